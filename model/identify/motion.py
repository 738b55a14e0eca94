"""Inertia and friction from any motion: inverse dynamics by instrumental variables (IDIM-LS and IDIM-IV;
Gautier and Khalil 1990, Janot, Vandanjon and Gautier 2014).

    F = M a + F_v v + F_c sgn v + F_0  (+ load over position, + Stribeck, + another friction each way)

Channels are a position or a speed and the force that drives it, linear (m, N) or rotary (rad, N m).
What is done to them stands in `motion_columns`, how it is solved in `motion_moments`, which model is
taken in `motion_ladder`, what is said of it in `motion_result`; cut-off and dead zone follow from the
noise (`motion_look`), the lag of the effort from the motion (`motion_lag`); noise that neighbouring
samples share is told by instruments far apart (`motion_shared`), and kept out by a lower cut-off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.least_squares import student_quantile
from model.identify.motion_columns import Basis, MotionFilter
from model.identify.motion_ladder import (
    STRIBECK_RANGE,
    STRIBECK_SPEEDS,
    Fitted,
    Ladder,
)
from model.identify.motion_lag import Alignment, LagEstimate, lag_sensitivity
from model.identify.motion_look import Look, SpeedChannel, compare_speed, look_at
from model.identify.motion_result import MotionFit, reported
from model.identify.motion_shared import SharedNoise, shared_noise
from model.identify.motion_source import MotionSource

_Variant = Literal["auto", "symmetric", "asymmetric", "stribeck"]
VARIANTS: tuple[_Variant, ...] = ("auto", "symmetric", "asymmetric", "stribeck")
_MINIMUM_SAMPLES = 200
_SAMPLES_PER_PERIOD = 1.5
"""Decimated samples of a period of the cut-off frequency: a longer window would reach from motion into standstill."""
_LAG_TOLD = 2.0
"""Sampling periods by which devices may latch apart."""
FALLING = (0.06, 0.15)
"""Of the top speed: the v_s of a friction that falls with speed, beside which a lag is told."""
_MOST_LOWERED = 6
"""How often the band is halved in which the floor of the noise is looked for."""
_SHARED_SHARE = 0.05
"""Of the inertia that shared noise may take off it."""
_SCALE_TOLERANCE = 0.05
"""By which a measured speed may differ from the derivative of the position."""


@dataclass(frozen=True, kw_only=True)
class MotionChoice:
    """What is chosen by hand; None leaves it to the data.

    `rigid_hz`: up to where everything that moves is one body; no higher cut-off is taken unless by hand.
    `lag` [s] of the effort where it is known. `load_orders`, `load_turn`: see `Basis`.
    `instrument_is_position`: whether the instrument channel is a position (a set-point).
    """

    variant: _Variant = "auto"
    cutoff_hz: float | None = None
    rigid_hz: float = math.inf
    decimation: int | None = None
    least_speed: float | None = None
    load_orders: tuple[int, ...] = ()
    load_turn: float = 1.0
    lag: float | None = None
    instrument_is_position: bool = False

    def recipe(self, look: Look, cutoff: float, period: float) -> MotionFilter:
        """The filter of this cut-off [Hz], with the dead zone that belongs to it."""
        every = max(1, math.floor(1.0 / (_SAMPLES_PER_PERIOD * cutoff * period) + 1e-9))
        return MotionFilter(
            cutoff_hz=cutoff,
            decimation=every if self.decimation is None else self.decimation,
            least_speed=look.least_speed(cutoff) if self.least_speed is None else self.least_speed,
            keeps_passages=self.least_speed is None,
        )


def identify_motion(
    source: MotionSource, choice: MotionChoice | None = None, *, rotary: bool = False
) -> MotionFit:
    """Inertia and friction of a motion, recipe and rung chosen by its data where `choice` leaves it to them.

    Raises `IdentificationError` for data that cannot carry the fit.
    """
    choice = choice or MotionChoice()
    prepared = _prepared(source, choice)
    chosen, ladder, lag = prepared.chosen, prepared.ladder, prepared.lag
    cutoff, speed = ladder.recipe.cutoff_hz, prepared.speed
    cutoffs = {cutoff: chosen.named()}
    for factor in (0.5, 2.0):
        filtered = choice.recipe(prepared.look, factor * cutoff, source.period)
        other = _again(source, chosen, filtered, ladder.with_instrument)
        if other:
            cutoffs[factor * cutoff] = other
    effect = _lag_effect(chosen, lag, source.period)
    fit = _with_lag(reported(chosen, rotary, ladder.rungs()), *effect)
    warnings = [*fit.warnings, *_lag_words(chosen.basis, lag, source.period)]
    if speed is not None and not ladder.with_instrument:
        warnings.append(
            f"The measured speed follows the motion too loosely to guide the fit (correlation of the accelerations "
            f"{speed.correlation:.2f})."
        )
    fit = replace(
        fit,
        warnings=tuple(warnings),
        instrument=_instrument_words(prepared.look, speed, ladder.with_instrument, choice),
        filter_uncertainty=_filter_uncertainty(cutoffs),
        rung_uncertainty={n: d / math.sqrt(3.0) for n, d in ladder.next_rung(chosen).items()},
        cutoffs=dict(sorted(cutoffs.items())),
        speed_channel=speed,
        metrics={**fit.metrics, "effort_lag": chosen.basis.lag},
    )
    return _with_shared_noise(fit, prepared)


@dataclass(frozen=True)
class _Prepared:
    """A motion looked at and aligned, and its rungs; what it shows of noise that samples share, first and now."""

    look: Look
    speed: SpeedChannel | None
    lag: LagEstimate | None
    ladder: Ladder
    chosen: Fitted
    shared: SharedNoise | None
    was_shared: bool = False

    @property
    def is_shared(self) -> bool:
        """Whether what samples share of their noise may still be in the inertia."""
        if self.shared is None:
            return False
        return self.shared.share > 0.0 or (self.was_shared and not self.shared.is_told)

    @property
    def may_share(self) -> bool:
        """The same, where that is not told yet."""
        return self.is_shared or (self.shared is not None and self.shared.may_be)


def _prepared(source: MotionSource, choice: MotionChoice) -> _Prepared:
    """The motion with a filter that keeps noise out that neighbouring samples share, as far as that goes.

    Such noise has a spectrum that falls: its floor is not where that of white noise is looked for,
    but below the cut-off that was chosen by it. Where there may be such noise, a lower cut-off is
    taken if there it is told that there is none.
    """
    look = look_at(source)
    look = replace(look, cutoff_hz=min(look.cutoff_hz, choice.rigid_hz))
    first = found = _with_look(source, choice, look)
    lowered = 0
    while found.may_share and choice.cutoff_hz is None and lowered < _MOST_LOWERED:
        lowered += 1
        try:
            look = look_at(source, 0.5 * look.cutoff_hz)
            found = replace(_with_look(source, choice, look), was_shared=True)
        except IdentificationError:
            break
    if found.is_shared and not first.is_shared:
        return first
    return found


def _with_look(source: MotionSource, choice: MotionChoice, look: Look) -> _Prepared:
    cutoff = look.cutoff_hz if choice.cutoff_hz is None else choice.cutoff_hz
    recipe = choice.recipe(look, cutoff, source.period)
    recipe.check(source.period)
    basis, speed = _instrument(source, choice, look, cutoff)
    with_instrument = speed is not None and speed.is_instrument
    lag = None
    if choice.lag is None:
        speeds = tuple(share * look.top_speed for share in FALLING)
        lag = Alignment(source, recipe, basis, with_instrument, speeds).lag()
    taken_off = choice.lag or 0.0
    if lag is not None and lag.is_clear(_LAG_TOLD * source.period) and lag.is_of_both_halves:
        taken_off = lag.lag
    basis = replace(basis, lag=taken_off)
    ladder = Ladder(source, recipe, basis, with_instrument, _stribeck_speeds(look, recipe))
    chosen, shared = ladder.chosen(choice.variant), None
    if not with_instrument:
        shared = shared_noise(chosen.moments, chosen.fit.names, chosen.fit.values)
    return _Prepared(look, speed, lag, ladder, chosen, shared)


def _with_shared_noise(fit: MotionFit, prepared: _Prepared) -> MotionFit:
    """What is still seen of noise that samples share is a line of the budget; much of it, and nothing is identified."""
    noise = prepared.shared
    if noise is None or not (prepared.was_shared or prepared.is_shared):
        return fit
    said = "Neighbouring samples share the position's noise"
    where = f"the cut-off was lowered to {fit.recipe.cutoff_hz:.3g} Hz, where it takes less off the inertia"
    words = f"{said}: {where}." if prepared.was_shared else f"{said}."
    fit = replace(
        fit,
        warnings=(*fit.warnings, words),
        shared_uncertainty={"inertia": max(noise.difference, 0.0) / math.sqrt(3.0)},
    )
    if not prepared.is_shared or 0.0 < noise.share <= _SHARED_SHARE:
        return fit
    note = "noise that neighbouring samples share: a set-point or a measured speed beside the position tells"
    return replace(
        fit,
        estimates={
            name: replace(e, identifiable="weakly", note=note) if e.identifiable == "yes" else e
            for name, e in fit.estimates.items()
        },
    )


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
    if not choice.instrument_is_position and abs(speed.scale - 1.0) > _SCALE_TOLERANCE:
        raise IdentificationError(
            "the measured speed is not the derivative of the position: a unit, a scale or a ratio is wrong",
            where="speed",
            value=f"{speed.scale:.4g} times the derivative",
            limit=f"1 ± {_SCALE_TOLERANCE:g}",
            remedy="Correct the map of the import, or leave the speed out with instrument=none.",
        )
    return replace(basis, instrument_lag=speed.lag), speed


def _lag_words(basis: Basis, lag: LagEstimate | None, period: float) -> list[str]:
    if lag is None or not lag.is_clear(_LAG_TOLD * period):
        return []
    if not lag.is_of_both_halves:
        first, second = (f"{1e3 * half:.3g} ms" for half in lag.halves)
        return [
            f"The first half shows an effort {first} late beside the motion, the second {second}: nothing was brought "
            "forward, and what a lag may change is in U. Fit the halves apart, or state lag_s."
        ]
    u = lag.standard_uncertainty
    return [
        f"The effort is {1e3 * lag.lag:.3g} ± {2e3 * u:.2g} ms late beside the motion; it was brought forward by that."
    ]


def _lag_effect(chosen: Fitted, lag: LagEstimate | None, period: float) -> tuple[Array, Array]:
    """What the standard uncertainty of a lag that was taken off, and of one that is not known, changes of each
    parameter.
    """
    names, matrix = chosen.transform
    nothing = np.zeros(len(names))
    if lag is None:
        return nothing, nothing
    per_second = np.asarray(matrix @ lag_sensitivity(chosen.moments, chosen.fit.names))
    u = lag.standard_uncertainty
    if chosen.basis.lag != 0.0:
        return u * per_second, nothing
    # Devices may latch apart by so much without anybody knowing; what is seen beyond it counts whole.
    usual = min(abs(lag.lag) + 2.0 * u, _LAG_TOLD * period)
    doubt = max(usual, abs(lag.lag) - 2.0 * u) / math.sqrt(3.0)
    return nothing, doubt * np.abs(per_second)


def _with_lag(fit: MotionFit, effect: Array, doubt: Array) -> MotionFit:
    """A lag that was estimated from these data widens the interval; a doubt of it is of type B."""
    covariance = fit.covariance + np.outer(effect, effect)
    half = student_quantile(fit.freedom) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    estimates = {
        name: replace(e, low=e.value - width, high=e.value + width)
        for (name, e), width in zip(fit.estimates.items(), half.tolist(), strict=True)
    }
    return replace(
        fit,
        covariance=covariance,
        estimates=estimates,
        lag_uncertainty=dict(zip(fit.estimates, doubt.tolist(), strict=True)),
    )


def _stribeck_speeds(look: Look, recipe: MotionFilter) -> tuple[float, ...]:
    """The v_s that are tried; none where the dead zone leaves no room for them."""
    low = max(STRIBECK_RANGE[0] * look.top_speed, 2.0 * recipe.least_speed)
    high = STRIBECK_RANGE[1] * look.top_speed
    return tuple(np.geomspace(low, high, STRIBECK_SPEEDS).tolist()) if 2.0 * low < high else ()


def _again(
    source: MotionSource, chosen: Fitted, recipe: MotionFilter, with_instrument: bool
) -> dict[str, float]:
    """The parameters of the same rung with another filter; empty where the recording does not allow that filter, or
    leaves motion one way with it, where the offset is in the Coulomb friction.
    """
    try:
        recipe.check(source.period)
        ladder = Ladder(source, recipe, chosen.basis, with_instrument, ())
        other = ladder.refitted(chosen).named()
    except IdentificationError:
        return {}
    return other if other.keys() == chosen.named().keys() else {}


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
