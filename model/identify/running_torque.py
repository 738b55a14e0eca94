"""The running torque of one constant speed: work per whole revolution, with an error that respects autocorrelation.

    T = (1/2 pi K) * integral of T d theta over K whole input revolutions

Averaging over angle takes out everything that is periodic in the input (cogging, mesh depth),
averaging over time would not at a speed that ripples. The error comes from revolution to
revolution; with few revolutions, from what a Fourier series over one revolution leaves. Half the
difference of the directions is friction; half the sum is offset of the torque zero and asymmetry.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import ArrayLike, NDArray

from model.arrays import quotient
from model.errors import IdentificationError
from model.identify.checks import Array, channels, increasing
from model.identify.least_squares import LinearFit, solve
from model.units import DEGREE, REVOLUTION, RPM

_FEW_REVOLUTIONS = 6
_USUAL_ORDERS = 12
"""Orders of the input that the torque over one revolution is always given."""
STANDS_OUT = 0.01
"""Probability that noise alone makes one further order stand out."""
_NOISY_RANGE = 4.0
"""Range of a handful of visits, in standard errors, that noise alone explains."""
_FEW_POINTS = 6
"""Speeds of a tare below which nobody can say whether it is a straight line."""
BENT = 0.2
"""Relative standard uncertainty of the slope with which a tare goes on above its fastest speed."""
REST_LIMIT = 0.1 * DEGREE
"""Standstill, in angle that a steady speed would have turned, above which a hold counts as stick: below a steep
Stribeck curve a speed loop stops and goes by tenths of a degree, and the mean torque is several per cent low."""
SWING_LIMIT = 0.5
"""Swing of the speed about its mean, relative rms, above which a hold counts as stick too: below a steep Stribeck curve
drive and gear can swing between rest and twice the mean in a few samples, so fast that no rest is seen, and the mean
torque is by per cents not that of the mean speed. Cogging makes 0.3 of it."""
_RESTING_STEPS = 3.0
"""Counts, or samples where each brings some, whose time is no standstill: cogging lets a slow speed ripple."""


@dataclass(frozen=True, kw_only=True)
class RunningTorque:
    """Mean torque of one hold: speed [rad/s, signed], torque [N m, signed], its standard error and degrees of freedom.

    revolutions: whole input revolutions averaged; time: middle of the hold [s]; speed_ripple: rms
    of the speed between tenths of a revolution, relative; rest_angle: longest standstill as the
    angle that the mean speed would have turned [rad]; swing: rms of the speed from sample to sample, relative.
    """

    speed: float
    torque: float
    standard_error: float
    freedom: float
    revolutions: int
    time: float
    speed_ripple: float = 0.0
    rest_angle: float = 0.0
    swing: float = 0.0
    temperature: float = math.nan

    @property
    def direction(self) -> float:
        return math.copysign(1.0, self.speed)

    @property
    def sticks(self) -> bool:
        """Whether the input stopped and went: it stood still for longer than a steady speed explains, or swung."""
        return self.rest_angle > REST_LIMIT or self.swing > SWING_LIMIT


def average_torque(
    time: ArrayLike, input_angle: ArrayLike, torque: ArrayLike, *, temperature: float = math.nan
) -> RunningTorque:
    """The running torque of one hold from time [s], input angle [rad] and torque [N m], shape (n,), settled.

    The last whole number of input revolutions is used. Raises `IdentificationError` for less than one revolution.
    """
    clock = increasing("time", time, minimum=16)
    clock, angle, effort = channels(16, time=clock, input_angle=input_angle, torque=torque)
    direction = math.copysign(1.0, angle[-1] - angle[0])
    turned = np.maximum.accumulate(direction * (angle - angle[0]))
    whole = math.floor(turned[-1] / REVOLUTION + 1e-6)
    if whole < 1:
        raise IdentificationError(
            "covers less than one whole input revolution",
            where="input_angle",
            value=f"{turned[-1] / REVOLUTION:.2f} revolutions",
            limit=">= 1",
            remedy="Hold the speed for longer.",
        )
    work = np.concatenate([[0.0], np.cumsum(0.5 * (effort[1:] + effort[:-1]) * np.diff(turned))])
    marks: Array = turned[-1] - REVOLUTION * np.arange(whole, -1, -1.0)
    rising = np.concatenate([[True], np.diff(turned) > 0.0])
    at_marks = np.interp(marks, turned[rising], work[rising])
    means = np.diff(at_marks) / REVOLUTION
    times = np.interp(marks, turned[rising], clock[rising])
    speed = direction * REVOLUTION * whole / (times[-1] - times[0])
    inside = turned >= marks[0]
    error, freedom = _mean_error(means, turned[inside] - marks[0], effort[inside], whole)
    tenths = np.interp(
        np.linspace(float(marks[0]), float(marks[-1]), 10 * whole + 1),
        turned[rising],
        clock[rising],
    )
    local = REVOLUTION / 10.0 / np.maximum(np.diff(tenths), 1e-12)
    rests = np.diff(clock[rising])
    return RunningTorque(
        speed=speed,
        torque=float(means.mean()),
        standard_error=error,
        freedom=freedom,
        revolutions=whole,
        time=0.5 * (times[0] + times[-1]),
        speed_ripple=float(np.std(local) / abs(speed)),
        rest_angle=_rest_angle(rests, turned[rising], speed),
        swing=_swing(turned),
        temperature=temperature,
    )


def _rest_angle(rests: Array, turned: Array, speed: float) -> float:
    """The longest time without a count, as angle at the mean speed, less what a few counts or samples take."""
    if len(rests) == 0:
        return 0.0
    step = max(float(np.min(np.diff(turned))), float(np.min(rests)) * abs(speed))
    return max(float(rests.max()) * abs(speed) - _RESTING_STEPS * step, 0.0)


def _swing(turned: Array) -> float:
    """Rms of the speed about its mean, relative: its autocovariance at one and at two samples, carried on to none by a
    parabola. Counts, noise of the angle and rows that came late raise one sample and lower its neighbour, and are no
    swing.
    """
    steps: Array = np.diff(turned)
    off: Array = steps / steps.mean() - 1.0
    one, two = (float(np.mean(off[lag:] * off[:-lag])) for lag in (1, 2))
    return math.sqrt(max((4.0 * one - two) / 3.0, 0.0))


def _mean_error(means: Array, turned: Array, effort: Array, whole: int) -> tuple[float, float]:
    """Standard error of the mean and its degrees of freedom."""
    if whole >= _FEW_REVOLUTIONS:
        centred = means - means.mean()
        variance = float(centred @ centred) / (whole - 1)
        inflation = 1.0
        if whole >= 20 and variance > 0.0:
            rho = min(
                max(
                    float(centred[1:] @ centred[:-1]) / float(centred @ centred) + 1.0 / whole, 0.0
                ),
                0.9,
            )
            inflation = (1.0 + rho) / (1.0 - rho)
        floor = 1e-12 * max(abs(float(means.mean())), 1e-9)
        return max(math.sqrt(variance * inflation / whole), floor), max(
            (whole - 1) / inflation, 2.0
        )
    return _error_within(turned, effort, whole)


def _error_within(turned: Array, effort: Array, whole: int) -> tuple[float, float]:
    """Error of the mean from what a Fourier series over one input revolution leaves (few revolutions).

    Further orders that stand out join the series: cogging is part of the motor and adds nothing to a mean over whole
    revolutions, so that it is no error of it.
    """
    bins = min(240 * whole, max(len(effort) // 4, 40 * whole))
    place = np.minimum((turned * (bins / (REVOLUTION * whole))).astype(np.intp), bins - 1)
    counts = np.bincount(place, minlength=bins)
    filled = counts > 0
    means = np.bincount(place, weights=effort, minlength=bins)[filled] / counts[filled]
    angle: Array = (np.flatnonzero(filled).astype(np.float64) + 0.5) * (REVOLUTION * whole / bins)
    orders = list(range(1, min(_USUAL_ORDERS, (len(angle) // 3 - 5) // 2) + 1))
    if len(angle) <= 2 * len(orders) + 4:
        spread = float(np.std(effort, ddof=1)) if len(effort) > 1 else abs(float(effort.mean()))
        return max(spread / math.sqrt(max(whole, 1)), 1e-12), 2.0
    fit = _series(angle, means, orders)
    further = np.arange(len(orders) + 1, bins // (2 * whole))
    # Half of the means are left to tell the noise.
    standing = _standing_out(angle, fit.residual, further)[: len(angle) // 4 - 1 - len(orders)]
    if len(standing):
        fit = _series(angle, means, [*orders, *standing])
    floor = 1e-12 * max(abs(float(means.mean())), 1e-9)
    return max(float(fit.standard_error[0]), floor), max(fit.freedom, 2.0)


def _series(angle: Array, values: Array, orders: Sequence[int]) -> LinearFit:
    """A Fourier series of these orders of the input revolution, its constant first."""
    waves = [f(n * angle) for n in orders for f in (np.cos, np.sin)]
    design: Array = np.column_stack([np.ones_like(angle), *waves])
    return solve(design, values, where="torque over one revolution")


def _standing_out(angle: Array, residual: Array, orders: NDArray[np.intp]) -> list[int]:
    """The orders whose power noise alone would not give, the strongest first.

    Noise has an exponential power, whose median is log 2 of its mean; a few strong orders do not move it.
    """
    if len(orders) == 0:
        return []
    power = np.abs(np.exp(1j * np.outer(orders, angle)) @ residual) ** 2
    mean = float(np.median(power)) / math.log(2.0)
    strong = power > mean * math.log(len(orders) / STANDS_OUT)
    return [int(n) for n in orders[np.argsort(-power)] if strong[n - orders[0]]]


@dataclass(frozen=True, kw_only=True)
class FrictionPoints:
    """Friction and offset over speed: arrays of shape (n,), SI.

    speed > 0; friction [N m]: half difference of the directions, or the torque of one direction with its sign removed
    (`paired` False); offset [N m]: half sum (NaN where unpaired). `members`: the holds behind each
    point, by their place in the sequence that was given; `level` numbers the speeds.
    """

    speed: Array
    friction: Array
    standard_error: Array
    freedom: Array
    offset: Array
    offset_error: Array
    paired: np.ndarray
    members: tuple[tuple[int, ...], ...]
    level: np.ndarray
    warnings: tuple[str, ...] = field(default=())

    def mean_of(self, values: Array) -> Array:
        """The mean of something that every hold has, over the holds of each point: (n, ...) from (holds, ...)."""
        return self._averaging @ values

    @functools.cached_property
    def _averaging(self) -> Array:
        shares = np.zeros((len(self.members), 1 + max(max(m) for m in self.members)))
        for row, members in enumerate(self.members):
            shares[row, list(members)] = 1.0 / len(members)
        return shares


def pair_directions(holds: Sequence[RunningTorque], *, tolerance: float = 0.03) -> FrictionPoints:
    """Half difference and half sum of forward and reverse holds whose speeds agree within `tolerance` (relative).

    Holds of one speed and direction (up and down, repeats) are matched in order of time, so that
    what drifts slowly cancels. Holds without a partner keep their own torque and are marked as not
    paired.
    """
    if not holds:
        raise IdentificationError(
            "holds no point", where="running torque", remedy="Give at least six speeds."
        )
    rows: list[tuple[float, ...]] = []
    members: list[tuple[int, ...]] = []
    for level, group in enumerate(_speed_levels(holds, tolerance)):
        in_time = sorted(group, key=lambda k: holds[k].time)
        ahead = [k for k in in_time if holds[k].speed > 0.0]
        back = [k for k in in_time if holds[k].speed < 0.0]
        matched = min(len(ahead), len(back))
        for i, j in zip(ahead, back, strict=False):
            rows.append((*_pair(holds[i], holds[j]), level))
            members.append((i, j))
        for k in (*ahead[matched:], *back[matched:]):
            h = holds[k]
            friction = h.direction * h.torque
            one = (abs(h.speed), friction, h.standard_error, h.freedom, math.nan, math.nan)
            rows.append((*one, level))
            members.append((k,))
    alone = sum(len(m) == 1 for m in members)
    warnings: list[str] = []
    if alone:
        warnings.append(
            f"{alone} of {len(holds)} holds have no partner in the other direction: an error "
            "of the torque zero enters their "
            "friction in full."
        )
    speed, friction, standard_error, freedom, offset, offset_error, levels = np.array(rows).T
    return FrictionPoints(
        speed=speed,
        friction=friction,
        standard_error=standard_error,
        freedom=freedom,
        offset=offset,
        offset_error=offset_error,
        paired=np.array([len(m) == 2 for m in members]),
        members=tuple(members),
        level=levels.astype(np.intp),
        warnings=tuple(warnings),
    )


def _speed_levels(holds: Sequence[RunningTorque], tolerance: float) -> list[list[int]]:
    """The places of the holds of each speed, slowest first."""
    levels: list[list[int]] = []
    for k in sorted(range(len(holds)), key=lambda k: abs(holds[k].speed)):
        if levels and abs(holds[k].speed) <= abs(holds[levels[-1][0]].speed) * (1.0 + tolerance):
            levels[-1].append(k)
        else:
            levels.append([k])
    return levels


def _pair(a: RunningTorque, b: RunningTorque) -> tuple[float, ...]:
    """Speed, half difference, its error and degrees of freedom, half sum and its error of two opposite holds."""
    variance = 0.25 * (a.standard_error**2 + b.standard_error**2)
    parts = (0.25 * a.standard_error**2) ** 2 / a.freedom
    parts += (0.25 * b.standard_error**2) ** 2 / b.freedom
    freedom = quotient(variance**2, parts, a.freedom + b.freedom)
    error, speed = math.sqrt(variance), 0.5 * (a.speed - b.speed)
    return (
        speed,
        0.5 * (a.torque - b.torque),
        error,
        freedom,
        0.5 * (a.torque + b.torque),
        error,
    )


def pooled_errors(points: FrictionPoints) -> Array:
    """Standard errors shrunk towards their common relative size: few revolutions say little about their own scatter."""
    relative = points.standard_error / np.maximum(np.abs(points.friction), 1e-12)
    typical = float(np.median(relative))
    prior = 4.0
    variance = (prior * typical**2 + points.freedom * relative**2) / (prior + points.freedom)
    return np.sqrt(variance) * np.maximum(np.abs(points.friction), 1e-12)


@dataclass(frozen=True)
class Tare:
    """Friction torque of the motor alone over speed, from a run without the gear: speed, torque,
    standard error (n,).
    """

    speed: Array
    torque: Array
    standard_error: Array
    valid: bool = True
    note: str = ""

    def at(self, speed: Array) -> tuple[Array, Array, np.ndarray]:
        """Torque and standard error at speeds [rad/s], and which speeds lie beyond the range.

        On the straight line through all of its points where they lie on one, else linear between them and parallel to
        that line above the fastest.
        """
        torque = self._shares(speed) @ self.torque
        error = np.sqrt(np.sum(self.columns(speed) ** 2, axis=1))
        beyond = (speed < self.speed[0] * 0.97) | (speed > self.speed[-1] * 1.03)
        return torque, error, beyond

    def columns(self, speed: Array) -> Array:
        """What one standard error of each of its points does at speeds [rad/s], and what a line that does not go on
        does above the fastest; (n, points + 1) [N m].
        """
        scatter = self._shares(speed) * self.standard_error
        above = np.maximum(speed - self.speed[-1], 0.0)
        bent = BENT * abs(float(self._slope @ self.torque)) * above
        return np.column_stack([scatter, bent])

    def _shares(self, speed: Array) -> Array:
        """The share of each of its torques in that at speeds [rad/s] (n, points)."""
        if self.is_straight:
            weight = self._weight / self._weight.sum()
            return weight + np.outer(speed - float(weight @ self.speed), self._slope)
        inside = np.clip(speed, self.speed[0], self.speed[-1])
        right = np.clip(np.searchsorted(self.speed, inside), 1, len(self.speed) - 1)
        share = (inside - self.speed[right - 1]) / (self.speed[right] - self.speed[right - 1])
        shares, rows = np.zeros((len(speed), len(self.speed))), np.arange(len(speed))
        shares[rows, right - 1], shares[rows, right] = 1.0 - share, share
        return shares + np.outer(np.maximum(speed - self.speed[-1], 0.0), self._slope)

    @property
    def _slope(self) -> Array:
        """The share of each torque in the slope of a straight line over speed, weighed by the errors [s/rad]."""
        away = self._weight * (self.speed - np.average(self.speed, weights=self._weight))
        return away / float(away @ self.speed)

    @property
    def _weight(self) -> Array:
        return 1.0 / np.maximum(self.standard_error, 1e-12) ** 2

    @functools.cached_property
    def is_straight(self) -> bool:
        """Whether its points, enough of them to tell, lie on a straight line as far as their errors say."""
        if len(self.speed) < _FEW_POINTS:
            return False
        weight, slope = self._weight, float(self._slope @ self.torque)
        residual = self.torque - np.average(self.torque, weights=weight)
        residual -= slope * (self.speed - np.average(self.speed, weights=weight))
        limit = scipy.special.chdtri(len(self.speed) - 2.0, 0.05)
        return float(weight @ residual**2) <= float(limit)

    def reaches(self, speed: Array, factor: float) -> np.ndarray:
        """Which speeds [rad/s] are at most this factor above its fastest."""
        return np.asarray(speed <= self.speed[-1] * factor)


def tare_from(holds: Sequence[RunningTorque]) -> Tare:
    """The motor's own friction over speed from the holds of a tare run; repeats of one speed are averaged."""
    points = pair_directions(holds)
    order = np.argsort(points.speed)
    speed, torque, error = points.speed[order], points.friction[order], points.standard_error[order]
    merged: list[tuple[float, float, float]] = []
    start = 0
    for k in range(1, len(speed) + 1):
        if k < len(speed) and speed[k] <= speed[start] * 1.03:
            continue
        part = slice(start, k)
        count = k - start
        internal = math.sqrt(float(np.sum(error[part] ** 2))) / count
        scatter = float(np.std(torque[part], ddof=1)) / math.sqrt(count) if count > 1 else 0.0
        merged.append(
            (float(speed[part].mean()), float(torque[part].mean()), max(internal, scatter))
        )
        start = k
    if len(merged) < 2:
        raise IdentificationError(
            "needs at least two speeds", where="tare", value=len(merged), limit=">= 2"
        )
    table = np.array(merged)
    note = "" if points.paired.all() else "the tare was not taken in both directions"
    return Tare(table[:, 0], table[:, 1], table[:, 2], note=note)


def bracket_drift(
    holds: Sequence[RunningTorque], *, limit: float = 0.03
) -> tuple[float, str | None]:
    """Relative drift of the friction at the reference speed over a sweep, and a sentence when it exceeds `limit`
    and the noise of the visits.

    `holds`: the visits to the reference speed in order of time, each direction apart or mixed.
    """
    if len(holds) < 2:
        return (
            math.nan,
            "The sweep was not bracketed by a reference speed: a drift with temperature cannot be seen.",
        )
    worst, seen = 0.0, False
    for sign in (1.0, -1.0):
        part = [h for h in sorted(holds, key=lambda h: h.time) if h.direction == sign]
        if len(part) >= 2:
            torque = np.array([h.torque for h in part])
            drift = float(np.ptp(torque)) / max(abs(float(torque.mean())), 1e-12)
            noise = _NOISY_RANGE * float(np.median([h.standard_error for h in part]))
            seen = seen or (drift > limit and float(np.ptp(torque)) > noise)
            worst = max(worst, drift)
    if seen:
        speed = abs(holds[0].speed) / RPM
        return worst, (
            f"The reference speed of {speed:.0f} r/min drifted by {100 * worst:.1f} % during the sweep "
            f"(limit {100 * limit:g} %): warm up longer; heat looks like a smaller viscous coefficient."
        )
    return worst, None
