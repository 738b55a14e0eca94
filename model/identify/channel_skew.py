"""Delay between any two channels of a recording, apart from hysteresis: it grows with speed, hysteresis does not.

    y(t) = a + h sgn(v) + g x(t - tau)          angles: g is the ratio, h half the width of the hysteresis
    y(t) = a + g x(t - tau)                     speeds, efforts
    y(t) = a + h sgn(v) + f v + g x(t - tau)    a torque against an acceleration

x and y are of one kind; the channel that is an integral of the other is differentiated first. tau
is found by a search over the whole range, then by Gauss and Newton: x(t - tau - d) = x - d dx/dt. In
steady motion at one speed h and tau are one number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.estimate import BudgetLine, Estimate
from model.identify.least_squares import LinearFit, closest, solve, student_quantile

SPEED_SPAN = 1.5
"""Largest over smallest speed below which hysteresis and delay cannot be told apart."""
TRIES = 61
"""Delays that are tried over the range before one is refined."""
_ITERATIONS = 12
_NOISE_SHARE = 1e-3
"""Of the variance of the slope of the first channel that its noise may be: more would pull the delay towards zero."""
LEAST_ROWS = 60
MOST_ROWS = 40_000
"""Averaged rows that are fitted."""
LEAST_VARIATION = 2.0
"""How many times the residual a channel must vary for a delay to be seen in it."""
MOVING = 0.05
"""Of the largest speed, below which an axis stands still: there hysteresis has no sign."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two channels of one kind over time: time [s], first and second (n,), speed (n,) whose sign tells the direction.

    `has_hysteresis`, `has_friction`: whether the second may lag behind by direction, and by speed.
    """

    time: Array
    first: Array
    second: Array
    speed: Array
    has_hysteresis: bool
    has_friction: bool


@dataclass(frozen=True)
class SkewFit:
    """Delay [s] (positive: the second is later), gain, half the hysteresis (NaN where there is none), rows averaged."""

    skew: Estimate
    gain: Estimate
    hysteresis: Estimate | None
    rows_averaged: int


def fit_skew(pair: Pair, longest: float, unit: str) -> SkewFit:
    """Delay of the second channel behind the first, searched up to `longest` [s]; `unit` is that of the second.

    Raises `IdentificationError` where the data cannot tell the delay from hysteresis, or show none.
    """
    width = _width(pair)
    narrow, wide = (_averaged(pair, w) for w in (width, 2 * width))
    if pair.has_hysteresis and not pair.has_friction:
        _require_speeds(narrow)
    fit, tau, deviation = _delay(narrow, longest)
    coarse, other, _ = _delay(wide, longest)
    lines = (
        BudgetLine(
            "residual, autocorrelation respected", "A", deviation, degrees_of_freedom=fit.freedom
        ),
        BudgetLine("choice of the averaging", "B", abs(other - tau) / math.sqrt(3.0)),
    )
    half = student_quantile(fit.freedom) * deviation
    skew = Estimate.about("skew", tau, half, "s", lines)
    gain = _estimate(fit, coarse, 1, "gain", "")
    has_sign = _column_of_sign(narrow) is not None
    hysteresis = _estimate(fit, coarse, 3, "hysteresis", unit) if has_sign else None
    return SkewFit(skew, gain, hysteresis, width)


def _estimate(fit: LinearFit, coarse: LinearFit, column: int, name: str, unit: str) -> Estimate:
    """A value of the fit; `coarse` is that over means of twice as many rows."""
    low, high = fit.interval(column)
    value = float(fit.values[column])
    change = abs(float(coarse.values[column]) - value) if len(coarse.values) > column else 0.0
    lines = (
        BudgetLine(
            "residual, autocorrelation respected",
            "A",
            float(fit.standard_error[column]),
            degrees_of_freedom=fit.freedom,
        ),
        BudgetLine("choice of the averaging", "B", change / math.sqrt(3.0)),
    )
    return Estimate(name=name, value=value, unit=unit, low=low, high=high, budget=lines)


def _width(pair: Pair) -> int:
    """Rows that are averaged: so many that the noise of the first channel's slope is a small share of it."""
    n = len(pair.time)
    period = float(np.median(np.diff(pair.time)))
    bent = np.diff(pair.first, 2)
    noise = float(np.percentile(np.abs(bent), 90.0)) / (1.645 * math.sqrt(6.0))
    width = max(1, n // MOST_ROWS)
    while width < n // (4 * LEAST_ROWS):
        smooth = _averaged(pair, width)
        slope = np.gradient(smooth.first, smooth.time)
        # Central differences of means over `width` rows.
        spread = noise**2 / (2.0 * width * (width * period) ** 2)
        if spread <= _NOISE_SHARE * float(np.var(slope)):
            break
        width *= 2
    return width


def _averaged(pair: Pair, width: int) -> Pair:
    """Means of `width` rows each, of both channels alike."""
    whole = len(pair.time) // width * width
    if whole // width < LEAST_ROWS:
        raise IdentificationError(
            "is too short for a delay",
            where="recording",
            value=f"{len(pair.time)} rows, of which {width} are averaged",
            limit=f">= {LEAST_ROWS} averaged rows",
            remedy="Record longer, or with less noise.",
        )
    time, first, second, speed = (
        column[:whole].reshape(-1, width).mean(axis=1)
        for column in (pair.time, pair.first, pair.second, pair.speed)
    )
    return Pair(
        time=time,
        first=first,
        second=second,
        speed=speed,
        has_hysteresis=pair.has_hysteresis,
        has_friction=pair.has_friction,
    )


def _require_speeds(pair: Pair) -> None:
    """Refuse motion at one speed, and say the sum that it shows."""
    size = np.abs(pair.speed)
    fastest = float(np.percentile(size, 98.0))
    moving = size[size > MOVING * fastest]
    if not len(moving):
        return
    slowest = float(np.percentile(moving, 2.0))
    if fastest < SPEED_SPAN * slowest:
        sign = np.sign(pair.speed)
        design = np.column_stack([np.ones(len(sign)), pair.first, sign])
        shown = "in one direction"
        if sign.min() < sign.max():
            offset = float(solve(design, pair.second, where="skew").values[2])
            shown = f"their sum is {offset:.4g} to each side at {np.median(moving):.4g} rad/s"
        raise IdentificationError(
            "there is one speed only: delay and hysteresis are one number",
            where="skew",
            value=f"fastest over slowest {fastest / slowest:.3g}; {shown}",
            limit=f">= {SPEED_SPAN:g}",
            remedy="Record both directions at two speeds at least.",
        )


def _require_variation(fit: LinearFit, pair: Pair) -> None:
    gain, residual = abs(float(fit.values[1])), float(np.std(fit.residual))
    varies = gain * float(np.std(pair.first))
    if not varies > LEAST_VARIATION * residual:
        raise IdentificationError(
            "the channels do not follow each other, or do not vary",
            where="skew",
            value=f"the first explains {varies:.3g} of the second, {residual:.3g} is left",
            limit=f"> {LEAST_VARIATION:g} times what is left",
            remedy="Choose two channels that show one motion, and record one that varies.",
        )


def _column_of_sign(pair: Pair) -> Array | None:
    """The direction of each row, 0 at standstill; None where there is no hysteresis, or one direction only."""
    if not pair.has_hysteresis:
        return None
    fastest = float(np.percentile(np.abs(pair.speed), 98.0))
    sign = np.where(np.abs(pair.speed) > MOVING * fastest, np.sign(pair.speed), 0.0)
    return sign if sign.min() < 0.0 < sign.max() else None


def _left(pair: Pair, tau: float) -> float:
    """What is left of the second channel at one delay (r.m.s.)."""
    design, observed = _design(pair, tau)
    values = closest(design, observed)
    return float(np.std(observed - design @ values))


def _solved(pair: Pair, tau: float) -> LinearFit:
    """The fit about one delay, with the covariance of its values."""
    design, observed = _design(pair, tau)
    return solve(design, observed, where="skew")


def _design(pair: Pair, tau: float) -> tuple[Array, Array]:
    """Columns offset, first channel, its change with the delay, direction, speed; and the second channel."""
    shifted = pair.time - tau
    inside = (shifted >= pair.time[0]) & (shifted <= pair.time[-1])
    slope = np.gradient(pair.first, pair.time)
    x = np.interp(shifted, pair.time, pair.first)
    columns = [np.ones(len(x)), x, -np.interp(shifted, pair.time, slope)]
    sign = _column_of_sign(pair)
    if sign is not None:
        # At a reversal the sign is of neither direction.
        inside &= sign != 0.0
        columns.append(sign)
    if pair.has_friction:
        columns.append(pair.speed)
    return np.column_stack(columns)[inside], pair.second[inside]


def _delay(pair: Pair, longest: float) -> tuple[LinearFit, float, float]:
    """The fit at its best delay, the delay [s] and its standard error."""
    tries, step = np.zeros(1), 1.0
    if longest > 0.0:
        tries = np.linspace(-longest, longest, TRIES)
        step = float(tries[1] - tries[0])
    left = [_left(pair, float(t)) for t in tries]
    tau = float(tries[int(np.argmin(left))])
    for _ in range(_ITERATIONS):
        design, observed = _design(pair, tau)
        values = closest(design, observed)
        change = float(values[2] / values[1]) if values[1] != 0.0 else 0.0
        tau += min(max(change, -step), step)
        if abs(change) < 1e-9:
            break
    fit = _solved(pair, tau)
    _require_variation(fit, pair)
    if abs(tau) > longest:
        raise IdentificationError(
            "no delay within the range explains the channels",
            where="skew",
            value=f"{tau:.3g} s",
            limit=f"up to {longest:g} s",
            remedy="Allow more with the setting longest_delay, or choose other channels.",
        )
    return fit, tau, float(fit.standard_error[2] / abs(fit.values[1]))
