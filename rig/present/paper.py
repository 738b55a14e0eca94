"""The report on paper: the content of the page set by typst, with the fonts that come with it; no
system library, no network.

Everything that comes from files is handed over as data and shown letter for letter, whatever it looks like.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

from experiments.result import DECISION_RULE
from rig.content.grid import TONES, Grid, capital, columns
from rig.content.wording import printable, unbroken
from rig.present.content import VerdictLine
from rig.present.typesetting import Document, set_pages

TEMPLATE, FRONT = "page.typ", "front.typ"
PLACE = b"// FRONT\n"
"""Where the functions of page one stand in the template: after those that they call."""
LONGEST_WORD = 26
"""Letters after which a word without a break may be broken: hashes, file names, hostile serial numbers."""
HEADING_LENGTH = 80
TEXT_SIZE, SMALL_TEXT_SIZE = 8.0, 7.5
"""Largest sizes of a table's text [pt]."""


def render_pdf(context: Mapping[str, Any]) -> bytes:
    """The pages of a report as PDF; `context` is what the HTML page is made of. Raises `RigError`."""
    (document,) = typeset(context, format="pdf")
    return document


def typeset(context: Mapping[str, Any], **output: Any) -> list[bytes]:
    """What typst makes of a report, in the format that `output` names. Raises `RigError`."""
    return set_pages(document_of(context), output)


def document_of(context: Mapping[str, Any]) -> Document:
    """The template and what it shows of a report."""
    content = json.dumps(paper_content(context), ensure_ascii=False, allow_nan=False)
    folder = resources.files("rig.present")
    source = folder.joinpath(TEMPLATE).read_bytes()
    source = source.replace(PLACE, folder.joinpath(FRONT).read_bytes(), 1)
    return Document(source.decode(), content, _fonts())


def _fonts() -> str:
    """The folder of the fonts in which the figures are drawn."""
    import matplotlib

    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf")


def paper_content(context: Mapping[str, Any]) -> dict[str, Any]:
    """What the template shows, as plain values: text without control characters and with breaks in long words."""
    content = {
        "tones": TONES,
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
        "catalogue": _grids(context["catalogue"], size=SMALL_TEXT_SIZE),
        "verdicts": _grids(verdict_grid(context["verdicts"]), size=SMALL_TEXT_SIZE),
        "key_results": _grids(_key_grid(context["key_results"])),
        "warnings": [f"{title}: {text}" for title, _, _, text in context["warnings"]],
        "parts": [_part(part) for part in context["parts"]],
        "truth": _grids(context["truth"]),
        "paper_figures": _grids(_paper_grid(context["paper_figures"])),
        "sections": [
            {
                "title": title,
                "grids": _grids(
                    context["files"] if "identities" in keys else None,
                    *(grid for key in keys for grid in context[key]),
                ),
            }
            for title, keys in SECTIONS
            if any(context[key] for key in keys) or ("identities" in keys and context["files"])
        ],
        "definitions": [list(pair) for pair in context["definitions"]],
        "paper": context["paper"],
        "not_measured": list(context["not_measured"]),
        "signature": asdict(context["signature"]),
        "annex": _grids(
            *context["parameter_sets"], *(g for p in context["parts"] for g in p.annex)
        ),
    }
    if "front" in context:
        content["front"] = _front(context["front"])
    return _clean(content)


def _front(front: Mapping[str, Any]) -> dict[str, Any]:
    """Page one of a certificate: its tables as those of the pages, its drawings by their widths."""
    return {
        **front,
        "laboratory": {**front["laboratory"], "logo": ""},
        "values": _grids(front["values"]),
        "hashes": _grids(front["hashes"], size=SMALL_TEXT_SIZE),
        "curves": [{**curve, "svg": str(curve["svg"])} for curve in front["curves"]],
    }


SECTIONS = (
    ("Conditions", ("conditions",)),
    ("Calibrations", ("calibrations",)),
    ("Provenance", ("identities", "conventions", "settings")),
)
"""Tables of facts side by side: heading, and what stands under it."""


def _grids(*grids: Grid | None, size: float = TEXT_SIZE) -> list[dict[str, Any]]:
    """Tables with the kinds of their columns and the largest size of their text [pt]; the template lays them out."""
    return [
        {
            "title": grid.title,
            "note": grid.note,
            "columns": [capital(unbroken(heading)) for heading in grid.headings],
            "kinds": [column.kind for column in grid.columns],
            "rows": [_named(row) if grid.names_rows else row for row in grid.rows],
            "largest": size,
        }
        for grid in grids
        if grid is not None
    ]


def _named(row: Sequence[str]) -> tuple[str, ...]:
    return (capital(row[0]), *row[1:])


def verdict_grid(lines: Sequence[VerdictLine]) -> Grid:
    """The judged quantities as one table."""
    heads = columns(
        ("quantity", "quantity"),
        ("value ± U (95 %)", "number"),
        ("limit", "number"),
        "definition and source of the limit",
        ("verdict", "word"),
    )
    rows = [(v.name, v.value, v.limit, f"{v.definition}; {v.source}", v.outcome) for v in lines]
    return Grid("Judged quantities", heads, rows, DECISION_RULE)


def _key_grid(rows: Sequence[tuple[str, str, str, str]]) -> Grid:
    heads = columns(
        "test", ("quantity", "quantity"), ("value ± U (95 %)", "number"), ("identifiable", "word")
    )
    return Grid("Summary", heads, rows)


def _paper_grid(rows: Sequence[tuple[str, str, Sequence[Any], str]]) -> Grid:
    cells = [
        (number, what, f"Figure {', '.join(str(f.number) for f in here)}" if here else missing)
        for number, what, here, missing in rows
    ]
    heads = columns(("paper", "number"), "what it shows", "here")
    return Grid("Figures after the paper", heads, cells)


def _part(part: Any) -> dict[str, Any]:
    return {
        "title": part.title,
        "run": part.run,
        "warnings": list(part.warnings),
        "figures": [{**asdict(f), "svg": str(f.svg)} for f in part.figures],
        "grids": _grids(*part.grids),
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
