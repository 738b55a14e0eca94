"""Cumulative sums of scores to both sides, from the end of the baseline on.

    S+_i = max(0, S+_(i-1) + u_i - k) ,   S-_i = max(0, S-_(i-1) - u_i - k) ,   S_baseline = head start

An alarm is the first run at which one of them exceeds the threshold h. k = 0.5 is best for a lasting step of one
standard deviation and good up to three. The head start finds what changed right after the baseline sooner, and is
forgotten by a gear that did not change. Sources: Page,
Biometrika 41 (1954) 100; Lucas, Crosier, Technometrics 24 (1982) 199, fast initial response.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ALLOWANCE = 0.5
"""k, in standard deviations."""
HEAD_START = 2.0
"""Both sums at the end of the baseline; less than half of every threshold that is used."""


@dataclass(frozen=True)
class Sums:
    """Upper and lower sum of many series, each (series, runs); zero within the baseline."""

    upper: Array
    lower: Array


def sums_of(scores: Array, baseline: int, begins: Sequence[int] = ()) -> Sums:
    """The sums of scores (series, runs). A run without a score adds nothing; at the runs `begins` a new level begins,
    and the sums with it.
    """
    series, runs = scores.shape
    upper, lower = np.zeros((series, runs)), np.zeros((series, runs))
    up, down = np.full(series, HEAD_START), np.full(series, HEAD_START)
    anew = frozenset(begins)
    for run in range(baseline, runs):
        if run in anew:
            up, down = np.zeros(series), np.zeros(series)
        score = scores[:, run]
        told = np.isfinite(score)
        up = np.where(told, np.maximum(0.0, up + score - ALLOWANCE), up)
        down = np.where(told, np.maximum(0.0, down - score - ALLOWANCE), down)
        upper[:, run], lower[:, run] = up, down
    return Sums(upper, lower)


def crossing_of(
    sums: Sums, threshold: float, baseline: int, begins: Sequence[int] = ()
) -> int | None:
    """The first run of the last level at which one series (series of length one) crosses; None where it does not.

    One before a new level is history: what was noted there explains it.
    """
    first = max((run for run in begins if run > baseline), default=baseline)
    over = np.maximum(sums.upper[0], sums.lower[0])[first:] > threshold
    return first + int(np.argmax(over)) if over.any() else None
