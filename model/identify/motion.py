# pyright: standard
"""Inertia and friction from any motion: inverse dynamics by instrumental variables (IDIM-LS and IDIM-IV;
Gautier and Khalil 1990, Janot, Vandanjon and Gautier 2014).

    F = M a + F_v v + F_c sgn v + F_0  (+ load over position, + Stribeck, + another friction each way)

Channels are a position or a speed and the force that drives it, linear (m, N) or rotary (rad, N m).
What is done to them stands in `motion_columns`, how it is solved in `motion_moments`, which model is
taken in `motion_ladder`, what is said of it in `motion_result`; cut-off and dead zone follow from the
noise (`motion_look`), the lag of the effort from the motion (`motion_lag`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, increasing, sampling_period, series
from model.identify.least_squares import student_quantile
from model.identify.motion_columns import Basis, MotionFilter
from model.identify.motion_ladder import (
    LEAST_GAIN,
    STRIBECK_RANGE,
    STRIBECK_SPEEDS,
    Fitted,
    Ladder,
    gathered,
)
from model.identify.motion_lag import LagEstimate, lag_left
from model.identify.motion_look import Look, SpeedChannel, compare_speed, look_at
from model.identify.motion_result import MotionFit, MotionScore, reported
from model.identify.motion_source import ArrayMotion, MotionSource

Variant = Literal["auto", "symmetric", "asymmetric", "stribeck"]
VARIANTS: tuple[Variant, ...] = ("auto", "symmetric", "asymmetric", "stribeck")
MINIMUM_SAMPLES = 200
SAMPLES_PER_PERIOD = 1.5
"""Decimated samples of a period of the cut-off frequency: a longer window would reach from motion into standstill."""
LAG_TOLD = 2.0
"""Sampling periods by which devices may latch apart: a lag within is not taken off, it stays in the budget."""
LAG_ROUNDS, LAG_SETTLED, LONGEST_LAG = 6, 0.2, 0.1
"""How often the effort is aligned anew, sampling periods below which nothing is left, s beyond which it is none."""
SCALE_TOLERANCE = 0.05
"""By which a measured speed may differ from the derivative of the position."""


@dataclass(frozen=True, kw_only=True)
class MotionChoice:
    """What is chosen by hand; None leaves it to the data.

    `lag` [s] of the effort where it is known. `load_orders`, `load_turn`: see `Basis`.
    `instrument_is_position`: whether the instrument channel is a position (a set-point).
    """

    variant: Variant = "auto"
    cutoff_hz: float | None = None
    decimation: int | None = None
    least_speed: float | None = None
    load_orders: tuple[int, ...] = ()
    load_turn: float = 1.0
    lag: float | None = None
    instrument_is_position: bool = False

    def recipe(self, look: Look, cutoff: float, period: float) -> MotionFilter:
        """The filter of this cut-off [Hz], with the dead zone that belongs to it."""
        every = max(1, math.floor(1.0 / (SAMPLES_PER_PERIOD * cutoff * period) + 1e-9))
        return MotionFilter(
            cutoff_hz=cutoff,
            decimation=every if self.decimation is None else self.decimation,
            least_speed=look.least_speed(cutoff) if self.least_speed is None else self.least_speed,
            keeps_passages=self.least_speed is None,
        )


def fit_motion(
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    *,
    variant: Variant = "symmetric",
    recipe: MotionFilter | None = None,
    rotary: bool = False,
) -> MotionFit:
    """Inertia, viscous and Coulomb friction (and offset) of one axis by a recipe that is given, not chosen.

    time [s], position [m or rad], force [N or N m]: shape (n,), evenly sampled. Intervals are 95 %
    with an error that respects the autocorrelation of the residual. Raises `IdentificationError`
    for data that cannot carry the fit. `identify_motion` lets the data choose the recipe.
    """
    recipe = MotionFilter() if recipe is None else recipe
    source = _array_source(time, position, force)
    recipe.check(source.period)
    ladder = Ladder(source, recipe, Basis(), False, ())
    chosen = ladder.chosen(variant if variant == "asymmetric" else "symmetric")
    return reported(chosen, rotary)


def identify_motion(
    source: MotionSource, choice: MotionChoice | None = None, *, rotary: bool = False
) -> MotionFit:
    """Inertia and friction of a motion, recipe and rung chosen by its data where `choice` leaves it to them.

    Raises `IdentificationError` for data that cannot carry the fit.
    """
    choice = MotionChoice() if choice is None else choice
    look = look_at(source)
    cutoff = look.cutoff_hz if choice.cutoff_hz is None else choice.cutoff_hz
    recipe = choice.recipe(look, cutoff, source.period)
    recipe.check(source.period)
    basis, speed = _instrument(source, choice, look, cutoff)
    with_instrument = speed is not None and speed.is_instrument
    slow = choice.recipe(look, min(look.slow_cutoff_hz, cutoff), source.period)
    basis, lag = _aligned(source, slow, basis, choice, with_instrument)
    ladder = Ladder(source, recipe, basis, with_instrument, _stribeck_speeds(look, recipe))
    chosen = ladder.chosen(choice.variant)
    cutoffs = {cutoff: chosen.named()}
    for factor in (0.5, 2.0):
        filtered = choice.recipe(look, factor * cutoff, source.period)
        other = _again(source, chosen, filtered, with_instrument)
        if other:
            cutoffs[factor * cutoff] = other
    effect = _lag_effect(chosen, basis, choice, lag, source.period)
    fit = _with_lag(reported(chosen, rotary, ladder.rungs()), effect, basis.lag != 0.0)
    warnings = [*fit.warnings, *_lag_words(basis, choice, lag)]
    if speed is not None and not with_instrument:
        warnings.append(
            f"The measured speed follows the motion too loosely to guide the fit (correlation of the accelerations "
            f"{speed.correlation:.2f})."
        )
    return replace(
        fit,
        warnings=tuple(warnings),
        instrument=_instrument_words(look, speed, with_instrument, choice),
        filter_uncertainty=_filter_uncertainty(cutoffs),
        rung_uncertainty={n: d / math.sqrt(3.0) for n, d in ladder.next_rung(chosen).items()},
        cutoffs=dict(sorted(cutoffs.items())),
        speed_channel=speed,
        metrics={**fit.metrics, "effort_lag": basis.lag},
    )


def score_motion(
    fit: MotionFit,
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    *,
    recipe: MotionFilter | None = None,
) -> MotionScore:
    """Cross-validation on arrays: how well a fitted set predicts the force of another recording."""
    return score_source(fit, _array_source(time, position, force), recipe=recipe)


def score_source(
    fit: MotionFit, source: MotionSource, *, recipe: MotionFilter | None = None
) -> MotionScore:
    """How well a fitted set predicts the effort of another recording, |F - X b|/|F| in per cent."""
    recipe = fit.recipe if recipe is None else recipe
    moments = gathered(source, recipe, fit.basis)
    x, y = moments.places(fit.regressors), moments.names.index("effort")
    total, b = moments.sums.sum(axis=0), fit.coefficients
    residual = total[y, y] - 2.0 * b @ total[x, y] + b @ total[np.ix_(x, x)] @ b
    norm = math.sqrt(max(float(residual), 0.0))
    measured = moments.shown[:, y]
    predicted = moments.shown[:, x] @ b
    percent = 100.0 * norm / math.sqrt(float(total[y, y]))
    return MotionScore(percent, norm, moments.shown_time, measured, predicted)


def _array_source(time: ArrayLike, position: ArrayLike, force: ArrayLike) -> ArrayMotion:
    """Arrays of an evenly sampled motion, checked."""
    clock = increasing("time", time, minimum=MINIMUM_SAMPLES)
    sampling_period("time", clock)
    place = series("position", position, minimum=MINIMUM_SAMPLES)
    if np.ptp(place) <= 0.0:
        raise IdentificationError(
            "does not move",
            where="position",
            value=place[0],
            remedy="Choose a part of the run with motion.",
        )
    return ArrayMotion.of(clock, force, position=place)


def _instrument(
    source: MotionSource, choice: MotionChoice, look: Look, cutoff: float
) -> tuple[Basis, SpeedChannel | None]:
    """The basis with load and instrument, and what the instrument channel is beside the position."""
    basis = Basis(
        load_orders=choice.load_orders,
        load_turn=choice.load_turn,
        instrument_is_speed=not choice.instrument_is_position,
    )
    if not look.of_position:
        if choice.load_orders:
            raise IdentificationError(
                "a load over position needs a position",
                where="motion.load",
                limit="a position channel",
            )
        return basis, None
    speed = compare_speed(source, cutoff, of_position=choice.instrument_is_position)
    if speed is None:
        return basis, None
    if not choice.instrument_is_position and abs(speed.scale - 1.0) > SCALE_TOLERANCE:
        raise IdentificationError(
            "the measured speed is not the derivative of the position: a unit, a scale or a ratio is wrong",
            where="speed",
            value=f"{speed.scale:.4g} times the derivative",
            limit=f"1 ± {SCALE_TOLERANCE:g}",
            remedy="Correct the map of the import, or leave the speed out with instrument=none.",
        )
    return replace(basis, instrument_lag=speed.lag), speed


def _aligned(
    source: MotionSource,
    recipe: MotionFilter,
    basis: Basis,
    choice: MotionChoice,
    with_instrument: bool,
) -> tuple[Basis, LagEstimate | None]:
    """The basis with the effort's lag taken off where it is stated or told by the data, and what is left of it."""
    if choice.lag is not None:
        return replace(basis, lag=choice.lag), None
    started: Fitted | None = None
    start, left = basis, None
    for _ in range(LAG_ROUNDS):
        fitted = Ladder(source, recipe, basis, with_instrument, ()).symmetric
        started = fitted if started is None else started
        left = lag_left(fitted.moments, fitted.fit.names, fitted.fit.values)
        told = basis.lag + left.lag
        clear = abs(told) - 2.0 * left.standard_uncertainty > LAG_TOLD * source.period
        if not clear or abs(told) > LONGEST_LAG:
            # Nothing to take off, or no lag of a device: another signal.
            return start, replace(left, lag=told)
        if abs(left.lag) < LAG_SETTLED * source.period:
            better = fitted.fit.hold_out_error < (1.0 - LEAST_GAIN) * started.fit.hold_out_error
            return (basis, left) if better else (start, replace(left, lag=told))
        basis = replace(basis, lag=told)
    return start, left and replace(left, lag=basis.lag)


def _lag_words(basis: Basis, choice: MotionChoice, lag: LagEstimate | None) -> list[str]:
    if choice.lag is not None or basis.lag == 0.0 or lag is None:
        return []
    return [
        f"The effort is {1e3 * basis.lag:.3g} ± {2e3 * lag.standard_uncertainty:.2g} ms late beside the motion; "
        "it was brought forward by that."
    ]


def _lag_effect(
    chosen: Fitted, basis: Basis, choice: MotionChoice, lag: LagEstimate | None, period: float
) -> Array:
    """What one standard uncertainty of the effort's lag, estimated or unknown, changes of each parameter."""
    names, matrix = chosen.transform
    if choice.lag is not None or lag is None:
        return np.zeros(len(names))
    u = lag.standard_uncertainty
    if basis.lag == 0.0:
        # Devices may latch apart by so much without anybody knowing; what is seen beyond it counts whole.
        usual = min(abs(lag.lag) + 2.0 * u, LAG_TOLD * period)
        u = max(usual, abs(lag.lag) - 2.0 * u) / math.sqrt(3.0)
    change = np.zeros(len(chosen.fit.names))
    base = [chosen.fit.names.index(n) for n in ("acceleration", "speed", "sign", "one")]
    loads = [chosen.fit.names.index(n) for n in basis.load_names]
    change[[*base, *loads]] = lag.sensitivity
    return np.asarray(u * (matrix @ change), dtype=np.float64)


def _with_lag(fit: MotionFit, effect: Array, is_estimated: bool) -> MotionFit:
    """A lag that was estimated from these data widens the interval; one that is not known is of type B."""
    if not is_estimated:
        names = fit.estimates
        return replace(fit, lag_uncertainty=dict(zip(names, np.abs(effect).tolist(), strict=True)))
    covariance = fit.covariance + np.outer(effect, effect)
    half = student_quantile(fit.freedom) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    estimates = {
        name: replace(e, low=e.value - width, high=e.value + width)
        for (name, e), width in zip(fit.estimates.items(), half.tolist(), strict=True)
    }
    return replace(fit, covariance=covariance, estimates=estimates)


def _stribeck_speeds(look: Look, recipe: MotionFilter) -> tuple[float, ...]:
    """The v_s that are tried; none where the dead zone leaves no room for them."""
    low = max(STRIBECK_RANGE[0] * look.top_speed, 2.0 * recipe.least_speed)
    high = STRIBECK_RANGE[1] * look.top_speed
    return tuple(np.geomspace(low, high, STRIBECK_SPEEDS).tolist()) if 2.0 * low < high else ()


def _again(
    source: MotionSource, chosen: Fitted, recipe: MotionFilter, with_instrument: bool
) -> dict[str, float]:
    """The parameters of the same rung with another filter; empty where the recording does not allow that filter."""
    try:
        recipe.check(source.period)
        ladder = Ladder(source, recipe, chosen.basis, with_instrument, ())
        return ladder.refitted(chosen).named()
    except IdentificationError:
        return {}


def _filter_uncertainty(cutoffs: Mapping[float, Mapping[str, float]]) -> dict[str, float]:
    """u = |change between half and twice the cut-off|/(2 sqrt 3); where one cannot be had, from the other."""
    ordered = [cutoffs[c] for c in sorted(cutoffs)]
    if len(ordered) < 2:
        return {}
    first, last = ordered[0], ordered[-1]
    share = 2.0 if len(ordered) == 3 else 1.0
    return {name: abs(last[name] - first[name]) / (share * math.sqrt(3.0)) for name in first}


def _instrument_words(
    look: Look, speed: SpeedChannel | None, with_instrument: bool, choice: MotionChoice
) -> str:
    if with_instrument and speed is not None:
        what = "set-point" if choice.instrument_is_position else "measured speed"
        return f"{what}, {1e3 * speed.lag:.3g} ms late"
    return f"even and odd samples of the {'position' if look.of_position else 'speed'}"
