"""When the input of one ramp began to turn, and at which torque.

Breakaway is a change that stays: the last moment from which on the input is away from its rest. A single row says
nothing of it: both angles go through a running median, the torque is read from a line that stray rows do not move.
Where there are two encoders both must tell the same motion, as far as the output's can tell it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from experiments.evidence import usable
from experiments.recording import Recording, Segment
from experiments.torque.zero import TorqueZero
from model.arrays import FloatArray
from model.units import ARCMIN, DEGREE

FIRST_MOTION = 0.2 * DEGREE
"""Input angle that counts as motion; less is the elastic wind-up of gear and grease, or counts flickering."""
_QUIET_SHARE = 0.25
"""Share of it below which the input is at rest, as far as its encoder can tell."""
_STUCK = 0.4 * DEGREE
"""Standstill in an approach, in angle at its mean speed, from which on it sticks and slips: the output swings when the
input stops, and is no longer wound up as far as its friction held it."""
LEAST_ROWS = 20
"""Rows of a ramp without which nothing is told."""
_AT_REST = 5
"""Rows at the start of a ramp whose median is its rest."""
_MEDIAN = 5
"""Rows of the running median: up to two stray rows beside each other are no motion."""
_SUDDEN = 4.0
"""How many times as much as in the rows beside it an angle gains where its counter jumped; what has come loose gains
more and more."""
_WOUND = 2.0 * ARCMIN
"""Of the output: wind-up and kinematic error within a ramp, by which both encoders may differ."""
_FLICKER = 4.0
"""Counts of the output by which they may differ beside that."""
STRAY = 6.0
"""Standard deviations from the line of a ramp beyond which a reading of the torque is none."""


class Unused(StrEnum):
    """Why a ramp tells no breakaway."""

    STILL = "ended without a motion that stays"
    JUMPED = "ended by a jump of the input's counts"
    ALONE = "moved by one encoder only"


@dataclass(frozen=True)
class Breakaway:
    """One ramp: wave-generator position [rad], direction, torque at first motion [N m], input angle there [rad];
    how far the torque rose while it is not known whether motion had begun, half of it [N m]."""

    position: float
    direction: int
    torque: float
    angle: float
    within: float
    repeat: int = 0


def breakaway_of(recording: Recording, segment: Segment, zero: TorqueZero) -> Breakaway | Unused:
    """Torque and angle of one ramp at first motion, or why there is none."""
    good = usable(recording, segment)
    time = recording.time(segment)[good]
    if len(time) < LEAST_ROWS:
        return Unused.STILL
    signal = recording.signals["input_angle"]
    angle = settled(recording.si("input_angle", segment)[good])
    threshold = max(FIRST_MOTION, 3.0 * signal.quantum)
    rest = float(np.median(angle[:_AT_REST]))
    moved = np.abs(angle - rest)
    away = int(np.flatnonzero(moved <= threshold)[-1]) + 1
    if away >= len(moved) or away < LEAST_ROWS // 2:
        return Unused.STILL
    if _jumps(angle, 0.5 * threshold + 2.0 * signal.quantum):
        return Unused.JUMPED
    if not _is_seen_by_both(recording, segment, good, angle - rest):
        return Unused.ALONE
    first, within = first_motion(time[: away + 1], moved[: away + 1], threshold)
    torque = recording.si("torque", segment)[good] - zero.at(time)
    stop = int(np.searchsorted(time, first, side="right"))
    start = max(stop - max(stop // 2, LEAST_ROWS // 2), 0)
    slope, level = _line(time[start:stop] - first, torque[start:stop])
    return Breakaway(
        segment.setpoint, segment.direction, level, rest, within * abs(slope), segment.repeat
    )


def settled(angle: FloatArray) -> FloatArray:
    """An angle without its stray rows: the running median."""
    half = _MEDIAN // 2
    padded = np.pad(angle, half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _MEDIAN)
    return np.asarray(np.median(windows, axis=1), dtype=np.float64)


def _jumps(angle: FloatArray, least: float) -> bool:
    """Whether the angle gains at least so much [rad] in one row, and next to nothing in those before and after it."""
    step = np.abs(np.diff(angle))
    beside = np.zeros_like(step)
    for k in (1, 2):
        beside[k:] = np.maximum(beside[k:], step[:-k])
        beside[:-k] = np.maximum(beside[:-k], step[k:])
    return bool(np.any((step > least) & (step >= _SUDDEN * beside)))


def _is_seen_by_both(
    recording: Recording, segment: Segment, good: np.ndarray, travel: FloatArray
) -> bool:
    """Whether the output moved as the input did [rad], as far as its encoder tells; true where there is none."""
    ratio = recording.metadata.ratio
    is_there = recording.has("output_angle") and recording.metadata.gear_mounted
    if not (is_there and math.isfinite(ratio) and ratio > 0.0):
        return True
    outer = settled(recording.output_angle(segment)[good])
    apart = outer - float(np.median(outer[:_AT_REST])) - travel / ratio
    allowed = _WOUND + _FLICKER * recording.signals["output_angle"].quantum
    return float(np.abs(apart).max()) <= allowed


def _line(time: FloatArray, torque: FloatArray) -> tuple[float, float]:
    """Slope and value at time 0 of the straight line through a torque, without the readings far beside it."""
    level, slope = float(np.median(torque)), 0.0
    kept = np.ones(len(time), dtype=np.bool_)
    for _ in range(3):
        slope, level = (float(v) for v in np.polyfit(time[kept], torque[kept], 1))
        beside = np.abs(torque - level - slope * time)
        spread = 1.4826 * float(np.median(beside))
        kept = beside <= max(STRAY * spread, 1e-12)
        if kept.all() or np.count_nonzero(kept) < LEAST_ROWS // 2:
            break
    return slope, level


def first_motion(time: FloatArray, moved: FloatArray, threshold: float) -> tuple[float, float]:
    """When motion began [s], and within what [s] that is known.

    What has come loose gains angle with the square of time where a step of the torque has set it
    free, with its cube where the torque rises evenly. A straight line through the roots goes back
    to the moment of rest; it lies between those of the two laws.
    """
    quiet = int(np.flatnonzero(moved <= _QUIET_SHARE * threshold)[-1])
    still = float(time[quiet])
    later, angle = time[quiet + 1 :] - still, moved[quiet + 1 :]
    if len(angle) < 3 or angle[-1] <= angle[0]:
        half = 0.5 * float(time[quiet + 1] - still)
        return still + half, half
    begins: list[float] = []
    for power in (2.0, 3.0):
        slope, level = np.polyfit(later, angle ** (1.0 / power), 1)
        begins.append(float(min(max(-level / slope, -2.0 * later[-1]), 0.0)))
    return still + 0.5 * sum(begins), 0.5 * abs(begins[0] - begins[1])


def approach_remarks(recording: Recording, ramps: Iterable[Segment]) -> list[str]:
    """Ramps that were approached against their own direction: an older plan, or another program's."""
    approaches = recording.labelled("position")
    wrong = 0
    for ramp in ramps:
        before = [a for a in approaches if a.stop <= ramp.start]
        wrong += bool(before) and _turned(recording, before[-1]) * ramp.direction < 0.0
    if not wrong:
        return []
    return [
        f"{wrong} ramps were approached against their own direction: the gear was still wound up the other way, "
        "so that their torque is too low by up to twice what the output's friction asks of the input."
    ]


def stuck_share(recording: Recording) -> float:
    """The share of the approaches that stuck and slipped."""
    approaches = [a for a in recording.labelled("position") if a.stop - a.start > 2]
    return float(np.mean([_rest_angle(recording, a) > _STUCK for a in approaches] or [0.0]))


def _rest_angle(recording: Recording, segment: Segment) -> float:
    """The longest standstill in an approach as angle at its mean speed [rad]."""
    time, angle = recording.time(segment), recording.si("input_angle", segment)
    travelled = np.maximum.accumulate(np.abs(angle - angle[0]))
    moving = time[np.flatnonzero(np.diff(travelled, prepend=-1.0) > 0.0)]
    rests = np.diff(moving, append=time[-1])
    return float(rests.max() * travelled[-1] / (time[-1] - time[0]))


def _turned(recording: Recording, segment: Segment) -> float:
    angle = recording.si("input_angle", segment)
    return float(angle[-1] - angle[0])
