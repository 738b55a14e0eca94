"""Check of every channel that is averaged: it neither stands still while the rig turns, nor jumps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from experiments.evidence import usable
from experiments.evidence.holds import Recorded, part_of
from experiments.evidence.outcomes import not_checked, refused_beyond
from experiments.finding import Finding
from model.arrays import FloatArray

_STANDING_TORQUE = 50
"""Equal rows of a torque that has noise: an honest one has less than ten."""
_NOISY_SHARE = 0.2
"""Share of rows that differ from the one before, from which on a torque has noise."""
_STANDING_ANGLE = 0.1
"""rad of the input that may be turned while an angle stands still: what stick and slip may do at low speed."""
STANDING_COUNTS = 5.0
"""Counts of the angle beside that."""
_STANDS_SHARE = 0.5
"""Share of its mean movement below which an encoder stands beside one that stands."""
JUMP_SHARE, JUMP_COUNTS = 0.3, 30.0
"""Change of an angle from one row to the next beside its median: ripple of the speed, and counts."""


def continuity(recorded: Recorded) -> Finding:
    """The longest standstill and the largest jump of angles and torque in segments that turn, in units of the limit."""
    if not recorded.turning:
        return not_checked("there are no segments that turn")
    worst, text = 0.0, ""
    for name in _averaged(recorded):
        for hold in recorded.turning:
            rows = part_of(hold.segment, recorded.recording.rows)
            stored = recorded.recording.stored(name, rows).astype(np.float64)
            at = np.flatnonzero(usable(recorded.recording, rows))
            stored = stored[at]
            if len(stored) < 3:
                continue
            if name == recorded.torque:
                excess, what = _torque(stored)
            else:
                beside = _beside(recorded, name, rows, at)
                excess, what = _angle(stored, np.diff(at), abs(hold.input_travel), beside)
            if excess > worst:
                worst = excess
                text = f"{name} {what} ({hold.segment.label} {hold.segment.index})"
    return refused_beyond(
        worst > 1.0,
        text if worst > 1.0 else f"{worst:.2g} of what is allowed",
        "1",
        "a channel stands still or jumps where the rig turns steadily",
    )


def _averaged(recorded: Recorded) -> list[str]:
    """The channels that the analysis rests on: those that it needs; of one without a plan all that there are."""
    names = ["input_angle", recorded.torque]
    if recorded.recording.metadata.gear_mounted:
        names.append("output_angle")
    needs = recorded.experiment.needs or names
    return [name for name in names if recorded.recording.has(name) and name in needs]


def _torque(stored: FloatArray) -> tuple[float, str]:
    standing = _longest_run(stored)
    is_noisy = np.count_nonzero(np.diff(stored)) > _NOISY_SHARE * len(stored)
    return (standing / _STANDING_TORQUE if is_noisy else 0.0), f"stands still for {standing} rows"


def _beside(recorded: Recorded, name: str, rows: slice, at: NDArray[np.int64]) -> FloatArray | None:
    """The counts (n,) of the other encoder in the same rows; None where there is none."""
    other = "output_angle" if name == "input_angle" else "input_angle"
    if not (recorded.recording.has(other) and recorded.recording.metadata.gear_mounted):
        return None
    counts: FloatArray = recorded.recording.stored(other, rows).astype(np.float64)[at]
    return counts


def _angle(
    stored: FloatArray, apart: NDArray[np.int64], travel: float, beside: FloatArray | None
) -> tuple[float, str]:
    """Standstill and jump of counts, of which the whole segment has as many as the input turns `travel` [rad].

    `apart` (n - 1,): cycles from one row to the next; more than one where cycles between cannot be used. Where the
    other encoder (`beside`) stands as well the shaft itself does, by stick and slip, and nothing is wrong with either.
    """
    steps = np.diff(stored) / apart
    turned = abs(float(stored[-1] - stored[0]))
    mean = turned / float(apart.sum())
    if not (mean > 0.0 and travel > 0.0):
        return math.inf, "stands still"
    per_radian = turned / travel
    standing = _longest_run(stored, beside)
    # One row that equals none before it has not stood still at all.
    stood = (standing - 1) * mean / (_STANDING_ANGLE * per_radian + STANDING_COUNTS)
    median = float(np.median(steps))
    jump = float(np.abs(steps - median).max())
    jumped = jump / (JUMP_SHARE * abs(median) + JUMP_COUNTS)
    if stood > jumped:
        return stood, f"stands still for {standing} rows"
    return jumped, f"jumps by {jump:.4g} counts"


def _longest_run(stored: FloatArray, beside: FloatArray | None = None) -> int:
    """Rows of the longest piece in which nothing changes, but for pieces in which `beside` stands as well."""
    changes = np.flatnonzero(np.diff(stored))
    first = np.concatenate([[0], changes + 1])
    last = np.concatenate([changes, [len(stored) - 1]])
    rows = last - first + 1
    if beside is not None:
        mean = abs(float(beside[-1] - beside[0])) / (len(beside) - 1)
        moved = np.abs(beside[last] - beside[first])
        rows = np.where(moved < _STANDS_SHARE * mean * (rows - 1), 1, rows)
    return int(rows.max())
