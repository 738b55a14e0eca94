"""The certificate: two pages that say what the analyses in force say, judge nothing, and show what is missing."""

from __future__ import annotations

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
from rig.analysis.fit.recorded import Fit
from rig.analysis.judging import GearVerdict
from rig.analysis.learnt import vouchers
from rig.analysis.store import FORMAT_2
from rig.errors import ConfigurationError, RigError
from rig.gears.acceptance import Acceptance
from rig.main import app
from rig.present.certificate import gather
from rig.present.certificate.front import MOST_LIMITS, value_grid
from rig.present.certificate.gather import Certified, certified
from rig.present.certificate.laboratory import LaboratoryWords, laboratory_of
from rig.present.certificate.pictures import measured_points
from rig.present.certificate.sheets import Paper, Sheets, render_screen, typeset
from rig.present.certificate.traceability import Instrument, instruments_of, title_of
from rig.present.certificate.words import ENGLISH as words
from rig.present.certificate.write import number_of
from rig.present.limits import with_limits
from tests.rig.handmade import save_acceptance
from tests.rig.library.stored import RUNNING, estimate, start, write
from tests.rig.present.certificate.certified_gear import (
    ACCEPTANCE,
    AT,
    FORWARD,
    LABORATORY,
    REVERSE,
    SPEEDS,
    accepted,
    gear,
    lay,
    printed,
    sheets_in,
    sheets_made,
    words_in,
)
from tests.rig.present.test_paper import squeezed
from tests.rig.runfile.making import reseal


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gear(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def sheets(whole: Path) -> Sheets:
    return sheets_in(whole)


@pytest.fixture(scope="module")
def pages(sheets: Sheets) -> list[str]:
    return printed(sheets)


def test_both_pages_agree_with_the_json_of_the_same_store(whole: Path, pages: list[str]) -> None:
    order = ["certificate", "--gear", "A1", "--runs", str(whole), "--json"]
    order += ["--acceptance", str(whole / "spec.toml"), "-o", str(whole / "c.html")]
    ran = CliRunner().invoke(app, order)
    told = json.loads(ran.stdout)
    first, second = map(squeezed, pages)
    assert (ran.exit_code, told["verdict"], told["complete"]) == (0, "PASS", True)
    assert told["title"] == "SIMULATION"
    assert squeezed(told["sentence"]) in first
    for line in told["limits"]:
        assert squeezed(line["outcome"]) in first
    for number, run in ((1, "friction"), (2, "kinematic-error")):
        path = whole / f"{number:05d}-{run}-A1.h5"
        stored = json.loads(next((whole / f"{path.stem}.analysis").glob("0*.json")).read_text())
        assert told["runs"][run] == stored["run"]
        for one in stored["result"]["parameters"].values():
            assert squeezed(f"{one['coverage_factor']:.2f}") in first
    assert told["manifest_sha256"] in second
    for said in ("80.00±0.39mNm", "≤90mNm", "1.031±0.067arcmin", "≤1.375arcmin"):
        assert said in first


def test_page_one_alone_is_enough(pages: list[str]) -> None:
    first = squeezed(pages[0])
    for said in (
        "SIMULATION",
        "Test house",
        "Street 1",
        "Robots Ltd",
        "PO 4711",
        "serial number A1, ratio 120",
        "The gear A1 keeps all 2 limits of the acceptance file specification.",
        "peak to peak",
        "points as measured",
        "limit",
    ):
        assert squeezed(said) in first, said


def test_page_two_says_how_it_was_found(pages: list[str]) -> None:
    second = squeezed(pages[1])
    for said in (
        words.LUBRICANT,
        words.HOURS,
        words.AMBIENT,
        words.HOLDS_AT,
        "TI 12",
        words.NO_DEVIATIONS,
        words.RULE,
        words.COVERAGE,
        "relates to this item only and may be copied only whole",
    ):
        assert squeezed(said) in second, said


def test_both_pages_have_number_page_place_and_days(pages: list[str]) -> None:
    for number, page in enumerate(pages, 1):
        for said in (
            "HC-1",
            f"page {number} of 2",
            "Place: Street 1",
            "Received: not stated",
            "Issued: 2026-03-02",
        ):
            assert squeezed(said) in squeezed(page)
        assert "SIMULATED" in page


def many_limits(count: int) -> Acceptance:
    one = ACCEPTANCE.limits[0]
    uppers = [0.0808 + 0.001 * place for place in range(count)]
    return replace(
        ACCEPTANCE, limits=tuple(replace(one, upper=upper) for upper in reversed(uppers))
    )


@pytest.mark.parametrize("paper", ["a4", "letter"])
@pytest.mark.parametrize("case", ["as it is", "many limits", "nothing there", "long words"])
def test_there_are_exactly_two_pages_in_at_most_220_words(
    whole: Path, case: str, paper: Paper
) -> None:
    long = LABORATORY
    more: dict[str, Any] = {}
    if case == "many limits":
        more["acceptance"] = replace(many_limits(40), path=str(whole / "spec.toml"))
    if case == "nothing there":
        more["protocols"] = tuple(catalogue.kinds())
    if case == "long words":
        said = "Laboratory for gears " * 12
        long = replace(LABORATORY, customer=said, deviations=said * 9, method=said)
    with certified(whole, "A1", **{"acceptance": accepted(whole), **more}) as gathered:
        made = sheets_made(gathered, long)
    pages = printed(made, paper)
    assert len(pages) == 2
    assert len(made.front.pictures) == 2
    if case != "long words":
        assert words_in(pages[0]) <= 220


def test_letters_are_of_three_sizes_none_below_eight_points(sheets: Sheets) -> None:
    (document,) = typeset(sheets, format="pdf")
    sizes: set[float] = set()

    def seen(text: str, cm: list[float], tm: list[float], font: object, size: float) -> None:
        if text.strip():
            area = (cm[0] * cm[3] - cm[1] * cm[2]) * (tm[0] * tm[3] - tm[1] * tm[2])
            sizes.add(round(size * abs(area) ** 0.5, 1))

    page = pypdf.PdfReader(io.BytesIO(document)).pages[0]
    page.extract_text(visitor_text=seen)
    assert len(sizes) <= 3
    assert min(sizes) >= 8.0
    fonts = page["/Resources"]["/Font"]  # type: ignore[index]
    families = {str(font.get_object()["/BaseFont"]).partition("+")[2] for font in fonts.values()}
    assert {name.partition("-")[0] for name in families} == {"LibertinusSerif"}


def test_of_many_limits_the_nearest_come_first_and_the_others_are_counted(whole: Path) -> None:
    asked = replace(many_limits(14), path=str(whole / "spec.toml"))
    with certified(whole, "A1", acceptance=asked) as gathered:
        grid = value_grid(gathered)
    assert len(grid.rows) == MOST_LIMITS
    limits = [float(row[4].split()[1]) for row in grid.rows]
    assert limits == sorted(limits)
    assert limits[0] == pytest.approx(80.8)
    assert "4 more limits (4 PASS)" in grid.note


def test_points_of_page_one_are_as_measured(whole: Path) -> None:
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        fit = gathered.fit_of("friction")
        assert isinstance(fit, Fit)
        plot = next(p for p in fit.result.plots if p.name == "friction-directions")
        points = {way: (x, y) for way, x, y in measured_points(plot)}
    for way, torque in (("forward", FORWARD), ("reverse", REVERSE)):
        # Figures are stored with seven digits.
        np.testing.assert_allclose(points[way][0], SPEEDS, rtol=1e-6)
        np.testing.assert_allclose(points[way][1], torque, rtol=1e-6)


def with_origin(gathered: Certified, origin: str) -> Certified:
    """The same runs from elsewhere."""
    fits = []
    for fit in gathered.fits:
        metadata = replace(fit.recording.metadata, origin=origin)  # type: ignore[arg-type]
        fits.append(replace(fit, recording=replace(fit.recording, metadata=metadata)))
    return replace(gathered, fits=tuple(fits))


def instrument(**more: str) -> Instrument:
    told = {
        "channel": "torque",
        "device": "T 1",
        "serial": "7",
        "certificate": "C-7",
        "laboratory": "PTB",
        "date": "2025-03-01",
        "due": "2027-03-01",
        "tested": "2026-03-02",
    }
    return Instrument(**{**told, **more})


@pytest.mark.parametrize(
    ("origin", "more", "title", "untraceable"),
    [
        ("hardware", {}, "CERTIFICATE", ""),
        ("hardware", {"due": "2026-03-02"}, "CERTIFICATE", ""),
        ("hardware", {"due": ""}, "CERTIFICATE", ""),
        (
            "hardware",
            {"due": "2026-03-01"},
            "TEST REPORT",
            "not traceable: torque (was due 2026-03-01)",
        ),
        ("hardware", {"certificate": ""}, "TEST REPORT", "not traceable: torque (no certificate)"),
        (
            "hardware",
            {"certificate": "none: scale from the manual"},
            "TEST REPORT",
            "not traceable: torque (no certificate)",
        ),
        ("imported", {}, "TEST REPORT", "not traceable: a recording of another rig"),
        ("replay", {}, "TEST REPORT", "not traceable: a recorded run played back"),
        ("simulated", {"certificate": ""}, "SIMULATION", ""),
    ],
)
def test_the_title_is_what_the_instruments_allow(
    whole: Path, origin: str, more: dict[str, str], title: str, untraceable: str
) -> None:
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        found = title_of(with_origin(gathered, origin), (instrument(), instrument(**more)))
    assert (found.word, found.untraceable) == (title, untraceable)


def test_what_a_bench_learnt_itself_vouches_for_no_certificate(whole: Path) -> None:
    """The torque port has a laboratory's certificate; the number rests on the bench's own scale."""
    named = f"none: learnt on this bench; learnt-torque-scale-7.toml, SHA-256 {'0' * 64}"
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        fits = tuple(
            replace(
                fit,
                result=replace(fit.result, options={**fit.result.options, "torque_scale": named}),
            )
            for fit in gathered.fits
        )
        instruments = instruments_of(replace(gathered, fits=fits))
        title = title_of(with_origin(gathered, "hardware"), instruments)
    (torque,) = [one for one in instruments if one.channel == "torque"]
    # The file stands in the manifest.
    assert (torque.certificate, torque.laboratory, torque.due) == (
        "none: learnt on this bench",
        "",
        "",
    )
    assert title.word == "TEST REPORT"
    assert "torque (no certificate)" in title.untraceable


def test_the_certificate_of_the_other_encoder_vouches_for_none_that_was_learnt() -> None:
    learnt = f"none: from 8 gears; learnt-output-encoder-7.csv, SHA-256 {'0' * 64}"
    assert vouchers({"certificates": f"PTB-4711; {learnt}"}) == {
        "output_angle": "none: from 8 gears"
    }
    assert vouchers({"certificates": "PTB-4711"}) == {}


def test_instruments_are_those_on_which_a_judged_number_rests(whole: Path) -> None:
    """The runs have a torque alone: what the kinematic error rests on has nothing that vouches for it."""
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        torque, *angles = instruments_of(gathered)
        friction = [line for line in gathered.verdict.lines if line.kind == "friction"]
        alone = replace(gathered, verdict=replace(gathered.verdict, lines=tuple(friction)))
        (only,) = instruments_of(alone)
    assert only == torque
    assert (torque.channel, torque.certificate, torque.tested) == (
        "torque",
        "PTB-17",
        start(1)[:10],
    )
    assert torque.doubt == ""
    assert [(one.channel, one.doubt) for one in angles] == [
        ("input_angle", words.NO_CERTIFICATE),
        ("output_angle", words.NO_CERTIFICATE),
    ]


def test_two_issues_never_share_a_number(whole: Path) -> None:
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        same = {number_of(gathered, LABORATORY, AT) for _ in range(2)}
        others = {
            number_of(gathered, LABORATORY, "2026-03-03T10:00:00+00:00"),
            number_of(gathered, replace(LABORATORY, order="PO 4712"), AT),
        }
    assert len(same) == 1
    assert len(same | others) == 3


def test_hardware_has_room_for_three_signatures(tmp_path: Path) -> None:
    made = sheets_in(gear(tmp_path, origin="hardware"))
    assert made.signature.allowed
    shown = render_screen(made)
    for who in ("Tested", "Checked", "Approved"):
        assert f"{who}: name, date, signature" in shown
    assert "SIMULATED" not in shown
    assert made.title.word == "TEST REPORT"
    assert "input angle (no certificate)" in shown


def test_the_verdict_is_what_judges_says_and_no_other(
    whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = GearVerdict(verdict="MARGINAL", because=("because the stand-in says so",))
    monkeypatch.setattr(gather, "judge", lambda *_: said)
    front = sheets_in(whole).front
    assert front.verdict == "MARGINAL"
    assert {row[-1] for row in front.values.rows} == {words.NOT_LISTED}


def test_no_module_of_the_certificate_holds_a_value_against_a_limit() -> None:
    for path in Path(package.__file__).parent.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "outcome_against" not in text
        assert "lacks_number" not in text


@pytest.mark.parametrize(
    ("torque", "word", "said"),
    [(0.12, "FAIL", "breaks 1 of the 2 limits"), (0.09, "MARGINAL", "does not keep 1 of them")],
)
def test_a_bad_gear_is_told_in_one_sentence(
    tmp_path: Path, torque: float, word: str, said: str
) -> None:
    front = sheets_in(gear(tmp_path, torque=torque)).front
    assert front.verdict == word
    assert said in front.sentence
    assert front.values.rows[0][0].startswith("No-load running torque")
    assert front.values.rows[0][-1] == word


def test_what_was_asked_for_and_is_missing_makes_it_incomplete(tmp_path: Path) -> None:
    folder = tmp_path
    lay(folder, 1, "friction", {RUNNING: estimate(RUNNING, 0.08, own=2e-4)})
    save_acceptance(ACCEPTANCE, folder / "spec.toml")
    made = sheets_in(folder, protocols=("friction", "velocity-steps"))
    assert "velocity-steps, kinematic-error" in made.front.incomplete
    assert made.front.verdict == "NOT JUDGED"
    assert "INCOMPLETE" in render_screen(made)


def test_a_gear_without_an_acceptance_file_is_not_judged(whole: Path) -> None:
    with certified(whole, "A1") as gathered:
        front = sheets_made(gathered).front
    assert front.verdict == "NOT JUDGED"
    assert "--acceptance" in front.sentence
    assert {row[-1] for row in front.values.rows} == {words.NOT_LISTED}


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
    (remark,) = sheets_in(folder).back.remarks
    assert "stale" in remark
    assert "rig fit" in remark


def test_an_analysis_without_a_seal_is_made_again_and_said_on_page_one(tmp_path: Path) -> None:
    folder = gear(tmp_path)
    store = next((folder / "00001-friction-A1.analysis").glob("0*.json"))
    content = json.loads(store.read_text()) | {"format": FORMAT_2}
    store.chmod(0o644)
    store.write_text(json.dumps(content))
    store.with_name(f"{store.name}.sha256").unlink()
    (remark,) = sheets_in(folder).back.remarks
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
        made = sheets_made(replace(gathered, passed_over=(evil,)), worded)
    shown = render_screen(made)
    assert "<script" not in shown
    assert evil in html.unescape(shown)
    assert all(squeezed(evil) in squeezed(page) for page in printed(made))


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


def described(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(f"[laboratory]\nname = 'Test house'\n{text}")
    return path


def test_a_logo_stands_on_the_page(tmp_path: Path, whole: Path) -> None:
    logo = b'<svg xmlns="http://www.w3.org/2000/svg" width="10" height="10"><rect width="9" height="9"/></svg>'
    (tmp_path / "logo.svg").write_bytes(logo)
    laboratory = laboratory_of(described(tmp_path, "logo = 'logo.svg'"))
    with certified(whole, "A1", acceptance=accepted(whole)) as gathered:
        made = sheets_made(gathered, laboratory)
    assert "data:image/svg+xml;base64," in render_screen(made)
    assert len(printed(made)) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("logo = 'none.png'", "the logo cannot be read"),
        ("logo = 'rig.toml'", "is no picture"),
        ("adress = 'Street'", "no such word"),
    ],
)
def test_a_laboratory_that_cannot_be_shown_is_refused_by_name(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(ConfigurationError, match=said) as refused:
        laboratory_of(described(tmp_path, text))
    assert "laboratory" in str(refused.value)


def test_a_file_without_a_laboratory_says_nothing_of_one(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("[rig]\nname = 'r'\n")
    assert laboratory_of(path) == LaboratoryWords()
