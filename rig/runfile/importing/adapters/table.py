"""What every adapter yields: named columns of numbers, a batch of rows at a time, and what the file says of them.

Units, times, gaps and checks are no matter of the adapters: they are one code for all (`streams`, `reading`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.content.phrase import phrase
from rig.errors import ConfigurationError

BATCH_ROWS = 16384
_BRACKETED = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*")

CellReader = Callable[[str], float]
"""A number for the text of a cell that is none, such as a date or a label; raises `ValueError` with why not."""


@dataclass(frozen=True)
class BadCell:
    """A cell that is no number: the line (or row) that the file's owner sees, the column, what
    stands there, and why.
    """

    line: int
    column: str
    text: str
    why: str


@dataclass(frozen=True)
class Batch:
    """Consecutive rows of the wanted columns: line numbers (n,), values (n, columns), the bad cells by row.

    `blank` are rows in which none of the wanted columns has anything: where a column has ended
    while others of the file go on.
    """

    lines: NDArray[np.int64]
    values: NDArray[np.float64]
    bad: dict[int, BadCell] = field(default_factory=dict)
    blank: frozenset[int] = frozenset()


class Table(Protocol):
    """Named columns of numbers in a file."""

    path: Path
    headings: tuple[str, ...]
    units: tuple[str, ...]
    """What the file says of the unit of each column, "" where it says nothing."""
    times: tuple[int | None, ...]
    """The column of time that belongs to each column, where the kind of file says so."""
    period: float | None
    """Seconds from row to row, where the file states them and has no column of time."""
    start_ns: int
    """Calendar time [ns since 1970] of time 0, where the file states it; else 0."""
    may_be_retimed: bool
    """Whether another column of time may be named in place of the one that the file says."""
    line_word: str
    notes: tuple[str, ...]
    """How the file was read, and what in it is worth knowing."""

    @property
    def stamped(self) -> Collection[int]:
        """The columns of time that count from `start_ns`; a `period` does so too."""
        ...

    def batches(
        self, columns: Sequence[int], readers: Mapping[int, CellReader] | None = None
    ) -> Iterator[Batch]:
        """The rows of these columns, a batch at a time; `readers` for columns of texts."""
        ...


def find_column(table: Table, wanted: str) -> int:
    """The index of a column by its heading (with or without its unit) or its number, counted from 1."""
    index = column_named(table, wanted)
    if index is not None:
        return index
    shown = ", ".join(table.headings[:20]) + phrase(", ...", table.headings[20:])
    raise ConfigurationError(
        "there is no such column",
        where=str(table.path),
        value=wanted,
        limit=f"{shown}, or a number from 1 to {len(table.headings)}",
    )


def column_named(table: Table, wanted: str) -> int | None:
    """The index of a column as `find_column` finds it; None where there is none."""
    plain = [split_heading(heading)[0] for heading in table.headings]
    small = [name.lower() for name in plain]
    for names, key in ((list(table.headings), wanted), (plain, wanted), (small, wanted.lower())):
        if names.count(key) == 1:
            return names.index(key)
        if names.count(key) > 1:
            raise ConfigurationError(
                "the file has more than one column of this name",
                where=str(table.path),
                value=wanted,
                remedy="Give the column's number, counted from 1.",
            )
    if wanted.isascii() and wanted.isdigit() and 1 <= int(wanted) <= len(table.headings):
        return int(wanted) - 1
    return None


_NO_UNITS = frozenset(
    {"a.u.", "a.u", "au", "arb. unit", "arb. units", "arbitrary units", "-", "n/a", "none", "raw"}
)
"""What people write in brackets where they know no unit."""


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit of a heading such as `Position [deg]` or `t (s)`.

    What stands in brackets and is no unit belongs to the name: the number of a channel (`x (2)`), or that nobody knows
    (`M (A.U.)`). `[1]` is a unit: that of a ratio.
    """
    match = _BRACKETED.fullmatch(heading)
    if match is None:
        return heading.strip(), ""
    name, unit = match.group(1).strip(), match.group(2).strip()
    if unit.isdigit() and not heading.rstrip().endswith("[1]"):
        inner, unit_before = split_heading(name)
        return f"{inner} ({unit})", unit_before
    if unit.lower() in _NO_UNITS:
        return heading.strip(), ""
    return name, unit


def heading_units(headings: Sequence[str]) -> tuple[str, ...]:
    """The units that headings name in brackets, "" for those without."""
    return tuple(split_heading(heading)[1] for heading in headings)


def not_finite(
    values: NDArray[np.float64], lines: NDArray[np.int64], headings: Sequence[str]
) -> dict[int, BadCell]:
    """The first cell of each row that is not a finite number."""
    bad: dict[int, BadCell] = {}
    for row, index in np.argwhere(~np.isfinite(values)):
        text = str(values[row, index])
        bad.setdefault(int(row), BadCell(int(lines[row]), headings[int(index)], text, "not finite"))
    return bad
