"""Orders whose amplitude changes with speed: each wave's cosine and sine are parabolas over the speed.

    y = trend + sum over v of Re[z_v(w) e^{i v theta}],   z_v(w) = z_0 + z_1 x + z_2 x^2,   x = (|w| - w_m)/w_m

A line whose amplitude changes while the angle runs has sidelobes beside it: lines that no mesh and no bearing makes.
With what lies beyond the amplitude at the middle speed w_m taken off, one line is left. Doubt is by blocks of the
recording, each with what it pulls (a sandwich), so that what moves slowly counts as what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import ComplexArray
from model.identify.checks import Array

LEAST_RANGE = 0.25
"""Of the middle speed: narrower a range of speeds tells no change."""
LEAST_CHANGE = 0.3
"""Of the amplitude at the middle speed, over the range: a smaller change stays in one amplitude."""
FALSE_ALARM = 1e-4
"""Chance by which blocks alone look as changed, below which a change is believed."""
MOST_ORDERS = 6
"""The strongest orders, of which the change is looked for."""
LOWEST, BESIDE = 0.5, 0.25
"""The lowest order that is looked at: a slower one is the trend over the speed; and how far from a stronger one."""
BLOCKS = 24
"""Parts of the recording that tell how much a coefficient is pulled."""
_SLOW, _FAST = 5.0, 95.0
"""Percentiles between which the speeds of a recording lie."""
_EVERY = 8
_TREND = 3
_PER_ORDER = 6


@dataclass(frozen=True)
class Moved:
    """Samples in the order of time: angle [rad], value, speed of the angle [rad/s], each (n,)."""

    angle: Array
    value: Array
    speed: Array


@dataclass(frozen=True)
class ChangingOrder:
    """An order with its parabola: `powers` z_0, z_1, z_2 (3,) about the `middle` speed [rad/s]."""

    order: float
    middle: float
    slow: float
    fast: float
    powers: ComplexArray

    def amplitude(self, speed: Array) -> Array:
        """At speeds (n,) [rad/s]."""
        return np.asarray(np.abs(self._wave(speed)), dtype=np.float64)

    def beyond(self, angle: Array, speed: Array) -> Array:
        """What the channel has at these samples (n,) beyond the amplitude at the middle speed."""
        change = self._wave(np.clip(np.abs(speed), self.slow, self.fast)) - self.powers[0]
        return np.asarray(np.real(change * np.exp(1j * self.order * angle)), dtype=np.float64)

    def _wave(self, speed: Array) -> ComplexArray:
        x = (speed - self.middle) / self.middle
        return np.asarray(self.powers @ np.stack([np.ones_like(x), x, x**2]), dtype=np.complex128)


def changing_orders(
    samples: Callable[[], Iterable[Moved]], orders: Sequence[float]
) -> tuple[ChangingOrder, ...]:
    """Of one direction, strongest first, the orders whose amplitude changes with speed; none where that is steady."""
    found_range = speed_range(samples())
    looked = _strongest(orders)
    if found_range is None or not looked:
        return ()
    slow, fast, rows = found_range
    middle = 0.5 * (slow + fast)
    sums = list(_block_sums(samples(), looked, middle, rows))
    squares, cross = sum(s for s, _ in sums), sum(c for _, c in sums)
    assert not isinstance(squares, int)
    if len(sums) < 2 or np.linalg.cond(squares) > 1e12:
        return ()
    found: Array = np.asarray(np.linalg.solve(squares, cross), dtype=np.float64)
    pulls = np.stack([c - s @ found for s, c in sums])
    inverse = np.linalg.inv(squares)
    covariance: Array = inverse @ (pulls.T @ pulls) @ inverse * len(sums) / (len(sums) - 1.0)
    changing: list[ChangingOrder] = []
    for k, order in enumerate(looked):
        own = slice(_TREND + _PER_ORDER * k, _TREND + _PER_ORDER * (k + 1))
        cosine, sine = found[own][::2], found[own][1::2]
        one = ChangingOrder(order, middle, slow, fast, np.asarray(cosine - 1j * sine))
        if _is_changed(one, found[own][2:], covariance[own, own][2:, 2:], len(sums)):
            changing.append(one)
    return tuple(changing)


def speed_range(samples: Iterable[Moved]) -> tuple[float, float, int] | None:
    """The speeds between which samples lie [rad/s], and how many these are; None where it is steady."""
    speeds = np.concatenate([np.zeros(0), *(np.abs(one.speed[::_EVERY]) for one in samples)])
    if not len(speeds):
        return None
    slow, fast = (float(np.percentile(speeds, share)) for share in (_SLOW, _FAST))
    is_told = slow + fast > 0.0 and fast - slow >= 0.5 * LEAST_RANGE * (slow + fast)
    return (slow, fast, len(speeds) * _EVERY) if is_told else None


def _strongest(orders: Sequence[float]) -> list[float]:
    """The strongest orders without what stands beside a stronger one: sidelobes would explain the change themselves."""
    kept: list[float] = []
    for order in orders:
        if order >= LOWEST and all(abs(order - other) > BESIDE for other in kept):
            kept.append(order)
    return kept[:MOST_ORDERS]


def _block_sums(
    samples: Iterable[Moved], orders: Sequence[float], middle: float, expected: int
) -> Iterator[tuple[Array, Array]]:
    """Normal equations (p, p) and (p,) of each block."""
    size = max(1, expected // BLOCKS)
    for one in samples:
        for first in range(0, len(one.angle), size):
            rows = slice(first, first + size)
            columns = _columns(one.angle[rows], one.speed[rows], orders, middle)
            yield columns.T @ columns, columns.T @ one.value[rows]


def _columns(angle: Array, speed: Array, orders: Sequence[float], middle: float) -> Array:
    """Trend over the speed; then cosine and sine of each order: times 1, x and x^2."""
    x = (np.abs(speed) - middle) / middle
    powers = (np.ones_like(x), x, x**2)
    waves = [
        part * power
        for order in orders
        for power in powers
        for part in (np.cos(order * angle), np.sin(order * angle))
    ]
    return np.stack([*powers, *waves], axis=1)


def _is_changed(one: ChangingOrder, change: Array, covariance: Array, blocks: int) -> bool:
    """Whether its amplitude changes by enough, and by more than blocks differ."""
    amplitudes = one.amplitude(np.linspace(one.slow, one.fast, 33))
    if np.ptp(amplitudes) < LEAST_CHANGE * float(amplitudes[16]):
        return False
    distance = float(change @ np.linalg.solve(covariance, change)) / len(change)
    freedom = max(blocks - len(change), 1)
    return (
        math.isfinite(distance)
        and float(scipy.special.fdtrc(len(change), freedom, distance)) < FALSE_ALARM
    )
