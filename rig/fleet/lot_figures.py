"""Figures of a lot: how a quantity is distributed against its limits, and what was measured when on which bench."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from experiments.result import Plot, Series
from rig.content.phrase import phrase
from rig.content.wording import number
from rig.fleet.lot_quantity import LotQuantity

MOST_BENCHES = 8
"""Benches that a figure tells apart by colour; more stand together."""
SECONDS_PER_DAY = 86400.0
_REACH = 3.0
"""Widths of the middle half of a lot beyond which a gear stands for itself: chance puts one of 250 000 there."""


def axis_of(one: LotQuantity) -> str:
    """The label of a quantity's axis, with its unit."""
    _, unit = one.shown_in
    return f"{one.title}{phrase(' [{}]', unit)}"


def core(values: np.ndarray) -> tuple[float, float]:
    """Between which values a lot lies but for single gears: three times the middle half on either side of it."""
    if not values.size:
        return -np.inf, np.inf
    low, high = np.percentile(values, (25.0, 75.0))
    reach = _REACH * (high - low)
    return (float(low - reach), float(high + reach)) if reach > 0.0 else (-np.inf, np.inf)


def distribution(one: LotQuantity) -> Plot:
    """How many gears lie where, with the limits; bins by Freedman and Diaconis. What lies far off is named.

    A limit is the edge of a bin, so that no bar stands on both sides of it (of two limits the upper one).
    """
    factor, unit = one.shown_in
    every = np.array([row.value for row in one.measured], dtype=float) / factor
    low, high = core(every)
    near = (every >= low) & (every <= high)
    limits = [value / factor for _, value in _limits(one)]
    counts, edges = np.histogram(every[near], bins=_edges(every[near], limits))
    top = float(counts.max(initial=1))
    middles = 0.5 * (edges[:-1] + edges[1:])
    far = [
        f"{row.gear} at {number(value)} {unit}".rstrip()
        for row, value, is_near in zip(one.measured, every, near, strict=True)
        if not is_near
    ]
    series = [Series(label="gears", x=middles, y=counts.astype(float), style="bars")]
    series += [
        Series(
            label=f"{side} limit",
            x=np.full(2, value / factor),
            y=np.array([0.0, top]),
            style="line",
            role="limit",
        )
        for side, value in _limits(one)
    ]
    beyond = phrase(" Not in the picture: {}.", ", ".join(far))
    return Plot(
        name=f"{one.kind}.{one.name}.distribution",
        title=f"{one.title}: distribution",
        x_label=axis_of(one),
        y_label="gears",
        series=tuple(series),
        note=f"How {len(every)} gears differ. Good where all of them lie well inside the limits, in one heap.{beyond}",
    )


def over_time(one: LotQuantity) -> Plot | None:
    """The values with their U over the days of the lot, by bench; None where nobody knows when they were measured."""
    rows = [row for row in one.measured if row.started is not None]
    if not rows:
        return None
    factor, _ = one.shown_in
    starts = [row.started for row in rows if row.started is not None]
    first = min(starts)
    benches = sorted({row.bench for row in rows})
    series = []
    for group, bench in enumerate(benches if len(benches) <= MOST_BENCHES else [None]):
        here = [row for row in rows if bench is None or row.bench == bench]
        values = np.array([row.value for row in here], dtype=float) / factor
        doubt = np.array([row.expanded_uncertainty or 0.0 for row in here]) / factor
        series.append(
            Series(
                label="all benches" if bench is None else f"bench {bench or 'not stated'}",
                x=np.array([_days(row.started, first) for row in here]),
                y=values,
                low=values - doubt,
                high=values + doubt,
                style="points",
                group=group,
            )
        )
    last = max(_days(start, first) for start in starts)
    series += [
        Series(
            label=f"{side} limit",
            x=np.array([0.0, max(last, 1e-3)]),
            y=np.full(2, value / factor),
            style="line",
            role="limit",
        )
        for side, value in _limits(one)
    ]
    return Plot(
        name=f"{one.kind}.{one.name}.time",
        title=f"{one.title}: over time",
        x_label=f"days since {datetime.fromtimestamp(first, UTC).date().isoformat()} (UTC)",
        y_label=axis_of(one),
        series=tuple(series),
        note="Each gear on its day, bars: U (95 %). Good where there is no slope: one is a drift of the production or "
        "of a bench.",
    )


def _edges(values: np.ndarray, limits: list[float]) -> np.ndarray:
    if not values.size:
        return np.array([-1.0, 1.0])
    if values.size < 2 or float(np.ptp(values)) == 0.0:
        middle = float(values[0])
        width = max(abs(middle) * 0.01, 1e-9)
        return np.array([middle - width, middle + width])
    edges = np.histogram_bin_edges(values, bins="fd")
    if not 4 <= len(edges) <= 60:
        edges = np.linspace(values.min(), values.max(), 21)
    if not limits:
        return edges
    width = float(edges[1] - edges[0])
    # A little further than to the outermost gears: none may fall out by the rounding of an edge.
    below = np.floor((values.min() - limits[-1]) / width - 1e-9)
    above = np.ceil((values.max() - limits[-1]) / width + 1e-9)
    return limits[-1] + width * np.arange(below, above + 1.0)


def _limits(one: LotQuantity) -> list[tuple[str, float]]:
    if one.limits is None or one.limits.conflict:
        return []
    sides = (("lower", one.limits.lower), ("upper", one.limits.upper))
    return [(side, value) for side, value in sides if value is not None]


def _days(started: float | None, first: float) -> float:
    assert started is not None
    return (started - first) / SECONDS_PER_DAY
