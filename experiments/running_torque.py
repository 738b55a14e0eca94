"""Running torques of a recording: one per segment at constant speed, averaged over whole input revolutions.

The averaging itself is `model.identify.running_torque`; here segments are found, cut from the recording and zeroed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from experiments.quality import usable
from experiments.recording import Recording, Segment
from experiments.stretches import stretches
from experiments.zero import TorqueZero
from model.errors import IdentificationError
from model.identify.running_torque import RunningTorque, average_torque
from model.units import REVOLUTION

TEMPERATURE = "housing_temperature"
LARGEST_HOLD = 2_000_000
"""Rows of one hold that are loaded at once; a longer one is cut to its last rows."""
STEADY_RIPPLE = 0.1
"""Relative ripple of the speed up to which a piece of a foreign recording counts as constant speed."""


@dataclass(frozen=True)
class Hold:
    """One segment at constant speed and its running torque."""

    segment: Segment
    torque: RunningTorque


def measured_holds(
    recording: Recording, segments: Iterable[Segment], zero: TorqueZero, channel: str = "torque"
) -> tuple[list[Hold], list[str]]:
    """The running torque of each segment, in order; words say which segments could not be used and why."""
    holds: list[Hold] = []
    unused: list[str] = []
    for segment in segments:
        try:
            holds.append(Hold(segment, _average(recording, segment, zero, channel)))
        except IdentificationError as error:
            unused.append(f"{segment.label} {segment.index} ({error.what})")
    warnings = []
    if unused:
        few = ", ".join(unused[:3]) + (" ..." if len(unused) > 3 else "")
        warnings.append(f"{len(unused)} segments were left out: {few}.")
    return holds, warnings


def _average(recording: Recording, segment: Segment, zero: TorqueZero, channel: str) -> RunningTorque:
    # A guard counts revolutions from the row before the segment: without it the last of them would be short by a cycle.
    rows = slice(max(segment.start - 1, segment.stop - LARGEST_HOLD, 0), segment.stop)
    good = usable(recording, rows)
    time = recording.time(rows)[good]
    torque = recording.si(channel, rows)[good] - zero.at(time)
    temperature = float(np.mean(recording.si(TEMPERATURE, rows)[good])) if recording.has(TEMPERATURE) else math.nan
    return average_torque(time, recording.si("input_angle", rows)[good], torque, temperature=temperature)


def foreign_holds(
    recording: Recording, zero: TorqueZero, channel: str, least_time: float = 0.5
) -> tuple[list[Hold], list[str]]:
    """Running torques of a recording without segments, by speed.

    Every stretch in one direction is cut into pieces of whole input revolutions that last at least `least_time` [s]; a piece
    counts where its speed is steady within `STEADY_RIPPLE`. Stretches begin one revolution after each reversal.
    """
    pieces: list[Segment] = []
    for stretch in stretches(recording, "hold"):
        pieces += _pieces(recording, stretch, least_time)
    holds, _ = measured_holds(recording, pieces, zero, channel)
    steady = [h for h in holds if h.torque.speed_ripple <= STEADY_RIPPLE]
    text = (
        f"The recording has no segments: {len(steady)} pieces of whole revolutions at steady speed were found from the "
        f"input angle ({len(pieces) - len(steady)} others left out)."
    )
    return steady, [text]


def _pieces(recording: Recording, stretch: Segment, least_time: float) -> list[Segment]:
    """Consecutive pieces of one stretch, each of whole revolutions and at least `least_time` long."""
    angle, time = recording.si("input_angle", stretch), recording.time(stretch)
    travelled = np.maximum.accumulate(stretch.direction * (angle - angle[0]))
    marks = np.searchsorted(travelled, np.arange(0.0, travelled[-1], REVOLUTION))
    found: list[Segment] = []
    begin = 0
    for end in range(1, len(marks)):
        if time[marks[end]] - time[marks[begin]] < least_time:
            continue
        start, stop = stretch.start + int(marks[begin]), stretch.start + int(marks[end]) + 1
        found.append(Segment(len(found), "hold", start, stop, stretch.setpoint, stretch.direction, stretch.repeat))
        begin = end
    return found
