"""What measured values of several gears are spread by: gear, bench, gear with bench, mounting, repeat; with intervals.

    y = mean + gear + bench + gear x bench + mounting + repeat        all but the mean random, normal, independent

The gauge is all of it but the gear:

    EV  = s_repeat        AV = sqrt(s_bench^2 + s_interaction^2)        PV = s_gear
    GRR^2 = AV^2 + s_mounting^2 + EV^2        TV^2 = GRR^2 + PV^2
    %GRR of study = 100 GRR/TV        ndc = floor(1.41 PV/GRR)
    %GRR of tolerance = 100 * 6 GRR/(upper - lower); of one side 100 * 3 GRR/|limit - mean|

AIAG, "Measurement Systems Analysis", 4th edition (2010), chapter III section B and appendix A. A mounting is a gear
taken off and refitted; the handbook knows none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Term = str
"""One of `TERMS`."""
TERMS: tuple[Term, ...] = ("gear", "bench", "interaction", "mounting", "repeat")
GAUGE = TERMS[1:]
"""The terms of the measurement: all but the gear."""
CONFIDENCE = 0.95
DISTINCT = 1.41
"""97 % of the gears in bands that do not overlap: the factor of AIAG."""
_APART = 1.96 * math.sqrt(2.0)
"""A difference of two values, in standard deviations of one, that one pair in twenty shows by chance."""
FloatArray = NDArray[np.float64]
Interval = tuple[float, float]


class GaugeError(ValueError):
    """Values that are no study of a gauge; says why."""


@dataclass(frozen=True, kw_only=True)
class Values:
    """Measured values (n,) of one quantity, SI, with the gear, bench and mounting of each (n,) by name."""

    gear: Sequence[str]
    bench: Sequence[str]
    mounting: Sequence[str]
    value: Sequence[float]

    @property
    def counted(self) -> tuple[int, int]:
        """How many gears and benches there are."""
        return len(set(self.gear)), len(set(self.bench))

    def cells(self) -> dict[tuple[str, str], dict[str, list[float]]]:
        """The values by gear and bench, and in each by mounting."""
        found: dict[tuple[str, str], dict[str, list[float]]] = {}
        for gear, bench, mounting, value in zip(
            self.gear, self.bench, self.mounting, self.value, strict=True
        ):
            found.setdefault((gear, bench), {}).setdefault(mounting, []).append(value)
        return found


@dataclass(frozen=True, kw_only=True)
class Row:
    """A line of the analysis of variance: sum of squares, degrees of freedom, F and p against the line below."""

    term: Term
    squares: float
    freedom: int
    f: float = math.nan
    p: float = math.nan

    @property
    def mean_square(self) -> float:
        """Sum of squares per degree of freedom."""
        return self.squares / self.freedom


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """The variances of the terms that the study tells apart, SI^2, and how sure they are.

    `draws` (m,) are variances as likely as the estimated ones, from which every interval is taken; `pooled` says that
    the interaction went into the term below. Where a level has one member only, its variance stands in the one above.
    """

    method: Literal["anova", "reml"]
    variances: Mapping[Term, float]
    draws: Mapping[Term, FloatArray]
    rows: tuple[Row, ...] = ()
    pooled: bool = False
    negative: tuple[Term, ...] = ()
    """Terms whose estimate came out below zero and was set to it."""

    def deviation(self, *terms: Term) -> float:
        """Standard deviation of some terms together; those that are not told apart count nothing."""
        return math.sqrt(sum(self.variances.get(term, 0.0) for term in terms))

    @property
    def percent_of_study(self) -> float:
        """GRR in percent of the whole variation; NaN where nothing varies."""
        return float(_percent(self.variances))

    @property
    def distinct(self) -> int:
        """ndc: how many groups of gears the gauge tells apart; at least 1."""
        grr = self.deviation(*GAUGE)
        return max(int(DISTINCT * self.deviation("gear") / grr), 1) if grr > 0.0 else 1

    def percent_of_tolerance(self, lower: float | None, upper: float | None, mean: float) -> float:
        """GRR in percent of a tolerance; NaN where there is none."""
        grr = self.deviation(*GAUGE)
        if lower is not None and upper is not None:
            return 100.0 * 6.0 * grr / (upper - lower)
        limit = lower if upper is None else upper
        if limit is None or limit == mean:
            return math.nan
        return 100.0 * 3.0 * grr / abs(limit - mean)

    def apart(self, *, one_bench: bool = False) -> float:
        """Two gears that differ by less, each measured once, are not told apart: on two benches, or on `one_bench`."""
        terms = [term for term in GAUGE if not (one_bench and term == "bench")]
        return _APART * self.deviation(*terms)

    def averaged(self, mountings: int, repeats: int) -> float:
        """%GRR of study for the mean of so many repeats in each of so many mountings."""
        less = {"mounting": mountings, "repeat": mountings * repeats}
        return float(_percent({t: v / less.get(t, 1) for t, v in self.variances.items()}))

    def interval_of_deviation(self, *terms: Term) -> Interval:
        """95 % interval of a standard deviation."""
        return self._interval(
            lambda draws: np.sqrt(sum((draws[t] for t in terms if t in draws), np.zeros(1)))
        )

    @property
    def interval_of_percent(self) -> Interval:
        """95 % interval of %GRR of study."""
        return self._interval(_percent)

    def _interval(self, of: Callable[[Mapping[Term, FloatArray]], FloatArray]) -> Interval:
        tail = 50.0 * (1.0 - CONFIDENCE)
        low, high = np.percentile(of(self.draws), (tail, 100.0 - tail))
        return float(low), float(high)


def _percent(variances: Mapping[Term, float] | Mapping[Term, FloatArray]) -> FloatArray:
    """100 GRR/TV of variances, one by one."""
    gauge = sum((np.asarray(variances[t]) for t in GAUGE if t in variances), np.zeros(()))
    whole = gauge + np.asarray(variances["gear"])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(100.0 * np.sqrt(gauge / whole), dtype=np.float64)
