"""Which of many runs a list shows."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from datetime import UTC, datetime

from rig.library.index import IndexedRun

SHOWN = 50
"""Runs that a terminal shows unless asked for more: to judge one takes a thousandth of a second."""


def newest(listed: Sequence[IndexedRun], most: int) -> list[IndexedRun]:
    """At most so many runs, those that began last, in the order in which they are listed; 0: all."""
    if not most or len(listed) <= most:
        return list(listed)
    chosen = heapq.nlargest(most, range(len(listed)), key=lambda i: (_began(listed[i]), i))
    return [listed[i] for i in sorted(chosen)]


def _began(run: IndexedRun) -> float:
    """When a run began; one that does not say when counts as new, so that nobody overlooks it."""
    try:
        moment = datetime.fromisoformat(run.start)
    except ValueError:
        return float("inf")
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
