"""Thinning of curves to what a page can show, without losing a peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LINE_BINS = 700
"""Bins along a curve of full width; each keeps its first, lowest, highest and last value."""
SCATTER_COLUMNS, SCATTER_ROWS = 1400, 700
"""Raster on which scattered points that fall on the same cell count as one."""


def peak_rows(y: NDArray[np.float64], bins: int = _LINE_BINS) -> NDArray[np.intp]:
    """Rows of a curve that must stay so that it looks the same: first, lowest, highest and last value of each bin.

    `y` (n,) in the order in which it is drawn; NaN (a gap in the line) is kept as one row per bin. Returns rising row
    numbers; all of them when the curve is short.
    """
    n = len(y)
    if n <= 4 * bins:
        return np.arange(n)
    edges = np.linspace(0, n, bins + 1).astype(np.intp)
    starts, stops = edges[:-1], edges[1:]
    gap = ~np.isfinite(y)
    chosen = [starts, stops - 1]
    for filler, pick in ((np.inf, np.minimum), (-np.inf, np.maximum)):
        filled = np.where(gap, filler, y)
        extreme = np.repeat(pick.reduceat(filled, starts), stops - starts)
        chosen.append(_first_true(filled == extreme, starts))
    if gap.any():
        chosen.append(_first_true(gap, starts))
    return np.unique(np.concatenate(chosen))


def _first_true(flags: NDArray[np.bool_], starts: NDArray[np.intp]) -> NDArray[np.intp]:
    """The first true row of each bin; bins without one give nothing."""
    n = len(flags)
    rows = np.minimum.reduceat(np.where(flags, np.arange(n), n), starts)
    return rows[rows < n]


def scatter_rows(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.intp]:
    """Rows of scattered points (n,) of which no two fall on the same cell of the raster; the extremes always stay."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if not len(finite):
        return finite
    column = _cells(x[finite], SCATTER_COLUMNS)
    row = _cells(y[finite], SCATTER_ROWS)
    _, first = np.unique(column * SCATTER_ROWS + row, return_index=True)
    extremes = [a[finite].argmin() for a in (x, y)] + [a[finite].argmax() for a in (x, y)]
    return np.unique(finite[np.concatenate([first, extremes])])


def _cells(values: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    low, high = values.min(), values.max()
    if high <= low:
        return np.zeros(len(values), dtype=np.intp)
    return np.minimum((values - low) / (high - low) * count, count - 1).astype(np.intp)
