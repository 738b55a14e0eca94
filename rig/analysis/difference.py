"""What differs between two runs: parameters, limits, calibrations, versions, conditions, gear, acquisition, results.

Results are compared by their newest analyses of the same kind. Two values differ significantly where

    |b - a| > U_c,    U_c = sqrt(U_a^2 + U_b^2)

with U the expanded uncertainties (95 %), taken as independent. What both have in common (the same
torque scale, the same tare, the same encoders) cancels in the difference: U_c is then too large and
the statement cautious, and U_c without what is shared stands beside it (`rig.analysis.causes`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.quantity import Quantity
from model.identify.estimate import Estimate, Ground
from rig.analysis.causes import Grounds, combined_uncertainty, common_grounds, grounds_of
from rig.analysis.in_force import in_force_by_kind
from rig.analysis.number_or_none import finite
from rig.analysis.store import Analysis
from rig.content.grid import Fact, Grid, columns
from rig.content.wording import laboratory_unit, number, readable, value_text
from rig.program import PROGRAM_KEYS
from rig.runfile.facts import GROUPS as RUN_GROUPS
from rig.runfile.facts import flat, run_facts
from rig.runfile.read import close_recording, open_run

GROUPS = (*RUN_GROUPS, "results")
"""What is compared, in this order."""
_PROGRAM_FACTS = dict(
    zip(("program version", "program commit", "program files"), PROGRAM_KEYS, strict=True)
)
"""What an analysis says of the program that made it, and its key there; older ones do not say all of it."""
_SUBJECT = (
    "torque_is_of",
    "torque_balance",
    "channel",
    "mounting",
    "highest_order",
    "kinematic_error",
)
"""Options of an analysis that change what its numbers mean."""
_HASH = re.compile(r"\b([0-9a-f]{12})[0-9a-f]{52}\b")
"""A hash whose beginning tells it from another; the whole of it stands in `--json`."""
_NOTHING = Fact("", "")
"""What a run says of a thing that it does not name."""
SAME_NUMBER = 1e-12
"""Relative; numbers nearer than this are one number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One thing that is not the same: where, both values as they are shown, and for results what the difference means.

    `difference` is second minus first in `unit`, `uncertainty` its U_c (95 %, independent);
    `significant` is None where nothing can be said, `note` then says why. `own_uncertainty` is U_c
    without what both results share, and `significant_without_shared` what follows from it; both
    None where nothing is shared.
    """

    group: str
    name: str
    first: str
    second: str
    difference: float | None = None
    uncertainty: float | None = None
    unit: str = ""
    significant: bool | None = None
    note: str = ""
    own_uncertainty: float | None = None
    significant_without_shared: bool | None = None
    title: str = ""
    """What it is called where people read it."""
    shown: str = ""
    """Difference ± U_c as it is read in a laboratory."""

    def in_words(self, text: str) -> str:
        """One of both values with its unit; a dash where there is none."""
        if not text:
            return "–"
        return text if self.group == "results" else f"{text} {self.unit}".rstrip()

    def as_json(self) -> dict[str, Any]:
        """One line of `rig diff --json`."""
        names = [name for name in self.__slots__ if name not in ("title", "shown")]
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Difference:
    """Two runs and everything in which they differ; `compared` counts what was looked at, by group;
    `same` is the rest.
    """

    first: str
    second: str
    changes: tuple[Change, ...]
    compared: Mapping[str, int]
    same: tuple[Change, ...] = ()

    @property
    def differs(self) -> bool:
        """Whether anything differs beyond the runs' own numbers and times."""
        return any(change.group != "run" for change in self.changes)

    def of(self, group: str) -> tuple[Change, ...]:
        """The changes of one group."""
        return tuple(change for change in self.changes if change.group == group)

    def as_json(self) -> dict[str, Any]:
        """The object that `rig diff --json` prints."""
        return {
            "first": self.first,
            "second": self.second,
            "differs": self.differs,
            "compared": dict(self.compared),
            "changes": [change.as_json() for change in self.changes],
        }


def change_grid(changes: Sequence[Change]) -> Grid:
    """Changes in the units of a laboratory; results name their kind of fit where there are several."""
    kinds = {change.name.partition(": ")[0] for change in changes if change.group == "results"}
    heads = columns(
        "group",
        ("what", "quantity"),
        "first",
        "second",
        ("difference ± U_c", "number"),
        ("significance", "word"),
        "remark",
    )
    rows = [_change_row(change, several_kinds=len(kinds) > 1) for change in changes]
    return Grid("Differences", heads, rows)


def _change_row(change: Change, *, several_kinds: bool) -> tuple[str, ...]:
    kind, name = "", change.name
    if change.group == "results":
        kind, _, name = name.partition(": ")
    words = change.title or readable(name) or kind
    what = f"{kind}: {words}" if name and kind and several_kinds else words
    first, second = (
        _HASH.sub(r"\1…", change.in_words(one)) for one in (change.first, change.second)
    )
    row = (change.group, what, first, second)
    if change.difference is None or change.uncertainty is None:
        return (*row, "", "", change.note)
    meaning = {None: "", True: "significant", False: "within U"}[change.significant]
    return (*row, change.shown, meaning, change.note)


def difference(first: str | Path, second: str | Path) -> Difference:
    """What differs between two run files. Raises `RunFileError` for one that cannot be read."""
    a, b = _facts(Path(first)), _facts(Path(second))
    found: list[Change] = []
    compared: dict[str, int] = {}
    for group in GROUPS[:-1]:
        left, right = a.of(group), b.of(group)
        names = list(dict.fromkeys((*left, *right)))
        compared[group] = len(names)
        for name in names:
            facts = [one[name] for one in (left, right) if name in one]
            change = Change(
                group=group,
                name=name,
                first=left.get(name, _NOTHING).value,
                second=right.get(name, _NOTHING).value,
                title=facts[0].title,
                unit=next((fact.unit for fact in facts if fact.unit), ""),
            )
            found.append(change)
    results = list(_results(a, b))
    compared["results"] = len(results)
    found += results
    changes = tuple(change for change in found if not _is_same(change))
    same = tuple(change for change in found if _is_same(change))
    return Difference(a.run_id, b.run_id, changes, compared, same)


def _is_same(change: Change) -> bool:
    if change.difference is None:
        return change.first == change.second
    return change.difference == 0.0


@dataclass(frozen=True)
class _Facts:
    """What a run says, its newest analysis per kind, and what each of them rests on."""

    run_id: str
    facts: tuple[Fact, ...]
    analyses: Mapping[str, Analysis]
    grounds: Mapping[str, Grounds]

    def of(self, group: str) -> dict[str, Fact]:
        """The facts of one group by their names."""
        return {fact.name: fact for fact in self.facts if fact.group == group}


def _facts(path: Path) -> _Facts:
    newest = {
        kind: found.analysis
        for kind, found in in_force_by_kind(path).items()
        if found.analysis is not None and found.of_this_run
    }
    recording = open_run(path)
    try:
        facts = run_facts(recording)
        grounds = {kind: grounds_of(recording, analysis) for kind, analysis in newest.items()}
        return _Facts(recording.metadata.run_id or path.name, facts, newest, grounds)
    finally:
        close_recording(recording)


def _results(a: _Facts, b: _Facts) -> Iterable[Change]:
    for kind in dict.fromkeys((*a.analyses, *b.analyses)):
        left, right = a.analyses.get(kind), b.analyses.get(kind)
        if left is None or right is None:
            texts, missing = ("analysed", "not analysed"), b.run_id
            if left is None:
                texts, missing = ("not analysed", "analysed"), a.run_id
            yield Change(
                group="results",
                name=kind,
                first=texts[0],
                second=texts[1],
                note=f"{missing} has no {kind} analysis: rig fit",
            )
            continue
        apart = list(_analysed_otherwise(kind, left, right))
        yield from apart
        other = any(
            change.first != change.second
            for change in apart
            if change.name.split(": ")[1] in _SUBJECT
        )
        common = common_grounds(a.grounds[kind], b.grounds[kind])
        first, second = left.result.estimates, right.result.estimates
        for name in dict.fromkeys((*first, *second)):
            quantity = (left if name in first else right).quantity(name)
            shown = Change(
                group="results",
                name=f"{kind}: {name}",
                first=_value_text(first.get(name), quantity),
                second=_value_text(second.get(name), quantity),
                title=quantity.titled(name),
            )
            yield _compared(
                shown,
                first.get(name),
                second.get(name),
                common,
                quantity=quantity,
                other_subject=other,
            )


def _analysed_otherwise(kind: str, left: Analysis, right: Analysis) -> Iterable[Change]:
    """How the two were analysed: options and settings, the tare, the program's version, the parameter set."""
    tables = [
        {
            **a.result.options,
            **{f"setting {n}": v for n, v in a.content.get("settings", {}).items()},
            "tare": a.content.get("tare", {}).get("run", "none"),
            **{t: a.content[key] for t, key in _PROGRAM_FACTS.items() if key in a.content},
        }
        for a in (left, right)
    ]
    first, second = ({fact.name: fact.value for fact in flat(kind, table)} for table in tables)
    for name in dict.fromkeys((*first, *second)):
        yield Change(
            group="results",
            name=f"{kind}: {name}",
            first=first.get(name, ""),
            second=second.get(name, ""),
        )


def _compared(
    shown: Change,
    first: Estimate | None,
    second: Estimate | None,
    common: frozenset[Ground],
    *,
    quantity: Quantity,
    other_subject: bool,
) -> Change:
    """What the difference of two estimates means, added to how they are shown."""
    if first is None or second is None:
        return replace(shown, note="found in one of the two only")
    unit = first.unit
    shown = replace(shown, unit=unit)
    if math.isnan(first.value + second.value) or unit != second.unit:
        return replace(shown, note="cannot be compared")
    change = _away(quantity, first.value, second.value)
    shown = replace(shown, difference=change)
    combined = combined_uncertainty(first, second, common)
    if combined is None:
        return replace(shown, note="no uncertainty is known")
    text = value_text(change, combined.independent, unit, quantity)
    shown = replace(shown, uncertainty=combined.independent, shown=text)
    unknown = [e for e in (first, second) if e.identifiable == "no"]
    if unknown or other_subject:
        note = "not the same quantity: see how they were analysed"
        if unknown:
            note = "not identifiable from one of the runs"
        return replace(shown, note=note)
    significant = abs(change) > combined.independent
    shown = replace(shown, significant=significant)
    if not combined.shared:
        return shown
    without = abs(change) > combined.own
    causes = " and ".join(combined.shared)
    factor, words = laboratory_unit(unit, max(abs(change), combined.own), quantity.shown)
    note = f"{causes} shared: without it U_c is {number(combined.own / factor, 2)} {words}".rstrip()
    if without != significant:
        note += ", and the difference significant"
    return replace(
        shown, note=note, own_uncertainty=combined.own, significant_without_shared=without
    )


def _away(quantity: Quantity, first: float, second: float) -> float:
    """Second minus first; on the circle the shorter way round, of numbers that agree to all but their
    last digits nothing.
    """
    change = second - first
    if quantity.is_circular:
        change = math.remainder(change, 2.0 * math.pi)
    return 0.0 if abs(change) <= SAME_NUMBER * max(abs(first), abs(second)) else change


def _value_text(estimate: Estimate | None, quantity: Quantity) -> str:
    """A value ± U as the report prints it: in the unit of the laboratory, rounded to two digits of U."""
    if estimate is None or math.isnan(estimate.value):
        return "-"
    doubt = finite(estimate.expanded_uncertainty)
    return value_text(estimate.value, doubt, estimate.unit, quantity)
