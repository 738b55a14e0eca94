"""Orders of a channel over an angle, each direction and their mean, with intervals by the noise beside each order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import quotient
from model.identify.checks import Array
from model.identify.least_squares import student_quantile
from model.identify.orders.comb import Comb, Weighted, median_floor
from model.identify.orders.regression import Solved, between_stretches, residuals, solve
from model.identify.orders.samples import OrderSamples, Piece
from model.identify.orders.search import (
    PADDING,
    Line,
    Search,
    find_orders,
    lowest_order,
    residual_combs,
    searched_to,
)

DIFFERENCE = 1e-3
"""Chance that noise alone makes the two directions of an order differ as much, below which they are told apart."""
LEAST_FREEDOM = 12.0
"""Degrees of freedom of the noise beside an order below which all of the residual tells it."""
_LEAST_STRETCHES = 4
"""Stretches of one direction from which their scatter tells more than the spectrum."""
FLOOR_LINES = 20


@dataclass(frozen=True)
class Wave:
    """One order in one direction, or the mean of both: a, b of a cos v theta + b sin v theta, their covariance (2, 2),
    and the degrees of freedom that it is known with.
    """

    vector: Array
    covariance: Array
    freedom: float

    @property
    def amplitude(self) -> float:
        """Length of (a, b)."""
        return float(np.hypot(*self.vector))

    @property
    def phase(self) -> float:
        """Of amplitude x cos(v theta - phase) [rad]."""
        return math.atan2(float(self.vector[1]), float(self.vector[0]))


@dataclass(frozen=True)
class Order:
    """An order with its waves by direction (+1, -1) and their mean; whether the directions differ."""

    line: Line
    waves: dict[int, Wave]
    mean: Wave
    differ: bool

    @property
    def order(self) -> float:
        """Cycles per revolution of the angle."""
        return self.line.order

    @property
    def name(self) -> str:
        """As in the names of estimates: no more digits than the order is known to."""
        if not self.line.uncertainty > 0.0:
            return f"{self.order:.6g}"
        digits = max(0, 1 - math.floor(math.log10(self.line.uncertainty)))
        return f"{round(self.order, digits):.6g}"


@dataclass(frozen=True, kw_only=True)
class OrdersFit:
    """The orders of a channel, strongest first.

    constants: by direction the mean of the channel without orders, its standard error and degrees of freedom. left
    (by direction): r.m.s. of what the fit leaves. spectrum, floor: amplitude per order before any fit, and the
    noise floor of what is left, by direction, for plots.
    """

    samples: OrderSamples
    orders: tuple[Order, ...]
    constants: dict[int, tuple[float, float, float]]
    left: dict[int, float]
    spectrum: dict[int, tuple[Array, Array]]
    floor: dict[int, tuple[Array, Array]]

    def rounded(self, order: Order) -> float:
        """Amplitude that the rounding of the angle can give a line beside this one: A v q/pi of each stronger order.

        Counts that keep step with the sampling lay it on lines of their own.
        """
        sizes = [
            other.mean.amplitude * other.order
            for other in self.orders
            if other.mean.amplitude > order.mean.amplitude
        ]
        return self.samples.quantum / math.pi * math.sqrt(sum(size**2 for size in sizes))

    def order(self, order: float) -> Order | None:
        """The order found there; None where there is none."""
        return next((o for o in self.orders if abs(o.order - order) < 1e-9), None)


def fit_samples(samples: OrderSamples, search: Search) -> OrdersFit:
    """The orders of samples that were gathered."""
    lines = find_orders(samples, search)
    orders = np.array([line.order for line in lines])
    solved = {d: solve(samples, samples.every(), d, orders) for d in samples.directions}
    top = max(searched_to(samples, search.highest), *orders, 1.0)
    combs, left = _residual_combs(samples, solved, top)
    whites = {d: float(np.mean(comb.power[1:])) for d, comb in combs.items()}
    waves = {d: _waves(samples, one, combs[d], d, whites[d]) for d, one in solved.items()}
    found = [_order(line, {d: waves[d][k] for d in solved}) for k, line in enumerate(lines)]
    return OrdersFit(
        samples=samples,
        orders=tuple(sorted(found, key=lambda o: -_strongest_way(o))),
        constants={d: _constant(samples, solved[d], combs[d], d, whites[d]) for d in solved},
        left=left,
        spectrum=_spectra(samples, search.highest),
        floor={d: _floor(combs[d], samples, d) for d in solved},
    )


def _strongest_way(order: Order) -> float:
    return max(order.mean.amplitude, *(wave.amplitude for wave in order.waves.values()))


def _waves(
    samples: OrderSamples, solved: Solved, comb: Comb, direction: int, white: float
) -> list[Wave]:
    """Each order of one direction with the noise beside it; with the scatter of the stretches where that is more."""
    variance, freedom = comb.noise(solved.orders, solved.orders, lowest_order(samples))
    few = freedom < LEAST_FREEDOM
    variance = np.where(few, white, variance)
    freedom = np.where(few, max(2.0 * len(comb.power) * comb.windows, 4.0), freedom)
    scattered, stretches = (
        (None, 0) if samples.is_steady else between_stretches(samples, solved, direction)
    )
    out: list[Wave] = []
    for k in range(len(solved.orders)):
        block = slice(2 * k, 2 * k + 2)
        covariance, known = variance[k] * solved.inverse[block, block], float(freedom[k])
        if scattered is not None and stretches >= _LEAST_STRETCHES:
            other = scattered[block, block]
            if np.trace(other) > np.trace(covariance):
                size = float(np.trace(other) / np.trace(covariance))
                covariance, known = size * covariance, 2.0 * (stretches - 1)
        out.append(Wave(solved.vector[block], covariance, known))
    return out


def _order(line: Line, waves: dict[int, Wave]) -> Order:
    every = list(waves.values())
    if len(every) == 1:
        return Order(line, waves, every[0], differ=False)
    covariance = every[0].covariance + every[1].covariance
    freedom = _together(every)
    mean = Wave(0.5 * (every[0].vector + every[1].vector), 0.25 * covariance, freedom)
    apart = every[0].vector - every[1].vector
    distance = float(apart @ np.linalg.solve(covariance, apart))
    chance = float(scipy.special.fdtrc(2.0, freedom, 0.5 * distance))
    return Order(line, waves, mean, differ=chance < DIFFERENCE)


def _together(waves: list[Wave]) -> float:
    """Degrees of freedom of a sum of these (Welch, Satterthwaite)."""
    sizes = [float(np.trace(wave.covariance)) for wave in waves]
    fourth = sum(size**2 / wave.freedom for size, wave in zip(sizes, waves, strict=True))
    return quotient(sum(sizes) ** 2, fourth, math.inf)


def _constant(
    samples: OrderSamples, solved: Solved, comb: Comb, direction: int, white: float
) -> tuple[float, float, float]:
    """The channel's mean without orders, its standard error, and the degrees of freedom.

    By the noise of the lowest orders; by the scatter of the stretches' means where that is more.
    """
    own = [k for k, s in enumerate(samples.stretches) if s.direction == direction]
    weights = np.array(
        [samples.stretches[k].samples for k in own if k in solved.trends], dtype=float
    )
    means = np.array([solved.trends[k][0] for k in own if k in solved.trends])
    total = float(weights.sum())
    value = float(weights @ means) / total
    (variance,), (freedom,) = comb.noise(np.zeros(1), solved.orders, lowest_order(samples))
    if freedom < LEAST_FREEDOM:
        variance, freedom = white, max(2.0 * len(comb.power) * comb.windows, 4.0)
    error = math.sqrt(variance / total)
    if len(means) >= 3:
        spread = weights / total * (means - value)
        scatter = math.sqrt(float(spread @ spread) * len(means) / (len(means) - 1.0))
        if scatter > error:
            return value, scatter, len(means) - 1.0
    return value, error, float(freedom)


def _residual_combs(
    samples: OrderSamples, solved: dict[int, Solved], highest: float
) -> tuple[dict[int, Comb], dict[int, float]]:
    """The spectrum of what the fit of everything leaves, and the r.m.s. of single samples, by direction."""
    combs: dict[int, Comb] = {}
    left: dict[int, float] = {}
    for direction, one in solved.items():
        sums = _Squares()
        pieces = sums.within(samples.every(), direction)
        parts = sums.counted(residuals(samples, pieces, one, direction))
        combs[direction] = Comb.of(parts, samples.reach(direction), highest, 1)
        left[direction] = math.sqrt(sums.square / max(sums.samples, 1.0))
    return combs, left


class _Squares:
    """Sum of squares of residuals that pass by."""

    def __init__(self) -> None:
        self.square = self.samples = 0.0

    def within(self, pieces: Iterable[Piece], direction: int) -> Iterator[Piece]:
        """The pieces; the scatter within their groups is added."""
        for piece in pieces:
            if piece.direction == direction:
                self.square += piece.within
            yield piece

    def counted(self, parts: Iterable[Weighted]) -> Iterator[Weighted]:
        """The residuals; their squares are added."""
        for angle, value, count in parts:
            self.square += float(count @ value**2)
            self.samples += float(count.sum())
            yield angle, value, count


def _spectra(samples: OrderSamples, highest: float) -> dict[int, tuple[Array, Array]]:
    """Orders and amplitudes of each direction with nothing but its trend taken out, for a plot."""
    nothing = np.empty(0)
    solved = {d: solve(samples, samples.held, d, nothing) for d in samples.held_directions}
    top = searched_to(samples, highest)
    spectra: dict[int, tuple[Array, Array]] = {}
    for d, comb in residual_combs(samples, solved, top, PADDING).items():
        count = sum(float(p.count.sum()) for p in samples.held if p.direction == d)
        scale = 2.0 / math.sqrt(count / comb.windows)
        spectra[d] = comb.orders[1:], scale * np.sqrt(comb.power[1:])
    return spectra


def _floor(comb: Comb, samples: OrderSamples, direction: int) -> tuple[Array, Array]:
    """Orders and the amplitude that noise alone has there, for a plot."""
    count = sum(float(p.count.sum()) for p in samples.held if p.direction == direction)
    floor = median_floor(comb.power[1:], FLOOR_LINES) / math.log(2.0)
    return comb.orders[1:], 2.0 * np.sqrt(floor / (count / comb.windows))


def interval(value: float, error: float, freedom: float) -> tuple[float, float]:
    """The 95 % interval of a value with a standard error of these degrees of freedom."""
    half = student_quantile(freedom) * error
    return value - half, value + half
