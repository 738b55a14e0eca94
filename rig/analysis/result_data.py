"""A result as plain JSON data and back, figures and tables included: what a program that drew
nothing hands to one that draws.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import catalogue
from experiments.quantity import Quantity, with_bare
from experiments.result import Covariance, Panel, Plot, Result, Series, Table, checks_from_mapping
from model.identify.estimate import BudgetLine, Cause, Distribution, Estimate
from rig.analysis.number_or_none import finite

_WORDS = ("name", "title", "x_label", "y_label", "x_scale", "y_scale", "figure", "note")
_ARRAYS = ("x", "y", "low", "high")
DIGITS = 9
"""Significant digits of a drawn number: far below what any screen or paper shows."""


def result_from_mapping(
    mapping: Mapping[str, Any], tables: Sequence[Mapping[str, Any]] = ()
) -> Result:
    """A result out of what `rig fit --json` prints or the analysis store keeps; `tables` where they lie beside it.

    Raises `ValueError`, `KeyError` or `TypeError` for what is none.
    """
    estimates = {name: _estimate_from_mapping(name, e) for name, e in mapping["parameters"].items()}
    return Result(
        run=str(mapping["run"]),
        kind=str(mapping["kind"]),
        quantities=quantities_for(str(mapping["kind"]), estimates, mapping.get("metrics", ())),
        estimates=estimates,
        metrics={name: _number(value) for name, value in mapping.get("metrics", {}).items()},
        warnings=tuple(str(warning) for warning in mapping.get("warnings", ())),
        plots=tuple(plot_from_mapping(plot) for plot in mapping.get("plots", ())),
        tables=tuple(_table_from_mapping(table) for table in (*mapping.get("tables", ()), *tables)),
        checks=checks_from_mapping(mapping.get("checks", ())),
        options=dict(mapping.get("options", {})),
    )


def declared_quantities(kind: str) -> tuple[Quantity, ...]:
    """What a kind of analysis declares; nothing for one that is not in the catalogue."""
    experiment = catalogue.declared(kind)
    return experiment.quantities if experiment else ()


def quantities_for(
    kind: str, estimates: Mapping[str, Estimate], metrics: Iterable[str]
) -> tuple[Quantity, ...]:
    """What a kind of analysis declares, and of numbers that it does not (any more) their names and units."""
    units = dict.fromkeys(metrics, "") | {name: e.unit for name, e in estimates.items()}
    return with_bare(declared_quantities(kind), units)


def _estimate_from_mapping(name: str, mapping: Mapping[str, Any]) -> Estimate:
    """One identified number out of JSON data."""
    budget = tuple(
        BudgetLine(
            source=str(b["source"]),
            kind=b["kind"],
            standard_uncertainty=_number(b["standard_uncertainty"]),
            note=str(b.get("note", "")),
            cause=Cause(b["cause"]) if b.get("cause") else None,
            degrees_of_freedom=math.inf if (d := b.get("degrees_of_freedom")) is None else d,
            assumed=str(b.get("assumed", "")),
            distribution=Distribution(b.get("distribution", Distribution.NORMAL)),
        )
        for b in mapping.get("budget", ())
    )
    # A stored result keeps the U that it was stated with, by whatever rule for k; a list of runs doesn't pay for SciPy.
    stated = mapping.get("coverage_factor", 2.0)
    return Estimate(
        name=name,
        value=_number(mapping["value"]),
        unit=str(mapping["unit"]),
        low=_number(mapping["low"]),
        high=_number(mapping["high"]),
        identifiable=mapping.get("identifiability", "yes"),
        note=str(mapping.get("note", "")),
        budget=budget,
        stated_coverage_factor=None if stated is None else float(stated),
    )


def covariance_from_mapping(mapping: Mapping[str, Any] | None) -> Covariance | None:
    """A covariance out of what the analysis store keeps. Raises `ValueError`, `KeyError` or `TypeError`."""
    if not mapping:
        return None
    shared = {Cause(name): _array(vector) for name, vector in mapping.get("shared", {}).items()}
    matrix = np.array([_array(row) for row in mapping["matrix"]], dtype=np.float64)
    return Covariance(tuple(mapping["names"]), matrix, shared)


def _number(value: Any) -> float:
    """A number; what JSON could not hold is NaN."""
    return math.nan if value is None else float(value)


def plot_to_mapping(plot: Plot) -> dict[str, Any]:
    """A figure as JSON data; NaN and infinity, which JSON cannot hold, are null."""
    mapping: dict[str, Any] = {name: getattr(plot, name) for name in _WORDS}
    mapping["series"] = [
        {
            "label": s.label,
            "style": s.style,
            "group": s.group,
            "role": s.role,
            "panel": s.panel,
            **{name: _numbers(getattr(s, name)) for name in _ARRAYS},
        }
        for s in plot.series
    ]
    mapping["panels"] = [{"y_label": p.y_label, "share": p.share} for p in plot.panels]
    mapping["enlarged"] = plot.enlarged
    return mapping


def plot_from_mapping(mapping: Mapping[str, Any]) -> Plot:
    """A figure out of JSON data. Raises `ValueError`, `KeyError` or `TypeError` for what is none."""
    series = tuple(
        Series(
            label=str(s["label"]),
            x=_array(s["x"]),
            y=_array(s["y"]),
            style=s["style"],
            low=_optional(s.get("low")),
            high=_optional(s.get("high")),
            group=int(s["group"]),
            role=s.get("role", "data"),
            panel=int(s.get("panel", 0)),
        )
        for s in mapping["series"]
    )
    panels = tuple(Panel(str(p["y_label"]), float(p["share"])) for p in mapping.get("panels", ()))
    enlarged = mapping.get("enlarged")
    return Plot(
        series=series,
        panels=panels,
        enlarged=None if enlarged is None else (float(enlarged[0]), float(enlarged[1])),
        **{name: mapping[name] for name in _WORDS},
    )


def table_to_mapping(table: Table) -> dict[str, Any]:
    """A table as JSON data."""
    return {
        "name": table.name,
        "title": table.title,
        "columns": table.columns,
        "rows": table.rows,
        "note": table.note,
    }


def _table_from_mapping(mapping: Mapping[str, Any]) -> Table:
    """A table out of JSON data; a number that JSON could not hold is a dash."""
    rows = tuple(tuple("–" if cell is None else cell for cell in row) for row in mapping["rows"])
    return Table(
        str(mapping["name"]),
        str(mapping["title"]),
        tuple(mapping["columns"]),
        rows,
        str(mapping.get("note", "")),
    )


def _numbers(values: NDArray[np.float64] | None) -> list[float | None] | None:
    if values is None:
        return None
    plain = np.asarray(values, dtype=np.float64).ravel().tolist()
    return [finite(float(f"{value:.{DIGITS}g}")) for value in plain]


def _array(values: list[float | None]) -> NDArray[np.float64]:
    # What JSON could not hold is NaN again.
    return np.array(values, dtype=np.float64)


def _optional(values: list[float | None] | None) -> NDArray[np.float64] | None:
    return None if values is None else _array(values)
