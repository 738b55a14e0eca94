"""What the window says of a result: each number beside its verdict and the catalogue's value with its conditions."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from experiments.quantity import Quantity
from experiments.result import Result, Verdict
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from rig.analysis.judging import GearVerdict, held_against, whose_limit
from rig.analysis.wording import laboratory_unit, number, readable, show
from rig.present.content import Grid, data_grid, metric_grid
from rig.window.shell.palette import Palette

RESULT_COLUMNS = (
    "quantity",
    "value ± U (95 %)",
    "unit",
    "identifiable",
    "limit or catalogue",
    "remark",
)


def result_rows(
    result: Result, gear: HarmonicDrive | None, lines: Sequence[Verdict] = ()
) -> list[tuple[str, ...]]:
    """A row per estimate, in the units of a laboratory, each under `RESULT_COLUMNS`; `lines` are its limits, judged."""
    verdicts = {line.estimate.name: line for line in lines}
    rows = []
    for name, estimate in result.estimates.items():
        quantity = result.quantity(name)
        s = show(estimate, quantity)
        verdict = verdicts.get(name)
        limit = catalogue_words(quantity, estimate, gear)
        if verdict is not None:
            limit = f"{verdict.outcome} {limit_words(verdict)}"
        value = f"{s.value} ± {s.expanded or '?'}"
        rows.append(
            (
                quantity.titled(name),
                value,
                s.unit,
                estimate.identifiable,
                limit,
                estimate.note,
            )
        )
    return rows


def limit_words(verdict: Verdict) -> str:
    """The limit that a quantity was held against, and whose limit it is."""
    _, limit = held_against(verdict)
    because = f"; {verdict.because}" if verdict.because else ""
    return f"({limit}, {whose_limit(verdict)}{because})"


def verdict_words(judged: GearVerdict) -> str:
    """The verdict with its reasons in one sentence."""
    because = "; ".join(judged.because)
    return f"Verdict: {judged.verdict}" + (f". {because}." if because else ".")


def catalogue_words(quantity: Quantity, estimate: Estimate, gear: HarmonicDrive | None) -> str:
    """The value of the catalogue, where it is from and under which conditions it holds; "" where there is none."""
    if quantity.catalogue is None or gear is None:
        return ""
    value = gear.value(f"ratings.{quantity.catalogue.rating}")
    factor, unit = laboratory_unit(value.unit, estimate.value, quantity.shown)
    source = f"{value.origin.provenance}: {value.origin.source}".rstrip(": ")
    return f"catalogue {number(value.value / factor)} {unit} ({source})"


def result_page(result: Result, palette: Palette, judged: GearVerdict | None = None) -> str:
    """Warnings, verdicts with their definitions, figures of merit, tables and conventions, as a page of rich text."""
    parts = []
    if result.warnings:
        lines = "".join(f"<li>{html.escape(w)}</li>" for w in result.warnings)
        parts.append(f'<h4 style="color:{palette.warning}">To beware of</h4><ul>{lines}</ul>')
    if judged is not None:
        parts.append(f"<p>{html.escape(verdict_words(judged))}</p>")
    for v in judged.of(result) if judged is not None else ():
        colour = {"PASS": palette.good, "FAIL": palette.bad, "MARGINAL": palette.warning}.get(
            v.outcome, palette.muted
        )
        value, _ = held_against(v)
        definition = v.quantity.definition[:1].upper() + v.quantity.definition[1:]
        words = html.escape(f"{v.name}: {value} {limit_words(v)}. {definition}.")
        parts.append(f'<p><b style="color:{colour}">{html.escape(v.outcome)}</b>&nbsp; {words}</p>')
    grids = [metric_grid(result), *(data_grid(table) for table in result.tables)]
    parts += [grid_html(grid, palette) for grid in grids if grid is not None]
    if result.options:
        pairs = [(readable(name), str(value)) for name, value in result.options.items()]
        parts.append(facts_html("Conventions", pairs, palette))
    return "".join(parts)


def grid_html(grid: Grid, palette: Palette) -> str:
    """A grid of the report as a table of rich text."""
    right = [' align="right"' if numeric else "" for numeric in grid.numeric]
    style = f'style="color:{palette.muted}"'
    head = "".join(
        f"<th{a} {style}>{html.escape(c)}</th>" for a, c in zip(right, grid.columns, strict=True)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{a}>{html.escape(str(c))}</td>" for a, c in zip(right, row, strict=True))
        + "</tr>"
        for row in grid.rows
    )
    note = f"<p>{html.escape(grid.note)}</p>" if grid.note else ""
    return f'<h4>{html.escape(grid.title)}</h4><table cellpadding="3"><tr>{head}</tr>{body}</table>{note}'


def facts_html(title: str, pairs: Iterable[Sequence[str]], palette: Palette) -> str:
    """Names and texts, one pair per line; nothing for none."""
    rows = "".join(
        f'<tr><td style="color:{palette.muted}">{html.escape(name)}&nbsp;&nbsp;</td><td>{html.escape(text)}</td></tr>'
        for name, text in pairs
        if text
    )
    return f'<h4>{html.escape(title)}</h4><table cellpadding="2">{rows}</table>' if rows else ""
