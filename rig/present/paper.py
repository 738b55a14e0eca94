"""The report on paper: the content of the page set by typst, with the fonts that come with it; no
system library, no network.

Everything that comes from files is handed over as data and shown letter for letter, whatever it looks like.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import is_dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from rig.content.grid import TONES, Grid, capital
from rig.content.page import Page
from rig.content.phrase import shortened
from rig.content.wording import printable, unbroken
from rig.present.typesetting import Document, set_pages

TEMPLATE = "page.typ"
_LONGEST_WORD = 26
"""Letters after which a word without a break may be broken: hashes, file names, hostile serial numbers."""
_HEADING_LENGTH = 80


def render_pdf(page: Page) -> bytes:
    """The pages of a report as PDF; Raises `RigError`."""
    (document,) = typeset(page, format="pdf")
    return document


def typeset(page: Page, **output: Any) -> list[bytes]:
    """What typst makes of a report, in the format that `output` names. Raises `RigError`."""
    return set_pages(document_of(page), output)


def document_of(page: Page) -> Document:
    """The template and what it shows of a report."""
    content = json.dumps(paper_content(page), ensure_ascii=False, allow_nan=False)
    source = resources.files("rig.present").joinpath(TEMPLATE).read_text(encoding="utf-8")
    return Document(source, content, (fonts(),))


def fonts() -> str:
    """The folder of the fonts in which the figures are drawn."""
    import matplotlib

    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf")


def paper_content(page: Page) -> dict[str, Any]:
    """What the template shows, as plain values: text without control characters and with breaks in long words."""
    return {
        **plain(page),
        "words": page.words,
        "tone_of": TONES,
        "heading_short": _breakable(printable(shortened(page.heading, _HEADING_LENGTH))),
    }


_AS_IT_IS = frozenset({"svg", "tone"})
"""What is no text of a run."""


def plain(value: Any) -> Any:
    """Tables by the kinds of their columns, every text printable, long words with places to break."""
    if isinstance(value, str):
        return _breakable(printable(value))
    if isinstance(value, Grid):
        heads = [capital(unbroken(heading)) for heading in value.headings]
        rows = (
            [(capital(row[0]), *row[1:]) for row in value.rows] if value.names_rows else value.rows
        )
        kinds = [column.kind for column in value.columns]
        table = {"title": value.title, "columns": heads, "rows": rows, "note": value.note}
        return {**plain(table), "kinds": kinds}
    if is_dataclass(value):
        value = vars(value)
    if isinstance(value, Mapping):
        return {
            key: one if key in _AS_IT_IS else plain(one)
            for key, one in value.items()
            if key != "logo"
        }
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    return value


def _breakable(text: str) -> str:
    """The text with a zero-width space in every word that is too long for a column."""
    if all(len(word) <= _LONGEST_WORD for word in text.split()):
        return text
    step = _LONGEST_WORD // 2

    def broken(word: str) -> str:
        if len(word) <= _LONGEST_WORD:
            return word
        return "\u200b".join(word[i : i + step] for i in range(0, len(word), step))

    return " ".join(map(broken, text.split(" ")))
