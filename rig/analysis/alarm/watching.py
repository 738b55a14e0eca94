"""A series of runs watched: scores, sums, whether it has changed, since when and by how much; and what hours do to it.

Size and slope of a change are coefficients of one more regressor, a step or a ramp from the run since which it is
told, beside those of `rig.analysis.alarm.noted`, over all runs:

    x = Z b + size [i >= since] + e ,      x = Z b + slope max(0, i - since + 1) + e

with intervals as wide as the days that the threshold assumes make them (`rig.analysis.alarm.lines`); `since` is the
run, not later than the one at which the change is told, for which the step leaves the least scatter. It was chosen
because it shows a change: of one that is small the size comes out too large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.analysis.alarm.lines import line
from rig.analysis.alarm.noted import Noted, NotedRun, noted
from rig.analysis.alarm.promise import Promise
from rig.analysis.alarm.scores import scores_of
from rig.analysis.alarm.sums import Sums, crossing_of, sums_of
from rig.analysis.alarm.threshold import CORRELATION, CORRELATIONS, Days, threshold_of

Array = NDArray[np.float64]

BOUNDING_RUNS = 50
"""Scores from which on a correlation of neighbouring runs can be told from that of days that are alike."""
_ONE_SIDED = 1.6449
"""Standard normal quantile of 95 % on one side."""


@dataclass(frozen=True)
class Coefficient:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Change:
    """How much has changed since a run (counted from 0): as a step and per run; `scatter` is that of one run."""

    run: int
    since: int
    size: Coefficient
    per_run: Coefficient
    scatter: float

    @property
    def direction(self) -> Literal["larger", "smaller"]:
        """Whether the quantity has become larger or smaller."""
        return "larger" if self.size.value > 0.0 else "smaller"


@dataclass(frozen=True, kw_only=True)
class WatchedSeries:
    """What the runs of one series say: `expected` by the runs before, normal `scores`, `sums`, the `change` if any."""

    noted: Noted
    scores: Array
    expected: Array
    sums: Sums
    threshold: float
    days: Days
    change: Change | None


def scored(values: Sequence[float], runs: Sequence[NotedRun], baseline: int) -> Array:
    """The scores of a series."""
    return _scores(np.asarray(values, dtype=np.float64), noted(runs, baseline))[0]


def watch(
    values: Sequence[float],
    runs: Sequence[NotedRun],
    promise: Promise,
    quantities: int,
    days: Days,
) -> WatchedSeries:
    """Watch a series, one of so many quantities of its gear that are watched together."""
    x = np.asarray(values, dtype=np.float64)
    told = noted(runs, promise.baseline)
    scores, expected = _scores(x, told)
    sums = sums_of(scores[None, :], promise.baseline, tuple(told.begins))
    threshold = threshold_of(promise, quantities, days)
    crossing = crossing_of(sums, threshold, promise.baseline, tuple(told.begins))
    return WatchedSeries(
        noted=told,
        scores=scores,
        expected=expected,
        sums=sums,
        threshold=threshold,
        days=days,
        change=None if crossing is None else _change(x, told, crossing, correlation_of(days)),
    )


def days_of(series: Sequence[Array]) -> Days:
    """Whether the scores of some series show that their days are independent: every one has enough runs, and its
    correlation of neighbours lies below that of days that are alike, with 95 % confidence.
    """
    bounds = [bound for bound in map(correlation_bound, series) if bound is not None]
    is_bounded = bool(bounds) and len(bounds) == len(series) and max(bounds) < CORRELATION
    return "independent" if is_bounded else "alike"


def correlation_bound(scores: Array) -> float | None:
    """The upper 95 % limit of the correlation of neighbouring runs; None for too few of them."""
    told = scores[np.isfinite(scores)]
    if len(told) < BOUNDING_RUNS:
        return None
    about = told - told.mean()
    correlation = float(about[1:] @ about[:-1] / (about @ about))
    return correlation + _ONE_SIDED * math.sqrt((1.0 - correlation**2) / len(told))


def _scores(values: Array, told: Noted) -> tuple[Array, Array]:
    """Scores and expectations; a run without its warmth is left out of both."""
    usable = np.isfinite(told.regressors).all(axis=1)
    normal, expected = np.full(len(values), np.nan), np.full(len(values), np.nan)
    if usable.any():
        found = scores_of(values[None, usable], told.regressors[None, usable])
        normal[usable], expected[usable] = found.normal[0], found.expected[0]
    return normal, expected


def correlation_of(days: Days) -> float:
    """What days are taken to be correlated by."""
    return CORRELATIONS[days]


def _change(values: Array, told: Noted, run: int, correlation: float) -> Change:
    places = np.arange(len(values))
    first = told.regressors.shape[1] + 1
    steps = {since: (places >= since).astype(float) for since in range(min(first, run), run + 1)}
    found = {
        since: coefficient(values, told.regressors, step, correlation)
        for since, step in steps.items()
    }
    since = min(found, key=lambda one: (found[one].scatter, -one))
    after = np.where(places >= since, places - since + 1.0, 0.0)
    return Change(
        run=run,
        since=since,
        size=found[since].coefficient,
        per_run=coefficient(values, told.regressors, after, correlation).coefficient,
        scatter=found[since].scatter,
    )


@dataclass(frozen=True)
class Fitted:
    """The coefficient of one more regressor, and the scatter of one run about the whole."""

    coefficient: Coefficient
    scatter: float


def coefficient(values: Array, regressors: Array, more: Array, correlation: float) -> Fitted:
    """One more regressor beside those of a series, by least squares over all runs."""
    usable = np.isfinite(regressors).all(axis=1) & np.isfinite(more)
    found = line(values[usable], np.column_stack([regressors[usable], more[usable]]), correlation)
    value = float(found.coefficients[-1])
    if not found.freedom:
        return Fitted(Coefficient(value, -math.inf, math.inf), math.inf)
    reach = found.quantile * math.sqrt(float(found.covariance[-1, -1]))
    return Fitted(Coefficient(value, value - reach, value + reach), found.scatter)
