"""A table of numbers as words: those of one column share their unit and, where they are of one size, their decimals."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from experiments.result import Table
from model.unit_text import scale_in
from rig.content.grid import Column, Grid
from rig.content.wording import fixed, heading, number

DIGITS = 4
"""Significant digits of the smaller numbers of a column; the largest one has at most one more."""
SPREAD = 100.0
"""Ratio of the largest number to the smaller ones up to which a column shares its decimals."""
_SMALL_UNITS = {"N m": "mN m"}
"""Units in which a column of small numbers is read, by its SI unit."""
_UNIT = re.compile(r"\[([^\]]+)\]\s*\Z")


def data_grid(table: Table) -> Grid:
    """A table of an analysis in words."""
    cells = [[row[place] for row in table.rows] for place in range(len(table.columns))]
    named = [data_column(*pair) for pair in zip(table.columns, cells, strict=True)]
    rows = tuple(zip(*(texts for _, texts in named), strict=True))
    return Grid(table.title, tuple(column for column, _ in named), rows, table.note)


def data_column(title: str, cells: Sequence[Any]) -> tuple[Column, list[str]]:
    """One column of a table with its texts; it is one of numbers where every cell is one."""
    texts = [number(cell) for cell in cells]
    numeric = bool(cells) and all(
        isinstance(cell, (int, float)) and not isinstance(cell, bool) for cell in cells
    )
    if not numeric:
        return Column(heading(title)), texts
    if not all(isinstance(cell, int) for cell in cells):
        title, values = _in_small_unit(title, [float(cell) for cell in cells])
        decimals = _decimals(values)
        texts = [number(value) if decimals is None else fixed(value, decimals) for value in values]
    return Column(heading(title), "number"), texts


def _in_small_unit(title: str, values: list[float]) -> tuple[str, list[float]]:
    match = _UNIT.search(title)
    if match is None or match[1] not in _SMALL_UNITS:
        return title, values
    unit = _SMALL_UNITS[match[1]]
    if max((abs(v) for v in values if math.isfinite(v)), default=1.0) >= 1.0:
        return title, values
    factor = scale_in(unit, match[1]) or 1.0
    return f"{title[: match.start()]}[{unit}]", [value / factor for value in values]


def _decimals(values: Sequence[float]) -> int | None:
    """Decimals that all numbers of a column share; None where they are of very different sizes."""
    sizes = sorted(abs(value) for value in values if math.isfinite(value) and value)
    if not sizes:
        return 0
    largest, smaller = sizes[-1], sizes[len(sizes) // 10]
    if largest / smaller > SPREAD or not 1e-3 <= largest < 1e6:
        return None
    if all(math.isclose(value, round(value), rel_tol=1e-9) for value in sizes):
        return 0
    first, last = (DIGITS - 1 - math.floor(math.log10(size)) for size in (largest, smaller))
    return min(max(min(first + 1, last), 0), 6)
