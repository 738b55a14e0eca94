"""What stands in a report, as plain values for the template: made from fits, with no markup but the drawings."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from experiments.quantity import key_names
from experiments.result import Result, Verdict
from model.units import printed
from rig.analysis.judging import GearVerdict, doubts_of, held_against, whose_limit
from rig.analysis.rows import (
    budget_grid,
    estimate_grid,
    metric_grid,
    order_grid,
    statistical_grid,
)
from rig.content.data import data_grid
from rig.content.grid import Grid, columns
from rig.content.wording import (
    laboratory_unit,
    number,
    order_label,
    printed_symbol,
    readable,
    show,
)
from rig.present.provenance import Provenance, provenance_of
from rig.program import version

if TYPE_CHECKING:
    from model.gear import HarmonicDrive
    from rig.analysis.fit import Fit

UNFINISHED = {"ABORTED", "TRIPPED", "ERROR", "INTERRUPTED"}
"""Outcomes of runs that did not reach their end."""


@dataclass(frozen=True, kw_only=True)
class VerdictLine:
    """One judged quantity as the page shows it."""

    name: str
    definition: str
    value: str
    limit: str
    source: str
    outcome: str
    run: str


@dataclass(frozen=True)
class Overall:
    """The verdict at the top: a word, its meaning in a sentence, and the class that colours it."""

    word: str
    sentence: str
    style: str


@dataclass(frozen=True, kw_only=True)
class Part:
    """One analysed run in the page."""

    anchor: str
    title: str
    run: str = ""
    grids: tuple[Grid, ...] = ()
    annex: tuple[Grid, ...] = ()
    warnings: tuple[str, ...] = ()
    provenance: Provenance = field(default=Provenance())
    figures: tuple[Any, ...] = ()


def report_number(results: Sequence[Result], hashes: Sequence[str]) -> str:
    """A number that follows from what is reported: the same runs and results give the same number."""
    digest = hashlib.sha256()
    for result, sha in zip(results, hashes, strict=True):
        digest.update(f"{result.run}|{result.kind}|{sha}|".encode())
        digest.update("|".join(f"{n}={e.value:.9g}" for n, e in result.estimates.items()).encode())
    return "HR-" + digest.hexdigest()[:10].upper()


def overall(verdict: GearVerdict, fits: Sequence[Fit] = ()) -> Overall:
    """The verdict in a word and a sentence; a run that did not reach its end is said, never passed over."""
    judged = _count(len(verdict.lines), "limit", "limits")
    sentence = {
        "PASS": f"{judged} kept with the whole expanded uncertainty.",
        "MARGINAL": "At least one limit lies inside the expanded uncertainty of the value: "
        "neither kept nor broken for certain.",
        "FAIL": "At least one quantity breaks its limit by more than its expanded uncertainty.",
        "NOT JUDGED": "Nothing is claimed of the gear; the values stand for themselves.",
    }[verdict.verdict]
    because = f" {'; '.join(verdict.because)}." if verdict.because else ""
    broken = [f.recording.metadata for f in fits if f.recording.metadata.outcome in UNFINISHED]
    runs = ", ".join(f"{m.run_id} ({m.outcome})" for m in broken)
    unfinished = f" Not every run reached its end: {runs}." if runs else ""
    style = "open" if verdict.verdict == "NOT JUDGED" else verdict.verdict.lower()
    return Overall(verdict.verdict, sentence + because + unfinished, style)


def _count(n: int, one: str, many: str) -> str:
    return f"{'One' if n == 1 else n} {one if n == 1 else many}"


def verdict_lines(verdict: GearVerdict) -> tuple[VerdictLine, ...]:
    """Every limit with what it was held against, as `judge` said it."""
    return tuple(_verdict_line(line) for line in verdict.lines)


def _verdict_line(line: Verdict) -> VerdictLine:
    value, limit = held_against(line)
    doubts = "; ".join(words for words in (line.because, line.rests_on) if words)
    because = f" ({doubts})" if doubts else ""
    return VerdictLine(
        name=readable(line.name),
        definition=line.quantity.definition,
        value=value,
        limit=limit,
        source=whose_limit(line) + because,
        outcome=line.outcome,
        run=line.run,
    )


def file_grid(fits: Sequence[Fit]) -> Grid:
    """The run files that the report rests on, the tares among them, with their hashes whole."""
    recordings = [
        r
        for f in fits
        for r in (f.recording, f.tare.recording if f.tare else None)
        if r is not None
    ]
    files = {r.metadata.run_id: r.metadata for r in recordings}
    rows = tuple(
        (m.run_id, m.outcome or "not stated", seal_words(m.is_sealed), m.sha256)
        for _, m in sorted(files.items())
    )
    return run_files(rows)


def run_files(rows: Sequence[tuple[str, str, str, str]]) -> Grid:
    """The table of run files: run, outcome, seal, hash."""
    heads = columns("run", "outcome", "seal", ("SHA-256 of the run file", "hash"))
    return Grid("Run files", heads, rows)


def seal_words(is_sealed: bool) -> str:
    """Whether the hash of a file is the one that was noted when it was sealed."""
    return "sealed" if is_sealed else "NOT SEALED"


def parameter_grid(gear: HarmonicDrive) -> Grid:
    """The whole parameter set with the source of every number, in the units in which a parameter file reads best."""
    from model.gear_file import harmonic_path
    from model.quantities import readable as in_readable_unit

    rows = []
    for v in gear.values():
        texts, unit = in_readable_unit((v.value,), v.unit)
        u = v.origin.standard_uncertainty
        shown_u = number(u * float(texts[0]) / v.value, 2) if u is not None and v.value else ""
        text = (
            number(v.value, 0)
            if v.value == int(v.value) and unit == "1"
            else number(float(texts[0]), 6)
        )
        rows.append(
            (
                v.description,
                printed_symbol(v.symbol),
                text,
                shown_u,
                "" if unit == "1" else printed(unit),
                v.origin.provenance,
                v.origin.source,
            )
        )
    for h in gear.kinematic_error:
        factor, unit = laboratory_unit("rad", h.amplitude)
        origin = gear.origins.get(harmonic_path(h.order))
        u = origin.standard_uncertainty if origin else None
        stated = (origin.provenance, origin.source) if origin else ("", "")
        name = f"kinematic error, order {order_label(h.order, gear.ratio)}: amplitude"
        rows.append(
            (
                name,
                "",
                number(h.amplitude / factor),
                number(u / factor, 2) if u else "",
                unit,
                *stated,
            )
        )
    heads = columns(
        "parameter",
        ("symbol", "symbol"),
        ("value", "number"),
        ("u", "number"),
        ("unit", "unit"),
        "provenance",
        "source",
    )
    return Grid(f"Parameter set {gear.name}", heads, rows)


def parameter_grids(fits: Sequence[Fit]) -> tuple[Grid, ...]:
    """The parameter sets that the analyses leaned on: the first one whole, of the others what differs from it."""
    parameter_sets: list[tuple[HarmonicDrive, list[str]]] = []
    for fit in fits:
        if not fit.leans_on_gear:
            continue
        same = next((kinds for gear, kinds in parameter_sets if gear == fit.gear), None)
        if same is None:
            parameter_sets.append((fit.gear, [fit.result.kind]))
        else:
            same.append(fit.result.kind)
    grids: list[Grid] = []
    whole: Grid | None = None
    for gear, kinds in parameter_sets:
        grid = parameter_grid(gear)
        whole = whole or grid
        title = (
            f"{grid.title}, used for {', '.join(dict.fromkeys(kinds))}"
            if len(parameter_sets) > 1
            else grid.title
        )
        if grid is not whole:
            first = set(whole.rows)
            rows = tuple(row for row in grid.rows if row not in first)
            grid = replace(grid, rows=rows, note="Only what differs from the set above.")
        grids.append(replace(grid, title=title).without_empty())
    return tuple(grids)


LONG_TABLE = 16
"""Rows above which a table of data stands in the annex."""


def part_of(fit: Fit, index: int, title: str) -> Part:
    """One analysed run for the page, its figures still to be drawn."""
    result = fit.result
    orders = [name for name in result.estimates if _is_order(result, name)]
    if len(orders) < 8:
        orders = []
    others = [name for name in result.estimates if name not in orders]
    any_budget = any(e.budget for e in result.estimates.values())
    tables = [data_grid(t) for t in result.tables if t.name != "budget" or not any_budget]
    grids = (
        estimate_grid(result, others).without_empty(),
        order_grid(result, orders),
        metric_grid(result),
        *(grid for grid in tables if len(grid.rows) <= LONG_TABLE),
        budget_grid(result, others),
    )
    annex = (statistical_grid(result), *(grid for grid in tables if len(grid.rows) > LONG_TABLE))
    return Part(
        anchor=f"part-{index + 1}",
        title=title,
        run=result.run,
        grids=tuple(grid for grid in grids if grid is not None and grid.rows),
        annex=tuple(replace(g, title=f"{title}: {g.title}") for g in annex if g.rows),
        warnings=(*doubts_of(fit), *result.warnings),
        provenance=provenance_of(fit),
    )


def _is_order(result: Result, name: str) -> bool:
    """Whether an estimate is one of a series over orders, which stand in a table of their own."""
    return result.quantity(name).placeholder == "order"


def key_results(fits: Sequence[Fit], most: int = 8) -> tuple[tuple[str, str, str, str], ...]:
    """The results that a reader looks for first: kind, quantity, value ± U, identifiable."""
    rows = []
    for result in (fit.result for fit in fits):
        names = key_names(result.quantities, result.estimates)
        names = names or tuple(n for n in result.estimates if not _is_order(result, n))
        for name in names[:most]:
            e, quantity = result.estimates[name], result.quantity(name)
            value = show(e, quantity).with_uncertainty
            rows.append((result.kind, quantity.titled(name), value, e.identifiable))
    return tuple(rows)


def program_version() -> str:
    """Name and version of the program that made the report."""
    return f"harmonic-rig {version()}"
