"""Bench beside bench: what the gears of each showed, how far from those of the others, and whether it drifts.

Different gears were on different benches: a difference is of gears, benches or both.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.fleet.lot_quantity import LotQuantity
from rig.fleet.lot_rows import LotRow

SECONDS_PER_DAY = 86400.0
_SECONDS_PER_MONTH = 30 * SECONDS_PER_DAY
_LEAST_DAYS = 3
"""Days below which no drift is told: that of hours says nothing of a month."""
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class BenchValues:
    """One quantity on one bench, SI: gears, mean, standard deviation; None where there are too few.

    `difference` to the mean of all other benches and `slope` per 30 days, each with the half-width of
    its 95 % interval (Welch; straight line by least squares).
    """

    bench: str
    gears: int
    mean: float
    standard_deviation: float | None
    difference: tuple[float, float] | None
    slope: tuple[float, float] | None


def by_bench(one: LotQuantity) -> tuple[BenchValues, ...]:
    """A quantity on each of the benches of a lot, in the order of their names."""
    rows_of: dict[str, list[LotRow]] = defaultdict(list)
    for row in one.measured:
        rows_of[row.bench].append(row)
    found = []
    for bench, rows in sorted(rows_of.items()):
        here = _values(rows)
        others = _values([row for row in one.measured if row.bench != bench])
        found.append(
            BenchValues(
                bench=bench,
                gears=len(rows),
                mean=float(here.mean()),
                standard_deviation=float(here.std(ddof=1)) if len(rows) > 1 else None,
                difference=_difference(here, others),
                slope=_slope(rows),
            )
        )
    return tuple(found)


def _values(rows: Sequence[LotRow]) -> np.ndarray:
    return np.array([row.value for row in rows], dtype=float)


def _difference(here: np.ndarray, others: np.ndarray) -> tuple[float, float] | None:
    """Difference of two means with the half-width of its interval, by Welch."""
    if len(here) < 2 or len(others) < 2:
        return None
    parts = [float(v.var(ddof=1)) / len(v) for v in (here, others)]
    variance = sum(parts)
    if not variance > 0.0:
        return None
    squares = sum(p**2 / (len(v) - 1) for p, v in zip(parts, (here, others), strict=True))
    return float(here.mean() - others.mean()), _factor(variance**2 / squares) * math.sqrt(variance)


def _slope(rows: Sequence[LotRow]) -> tuple[float, float] | None:
    """Slope per 30 days with the half-width of its interval; None for fewer than three days."""
    timed = [row for row in rows if row.started is not None]
    x = np.array([row.started for row in timed], dtype=float)
    if len(np.unique(x // SECONDS_PER_DAY)) < _LEAST_DAYS:
        return None
    x = (x - x.mean()) / _SECONDS_PER_MONTH
    y = _values(timed)
    spread = float(x @ x)
    slope = float(x @ (y - y.mean())) / spread
    rest = y - y.mean() - slope * x
    freedom = len(y) - 2
    return slope, _factor(freedom) * math.sqrt(float(rest @ rest) / freedom / spread)


def _factor(freedom: float) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1.0 + CONFIDENCE) / 2.0))
