"""A run in Python: a recording with its channels in SI, as arrays, as a data frame, as a data set, as a figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from experiments.recording import Segment
from rig.api.tables import Tabular
from rig.content.grid import Grid, columns
from rig.content.phrase import phrase
from rig.errors import RigError
from rig.extras import optional
from rig.runfile.contents import segment_grid

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from experiments.recording import Event, Recording, RunMetadata
    from model.arrays import FloatArray


class Segments(Tabular, Sequence[Segment]):
    """The labelled intervals of a run, in the order they were recorded; a table where it is shown."""

    def __init__(self, segments: Sequence[Segment], run_id: str) -> None:
        self._segments, self._run_id = tuple(segments), run_id

    @overload
    def __getitem__(self, place: int) -> Segment: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Segment, ...]: ...
    def __getitem__(self, place: int | slice) -> Segment | tuple[Segment, ...]:
        return self._segments[place]

    def __len__(self) -> int:
        return len(self._segments)

    def labelled(self, *labels: str) -> tuple[Segment, ...]:
        """Those with one of these labels."""
        return tuple(segment for segment in self._segments if segment.label in labels)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per segment: label, first row, end, set-point (SI), direction, repeat."""
        frame = optional("pandas", "a data frame of segments").DataFrame
        return frame([vars(segment) for segment in self._segments], columns=list(_FIELDS))

    def _grid(self) -> Grid:
        title = f"{len(self._segments)} segments of run {self._run_id}"
        return segment_grid(self._segments, title)


_FIELDS = ("index", "label", "start", "stop", "setpoint", "direction", "repeat")


class Run(Tabular):
    """One recording: executed, loaded, imported or simulated. Rows are read when they are asked for.

    `run["torque"]` is a channel in SI over all rows, `run.time` the seconds since the first row. A run that came
    from a file holds it open until `close()`, the end of a `with` block, or its own end.
    """

    def __init__(self, recording: Recording, path: Path | None = None) -> None:
        self.recording = recording
        """What analyses see of it (`experiments.recording`)."""
        self.path = path
        """The run file; None for a recording in memory."""

    @property
    def id(self) -> str:
        """The name of the run."""
        return self.recording.metadata.run_id

    @property
    def metadata(self) -> RunMetadata:
        """Who, what, when and on what: protocol, gear, origin, conditions, parameters, calibrations' hash."""
        return self.recording.metadata

    @property
    def outcome(self) -> str:
        """How it ended: COMPLETED, ABORTED, TRIPPED, ERROR, INTERRUPTED; "" for a recording of another rig."""
        return self.metadata.outcome

    @property
    def rows(self) -> int:
        """Number of cycles."""
        return self.recording.rows

    @property
    def channels(self) -> dict[str, str]:
        """The channels and their SI units."""
        return {name: channel.unit for name, channel in self.recording.signals.items()}

    @property
    def segments(self) -> Segments:
        """The labelled intervals: which set-point, which direction, which repeat."""
        return Segments(self.recording.segments, self.id)

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened: states, trips, prompts, notes, and what an import had to say."""
        return self.recording.events

    @property
    def warnings(self) -> tuple[str, ...]:
        """The texts of the events that are warnings or errors."""
        return tuple(e.text for e in self.events if e.level in ("warning", "error"))

    @property
    def time(self) -> FloatArray:
        """Seconds since the first row (n,). Raises `RigError` for a recording without a time base."""
        if self.metadata.time_base == "none":
            raise RigError(
                "this recording has no time base", where=self.id, remedy="Plot it over an angle."
            )
        return self.recording.time()

    def __getitem__(self, channel: str) -> FloatArray:
        return self.si(channel)

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def si(self, channel: str, where: Segment | slice | None = None) -> FloatArray:
        """A channel in SI over a segment, over a slice of rows, or over all. Raises `AnalysisError` for none such."""
        self.recording.require("this", channel)
        return self.recording.si(channel, where)

    def to_pandas(self, *channels: str, where: Segment | slice | None = None) -> pandas.DataFrame:
        """These channels (all without any named) in SI, one row per cycle, over the time in seconds.

        Over the row number where there is no time base. `attrs` holds units, run and origin. The index of a
        segment is the time since the first row of the run.
        """
        frame = optional("pandas", "a data frame").DataFrame
        names = channels or tuple(self.channels)
        columns = {name: self.si(name, where) for name in names}
        index = self._axis(where)
        made = frame(columns, index=index)
        made.index.name = self._axis_name
        made.attrs = {**self._attributes, "units": {name: self.channels[name] for name in names}}
        return made

    def to_xarray(self, *channels: str, where: Segment | slice | None = None) -> xarray.Dataset:
        """These channels (all without any named) in SI over the time, each with its unit, as a data set."""
        dataset = optional("xarray", "a data set").Dataset
        axis = self._axis_name
        signals = self.recording.signals
        variables = {
            name: (
                axis,
                self.si(name, where),
                {"units": self.channels[name], "long_name": signals[name].long_name or name},
            )
            for name in channels or tuple(self.channels)
        }
        unit = {"units": "s"} if axis == "time" else {}
        coordinates = {axis: (axis, self._axis(where), unit)}
        return dataset(variables, coords=coordinates, attrs=self._attributes)

    def plot(self, *channels: str, where: Segment | slice | None = None) -> Figure:
        """These channels over the time, under each other; without any named the first four. A matplotlib figure."""
        from experiments.result import Panel, Plot, Series
        from rig.present.figure import draw_figure

        names = channels or tuple(self.channels)[:_SHOWN_CHANNELS]
        axis = self._axis(where)
        labels = [f"{name} [{self.channels.get(name, '')}]" for name in names]
        series = tuple(
            Series(label=name, x=axis, y=self.si(name, where), group=place, panel=place)
            for place, name in enumerate(names)
        )
        plot = Plot(
            name="channels",
            title=self.metadata.title or self.id,
            x_label="time [s]" if self._axis_name == "time" else "row",
            y_label=labels[0],
            series=series,
            panels=tuple(Panel(label, 1.0) for label in labels[1:]),
        )
        return draw_figure(plot, self.metadata.origin)

    def close(self) -> None:
        """Let go of the file behind it; nothing can be read any more."""
        from rig.runfile.read import close_recording

        close_recording(self.recording)

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _axis_name(self) -> str:
        return "row" if self.metadata.time_base == "none" else "time"

    def _axis(self, where: Segment | slice | None) -> Any:
        import numpy as np

        if self._axis_name == "time":
            return self.recording.time(where)
        return np.arange(*self.recording.rows_of(where))

    @property
    def _attributes(self) -> dict[str, str]:
        metadata = self.metadata
        return {
            "run": self.id,
            "origin": metadata.origin,
            "protocol": metadata.experiment,
            "gear": metadata.gear_serial,
            "start_time": metadata.start_time,
            "sha256": metadata.sha256,
        }

    def _grid(self) -> Grid:
        metadata = self.metadata
        words = (metadata.experiment or "recording", metadata.origin.upper(), self.outcome)
        gear = phrase(", gear {}", metadata.gear_serial)
        span = f" at {metadata.sample_rate:.6g} Hz" if metadata.sample_rate > 0.0 else ""
        title = f"Run {self.id}: {' '.join(filter(None, words))}{gear}, {self.rows} rows{span}"
        rows = [(name, one.unit, one.long_name) for name, one in self.recording.signals.items()]
        counts = f"{len(self.recording.segments)} segments, {len(self.events)} events"
        remarks = "\n".join((counts, *self.warnings))
        return Grid(title, columns("channel", ("unit", "unit"), "what"), rows, remarks)


def file_of(run: Run | str | Path) -> Path | None:
    """The file of a run; None for one in memory."""
    return run.path if isinstance(run, Run) else Path(run)


_SHOWN_CHANNELS = 4
"""Channels of a figure for which nobody named any."""
