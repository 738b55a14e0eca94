"""The threshold of the sums that keeps a promise of how often a gear that does not change is told to have changed.

    P(any of q quantities crosses h within n runs after the baseline | nothing changed) = a ,   F_M(h) = (1 - a)^(1/q)

F_M is the law of the largest sum of one series, found by drawing series: normal scatter, a warmth of its own at every
run, and days that are independent, or each resembles the day before (correlation r of neighbouring runs). Quantities
are taken as independent of each other: where they are not, there are fewer alarms than promised.

Without correlation the scores are exactly independent, whatever the baseline. With it they are not, and the thresholds
are higher. The usual promise is a table (`_TABLE`, made by `python -m tests.benchmarks.alarm_thresholds`); any other
one is drawn once by the same function and kept in the user's cache.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from experiments.recording import mapping_of
from rig.analysis.alarm.promise import MOST_QUANTITIES, Promise
from rig.analysis.alarm.scores import scores_of
from rig.analysis.alarm.sums import ALLOWANCE, HEAD_START, sums_of

Array = NDArray[np.float64]
Days = Literal["independent", "alike"]

CORRELATION = 0.3
"""Of neighbouring days that are alike, at most."""
CORRELATIONS: Mapping[Days, float] = {"independent": 0.0, "alike": CORRELATION}
"""What neighbouring days are taken to be correlated by."""
_SEED = 20_331
_BLOCK, _BLOCKS = 10_000, 8
_KEPT = "alarm-thresholds.json"


_TABLE: Mapping[tuple[Days, int], tuple[float, float, float]] = {
    ("independent", 10): (5.309, 5.934, 6.316),
    ("independent", 20): (5.316, 5.959, 6.336),
    ("alike", 10): (7.104, 7.987, 8.480),
    ("alike", 20): (7.293, 8.252, 8.779),
}
"""h for 5 % over 20 runs, by days and baseline, of one, two and three quantities."""


def threshold_of(promise: Promise, quantities: int, days: Days, kept: Path | None = None) -> float:
    """The threshold h of each of so many quantities; drawn where the table has none (a few seconds, once).

    `kept`: where drawn thresholds are kept; the user's cache without it.
    """
    count = min(max(quantities, 1), MOST_QUANTITIES)
    usual = (promise.false_alarms, promise.over) == (Promise.false_alarms, Promise.over)
    row = _TABLE.get((days, promise.baseline)) if usual else None
    if row is None:
        row = _kept_or_drawn(promise, days, kept or _cache())
    return row[count - 1]


def _cache() -> Path:
    import platformdirs

    return platformdirs.user_cache_path("harmonic-rig", appauthor=False) / _KEPT


@functools.cache
def _kept_or_drawn(promise: Promise, days: Days, path: Path) -> tuple[float, float, float]:
    """The thresholds of one, two and three quantities: as they were kept, or drawn now and kept."""
    name = (
        f"{promise.false_alarms:g} over {promise.over} after {promise.baseline}, {days}, "
        f"k {ALLOWANCE:g}, head start {HEAD_START:g}"
    )
    known = _read(path)
    row = known.get(name)
    if isinstance(row, list) and len(row) == MOST_QUANTITIES:
        return (float(row[0]), float(row[1]), float(row[2]))
    drawn = thresholds(promise, days)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({**known, name: drawn}, indent=1), encoding="utf-8")
    except OSError:
        # A cache that cannot be written costs the same seconds next time, and nothing else.
        pass
    return drawn


def _read(path: Path) -> Mapping[str, object]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return mapping_of(content)


def thresholds(
    promise: Promise, days: Days, *, blocks: int = _BLOCKS, seed: int = _SEED
) -> tuple[float, float, float]:
    """The thresholds of one, two and three quantities, from blocks of ten thousand drawn series each."""
    correlation = CORRELATIONS[days]
    generator = np.random.default_rng(seed)
    largest = np.concatenate(
        [largest_sums(promise, correlation, _BLOCK, generator) for _ in range(blocks)]
    )
    levels = [(1.0 - promise.false_alarms) ** (1.0 / count) for count in (1, 2, 3)]
    one, two, three = np.quantile(largest, levels)
    return round(float(one), 3), round(float(two), 3), round(float(three), 3)


def largest_sums(
    promise: Promise,
    correlation: float,
    series: int,
    generator: np.random.Generator,
) -> Array:
    """The largest sum of each of so many series of a gear that does not change, at runs of different warmth."""
    runs = promise.baseline + promise.over
    values = alike_days(series, runs, correlation, generator)
    warmth = generator.normal(size=(series, runs))
    regressors = np.stack([np.ones_like(warmth), warmth], axis=2)
    sums = sums_of(scores_of(values, regressors).normal, promise.baseline)
    return np.maximum(sums.upper, sums.lower).max(axis=1)


def alike_days(series: int, runs: int, correlation: float, generator: np.random.Generator) -> Array:
    """Standard normal series (series, runs), each run correlated with the one before."""
    values = generator.normal(size=(series, runs))
    for run in range(1, runs):
        own = np.sqrt(1.0 - correlation**2) * values[:, run]
        values[:, run] = correlation * values[:, run - 1] + own
    return values
