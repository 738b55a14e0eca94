"""The report on paper: the same words and numbers as on screen, marked on every page, deaf to what
looks like markup.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pypdf
import pytest
from matplotlib.image import imread

from drivers.channel import Calibration, Channel
from experiments.recording import Origin
from experiments.result import Table
from rig.analysis.fit.recorded import Fit
from rig.content.page import Page
from rig.errors import RigError
from rig.present.paper import paper_content, render_pdf, typeset
from rig.present.report import report_page
from rig.present.typesetting import Document, set_pages
from rig.runfile.layout import Column
from tests.rig import handmade

CREATED = "2026-11-21 08:00:00+00:00"


@dataclass(frozen=True)
class Paper:
    """A report on paper: what it was made of, and the text of its pages."""

    page: Page
    pages: tuple[str, ...]

    @property
    def text(self) -> str:
        return squeezed("".join(self.pages))


def squeezed(text: str) -> str:
    """Without what line breaks, hyphens and thin spaces make of it."""
    return re.sub(r"[\s\u200b\u2060\u00ad\u2009\u202f-]+", "", text)


def printed(fits: Sequence[Fit], *, annex: bool = False, **more: Any) -> Paper:
    """The report read back; without its annex, which takes the most of the reading, unless that is asked for."""
    told = {"created": CREATED, "verdict": handmade.verdict(fits), **more}
    page = report_page(fits, **told)
    if not annex:
        page = replace(page, annexes=())
    made = render_pdf(page)
    assert made.startswith(b"%PDF")
    return Paper(
        page, tuple(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(made)).pages)
    )


@cache
def paper(origin: Origin) -> Paper:
    """The report of a friction run; only the simulated one has its figure and its annex."""
    fit = handmade.fit(origin)
    if origin == "simulated":
        return printed([fit], annex=True)
    return printed([replace(fit, result=replace(fit.result, plots=()))])


def test_it_has_the_numbers_of_the_page() -> None:
    found = paper("simulated")
    page, text = found.page, found.text
    for wanted in (
        page.number,
        page.states[0].word,
        "SN-0815",
        "HarmonicGreaseSK-1A",
        "A.Example",
    ):
        assert squeezed(wanted) in text, wanted
    for row in page.judged[0].rows:
        assert all(squeezed(cell) in text for cell in row[1:3])
    for row in page.sections[0].grids[0].rows:
        for cell in row[:5]:
            # A symbol such as F_c is printed with its index below the line.
            assert squeezed(cell).replace("_", "") in text.replace("_", ""), cell


def test_hashes_stand_whole_in_one_line() -> None:
    assert any(
        "ab" * 32 in line
        for page in paper("simulated").pages
        for line in page.replace("\u200b", "").splitlines()
    )


def test_the_catalogue_stands_beside_the_results() -> None:
    found = paper("simulated")
    grid = found.page.judged[1]
    for cell in (grid.title, *grid.rows[0]):
        assert squeezed(cell) in found.text, cell
    assert found.text.index(squeezed(grid.title)) < found.text.index("Summary")


@pytest.mark.parametrize(
    ("origin", "word"), [("simulated", "SIMULATED"), ("replay", "REPLAY"), ("imported", "IMPORTED")]
)
def test_what_is_no_measurement_says_so_on_every_page_and_is_not_signed(
    origin: Origin, word: str
) -> None:
    found = paper(origin).pages
    # In the footer, across the page, and on the figures.
    assert all(page.count(word) >= 2 for page in found)
    assert not any("Approved by" in page for page in found)


def test_a_run_from_hardware_has_room_for_two_signatures_and_no_mark() -> None:
    whole = " ".join(paper("hardware").pages)
    assert "Tested by" in whole
    assert "Approved by" in whole
    assert "SIMULATED" not in whole


def test_every_page_is_numbered_and_names_its_runs() -> None:
    found = paper("simulated").pages
    for number, page in enumerate(found, 1):
        assert f"page {number} of {len(found)}" in page
        assert "Run R-000042" in page


def test_an_expired_calibration_is_loud_and_an_unsealed_file_is_not_signed() -> None:
    fit = handmade.fit("hardware", replace(handmade.friction_result(), plots=()), is_sealed=False)
    torque = Channel(
        name="torque",
        unit="N m",
        scale=1e-3,
        calibration=Calibration(certificate="C-7", date="2020-01-01", due="2021-01-01"),
    )
    object.__setattr__(fit.recording.source, "columns", (Column.of(torque),))
    found = printed([fit])
    alarm = squeezed(
        "The calibration of torque (C-7) was due on 2021-01-01: EXPIRED WHEN THE RUN BEGAN."
    )
    assert squeezed(found.pages[0]).index(alarm) < squeezed(found.pages[0]).index(
        "Judgedquantities"
    )
    assert squeezed("C-7, of 2020-01-01, due 2021-01-01: EXPIRED WHEN THE RUN BEGAN") in found.text
    assert "Approvedby" not in found.text
    assert squeezed("Not sealed, so that it could still change: R-000042") in found.text


HOSTILE = (
    '#import "x": *',
    "$ x^2 $ *bold* _it_ @ref <label>",
    '\\u{1F600} \\ `raw` "]#panic()',
    "<script>alert(1)</script>",
    "\x07\x00tab\tbell",
    "= heading // comment",
    "a_b~c--d'e",
)


def test_text_that_looks_like_markup_comes_out_as_it_stands() -> None:
    serial, operator, lubricant, fact, warning, run, note = HOSTILE
    result = replace(handmade.friction_result(), plots=(), warnings=(warning,), run=run)
    fit = handmade.fit(
        "simulated",
        result,
        gear_serial=serial,
        operator=operator,
        conditions={fact: lubricant},
        run_id=run,
        title=note,
    )
    found = printed([replace(fit, gear=replace(fit.gear, name=note))], note=note)
    for wanted in HOSTILE:
        plain = "".join(c for c in wanted if c.isprintable() or c == " ")
        assert (
            squeezed(plain) in found.text or squeezed(plain[:1].upper() + plain[1:]) in found.text
        ), wanted


def test_the_same_content_gives_the_same_plain_values() -> None:
    first, second = (paper_content(paper("replay").page) for _ in range(2))
    assert first == second
    annexes = paper_content(paper("simulated").page)["annexes"]
    assert annexes
    for table in annexes[0]["grids"]:
        assert len(table["kinds"]) == len(table["columns"])


def test_nothing_stands_in_the_margins() -> None:
    """Long numbers of runs, long words and tables of many columns stay within the text of their page."""
    long = "W" * 60
    tables = tuple(
        Table(
            f"wide{n}",
            f"{n} columns",
            tuple(f"column {k} [mN m]" for k in range(n)),
            ((0.123456,) * n,) * 40,
        )
        for n in (18, 40)
    )
    named = {"run": f"00042-friction-{long}", "warnings": (long * 9,)}
    result = replace(handmade.friction_result(), tables=tables, plots=(), **named)
    more = {
        "gear_serial": long,
        "operator": long,
        "process": {"git_commit": "0123456789" * 4, "backend": long},
        "conditions": {long: long * 3, "note": "word " * 300},
    }
    fits = [
        handmade.fit(result=result, **more),
        handmade.fit(result=handmade.kinematic_result(), **more),
    ]
    crosswise = 0
    pages = typeset(
        report_page(fits, created=CREATED, verdict=handmade.verdict(fits)),
        format="png",
        ppi=72.0,
    )
    for number, page in enumerate(pages, 1):
        picture = imread(io.BytesIO(page))[:, :, :3].min(axis=2)
        height, width = picture.shape
        crosswise += width > height
        across, down = (
            width / (297.0 if width > height else 210.0),
            height / (210.0 if width > height else 297.0),
        )
        left, bottom, top = round(17.0 * across), round(7.0 * down), round(8.0 * down)
        # The mark across the page is pale; ink is not.
        assert picture[:, :left].min() > 0.6
        assert picture[:, -left:].min() > 0.6
        assert picture[-bottom:, :].min() > 0.6
        assert picture[:top, :].min() > 0.6
        assert np.count_nonzero(picture < 0.5) > 100, "an empty page"
        inked = np.flatnonzero((picture[2 * top : -3 * bottom] < 0.5).any(axis=1))
        assert number == len(pages) or np.ptp(inked) > height / 3, f"page {number} is nearly empty"
    assert crosswise


def test_a_document_that_cannot_be_set_is_refused_with_the_reason() -> None:
    """By what typst says of it, and where its process dies of it by that."""
    with pytest.raises(RigError, match=r"cannot be set on paper.*unknown variable: nowhere"):
        set_pages(Document("#nowhere", "{}", ()), {"format": "pdf"})
    with pytest.raises(RigError, match=r"cannot be set on paper: its process ended with 1"):
        set_pages(Document("", "{}", ()), {"no such option": 1})


def test_the_document_is_set_in_a_process_that_ends_with_it() -> None:
    """typst keeps 300 MB of a certificate for as long as its process lives."""
    asked = """
import sys
from rig.present.typesetting import Document, set_pages
(made,) = set_pages(Document("Hello", "{}", ()), {"format": "pdf"})
print(made[:4], "typst" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert done.stdout == "b'%PDF' False\n"
