"""By how much a measured speed is late: the shift at which it is most like the derivative of its angle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_LONGEST_S = 1.0
LEAST_ROWS = 64
CLEAR = 0.5
"""Correlation below which the two have nothing to do with each other."""


def lag_of_speed(angle: NDArray[np.float64], speed: NDArray[np.float64], rate: float) -> float:
    """Seconds by which `speed` is behind the derivative of `angle`, at most a second; NaN where they are not alike.

    angle, speed: (n,), evenly sampled at `rate` [Hz]. The peak of the cross-correlation, between
    the samples by a parabola.
    """
    if len(angle) < LEAST_ROWS or not math.isfinite(rate):
        return math.nan
    own = np.gradient(angle) * rate
    own, other = own - own.mean(), speed - speed.mean()
    size = 1 << (2 * len(own) - 1).bit_length()
    product = np.fft.irfft(np.conj(np.fft.rfft(own, size)) * np.fft.rfft(other, size), size)
    reach = min(max(1, round(_LONGEST_S * rate)), len(own) // 4)
    shifts = np.arange(-reach, reach + 1)
    near = product[shifts]
    best = int(np.argmax(near))
    scale = math.sqrt(float(own @ own) * float(other @ other))
    if scale == 0.0 or near[best] < CLEAR * scale or best in (0, len(near) - 1):
        return math.nan
    left, top, right = near[best - 1 : best + 2]
    bend = left - 2.0 * top + right
    offset = 0.5 * (left - right) / bend if bend else 0.0
    return float((shifts[best] + offset) / rate)
