"""Jumps of an angle as a wrapped one has them: one step back by (nearly) the whole range while it goes on forward."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LEAST_RAD = 0.3
"""Smallest jump that counts: below it are dither, noise and slow counters."""
_LARGER = 2.5
"""A jump is so many times larger than the steps beside it."""
_OF_RANGE = 0.5
"""A jump goes over more than this share of all that was turned nearby."""
_USUAL_RANGES = (360.0, 6.283185307179586, 1.0, 400.0, 4096.0, 8192.0, 16384.0, 65536.0)
"""Ranges of wrapped columns that are met: degrees, radians, revolutions, gon, counts."""


def wraps(values: NDArray[np.float64], scale: float) -> NDArray[np.intp]:
    """The rows at which an angle jumps as if it were wrapped; values (n,) times `scale` are rad.

    A jump stands alone: the steps beside it are much smaller and, where they are any, go the other
    way. A spike has two jumps side by side, a start of motion large steps after it: neither is one.
    """
    if len(values) < 4:
        return np.zeros(0, dtype=np.intp)
    steps = np.diff(values)
    step, before, after = steps[1:-1], steps[:-2], steps[2:]
    beside = np.maximum(np.abs(before), np.abs(after))
    alone = np.abs(step) > _LARGER * beside
    against = (step * before <= 0.0) & (step * after <= 0.0)
    far = (np.abs(step) * scale > _LEAST_RAD) & (np.abs(step) > _OF_RANGE * np.ptp(values))
    return np.flatnonzero(alone & against & far) + 2


def range_like(jump: float) -> float:
    """The usual range of a wrapped column that a jump is nearest to; the jump itself where none is near."""
    near = (usual for usual in _USUAL_RANGES if abs(jump - usual) < 0.1 * usual)
    return next(near, round(jump))
