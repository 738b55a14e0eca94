"""The answer to a ready question as a table that a person reads: titles, and numbers in the units of a laboratory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from experiments.catalogue import declared_quantity
from experiments.quantity import bare_quantity
from rig.content.grid import Column, Grid, Kind
from rig.content.wording import laboratory_unit, number
from rig.fleet.questions import Answer, Question

_IN_UNIT = frozenset(
    (
        "mean",
        "standard_deviation",
        "lowest",
        "median",
        "highest",
        "expanded_uncertainty",
        "difference",
        "standard_error",
        "slope_per_day",
        "lower_limit",
        "upper_limit",
        "value",
        "limit_value",
    )
)
"""Columns of the ready questions that are in the unit of their row's quantity."""
_HEADINGS = {
    "expanded_uncertainty": "U",
    "standard_deviation": "s",
    "deviation_over_u": "s / u",
    "difference_over_error": "difference / error",
    "slope_over_error": "slope / error",
    "margin_over_expanded_uncertainty": "margin / U",
    "mean_of_others": "mean of others",
}
_ANSWERS = (
    "verdict",
    "cpk",
    "margin_over_expanded_uncertainty",
    "deviation_over_u",
    "difference_over_error",
    "slope_over_error",
)
_KINDS: Mapping[str, Kind] = {
    "unit": "unit",
    "verdict": "word",
    "quantity": "quantity",
    "bench": "word",
}


def answer_grid(question: Question, answer: Answer) -> Grid:
    """The rows of a ready question in words; `unit` is that of every value of the row.

    What the row is of stands first, then what answers the question; its kind and its file, which the quantity and the
    run say too, last.
    """
    first = [name for name in ("gear", "quantity", "bench", *_ANSWERS) if name in answer.columns]
    last = [name for name in ("kind", "day", "run_file") if name in answer.columns]
    between = [name for name in answer.columns if name not in (*first, *last)]
    if isinstance(_example(answer, "gear"), int):
        # How many gears, not which.
        first, between = first[1:], ["gear", *between]
    order = (*first, *between, *last)
    return Grid(
        question.asks,
        tuple(Column(_heading(name), _kind(name, answer)) for name in order),
        [_row(order, dict(zip(answer.columns, row, strict=True))) for row in answer.rows],
    )


def _heading(name: str) -> str:
    return _HEADINGS.get(name, name.replace("_", " "))


def _kind(name: str, answer: Answer) -> Kind:
    if name in _KINDS:
        return _KINDS[name]
    return "number" if _is_number(_example(answer, name)) else "text"


def _example(answer: Answer, name: str) -> Any:
    """What stands in a column, where anything does."""
    if name not in answer.columns:
        return None
    place = answer.columns.index(name)
    return next((row[place] for row in answer.rows if row[place] is not None), None)


def _row(order: Sequence[str], cells: dict[str, Any]) -> tuple[str, ...]:
    quantity = declared_quantity(cells["kind"], cells["quantity"]) or bare_quantity(
        cells["quantity"], cells["unit"]
    )
    factor, unit = laboratory_unit(cells["unit"], _size(cells), quantity.shown)
    for name in _IN_UNIT & cells.keys():
        if _is_number(cells[name]):
            cells[name] /= factor
    cells |= {"unit": unit, "quantity": quantity.titled(cells["quantity"])}
    return tuple("–" if cells[name] is None else number(cells[name]) for name in order)


def _size(cells: Mapping[str, Any]) -> float:
    """By what the unit of a row is chosen: what was measured, else the limit."""
    for name in ("mean", "value", "lowest", "difference", "slope_per_day", "upper_limit"):
        if _is_number(cells.get(name)) and math.isfinite(cells[name]):
            return abs(float(cells[name]))
    return 1.0


def _is_number(cell: object) -> bool:
    return isinstance(cell, (int, float)) and not isinstance(cell, bool)
