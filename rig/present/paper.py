"""The report on paper: the content of the page set by typst, with the fonts that come with it; no
system library, no network.

Everything that comes from files is handed over as data and shown letter for letter, whatever it looks like.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from importlib import resources
from pathlib import Path
from typing import Any

from rig.analysis.wording import printable, unbroken
from rig.errors import RigError
from rig.present.content import Grid, VerdictLine
from rig.present.layout import KEPT_LINES, PORTRAIT, SIZES, Layout, laid_out, width_of

TEMPLATE = "page.typ"
LONGEST_WORD = 26
"""Letters after which a word without a break may be broken: hashes, file names, hostile serial numbers."""
HEADING_LENGTH = 80
MATRIX_SIZE = 7.5
"""Size of the text of facts side by side [pt]."""
WIDEST_NAME = 14.0
"""Room for the names of facts [em]; longer ones are broken."""


def render_pdf(context: Mapping[str, Any]) -> bytes:
    """The pages of a report as PDF; `context` is what the HTML page is made of. Raises `RigError`."""
    document = typeset(context, format="pdf")
    assert isinstance(document, bytes)
    return document


def typeset(context: Mapping[str, Any], **wanted: Any) -> Any:
    """What typst makes of a report, in the format that is `wanted`. Raises `RigError`."""
    import typst

    content = json.dumps(paper_content(context), ensure_ascii=False, allow_nan=False)
    source = resources.files("rig.present").joinpath(TEMPLATE).read_bytes()
    try:
        return typst.compile(
            source,
            sys_inputs={"content": content},
            ignore_system_fonts=True,
            font_paths=[_fonts()],  # type: ignore[arg-type]  the stubs leave paths out
            **wanted,
        )
    except (RuntimeError, ValueError, OSError) as error:
        raise RigError(
            f"the report cannot be set on paper: {error}", remedy="Write it as HTML instead."
        ) from error


def _fonts() -> str:
    """The folder of the fonts in which the figures are drawn."""
    import matplotlib

    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf")


def paper_content(context: Mapping[str, Any]) -> dict[str, Any]:
    """What the template shows, as plain values: text without control characters and with breaks in long words."""
    content = {
        "number": context["number"],
        "heading": context["heading"],
        "heading_short": _shortened(context["heading"]),
        "created": context["created"],
        "version": context["version"],
        "note": context["note"],
        "run_word": context["run_word"],
        "gear_name": context["gear_name"],
        "serial": context["serial"],
        "operators": context["operators"],
        "dates": context["dates"],
        "words": context["words"],
        "origin_sentences": context["origin_sentences"],
        "subtitle": context["subtitle"],
        "states": [asdict(state) for state in context["states"]],
        "truth_note": context["truth_note"],
        "alarms": list(context["alarms"]),
        "run_line": context["run_line"],
        "catalogue": _laid_out(context["catalogue"], SIZES[1]) if context["catalogue"] else [],
        "verdicts": _laid_out(verdict_grid(context["verdicts"]), SIZES[1]),
        "key_results": _laid_out(_key_grid(context["key_results"])),
        "warnings": [f"{title}: {text}" for title, _, _, text in context["warnings"]],
        "parts": [_part(part) for part in context["parts"]],
        "truth": _laid_out(context["truth"]) if context["truth"] else [],
        "paper_figures": _laid_out(_paper_grid(context["paper_figures"]))
        if context["paper_figures"]
        else [],
        "sections": [
            {
                "title": title,
                "grids": _laid_out(context["files"])
                if context["files"] and "identities" in keys
                else [],
                "matrices": [_matrix(m) for key in keys for m in context[key]],
            }
            for title, keys in SECTIONS
            if any(context[key] for key in keys) or ("identities" in keys and context["files"])
        ],
        "definitions": [list(pair) for pair in context["definitions"]],
        "paper": context["paper"],
        "not_measured": list(context["not_measured"]),
        "signature": asdict(context["signature"]),
    }
    annex = [
        t
        for g in (*context["parameter_sets"], *(g for p in context["parts"] for g in p.annex))
        for t in _laid_out(g)
    ]
    content["annex"] = [grid for grid in annex if not grid["landscape"]]
    content["wide"] = [grid for part in content["parts"] for grid in part.pop("wide")]
    content["wide"] += [grid for grid in annex if grid["landscape"]]
    return _clean(content)


SECTIONS = (
    ("Conditions", ("conditions",)),
    ("Calibrations", ("calibrations",)),
    ("Provenance", ("identities", "conventions", "settings")),
)
"""Tables of facts side by side: heading, and what stands under it."""


def _laid_out(grid: Grid, largest: float = SIZES[0]) -> list[dict[str, Any]]:
    """A table with the size of its text and the widths of its columns: one, or several where it fits no page."""
    plain = Grid(
        grid.title,
        tuple(_clean(unbroken(c)) for c in grid.columns),
        tuple(map(tuple, _clean(grid.rows))),
        grid.numeric,
        hashes=tuple(_clean(unbroken(c)) for c in grid.hashes),
    )
    tables = laid_out(plain, largest)
    placed = []
    for number, (part, layout) in enumerate(tables, 1):
        title = (
            f"{grid.title}, columns part {number} of {len(tables)}"
            if len(tables) > 1
            else grid.title
        )
        note = grid.note if number == len(tables) else ""
        placed.append(_table(replace(part, title=title, note=note), layout))
    return placed


def _table(grid: Grid, layout: Layout) -> dict[str, Any]:
    faces = [FACES.get(column, "hash" if column in grid.hashes else "") for column in grid.columns]
    return {**asdict(grid), "faces": faces, **asdict(layout), "kept": layout.fits_one_page}


FACES = {"Verdict": "verdict", "Identifiable": "verdict", "Symbol": "symbol", "Quantity": "words"}
"""Columns whose text is set in a way of its own."""


def verdict_grid(lines: Sequence[VerdictLine]) -> Grid:
    """The judged quantities as one table."""
    columns = (
        "Quantity",
        "Value ± U (k = 2)",
        "Limit",
        "Definition and source of the limit",
        "Verdict",
    )
    rows = tuple(
        (v.name, v.value, v.limit, f"{v.definition}; {v.source}", v.outcome) for v in lines
    )
    return Grid("Judged quantities", columns, rows, (False, True, True, False, False))


def _key_grid(rows: Sequence[tuple[str, str, str, str]]) -> Grid:
    return Grid(
        "Summary",
        ("Test", "Quantity", "Value ± U (k = 2)", "Identifiable"),
        tuple(rows),
        (False, False, True, False),
    )


def _paper_grid(rows: Sequence[tuple[str, str, Sequence[Any], str]]) -> Grid:
    cells = tuple(
        (number, what, f"Figure {', '.join(str(f.number) for f in here)}" if here else missing)
        for number, what, here, missing in rows
    )
    return Grid(
        "Figures after the paper", ("Paper", "What it shows", "Here"), cells, (True, False, False)
    )


def _part(part: Any) -> dict[str, Any]:
    grids = (part.estimates, part.orders, part.metrics, *part.tables, part.budget)
    tables = [table for grid in grids if grid is not None for table in _laid_out(grid)]
    wide = [
        {**table, "title": f"{part.title}: {_lowered(table['title'])}"}
        for table in tables
        if table["landscape"]
    ]
    return {
        "title": part.title,
        "run": part.run,
        "warnings": list(part.warnings),
        "figures": [{**asdict(f), "svg": str(f.svg)} for f in part.figures],
        "grids": [table for table in tables if not table["landscape"]],
        "wide": wide,
        "elsewhere": [_lowered(table["title"]) for table in tables if table["landscape"]],
    }


def _lowered(title: str) -> str:
    return title[:1].lower() + title[1:]


def _matrix(matrix: Any) -> dict[str, Any]:
    names = min(max((width_of(name) for name, _ in matrix.rows), default=0.0), WIDEST_NAME)
    rows = [[name, list(texts)] for name, texts in matrix.rows]
    room = (PORTRAIT / MATRIX_SIZE - names) / len(matrix.columns) - 1.0
    lines = sum(
        max(math.ceil(1.08 * width_of(text) / room) for text in texts) for _, texts in matrix.rows
    )
    return {
        "caption": matrix.caption,
        "columns": list(matrix.columns),
        "rows": rows,
        "names": names,
        "size": MATRIX_SIZE,
        "kept": lines <= KEPT_LINES,
    }


def _shortened(text: str) -> str:
    return text if len(text) <= HEADING_LENGTH else text[: HEADING_LENGTH - 1] + "…"


def _clean(value: Any) -> Any:
    """Every text printable, long words with places to break; drawings as they are."""
    if isinstance(value, str):
        return _breakable(printable(value))
    if isinstance(value, Mapping):
        return {
            key: entry if key in ("svg", "style") else _clean(entry) for key, entry in value.items()
        }
    if isinstance(value, (list, tuple)):
        return [_clean(entry) for entry in value]
    return value


def _breakable(text: str) -> str:
    """The text with a zero-width space in every word that is too long for a column."""
    if all(len(word) <= LONGEST_WORD for word in text.split()):
        return text
    step = LONGEST_WORD // 2
    return " ".join(
        word
        if len(word) <= LONGEST_WORD
        else "\u200b".join(word[i : i + step] for i in range(0, len(word), step))
        for word in text.split(" ")
    )
