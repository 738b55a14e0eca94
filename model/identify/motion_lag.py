"""How late the effort is beside the motion: one more column of the same normal equations.

It begins with the lag of a coarse grid that leaves the least residual, and is refined from there. An
effort that is late by tau reads F(t + tau) = X b, so that F = X b - tau F' to first order. The rate
F' carries the effort's own noise; its instrument is what the model says of it,
w = M x''' + F_c (sgn v)', which has the position's. Alignment and estimate are repeated until
nothing is left. Friction that falls with speed is let in with it, so that it is not taken for a lag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.least_squares import closest, inverse_of, solution_of
from model.identify.motion_columns import LEAST_SAMPLES, Basis, MotionFilter
from model.identify.motion_ladder import base_of, gathered
from model.identify.motion_moments import Moments, lagged_sum, noise_sums, solve_moments
from model.identify.motion_source import MotionSource

LONGEST_LAG = 0.1
"""s beyond which it is no lag of a device."""
TRIED = tuple(s * t for s in (-1.0, 1.0) for t in (0.1, 0.07, 0.05, 0.035, 0.02, 0.01))
ROUNDS = 8
CLEAR = 4.0
"""Standard uncertainties of a lag that is taken off."""
LEAST_GAIN, LEAST_GAIN_OF_USUAL = 0.06, 0.15
"""Share of the error out of sample that a lag must explain, and that one by which devices latch apart must."""
_ALIKE = 0.5
"""Of a lag by which what one half of the recording shows may differ from it: noise of few reversals is less alike."""
_SETTLED = 0.05
"""Of its own standard uncertainty below which nothing of a lag is left."""


@dataclass(frozen=True)
class LagEstimate:
    """The effort's lag [s], or what is left of it, and its standard uncertainty; infinite where nothing tells it."""

    lag: float
    standard_uncertainty: float
    gain: float = 0.0
    """By which share the error on data that the fit has not seen is smaller with this lag taken off: in that half of
    the recording in which it gains less.
    """
    halves: tuple[float, ...] = ()
    """s: what each half of the recording shows alone."""

    @property
    def is_of_both_halves(self) -> bool:
        return all(abs(half - self.lag) < _ALIKE * abs(self.lag) for half in self.halves)

    def is_clear(self, usual: float) -> bool:
        """Whether it is the lag of a device, if both halves show it: a wrong friction looks like one too, but
        explains less by it.

        Devices latch apart by the `usual` [s] anyway: a shorter lag has to explain more.
        """
        least = LEAST_GAIN if abs(self.lag) > usual else LEAST_GAIN_OF_USUAL
        return abs(self.lag) > CLEAR * self.standard_uncertainty and self.gain > least


@dataclass(frozen=True)
class Alignment:
    """What a lag is looked for with: a motion, its filter and columns, and the v_s of a friction that falls."""

    source: MotionSource
    recipe: MotionFilter
    basis: Basis
    with_instrument: bool
    speeds: tuple[float, ...]

    def lag(self) -> LagEstimate:
        """The lag of the effort; 0 s, not told, where nothing tells it or it is longer than one of a device."""
        tried = replace(self.basis, stribeck=self.speeds, tried_lags=TRIED)
        moments = gathered(self.source, self.recipe, tried)
        if moments.kept < LEAST_SAMPLES:
            return LagEstimate(0.0, math.inf)
        names = self._regressors(moments)
        lag, without = _least(moments, names), self._errors(moments, names)
        for _ in range(ROUNDS):
            basis = replace(self.basis, stribeck=self.speeds, lag=lag)
            moments = gathered(self.source, self.recipe, basis)
            fit = solve_moments(moments, names, with_instrument=self.with_instrument)
            left = _lag_left(moments, names, fit.values)
            if not abs(lag + left.lag) <= LONGEST_LAG:
                break
            lag += left.lag
            if abs(left.lag) <= _SETTLED * left.standard_uncertainty:
                gain = math.nan
                if np.all(without > 0.0):
                    gain = float(np.min(1.0 - fit.half_errors / without))
                halves = tuple(
                    lag + _lag_left(half, names, fit.values).lag for half in moments.halves()
                )
                return LagEstimate(lag, left.standard_uncertainty, gain, halves)
        return LagEstimate(0.0, math.inf)

    def _errors(self, moments: Moments, names: Sequence[str]) -> Array:
        return solve_moments(moments, names, with_instrument=self.with_instrument).half_errors

    def _regressors(self, moments: Moments) -> tuple[str, ...]:
        """With the friction that falls where the data carry it."""
        plain = (*base_of(moments), *self.basis.load_names)
        whole = (*plain, *(f"stribeck_{k}" for k in range(len(self.speeds))))
        try:
            solve_moments(moments, whole, with_instrument=self.with_instrument)
        except IdentificationError:
            return plain
        return whole


def _least(moments: Moments, regressors: Sequence[str]) -> float:
    """The lag of the grid, or none, that leaves the least of the effort unexplained."""
    x = moments.places(regressors)
    total: Array = moments.sums.sum(axis=0)
    squares: Array = total[x][:, x]
    left: dict[float, float] = {}
    for k, lag in [(-1, 0.0), *enumerate(TRIED)]:
        y = moments.names.index("effort" if k < 0 else f"effort_{k}")
        cross: Array = total[x, y]
        told = closest(squares, cross)
        left[lag] = 1.0 - float(told @ cross) / float(total[y, y])
    return min(left, key=lambda lag: left[lag])


def lag_sensitivity(moments: Moments, regressors: Sequence[str]) -> Array:
    """By how much the parameters (p,) change per second of the effort's lag that is taken off."""
    names, total = tuple(regressors), moments.sums.sum(axis=0)
    x, rate = moments.places(names), moments.names.index("effort_rate")
    squares = total[np.ix_(x, x)] - noise_sums(moments, names).sum(axis=0)
    return solution_of(squares, total[x, rate])


def _lag_left(moments: Moments, regressors: tuple[str, ...], values: Array) -> LagEstimate:
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
        found = solution_of(whole, right.sum(axis=0))
        inverse = inverse_of(whole)
    except np.linalg.LinAlgError:
        # Without jerk and reversals nothing tells a lag.
        return LagEstimate(0.0, math.inf)
    spread, _ = lagged_sum(right - left @ found)
    variance = float((inverse @ spread @ inverse.T)[p, p])
    return LagEstimate(-float(found[p]), math.sqrt(max(variance, 0.0)))
