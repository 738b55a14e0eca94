"""The report of a gear over its life: verdict, catalogue, charts and files are read from the page
and from the paper.
"""

from __future__ import annotations

import html
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pypdf
import pytest
from typer.testing import CliRunner

from experiments import catalogue
from experiments.result import Result
from model.gear_file import gear_to_mapping, shipped_gear
from rig.analysis.passport.build import passport
from rig.analysis.result_data import quantities_for
from rig.analysis.store import Basis, append_analysis
from rig.content.page import Page
from rig.errors import RigError
from rig.gears.acceptance import Acceptance, Limit
from rig.main import app
from rig.present.gear import gear_page
from rig.present.page import render_page
from rig.present.paper import render_pdf
from rig.runfile.seal import recorded_sha256
from tests.rig.library.stored import RUNNING, estimate, start, write
from tests.rig.present.test_paper import squeezed
from tests.rig.runfile.making import reseal

CREATED = "2026-11-21 08:00:00+00:00"
VALUES = (80.0, 81.0, 79.5, 80.5, 80.0, 81.0, 79.5, 80.5, 80.0, 81.0, 88.0, 92.25, 95.25)
"""Running torques [mN m] of a gear that wears from the eleventh run on."""
LIMIT = 0.09
"""Verified limit [N m]: kept by all but the last."""
ACCEPTANCE = Acceptance(
    name="specification",
    source="page 12",
    use="any",
    limits=(
        Limit(
            quantity=f"friction.{RUNNING}",
            unit="N m",
            source="page 12",
            standing="customer",
            upper=LIMIT,
            confirmed_by="A. Example",
            confirmed_on="2026-11-01",
        ),
    ),
    path="spec.toml",
)
TARE = {"run": "00000-motor_tare-bare", "sha256": "cd" * 32}


def life(folder: Path, values: Sequence[float] = VALUES, **more: Any) -> Path:
    """The runs of a gear, each with its analysis."""
    for day, value in enumerate(values, 1):
        write(folder, day, **{"start_time": start(day), "operator": "Ada Grün", **more})
        (run,) = folder.glob(f"{day:05d}-*.h5")
        found = estimate(RUNNING, 1e-3 * value, own=0.2e-3)
        options = {"torque_is_of": "gear", "channel": "torque", "tare_run": TARE["run"]}
        result = Result(
            run=run.name.removesuffix(".h5"),
            kind="friction",
            quantities=quantities_for("friction", {RUNNING: found}, ()),
            estimates={RUNNING: found},
            options=options,
        )
        append_analysis(
            run,
            result,
            Basis(
                recorded_sha256(run),
                "2025-11-21T05:00:00+00:00",
                gear_to_mapping(shipped_gear()),
                TARE,
                analysis_version=catalogue.load("friction").version,
            ),
        )
    return folder


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return life(tmp_path_factory.mktemp("worn"))


@pytest.fixture(scope="module")
def page(worn: Path) -> Page:
    found = passport(worn, "A1")
    return gear_page(found, created=CREATED, acceptance=ACCEPTANCE)[0]


@pytest.fixture(scope="module")
def pages(page: Page) -> list[str]:
    return [one.extract_text() for one in pypdf.PdfReader(io.BytesIO(render_pdf(page))).pages]


@pytest.fixture(scope="module")
def both(page: Page, pages: list[str]) -> tuple[str, str]:
    """The report on screen and on paper, squeezed."""
    return squeezed(html.unescape(render_page(page))), squeezed("".join(pages))


def test_the_verdict_of_the_newest_run_and_the_worst_state_stand_at_the_head(
    page: Page,
) -> None:
    verdict, state = page.states
    assert (verdict.word, verdict.tone) == ("FAIL", "bad")
    assert "newest run of every kind" in verdict.sentence
    assert (state.word, state.tone) == ("CHANGED", "bad")
    assert "is larger by" in state.sentence
    assert "Of one quantity over time: 1 changed." in state.sentence
    figures = [figure for part in page.sections for figure in part.figures]
    assert len({figure.number for figure in figures}) == len(figures) == 2
    assert ("Serial number", "A1") in page.facts
    assert any("95.25 ± 0.39 mN m" in row for row in page.summary[0].rows)


def test_page_and_paper_say_the_same(page: Page, both: tuple[str, str]) -> None:
    wanted = [
        page.number,
        "Passport of gear A1",
        "FAIL",
        "CHANGED",
        "95.25 ± 0.39 mN m",
        "Runs that count",
        "Ada Grün",
        "expected from the runs before",
        "since the change",
        "No-load running torque at 1000 r/min (changed)",
        "is larger by",
        "≤ 90 mN m",
        "page 12",
    ]
    wanted += [f"{day:05d}-friction-A1" for day in range(1, len(VALUES) + 1)]
    for text in wanted:
        assert all(squeezed(text) in made for made in both), text


def test_the_catalogue_with_the_conditions_of_both_stands_in_it(
    page: Page, both: tuple[str, str]
) -> None:
    row = page.judged[1].rows[0]
    assert row[0].startswith("running torque 1000 r/min: torque that keeps the input turning")
    assert row[1] == "95.25 ± 0.39 mN m"
    assert row[2] == "100 mN m"
    assert "at a stated speed and temperature (20 °C)" in row[3]
    assert row[4] == "lubricant SK-1A, torque of gear"
    for made in both:
        assert all(squeezed(cell) in made for cell in row[1:])


def test_every_file_and_the_tare_stand_in_it_with_their_hashes(
    worn: Path, both: tuple[str, str]
) -> None:
    hashes = [recorded_sha256(run) for run in sorted(worn.glob("*.h5"))]
    assert len(set(hashes)) == len(VALUES)
    for sha256 in (*hashes, TARE["sha256"]):
        assert all(sha256 in made for made in both)
    assert all(squeezed(f"run {TARE['run']}") in made for made in both)


def test_versions_calibrations_and_definitions_stand_in_it(both: tuple[str, str]) -> None:
    for text in (
        "Program version",
        "Git commit",
        "PTB-17, of 2025-02-03, due 2027-02-03",
        "5 % are told to have changed within 20 runs",
    ):
        assert all(squeezed(text) in made for made in both), text


def test_every_page_carries_the_mark_and_none_is_signed(page: Page, pages: list[str]) -> None:
    assert all(text.count("SIMULATED") >= 2 for text in pages)
    assert not page.signature.allowed
    assert not any("Approved by" in text for text in pages)


def test_a_gear_on_hardware_can_be_signed_and_an_expired_calibration_is_an_alarm(
    tmp_path: Path,
) -> None:
    life(tmp_path, VALUES[:2], origin="hardware", start_time="2027-03-05T09:00:00.000+00:00")
    made, _ = gear_page(passport(tmp_path, "A1"), created=CREATED)
    alarm = (
        "The calibration of torque (PTB-17) was due on 2027-02-03: EXPIRED WHEN THE RUN BEGAN. "
        "(runs 00001-friction-A1, 00002-friction-A1)"
    )
    assert made.alarms == (alarm,)
    assert made.signature.allowed
    plain = replace(made, sections=tuple(replace(part, figures=()) for part in made.sections))
    found = [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(render_pdf(plain))).pages]
    assert squeezed(alarm) in squeezed(found[0])
    assert any("Approved by" in text for text in found)
    assert not any("SIMULATED" in text for text in found)


def test_what_was_measured_once_has_a_line_and_no_chart(tmp_path: Path) -> None:
    life(tmp_path, VALUES[:1])
    made, _ = gear_page(passport(tmp_path, "A1"), created=CREATED)
    (once,) = [part for part in made.sections if part.title == "Measured once"]
    (row,) = once.grids[0].rows
    assert "80.00 ± 0.39" in row
    assert "00001-friction-A1" in row
    assert not any(part.figures for part in made.sections)
    twice = tmp_path / "twice"
    twice.mkdir()
    made, _ = gear_page(passport(life(twice, VALUES[:2]), "A1"), created=CREATED)
    assert not any(part.title == "Measured once" for part in made.sections)
    assert any(part.figures for part in made.sections)


def test_the_command_writes_both(worn: Path, tmp_path: Path) -> None:
    target = tmp_path / "A1.pdf"
    done = CliRunner().invoke(
        app,
        [
            "report",
            "--gear",
            "A1",
            "--runs",
            str(worn),
            "--format",
            "both",
            "--output",
            str(target),
        ],
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


def test_a_gear_without_an_analysis_is_not_judged_and_its_files_are_listed(tmp_path: Path) -> None:
    write(tmp_path, 1)
    made, _ = gear_page(passport(tmp_path, "A1"), created=CREATED)
    assert [state.word for state in made.states] == ["NOT JUDGED", "NOTHING TO FOLLOW"]
    assert made.judged == ()
    (sha256,) = (recorded_sha256(run) for run in tmp_path.glob("*.h5"))
    assert sha256 in render_page(made)
    assert sha256 in squeezed(
        "".join(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(render_pdf(made))).pages)
    )


def test_an_analysis_that_is_none_is_named(tmp_path: Path) -> None:
    life(tmp_path, VALUES[:1])
    found = passport(tmp_path, "A1")
    (newest,) = (tmp_path / "00001-friction-A1.analysis").glob("0*.json")
    newest.chmod(0o644)
    newest.write_text(
        newest.read_text(encoding="utf-8")
        .replace('"verdicts"', '"verdict"')
        .replace('"unit"', '"units"')
    )
    reseal(newest)
    with pytest.raises(RigError, match="holds no result"):
        gear_page(found, created=CREATED)
