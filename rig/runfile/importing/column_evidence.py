"""What the numbers of a column tell of it: a time, a derivative, an effort, two angles in proportion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
SAME = 0.98
"""Correlation from which on a column is the derivative of another, or an angle in proportion to another."""
_LEAST_ROWS = 20
_EVEN = 0.2
"""Relative scatter of the steps of an even time (median absolute deviation over median)."""


def never_falls(values: Numbers) -> bool:
    """Whether a column that is called a time can be one; a line that is none of the table is a matter of the import."""
    values = values[np.isfinite(values)]
    return len(values) > 1 and float(np.diff(values).min()) >= 0.0


def rises_evenly(values: Numbers) -> bool:
    """Whether a column is a time: it only rises, and mostly by the same."""
    values = values[np.isfinite(values)]
    if len(values) < _LEAST_ROWS:
        return False
    steps = np.diff(values)
    middle = float(np.median(steps))
    if middle <= 0.0 or steps.min() < 0.0:
        return False
    return float(np.median(np.abs(steps - middle))) <= _EVEN * middle


def derivative(angle: Numbers, speed: Numbers, time: Numbers) -> tuple[float, float]:
    """Correlation of the derivative of one column with another, and the slope; (0, 0) where nothing moves."""
    n = min(len(angle), len(speed), len(time))
    good = np.isfinite(angle[:n]) & np.isfinite(speed[:n]) & np.isfinite(time[:n])
    a, s, t = angle[:n][good], speed[:n][good], time[:n][good]
    if len(a) < _LEAST_ROWS or np.ptp(a) == 0.0 or np.ptp(s) == 0.0:
        return 0.0, 0.0
    # Over stretches, so that the resolution of the angle does not drown it.
    stride = max(1, len(a) // 2000)
    rows = np.arange(0, len(a) - 4 * stride, stride)
    lasting = t[rows + 4 * stride] - t[rows]
    rows, lasting = rows[lasting > 1e-9], lasting[lasting > 1e-9]
    if len(rows) < 3:
        return 0.0, 0.0
    rate = (a[rows + 4 * stride] - a[rows]) / lasting
    cumulated = np.concatenate(([0.0], np.cumsum(s)))
    mean = (cumulated[rows + 4 * stride] - cumulated[rows]) / (4 * stride)
    if np.ptp(rate) == 0.0 or np.ptp(mean) == 0.0:
        return 0.0, 0.0
    return float(np.corrcoef(rate, mean)[0, 1]), float(rate @ mean / (mean @ mean))


def sign_share(effort: Numbers, speed: Numbers) -> float:
    """How often an effort has the sign of the speed where that moves; 0 where one of them says nothing."""
    if len(effort) != len(speed) or np.nanstd(effort) == 0.0:
        return 0.0
    moving = np.abs(speed) > 0.1 * np.nanmax(np.abs(speed))
    return float(np.mean(np.sign(effort[moving]) == np.sign(speed[moving])))


def slope_of(first: Numbers, second: Numbers) -> float:
    """The second over the first, where the two are in proportion but for an offset; else NaN."""
    n = min(len(first), len(second))
    good = np.isfinite(first[:n]) & np.isfinite(second[:n])
    a, b = first[:n][good], second[:n][good]
    if len(a) < _LEAST_ROWS or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return math.nan
    if abs(float(np.corrcoef(a, b)[0, 1])) < SAME:
        return math.nan
    return float(np.polyfit(a - a.mean(), b - b.mean(), 1)[0])
