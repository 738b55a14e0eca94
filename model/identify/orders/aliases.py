"""Which orders the samples cannot tell apart: what sampling makes of an angle.

At S samples per revolution an order m stands in the samples as |k S - m| as well. With the angle of
each sample known the two part as the speed changes; how far, tells the canonical correlation of
their waves at the samples, |mean e^{i (m ± v) theta}|.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.identify.checks import Array
from model.units import REVOLUTION

HIGHEST_SHARE = 0.4
"""Of the samples per revolution: no order above it is identified."""
_HIGHEST_ALIAS = 400
"""Orders up to which a gear, a motor or a joint has ripple of its own: teeth, slots, and their harmonics."""
ONE_AND_THE_SAME = 0.95
"""Correlation of two orders over the samples above which they are given as a pair."""
_IMAGE = 0.3
"""The same for one that is no whole order: a speed that drifts smears the image of another."""
NEAR_FOLD, MOST_STEPS = 0.02, 400
"""Share of the samples per revolution by which their median may be off, and steps that are looked at to each side."""
DRAWN = 2048
"""Samples of a part that stand for all of it."""
_STEP_ROWS = 8
"""Rows to each side over which the step from sample to sample is averaged."""
_CREEPS = 0.1
"""Of the mean step, below which a sample hardly moves."""
WHOLE = 1e-3
"""Orders apart up to which one counts as whole."""


class SamplingSums:
    """What the angles of many samples come to, part by part: some that stand for all, and the steps between them."""

    def __init__(self) -> None:
        self._parts: list[tuple[Array, Array, Array]] = []

    def take(self, angle: Array) -> Array:
        """A contiguous part (n,) [rad]; returns the mean step from sample to sample about each, (n,) [rad]."""
        n = len(angle)
        steps = _mean_steps(angle)
        some = np.linspace(0, n - 1, min(n, DRAWN)).astype(np.int64)
        # Evenly spaced rows would be a sampling of their own: each is moved within its share.
        some = np.minimum(
            some + np.random.default_rng(n).integers(0, max(n // DRAWN, 1), len(some)), n - 1
        )
        self._parts.append((angle[some], np.full(len(some), n / len(some)), np.abs(steps[some])))
        return steps

    @property
    def parts(self) -> int:
        """How many parts were taken."""
        return len(self._parts)

    def window(self, percentile: float = 50.0) -> SamplingWindow:
        """The window; samples per revolution are this percentile over the samples that turn."""
        if not self._parts:
            return SamplingWindow(np.zeros(1), np.ones(1), math.inf)
        angle = np.concatenate([part[0] for part in self._parts])
        weight = np.concatenate([part[1] for part in self._parts])
        steps = np.concatenate([part[2] for part in self._parts])
        moving = steps > _CREEPS * float(weight @ steps) / float(weight.sum())
        if not moving.any():
            return SamplingWindow(angle, weight, math.inf)
        sizes: Array = steps[moving]
        order = np.argsort(sizes)
        share = np.cumsum(weight[moving][order])
        wanted = (1.0 - 0.01 * percentile) * float(share[-1])
        at = int(np.count_nonzero(share < wanted))
        typical = float(sizes[order][min(at, len(order) - 1)])
        return SamplingWindow(angle[moving], weight[moving], REVOLUTION / typical)


def _mean_steps(angle: Array) -> Array:
    """Mean step from sample to sample about each one (n,): over some rows, so that counting does not show."""
    n = len(angle)
    if n < 2:
        return np.zeros(n)
    rows = np.arange(n)
    low, high = np.maximum(rows - _STEP_ROWS, 0), np.minimum(rows + _STEP_ROWS, n - 1)
    steps: Array = (angle[high] - angle[low]) / (high - low)
    return steps


@dataclass(frozen=True)
class SamplingWindow:
    """Angles (n,) [rad] that stand for all that turn, how many samples each, and the samples per revolution."""

    angle: Array
    weight: Array
    per_revolution: float

    @property
    def revolutions(self) -> float:
        """Turns from the least angle to the greatest; infinite where no angle is known."""
        return float(np.ptp(self.angle)) / REVOLUTION if len(self.angle) > 1 else math.inf

    def correlation(self, order: float, other: float) -> float:
        """How alike two orders are at these samples: 0 apart, 1 one and the same."""
        return max(self._together(other - order), self._together(other + order))

    def folded(self, order: float) -> float:
        """How alike an order is to itself turned back: at 1 its sine or its cosine is zero at every sample."""
        return self._together(2.0 * order)

    def alias_of(self, order: float) -> int | None:
        """The whole order that these samples cannot tell from this one; None where there is none."""
        least = ONE_AND_THE_SAME if abs(order - round(order)) < WHOLE else _IMAGE
        for other, sign in self.candidates(order):
            if self._together(other - sign * order) > least:
                return other
        return None

    def image_of(self, order: float) -> float | None:
        """The lowest order above this one, whole or not, of which it may be the image; None for none."""
        found = [
            other
            for lattice in self._lattice
            for other in (lattice - order, lattice + order)
            if order < other <= _HIGHEST_ALIAS
        ]
        return min(found, default=None)

    @cached_property
    def _lattice(self) -> list[float]:
        """Orders by which two may differ, or that they may add up to, and look the same: multiples of the samples."""
        if not math.isfinite(self.per_revolution):
            return []
        folds = range(1, math.ceil(2.0 * _HIGHEST_ALIAS / self.per_revolution) + 1)
        fine = 0.25 * REVOLUTION / max(float(np.ptp(self.angle)), REVOLUTION)
        found: list[float] = []
        for fold in folds:
            middle = fold * self.per_revolution
            steps = min(math.ceil(NEAR_FOLD * middle / fine), MOST_STEPS)
            near = middle + fine * np.arange(-steps, steps + 1)
            alike = [self._together(order) for order in near.tolist()]
            at = int(np.argmax(alike))
            if alike[at] > _IMAGE:
                found.append(float(near[at]))
        return found

    def candidates(self, order: float) -> list[tuple[int, float]]:
        """Whole orders above this one that sampling may fold onto it, and in which sense."""
        if not math.isfinite(self.per_revolution):
            return []
        folds = range(1, math.ceil(2.0 * _HIGHEST_ALIAS / self.per_revolution) + 1)
        every = [
            (round(fold * self.per_revolution + sign * order), sign)
            for fold in folds
            for sign in (-1.0, 1.0)
        ]
        return [(other, sign) for other, sign in every if order < other <= _HIGHEST_ALIAS]

    def principal(self, order: float) -> float:
        """The lowest order that looks the same at these samples: the order itself where none does."""
        if not math.isfinite(self.per_revolution):
            return order
        folds = range(1, math.ceil(2.0 * order / self.per_revolution) + 1)
        lower = sorted(abs(fold * self.per_revolution - order) for fold in folds)
        for other in lower:
            if 0.0 < other < order and self.correlation(other, order) > ONE_AND_THE_SAME:
                return other
        return order

    def _together(self, order: float) -> float:
        wave = np.exp(1j * order * self.angle)
        return abs(complex((self.weight * wave).sum())) / float(self.weight.sum())
