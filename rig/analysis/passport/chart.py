"""Individuals and moving-range chart of one quantity over runs, and the rules by which it speaks.

    MR_i = |x_i - x_(i-1)|,   sigma = mean(MR)/1.128,   limits = mean +- 3 sigma,   upper limit of MR = 3.267 mean(MR)

from the first runs. Sources: ISO 7870-2:2013 (individuals chart); Western Electric, Statistical
Quality Control Handbook (1956), zone tests; Montgomery, Introduction to Statistical Quality
Control, chapter 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from rig.analysis.passport.content import ControlLimits

BASELINE_RUNS = 10
"""Runs that make the limits; with fewer there are none yet."""
_D2 = 1.128
"""Mean range of two draws of a normal distribution over its standard deviation."""
_D4 = 3.267
"""Upper limit of the moving range over its mean (three sigma of the range of two)."""
_RANGE_VARIANCE = 2.0 - 4.0 / math.pi
_NEIGHBOUR_COVARIANCE = 4.0 / math.pi * (math.sqrt(0.75) + math.pi / 12.0 - 1.0)
"""Of moving ranges of two in units of sigma^2: of one, and of one with the next, with which it has a run in common."""

RULES: Mapping[str, str] = {
    "1": "beyond a control limit (Western Electric rule 1)",
    "2": "two of three runs beyond two sigma on the same side (rule 2)",
    "3": "four of five runs beyond one sigma on the same side (rule 3)",
    "4": "eight runs in a row on the same side of the centre line (rule 4)",
    "MR": "a step from the run before beyond the upper limit of the moving range",
}
"""What a signal means."""

Array = NDArray[np.float64]


def control_limits(
    values: Sequence[float], runs: Sequence[str], baseline: int = BASELINE_RUNS
) -> ControlLimits | None:
    """The limits from the first `baseline` values; None where there are fewer, or where they do not scatter at all."""
    x = np.asarray(values[:baseline], dtype=np.float64)
    if len(x) < max(baseline, 2) or not np.isfinite(x).all():
        return None
    mean_range = float(np.abs(np.diff(x)).mean())
    if mean_range <= 1e-12 * float(np.abs(x).max()):
        return None
    centre, sigma = float(x.mean()), mean_range / _D2
    return ControlLimits(
        centre=centre,
        sigma=sigma,
        lower=centre - 3.0 * sigma,
        upper=centre + 3.0 * sigma,
        moving_range=mean_range,
        moving_range_upper=_D4 * mean_range,
        runs=tuple(runs[: len(x)]),
        false_alarms=false_alarm_share(len(x)),
    )


def false_alarm_share(baseline: int) -> float:
    """Share of later runs of an unchanged gear beyond limits made from `baseline` runs.

    A later value lies (1 + 1/m) sigma^2 around the baseline's mean, and sigma is itself an estimate without bias whose
    relative variance r follows from the ranges: a t distribution with about 1/(2 r) + 1/4 degrees of freedom.
    """
    ranges = baseline - 1
    variance = (ranges * _RANGE_VARIANCE + 2.0 * (ranges - 1) * _NEIGHBOUR_COVARIANCE) / ranges**2
    relative = variance / (4.0 / math.pi)
    unbiased = math.sqrt(1.0 + relative)
    return float(
        2.0 * stdtr(0.5 / relative + 0.25, -3.0 * unbiased / math.sqrt(1.0 + 1.0 / baseline))
    )


def signals_of(values: Sequence[float], limits: ControlLimits) -> tuple[tuple[str, ...], ...]:
    """The rules that each value breaks, in the order of `RULES`; a pattern is told at the run that completes it."""
    x = np.asarray(values, dtype=np.float64)
    signals: list[list[str]] = [[] for _ in x]
    if not len(x):
        return ()
    z = (x - limits.centre) / limits.sigma
    for rule, broken in _TESTS.items():
        for at in np.flatnonzero(broken(z)):
            signals[int(at)].append(rule)
    for at in np.flatnonzero(np.abs(np.diff(x)) > limits.moving_range_upper):
        signals[int(at) + 1].append("MR")
    return tuple(tuple(rules) for rules in signals)


def _zone(needed: int, of: int, beyond: float) -> Callable[[Array], NDArray[np.bool_]]:
    """The test that `needed` of the latest `of` values, this one among them, lie beyond so many sigma on one side."""

    def broken(z: Array) -> NDArray[np.bool_]:
        speaks = np.zeros(len(z), dtype=bool)
        for side in (1.0, -1.0):
            out = side * z > beyond
            count = np.convolve(out, np.ones(of, dtype=np.int64))[: len(z)]
            speaks |= out & (count >= needed)
        return speaks

    return broken


_TESTS: Mapping[str, Callable[[Array], NDArray[np.bool_]]] = {
    "1": _zone(1, 1, 3.0), "2": _zone(2, 3, 2.0), "3": _zone(4, 5, 1.0), "4": _zone(8, 8, 0.0),
}  # fmt: skip
