"""The report on paper: the same words and numbers as on screen, marked on every page, deaf to what looks like markup."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import pypdf
import pytest

from experiments.recording import Origin
from rig.report.page import report_context
from rig.report.pdf import paper_content, render_pdf
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
    assert all(len(grid["weights"]) == len(grid["columns"]) for grid in first["annex"])


def test_an_expired_calibration_is_loud() -> None:
    from drivers.channel import Calibration
    from rig.report.provenance import calibrations_of
    from rig.runfile.layout import Column

    recording = handmade.recording()
    column = Column("torque", "N m", "int32", 1e-3, 0.0, calibration=Calibration("C-7", "2020-01-01", "2021-01-01"))
    object.__setattr__(recording.source, "columns", (column,))
    assert calibrations_of(recording) == (("Torque", "C-7, of 2020-01-01, due 2021-01-01: EXPIRED WHEN THE RUN BEGAN"),)
