"""Running torques of a recording: one per segment at constant speed, averaged over whole input revolutions.

The averaging itself is `model.identify.running_torque`; here segments are found, cut from the recording and zeroed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from experiments.angle.traverses import traverses_of
from experiments.evidence import usable
from experiments.recording import Recording, Segment
from experiments.torque.zero import TorqueZero
from model.errors import IdentificationError
from model.identify.running_torque import RunningTorque, average_torque
from model.units import REVOLUTION

TEMPERATURE = "housing_temperature"
_LARGEST_HOLD = 2_000_000
"""Rows of one hold that are loaded at once; a longer one is cut to its last rows."""
_STEADY_RIPPLE = 0.1
"""Relative change of speed up to which a piece of a foreign recording counts as constant speed."""
MARKS = 10
"""Marks per input revolution at which the speed of a foreign recording is looked at."""


@dataclass(frozen=True)
class Hold:
    """One segment at constant speed, its running torque, and the output angles [rad] from where to where it turned."""

    segment: Segment
    torque: RunningTorque
    place: tuple[float, float] | None = None


def measured_holds(
    recording: Recording, segments: Iterable[Segment], zero: TorqueZero, channel: str = "torque"
) -> tuple[list[Hold], list[str]]:
    """The running torque of each segment, in order; words say which segments could not be used and why."""
    holds: list[Hold] = []
    unused: list[str] = []
    for segment in segments:
        try:
            holds.append(
                Hold(
                    segment, _average(recording, segment, zero, channel), _place(recording, segment)
                )
            )
        except IdentificationError as error:
            unused.append(f"{segment.label} {segment.index} ({error.what})")
    warnings: list[str] = []
    if unused:
        few = ", ".join(unused[:3]) + (" ..." if len(unused) > 3 else "")
        warnings.append(f"{len(unused)} segments were left out: {few}.")
    return holds, warnings


def _average(
    recording: Recording, segment: Segment, zero: TorqueZero, channel: str
) -> RunningTorque:
    # A guard counts revolutions from the row before the segment: without it the last of them would be short by a cycle.
    rows = slice(max(segment.start - 1, segment.stop - _LARGEST_HOLD, 0), segment.stop)
    good = usable(recording, rows)
    time = recording.time(rows)[good]
    torque = recording.si(channel, rows)[good] - zero.at(time)
    temperature = math.nan
    if recording.has(TEMPERATURE):
        temperature = float(np.mean(recording.si(TEMPERATURE, rows)[good]))
    return average_torque(
        time, recording.si("input_angle", rows)[good], torque, temperature=temperature
    )


def _place(recording: Recording, segment: Segment) -> tuple[float, float] | None:
    if not recording.has("output_angle") or not recording.metadata.gear_mounted:
        return None
    begin = recording.output_angle(slice(segment.start, segment.start + 1))
    end = recording.output_angle(slice(segment.stop - 1, segment.stop))
    return float(begin[0]), float(end[0])


def foreign_holds(
    recording: Recording, zero: TorqueZero, channel: str, least_time: float = 0.5
) -> tuple[list[Hold], list[str]]:
    """Running torques of a recording without segments, by speed.

    Every traverse in one direction is cut into pieces of whole input revolutions that last at least
    `least_time` [s]; a piece counts where its speed is steady within `_STEADY_RIPPLE`. Traversees
    begin one revolution after each reversal.
    """
    pieces: list[Segment] = []
    for traverse in traverses_of(recording, "hold"):
        pieces += _pieces(recording, traverse, least_time)
    holds, _ = measured_holds(recording, pieces, zero, channel)
    steady = [h for h in holds if h.torque.speed_ripple <= _STEADY_RIPPLE]
    text = (
        f"The recording has no segments: {len(steady)} pieces of whole revolutions at steady speed were found from the "
        f"input angle ({len(pieces) - len(steady)} others left out)."
    )
    return steady, [text]


def _pieces(recording: Recording, traverse: Segment, least_time: float) -> list[Segment]:
    """Pieces of one traverse at steady speed, each of whole revolutions and at least `least_time` long."""
    angle, time = recording.si("input_angle", traverse), recording.time(traverse)
    travelled = np.maximum.accumulate(traverse.direction * (angle - angle[0]))
    marks = np.searchsorted(travelled, np.arange(0.0, travelled[-1], REVOLUTION / MARKS))
    pieces: list[Segment] = []
    for first, last in _steady_runs(time[marks]):
        begin = first
        for end in range(first + MARKS, last + 1, MARKS):
            if time[marks[end]] - time[marks[begin]] < least_time:
                continue
            start, stop = traverse.start + int(marks[begin]), traverse.start + int(marks[end]) + 1
            pieces.append(
                Segment(
                    index=len(pieces),
                    label="hold",
                    start=start,
                    stop=stop,
                    setpoint=traverse.setpoint,
                    direction=traverse.direction,
                    repeat=traverse.repeat,
                )
            )
            begin = end
    return pieces


def _steady_runs(times: np.ndarray) -> list[tuple[int, int]]:
    """First and last mark of every run of marks (tenths of a revolution) whose speed stays within `_STEADY_RIPPLE`.

    The first mark of a run is left out: it may still hold the change of speed.
    """
    speed = 1.0 / np.maximum(np.diff(times), 1e-9)
    runs: list[tuple[int, int]] = []
    begin = 0
    for k in range(1, len(speed) + 1):
        mean = float(np.median(speed[begin:k]))
        if k < len(speed) and abs(speed[k] / mean - 1.0) <= _STEADY_RIPPLE:
            continue
        if k - begin > MARKS:
            runs.append((begin + 1, k))
        begin = k
    return runs
