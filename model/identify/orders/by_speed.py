"""Orders whose amplitude changes with speed: each wave's cosine and sine are parabolas over the speed.

    y = trend + sum over v of Re[z_v(w) e^{i v theta}],   z_v(w) = z_0 + z_1 x + z_2 x^2,   x = (|w| - w_m)/w_m

A line whose amplitude changes while the angle runs has sidelobes beside it: lines that no mesh and no bearing makes.
With what lies beyond the amplitude at the middle speed w_m taken off, one line is left. Doubt is by blocks of the
recording, each with what it pulls (a sandwich), so that what moves slowly counts as what it is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import ComplexArray, IntArray
from model.identify.checks import Array
from model.identify.least_squares import closest, inverse_of, solution_of
from model.units import REVOLUTION

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
BLOCKS, LEAST_BLOCKS = 24, 8
"""Parts of the recording that tell how much a coefficient is pulled, and what it predicts of what it has not seen."""
UNSEEN_PARTS = 4
"""Parts of the way, each of which the others must predict better with the change than without it."""
PERIODS = 2.0
"""Of the order, that a part must hold to tell its amplitude."""
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


@dataclass(frozen=True)
class SpeedTrend:
    """What a channel has over the speed besides waves (viscous friction): `powers` of x and x^2 (2,) about the middle.

    Over an angle that is turned at a changing speed it would be lines of orders far below one.
    """

    middle: float
    slow: float
    fast: float
    powers: Array

    def value(self, speed: Array) -> Array:
        """At speeds (n,) [rad/s], beside that at the middle speed."""
        x = (np.clip(np.abs(speed), self.slow, self.fast) - self.middle) / self.middle
        return np.asarray(self.powers[0] * x + self.powers[1] * x**2, dtype=np.float64)


def speed_trend(samples: Callable[[], Iterable[Moved]]) -> SpeedTrend | None:
    """The trend of one direction over the speed; None where that is steady, or where it predicts nothing unseen."""
    found_range = speed_range(samples())
    if found_range is None:
        return None
    slow, fast, rows = found_range
    blocks = list(_blocks(samples(), (), (slow, fast), rows))
    if len(blocks) < LEAST_BLOCKS or np.linalg.cond(_total(blocks)[0]) > 1e12:
        return None
    if not _is_predicted(blocks, np.arange(_TREND), np.arange(1)):
        return None
    found, _ = _fitted(blocks)
    return SpeedTrend(0.5 * (slow + fast), slow, fast, found[1:_TREND])


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
    blocks = list(_blocks(samples(), looked, (slow, fast), rows))
    if len(blocks) < LEAST_BLOCKS or np.linalg.cond(_total(blocks)[0]) > 1e12:
        return ()
    found, covariance = _fitted(blocks)
    turned = float(np.median([one.turned for one in blocks]))
    changing: list[ChangingOrder] = []
    for k, order in enumerate(looked):
        own = np.arange(_TREND + _PER_ORDER * k, _TREND + _PER_ORDER * (k + 1))
        powers = np.asarray(found[own[::2]] - 1j * found[own[1::2]])
        one, change = ChangingOrder(order, middle, slow, fast, powers), own[2:]
        if turned * order >= PERIODS * REVOLUTION and _is_changed(
            one, found[change], covariance[np.ix_(change, change)], len(blocks)
        ):
            without = np.setdiff1d(np.arange(len(found)), change)
            if _is_predicted(blocks, np.arange(len(found)), without):
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


@dataclass(frozen=True)
class _Block:
    """Normal equations of some samples: squares (p, p), cross (p,), square of the values; and the angle they turn."""

    squares: Array
    cross: Array
    power: float
    turned: float


def _blocks(
    samples: Iterable[Moved], orders: Sequence[float], reach: tuple[float, float], rows: int
) -> Iterator[_Block]:
    """The samples in blocks; a speed beyond the reach, which a jump of angle or time makes, counts as its end."""
    size, middle = max(1, rows // BLOCKS), 0.5 * sum(reach)
    for one in samples:
        speed = np.clip(np.abs(one.speed), *reach)
        for first in range(0, len(one.angle), size):
            part = slice(first, first + size)
            columns = _columns(one.angle[part], speed[part], orders, middle)
            value = one.value[part]
            turned = abs(float(one.angle[part][-1] - one.angle[part][0]))
            yield _Block(columns.T @ columns, columns.T @ value, float(value @ value), turned)


def _total(blocks: Sequence[_Block]) -> tuple[Array, Array]:
    """Normal equations of all blocks: (p, p) and (p,)."""
    squares = np.stack([one.squares for one in blocks]).sum(axis=0)
    cross = np.stack([one.cross for one in blocks]).sum(axis=0)
    return np.asarray(squares, dtype=np.float64), np.asarray(cross, dtype=np.float64)


def _fitted(blocks: Sequence[_Block]) -> tuple[Array, Array]:
    """The coefficients (p,), and their covariance (p, p) by what each block pulls."""
    squares, cross = _total(blocks)
    found = solution_of(squares, cross)
    pulls: Array = np.stack([one.cross - one.squares @ found for one in blocks])
    inverse = inverse_of(squares)
    covariance: Array = inverse @ (pulls.T @ pulls) @ inverse * len(blocks) / (len(blocks) - 1.0)
    return found, covariance


def _is_predicted(blocks: Sequence[_Block], columns: IntArray, without: IntArray) -> bool:
    """Whether every part of the way is predicted better by the others with all of the columns than with some."""
    return bool(np.all(_unseen_errors(blocks, columns) < _unseen_errors(blocks, without)))


def _unseen_errors(blocks: Sequence[_Block], columns: IntArray) -> Array:
    """Sum of squares that a fit of some columns leaves of each part of the way when it is fitted to all others.

    Parts are long: what wanders with time or place is alike in neighbouring blocks, and would predict itself.
    """
    square = np.ix_(columns, columns)
    whole, right = _total(blocks)
    squares, cross = whole[square], right[columns]
    left: list[float] = []
    ends = [len(blocks) * k // UNSEEN_PARTS for k in range(UNSEEN_PARTS + 1)]
    for begin, end in itertools.pairwise(ends):
        part = blocks[begin:end]
        own, power = _total(part), math.fsum(block.power for block in part)
        one = _Block(*own, power, 0.0)
        others, rest = squares - one.squares[square], cross - one.cross[columns]
        found = closest(others, rest)
        cross_left = 2.0 * float(found @ one.cross[columns])
        left.append(one.power - cross_left + float(found @ one.squares[square] @ found))
    return np.array(left)


def _columns(angle: Array, speed: Array, orders: Sequence[float], middle: float) -> Array:
    """Trend over the speed; then cosine and sine of each order: times 1, x and x^2."""
    x = (speed - middle) / middle
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
