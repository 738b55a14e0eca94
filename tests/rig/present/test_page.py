"""The report as a page: complete, self-contained, safe against what files say, honest about what it may claim."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.channel import Calibration, Channel
from experiments.recording import Origin, Segment
from experiments.result import Result
from experiments.truth import TruthRow
from model.gear_file import shipped_gear
from model.identify.estimate import BudgetLine
from model.units import ARCMIN
from rig.analysis.fit.recorded import Fit
from rig.analysis.judging import GearVerdict
from rig.analysis.rows import budget_grid
from rig.analysis.validate import ValidatedRung, Validation
from rig.content.page import SECTIONS, word_of
from rig.errors import RigError
from rig.main import app
from rig.present.page import css_text, render_page
from rig.present.report import overall, report_page, run_line, write_report
from rig.runfile.layout import Column
from rig.runfile.prevailing import conditions_of
from tests.rig import handmade

CREATED = "2024-03-02 09:00+01:00"
VOID = {"meta", "br", "link", "img", "hr", "input", "use", "path"}


class Page(HTMLParser):
    """Tags, ids, attributes and text of a page; `open_tags` is empty for one that is well nested."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.events: list[str] = []
        self.words: list[str] = []
        self.open_tags: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open_tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "src", "xlink:href"):
                self.links.append(value or "")
            if name.startswith("on"):
                self.events.append(name)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open_tags.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open_tags.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def render_report(
    fits: Sequence[Fit],
    *,
    created: str,
    truth: Sequence[tuple[str, TruthRow]] = (),
    note: str = "",
    verdict: GearVerdict | None = None,
) -> str:
    """The text of the page of these fits."""
    verdict = verdict or handmade.verdict(fits)
    made = report_page(fits, created=created, truth=truth, note=note, verdict=verdict)
    return render_page(made)


def bare(origin: Origin = "simulated", result: Result | None = None, **more: Any) -> Fit:
    """A fit without its figures, which take the most of the time."""
    return handmade.fit(origin, replace(result or handmade.friction_result(), plots=()), **more)


@pytest.fixture(scope="module")
def page() -> Page:
    fits = [handmade.fit(), handmade.fit(result=handmade.kinematic_result())]
    truth = [("friction", TruthRow(handmade.friction_result().estimates["F_c"], 78.0, 70.0))]
    return Page(render_report(fits, created=CREATED, truth=truth))


def test_the_page_is_well_nested_and_needs_nothing_else(page: Page) -> None:
    assert not page.open_tags
    assert len(page.ids) == len(set(page.ids))
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)


def test_what_a_laboratory_looks_for_is_there(page: Page) -> None:
    wanted = [
        "TEST REPORT",
        "SN-0815",
        "A. Example",
        "PASS",
        "87.3 ± 2.4 mN m",
        "The bracket drifted by 1.2 % over the sweep.",
        "70.3",
        "68.5 … 72.1",
        "weakly",
        "does not move",
        "torque scale (B)",
        "ab" * 32,
        "R-000042",
        "energy",
        "24.0 to 26.2 °C",
        "60 to 3 000 r/min, both directions",
        "Harmonic Grease SK-1A",
        "Load inertia J_o",
        "Hysteresis loss, lost motion, static torsional stiffness",
        "Transmission accuracy",
        "Statistical part",
        "Found against the simulator's truth",
        "Measurand",
        "This bench sees",
        "Coulomb friction F c",
        "harmonic-rig",
        "Torque per speed",
        "needs a velocity-steps run",
    ]
    assert [w for w in wanted if w not in page.text] == []


def test_a_simulated_run_is_marked_everywhere_and_cannot_be_signed(page: Page) -> None:
    assert page.text.count("SIMULATED") >= 3 + 3
    assert "signature on it" in page.text
    assert "Approved by" not in page.text


def test_a_hardware_run_can_be_signed_and_carries_no_mark() -> None:
    shown = Page(render_report([bare("hardware")], created=CREATED)).text
    assert "Approved by: name, date, signature" in shown
    assert not any(word in shown for word in ("SIMULATED", "REPLAY", "IMPORTED"))


def test_one_run_from_elsewhere_takes_the_signature_away() -> None:
    fits = [bare("hardware"), bare("imported", handmade.kinematic_result())]
    shown = Page(render_report(fits, created=CREATED)).text
    assert "Approved by" not in shown
    assert "runs marked IMPORTED" in shown


@pytest.mark.parametrize(
    ("limit", "confirmed_by", "word"),
    [
        (0.15, "A. Example", "PASS"),
        (0.08, "A. Example", "FAIL"),
        (0.088, "A. Example", "MARGINAL"),
        (0.15, "", "NOT JUDGED"),
        (0.01, "", "NOT JUDGED"),
    ],
)
def test_the_verdict_stands_at_the_top(limit: float, confirmed_by: str, word: str) -> None:
    fits = [bare(result=handmade.friction_result())]
    verdict = handmade.verdict(fits, limit, confirmed_by)
    text = render_report(fits, created=CREATED, verdict=verdict)
    assert re.search(r'class="word" id="verdict">([A-Z ]+)<', text)[1] == word  # type: ignore[index]
    if word == "NOT JUDGED":
        assert "the limit is not confirmed" in text


def test_nothing_judged_is_not_called_a_pass() -> None:
    text = render_report([bare(result=handmade.kinematic_result())], created=CREATED)
    assert ">NOT JUDGED<" in text
    assert ">PASS<" not in text.replace("<td>PASS</td>", "")


@pytest.mark.parametrize("outcome", ["ABORTED", "TRIPPED", "ERROR", "INTERRUPTED"])
def test_an_unfinished_run_is_not_judged_whatever_its_numbers(outcome: str) -> None:
    text = render_report([bare("hardware", outcome=outcome)], created=CREATED)
    assert re.search(r'class="word" id="verdict">([A-Z ]+)<', text)[1] == "NOT JUDGED"  # type: ignore[index]
    assert f"the run ended as {outcome}" in text
    assert f"Not every run reached its end: R-000042 ({outcome})" in text
    assert "Approved by" not in text


def test_hostile_names_inject_nothing() -> None:
    evil = "</title></style><script>alert(1)</script><img src=x onerror=alert(2)>\"'{{ 7*7 }}"
    fit = bare(
        gear_serial=evil,
        operator=evil,
        conditions={evil: evil},
        parameters={evil: evil},
        title=evil,
    )
    gear = replace(fit.gear, name=evil)
    result = replace(fit.result, warnings=(evil,), run=evil)
    fit = replace(
        fit,
        gear=gear,
        result=result,
        recording=replace(
            fit.recording,
            metadata=replace(fit.recording.metadata, gear=gear, run_id=evil, sha256=evil),
        ),
    )
    found = Page(render_report([fit], created=evil, note=evil))
    assert "script" not in found.tags
    assert "img" not in found.tags
    assert found.events == []
    assert "{{ 7*7 }}" in found.text
    assert not found.open_tags


def test_the_same_fits_give_the_same_bytes(tmp_path: Path) -> None:
    first = write_report(
        [handmade.fit()],
        tmp_path / "a" / "report.html",
        created=CREATED,
        verdict=handmade.verdict([]),
    )
    second = write_report(
        [handmade.fit()], tmp_path / "b.html", created=CREATED, verdict=handmade.verdict([])
    )
    assert first.read_bytes() == second.read_bytes()


def test_another_result_has_another_number() -> None:
    numbers = [
        re.search("HR-[0-9A-F]{10}", render_report([bare(sha256=sha)], created=CREATED))
        for sha in ("aa" * 32, "bb" * 32)
    ]
    assert numbers[0][0] != numbers[1][0]  # type: ignore[index]


def test_nothing_to_report_is_refused() -> None:
    with pytest.raises(RigError, match="nothing to report"):
        render_report([], created=CREATED)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RigError, match=r"report\.html"):
        write_report(
            [bare()],
            tmp_path / "file" / "report.html",
            created=CREATED,
            verdict=handmade.verdict([]),
        )


def test_a_result_without_anything_makes_a_page() -> None:
    empty = bare(
        "imported",
        Result(run="R-1", kind="motion", estimates={}),
        gear_serial="",
        operator="",
        start_time="",
        sha256="",
    )
    shown = Page(render_report([replace(empty, gear_known=False)], created=CREATED)).text
    assert "Harmonic drive CSF" not in shown
    assert "not stated" in shown
    assert "IMPORTED" in shown


def test_what_is_measured_stands_beside_the_catalogue_with_the_conditions_of_both() -> None:
    made = report_page(
        [bare(result=handmade.kinematic_result())], created=CREATED, verdict=handmade.verdict([])
    )
    (grid,) = made.judged
    quantity, measured, stated, source, here = grid.rows[0]
    rating = shipped_gear().value("ratings.transmission_accuracy")
    assert quantity.startswith(
        "transmission accuracy forward: largest positive plus largest negative deviation"
    )
    assert measured.startswith("0.84")
    assert stated == f"{rating.value / ARCMIN:g} arcmin"
    assert source.startswith("nothing on the output, low speed")
    assert rating.origin.source in source
    assert "Harmonic Grease SK-1A" in here
    assert "housing 24.0 to 26.2 °C" in here
    assert all(row[1] not in ("", "–") for row in grid.rows)
    assert "Not measurable on this rig, but stated: hysteresis loss (1 arcmin)" in grid.note
    assert "K1 (" in grid.note
    assert "K3 (" in grid.note
    assert "Beside the catalogue" in Page(render_page(made)).text


def test_the_set_points_of_a_starting_torque_are_places_and_not_speeds() -> None:
    made = handmade.recording(experiment="starting-torque")
    ramps = tuple(
        Segment(
            index=k,
            label="torque-ramp",
            start=k,
            stop=k + 1,
            setpoint=k * math.pi / 4,
            direction=1 - 2 * (k % 2),
        )
        for k in range(8)
    )
    conditions = {one.title: one.text for one in conditions_of(replace(made, segments=ramps), None)}
    assert conditions["wave-generator positions"] == "8 from 0 to 315°, both directions"
    assert "input speeds" not in conditions
    (speeds, *_) = conditions_of(handmade.recording(), None)
    assert (speeds.title, speeds.text) == (
        "input speeds",
        "60 to 3\u202f000 r/min, both directions",
    )


def test_a_gear_that_is_not_known_has_no_catalogue() -> None:
    fit = replace(bare(result=handmade.kinematic_result()), gear_known=False)
    assert report_page([fit], created=CREATED, verdict=handmade.verdict([])).judged == ()


def test_a_run_without_a_gear_is_titled_as_a_bare_motor_and_has_no_parameters_of_one() -> None:
    alone = bare(gear_mounted=False)
    page = report_page([alone], created=CREATED, verdict=handmade.verdict([]))
    assert page.heading == "Bare motor, R-000042"
    assert dict(page.facts)["Gear"] == "none mounted"
    assert dict(page.facts)["Serial number"] == "none"
    assert not any("parameter set" in annex.title for annex in page.annexes)
    # Beside a run with the gear it is that gear's report.
    both = report_page([alone, bare()], created=CREATED, verdict=handmade.verdict([]))
    assert both.heading.startswith("Harmonic drive CSF-25-120-2UH, serial SN-0815")
    assert any("parameter set" in annex.title for annex in both.annexes)


def test_a_limit_in_doubt_is_said_for_both_of_its_reasons() -> None:
    said = overall(replace(handmade.verdict([]), verdict="MARGINAL")).sentence
    assert "neither kept nor broken for certain" in said
    assert "inside the expanded uncertainty" in said
    assert "lower one of a number that may be zero" in said


def test_an_expired_calibration_is_said_at_the_top_and_a_missing_one_of_hardware_too() -> None:
    fit = bare("hardware")
    channels = (
        Channel(
            name="torque",
            unit="N m",
            scale=1e-3,
            calibration=Calibration(certificate="C-7", date="2020-01-01", due="2021-01-01"),
        ),
        Channel(name="input_angle", unit="rad", scale=1e-3),
        Channel(name="statusword", unit="1"),
    )
    object.__setattr__(fit.recording.source, "columns", tuple(map(Column.of, channels)))
    text = render_report([fit], created=CREATED)
    shown = Page(text).text
    assert (
        "The calibration of torque (C-7) was due on 2021-01-01: EXPIRED WHEN THE RUN BEGAN."
        in shown
    )
    assert "Input angle has no calibration certificate." in shown
    assert "Statusword" not in shown
    assert text.index("EXPIRED WHEN") < text.index('id="summary"')


def test_a_file_that_could_still_change_is_not_signed() -> None:
    shown = Page(render_report([bare("hardware", is_sealed=False)], created=CREATED)).text
    assert "Approved by" not in shown
    assert "Not sealed, so that it could still change: R-000042" in shown


def test_every_page_names_the_runs_letter_for_letter() -> None:
    assert run_line(["00002-b", "00001-a", "00002-b"]) == "Runs 00001-a, 00002-b"
    assert run_line(["00001-a"]) == "Run 00001-a"
    assert run_line([]) == ""
    many = run_line([f"{k:05d}-friction-SN" for k in range(1, 40)])
    assert many == "39 runs, 00001-friction-SN to 00039-friction-SN"
    for line in (run_line(["x" * 500]), run_line(["x" * 500, "y" * 500])):
        assert len(line) <= 124
        assert line.endswith("…")
    assert css_text('a"} body { x: url(y) \\ </style>') == (
        '"a\\22 \\7d  body \\7b  x\\3a  url\\28 y\\29  \\5c  \\3c \\2f style\\3e "'
    )


def test_runs_of_more_than_one_gear_under_one_verdict_are_said_loudly() -> None:
    fits = [bare(gear_serial="A1"), bare(result=handmade.kinematic_result(), gear_serial="B2")]
    made = report_page(fits, created=CREATED, verdict=handmade.verdict([]))
    assert made.alarms == (
        "These runs are of more than one gear (B2, A1): the verdict covers them together.",
    )
    assert "of more than one gear (B2, A1)" in Page(render_page(made)).text


def test_every_printed_page_of_a_run_that_is_none_from_hardware_is_marked() -> None:
    simulated, hardware = (
        render_report([bare(origin)], created=CREATED) for origin in ("simulated", "hardware")
    )
    assert '<div class="watermark" aria-hidden="true">SIMULATED</div>' in simulated
    assert '@top-center { content: "SIMULATED"' in simulated
    assert 'class="watermark"' not in hardware
    assert "@top-center" not in hardware


def test_indices_of_symbols_stand_below_the_line_and_names_stay_whole() -> None:
    evil = "A_b <i>"
    text = render_report([bare(gear_serial=evil)], created=CREATED)
    assert "<td><i>F</i><sub>c</sub></td>" in text
    assert "serial A_b &lt;i&gt;" in text
    assert "<i>A</i>" not in text


def test_a_budget_names_the_largest_part_first_and_has_no_empty_cells() -> None:
    result = handmade.friction_result()
    sources = tuple(BudgetLine(f"source {k}", "B", 0.1 * k) for k in (1, 9))
    one = {"F_c": replace(result.estimates["F_c"], budget=sources)}
    alone = budget_grid(replace(result, estimates=one), one)
    beside = budget_grid(result, result.estimates)
    assert alone is not None
    assert beside is not None
    assert alone.headings == ("source (type)", "F_c [N]")
    assert [row[0] for row in alone.rows] == ["source 9 (B)", "source 1 (B)", "u", "U (95 %)"]
    assert beside.headings == ("quantity", "unit", "u", "U (95 %)", "made up of, the largest first")
    assert beside.rows[0][4].startswith("repeats (A): 0.9")
    assert all(cell for row in beside.rows for place, cell in enumerate(row) if place != 1)


def test_models_stand_with_the_last_run_of_their_kind() -> None:
    rungs = tuple(
        ValidatedRung(
            name=name, parameters=n, fitted_error=1e-3, held_out_error=error, skill=0.5, bic=-10.0
        )
        for n, (name, error) in enumerate((("mean (null)", 4e-3), ("line", 2e-3)), 1)
    )
    judged = Validation(
        kind="friction",
        quantity="running torque",
        unit="N m",
        shown="mN m",
        fitted=("1", "2"),
        judged=("1", "2"),
        rungs=rungs,
        origin="simulated",
        independent=20.0,
    )
    fits = [bare(), bare()]
    made = report_page(fits, created=CREATED, verdict=handmade.verdict([]), models=[judged])
    first, second = made.sections[:2]
    assert "Models of the running torque" not in [grid.title for grid in first.grids]
    assert second.grids[-1].title == "Models of the running torque"
    assert second.grids[-1].rows[1][:2] == ("2  line", "2")
    assert second.figures[-1].note.endswith("the lower the better. 1: mean (null); 2: line.")


def test_sections_that_are_asked_for_stand_alone_under_the_same_head() -> None:
    fits = [bare("hardware")]
    whole = report_page(fits, created=CREATED, verdict=handmade.verdict(fits))
    assert {word_of(one) for one in (*whole.sections, *whole.annexes)} <= set(SECTIONS)
    some = whole.only(("results", "definitions"))
    assert [word_of(one) for one in (*some.sections, *some.annexes)] == ["results", "definitions"]
    assert (some.states, some.warnings, some.judged) == (whole.states, whole.warnings, whole.judged)


def test_a_section_that_no_report_has_is_refused_with_those_that_there_are() -> None:
    ran = CliRunner().invoke(app, ["report", "run.h5", "--sections", "results,curves"])
    assert ran.exit_code == 2
    assert "curves" in ran.output


def test_what_hardly_adds_to_an_uncertainty_stands_together() -> None:
    result = handmade.friction_result()
    sizes = (1.0, 0.5, 0.04, 0.03)
    lines = tuple(BudgetLine(f"source {u:g}", "B", u) for u in sizes)
    two = {
        name: replace(result.estimates[name], unit="N", budget=lines)
        for name in ("F_c", "running_torque")
    }
    beside = budget_grid(replace(result, estimates=two), two)
    assert beside is not None
    assert beside.rows[0][4] == (
        "source 1 (B): 1; source 0.5 (B): 0.5; 2 smaller ones together: 0.05"
    )
    alone = budget_grid(replace(result, estimates=two), ("F_c",))
    assert alone is not None
    assert len(alone.rows) == len(sizes) + 2
