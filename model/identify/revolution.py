"""Fourier series of any channel over one revolution, with the orders chosen by the data and the directions apart.

    y(theta) = c_± + sum_n (a_n± cos n theta + b_n± sin n theta)

+ and - are the two directions of travel. Their mean is a function of the angle alone (cogging,
eccentricity); half the difference of the constants is what opposes motion (friction). The estimator
is that of `model.identify.orders`: lines that are no whole orders are fitted beside the whole ones,
so that their leakage is not taken for orders, and are said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array, positive
from model.identify.estimate import BudgetLine, Estimate
from model.identify.orders.fit import Order, OrdersFit, Wave, fit_samples, interval
from model.identify.orders.samples import (
    WHOLE_TURN,
    OrderSamples,
    Piece,
    Source,
)
from model.identify.orders.search import Search, searched_to
from model.identify.polar import RESIDUAL, polar
from model.units import REVOLUTION

HIGHEST_ORDER = 200
LEAST_SAMPLES = 60
WHOLE = 1e-9
CURVE_POINTS = 3600
_OF_WAVES = 48.0
"""Degrees of freedom of a shift between directions that the noise of the waves alone explains."""


@dataclass(frozen=True)
class DirectionSeries:
    """The series of one direction: constant, a_n and b_n of the whole orders, and what the fit leaves (r.m.s.)."""

    constant: float
    cosine: Array
    sine: Array
    residual_rms: float


@dataclass(frozen=True, kw_only=True)
class RevolutionFit:
    """A channel over one revolution: whole orders chosen by significance, strongest first.

    orders (k,); amplitude (k,) of the mean of both directions; estimates: amplitude_n, phase_n of a cos + b sin =
    amplitude cos(n theta - phase), mean, and with both directions friction (half difference) and direction_shift [rad].
    metrics: residual_rms (worst direction), samples, candidates, revolutions. angle, forward_curve, reverse_curve,
    mean_curve over one revolution; `fit` has every line, whole or not, with spectra and noise floors.
    """

    orders: np.ndarray
    amplitude: Array
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    forward: DirectionSeries | None
    reverse: DirectionSeries | None
    angle: Array
    forward_curve: Array | None
    reverse_curve: Array | None
    mean_curve: Array
    fit: OrdersFit


def fit_series(
    source: Source, *, highest_order: int = HIGHEST_ORDER, unit: str, has_line: bool = True
) -> RevolutionFit:
    """The Fourier series of what a source yields over one revolution of an angle, orders chosen automatically.

    Each direction of travel must cover a whole revolution. `unit` is that of the values; `has_line`: whether the trend
    may have a slope.
    """
    highest = positive("highest_order", float(highest_order))
    samples = OrderSamples.gathered(source, highest, has_line=has_line)
    warnings: list[str] = []
    left_out: list[int] = []
    for direction in samples.directions:
        turned = samples.revolutions(direction)
        if turned < WHOLE_TURN:
            name = "Forward" if direction > 0 else "Reverse"
            warnings.append(f"{name} travel covers only {turned:.2f} revolutions and is left out.")
            left_out.append(direction)
    if len(left_out) == len(samples.directions):
        raise IdentificationError(
            "covers no whole revolution in any direction",
            where="angle",
            value=f"{max(samples.revolutions(d) for d in left_out):.2f} revolutions",
            limit=">= 1",
            remedy="Record a whole revolution, or ask for the order spectrum of a part of one.",
        )
    if left_out:
        one_way = _one_way(source, -left_out[0])
        samples = OrderSamples.gathered(one_way, highest, has_line=has_line)
    reached = searched_to(samples, highest)
    if reached < highest:
        warnings.append(f"The samples carry orders up to {reached:.4g} only.")
    fit = fit_samples(samples, Search(highest, prefers_whole=True))
    return _revolution_fit(fit, warnings, unit, reached)


def _one_way(source: Source, direction: int) -> Source:
    """What a source yields of one direction, its stretches numbered anew."""

    def pieces() -> Iterator[Piece]:
        numbers: dict[int, int] = {}
        for piece in source():
            if piece.direction == direction:
                yield replace(piece, stretch=numbers.setdefault(piece.stretch, len(numbers)))

    return pieces


def _revolution_fit(
    fit: OrdersFit, warnings: list[str], unit: str, reached: float
) -> RevolutionFit:
    whole = [order for order in fit.orders if abs(order.order - round(order.order)) < WHOLE]
    between = [order for order in fit.orders if order not in whole]
    orders = np.array([round(order.order) for order in whole], dtype=np.int64)
    series = {d: _series(whole, fit, d) for d in fit.samples.directions}
    angle = np.linspace(0.0, REVOLUTION, CURVE_POINTS, endpoint=False)
    curves = {d: _curve(angle, orders, one) for d, one in series.items()}
    if not len(orders):
        warnings.append("No order rises above the noise.")
    if between:
        warnings.append(_between(between))
    return RevolutionFit(
        orders=orders,
        amplitude=np.array([order.mean.amplitude for order in whole]),
        estimates={**_order_estimates(whole, unit), **_direction_estimates(fit, whole, unit)},
        metrics={
            "residual_rms": max(fit.left.values()),
            "samples": float(fit.samples.samples),
            "candidates": float(math.floor(reached)),
            "revolutions": max(fit.samples.revolutions(d) for d in fit.samples.directions),
        },
        warnings=tuple(warnings),
        forward=series.get(1),
        reverse=series.get(-1),
        angle=angle,
        forward_curve=curves.get(1),
        reverse_curve=curves.get(-1),
        mean_curve=np.mean(list(curves.values()), axis=0),
        fit=fit,
    )


def _between(lines: list[Order]) -> str:
    """What is said of lines that are no whole orders."""
    named = ", ".join(order.name for order in lines[:6])
    more = f" and {len(lines) - 6} more" if len(lines) > 6 else ""
    return (
        f"There are lines at {named}{more}, which are no whole orders of this angle: they were fitted beside, and "
        "are no part of the series. Where they are strong, look at the ratio and at the channel of the angle."
    )


def _series(whole: list[Order], fit: OrdersFit, direction: int) -> DirectionSeries:
    vectors = np.array([order.waves[direction].vector for order in whole]).reshape(-1, 2)
    constant, _, _ = fit.constants[direction]
    return DirectionSeries(constant, vectors[:, 0], vectors[:, 1], fit.left[direction])


def _curve(angle: Array, orders: np.ndarray, series: DirectionSeries) -> Array:
    phase = angle[:, None] * orders
    curve: Array = series.constant + np.cos(phase) @ series.cosine + np.sin(phase) @ series.sine
    return curve


def _order_estimates(whole: list[Order], unit: str) -> dict[str, Estimate]:
    estimates: dict[str, Estimate] = {}
    for order in whole:
        mean = order.mean
        found = polar(order.name, mean.vector, mean.covariance, mean.freedom, unit)
        estimates[found.amplitude.name] = found.amplitude
        estimates[found.phase.name] = found.phase
    return estimates


def _direction_estimates(fit: OrdersFit, whole: list[Order], unit: str) -> dict[str, Estimate]:
    """Mean (half sum), friction (half difference), and the angle by which the series of the directions are shifted."""
    if len(fit.constants) == 1:
        ((value, error, freedom),) = fit.constants.values()
        note = "one direction only: friction and offset cannot be separated"
        mean = _estimate("mean", value, error, freedom, unit)
        return {"mean": replace(mean, identifiable="weakly", note=note)}
    (ahead, error_ahead, freedom_ahead), (back, error_back, freedom_back) = (
        fit.constants[1],
        fit.constants[-1],
    )
    error = 0.5 * math.hypot(error_ahead, error_back)
    freedom = min(freedom_ahead, freedom_back)
    estimates = {
        name: _estimate(name, value, error, freedom, unit)
        for name, value in (("mean", 0.5 * (ahead + back)), ("friction", 0.5 * (ahead - back)))
    }
    shift = _shift(whole)
    if shift is not None:
        estimates["direction_shift"] = shift
    return estimates


def _estimate(name: str, value: float, error: float, freedom: float, unit: str) -> Estimate:
    low, high = interval(value, error, freedom)
    line = BudgetLine(RESIDUAL, "A", error, degrees_of_freedom=freedom)
    return Estimate(name=name, value=value, unit=unit, low=low, high=high, budget=(line,))


def _shift(whole: list[Order]) -> Estimate | None:
    """The angle [rad] by which the series ahead is shifted against that back: phases over orders, by their weight."""
    both = [order for order in whole if len(order.waves) == 2]
    if not both:
        return None
    orders = np.array([order.order for order in both])
    apart = np.array([order.waves[1].phase - order.waves[-1].phase for order in both])
    shifts = np.angle(np.exp(1j * apart)) / orders
    variance = np.array([sum(_phase_variance(w) for w in o.waves.values()) for o in both])
    weight = orders**2 / np.maximum(variance, 1e-300)
    total = float(weight.sum())
    value = float(weight @ shifts) / total
    # Orders that disagree by more than their noise say so themselves (Birge).
    excess = float(weight @ (shifts - value) ** 2) / max(len(both) - 1, 1)
    error = math.sqrt(max(excess if len(both) > 1 else 1.0, 1.0) / total)
    return _estimate(
        "direction_shift",
        value,
        error,
        max(len(both) - 1.0, 1.0) if excess > 1.0 else _OF_WAVES,
        "rad",
    )


def _phase_variance(wave: Wave) -> float:
    return 0.5 * float(np.trace(wave.covariance)) / max(wave.amplitude**2, 1e-300)
