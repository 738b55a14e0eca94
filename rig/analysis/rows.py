"""A result in rows: its estimates beside limit and catalogue, its orders, figures of merit, budget, and the truth."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from experiments.quantity import Quantity
from experiments.result import Result, Verdict
from rig.analysis.judging import held_against, whose_limit
from rig.content.grid import Grid, columns, number_columns
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
    because = f"; {line.because}" if line.because else ""
    return f"({held_against(line)[1]}, {whose_limit(line)}{because})"


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
    """Standard uncertainties by source, its type beside it; what there is more of, quantities or
    sources, goes down the page.
    """
    estimates = [e for n, e in result.estimates.items() if n in names and e.budget]
    lines = [line for estimate in estimates for line in estimate.budget]
    sources = list(dict.fromkeys((line.source, line.kind) for line in lines))
    if not sources:
        return None
    shares = [_shares(result.quantity(e.name), e, sources) for e in estimates]
    heads = (*(f"{source} ({kind})" for source, kind in sources), "u", "U (95 %)")
    remarks = "; ".join(dict.fromkeys(f"{line.source}: {line.note}" for line in lines if line.note))
    note = "Standard uncertainties by source, type A or B; u is their root sum of squares. "
    note = f"{note}{remarks[:1].upper()}{remarks[1:]}".strip()
    if len(heads) <= len(shares) + 1:
        named = (*columns(("quantity", "quantity"), ("unit", "unit")), *number_columns(*heads))
        return Grid("Uncertainty budget", named, [(*who, *cells) for who, cells in shares], note)
    units = [f"{name} [{unit}]" if unit else name for (name, unit), _ in shares]
    named = (*columns("source (type)"), *number_columns(*units))
    rows = list(zip(heads, *(cells for _, cells in shares), strict=True))
    return Grid("Uncertainty budget", named, rows, note)


def _shares(
    quantity: Quantity, estimate: Estimate, sources: Sequence[tuple[str, str]]
) -> tuple[tuple[str, str], list[str]]:
    """Name and unit of one quantity, and its standard uncertainties: by source, combined, expanded."""
    size = max(abs(estimate.value), estimate.expanded_uncertainty)
    factor, unit = laboratory_unit(estimate.unit, size, quantity.shown)
    shares: dict[tuple[str, str], float] = {}
    for line in estimate.budget:
        key = (line.source, line.kind)
        shares[key] = math.hypot(shares.get(key, 0.0), line.standard_uncertainty)
    whole = (estimate.standard_uncertainty, estimate.expanded_uncertainty)
    sizes = (*(shares.get(source) for source in sources), *whole)
    cells = ["·" if size is None else number(size / factor, 2) for size in sizes]
    return (quantity.titled(estimate.name), unit), cells


def metric_grid(result: Result) -> Grid:
    """The figures of merit; what both directions have stands side by side."""
    ways = ("forward", "reverse")
    rows: dict[str, list[str]] = {}
    for name, value in result.metrics.items():
        quantity = result.quantity(name)
        way = quantity.member(name)
        title = quantity.family_title if way in ways else quantity.titled(name)
        place = ways.index(way) if way in ways else 0
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
                "yes" if row.within else "no",
                shown.number(estimate.value - row.difference),
                "yes" if row.covered else "no",
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
