"""Which study gives a wished interval of %GRR: gears, benches, mountings and repeats, the fewest runs first.

The interval of a design is that of a study whose mean squares are their expectations under the expected variances:
half of all studies come out wider.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rig.fleet.gauge.anova import expected_rows, gauge_of_rows
from rig.fleet.gauge.components import Interval, Term

_DRAWS = 4000
GEARS, MOUNTINGS, REPEATS = (5, 6, 8, 10, 12, 15, 20), (1, 2, 3), (1, 2, 3)
ASSUMED_SHARES: Mapping[Term, float] = {
    "bench": 0.4,
    "interaction": 0.1,
    "mounting": 0.3,
    "repeat": 0.2,
}
"""Of GRR^2, where no study says it: most of what benches differ by is their encoder, then the mounting."""


@dataclass(frozen=True, kw_only=True)
class Design:
    """A study that could be made, and the interval of %GRR to be expected of it."""

    gears: int
    benches: int
    mountings: int
    repeats: int
    interval: Interval

    @property
    def runs(self) -> int:
        """Runs that it takes."""
        return self.gears * self.benches * self.mountings * self.repeats

    @property
    def half_width(self) -> float:
        """Half the width of the interval, in percent points."""
        return 0.5 * (self.interval[1] - self.interval[0])


def variances_of(percent: float) -> dict[Term, float]:
    """The variances of a gauge with this %GRR of study, the whole being 1, shared out as assumed."""
    grr = (percent / 100.0) ** 2
    shares: dict[Term, float] = {term: grr * share for term, share in ASSUMED_SHARES.items()}
    return {"gear": 1.0 - grr, **shares}


def designs(variances: Mapping[Term, float], benches: int) -> list[Design]:
    """Every design with at most so many benches, the fewest runs first."""
    return sorted(_designs(variances, benches), key=lambda one: (one.runs, one.half_width))


def _designs(variances: Mapping[Term, float], most: int) -> Iterator[Design]:
    for shape in itertools.product(GEARS, range(2, most + 1), MOUNTINGS, REPEATS):
        if shape[2] * shape[3] == 1:
            continue
        gauge = gauge_of_rows(expected_rows(variances, shape), shape, draws=_DRAWS)
        low, high = gauge.interval_of_percent
        yield Design(
            gears=shape[0],
            benches=shape[1],
            mountings=shape[2],
            repeats=shape[3],
            interval=(low, high),
        )


def proposals(all_designs: list[Design], half_width: float) -> list[Design]:
    """The design with the fewest runs for each number of benches that keeps the wished half-width."""
    best: dict[int, Design] = {}
    for one in all_designs:
        if one.half_width <= half_width and one.benches not in best:
            best[one.benches] = one
    return list(best.values())


def narrowest(all_designs: list[Design]) -> Design:
    """The design with the narrowest interval."""
    return min(all_designs, key=lambda one: (one.half_width, one.runs))


def factor_of_few(benches: int) -> Interval:
    """Between which multiples of its estimate the spread of so many benches lies, 95 %."""
    from scipy.special import chdtri

    freedom = benches - 1
    low, high = (np.sqrt(freedom / chdtri(freedom, tail)) for tail in (0.025, 0.975))
    return float(low), float(high)
