"""The report of a gear over its life: a control chart that goes wrong is read from the page and from the paper."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pypdf
import pytest
from typer.testing import CliRunner

from rig.main import app
from rig.passport import passport
from rig.report.gear import gear_context
from rig.report.page import render_page
from rig.report.pdf import render_pdf
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write
from tests.rig.test_report_pdf import squeezed

CREATED = "2026-11-21 08:00:00+00:00"
VALUES = (80.0, 81.0, 79.5, 80.5, 95.25)
"""Running torques [mN m] of a gear that is worn in the fifth run."""


def life(folder: Path) -> Path:
    """The runs of a gear, each with its analysis."""
    for day, value in enumerate(VALUES, 1):
        write(folder, day, start_time=start(day))
        (run,) = folder.glob(f"{day:05d}-*.h5")
        analyse(run, estimate(RUNNING, 1e-3 * value, own=0.2e-3))
    return folder


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return life(tmp_path_factory.mktemp("worn"))


@pytest.fixture(scope="module")
def context(worn: Path) -> dict[str, Any]:
    return gear_context(passport(worn, "A1", baseline=4), created=CREATED)


def test_the_worst_state_stands_at_the_head(context: dict[str, Any]) -> None:
    assert context["overall"].word == "OUT OF CONTROL"
    assert context["overall"].style == "fail"
    assert context["serial"] == "A1"
    assert any("95.25 ± 0.40 mN m" in row for row in context["key_results"])


def test_page_and_paper_say_the_same(context: dict[str, Any]) -> None:
    page = render_page(context)
    pages = [p.extract_text() for p in pypdf.PdfReader(io.BytesIO(render_pdf(context))).pages]
    paper = squeezed("".join(pages))
    for wanted in (context["number"], "Passport of gear A1", "OUT OF CONTROL", "95.25 ± 0.40 mN m", "Runs that count"):
        assert wanted in page, wanted
        assert squeezed(wanted) in paper, wanted
    for run in (f"{day:05d}-friction-A1" for day in range(1, 6)):
        assert run in page
        assert squeezed(run) in paper
    assert all(text.count("SIMULATED") >= 2 for text in pages)
    assert not context["signature"].allowed
    assert "Approved by" not in page


def test_the_command_writes_both(worn: Path, tmp_path: Path) -> None:
    target = tmp_path / "A1.pdf"
    done = CliRunner().invoke(
        app, ["report", "--gear", "A1", "--runs", str(worn), "--format", "both", "--output", str(target)]
    )
    assert done.exit_code == 0, done.output
    assert target.read_bytes().startswith(b"%PDF")
    assert "Passport of gear A1" in target.with_suffix(".html").read_text(encoding="utf-8")


def test_a_gear_without_runs_is_refused_and_nothing_is_written(worn: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["report", "--gear", "Z9", "--runs", str(worn), "--output", str(tmp_path / "z.html")]
    )
    assert done.exit_code != 0
    assert not list(tmp_path.iterdir())
