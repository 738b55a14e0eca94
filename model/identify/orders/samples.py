"""Samples of a channel over an angle, one-way stretch by stretch: held in memory where they fit, else read again.

Neighbouring samples within a narrow cell of angle are averaged; the variance of their angles is kept,
so that the mean of a wave over them is known: e^{i v theta} e^{-v^2 s^2 / 2}.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.orders.aliases import SamplingSums, SamplingWindow
from model.units import REVOLUTION

CELLS_PER_PERIOD = 16
"""Cells per period of the highest order: averaging takes 0.6 % there, which is corrected to 1e-5."""
HELD = 1 << 20
"""Groups of samples that are held in memory; of more, evenly spread pieces are."""
CHUNK = 1 << 16
"""Samples that are read at a time."""
WHOLE_TURN = 0.98
"""Revolutions from which a stretch is taken for a whole one."""
BENT, LONG = 7, 6.0
"""Degree of the trend where it bends (inertia, gravity, viscous friction), and revolutions from which one may."""
STEADY = 0.3
"""Share by which the speed may differ within a stretch that is called steady."""


@dataclass(frozen=True)
class Piece:
    """Contiguous samples of one stretch: angle [rad] and value (n,), samples in each (n,), variance of their angles."""

    stretch: int
    direction: int
    angle: Array
    value: Array
    count: Array
    spread: Array
    within: float = 0.0
    """Sum of squares of single samples about the means that stand for them."""

    @classmethod
    def of(
        cls, stretch: int, direction: int, angle: Array, value: Array, quantum: float = 0.0
    ) -> Piece:
        """Single samples of an angle whose count is `quantum` [rad]: it lies anywhere within one."""
        spread = np.full(len(angle), quantum**2 / 12.0)
        return cls(stretch, direction, angle, value, np.ones(len(angle)), spread)

    def grouped(self, cells: float) -> Piece:
        """Successive samples in one cell of angle, `cells` to a revolution, as one; itself where that saves nothing."""
        cell = np.floor(self.angle * (cells / REVOLUTION)).astype(np.int64)
        starts = np.flatnonzero(np.diff(cell, prepend=cell[0] - 1))
        if len(starts) > 0.7 * len(cell):
            return self
        count = np.add.reduceat(self.count, starts)
        base = self.angle[starts]
        beyond = self.angle - np.repeat(base, np.diff(np.append(starts, len(cell))))
        offset = np.add.reduceat(beyond, starts) / count
        square = np.add.reduceat(beyond**2, starts) / count
        mean = np.add.reduceat(self.value, starts) / count
        scatter = self.value - np.repeat(mean, np.diff(np.append(starts, len(cell))))
        return Piece(
            self.stretch,
            self.direction,
            base + offset,
            mean,
            count,
            np.maximum(square - offset**2, 0.0) + self.spread[starts],
            within=float(scatter @ scatter),
        )


Source = Callable[[], Iterator[Piece]]
"""Pieces of single samples in the order they were recorded; may be asked for again."""


@dataclass(frozen=True)
class Stretch:
    """What one stretch covers: its direction, lowest and highest angle [rad], samples; whether its speed was steady.

    `has_line`: whether its trend may have a slope; an angle of which the exact share of another was taken has none.
    """

    direction: int
    low: float
    high: float
    samples: int
    is_steady: bool
    has_line: bool = True

    @property
    def revolutions(self) -> float:
        """Revolutions covered."""
        return (self.high - self.low) / REVOLUTION

    @property
    def degree(self) -> int:
        """Of the polynomial over angle that its trend is: a line; what is unsteady, or no revolution, bends more."""
        if self.revolutions < WHOLE_TURN:
            return BENT
        if not self.has_line:
            return 0
        # What bends over a turn or two would be order 1 itself.
        return 1 if self.is_steady or self.revolutions < LONG else BENT


@dataclass(frozen=True, kw_only=True)
class OrderSamples:
    """A channel over an angle: what is held of it, and what its sampling can carry.

    `mean` is that of the channel, `cells` those of a revolution in which samples are averaged, `densest` the
    samples per revolution where it turns slowly, `quantum` a count of the angle [rad].
    """

    source: Source
    held: tuple[Piece, ...]
    is_whole: bool
    stretches: tuple[Stretch, ...]
    samples: int
    mean: float
    window: SamplingWindow
    densest: float
    cells: float
    quantum: float

    @classmethod
    def gathered(cls, source: Source, highest: float, *, has_line: bool = True) -> OrderSamples:
        """One pass over the source; a second one for its middle, where not all of it can be held."""
        cells = CELLS_PER_PERIOD * highest
        held: list[Piece] = []
        size = 0
        covered: dict[int, _Covered] = {}
        sampling = SamplingSums()
        total = quantum = 0.0
        for piece in source():
            steps = sampling.take(piece.angle)
            covered.setdefault(piece.stretch, _Covered(piece.direction)).take(piece, steps)
            total += float(piece.value.sum())
            quantum = math.sqrt(12.0 * float(piece.spread[0]))
            if size <= HELD:
                held.append(piece.grouped(cells))
            # What is not held counts as it would if it were.
            size += len(held[-1].angle)
        if not covered:
            raise IdentificationError(
                "never turns one way for long enough", where="angle", value="no stretch"
            )
        samples = sum(one.samples for one in covered.values())
        is_whole = size <= HELD
        return cls(
            source=source,
            held=tuple(held) if is_whole else _middle(source, sampling.parts, cells),
            is_whole=is_whole,
            stretches=tuple(covered[k].stretch(has_line=has_line) for k in sorted(covered)),
            samples=samples,
            mean=total / samples,
            window=sampling.window(),
            densest=sampling.window(95.0).per_revolution,
            cells=cells,
            quantum=quantum,
        )

    @property
    def held_samples(self) -> int:
        """Samples that what is held stands for."""
        return int(sum(piece.count.sum() for piece in self.held))

    @property
    def directions(self) -> tuple[int, ...]:
        """The directions that were turned in, forward first."""
        return tuple(d for d in (1, -1) if any(s.direction == d for s in self.stretches))

    def reach(self, direction: int) -> tuple[float, float]:
        """Lowest and highest angle of a direction [rad]."""
        own = [s for s in self.stretches if s.direction == direction]
        return min(s.low for s in own), max(s.high for s in own)

    def revolutions(self, direction: int) -> float:
        """Revolutions between lowest and highest angle of a direction."""
        low, high = self.reach(direction)
        return (high - low) / REVOLUTION

    @property
    def is_steady(self) -> bool:
        """Whether every stretch turned steadily."""
        return all(s.is_steady for s in self.stretches)

    def every(self) -> Iterator[Piece]:
        """All of it, held or read again."""
        if self.is_whole:
            yield from self.held
            return
        for piece in self.source():
            yield piece.grouped(self.cells)

    def within(self, direction: int, span: float) -> Source:
        """The pieces of a direction within half of `span` revolutions about the middle of what is held."""
        low, high = self.held_reach(direction)
        half, middle = 0.5 * span * REVOLUTION, 0.5 * (low + high)
        is_held = self.is_whole or span * REVOLUTION <= high - low

        def pieces() -> Iterator[Piece]:
            for piece in self.held if is_held else self.every():
                centre = float(piece.angle[len(piece.angle) // 2])
                if piece.direction == direction and abs(centre - middle) <= half:
                    yield piece

        return pieces

    @cached_property
    def held_directions(self) -> tuple[int, ...]:
        """The directions of what is held, forward first."""
        return tuple(d for d in (1, -1) if any(piece.direction == d for piece in self.held))

    def held_reach(self, direction: int) -> tuple[float, float]:
        """Lowest and highest angle of what is held of a direction [rad]."""
        return self._held_reaches[direction]

    @cached_property
    def _held_reaches(self) -> dict[int, tuple[float, float]]:
        reaches: dict[int, tuple[float, float]] = {}
        for d in self.held_directions:
            own = [piece.angle for piece in self.held if piece.direction == d]
            reaches[d] = min(float(a.min()) for a in own), max(float(a.max()) for a in own)
        return reaches

    def held_middle(self, direction: int) -> float:
        """Middle of the way of a direction that is held [rad]."""
        return 0.5 * sum(self.held_reach(direction))

    @property
    def held_revolutions(self) -> float:
        """Revolutions that what is held spans, in the direction in which it spans more."""
        return max((high - low) / REVOLUTION for low, high in self._held_reaches.values())


def _middle(source: Source, number: int, cells: float) -> tuple[Piece, ...]:
    """What fits into memory of the middle of a source of so many pieces."""
    held: list[Piece] = []
    size, room = 0, HELD
    before = max(0, number // 2 - HELD // (2 * CHUNK))
    for piece in itertools.islice(source(), before, None):
        held.append(piece.grouped(cells))
        size += len(held[-1].angle)
        if size > room:
            break
    return tuple(held)


class _Covered:
    """What the pieces of one stretch come to."""

    def __init__(self, direction: int) -> None:
        self._direction = direction
        self._low, self._high = math.inf, -math.inf
        self._slowest, self._fastest = math.inf, 0.0
        self.samples = 0

    def take(self, piece: Piece, steps: Array) -> None:
        self._low = min(self._low, float(piece.angle.min()))
        self._high = max(self._high, float(piece.angle.max()))
        speed = np.abs(steps)
        self._slowest = min(self._slowest, float(np.percentile(speed, 5.0)))
        self._fastest = max(self._fastest, float(np.percentile(speed, 95.0)))
        self.samples += len(piece.angle)

    def stretch(self, *, has_line: bool) -> Stretch:
        is_steady = self._slowest >= (1.0 - STEADY) * self._fastest
        reach = self._low, self._high
        return Stretch(self._direction, *reach, self.samples, is_steady, has_line)
