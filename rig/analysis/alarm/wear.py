"""What the hours of a gear do to a quantity: a straight line over hours, and when it meets a limit.

    x = Z b + slope hours + e ,      hours to the limit = (limit - level at the newest run) / slope

The interval is Fieller's: the hours h at which a line through the limit is not refuted at 95 %,
(limit - x(h))^2 <= t^2 v(h). Where it is open to one side the end is infinite. It says where a straight line goes,
and promises no remaining life.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.analysis.alarm.lines import Line, line
from rig.analysis.alarm.watching import Coefficient, coefficient

Array = NDArray[np.float64]

_LEAST_RUNS = 4


@dataclass(frozen=True, kw_only=True)
class Trend:
    """`slope` per hour; `to_limit` in hours from the newest run, None without a limit or a slope of known sign."""

    slope: Coefficient
    to_limit: Coefficient | None


def trend(
    values: Array, regressors: Array, hours: Array, limit: float | None, correlation: float
) -> Trend | None:
    """The trend of a series over the hours of its gear (NaN: not noted); None where the hours tell none."""
    usable = np.isfinite(regressors).all(axis=1) & np.isfinite(hours)
    if usable.sum() < _LEAST_RUNS + regressors.shape[1] or np.ptp(hours[usable]) <= 0.0:
        return None
    newest = float(hours[usable][-1])
    slope = coefficient(values, regressors, hours - newest, correlation).coefficient
    if not math.isfinite(slope.low):
        return None
    is_told = slope.low > 0.0 or slope.high < 0.0
    to_limit = None
    if is_told and limit is not None:
        matrix = np.column_stack([regressors[usable], hours[usable] - newest])
        to_limit = _to_limit(
            line(values[usable], matrix, correlation), regressors[usable][-1], limit
        )
    return Trend(slope=slope, to_limit=to_limit)


def _to_limit(found: Line, newest: Array, limit: float) -> Coefficient | None:
    """Hours to the limit at the regressors of the newest run; None where the line has passed it or leads away."""
    here = np.append(newest, 0.0)
    level, slope = float(here @ found.coefficients), float(found.coefficients[-1])
    middle = (limit - level) / slope
    if not middle > 0.0:
        return None
    # (limit - level - slope h)^2 = t^2 (v_level + 2 h c + h^2 v_slope), a square in h.
    square = found.quantile**2
    v_level, v_slope = float(here @ found.covariance @ here), float(found.covariance[-1, -1])
    c = float(here @ found.covariance[:, -1])
    a2 = slope**2 - square * v_slope
    a1 = -2.0 * ((limit - level) * slope + square * c)
    a0 = (limit - level) ** 2 - square * v_level
    root = math.sqrt(max(a1**2 - 4.0 * a2 * a0, 0.0))
    if a2 <= 0.0:
        return Coefficient(middle, 0.0, math.inf)
    return Coefficient(middle, (-a1 - root) / (2.0 * a2), (-a1 + root) / (2.0 * a2))
