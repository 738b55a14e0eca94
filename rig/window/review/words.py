"""What the window says of a result: each number beside its verdict and the catalogue's value with its conditions."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from experiments.result import Result, Verdict
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from rig.analysis.wording import display_unit, number, readable, show
from rig.present.content import Grid, data_grid, metric_grid
from rig.window.shell.palette import Palette

RESULT_COLUMNS = (
    "quantity",
    "value ± U (k = 2)",
    "unit",
    "95 % interval",
    "identifiable",
    "limit or catalogue",
    "remark",
)
RATINGS = {
    "transmission_accuracy": "transmission_accuracy",
    "running_torque": "running_torque",
    "starting_torque": "starting_torque",
}
"""Results that a catalogue gives, by how their name begins, and the rating that holds its value."""


def result_rows(result: Result, gear: HarmonicDrive | None) -> list[tuple[str, ...]]:
    """A row per estimate, in the units of a laboratory, each under `RESULT_COLUMNS`."""
    verdicts = {id(v.estimate): v for v in result.verdicts}
    rows = []
    for name, estimate in result.estimates.items():
        s = show(estimate)
        verdict = verdicts.get(id(estimate))
        limit = verdict_words(verdict) if verdict else catalogue_words(estimate, gear)
        interval = f"{s.low} … {s.high}"
        value = f"{s.value} ± {s.expanded or '?'}"
        rows.append(
            (readable(name), value, s.unit, interval, estimate.identifiable, limit, estimate.note)
        )
    return rows


def verdict_words(verdict: Verdict) -> str:
    """The outcome, the limit that it was held against, and where that is from and under which conditions it holds."""
    factor, unit = display_unit(
        verdict.estimate.name, verdict.estimate.unit, verdict.estimate.value
    )
    source = f"{verdict.limit_provenance}: {verdict.limit_source}".rstrip(": ")
    limit = f"≤ {number(verdict.limit / factor)} {unit}".rstrip()
    return f"{verdict.outcome} ({limit}, {source})"


def catalogue_words(estimate: Estimate, gear: HarmonicDrive | None) -> str:
    """The value of the catalogue, where it is from and under which conditions it holds; "" where there is none."""
    rating = next(
        (rating for start, rating in RATINGS.items() if estimate.name.startswith(start)), ""
    )
    if not rating or gear is None:
        return ""
    value = gear.value(f"ratings.{rating}")
    factor, unit = display_unit(estimate.name, value.unit, estimate.value)
    source = f"{value.origin.provenance}: {value.origin.source}".rstrip(": ")
    return f"catalogue {number(value.value / factor)} {unit} ({source})"


def result_page(result: Result, palette: Palette) -> str:
    """Warnings, verdicts with their definitions, figures of merit, tables and conventions, as a page of rich text."""
    parts = []
    if result.warnings:
        lines = "".join(f"<li>{html.escape(w)}</li>" for w in result.warnings)
        parts.append(f'<h4 style="color:{palette.warning}">To beware of</h4><ul>{lines}</ul>')
    for v in result.verdicts:
        colour = {"PASS": palette.good, "FAIL": palette.bad, "MARGINAL": palette.warning}.get(
            v.outcome, palette.muted
        )
        limit = verdict_words(v).removeprefix(v.outcome).strip()
        definition = v.definition[:1].upper() + v.definition[1:]
        words = html.escape(f"{v.name}: {show(v.estimate).with_uncertainty} {limit}. {definition}.")
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
