"""Capability of a production: how its spread and its place stand to a limit, with intervals.

    C_p  = (upper - lower) / (6 s)
    C_pk = min(upper - mean, mean - lower) / (3 s)

`s` is the standard deviation of one value per gear; it holds the gears' own spread and that of their
measurement. Both assume a normal distribution, whose distance from the data is told beside them.
Intervals at 95 %: C_p by the chi-square distribution of s; C_pk by Bissell's approximation,

    C_pk +- z sqrt(1 / (9 n) + C_pk^2 / (2 (n - 1)))

A. F. Bissell, "How reliable is your capability index?", Applied Statistics 39 (1990) 331-340; S. Kotz
and N. L. Johnson, "Process Capability Indices", 1993, sections 2.2 and 2.3. Normality: Anderson and
Darling's A^2 with mean and variance estimated, R. B. D'Agostino and M. A. Stephens, "Goodness-of-Fit
Techniques", 1986, table 4.7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.content.phrase import counted

LEAST_GEARS = 10
"""Gears below which no capability is told: the interval of C_p reaches from 0.55 to 1.45 times the value of ten."""
CONFIDENCE = 0.95
_NOT_NORMAL = 1.035
"""Modified A^2 above which a normal distribution is refused at 1 %."""
Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Capability:
    """How a production stands to its limits.

    `potential` (C_p) is None where one side is free, `actual` is C_pk; both with their 95 %
    intervals. `anderson_darling` is the modified A^2 of the values.
    """

    gears: int
    mean: float
    standard_deviation: float
    potential: float | None
    potential_interval: Interval | None
    actual: float
    actual_interval: Interval
    anderson_darling: float

    @property
    def is_normal(self) -> bool:
        """Whether nothing speaks against a normal distribution at 1 %."""
        return self.anderson_darling <= _NOT_NORMAL


def capability(
    values: Sequence[float], *, lower: float | None = None, upper: float | None = None
) -> Capability | str:
    """The capability of gears (n,) with one value each, in the unit of the limits; in words why there is none."""
    n = len(values)
    if lower is None and upper is None:
        return "no limit is on it"
    if n < LEAST_GEARS:
        return f"{counted(n, 'gear', 'gears')} judged, {LEAST_GEARS} are needed"
    found = np.asarray(values, dtype=float)
    mean, deviation = float(found.mean()), float(found.std(ddof=1))
    if not deviation > 1e-12 * abs(mean):
        return "all gears show the same value: there is no spread to hold against the limit"
    sides: list[float] = []
    if upper is not None:
        sides.append(upper - mean)
    if lower is not None:
        sides.append(mean - lower)
    actual = min(sides) / (3.0 * deviation)
    both = between = None
    if lower is not None and upper is not None:
        both = (upper - lower) / (6.0 * deviation)
        between = potential_interval(both, n)
    return Capability(
        gears=n,
        mean=mean,
        standard_deviation=deviation,
        potential=both,
        potential_interval=between,
        actual=actual,
        actual_interval=actual_interval(actual, n),
        anderson_darling=_anderson_darling(found, mean, deviation),
    )


def potential_interval(potential: float, n: int) -> Interval:
    """The 95 % interval of C_p of n gears: (n - 1) s^2 / sigma^2 is distributed as chi-square."""
    from scipy.special import chdtri

    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = (
        math.sqrt(float(chdtri(n - 1, 1.0 - part)) / (n - 1)) for part in (tail, 1.0 - tail)
    )
    return potential * low, potential * high


def actual_interval(actual: float, n: int) -> Interval:
    """The 95 % interval of C_pk of n gears, by Bissell."""
    from scipy.special import ndtri

    half = float(ndtri((1.0 + CONFIDENCE) / 2.0)) * math.sqrt(
        1.0 / (9.0 * n) + actual**2 / (2.0 * (n - 1))
    )
    return actual - half, actual + half


def _anderson_darling(values: np.ndarray, mean: float, deviation: float) -> float:
    """A^2 (1 + 0.75 / n + 2.25 / n^2) of values (n,) against a normal distribution of their mean and deviation."""
    from scipy.special import log_ndtr

    n = len(values)
    z = np.sort((values - mean) / deviation)
    weights = 2.0 * np.arange(1, n + 1) - 1.0
    squared = -n - float(np.sum(weights * (log_ndtr(z) + log_ndtr(-z[::-1])))) / n
    return squared * (1.0 + 0.75 / n + 2.25 / n**2)
