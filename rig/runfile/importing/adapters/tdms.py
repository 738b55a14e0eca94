"""Channels of TDMS files, as LabVIEW, DIAdem and FlexLogger write them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.extras import optional
from rig.runfile.importing.adapters.arrays import NUMERIC
from rig.runfile.importing.adapters.blocks import (
    BlockTable,
    FileColumn,
    as_numbers,
    calendar_ns,
    headings_of,
    only_one,
    refused_damage,
    seconds_since,
    steps_of_rows,
)
from rig.runfile.importing.adapters.listening import heard

KIND = "TDMS file"
_UNIT = ("unit_string", "Unit", "unit")


@dataclass(frozen=True)
class _Step:
    """A stated column of time: seconds of the first row after the start of the file, step, rows."""

    first_s: float
    step_s: float
    rows: int


class TdmsTable(BlockTable):
    """The channels of a TDMS file, scaled as the file says; `unit_string` is the unit.

    A waveform's time follows from its `wf_increment`, `wf_start_offset` and `wf_start_time`; else the
    only channel of time stamps in a group is the time of the others there. Another column of time may
    be named in their place.
    """

    def __init__(self, path: Path) -> None:
        self._package = optional("nptdms", "reading TDMS files", "import")
        with self._open(path) as file:
            channels = [
                channel
                for group in file.groups()
                for channel in group.channels()
                if len(channel) and (channel.dtype.kind in NUMERIC or _is_moment(channel))
            ]
            is_cut = bool(file.file_status.incomplete_final_segment)
            said = _comments(file, channels)
            start_ns = min((found for c in channels if (found := _start(c))), default=0)
        names = headings_of([(channel.group_name, channel.name) for channel in channels])
        self._places: dict[str, tuple[str, str]] = {
            name: (channel.group_name, channel.name)
            for name, channel in zip(names, channels, strict=True)
        }
        self._steps: dict[str, _Step] = {}
        untimed: list[str] = []
        columns = [
            FileColumn(
                heading=name,
                unit="s" if _is_moment(channel) else _unit(channel.properties),
                rows=len(channel),
                time=self._time_of(channel, channels, names, start_ns, untimed),
                is_moment=_is_moment(channel),
            )
            for name, channel in zip(names, channels, strict=True)
        ]
        stated = [
            FileColumn(heading=name, unit="s", rows=step.rows, is_moment=bool(start_ns))
            for name, step in self._steps.items()
        ]
        super().__init__(path, [*columns, *stated], KIND, start_ns)
        self.take_said(said)
        if is_cut:
            self.notes += ("WARNING: the file was cut off while it was written",)
        if untimed:
            self.notes += (
                f"{', '.join(untimed)}: a step without a start, where other channels state one; it is not used",
            )

    @contextmanager
    def _open(self, path: Path) -> Iterator[Any]:
        """The file, closed whatever happens. Raises `RunFileError` for one that cannot be read."""
        # The stream is our own: the package leaves it open where the file is damaged.
        with refused_damage(path, KIND), path.open("rb") as stream:
            with heard("nptdms") as said:
                file = self._package.TdmsFile.open(stream)
            self.take_note(said)
            with file:
                yield file

    def _time_of(
        self,
        channel: Any,
        channels: Sequence[Any],
        names: Sequence[str],
        start_ns: int,
        untimed: list[str],
    ) -> str:
        """The heading of the column of time of a channel; "" where the file states none."""
        if _is_moment(channel):
            return ""
        step = _number(channel.properties, "wf_increment")
        if step > 0.0:
            own = _start(channel)
            if start_ns and not own:
                untimed.append(channel.name)
                return ""
            first = _number(channel.properties, "wf_start_offset") + (own - start_ns) * 1e-9
            found = _Step(first, step, len(channel))
            for name, other in self._steps.items():
                if other == found:
                    return name
            name = f"time of {names[channels.index(channel)]}"
            self._steps[name] = found
            return name
        beside = [
            name
            for name, other in zip(names, channels, strict=True)
            if other.group_name == channel.group_name and _is_moment(other)
        ]
        return only_one(beside)

    def blocks(self, columns: Sequence[int]) -> Iterator[NDArray[np.float64]]:
        names = [self.headings[index] for index in columns]
        with self._open(self.path) as file:
            for part in steps_of_rows(self._rows[columns[0]]):
                with heard("nptdms") as said:
                    values = np.column_stack([self._read(file, name, part) for name in names])
                self.take_note(said)
                yield values

    def _read(self, file: Any, name: str, part: slice) -> NDArray[np.float64]:
        step = self._steps.get(name)
        if step is not None:
            return step.first_s + np.arange(part.start, part.stop) * step.step_s
        group, channel = self._places[name]
        values = file[group][channel].read_data(part.start, part.stop - part.start)
        if np.asarray(values).dtype.kind == "M":
            return seconds_since(np.asarray(values), self.start_ns)
        return as_numbers(values, self.path, name)


def _comments(file: Any, channels: Sequence[Any]) -> dict[str, object]:
    """What stands in the properties of the file in words, and the description of each channel."""
    own = {name: text for name, text in file.properties.items() if isinstance(text, str)}
    of_channels = {c.name: c.properties.get("description") for c in channels}
    return {**own, **{name: text for name, text in of_channels.items() if isinstance(text, str)}}


def _is_moment(channel: Any) -> bool:
    return channel.dtype.kind == "M"


def _start(channel: Any) -> int:
    """Where the clock of a channel begins [ns since 1970]; 0 where the file does not say it."""
    if _is_moment(channel):
        return calendar_ns(channel.read_data(0, 1)[0])
    if _number(channel.properties, "wf_increment") <= 0.0:
        return 0
    return calendar_ns(channel.properties.get("wf_start_time"))


def _number(properties: Mapping[str, Any], name: str) -> float:
    """A property that is a number; 0 for what is none."""
    value = properties.get(name)
    if isinstance(value, (int, float, np.number)) and math.isfinite(float(value)):
        return float(value)
    return 0.0


def _unit(properties: Mapping[str, Any]) -> str:
    return next((str(properties[key]) for key in _UNIT if properties.get(key)), "")
