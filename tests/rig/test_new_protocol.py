"""A protocol that is added in one file and one line of the catalogue is shown everywhere as it declares itself."""

from __future__ import annotations

import contextlib
import html
import io
import re
from pathlib import Path

import numpy as np
import pytest

import rig.main
from experiments import catalogue
from experiments.errors import AnalysisError
from experiments.quantity import key_names
from experiments.result import Result
from model.units import ARCSEC, RPM
from rig.analysis.difference import difference
from rig.analysis.passport.build import passport
from rig.analysis.store import read_analyses
from rig.content.wording import metric_text, show
from tests.rig import toy_protocol
from tests.rig.library.stored import analyse, start, write
from tests.rig.toy_protocol import toy_estimates


@pytest.fixture(autouse=True)
def _in_the_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "ENTRIES", (*catalogue.ENTRIES, toy_protocol.ENTRY))


@pytest.fixture
def result() -> Result:
    """What an analysis of the toy returns."""
    estimates = {estimate.name: estimate for estimate in toy_estimates()}
    return Result(
        run="R-1",
        kind="toy",
        quantities=toy_protocol.QUANTITIES,
        estimates=estimates,
        metrics={"dwell_rate": 30.0 * RPM},
    )


def run_of_the_toy(folder: Path, number: int, backlash: float) -> Path:
    run = write(folder, number, "toy", start_time=start(number))
    analyse(
        run,
        *toy_estimates(backlash * ARCSEC),
        kind="toy",
        options={"pace": "120"},
        metrics={"dwell_rate": 30.0 * RPM},
    )
    return run


def test_it_is_found_by_its_name_alone() -> None:
    assert "toy" in catalogue.names()
    assert catalogue.load("toy").title == "Play of a toy"


def test_its_numbers_have_its_titles_and_its_units(result: Result) -> None:
    texts = {
        result.quantity(name).titled(name): show(estimate, result.quantity(name)).with_uncertainty
        for name, estimate in result.estimates.items()
    }
    assert texts["play of the toy"] == "40.0 ± 2.0 arcsec"
    assert texts["static wind-up"] == "1.500 ± 0.033 arcmin"
    assert texts["twist forward"].endswith(" °")
    dwell = result.quantity("dwell_rate")
    assert (dwell.title, metric_text(dwell, 30.0 * RPM)) == ("rate of dwelling", "30 r/min")


def test_its_key_result_is_the_one_it_declares(result: Result) -> None:
    assert key_names(result.quantities, result.estimates) == ("backlash",)


def test_a_number_that_it_does_not_declare_is_refused() -> None:
    with pytest.raises(AnalysisError, match=r"toy\.wobble.*protocol's quantities"):
        Result(
            run="R-1",
            kind="toy",
            quantities=toy_protocol.QUANTITIES,
            estimates={},
            metrics={"wobble": 1.0},
        )


def test_its_analysis_lies_in_the_store_with_what_its_numbers_are(tmp_path: Path) -> None:
    run = run_of_the_toy(tmp_path, 1, 40.0)
    (stored,) = read_analyses(run)
    assert stored.content["quantities"]["backlash"] == {
        "title": "play of the toy",
        "unit": "rad",
        "definition": "what the output loses between the ways",
    }
    read = stored.result
    assert read.quantity("backlash") is toy_protocol.QUANTITIES[0]


def test_the_difference_of_two_of_its_runs_is_in_its_words(tmp_path: Path) -> None:
    runs = [run_of_the_toy(tmp_path, number, play) for number, play in ((1, 40.0), (2, 50.0))]
    found = {change.title: change for change in difference(*runs).of("results") if change.title}
    play = found["play of the toy"]
    assert (play.first, play.second) == ("40.0 ± 2.0 arcsec", "50.0 ± 2.0 arcsec")
    assert play.shown == "10.0 ± 2.8 arcsec"
    assert play.significant


def test_a_passport_follows_what_it_declares_as_watched(tmp_path: Path) -> None:
    for number, play in ((1, 40.0), (2, 42.0)):
        run_of_the_toy(tmp_path, number, play)
    (series,) = passport(tmp_path, "A1").series
    assert (series.title, series.display_unit) == ("Play of the toy", "arcsec")
    assert series.definition == "what the output loses between the ways"
    assert series.conditions == {"part": "CSF-25-120-2UH", "pace": "120"}
    assert series.plot.y_label == "play of the toy [arcsec]"
    assert series.plot.series[0].y == pytest.approx(np.array([40.0, 42.0]))


def test_a_passport_says_what_there_is_none_of(tmp_path: Path) -> None:
    write(tmp_path, 1, "friction")
    missing = {one.what: one.remedy for one in passport(tmp_path, "A1").missing}
    assert missing["Play of the toy: there is no toy run of this gear"] == "rig run toy"


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the toy on the simulated rig, made by its command."""
    folder = tmp_path_factory.mktemp("toy")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue, "ENTRIES", (*catalogue.ENTRIES, toy_protocol.ENTRY))
        called("run", "toy", "--backend", "sim", "--gear", "A1", "--output", str(folder))
    (run,) = folder.glob("*.h5")
    return run


def called(*words: str) -> str:
    """What a command prints on standard output."""
    out = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.suppress(SystemExit),
    ):
        patch.setenv("COLUMNS", "200")
        rig.main.run(list(words))
    return out.getvalue()


def test_the_terminal_plans_it_and_shows_its_flags() -> None:
    helped = called("run", "toy", "--help")
    assert "toy: Play of a toy" in helped
    assert "--pace-rpm" in helped
    assert "toy: Play of a toy" in called("plan", "toy")


def test_the_terminal_shows_its_numbers_as_it_declares_them(turned: Path) -> None:
    short = called("fit", str(turned), "--no-keep")
    assert re.search(r"play of the toy +40\.0 ± 2\.0 +arcsec +yes", short), short
    # The statistical intervals stand among all that was found.
    text = called("fit", str(turned), "--no-keep", "--all")
    assert "38.0 … 42.0" not in short
    assert re.search(r"play of the toy +40\.0 ± 2\.0 +arcsec +yes", text), text
    assert re.search(r"play of the toy +38\.0 … 42\.0 +arcsec", text), text
    assert re.search(r"static wind-up +1\.500 ± 0\.033 +arcmin", text)
    assert re.search(r"twist forward +28\.6\d+ ± 0\.0\d+ +°", text)
    assert re.search(r"rate of dwelling +120 r/min", text)


def test_the_report_has_its_title_its_numbers_and_its_figure(turned: Path, tmp_path: Path) -> None:
    page = tmp_path / "toy.html"
    called("report", str(turned), "--output", str(page))
    markup = re.sub(r"<svg.*?</svg>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", markup)))
    assert "Play of a toy" in text
    # The key result stands in the summary, which names the kind of fit; the others do not.
    assert re.search(r"toy play of the toy 40\.0 ± 2\.0 arcsec yes", text)
    assert not re.search(r"toy static wind-up", text)
    assert re.search(r"static wind-up 1\.500 ± 0\.033 arcmin", text)
    assert "rate of dwelling 120 r/min" in text
    assert "Play What a toy loses when it turns back." in text
    assert "99 the play of a toy" in text
    assert "Play of the toy over time" in text


def test_its_passport_and_difference_stand_on_the_terminal(tmp_path: Path) -> None:
    runs = [run_of_the_toy(tmp_path, number, play) for number, play in ((1, 40.0), (2, 50.0))]
    compared = called("diff", *map(str, runs))
    row = r"play of the toy +40\.0 ± 2\.0 arcsec +50\.0 ± 2\.0 arcsec +10\.0 ± 2\.8 arcsec +significant"
    assert re.search(row, compared), compared
    passported = called("report", "--gear", "A1", "--passport", "--runs", str(tmp_path))
    assert re.search(r"Play of the toy .*50\.0 ± 2\.0 +arcsec", passported), passported
