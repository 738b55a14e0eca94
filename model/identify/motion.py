"""Inertia and friction from any motion: inverse dynamics by least squares (IDIM-LS; Gautier and
Khalil 1990, Janot 2019).

    symmetric     F = M a + F_v v + F_c sgn v + F_0
    asymmetric    F = M a + F_v+ v + F_c+          (v > 0)
                  F = M a + F_v- v - F_c-          (v < 0)

Channels are a position and the force that drives it, linear (m, N) or rotary (rad, N m). Velocity
and acceleration come from the position: zero-phase low-pass Butterworth filter, central
differences, then regressors and force are decimated together (parallel filter), so that regressors
and force see the same filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, channels, increasing, sampling_period
from model.identify.estimate import Estimate
from model.identify.least_squares import LinearFit, solve

Variant = Literal["symmetric", "asymmetric"]
MINIMUM_SAMPLES = 200


@dataclass(frozen=True)
class MotionFilter:
    """How velocity and acceleration are taken from the position: the recipe of the fit.

    cutoff_hz of the zero-phase Butterworth filter of `order`; `edge_samples` dropped at start and end; `decimation` of
    regressors and force (1 = none).
    """

    order: int = 4
    cutoff_hz: float = 100.0
    edge_samples: tuple[int, int] = (25, 26)
    decimation: int = 10


@dataclass(frozen=True, kw_only=True)
class MotionFit:
    """Inertia and friction of a motion, with what is needed to judge and to plot them.

    estimates by name; metrics: relative_error_percent, condition, residual_norm, samples, and those
    of a cross-validation; time, velocity, measured, predicted: (n,) after decimation; covariance (p, p) in
    the order of the estimates.
    """

    variant: Variant
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    time: Array
    velocity: Array
    measured: Array
    predicted: Array
    covariance: Array

    @property
    def values(self) -> Array:
        """The parameters in the order of the regressors, shape (4,) or (5,)."""
        return np.array([e.value for e in self.estimates.values()])


@dataclass(frozen=True)
class MotionScore:
    """A fitted set on data it was not fitted to: relative error [%], norm of the residual, and the curves."""

    relative_error_percent: float
    residual_norm: float
    time: Array
    measured: Array
    predicted: Array


@dataclass(frozen=True)
class _Regression:
    time: Array
    velocity: Array
    design: Array
    force: Array


def names(variant: Variant) -> tuple[str, ...]:
    """The names of the parameters of a variant, in the order of the regressors."""
    if variant == "symmetric":
        return ("inertia", "viscous", "coulomb", "offset")
    return ("inertia", "viscous_forward", "coulomb_forward", "viscous_reverse", "coulomb_reverse")


def _regressors(velocity: Array, acceleration: Array, variant: Variant) -> Array:
    if variant == "symmetric":
        return np.column_stack([acceleration, velocity, np.sign(velocity), np.ones_like(velocity)])
    forward = (velocity > 0.0).astype(np.float64)
    reverse = 1.0 - forward
    return np.column_stack(
        [acceleration, velocity * forward, forward, velocity * reverse, -reverse]
    )


def _decimate(values: Array, factor: int) -> Array:
    return (
        values
        if factor == 1
        else np.ascontiguousarray(scipy.signal.decimate(values, factor, axis=0))
    )


def _check_filter(recipe: MotionFilter, period: float, count: int) -> None:
    nyquist = 0.5 / period
    if not 0.0 < recipe.cutoff_hz < nyquist:
        raise IdentificationError(
            "is outside the band of the recording",
            where="filter.cutoff_hz",
            value=recipe.cutoff_hz,
            limit=f"> 0 and < {nyquist:g} Hz",
            remedy="Choose a cut-off well above the motion and below half of the sampling rate.",
        )
    if recipe.order < 1 or recipe.decimation < 1 or min(recipe.edge_samples) < 2:
        raise IdentificationError(
            "order and decimation start at 1, two edge samples are the least",
            where="filter",
            value=recipe,
        )
    left = (count - sum(recipe.edge_samples)) // recipe.decimation
    if left < 20:
        raise IdentificationError(
            "too little is left after cutting the edges and decimation",
            where="filter",
            value=f"{left} samples",
            limit=">= 20",
        )


def _regression(
    time: ArrayLike, position: ArrayLike, force: ArrayLike, variant: Variant, recipe: MotionFilter
) -> _Regression:
    clock = increasing("time", time, minimum=MINIMUM_SAMPLES)
    clock, place, effort = channels(MINIMUM_SAMPLES, time=clock, position=position, force=force)
    period = sampling_period("time", clock)
    _check_filter(recipe, period, len(clock))
    if np.ptp(place) <= 0.0:
        raise IdentificationError(
            "does not move",
            where="position",
            value=place[0],
            remedy="Choose a part of the run with motion.",
        )
    b, a = scipy.signal.butter(recipe.order, recipe.cutoff_hz * 2.0 * period)
    smooth = scipy.signal.filtfilt(b, a, place)
    velocity = np.zeros_like(smooth)
    velocity[1:-1] = (smooth[2:] - smooth[:-2]) / (2.0 * period)
    acceleration = np.zeros_like(smooth)
    acceleration[1:-1] = (velocity[2:] - velocity[:-2]) / (2.0 * period)
    inner = slice(recipe.edge_samples[0], len(smooth) - recipe.edge_samples[1])
    design = _regressors(velocity[inner], acceleration[inner], variant)
    q = recipe.decimation
    return _Regression(
        clock[inner][::q], velocity[inner][::q], _decimate(design, q), _decimate(effort[inner], q)
    )


def _units(variant: Variant, rotary: bool) -> dict[str, str]:
    table = {"inertia": "kg m2", "viscous": "N m s/rad", "coulomb": "N m", "offset": "N m"}
    if not rotary:
        table = {"inertia": "kg", "viscous": "N s/m", "coulomb": "N", "offset": "N"}
    return {name: table[name.split("_")[0]] for name in names(variant)}


def _estimates(fit: LinearFit, variant: Variant, rotary: bool) -> dict[str, Estimate]:
    estimates: dict[str, Estimate] = {}
    for index, (name, unit) in enumerate(_units(variant, rotary).items()):
        low, high = fit.interval(index)
        value = float(fit.values[index])
        share = 0.5 * (high - low) / max(abs(value), np.finfo(float).tiny)
        relative = name != "offset"
        verdict = "yes" if not relative or share < 0.3 else "weakly" if share < 1.0 else "no"
        note = "" if verdict == "yes" else f"the interval is ±{100 * share:.0f} % of the value"
        estimates[name] = Estimate(
            name=name, value=value, unit=unit, low=low, high=high, identifiable=verdict, note=note
        )
    return estimates


def fit_motion(
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    *,
    variant: Variant = "symmetric",
    recipe: MotionFilter | None = None,
    rotary: bool = False,
) -> MotionFit:
    """Inertia, viscous and Coulomb friction (and offset) of one axis from a recorded motion.

    time [s], position [m or rad], force [N or N m]: shape (n,), evenly sampled. Intervals are 95 %
    with an error that respects the autocorrelation of the residual. Raises `IdentificationError`
    for data that cannot carry the fit.
    """
    recipe = MotionFilter() if recipe is None else recipe
    data = _regression(time, position, force, variant, recipe)
    warnings: list[str] = []
    if data.velocity.min() >= 0.0 or data.velocity.max() <= 0.0:
        raise IdentificationError(
            "moves in one direction only: Coulomb friction and offset cannot be separated",
            where="position",
            limit="motion both ways",
            remedy="Use a recording that reverses.",
        )
    fit = solve(data.design, data.force, where="motion")
    estimates = _estimates(fit, variant, rotary)
    for name, estimate in estimates.items():
        if name != "offset" and estimate.value <= 0.0:
            warnings.append(
                f"{name} is {estimate.value:.4g} {estimate.unit}, which is not physical: check the sign of the force."
            )
    if fit.condition_raw > 100.0 and fit.condition > 100.0:
        warnings.append(
            f"The regressors are nearly dependent (condition number {fit.condition:.3g}): excite more richly."
        )
    return MotionFit(
        variant=variant,
        estimates=estimates,
        metrics={
            "relative_error_percent": 100.0 * fit.relative_error,
            "condition": fit.condition_raw,
            "condition_scaled": fit.condition,
            "residual_norm": float(np.linalg.norm(fit.residual)),
            "samples": float(len(data.force)),
        },
        warnings=tuple(warnings),
        time=data.time,
        velocity=data.velocity,
        measured=data.force,
        predicted=data.force - fit.residual,
        covariance=fit.covariance,
    )


def score_motion(
    fit: MotionFit,
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    *,
    recipe: MotionFilter | None = None,
) -> MotionScore:
    """Cross-validation: how well a fitted set predicts the force of another recording, |F - X b|/|F| in per cent."""
    recipe = MotionFilter() if recipe is None else recipe
    data = _regression(time, position, force, fit.variant, recipe)
    predicted = data.design @ fit.values
    norm = float(np.linalg.norm(data.force - predicted))
    return MotionScore(
        100.0 * norm / float(np.linalg.norm(data.force)), norm, data.time, data.force, predicted
    )
