"""The report on paper: the same words and numbers as on screen, marked on every page, deaf to what looks like markup."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pypdf
import pytest
from matplotlib.image import imread

from experiments.recording import Origin
from experiments.result import Table
from rig.report.content import Grid
from rig.report.layout import LANDSCAPE, PORTRAIT, layout_of
from rig.report.page import report_context
from rig.report.pdf import draw_pages, paper_content, render_pdf
from tests.rig import handmade

CREATED = "2026-11-21 08:00:00+00:00"


def pages(origin: Origin = "simulated", **more: Any) -> list[str]:
    context = report_context([handmade.fit(origin, **more)], created=CREATED)
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(render_pdf(context))).pages]


def squeezed(text: str) -> str:
    """Without what line breaks, hyphens and thin spaces make of it."""
    return re.sub(r"[\s\u200b\u00ad\u2009\u202f-]+", "", text)


def test_it_is_a_pdf_with_the_numbers_of_the_page(tmp_path: Path) -> None:
    context = report_context([handmade.fit()], created=CREATED)
    made = render_pdf(context)
    assert made.startswith(b"%PDF")
    text = squeezed("".join(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(made)).pages))
    for wanted in (context["number"], context["overall"].word, "SN-0815", "ab" * 32, "HarmonicGreaseSK-1A", "A.Example"):
        assert squeezed(wanted) in text, wanted
    for line in context["verdicts"]:
        assert squeezed(line.value) in text
        assert squeezed(line.limit) in text
    for row in context["parts"][0].estimates.rows:
        for cell in row[:5]:
            assert squeezed(cell) in text, cell


@pytest.mark.parametrize(("origin", "word"), [("simulated", "SIMULATED"), ("replay", "REPLAY"), ("imported", "IMPORTED")])
def test_what_is_no_measurement_says_so_on_every_page_and_is_not_signed(origin: Origin, word: str) -> None:
    found = pages(origin)
    # In the footer, across the page, and on the figures.
    assert all(page.count(word) >= 2 for page in found)
    assert not any("Approved by" in page for page in found)


def test_a_run_from_hardware_has_room_for_two_signatures_and_no_mark() -> None:
    found = pages("hardware")
    whole = " ".join(found)
    assert "Tested by" in whole
    assert "Approved by" in whole
    assert "SIMULATED" not in whole


def test_every_page_is_numbered() -> None:
    found = pages()
    for number, page in enumerate(found, 1):
        assert f"page {number} of {len(found)}" in page


@pytest.mark.parametrize(
    "serial",
    ['#import "x": *', "$ x^2 $ *bold* _it_ @ref <label>", "\\u{1F600} \\ `raw`", "<script>alert(1)</script>", "x" * 400,
     "\x07\x00tab\t"],
)  # fmt: skip
def test_text_that_looks_like_markup_comes_out_as_it_stands(serial: str) -> None:
    found = squeezed(" ".join(pages(gear_serial=serial)))
    wanted = squeezed("".join(c for c in serial if c.isprintable() or c == " "))
    assert wanted[:60] in found


def test_the_same_content_gives_the_same_plain_values() -> None:
    first, second = (paper_content(report_context([handmade.fit()], created=CREATED)) for _ in range(2))
    assert first == second
    assert all(len(grid["widths"]) == len(grid["columns"]) for grid in first["annex"])


def test_an_expired_calibration_is_loud() -> None:
    from drivers.channel import Calibration
    from rig.report.provenance import calibrations_of
    from rig.runfile.layout import Column

    recording = handmade.recording()
    column = Column("torque", "N m", "int32", 1e-3, 0.0, calibration=Calibration("C-7", "2020-01-01", "2021-01-01"))
    object.__setattr__(recording.source, "columns", (column,))
    assert calibrations_of(recording) == (("Torque", "C-7, of 2020-01-01, due 2021-01-01: EXPIRED WHEN THE RUN BEGAN"),)


def test_nothing_stands_in_the_margins() -> None:
    """Long numbers of runs, long words and tables of many columns stay within the text of their page."""
    long = "W" * 60
    table = Table("wide", "Many columns", tuple(f"column {k} [mN m]" for k in range(18)), ((0.123456,) * 18,) * 40)
    result = replace(handmade.friction_result(), tables=(table,), run=f"00042-friction-{long}")
    more = {"gear_serial": long, "operator": long, "process": {"git_commit": "0123456789" * 4, "backend": long},
            "conditions": {long: long}}  # fmt: skip
    fits = [handmade.fit(result=result, **more), handmade.fit(result=handmade.kinematic_result(), **more)]
    for page in draw_pages(report_context(fits, created=CREATED), 72.0):
        picture = imread(io.BytesIO(page))[:, :, :3].min(axis=2)
        height, width = picture.shape
        across, down = width / (297.0 if width > height else 210.0), height / (210.0 if width > height else 297.0)
        left, bottom = round(17.0 * across), round(7.0 * down)
        # The mark across the page is pale; ink is not.
        assert picture[:, :left].min() > 0.6
        assert picture[:, -left:].min() > 0.6
        assert picture[-bottom:, :].min() > 0.6
        assert np.count_nonzero(picture < 0.5) > 100, "an empty page"


def test_a_table_is_no_wider_than_its_page() -> None:
    for columns in (2, 5, 9, 14, 20, 40):
        for cell in ("1.5", "a longer text that may be broken into lines", "x" * 200, ""):
            grid = Grid("t", ("heading of a column",) * columns, ((cell,) * columns,), (False,) * columns)
            found = layout_of(grid)
            room = LANDSCAPE if found.landscape else PORTRAIT
            assert sum(width * found.size + 7.0 for width in found.widths) <= room + 1.0, (columns, cell)
