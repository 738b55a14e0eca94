"""Labels for a recording that has none, from its motion alone: what a person may take over or correct."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.units import REVOLUTION
from rig.runfile.importing.channel_map import ForeignSegment

BLOCK_S = 0.05
"""Length of the blocks of rows whose change is looked at."""
STEADY = 0.05
"""Relative change of the speed within which a stretch is steady."""
_LEAST_BLOCKS = 10
STILL = 0.01
MOST = 200
"""Stretches that are proposed; a motion that never rests has none."""


def propose(
    changes: NDArray[np.float64], begins: NDArray[np.float64], unit: str
) -> list[ForeignSegment]:
    """`step`, `traverse` and `hold` from the change of the angle over blocks that begin at `begins` [s].

    A stretch of at least ten blocks at one speed (to 5 %) is a `step` where the blocks before it
    stand still, a `traverse` where a whole revolution is turned, else a `hold`.
    """
    if not len(changes) or not np.abs(changes).max():
        return []
    seconds = float(np.median(np.diff(begins))) if len(begins) > 1 else BLOCK_S
    edges = np.concatenate([begins, begins[-1:] + seconds])
    still = np.abs(changes) < STILL * np.abs(changes).max()
    found: list[ForeignSegment] = []
    begin = 0
    while begin < len(changes) and len(found) < MOST:
        end = _steady_until(changes, begin)
        if still[begin] or end - begin < _LEAST_BLOCKS:
            begin += 1
            continue
        start = _onset(still, begin)
        speed = float(changes[begin:end].mean()) / seconds
        turned = abs(float(changes[begin:end].sum()))
        label = "hold"
        if start < begin:
            label = "step"
        elif unit == "rad" and turned >= REVOLUTION:
            label = "traverse"
        found.append(
            ForeignSegment(
                label=label,
                start=float(edges[start]),
                stop=float(edges[end]),
                setpoint=speed,
                direction=int(np.sign(speed)),
                repeat=sum(s.label == label and s.direction == np.sign(speed) for s in found),
            )
        )
        begin = end
    return found


def _steady_until(changes: NDArray[np.float64], begin: int) -> int:
    """The end of the stretch from `begin` on in which the speed stays within its tolerance of its mean."""
    end, total, mean = begin, 0.0, float(changes[begin])
    while end < len(changes) and not abs(changes[end] - mean) > STEADY * abs(mean):
        total += float(changes[end])
        end += 1
        mean = total / (end - begin)
    return end


def _onset(still: NDArray[np.bool_], begin: int) -> int:
    """The block in which a stretch was started from rest; its own beginning where it was not, or slowly."""
    for back in (1, 2, 3):
        if begin - back >= 1 and still[begin - back] and still[begin - back - 1]:
            return begin - max(back - 1, 1)
    return begin
