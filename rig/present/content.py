"""What stands in a report, as plain values for the template: made from fits, with no markup but the drawings."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from experiments.quantity import Quantity, key_names
from experiments.result import Result, Verdict
from model.units import printed
from rig.analysis.judging import GearVerdict, doubts_of, held_against, whose_limit
from rig.analysis.wording import (
    STATISTICAL_PART,
    laboratory_unit,
    metric_text,
    number,
    order_label,
    printed_symbol,
    readable,
    show,
)
from rig.present.columns import column
from rig.present.provenance import Provenance, provenance_of
from rig.program import version

if TYPE_CHECKING:
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from model.identify.estimate import Estimate
    from rig.analysis.fit import Fit

UNFINISHED = {"ABORTED", "TRIPPED", "ERROR", "INTERRUPTED"}
"""Outcomes of runs that did not reach their end."""


@dataclass(frozen=True)
class Grid:
    """A table for the page: headings, rows of text, which columns are numbers, and a remark."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]
    note: str = ""
    hashes: tuple[str, ...] = ()
    """Headings of columns of hashes: compared letter by letter, they stand in one line, all letters of one width."""


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
    run: str
    word: str
    estimates: Grid | None
    orders: Grid | None
    budget: Grid | None
    metrics: Grid | None
    tables: tuple[Grid, ...]
    annex: tuple[Grid, ...]
    warnings: tuple[str, ...]
    provenance: Provenance
    figures: tuple[Any, ...] = field(default=())


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
    because = f" ({line.because})" if line.because else ""
    return VerdictLine(
        name=readable(line.name),
        definition=line.quantity.definition,
        value=value,
        limit=limit,
        source=whose_limit(line) + because,
        outcome=line.outcome,
        run=line.run,
    )


def estimate_grid(title: str, result: Result, estimates: Mapping[str, Estimate]) -> Grid | None:
    """Value ± U, unit, identifiability, remark."""
    if not estimates:
        return None
    rows = []
    for name, estimate in estimates.items():
        quantity = result.quantity(name)
        s = show(estimate, quantity)
        rows.append(
            (
                quantity.titled(name),
                s.value,
                s.expanded or "–",
                s.unit,
                estimate.identifiable,
                estimate.note,
            )
        )
    columns = ("Quantity", "Value", "± U (95 %)", "Unit", "Identifiable", "Remark")
    return without_empty(
        Grid(title, columns, tuple(rows), (False, True, True, False, False, False))
    )


def statistical_grid(result: Result, estimates: Mapping[str, Estimate]) -> Grid | None:
    """For the annex: the 95 % intervals of the data alone, k and degrees of freedom of every U."""
    rows = []
    for name, estimate in estimates.items():
        quantity = result.quantity(name)
        s = show(estimate, quantity)
        freedom = estimate.degrees_of_freedom
        rows.append(
            (
                quantity.titled(name),
                f"{s.low} … {s.high}",
                s.unit,
                number(estimate.coverage_factor, 3),
                number(freedom, 3) if freedom < 1e4 else "∞",
            )
        )
    columns = ("Quantity", STATISTICAL_PART.capitalize(), "Unit", "k of U", "Degrees of freedom")
    if not rows:
        return None
    return Grid("Statistical part", columns, tuple(rows), (False, True, False, True, True))


def budget_grid(result: Result, estimates: Mapping[str, Estimate]) -> Grid | None:
    """Standard uncertainties by source, its type beside it; what there is more of, quantities or
    sources, goes down the page.
    """
    with_budget = {n: e for n, e in estimates.items() if e.budget}
    sources = list(
        dict.fromkeys((b.source, b.kind) for e in with_budget.values() for b in e.budget)
    )
    if not sources:
        return None
    columns = [
        _budget_column(result.quantity(name), estimate, sources)
        for name, estimate in with_budget.items()
    ]
    heads = (*(f"{source} ({kind})" for source, kind in sources), "u", "U (95 %)")
    notes = dict.fromkeys(
        f"{b.source}: {b.note}" for e in with_budget.values() for b in e.budget if b.note
    )
    remarks = "; ".join(notes)
    note = (
        "Standard uncertainties by source, type A or B; u is their root sum of squares. "
        f"{remarks[:1].upper()}{remarks[1:]}"
    ).strip()
    if len(heads) <= len(columns) + 1:
        lines = tuple((name, unit, *cells) for name, unit, cells in columns)
        return Grid(
            "Uncertainty budget",
            ("Quantity", "Unit", *heads),
            lines,
            (False, False, *([True] * len(heads))),
            note,
        )
    titles = tuple(f"{name} [{unit}]" if unit else name for name, unit, _ in columns)
    lines = tuple((head, *(cells[k] for _, _, cells in columns)) for k, head in enumerate(heads))
    return Grid(
        "Uncertainty budget",
        ("Source (type)", *titles),
        lines,
        (False, *([True] * len(columns))),
        note,
    )


def _budget_column(
    quantity: Quantity, estimate: Estimate, sources: Sequence[tuple[str, str]]
) -> tuple[str, str, tuple[str, ...]]:
    """Name, unit and standard uncertainties of one quantity: by source, combined, expanded."""
    size = max(abs(estimate.value), estimate.expanded_uncertainty)
    factor, unit = laboratory_unit(estimate.unit, size, quantity.shown)
    shares: dict[tuple[str, str], float] = {}
    for line in estimate.budget:
        key = (line.source, line.kind)
        shares[key] = math.hypot(shares.get(key, 0.0), line.standard_uncertainty)
    sizes = (
        *(shares.get(source) for source in sources),
        estimate.standard_uncertainty,
        estimate.expanded_uncertainty,
    )
    return (
        quantity.titled(estimate.name),
        unit,
        tuple("·" if size is None else number(size / factor, 2) for size in sizes),
    )


def data_grid(table: Any) -> Grid:
    """A table of an analysis as text."""
    columns = [
        column(title, [row[i] for row in table.rows]) for i, title in enumerate(table.columns)
    ]
    rows = tuple(tuple(texts[k] for _, texts, _ in columns) for k in range(len(table.rows)))
    return Grid(
        table.title,
        tuple(title for title, _, _ in columns),
        rows,
        tuple(numeric for _, _, numeric in columns),
        table.note,
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
    columns = ("Run", "Outcome", "Seal", "SHA-256 of the run file")
    return Grid("Run files", columns, tuple(rows), (False,) * len(columns), hashes=columns[3:])


def seal_words(is_sealed: bool) -> str:
    """Whether the hash of a file is the one that was noted when it was sealed."""
    return "sealed" if is_sealed else "NOT SEALED"


def without_empty(grid: Grid) -> Grid:
    """The grid without the columns that say nothing."""
    full = [i for i in range(len(grid.columns)) if any(row[i] for row in grid.rows)]
    if len(full) == len(grid.columns) or not full:
        return grid
    return replace(
        grid,
        columns=tuple(grid.columns[i] for i in full),
        numeric=tuple(grid.numeric[i] for i in full),
        rows=tuple(tuple(row[i] for i in full) for row in grid.rows),
    )


def metric_grid(result: Result) -> Grid | None:
    """The figures of merit in words; what both directions have stands side by side."""
    if not result.metrics:
        return None
    ways = ("forward", "reverse")
    rows: dict[str, list[str]] = {}
    for name, value in result.metrics.items():
        quantity = result.quantity(name)
        way = quantity.member(name)
        title = quantity.family_title if way in ways else quantity.titled(name)
        column = ways.index(way) if way in ways else 0
        rows.setdefault(title, ["", ""])[column] = metric_text(quantity, float(value))
    if any(cells[1] for cells in rows.values()):
        lines = tuple((title, *cells) for title, cells in rows.items())
        return Grid(
            "Figures of merit",
            ("Figure of merit", "Value, or forward", "Reverse"),
            lines,
            (False, True, True),
        )
    lines = tuple((title, cells[0]) for title, cells in rows.items())
    return Grid("Figures of merit", ("Figure of merit", "Value"), lines, (False, True))


def order_grid(result: Result, estimates: Mapping[str, Estimate]) -> Grid | None:
    """The orders of a series, one per row: amplitude and phase with their expanded uncertainties."""
    rows = []
    for name, amplitude in estimates.items():
        if not name.startswith("amplitude_"):
            continue
        label = name.removeprefix("amplitude_")
        a = show(amplitude, result.quantity(name))
        phase = estimates.get(f"phase_{label}")
        p = show(phase, result.quantity(phase.name)) if phase else None
        angle = (p.value, p.expanded or "–") if p else ("", "")
        rows.append(
            (
                label,
                a.value,
                a.expanded or "–",
                a.unit,
                *angle,
                amplitude.identifiable,
            )
        )
    if not rows:
        return None
    columns = (
        "Order",
        "Amplitude",
        "± U (k = 2)",
        "Unit",
        "Phase [°]",
        "± U (k = 2)",
        "Identifiable",
    )
    numeric = (False, True, True, False, True, True, False)
    return Grid("Orders, amplitude and phase", columns, tuple(rows), numeric)


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
    columns = ("Parameter", "Symbol", "Value", "u", "Unit", "Provenance", "Source")
    numeric = (False, False, True, True, False, False, False)
    return Grid(f"Parameter set {gear.name}", columns, tuple(rows), numeric)


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
        grids.append(without_empty(replace(grid, title=title)))
    return tuple(grids)


def truth_grid(rows: Sequence[tuple[str, TruthRow]], results: Sequence[Result]) -> Grid:
    """Identified against true values of a simulated gear: kind of fit and row; `results` are those of the fits."""
    of_kind = {result.kind: result for result in results}
    lines = []
    for kind, row in rows:
        e = row.estimate
        quantity = of_kind[kind].quantity(e.name)
        s = show(e, quantity)
        u = e.expanded_uncertainty
        lines.append(
            (
                kind,
                quantity.titled(e.name),
                s.value,
                s.expanded or "–",
                s.unit,
                s.number(e.value - row.error),
                number(abs(row.error) / u, 2) if u > 0 else "–",
                "yes" if row.within else "no",
                s.number(e.value - row.difference),
                "yes" if row.covered else "no",
            )
        )
    columns = (
        "Test",
        "Quantity",
        "Found",
        "± U",
        "Unit",
        "Measurand",
        "|Δ| / U",
        "Within U",
        "This bench sees",
        "In the statistical part",
    )
    numeric = (False, False, True, True, False, True, True, False, True, False)
    return Grid("Found against the simulator's truth", columns, tuple(lines), numeric)


LONG_TABLE = 16
"""Rows above which a table of data stands in the annex."""


def part_of(fit: Fit, index: int, title: str) -> Part:
    """One analysed run for the page, its figures still to be drawn."""
    result = fit.result
    orders = {n: e for n, e in result.estimates.items() if _is_order(result, n)}
    if len(orders) < 8:
        orders = {}
    others = {n: e for n, e in result.estimates.items() if n not in orders}
    any_budget = any(e.budget for e in result.estimates.values())
    grids = [data_grid(t) for t in result.tables if t.name != "budget" or not any_budget]
    return Part(
        anchor=f"part-{index + 1}",
        title=title,
        run=result.run,
        word=fit.recording.metadata.origin,
        estimates=estimate_grid("Results", result, others),
        orders=order_grid(result, orders),
        budget=budget_grid(result, others),
        metrics=metric_grid(result),
        tables=tuple(g for g in grids if len(g.rows) <= LONG_TABLE),
        annex=tuple(
            replace(g, title=f"{title}: {g.title}")
            for g in (statistical_grid(result, result.estimates), *grids)
            if g is not None and (len(g.rows) > LONG_TABLE or g.title == "Statistical part")
        ),
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
