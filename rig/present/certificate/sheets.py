"""The two pages of a certificate: their content, and how they are set on paper (A4 or Letter) and on screen."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from rig.content.page import Signature
from rig.content.wording import days_text
from rig.present.certificate.back import Back, back_of
from rig.present.certificate.front import Front, front_of
from rig.present.certificate.gather import Certified
from rig.present.certificate.laboratory import LaboratoryWords, Logo
from rig.present.certificate.traceability import Title, instruments_of, title_of
from rig.present.certificate.words import ENGLISH, SHIPPED, Words
from rig.present.page import environment
from rig.present.paper import fonts, plain
from rig.present.report import marks_of, program_version
from rig.present.typesetting import Document, set_pages
from rig.runfile.manifest import Manifest

Paper = Literal["a4", "letter"]
_PAPERS: dict[Paper, str] = {"a4": "a4", "letter": "us-letter"}
"""Sizes of paper by what typst calls them."""
_TYPEFACES = ("Libertinus Serif", "DejaVu Sans")
TEMPLATE, SCREEN, STYLE = "certificate.typ", "certificate.html", "certificate.css"
_MEDIA = {"png": "image/png", "jpg": "image/jpeg", "svg": "image/svg+xml"}


@dataclass(frozen=True, kw_only=True)
class Sheets:
    """A certificate: what stands on both its pages, page one and page two."""

    number: str
    title: Title
    laboratory: str
    address: str
    logo: Logo | None
    foot: tuple[tuple[str, str], ...]
    """Place, and the days of receipt, test and issue: on both pages."""
    mark: str
    """What is no measurement says so on both pages."""
    program: str
    front: Front
    back: Back
    words: Words = ENGLISH

    @property
    def signature(self) -> Signature:
        """Whether there is room for signatures, and why not."""
        return self.back.signature


def sheets_of(
    gathered: Certified,
    laboratory: LaboratoryWords,
    manifest: Manifest,
    *,
    number: str,
    created: str,
    manifest_file: str,
) -> Sheets:
    """The two pages. `created` is the calendar time of issue, `manifest_file` the name of the manifest beside them."""
    words = laboratory.words
    instruments = instruments_of(gathered)
    title = title_of(gathered, instruments, words)
    marks = marks_of(fit.recording.metadata.origin for fit in gathered.fits)
    days = days_text(fit.recording.metadata.start_time for fit in gathered.fits)
    foot = (
        (words.PLACE, laboratory.place or laboratory.address),
        (words.RECEIVED, laboratory.received),
        (words.TESTED, words.named(days)),
        (words.ISSUED, created[:10]),
    )
    return Sheets(
        number=number,
        title=title,
        laboratory=laboratory.name,
        address=laboratory.address,
        logo=laboratory.logo,
        foot=tuple((name, text or words.NOT_STATED) for name, text in foot),
        mark=", ".join(words.coded(words.MARKS, word) for word, _ in marks),
        program=words.MADE_BY.format(program=program_version()),
        front=front_of(gathered, laboratory),
        back=back_of(
            gathered,
            laboratory,
            manifest,
            instruments,
            (words.KINDS[title.kind], manifest_file),
        ),
        words=words,
    )


def texts_of(sheets: Sheets) -> tuple[list[str], list[str]]:
    """What stands on page one and on page two, piece by piece, as it can be read again from the pages."""
    both = [sheets.number, sheets.mark, *(text for pair in sheets.foot for text in pair)]
    front, back = sheets.front, sheets.back
    one = [
        sheets.title.word,
        sheets.title.untraceable,
        sheets.laboratory,
        *(text for pair in front.facts for text in pair),
        front.verdict,
        front.sentence,
        front.incomplete,
        *front.because,
        *(" ".join(row) for row in front.values.rows),
        front.values.note,
        *(picture.title for picture in front.pictures),
    ]
    two = [
        *(text for pair in (*back.conditions, *back.paragraphs) for text in pair),
        *(cell for grid in (back.tests, back.instruments) for row in grid.rows for cell in row),
        *back.remarks,
        back.manifest,
        back.scope,
        back.signature.reason,
    ]
    return [text for text in (*both, *one) if text], [text for text in (*both, *two) if text]


def rendered(sheets: Sheets, path: Path, paper: Paper = "a4") -> bytes:
    """The two pages as PDF or HTML, by the suffix of the path. Raises `RigError`."""
    if path.suffix.lower() == ".pdf":
        (document,) = typeset(sheets, paper, format="pdf")
        return document
    return render_screen(sheets, paper).encode("utf-8")


def typeset(sheets: Sheets, paper: Paper = "a4", **output: Any) -> list[bytes]:
    """What typst makes of it, in the format that `output` names. Raises `RigError`."""
    content = {**plain(sheets), **_title(sheets), "logo": None, "paper": _PAPERS[paper]}
    del content["words"]
    if sheets.logo is not None:
        content["logo"] = {"bytes": list(sheets.logo.content), "format": sheets.logo.format}
    words = sheets.words
    content["signed"] = list(words.SIGNED)
    content["pages"] = [words.PAGE.format(page=page) for page in (1, 2)]
    content["lang"] = _tongue(words)
    content["typefaces"] = [*_TYPEFACES, *words.fonts]
    source = resources.files("rig.present").joinpath(TEMPLATE).read_text(encoding="utf-8")
    order = json.dumps(content, ensure_ascii=False, allow_nan=False)
    folders = dict.fromkeys(str(file.parent) for file in words.font_files())
    return set_pages(Document(source, order, (fonts(), *folders)), output)


def _tongue(words: Words) -> str:
    """The language of a page by its code; of a table of somebody's own nobody knows it."""
    return words.language if words.language in SHIPPED else SHIPPED[0]


def render_screen(sheets: Sheets, paper: Paper = "a4") -> str:
    """The HTML of it: two sections, a page each."""
    from markupsafe import Markup

    jinja = environment()
    style = Markup(jinja.get_template(STYLE).render(paper=paper))
    logo = ""
    if sheets.logo is not None:
        coded = base64.b64encode(sheets.logo.content).decode()
        logo = f"data:{_MEDIA[sheets.logo.format]};base64,{coded}"
    words = sheets.words
    told = {"style": style, "sheets": sheets, "words": words, "logo": logo, "signed": words.SIGNED}
    told["lang"] = _tongue(words)
    return jinja.get_template(SCREEN).render(**told)


def _title(sheets: Sheets) -> dict[str, Any]:
    said = {name.lower(): getattr(sheets.words, name) for name in _HEADINGS}
    return {"title": sheets.title.word, "untraceable": sheets.title.untraceable, "said": said}


_HEADINGS = ("CONDITIONS", "INSTRUMENTS", "REMARKS", "RESTS_ON", "REPORT", "SIGNATURE")
"""What the templates set by themselves."""
