"""What stands in a report, as plain values for the template: made from fits, with no markup but the drawings."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from experiments.result import Result
from rig.report.wording import display_unit, metric, number, pretty, readable, show

if TYPE_CHECKING:
    from experiments.recording import Recording
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from model.identify.estimate import Estimate
    from rig.fit import Fit

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


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class Provenance:
    """Where one run comes from."""

    rows: tuple[tuple[str, str], ...] = ()
    conditions: tuple[tuple[str, str], ...] = ()
    settings: tuple[tuple[str, str], ...] = ()
    options: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Matrix:
    """The same facts of several runs side by side: one column per run, one row per fact."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class Part:
    """One analysed run in the page."""

    anchor: str
    title: str
    run: str
    word: str
    estimates: Grid | None
    orders: Grid | None
    budget: Grid | None
    metrics: tuple[tuple[str, str], ...]
    tables: tuple[Grid, ...]
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


def overall(fits: Sequence[Fit]) -> Overall:
    """The worst of all verdicts; an unfinished run or the lack of a verified limit is said, never passed over."""
    outcomes = [v.outcome for f in fits for v in f.result.verdicts]
    broken = [f.recording.metadata for f in fits if f.recording.metadata.outcome in UNFINISHED]
    judged = [o for o in outcomes if o != "no verified limit"]
    unjudged = len(outcomes) - len(judged)
    aside = f" {_count(unjudged, 'quantity has', 'quantities have')} no verified limit." if unjudged else ""
    if broken:
        runs = ", ".join(f"{m.run_id} ({m.outcome})" for m in broken)
        return Overall(
            "INCOMPLETE", f"Not every run reached its end: {runs}. What was recorded is reported.{aside}", "open"
        )
    if not judged:
        why = aside.strip() or "No quantity of these runs was held against a limit."
        return Overall("NOT JUDGED", f"{why} The values stand for themselves.", "open")
    worst = next(word for word in ("FAIL", "MARGINAL", "PASS") if word in judged)
    sentence = {
        "PASS": f"{_count(len(judged), 'judged quantity keeps its limit', 'judged quantities keep their limits')} "
        "with the whole expanded uncertainty.",
        "MARGINAL": "At least one limit lies inside the expanded uncertainty of the value: neither kept nor broken for certain.",
        "FAIL": "At least one quantity breaks its limit by more than its expanded uncertainty.",
    }[worst]
    return Overall(worst, sentence + aside, worst.lower())


def _count(n: int, one: str, many: str) -> str:
    return f"{'One' if n == 1 else n} {one if n == 1 else many}"


def verdict_lines(fits: Sequence[Fit]) -> tuple[VerdictLine, ...]:
    """Every verdict of every run."""
    lines = []
    for fit in fits:
        for v in fit.result.verdicts:
            factor, unit = display_unit(v.estimate.name, v.estimate.unit, v.estimate.value)
            limit = f"≤ {number(v.limit / factor)} {unit}".rstrip()
            source = f"{v.limit_provenance}: {v.limit_source}" if v.limit_source else v.limit_provenance
            value = show(v.estimate).with_uncertainty
            lines.append(VerdictLine(readable(v.name), v.definition, value, limit, source, v.outcome, fit.result.run))
    return tuple(lines)


def estimate_grid(title: str, estimates: Mapping[str, Estimate]) -> Grid | None:
    """Value ± U, unit, interval, identifiability, remark."""
    if not estimates:
        return None
    rows = []
    for name, estimate in estimates.items():
        s = show(estimate)
        interval = f"{s.low} … {s.high}"
        rows.append(
            (readable(name), s.value, s.expanded or "–", s.unit, interval, estimate.identifiable, estimate.note)
        )
    columns = ("Quantity", "Value", "± U (k = 2)", "Unit", "95 % interval", "Identifiable", "Remark")
    return _without_empty(Grid(title, columns, tuple(rows), (False, True, True, False, True, False, False)))


def budget_grid(estimates: Mapping[str, Estimate]) -> Grid | None:
    """Standard uncertainties: a row per quantity, a column per source, its type beside it."""
    with_budget = {n: e for n, e in estimates.items() if e.budget}
    sources = list(dict.fromkeys((b.source, b.kind) for e in with_budget.values() for b in e.budget))
    if not sources:
        return None
    rows = []
    for name, estimate in with_budget.items():
        size = max(abs(estimate.value), estimate.expanded_uncertainty)
        factor, unit = display_unit(estimate.name, estimate.unit, size)
        found: dict[tuple[str, str], float] = {}
        for line in estimate.budget:
            key = (line.source, line.kind)
            found[key] = (found.get(key, 0.0) ** 2 + line.standard_uncertainty**2) ** 0.5
        cells = (number(found[s] / factor, 2) if s in found else "·" for s in sources)
        combined = number(estimate.standard_uncertainty / factor, 2)
        expanded = number(estimate.expanded_uncertainty / factor, 2)
        rows.append((readable(name), unit, *cells, combined, expanded))
    columns = ("Quantity", "Unit", *(f"{source} ({kind})" for source, kind in sources), "u", "U (k = 2)")
    notes = dict.fromkeys(f"{b.source}: {b.note}" for e in with_budget.values() for b in e.budget if b.note)
    note = "Standard uncertainties by source, type A or B; u is their root sum of squares. " + "; ".join(notes)
    return Grid(
        "Uncertainty budget", columns, tuple(rows), (False, False, *([True] * (len(sources) + 2))), note.strip()
    )


def data_grid(table: Any) -> Grid:
    """A table of an analysis as text."""
    numeric = tuple(
        all(isinstance(row[i], (int, float)) and not isinstance(row[i], bool) for row in table.rows)
        for i in range(len(table.columns))
    )
    rows = tuple(tuple(number(cell) for cell in row) for row in table.rows)
    return Grid(table.title, tuple(table.columns), rows, numeric, table.note)


def _without_empty(grid: Grid) -> Grid:
    """The grid without a last column that says nothing."""
    if any(row[-1] for row in grid.rows):
        return grid
    return Grid(grid.title, grid.columns[:-1], tuple(r[:-1] for r in grid.rows), grid.numeric[:-1], grid.note)


def metric_rows(result: Result) -> tuple[tuple[str, str], ...]:
    """The metrics of a result in words."""
    return tuple((readable(name), metric(name, float(value))) for name, value in result.metrics.items())


def conditions_of(recording: Recording, gear: HarmonicDrive) -> tuple[tuple[str, str], ...]:
    """What prevailed during a run: speeds, duration, temperatures, load inertia, cycles, and what the operator noted."""
    import numpy as np

    from model.units import RPM

    rows: list[tuple[str, str]] = []
    turning = [abs(s.setpoint) for s in recording.segments if s.direction and s.setpoint]
    if turning:
        low, high = number(min(turning) / RPM), number(max(turning) / RPM)
        both = {s.direction for s in recording.segments} >= {1, -1}
        speeds = f"{low} r/min" if low == high else f"{low} to {high} r/min"
        rows.append(("Input speeds", speeds + (", both directions" if both else "")))
    if recording.rows > 1:
        seconds = float(recording.time(slice(recording.rows - 1, recording.rows))[0])
        rows.append(("Duration", f"{number(seconds)} s in {number(recording.rows)} cycles"))
    rate = recording.metadata.sample_rate
    if np.isfinite(rate):
        rows.append(("Sampling", f"{number(float(rate))} Hz; time base: {recording.metadata.time_base}"))
    rows.append(("Incomplete cycles", _missed(recording)))
    for channel, words in (
        ("housing_temperature", "Housing temperature"),
        ("ambient_temperature", "Ambient temperature"),
    ):
        if recording.has(channel):
            rows.append((words, _range(recording, channel, "°C")))
    inertia = gear.value("inertia.output")
    source = f"{inertia.origin.provenance}: {inertia.origin.source}".rstrip(": ")
    rows.append(("Load inertia J_o", f"{number(inertia.value)} kg m² ({source})"))
    rows.extend((readable(str(k)).capitalize(), _text(v)) for k, v in recording.metadata.conditions.items())
    return tuple(rows)


def _missed(recording: Recording) -> str:
    missed = sum(int((recording.flags(block) & 1 != 0).sum()) for block in recording.blocks())
    return f"{number(missed)} of {number(recording.rows)}"


def _range(recording: Recording, channel: str, unit: str) -> str:
    import numpy as np

    low, high = np.inf, -np.inf
    for block in recording.blocks():
        values = recording.si(channel, block)
        values = values[np.isfinite(values)]
        if len(values):
            low, high = min(low, float(values.min())), max(high, float(values.max()))
    if low > high:
        return "not recorded"
    return f"{low:.1f} to {high:.1f} {unit}" if high - low >= 0.05 else f"{low:.1f} {unit}"


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return "; ".join(f"{readable(str(k))}: {_text(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(v) for v in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value, 6)


def provenance_of(fit: Fit) -> Provenance:
    """The run's identity and how it was analysed."""
    m = fit.recording.metadata
    rows = [
        ("Run", m.run_id),
        ("Protocol", m.experiment or "none (recording from another rig)"),
        ("Origin", m.origin),
        ("Outcome of the run", m.outcome or "not stated"),
        ("Started", m.start_time or "not stated"),
        ("Ended", m.end_time or "not stated"),
        ("Operator", m.operator or "not stated"),
        ("Gear", f"{fit.gear.name}, serial {m.gear_serial or 'not stated'}" if m.gear_mounted else "none mounted"),
        ("Mounting", m.mounting.replace("-", " ")),
        ("File", fit.path.name if fit.path else "in memory"),
        ("Analysis", fit.stored or "not stored"),
        ("SHA-256", m.sha256 or "not sealed"),
        ("Tare", f"run {fit.tare.recording.metadata.run_id}" if fit.tare else "none"),
    ]
    rows.extend((readable(str(key)).capitalize(), _text(value)) for key, value in _process(m.process))
    settings = tuple((readable(str(k)), _text(v)) for k, v in (*m.parameters.items(), *fit.settings.items()))
    options = tuple((readable(str(k)), _text(v)) for k, v in fit.result.options.items())
    return Provenance(tuple(rows), conditions_of(fit.recording, fit.gear), settings, options)


def _process(process: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """What the run file says about how it was made, without long texts and the truth of a simulated rig."""
    return [
        (k, v) for k, v in process.items()
        if k not in ("truth", "experiment", "parameters") and not isinstance(v, Mapping) and len(str(v)) <= 200
    ]  # fmt: skip


MATRIX_COLUMNS = 4
"""Runs that fit side by side on A4."""


def side_by_side(parts: Sequence[Part], what: str, caption: str = "") -> tuple[Matrix, ...]:
    """One field of the provenance of all parts, at most four runs to a table."""
    made = []
    for first in range(0, len(parts), MATRIX_COLUMNS):
        some = [p for p in parts[first : first + MATRIX_COLUMNS] if getattr(p.provenance, what)]
        facts = [dict(getattr(p.provenance, what)) for p in some]
        names = list(dict.fromkeys(name for f in facts for name in f))
        rows = tuple((name, tuple(f.get(name, "–") for f in facts)) for name in names)
        if rows:
            made.append(Matrix(caption, tuple(p.title for p in some), rows))
    return tuple(made)


def parameter_grid(gear: HarmonicDrive) -> Grid:
    """The whole parameter set with the source of every number, in the units in which a parameter file reads best."""
    from model.gear_file import harmonic_path
    from model.quantities import readable as in_readable_unit

    rows = []
    for v in gear.values():
        texts, unit = in_readable_unit((v.value,), v.unit)
        u = v.origin.standard_uncertainty
        shown_u = number(u * float(texts[0]) / v.value, 2) if u is not None and v.value else ""
        text = number(v.value, 0) if v.value == int(v.value) and unit == "1" else number(float(texts[0]), 6)
        rows.append(
            (
                v.description,
                v.symbol,
                text,
                shown_u,
                "" if unit == "1" else pretty(unit),
                v.origin.provenance,
                v.origin.source,
            )
        )
    for h in gear.kinematic_error:
        factor, unit = display_unit("amplitude", "rad", h.amplitude)
        origin = gear.origins.get(harmonic_path(h.order))
        u = origin.standard_uncertainty if origin else None
        known = (origin.provenance, origin.source) if origin else ("", "")
        name = f"kinematic error, order {number(h.order, 6)}: amplitude"
        rows.append((name, "", number(h.amplitude / factor), number(u / factor, 2) if u else "", unit, *known))
    columns = ("Parameter", "Symbol", "Value", "u", "Unit", "Provenance", "Source")
    numeric = (False, False, True, True, False, False, False)
    if not any(row[3] for row in rows):
        columns, numeric = columns[:3] + columns[4:], numeric[:3] + numeric[4:]
        rows = [row[:3] + row[4:] for row in rows]
    return Grid(f"Parameter set {gear.name}", columns, tuple(rows), numeric)


def truth_grid(rows: Sequence[tuple[str, TruthRow]]) -> Grid:
    """Identified against true values of a simulated gear: kind of fit and row."""
    made = []
    for kind, row in rows:
        e = row.estimate
        s = show(e)
        u = e.expanded_uncertainty
        distance = number(abs(row.difference) / u, 2) if u > 0 else "–"
        inside = ("yes" if row.covered else "no", "yes" if row.within else "no")
        truth = s.number(e.value - row.difference)
        made.append((kind, readable(e.name), s.value, s.expanded or "–", truth, s.unit, distance, *inside))
    columns = ("Test", "Quantity", "Found", "± U", "Truth", "Unit", "|Δ| / U", "In the 95 % interval", "Within U")
    numeric = (False, False, True, True, True, False, True, False, False)
    return Grid("Found against the simulator's truth", columns, tuple(made), numeric)


_ORDER_ROW = re.compile(r"(amplitude|phase|cosine|sine|a|b)[_ ]?(order)?[_ ]?\d|_order_|\border\b")


def part_of(fit: Fit, index: int, title: str) -> Part:
    """One analysed run for the page, its figures still to be drawn."""
    result = fit.result
    orders = {n: e for n, e in result.estimates.items() if _ORDER_ROW.match(n)}
    if len(orders) < 8:
        orders = {}
    others = {n: e for n, e in result.estimates.items() if n not in orders}
    any_budget = any(e.budget for e in result.estimates.values())
    return Part(
        anchor=f"part-{index + 1}",
        title=title,
        run=result.run,
        word=fit.recording.metadata.origin,
        estimates=estimate_grid("Results", others),
        orders=estimate_grid("Orders", orders),
        budget=budget_grid(others),
        metrics=metric_rows(result),
        tables=tuple(data_grid(t) for t in result.tables if t.name != "budget" or not any_budget),
        warnings=result.warnings,
        provenance=provenance_of(fit),
    )


def key_results(fits: Sequence[Fit], most: int = 6) -> tuple[tuple[str, str, str, str], ...]:
    """The results that a reader looks for first: kind, quantity, value ± U, identifiable; those with a verdict lead."""
    rows = []
    for fit in fits:
        judged = [v.estimate.name for v in fit.result.verdicts]
        plain = [n for n, e in fit.result.estimates.items() if not _ORDER_ROW.match(n) and e.identifiable != "no"]
        names = [n for n in plain if n in judged] + [n for n in plain if n not in judged]
        for name in names[:most]:
            e = fit.result.estimates[name]
            rows.append((fit.result.kind, readable(name), show(e).with_uncertainty, e.identifiable))
    return tuple(rows)


def program_version() -> str:
    """Name and version of the program that made the report."""
    from rig import results

    return f"harmonic-rig {results.program_version()}"
