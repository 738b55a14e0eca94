"""What was noted of each run and may move a quantity without the gear having changed: the regressors of the scores.

    column          what it is                                    where it is used
    level           1                                             always
    warmth          housing temperature less that of run 1, 5 K   every run of the baseline has one
    bench           1 on this bench                               a bench other than the first
    fresh lubricant 1 from that run on                            lubricant noted otherwise than before
    new mounting    1 from that run on                            mounting noted otherwise, unless that is so often that
                                                                  mounting belongs to the scatter of the gear

What nobody noted is no change: a card that is filled in after some runs begins no level, and hides none.

A run that begins a level is not judged by what was before: it teaches the new level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WARMTH_UNIT = 5.0
"""K; regressors are of about unit size."""
_OFTEN = 3
"""Runs of a mounting, on average over the baseline, below which mounting belongs to the scatter."""


@dataclass(frozen=True, kw_only=True)
class NotedRun:
    """What was noted of one run; "" and None: nothing."""

    temperature: float | None = None
    bench: str = ""
    lubricant: str = ""
    mounting: str = ""


@dataclass(frozen=True)
class Noted:
    """Of a series: `regressors` (runs, columns), NaN in a run that lacks its warmth; the runs at which a level
    `begins` with what began it; the names of the `columns`.
    """

    regressors: Array
    begins: dict[int, str]
    columns: tuple[str, ...]


def noted(runs: Sequence[NotedRun], baseline: int) -> Noted:
    """The regressors of a series of runs in order of time."""
    count = len(runs)
    columns: dict[str, Array] = {"level": np.ones(count)}
    if all(run.temperature is not None for run in runs[:baseline]):
        # One that was not recorded is NaN.
        temperature = np.array([run.temperature for run in runs], dtype=np.float64)
        columns["warmth"] = (temperature - temperature[:1]) / _WARMTH_UNIT
    for bench in list(dict.fromkeys(run.bench for run in runs if run.bench))[1:]:
        columns[f"bench {bench}"] = np.array([float(run.bench == bench) for run in runs])
    begins: dict[int, list[str]] = {}
    for name, changes in _levels(runs, baseline).items():
        for run in changes:
            begins.setdefault(run, []).append(name)
            columns[f"{name} at {run}"] = (np.arange(count) >= run).astype(float)
    words = {run: ", ".join(names) for run, names in begins.items()}
    return Noted(np.stack(list(columns.values()), axis=1), words, tuple(columns))


def _levels(runs: Sequence[NotedRun], baseline: int) -> dict[str, list[int]]:
    levels = {"fresh lubricant": _changes([run.lubricant for run in runs])}
    mountings = _changes([run.mounting for run in runs])
    within = sum(run < baseline for run in mountings)
    if (within + 1) * _OFTEN <= max(baseline, _OFTEN):
        levels["new mounting"] = mountings
    return levels


def _changes(values: Sequence[str]) -> list[int]:
    """The runs at which something is noted otherwise than when it was noted last."""
    changes, last = [], ""
    for run, value in enumerate(values):
        if value and last and value != last:
            changes.append(run)
        last = value or last
    return changes
