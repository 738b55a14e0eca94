"""A result in rows: its estimates beside limit and catalogue, its orders, figures of merit, budget, and the truth."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from experiments.quantity import Quantity
from experiments.result import Result, Verdict
from rig.analysis.judging import held_against, whose_limit
from rig.content.grid import Grid, columns, number_columns
from rig.content.phrase import phrase, yes_or_no
from rig.content.wording import STATISTICAL_PART, laboratory_unit, metric_text, number, show

if TYPE_CHECKING:
    from experiments.truth import TruthRow
    from model.gear import HarmonicDrive
    from model.identify.estimate import Estimate

VALUE = "value ± U (95 %)"
LIMIT = "limit or catalogue"


def estimate_grid(
    result: Result,
    names: Collection[str] | None = None,
    *,
    lines: Sequence[Verdict] = (),
    gear: HarmonicDrive | None = None,
) -> Grid:
    """Every estimate (or those of these names) as value ± U with its unit, and whether the data determine it.

    `lines` are the limits that it was held against, judged; `gear` knows what the catalogue says where there is none.
    """
    judged = {line.estimate.name: line for line in lines}
    rows = []
    for name, estimate in result.estimates.items():
        if names is not None and name not in names:
            continue
        quantity, line = result.quantity(name), judged.get(name)
        shown = show(estimate, quantity)
        words = _catalogue_words(quantity, estimate, gear)
        if line is not None:
            words = f"{line.outcome} {limit_words(line)}"
        known = (estimate.identifiable, words, estimate.note)
        rows.append((quantity.titled(name), shown.pair, shown.unit, *known))
    heads = columns(
        ("quantity", "quantity"),
        (VALUE, "number"),
        ("unit", "unit"),
        ("identifiable", "word"),
        (LIMIT, "word"),
        "remark",
    )
    return Grid("Results", heads, rows)


def proof_words(result: Result) -> str:
    """What a run along a compensation table proved; "" of every other result."""
    proof, removed = result.options.get("proof"), result.metrics.get("removed")
    if proof is None or removed is None:
        return ""
    return f"{proof}; takes out {100.0 * removed:.0f} % as seen"


def limit_words(line: Verdict) -> str:
    """The limit that a quantity was held against, and whose limit it is."""
    return f"({held_against(line)[1]}, {whose_limit(line)}{phrase('; {}', line.because)})"


def _catalogue_words(quantity: Quantity, estimate: Estimate, gear: HarmonicDrive | None) -> str:
    """The value of the catalogue, where it is from and under which conditions it holds; "" where there is none."""
    if quantity.catalogue is None or gear is None:
        return ""
    value = gear.value(f"ratings.{quantity.catalogue.rating}")
    factor, unit = laboratory_unit(value.unit, estimate.value, quantity.shown)
    source = f"{value.origin.provenance}: {value.origin.source}".rstrip(": ")
    return f"catalogue {number(value.value / factor)} {unit} ({source})"


def statistical_grid(result: Result) -> Grid:
    """The 95 % intervals of the data alone, k and degrees of freedom of every U."""
    rows = []
    for name, estimate in result.estimates.items():
        shown = show(estimate, result.quantity(name))
        interval = f"{shown.low} … {shown.high}"
        title = result.quantity(name).titled(name)
        rows.append((title, interval, shown.unit, *coverage(estimate)))
    heads = columns(
        ("quantity", "quantity"),
        (STATISTICAL_PART, "number"),
        ("unit", "unit"),
        ("k of U", "number"),
        ("degrees of freedom", "number"),
    )
    return Grid("Statistical part", heads, rows)


def coverage(estimate: Estimate) -> tuple[str, str]:
    """k and the degrees of freedom of a number as text; nothing for one that is none."""
    if not math.isfinite(estimate.value):
        return "–", "–"
    freedom = estimate.degrees_of_freedom
    return number(estimate.coverage_factor, 3), number(freedom, 3) if freedom < 1e4 else "∞"


def budget_grid(result: Result, names: Collection[str]) -> Grid | None:
    """What makes up the uncertainty of each quantity, the largest part first; of one quantity alone part by part."""
    estimates = [e for n, e in result.estimates.items() if n in names and e.budget]
    if not estimates:
        return None
    lines = [line for estimate in estimates for line in estimate.budget]
    remarks = "; ".join(dict.fromkeys(f"{line.source}: {line.note}" for line in lines if line.note))
    note = "Standard uncertainties, type A or B; u is their root sum of squares. "
    note = f"{note}{remarks[:1].upper()}{remarks[1:]}".strip()
    title = "Uncertainty budget"
    (who, unit), parts, whole = _parts(result.quantity(estimates[0].name), estimates[0])
    if len(estimates) == 1:
        heads = columns("source (type)", (f"{who} [{unit}]".removesuffix(" []"), "number"))
        return Grid(title, heads, (*parts, ("u", whole[0]), ("U (95 %)", whole[1])), note)
    heads = (
        *columns(("quantity", "quantity"), ("unit", "unit")),
        *number_columns("u", "U (95 %)"),
        *columns(("made up of, the largest first", "sentence")),
    )
    rows = []
    for estimate in estimates:
        named, parts, whole = _parts(result.quantity(estimate.name), estimate, least=_NAMED)
        rows.append((*named, *whole, "; ".join(f"{source}: {u}" for source, u in parts)))
    return Grid(title, heads, rows, note)


_NAMED = 0.05
"""Share of u from which on a part is named where many quantities stand together: less than it adds 0.2 % to u."""


def _parts(
    quantity: Quantity, estimate: Estimate, least: float = 0.0
) -> tuple[tuple[str, str], list[tuple[str, str]], tuple[str, str]]:
    """Name and unit of one quantity, its standard uncertainties by source, the combined and the expanded one.

    Several that are below `least` of the combined one stand together, in the last place.
    """
    size = max(abs(estimate.value), estimate.expanded_uncertainty)
    factor, unit = laboratory_unit(estimate.unit, size, quantity.shown)
    shares: dict[str, float] = {}
    for line in estimate.budget:
        key = f"{line.source} ({line.kind})"
        shares[key] = math.hypot(shares.get(key, 0.0), line.standard_uncertainty)
    small = [key for key, u in shares.items() if u < least * estimate.standard_uncertainty]
    if len(small) > 1:
        together = math.hypot(*(shares.pop(key) for key in small))
        shares[f"{len(small)} smaller ones together"] = together
    largest_first = sorted(shares.items(), key=lambda one: -one[1])
    parts = [(source, number(u / factor, 2)) for source, u in largest_first]
    whole = (estimate.standard_uncertainty, estimate.expanded_uncertainty)
    combined, expanded = (number(size / factor, 2) for size in whole)
    return (quantity.titled(estimate.name), unit), parts, (combined, expanded)


def metric_grid(result: Result) -> Grid:
    """The figures of merit; what both directions have stands side by side."""
    ways = ("forward", "reverse")
    rows: dict[str, list[str]] = {}
    for name, value in result.metrics.items():
        quantity = result.quantity(name)
        way = quantity.member(name)
        title, place = quantity.titled(name), 0
        if way in ways:
            title, place = quantity.family_title, ways.index(way)
        rows.setdefault(title, ["", ""])[place] = metric_text(quantity, float(value))
    values = "value, or forward" if any(cells[1] for cells in rows.values()) else "value"
    heads = columns("figure of merit", (values, "number"), ("reverse", "number"))
    lines = [(title, *cells) for title, cells in rows.items()]
    return Grid("Figures of merit", heads, lines).without_empty()


def order_grid(result: Result, names: Collection[str]) -> Grid:
    """The orders of a series, one per row: amplitude and phase with their expanded uncertainties."""
    rows = []
    for name, amplitude in result.estimates.items():
        if name not in names or not name.startswith("amplitude_"):
            continue
        label = name.removeprefix("amplitude_")
        shown = show(amplitude, result.quantity(name))
        phase = result.estimates.get(f"phase_{label}")
        angle = show(phase, result.quantity(phase.name)).pair if phase else ""
        rows.append((label, shown.pair, shown.unit, angle, amplitude.identifiable))
    heads = columns(
        "order",
        ("amplitude ± U (95 %)", "number"),
        ("unit", "unit"),
        ("phase ± U (95 %) [°]", "number"),
        ("identifiable", "word"),
    )
    return Grid("Orders, amplitude and phase", heads, rows)


def truth_grid(rows: Sequence[tuple[str, TruthRow]], results: Sequence[Result]) -> Grid:
    """Identified against true values of a simulated gear: kind of fit and row; `results` are those of the fits."""
    of_kind = {result.kind: result for result in results}
    lines = []
    for kind, row in rows:
        estimate, u = row.estimate, row.estimate.expanded_uncertainty
        quantity = of_kind[kind].quantity(estimate.name)
        shown = show(estimate, quantity)
        lines.append(
            (
                kind,
                quantity.titled(estimate.name),
                shown.pair,
                shown.unit,
                shown.number(estimate.value - row.error),
                number(abs(row.error) / u, 2) if u > 0 else "–",
                yes_or_no(row.within),
                shown.number(estimate.value - row.difference),
                yes_or_no(row.covered),
            )
        )
    heads = columns(
        "test",
        ("quantity", "quantity"),
        ("found ± U", "number"),
        ("unit", "unit"),
        ("measurand", "number"),
        ("|Δ| / U", "number"),
        ("within U", "word"),
        ("this bench sees", "number"),
        ("in the statistical part", "word"),
    )
    return Grid("Found against the simulator's truth", heads, lines)
