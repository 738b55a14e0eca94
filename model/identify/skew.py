"""Skew between channels: how much later one of them is latched than another, from what the motion itself shows.

Encoders: theta_o(t + tau) - theta_i(t)/N = ke + w sign(omega) + tau omega, omega the output's
speed. The mean over whole input revolutions takes the input orders away; the orders of the output's
revolution are fitted beside. What is proportional to speed is tau *and* the viscous part of the
wind-up (a torque c omega twists the gear by c omega / K): steady motion cannot tell them apart, so
c/K stands in the budget as type B.

Torque channels: y(t) = a + g x(t - tau) for two readings of one torque; both are smoothed by the
same window, to first order in tau: y = a + g x - g tau dx/dt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from model.arrays import IntArray
from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.estimate import BudgetLine, Estimate, Identifiable
from model.identify.least_squares import LinearFit, solve, student_quantile
from model.units import REVOLUTION

OUTPUT_ORDERS = 4
"""Orders of the output's revolution that are fitted beside the skew, where a whole revolution was turned."""
SPEED_SPAN = 1.5
"""Largest over smallest speed below which wind-up and skew cannot be told apart."""
LEAST_ROWS = 8
"""Whole input revolutions at constant speed, at least."""
WINDOW = 11
"""Samples of the window that both torques are smoothed by."""
LEAST_VARIATION = 4.0
"""How many times its own residual a torque must vary for a delay to be seen in it."""


@dataclass(frozen=True)
class RevolutionMeans:
    """Means over whole input revolutions at constant speed, in the order they were turned.

    speed (n,) of the output [rad/s], signed; offset (n,) of theta_o - theta_i/N [rad]; output_angle
    (n,) [rad]; plateau (n,) which stretch of constant speed each belongs to, ascending.
    """

    speed: Array
    offset: Array
    output_angle: Array
    plateau: IntArray


def encoder_skew(means: RevolutionMeans, needed: float, viscous_windup: float = 0.0) -> Estimate:
    """How much later the output encoder is latched than the input encoder [s].

    `needed` [s]: an expanded uncertainty up to this counts as identified; `viscous_windup` [s] the
    standard uncertainty of c/K, the viscous wind-up per speed. One speed, one direction or too few
    revolutions are "no", never an exception.
    """
    n = len(means.speed)
    if n < LEAST_ROWS:
        return _unknown(
            "encoder_skew", f"{n} whole revolutions at constant speed, {LEAST_ROWS} are needed"
        )
    both = bool((means.speed > 0).any() and (means.speed < 0).any())
    span = float(np.abs(means.speed).max() / np.abs(means.speed).min())
    if not both or span < SPEED_SPAN:
        why = f"one speed only (largest over smallest {span:.3g})" if both else "one direction only"
        return _unknown(
            "encoder_skew", f"{why}: wind-up by friction and skew times speed are one number"
        )
    turned = float(np.ptp(means.output_angle))
    orders = OUTPUT_ORDERS if turned >= REVOLUTION else 0
    try:
        value, deviation, freedom = _fit(means, orders)
    except IdentificationError as error:
        return _unknown("encoder_skew", str(error))
    lines = [BudgetLine("scatter between stretches", "A", deviation, degrees_of_freedom=freedom)]
    if viscous_windup > 0.0:
        lines.append(
            BudgetLine(
                "viscous wind-up c/K", "B", viscous_windup, "proportional to speed as the skew is"
            )
        )
    half = deviation * student_quantile(freedom)
    estimate = Estimate.about("encoder_skew", value, half, "s", tuple(lines))
    notes: list[str] = []
    if not orders:
        turns = turned / REVOLUTION
        notes.append(f"only {turns:.2f} output revolutions: its orders are in the scatter")
    if half > needed:
        return _judged(estimate, "no", [*notes, _too_wide(half, needed)])
    if estimate.expanded_uncertainty > needed:
        notes.append(
            "skew and viscous wind-up together; what is proportional to speed is known, not which of them it is"
        )
        return _judged(estimate, "weakly", notes)
    return _judged(estimate, "weakly" if notes else "yes", notes)


def torque_skew(
    first: Array,
    second: Array,
    interval: float,
    needed: float,
    starts: IntArray,
    quantum: float = 0.0,
) -> Estimate:
    """How much later `second` (n,) shows a torque than `first` (n,) [s], both sampled every `interval` [s].

    `starts` are the rows at which contiguous pieces begin, each longer than the window; a smoothed row never spans two.
    `quantum` is the size of one count of `first`: its quantisation would pull the delay towards zero and is taken out.
    Torques that hardly vary, or do not agree, are "no".
    """
    match = _delay(first, second, interval, starts, quantum, WINDOW)
    if isinstance(match, str):
        return _unknown("torque_skew", match)
    delay, error, freedom = match
    longer = _delay(first, second, interval, starts, quantum, 2 * WINDOW - 1)
    lines = [BudgetLine("scatter between pieces", "A", error, degrees_of_freedom=freedom)]
    if not isinstance(longer, str):
        # Torque that is faster than half the sampling rate appears slow, with a delay of its own.
        lines.append(
            BudgetLine(
                "choice of the window",
                "B",
                abs(longer[0] - delay),
                "aliased ripple changes with it",
            )
        )
    half = error * student_quantile(freedom)
    estimate = Estimate.about("torque_skew", delay, half, "s", tuple(lines))
    if half > needed:
        return _judged(estimate, "no", [_too_wide(half, needed)])
    if estimate.expanded_uncertainty > needed:
        return _judged(
            estimate,
            "weakly",
            ["it changes with the window: the torque has ripple faster than the sampling"],
        )
    return estimate


def _delay(
    first: Array,
    second: Array,
    interval: float,
    starts: IntArray,
    quantum: float,
    width: int,
) -> tuple[float, float, float] | str:
    """Delay, its standard error and degrees of freedom with one window; in words why there is none."""
    x, slope, y, blocks = _smoothed(first, second, interval, starts, width)
    if len(blocks) < 3:
        return f"{len(blocks)} pieces of torque, 3 are needed"
    design = np.column_stack([np.ones(len(x)), x, slope])
    try:
        fit = solve(design, y, block_starts=blocks.astype(np.float64), where="torque skew")
    except IdentificationError as error:
        return str(error)
    values, covariance = _without_noise(fit, design, interval, quantum, width)
    gain, product = float(values[1]), float(values[2])
    residual = float(np.std(fit.residual))
    if not abs(gain) > 0.1 or float(np.std(x)) < LEAST_VARIATION * residual / abs(gain):
        return "the torque did not vary enough, or both readings are not of one torque"
    jacobian = np.array([product / gain**2, -1.0 / gain])
    error = math.sqrt(max(float(jacobian @ covariance[1:, 1:] @ jacobian), 0.0))
    return -product / gain, error, fit.freedom


def _fit(means: RevolutionMeans, orders: int) -> tuple[float, float, float]:
    """The factor of the speed, its standard error and degrees of freedom, from the scatter between the stretches.

    Few stretches say little about their own scatter: three of their degrees of freedom belong to
    offset, wind-up and skew.
    """
    angle = means.output_angle
    columns = [np.ones(len(angle)), np.sign(means.speed), means.speed]
    for k in range(1, orders + 1):
        columns += [np.cos(k * angle), np.sin(k * angle)]
    starts = np.flatnonzero(np.diff(means.plateau, prepend=means.plateau[0] - 1))
    free = len(starts) - 3
    if free < 1:
        raise IdentificationError(
            "too few stretches of constant speed",
            where="encoder skew",
            value=len(starts),
            limit=">= 4",
        )
    fit = solve(
        np.column_stack(columns),
        means.offset,
        block_starts=starts.astype(np.float64),
        where="encoder skew",
    )
    deviation = float(fit.standard_error[2]) * math.sqrt(len(starts) / free)
    return float(fit.values[2]), deviation, float(free)


def _without_noise(
    fit: LinearFit, design: Array, interval: float, quantum: float, width: int
) -> tuple[Array, Array]:
    """Values and covariance of the fit with the quantisation of its regressors taken out of the normal matrix."""
    if not quantum > 0.0:
        return fit.values, fit.covariance
    window = _window(width)
    slope = np.convolve(window, [1.0, 0.0, -1.0]) / (2.0 * interval)
    noise = (
        len(design)
        * quantum**2
        / 12.0
        * np.diag([0.0, float(window @ window), float(slope @ slope)])
    )
    normal = design.T @ design
    if np.any(np.linalg.eigvalsh(normal - 2.0 * noise) <= 0.0):
        # Hardly more than quantisation: nothing is made of it.
        return fit.values, fit.covariance
    correction = np.linalg.solve(normal - noise, normal)
    return correction @ fit.values, correction @ fit.covariance @ correction.T


def _window(width: int) -> Array:
    window = np.hanning(width + 2)[1:-1]
    return window / window.sum()


def _smoothed(
    first: Array, second: Array, interval: float, starts: IntArray, width: int
) -> tuple[Array, Array, Array, IntArray]:
    """Smoothed first torque, its slope, smoothed second torque, and where the pieces begin in them."""
    window = _window(width)
    rows: list[tuple[Array, Array, Array]] = []
    for start, stop in zip(starts, [*starts[1:], len(first)], strict=False):
        if stop - start < 3 * width:
            continue
        x = np.convolve(first[start:stop], window, "valid")
        y = np.convolve(second[start:stop], window, "valid")
        rows.append((x[1:-1], (x[2:] - x[:-2]) / (2.0 * interval), y[1:-1]))
    if not rows:
        return np.empty(0), np.empty(0), np.empty(0), np.empty(0, dtype=np.int64)
    begins = np.cumsum([0, *(len(x) for x, _, _ in rows[:-1])])
    x, slope, y = (np.concatenate(column) for column in zip(*rows, strict=True))
    return x, slope, y, begins.astype(np.int64)


def _too_wide(half: float, needed: float) -> str:
    return f"the scatter allows {half:.2g} s, {needed:.2g} s were needed"


def _judged(estimate: Estimate, verdict: Identifiable, notes: list[str]) -> Estimate:
    return replace(estimate, identifiable=verdict, note="; ".join(notes))


def _unknown(name: str, why: str) -> Estimate:
    return Estimate.about(name, math.nan, math.nan, "s", identifiable="no", note=why)
