"""What a day draws: as it comes, or resembling the day before.

    z_1 = e_1 ,   z_d = r z_(d-1) + sqrt(1 - r^2) e_d

with e_d what day d draws by itself, as a standard normal number (a uniform one by its rank), and r the correlation
of neighbouring days. The law of a single day stays what it is, and the first day draws what it draws without.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from sim_backend.streams import stream
from sim_backend.world import World

STRONGEST = 0.4
"""Largest correlation of neighbouring days that a wide bench draws."""
_FORGOTTEN = 1e-9
"""Share of a day that no later day needs to know of."""
_NORMAL = NormalDist()


@dataclass(frozen=True)
class Days:
    """The day of a world, drawn entry by entry, each from the stream of its name."""

    world: World

    @property
    def correlation(self) -> float:
        """Of a day with the next one at this bench: as stated, else 0, of a wide bench 0 to 0.4."""
        world = self.world
        if world.day_correlation is not None:
            return world.day_correlation
        if world.population == "narrow" or world.version < 2:
            return 0.0
        return float(stream(world.bench_seed, "wide day correlation").uniform(0.0, STRONGEST))

    def within(self, entry: str, low: float, high: float) -> float:
        """A uniform number."""

        def rank(day: int) -> float:
            share = float(stream(self.world.seed_of_day(day), entry).uniform())
            return _NORMAL.inv_cdf(min(max(share, 1e-12), 1.0 - 1e-12))

        if not self._remembers:
            own = stream(self.world.seed_of_day(self.world.day), entry)
            return float(own.uniform(low, high))
        return low + (high - low) * _NORMAL.cdf(self._chained(rank))

    def normal(self, entry: str, of: Callable[[np.random.Generator], float]) -> float:
        """A standard normal number, as `of` takes it from a generator."""
        return self._chained(lambda day: of(stream(self.world.seed_of_day(day), entry)))

    @property
    def _remembers(self) -> bool:
        return self.world.day > 1 and self.correlation > 0.0

    def _chained(self, own: Callable[[int], float]) -> float:
        today, r = self.world.day, self.correlation
        if not self._remembers:
            return own(today)
        reach = math.ceil(math.log(_FORGOTTEN) / math.log(r))
        first = max(1, today - reach)
        z = own(first)
        for day in range(first + 1, today + 1):
            z = r * z + math.sqrt(1.0 - r * r) * own(day)
        return z
