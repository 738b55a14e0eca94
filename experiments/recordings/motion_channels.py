"""The channels of a motion, read from a recording block by block: which they are, in which unit, how late."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.errors import AnalysisError
from experiments.evidence import usable
from experiments.need import ANGLES, EFFORTS
from experiments.planning.parts import ZERO_AFTER, ZERO_BEFORE
from experiments.recording import Recording
from experiments.recordings.channels import chosen_channel, stated, stated_lag
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.identify.motion_source import MotionBlock, TimeAxis, UnbrokenRows, time_axis

_SPEED_OF: Mapping[str, tuple[str, ...]] = {
    "input_angle": ("input_speed", "speed"),
    "position": ("speed",),
    "output_angle": ("output_speed", "speed"),
}
"""The measured speeds of each position."""
SPEEDS = ("input_speed", "speed", "output_speed")
SET_POINTS = ("target_position",)
"""What an axis was told to do carries none of its encoder's noise."""
NONE = "none"
BLOCK = 1 << 18
_UNITS_OF_PLACE = ("rad", "m")
_PERIOD_ROWS = 4096


@dataclass(frozen=True, kw_only=True)
class RecordedMotion:
    """A motion in a recording: a `MotionSource`. `place` is the position, or a speed where there is none."""

    recording: Recording
    place: str
    effort: str
    instrument: str
    rows: slice
    zero: TorqueZero | None

    @property
    def is_position(self) -> bool:
        """Whether a position was recorded."""
        return self._unit in _UNITS_OF_PLACE

    @property
    def instrument_is_position(self) -> bool:
        """Whether the instrument is a set-point of position."""
        return self.instrument in SET_POINTS

    @property
    def position_unit(self) -> str:
        """rad or m."""
        return self._unit.removesuffix("/s")

    @property
    def effort_unit(self) -> str:
        return self.recording.signals[self.effort].unit

    @property
    def is_mechanical(self) -> bool:
        """Whether effort and position are torque and angle, or force and length."""
        return (self.effort_unit, self.position_unit) in (("N m", "rad"), ("N", "m"))

    @property
    def _unit(self) -> str:
        return self.recording.signals[self.place].unit

    @property
    def period(self) -> float:
        return self.axis.period

    @property
    def is_even(self) -> bool:
        return self.axis.is_even

    @property
    def stretches(self) -> Sequence[UnbrokenRows]:
        return self.axis.stretches

    @functools.cached_property
    def axis(self) -> TimeAxis:
        """The time axis of the rows that can be used."""
        first, last = self.rows.start, self.rows.stop
        starts = {first, (first + last) // 2, max(first, last - _PERIOD_ROWS)}
        steps = [
            np.diff(self.recording.time(slice(s, min(s + _PERIOD_ROWS, last)))) for s in starts
        ]
        return time_axis(self._stamps(), float(np.median(np.concatenate(steps))))

    @functools.cached_property
    def stated_lag(self) -> float | None:
        """How late the effort is beside the place [s], where the import states it; None where nobody does."""
        late = stated_lag(self.recording, self.effort)
        return None if late is None else late - (stated_lag(self.recording, self.place) or 0.0)

    def _stamps(self) -> Iterator[tuple[int, FloatArray]]:
        # A row that cannot be used leaves its time out of its block: it becomes a long step, as a lost one does.
        for rows in self.recording.blocks(self.rows, BLOCK):
            time = self.recording.time(rows)
            good = usable(self.recording, rows)
            if good.all():
                yield rows.start, time
                continue
            for start, stop in _runs(good):
                yield rows.start + start, time[start:stop]

    def read(self, start: int, stop: int) -> MotionBlock:
        """The rows [start, stop) that can be used, the zero taken off the effort."""
        rows = slice(start, stop)
        good = usable(self.recording, rows)
        time = self.recording.time(rows)[good]
        effort = self.recording.si(self.effort, rows)[good]
        place = self._sensed(self.place, rows)[good]
        return MotionBlock(
            time=time,
            effort=effort if self.zero is None else effort - self.zero.at(time),
            position=place if self.is_position else None,
            speed=None if self.is_position else place,
            instrument=self._sensed(self.instrument, rows)[good] if self.instrument else None,
        )

    def stamp(self, row: int) -> float:
        """The time of a row [s]."""
        return float(self.recording.time(slice(row, row + 1))[0])

    def _sensed(self, name: str, rows: slice) -> FloatArray:
        """A channel counted positive along a positive input; as recorded where nobody said how the output counts."""
        values = self.recording.si(name, rows)
        turned = name.startswith("output_") and not self.sense_is_unknown
        return self.recording.metadata.output_sense * values if turned else values

    @property
    def sense_is_unknown(self) -> bool:
        """Whether an imported output channel is used whose sense nobody stated."""
        is_imported = self.recording.metadata.origin == "imported"
        said = bool(stated(self.recording).get("output_sense"))
        return self.place.startswith("output_") and is_imported and not said


def _runs(good: np.ndarray) -> list[tuple[int, int]]:
    """Runs [start, stop) of rows that can be used."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def recorded_motion(recording: Recording, settings: Mapping[str, Any], kind: str) -> RecordedMotion:
    """The motion of a recording as the settings position, effort, instrument, start and stop choose it.

    Raises `AnalysisError` for a channel that is not there or is in no unit of a position.
    """
    place = _place(recording, settings, kind)
    effort = chosen_channel(
        recording, settings, "effort", (*EFFORTS, "output_torque"), "inverse dynamics"
    )
    has_zero = bool(recording.labelled(ZERO_BEFORE, ZERO_AFTER))
    return RecordedMotion(
        recording=recording,
        place=place,
        effort=effort,
        instrument=_instrument(recording, settings, place, kind),
        rows=_rows(recording, settings, kind),
        zero=torque_zero(recording, effort) if has_zero else None,
    )


def _place(recording: Recording, settings: Mapping[str, Any], kind: str) -> str:
    place = chosen_channel(recording, settings, "position", (*ANGLES, *SPEEDS), "the motion")
    unit = recording.signals[place].unit
    what, allowed = "a position", _UNITS_OF_PLACE
    if place in SPEEDS:
        what, allowed = "a speed", tuple(f"{u}/s" for u in _UNITS_OF_PLACE)
    if unit not in allowed:
        raise AnalysisError(
            f"is not {what}",
            where=f"{kind}.position: {place}",
            value=f"unit {unit or 'none'}",
            limit=" or ".join(allowed),
            remedy="Name the channel with the setting position=NAME, or correct the map of the import.",
        )
    return place


def _instrument(recording: Recording, settings: Mapping[str, Any], place: str, kind: str) -> str:
    """A channel that shows the same motion with another noise; "" where there is none."""
    wanted = settings.get("instrument")
    if wanted == NONE or place in SPEEDS:
        return ""
    unit = recording.signals[place].unit
    units = {name: unit for name in SET_POINTS} | {n: f"{unit}/s" for n in _SPEED_OF.get(place, ())}
    if wanted is not None:
        recording.require("the instrument", str(wanted))
        units = {str(wanted): unit if str(wanted) in SET_POINTS else f"{unit}/s"}
    for name, needed in units.items():
        if recording.has(name):
            found = recording.signals[name].unit
            if found == needed:
                return name
            raise AnalysisError(
                "does not go with the position",
                where=f"{kind}: {name}",
                value=f"unit {found or 'none'}",
                limit=needed,
                remedy="Correct the map of the import, or leave the channel out with instrument=none.",
            )
    return ""


def _rows(recording: Recording, settings: Mapping[str, Any], kind: str) -> slice:
    """The part of the run that is used: between the torque zeros, or from `start` to `stop` seconds."""
    first, last = 0, recording.rows
    for segment in recording.labelled(ZERO_BEFORE):
        first = max(first, segment.stop)
    for segment in recording.labelled(ZERO_AFTER):
        last = min(last, segment.start)
    if "start" in settings or "stop" in settings:
        begin = number(settings, "start", kind, -math.inf)
        end = number(settings, "stop", kind, math.inf)
        inside = [
            (rows.start + at[0], rows.start + at[-1] + 1)
            for rows in recording.blocks(size=BLOCK)
            if len(at := _between(recording.time(rows), begin, end))
        ]
        first, last = (inside[0][0], inside[-1][1]) if inside else (0, 0)
    if last - first < 2:
        raise AnalysisError(
            "the chosen part of the run is empty", where=f"{kind}.start, {kind}.stop"
        )
    return slice(int(first), int(last))


def _between(time: FloatArray, begin: float, end: float) -> np.ndarray:
    return np.flatnonzero((time >= begin) & (time <= end))


def number(settings: Mapping[str, Any], name: str, kind: str, usual: float) -> float:
    """A setting as a number; `AnalysisError` for what is none."""
    value = settings.get(name, usual)
    try:
        return float(value)
    except (TypeError, ValueError):
        raise AnalysisError(
            "is not a number", where=f"{kind}.{name}", value=repr(value), limit="a number"
        ) from None
