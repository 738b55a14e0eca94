"""The certificate: page one says what the analyses in force say, judges nothing itself, and shows what is missing."""

from __future__ import annotations

import hashlib
import html
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pypdf
import pytest
from typer.testing import CliRunner

import rig.present.certificate as package
from experiments import catalogue
from experiments.result import Panel, Plot, Result, Series
from model.gear_file import gear_to_mapping, shipped_gear
from rig.analysis.fit import Fit
from rig.analysis.judging import GearVerdict
from rig.analysis.result_data import quantities_for
from rig.analysis.store import FORMAT_2, Basis, append_analysis
from rig.content.page import Page
from rig.errors import ConfigurationError, RigError
from rig.gears.acceptance import Acceptance, Limit
from rig.main import app
from rig.present.certificate import front as front_module
from rig.present.certificate import gather
from rig.present.certificate.curves import with_limits
from rig.present.certificate.front import front_page, value_grid
from rig.present.certificate.gather import certified
from rig.present.certificate.laboratory import LaboratoryWords, laboratory_of
from rig.present.certificate.rests_on import manifest_of
from rig.present.certificate.write import certificate_page
from rig.present.page import render_page
from rig.present.paper import render_pdf
from rig.runfile.seal import recorded_sha256
from tests.rig.handmade import save_acceptance
from tests.rig.library.stored import RUNNING, estimate, start, write
from tests.rig.present.test_paper import squeezed
from tests.rig.runfile.making import reseal

AT = "2026-03-02T10:00:00+00:00"
ACCURACY = "transmission_accuracy_forward"
LABORATORY = LaboratoryWords(
    name="Test house", address="Street 1", customer="Robots Ltd", order="PO 4711", method="TI 12"
)
X = np.linspace(1.0, 3000.0, 40)
CURVES = {
    "friction": Plot(
        name="friction-curve",
        title="No-load running torque over speed",
        x_label="input speed [r/min]",
        y_label="torque [mN m]",
        series=(
            Series(label="measured", x=X, y=50.0 + X / 50.0, style="points"),
            Series(label="", x=X, y=np.zeros(40), style="points", panel=1),
        ),
        figure="9",
        panels=(Panel("residual [mN m]", 0.4),),
        enlarged=(0.0, 60.0),
    ),
    "kinematic-error": Plot(
        name="kinematic-error-fit",
        title="Kinematic error, averaged per input angle",
        x_label="input angle [deg]",
        y_label="forward [arcmin]",
        series=(Series(label="measured, forward", x=X, y=np.sin(X)),),
        figure="13",
    ),
}


def limit_of(kind: str, name: str, upper: float, unit: str) -> Limit:
    return Limit(
        quantity=f"{kind}.{name}",
        unit=unit,
        source="specification, page 12",
        standing="customer",
        upper=upper,
        confirmed_by="A. Example",
        confirmed_on="2026-01-02",
    )


ACCEPTANCE = Acceptance(
    name="specification",
    source="page 12",
    use="any",
    limits=(
        limit_of("friction", RUNNING, 0.09, "mN m"),
        limit_of("kinematic-error", ACCURACY, 4e-4, "arcmin"),
    ),
    path="spec.toml",
)


def lay(folder: Path, number: int, kind: str, found: dict[str, Any], **more: Any) -> Path:
    """A run with its analysis in the store."""
    run = write(folder, number, kind, start_time=start(number), operator="Ada Grün", **more)
    result = Result(
        run=run.name.removesuffix(".h5"),
        kind=kind,
        quantities=quantities_for(kind, found, ()),
        estimates=found,
        plots=(CURVES[kind],),
        options={"torque_is_of": "gear"},
    )
    basis = Basis(
        recorded_sha256(run),
        AT,
        gear_to_mapping(shipped_gear()),
        analysis_version=catalogue.load(kind).version,
    )
    append_analysis(run, result, basis)
    return run


def gear(folder: Path, torque: float = 0.08, accuracy: float = 3e-4, **more: Any) -> Path:
    """The two runs of a gear."""
    lay(folder, 1, "friction", {RUNNING: estimate(RUNNING, torque, own=2e-4)}, **more)
    found = {ACCURACY: estimate(ACCURACY, accuracy, "rad", own=1e-5)}
    lay(folder, 2, "kinematic-error", found, **more)
    save_acceptance(ACCEPTANCE, folder / "spec.toml")
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gear(tmp_path_factory.mktemp("whole"))


def accepted(folder: Path) -> Acceptance:
    return replace(ACCEPTANCE, path=str(folder / "spec.toml"))


def page_of(folder: Path, **more: Any) -> Page:
    told = {"acceptance": accepted(folder), **more}
    with certified(folder, "A1", **told) as gathered:
        return certificate_page(
            gathered, LABORATORY, manifest_of(gathered), created="2026-03-02 10:00:00"
        )


@pytest.fixture(scope="module")
def page(whole: Path) -> Page:
    return page_of(whole)


@pytest.fixture(scope="module")
def pages(page: Page) -> list[str]:
    made = render_pdf(replace(page, annexes=()))
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(made)).pages]


def test_page_one_agrees_with_the_json_of_the_same_store(whole: Path, pages: list[str]) -> None:
    order = ["certificate", "--gear", "A1", "--runs", str(whole), "--json"]
    order += ["--acceptance", str(whole / "spec.toml"), "-o", str(whole / "c.html")]
    ran = CliRunner().invoke(app, order)
    told = json.loads(ran.stdout)
    first = squeezed(pages[0])
    assert (ran.exit_code, told["verdict"], told["complete"]) == (0, "PASS", True)
    assert squeezed(told["sentence"]) in first
    assert squeezed(told["decision_rule"]) in first
    for line in told["limits"]:
        assert squeezed(line["outcome"]) in first
    for number, run in ((1, "friction"), (2, "kinematic-error")):
        path = whole / f"{number:05d}-{run}-A1.h5"
        stored = json.loads(next((whole / f"{path.stem}.analysis").glob("0*.json")).read_text())
        assert told["runs"][run] == stored["run"]
        assert recorded_sha256(path) in first
        for one in stored["result"]["parameters"].values():
            assert squeezed(f"{one['coverage_factor']:.2f}") in first
    assert hashlib.sha256((whole / "spec.toml").read_bytes()).hexdigest() in first
    for words in ("80.00±0.39mNm", "≤90mNm", "1.031±0.067arcmin", "≤1.375arcmin"):
        assert words in first


def test_page_one_alone_is_enough(pages: list[str]) -> None:
    first = squeezed(pages[0])
    for words in (
        "Certificate HC-",
        "Test house",
        "Robots Ltd",
        "PO 4711",
        "TI 12",
        "serial number A1, ratio 120",
        "The gear A1 keeps all 2 limits of the acceptance file specification.",
        "Ada Grün",
        "Kinematic error, averaged per input angle",
        "No-load running torque over speed",
        "SIMULATED",
    ):
        assert squeezed(words).lower() in first.lower()
    assert "Curvesafterthepaper" not in first


def test_every_page_carries_the_word_of_a_run_that_is_not_hardware(pages: list[str]) -> None:
    assert len(pages) > 3
    assert all("SIMULATED" in page for page in pages)
    assert "Approved by" not in "".join(pages)


def test_hardware_has_room_for_two_signatures(tmp_path: Path) -> None:
    folder = gear(tmp_path, origin="hardware")
    made = page_of(folder)
    assert made.signature.allowed
    shown = render_page(made)
    assert "Tested by: name" in shown
    assert "Approved by: name" in shown
    assert "SIMULATED" not in shown


def test_the_verdict_is_what_judges_says_and_no_other(
    whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = GearVerdict(verdict="MARGINAL", because=("because the stand-in says so",))
    monkeypatch.setattr(gather, "judge", lambda *_: said)
    front = page_of(whole).front
    assert (front["word"], front["because"]) == ("MARGINAL", ["because the stand-in says so"])
    assert {row[-1] for row in front["values"].rows} == {front_module.NO_LIMIT}


def test_no_module_of_the_certificate_holds_a_value_against_a_limit() -> None:
    for path in Path(package.__file__).parent.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "outcome_against" not in text
        assert "lacks_number" not in text


@pytest.mark.parametrize(
    ("torque", "word", "words"),
    [(0.12, "FAIL", "breaks 1 of the 2 limits"), (0.09, "MARGINAL", "does not keep 1 of them")],
)
def test_a_bad_gear_is_told_in_one_sentence(
    tmp_path: Path, torque: float, word: str, words: str
) -> None:
    front = page_of(gear(tmp_path, torque=torque)).front
    assert front["word"] == word
    assert words in front["sentence"]
    assert any("running torque" in reason for reason in front["because"])


def test_what_was_asked_for_and_is_missing_makes_it_incomplete(tmp_path: Path) -> None:
    folder = tmp_path
    lay(folder, 1, "friction", {RUNNING: estimate(RUNNING, 0.08, own=2e-4)})
    save_acceptance(ACCEPTANCE, folder / "spec.toml")
    front = page_of(folder, protocols=("friction", "velocity-steps")).front
    assert "velocity-steps, kinematic-error" in front["incomplete"]
    assert front["word"] == "NOT JUDGED"
    assert "INCOMPLETE" in render_page(page_of(folder))


def test_a_gear_without_an_acceptance_file_is_not_judged(whole: Path) -> None:
    with certified(whole, "A1") as gathered:
        front = front_page(gathered, LABORATORY, manifest_of(gathered))
    assert front["word"] == "NOT JUDGED"
    assert "--acceptance" in front["sentence"]
    assert {row[-1] for row in front["values"].rows} == {front_module.NO_LIMIT}


def test_an_unfinished_newer_run_is_passed_over_and_named(tmp_path: Path) -> None:
    folder = gear(tmp_path)
    write(folder, 3, "friction", start_time=start(3), outcome="ABORTED")
    with certified(folder, "A1", acceptance=accepted(folder)) as gathered:
        assert {fit.result.run for fit in gathered.fits} >= {"00001-friction-A1"}
        (remark,) = gathered.passed_over
    assert "00003-friction-A1" in remark
    assert "ABORTED" in remark


def test_a_stale_analysis_is_said_with_the_command_that_renews_it(tmp_path: Path) -> None:
    folder = gear(tmp_path)
    store = next((folder / "00001-friction-A1.analysis").glob("0*.json"))
    content = json.loads(store.read_text()) | {"analysis_version": 1}
    store.chmod(0o644)
    store.write_text(json.dumps(content))
    reseal(store)
    (remark,) = page_of(folder).front["remarks"]
    assert "stale" in remark
    assert "rig fit" in remark


def test_an_analysis_without_a_seal_is_made_again_and_said_on_page_one(tmp_path: Path) -> None:
    folder = gear(tmp_path)
    store = next((folder / "00001-friction-A1.analysis").glob("0*.json"))
    content = json.loads(store.read_text()) | {"format": FORMAT_2}
    store.chmod(0o644)
    store.write_text(json.dumps(content))
    store.with_name(f"{store.name}.sha256").unlink()
    (remark,) = page_of(folder).front["remarks"]
    assert "not sealed (0.2.0)" in remark
    # A run without rows to fit gives none of its numbers again.
    assert "not made again" in remark


def test_a_gear_of_which_nothing_is_analysed_has_no_certificate(tmp_path: Path) -> None:
    write(tmp_path, 1, "friction")
    with (
        pytest.raises(RigError, match="no run of this gear is analysed"),
        certified(tmp_path, "A1"),
    ):
        pass
    with pytest.raises(RigError, match="no run of this gear"), certified(tmp_path, "B7"):
        pass


def test_words_of_a_run_and_of_a_laboratory_stay_words(tmp_path: Path) -> None:
    evil = '<script>alert(1)</script>#import "x": *'
    folder = gear(tmp_path, changes=None)
    with certified(folder, "A1", acceptance=accepted(folder)) as gathered:
        worded = replace(LABORATORY, name=evil, customer=evil, order=evil)
        made = certificate_page(
            replace(gathered, passed_over=(evil,)), worded, manifest_of(gathered), created=evil
        )
    shown = render_page(made)
    assert "<script" not in shown
    assert evil in html.unescape(shown)
    printed = pypdf.PdfReader(io.BytesIO(render_pdf(replace(made, sections=(), annexes=())))).pages[
        0
    ]
    assert squeezed(evil) in squeezed(printed.extract_text())


def test_limits_stand_in_the_curves(whole: Path) -> None:
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        fit = gathered.fit_of("friction")
        assert isinstance(fit, Fit)
        plot = with_limits(fit, gathered.verdict.lines).result.plots[0]
    (line,) = [series for series in plot.series if series.role == "limit"]
    assert set(line.y) == {90.0}
    assert line.x.mean() == pytest.approx(1000.0)


def test_k_and_degrees_of_freedom_are_those_of_each_number(whole: Path) -> None:
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        grid = value_grid(gathered)
        found = gathered.fit_of("friction").result.estimates[RUNNING]  # type: ignore[union-attr]
    assert grid.rows[0][2] == f"{found.coverage_factor:.2f}"
    assert grid.rows[0][3] == "∞"


def test_control_charts_come_with_the_third_run(tmp_path: Path) -> None:
    folder = gear(tmp_path)
    assert "Control charts" not in [part.title for part in page_of(folder).sections]
    for number in (3, 4):
        lay(folder, number, "friction", {RUNNING: estimate(RUNNING, 0.08, own=2e-4)})
    charts = [part for part in page_of(folder).sections if part.title == "Control charts"]
    assert len(charts) == 1
    assert len(charts[0].figures) == 1


def described(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(f"[laboratory]\nname = 'Test house'\n{text}")
    return path


def test_a_logo_stands_on_the_page(tmp_path: Path, whole: Path) -> None:
    logo = b'<svg xmlns="http://www.w3.org/2000/svg" width="10" height="10"><rect width="9" height="9"/></svg>'
    (tmp_path / "logo.svg").write_bytes(logo)
    laboratory = laboratory_of(described(tmp_path, "logo = 'logo.svg'"))
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        made = certificate_page(gathered, laboratory, manifest_of(gathered), created="now")
    assert "data:image/svg+xml;base64," in render_page(made)
    assert render_pdf(replace(made, sections=(), annexes=())).startswith(b"%PDF")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("logo = 'none.png'", "the logo cannot be read"),
        ("logo = 'rig.toml'", "is no picture"),
        ("adress = 'Street'", "no such word"),
    ],
)
def test_a_laboratory_that_cannot_be_shown_is_refused_by_name(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words) as refused:
        laboratory_of(described(tmp_path, text))
    assert "laboratory" in str(refused.value)


def test_a_file_without_a_laboratory_says_nothing_of_one(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("[rig]\nname = 'r'\n")
    assert laboratory_of(path) == LaboratoryWords()
