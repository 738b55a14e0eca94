"""The page of measurands: what is meant by each quantity, and which lines its budget has."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from reference_pages.words import cell, default_text

BUDGETS = Path(__file__).parents[1] / "budgets.json"
"""Lines of the budgets by quantity, as the analyses give them: `tests/experiments/test_versions.py` holds it."""


def measurands() -> Iterable[str]:
    """Each measurand as its protocol declares it, with the lines of its budget."""
    from experiments import catalogue
    from experiments.parameters import parameter_fields

    yield "# Measurands"
    yield ""
    yield (
        "What exactly is meant by each quantity that a protocol finds, as the protocol declares it. "
        "A word in braces stands for a member of a family: `{way}` is forward or reverse, `{speed}` r/min at "
        "the input, `{order}` cycles per input revolution. The lines of a budget are those that the analysis of a "
        "small recording has whose bench states nothing of itself; a calibration, a tare or a certificate changes "
        "where a line comes from, and its size stands in the report of a result. A: from the scatter of the data. "
        "B: from elsewhere."
    )
    budgets = json.loads(BUDGETS.read_text(encoding="utf-8"))
    for entry in catalogue.ENTRIES:
        experiment = catalogue.load(entry.name)
        shown = [q for q in experiment.quantities if q.is_key or q.definition]
        if not entry.has_plan or not shown:
            continue
        yield f"\n## {entry.name}\n"
        yield f"{entry.summary[0].upper()}{entry.summary[1:]}."
        plan = [
            f"{f.name.replace('_', ' ')} {default_text(f.default)} {f.unit}".strip()
            for f in parameter_fields(experiment.parameters)
            if default_text(f.default)
        ]
        yield f"\nConditions unless the plan says otherwise: {cell('; '.join(plan))}."
        for q in dict.fromkeys(shown):
            yield f"\n### {cell(q.headed(q.name))}\n"
            yield from _measurand(entry.name, q, _speeds(experiment))
            yield from _budget(budgets.get(entry.name, {}).get(q.name, ()))


def _speeds(experiment: Any) -> str:
    """The speeds of a protocol's plan, as its parameters say them."""
    from experiments.parameters import parameter_fields

    return "; ".join(
        f"{f.name.replace('_', ' ')} {default_text(f.default)}"
        for f in parameter_fields(experiment.parameters)
        if f.unit == "r/min" and default_text(f.default)
    )


def _budget(lines: Sequence[Sequence[str]]) -> Iterable[str]:
    """The lines of a budget as a table; nothing for a quantity that no small recording tells."""
    if lines:
        yield "\n| line of the budget | type | where it comes from |\n|---|---|---|"
    for source, kind, note in lines:
        yield f"| {cell(source)} | {kind} | {cell(note)} |"


def _measurand(kind: str, q: Any, speeds: str) -> Iterable[str]:
    ways = {"way": "each direction of turning for itself"}
    rows = [
        ("name", f"`{kind}.{q.name}`"),
        ("unit", q.unit + (f", shown in {q.shown}" if q.shown else "")),
        ("definition", cell(q.definition)),
        ("speeds", "that in its name" if q.placeholder == "speed" else cell(speeds)),
        ("temperature", "20 °C" if "at_20_degrees" in q.name else "that of the run"),
        ("direction", ways.get(q.placeholder, "") or ("with its sign" if q.is_signed else "")),
        ("comparable at equal", cell(", ".join(q.conditions))),
        ("U of a useful result", cell(" ".join((q.target_text, q.target_reason)).strip())),
    ]
    if q.catalogue is not None:
        rows += [
            ("reference: definition of catalogues", cell(q.catalogue.definition)),
            ("reference: conditions of catalogues", cell(q.catalogue.conditions)),
            ("reference: rating", f"`ratings.{q.catalogue.rating}`"),
        ]
    yield "| | |\n|---|---|"
    for name, text in rows:
        if text:
            yield f"| {name} | {text} |"
