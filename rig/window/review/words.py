"""What the window says of a result: each number beside its verdict and the catalogue's value with its conditions."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from experiments.assumed import replacing
from experiments.result import Plot, Result
from rig.analysis.judging import GearVerdict, held_against
from rig.analysis.rows import budget_grid, limit_words, metric_grid, proof_words
from rig.content.data import data_grid
from rig.content.grid import Grid, capital, tone_of
from rig.content.phrase import phrase
from rig.content.wording import readable
from rig.window.shell.palette import Palette


def _verdict_words(judged: GearVerdict) -> str:
    """The verdict with its reasons in one sentence."""
    because = "; ".join(judged.because)
    return f"Verdict: {judged.verdict}{phrase('. {}', because)}."


POINTS = "points"
"""Target of the link from a number to the figure that shows its points."""


def budget_page(result: Result, name: str, palette: Palette) -> str:
    """What the uncertainty of one number is made of, and the way to its points."""
    title = html.escape(capital(result.quantity(name).titled(name)))
    grid = budget_grid(result, (name,))
    body = grid_html(grid, palette) if grid else "<p>It has no budget.</p>"
    way = f'<p><a href="{POINTS}" style="color:{palette.accent}">Its points</a></p>'
    return f"<h3>{title}</h3>{way}{body}"


def plot_of(plots: Sequence[Plot], name: str) -> str:
    """The figure that shows the points of a number: the one whose name shares most words with it, else the first."""
    words = set(name.replace("_", " ").replace("-", " ").split())
    alike = [(len(words & set(plot.name.replace("-", " ").split())), plot) for plot in plots]
    return max(alike, key=lambda pair: pair[0])[1].name


def result_page(result: Result, palette: Palette, judged: GearVerdict | None = None) -> str:
    """Warnings, verdicts with their definitions, figures of merit, tables and conventions, as a page of rich text."""
    parts = []
    if result.warnings:
        lines = "".join(f"<li>{html.escape(w)}</li>" for w in result.warnings)
        parts.append(f'<h4 style="color:{palette.warning}">To beware of</h4><ul>{lines}</ul>')
    if unsaid := replacing(result.estimates.values()):
        parts.append(facts_html("Assumed, and what states it", unsaid.items(), palette))
    if judged is not None:
        parts.append(f"<p>{html.escape(_verdict_words(judged))}</p>")
    if proof := proof_words(result):
        parts.append(f"<p><b>Proof: {html.escape(proof)}.</b></p>")
    for v in judged.of(result) if judged is not None else ():
        colour = getattr(palette, tone_of(v.outcome) or "muted")
        value, _ = held_against(v)
        words = html.escape(
            f"{v.name}: {value} {limit_words(v)}. {capital(v.quantity.definition)}."
        )
        parts.append(f'<p><b style="color:{colour}">{html.escape(v.outcome)}</b>&nbsp; {words}</p>')
    grids = [metric_grid(result), *(data_grid(table) for table in result.tables)]
    parts += [grid_html(grid, palette) for grid in grids if grid.rows]
    if result.options:
        pairs = [(readable(name), str(value)) for name, value in result.options.items()]
        parts.append(facts_html("Conventions", pairs, palette))
    return "".join(parts)


def grid_html(grid: Grid, palette: Palette) -> str:
    """A grid of the report as a table of rich text."""
    right = [' align="right"' if one.kind == "number" else "" for one in grid.columns]
    style = f'style="color:{palette.muted}"'
    head = "".join(
        f"<th{a} {style}>{html.escape(c)}</th>" for a, c in zip(right, grid.headings, strict=True)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{a}>{html.escape(str(c))}</td>" for a, c in zip(right, row, strict=True))
        + "</tr>"
        for row in grid.rows
    )
    note = phrase("<p>{}</p>", html.escape(grid.note))
    return f'<h4>{html.escape(grid.title)}</h4><table cellpadding="3"><tr>{head}</tr>{body}</table>{note}'


def facts_html(title: str, pairs: Iterable[Sequence[str]], palette: Palette) -> str:
    """Names and texts, one pair per line; nothing for none."""
    rows = "".join(
        f'<tr><td style="color:{palette.muted}">{html.escape(capital(name))}&nbsp;&nbsp;</td>'
        f"<td>{html.escape(text)}</td></tr>"
        for name, text in pairs
        if text
    )
    return phrase('<h4>{1}</h4><table cellpadding="2">{0}</table>', rows, html.escape(title))
