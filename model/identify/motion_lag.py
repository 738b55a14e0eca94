"""How late the effort is beside the motion: one more column of the same normal equations.

An effort that is late by tau reads F(t + tau) = X b, so that F = X b - tau F' to first order. The
rate F' carries the effort's own noise; its instrument is what the model says of it,
w = M x''' + F_c (sgn v)', which has the position's. Alignment and estimate are repeated until
nothing is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.identify.checks import Array
from model.identify.motion_moments import Moments, lagged_sum, noise_sums


@dataclass(frozen=True)
class LagEstimate:
    """What is left of the effort's lag [s], its standard uncertainty, and the change of the parameters per second."""

    lag: float
    standard_uncertainty: float
    sensitivity: Array


def lag_left(moments: Moments, regressors: tuple[str, ...], values: Array) -> LagEstimate:
    """The lag of the effort that these moments show, with the parameters `values` (p,) of the fit without one."""
    sums = moments.sums
    x = moments.places(regressors)
    y, rate = moments.places(("effort", "effort_rate"))
    jerk, turn = moments.places(("jerk", "sign_rate"))
    inertia = values[regressors.index("acceleration")]
    coulomb = values[regressors.index("sign")]
    guide = inertia * sums[:, jerk] + coulomb * sums[:, turn]
    p = len(x)
    left = np.empty((len(sums), p + 1, p + 1))
    left[:, :p, :p] = sums[:, x][:, :, x] - noise_sums(moments, regressors)
    left[:, :p, p] = sums[:, x, rate]
    left[:, p, :p] = guide[:, x]
    left[:, p, p] = guide[:, rate]
    right = np.concatenate([sums[:, x, y], guide[:, [y]]], axis=1)
    whole = left.sum(axis=0)
    try:
        found: Array = np.asarray(np.linalg.solve(whole, right.sum(axis=0)), dtype=float)
        inverse: Array = np.asarray(np.linalg.inv(whole), dtype=float)
        sensitivity: Array = np.asarray(np.linalg.solve(whole[:p, :p], whole[:p, p]), dtype=float)
    except np.linalg.LinAlgError:
        # Without jerk and reversals nothing tells a lag.
        return LagEstimate(0.0, math.inf, np.zeros(p))
    spread, _ = lagged_sum(right - left @ found)
    variance = float((inverse @ spread @ inverse.T)[p, p])
    return LagEstimate(-float(found[p]), math.sqrt(max(variance, 0.0)), sensitivity)
