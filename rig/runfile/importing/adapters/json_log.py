"""Logs in JSON, in the forms in which people write tables.

    rows as objects     [{"t": 0.0, "x": 1.0}, ...], alone or under a key of the file
    rows as lists       [["t", "x"], [0.0, 1.0], ...], with the names in the first row, or without names
    columns             {"t": [0.0, ...], "x": [1.0, ...]}, or each an object by row number (pandas' "columns")
    pandas' "split"     {"columns": ["t", "x"], "data": [[0.0, 1.0], ...]}

Of several in one file the one with most rows is read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import RunFileError
from rig.runfile.importing.adapters.arrays import ArrayTable

SHOWN = 8


def json_table(path: Path) -> ArrayTable:
    """The columns of a log: the table with most rows in the file. Truth values become 0 and 1.

    A key that an object lacks, or that has no number there, is a hole (NaN). What else stands at
    the top of the file is shown in a note.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise RunFileError(f"cannot be read: {error.strerror or error}", where=str(path)) from error
    except (ValueError, RecursionError) as error:
        raise RunFileError(f"is not JSON: {error}", where=str(path)) from error
    found = _columns(content)
    arrays = {
        name: np.array([_number(value) for value in values])
        for name, values in found.columns.items()
    }
    table = ArrayTable(
        path, {name: a for name, a in arrays.items() if np.isfinite(a).any()}, "JSON log"
    )
    table.notes += tuple(
        f"{name}: {count} values where other columns have {found.rows}, left out"
        for name, count in found.short.items()
    )
    if isinstance(content, dict):
        stated = {k: v for k, v in content.items() if isinstance(v, (str, int, float))}
        said = ", ".join(f"{key} {value}" for key, value in list(stated.items())[:SHOWN])
        if said:
            table.notes += (f"the file says: {said}",)
    return table


@dataclass(frozen=True)
class _ColumnTable:
    """The columns of one table, and the lists beside them that are shorter, with their lengths."""

    columns: dict[str, list[Any]]
    short: dict[str, int] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """The length of a column."""
        return max(map(len, self.columns.values()), default=0)


def _columns(content: Any) -> _ColumnTable:
    """The table with most rows; empty where there is none."""
    places = [content, *content.values()] if isinstance(content, dict) else [content]
    tables = [table for place in places for table in _tables(place)]
    return max(tables, key=lambda one: one.rows, default=_ColumnTable({}))


def _tables(place: Any) -> Iterator[_ColumnTable]:
    """What one part of a file is as a table, by each form that it has."""
    if isinstance(place, list):
        yield from _of_list(place)
    elif isinstance(place, dict) and {"columns", "data"} <= place.keys():
        yield from _of_split(place["columns"], place["data"])
    elif isinstance(place, dict):
        yield from _of_columns(place)


def _of_list(rows: list[Any]) -> Iterator[_ColumnTable]:
    """Rows that all are objects, or all lists."""
    kinds = set(map(type, rows))
    if kinds == {dict}:
        names = dict.fromkeys(key for row in rows for key in row)
        yield _ColumnTable({name: [row.get(name) for row in rows] for name in names})
    elif kinds == {list}:
        yield _ColumnTable(_of_rows(rows))


def _of_split(names: Any, rows: Any) -> Iterator[_ColumnTable]:
    """Rows as lists, with their names beside them."""
    if isinstance(names, list) and isinstance(rows, list):
        yield _ColumnTable(_of_rows([[str(name) for name in names], *rows]))


def _of_columns(place: dict[str, Any]) -> Iterator[_ColumnTable]:
    """Columns as lists, and columns as objects by row number: each kind a table of its own."""
    lists = {k: v for k, v in place.items() if isinstance(v, list) and not _holds(v)}
    by_row = {k: v for k, v in place.items() if isinstance(v, dict) and v}
    numbers = {k: v for k, v in by_row.items() if not _holds(v.values())}
    if lists:
        yield _of_longest(lists)
    if numbers:
        # A row that one column lacks is a hole there, not the next row's number.
        keys = dict.fromkeys(key for column in numbers.values() for key in column)
        yield _ColumnTable({name: [c.get(key) for key in keys] for name, c in numbers.items()})


def _holds(values: Iterable[Any]) -> bool:
    """Whether anything in it is a table or a list of its own."""
    return any(isinstance(value, (list, dict)) for value in values)


def _of_longest(columns: dict[str, list[Any]]) -> _ColumnTable:
    """The columns that have as many rows as the longest; of the shorter ones nobody knows which rows they are of."""
    longest = max(map(len, columns.values()))
    return _ColumnTable(
        {name: values for name, values in columns.items() if len(values) == longest},
        {name: len(values) for name, values in columns.items() if len(values) < longest},
    )


def _of_rows(rows: list[Any]) -> dict[str, list[Any]]:
    """Columns of rows that are lists; the first row has the names where all of it is text."""
    rows = [row for row in rows if isinstance(row, list)]
    width = max(map(len, rows), default=0)
    names = [f"column {k}" for k in range(1, width + 1)]
    if rows and set(map(type, rows[0])) == {str}:
        names, *rows = rows
    columns = zip_longest(names, *rows)
    return {str(name): list(values) for name, *values in islice(columns, len(names))}


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan
