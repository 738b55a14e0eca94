"""The whole chain on the simulated rig, and what happens when it is stopped, fails, or an analysis crashes."""

from __future__ import annotations

import dataclasses
import json
import re
import threading
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from experiments.errors import PlanError
from model.gear_file import load_gear
from rig.analysis.judging import not_judged
from rig.analysis.store import json_text, read_analyses
from rig.commands.demo_tables import Lines, beating, print_demonstration
from rig.errors import RigError
from rig.present.figure import FULL_WIDTH, HALF_WIDTH, draw_figure
from rig.run.start import run_order
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from rig.trial.campaign import journal as journals
from rig.trial.campaign.analyst import Analysed
from rig.trial.campaign.conduct import CampaignReport
from rig.trial.campaign.journal import DoneStage
from rig.trial.demo import chain as demo
from rig.trial.demo.chain import Demonstration, DemoOrder, Finished, Step, demonstrate
from rig.trial.demo.first_screen import HEIGHT, ROWS, SENTENCES, first_screen
from tests.rig.present.overlap import unreadable

SHORT = {
    "motor-tare": {"lowest_rpm": 5.0, "points": 9, "measure_time": 0.3, "settle_time": 0.2},
    "kinematic-error": {"speed_rpm": 241.7},
    "friction": {
        "lowest_rpm": 5.0,
        "points": 10,
        "measure_time": 0.3,
        "settle_time": 0.2,
        "up_and_down": False,
    },
    "starting-torque": {"positions": 2},
    "velocity-steps": {"speeds_rpm": (600.0, 1800.0), "repeats": 1},
}
CREATED = "2024-03-02T09:00:00+01:00"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    seen: list[Step | Finished] = []

    def now() -> str:
        return f"2024-03-02T09:0{sum(isinstance(m, Finished) for m in seen)}:00+01:00"

    order = DemoOrder(tmp_path_factory.mktemp("demo"), 3, now, SHORT)
    found = demonstrate(order, beside=False, show=seen.append)
    assert [m.protocol for m in seen if isinstance(m, Finished)] == list(demo.ORDER)
    assert {m.protocol for m in seen if isinstance(m, Step)} == set(demo.ORDER)
    return found


def test_every_figure_of_every_protocol_can_be_read(made: Demonstration) -> None:
    """At the size in which the report has it, its title in the caption."""
    plots = [plot for fit in made.fits for plot in fit.result.plots]
    siblings = Counter(plot.figure for plot in plots if plot.figure)
    faults = {
        plot.name: found
        for plot in plots
        for size in ((FULL_WIDTH, HALF_WIDTH) if siblings[plot.figure] >= 3 else (FULL_WIDTH,))
        if (
            found := unreadable(draw_figure(dataclasses.replace(plot, title=""), "simulated", size))
        )
    }
    assert not faults
    assert len(plots) > 15
    # Under each: what is seen and when it is good, in whole sentences.
    for plot in plots:
        assert re.fullmatch(r"[A-Z0-9].*\.", plot.note), (plot.name, plot.note)
        assert len(plot.note.split()) >= 12, plot.note


def test_report_and_certificate_are_dated_after_the_last_run(made: Demonstration) -> None:
    assert "2024-03-02 09:07:00+01:00" in made.report.read_text(encoding="utf-8")
    record = json.loads((made.order.folder / "certificate.json").read_text(encoding="utf-8"))
    assert record["created"] == "2024-03-02T09:07:00+01:00"


def test_every_protocol_is_run_in_order_and_fitted(made: Demonstration) -> None:
    assert [f.result.kind for f in made.fits] == list(demo.ORDER)
    assert [f.path.name[:5] for f in made.finished] == [f"0000{n}" for n in range(1, 8)]
    assert all(f.outcome == "COMPLETED" for f in made.finished)
    assert all(read_analyses(f.path)[0].kind == f.protocol for f in made.finished)


def test_the_order_in_which_runs_happen_changes_no_count(
    made: Demonstration, tmp_path: Path
) -> None:
    """The first run once more, after others of the same gear and day: neither number nor warmth are theirs."""
    first = made.finished[0]
    order = dataclasses.replace(made.order, folder=tmp_path)
    for path in made.order.folder.glob("0000[2-7]-*.h5*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    again = run_order(demo.campaign_order(order, beside=False).walk.stages[0].order)
    assert again.run_id.startswith("00008-")
    one, other = open_run(first.path), open_run(again.path)
    assert one.metadata.process["world"] == other.metadata.process["world"]
    assert all(np.array_equal(one.stored(name), other.stored(name)) for name in one.signals)
    for recording in (one, other):
        close_recording(recording)


def test_the_tare_and_the_kinematic_error_are_handed_on(made: Demonstration) -> None:
    fits = {f.result.kind: f for f in made.fits}
    assert (
        fits["friction"].result.options["tare_run"] == fits["motor-tare"].recording.metadata.run_id
    )
    assert fits["friction"].result.options["torque_is_of"] == "gear"
    assert fits["velocity-steps"].gear.kinematic_error != fits["friction"].gear.kinematic_error


def test_the_truth_is_laid_beside_what_was_found(made: Demonstration) -> None:
    rows = {(kind, row.estimate.name): row for kind, row in made.truth}
    assert ("kinematic-error", "amplitude_2") in rows
    assert ("friction", "coulomb") in rows
    assert rows["kinematic-error", "amplitude_2"].difference == pytest.approx(
        0.0, abs=0.02 * rows["kinematic-error", "amplitude_2"].seen
    )
    assert all(row.estimate.identifiable != "no" for row in rows.values())


def test_report_and_parameter_set_are_written(made: Demonstration) -> None:
    page = made.report.read_text(encoding="utf-8")
    assert page.count("SIMULATED") > 10
    for words in (
        "Found against the simulator",
        "SIM-0003",
        "Velocity steps",
        "00001-motor_tare-SIM_0003",
    ):
        assert words in page
    assert made.report.stat().st_size < 5_000_000
    gear = load_gear(made.parameters)
    assert {o.provenance for p, o in gear.origins.items() if p.startswith("kinematic_error")} == {
        "identified"
    }


def test_json_and_people_get_the_same_story(
    made: Demonstration, capsys: pytest.CaptureFixture[str]
) -> None:
    found = json.loads(json_text(made.as_json()))
    assert [f["kind"] for f in found["fits"]] == list(demo.ORDER)
    assert found["compared"] == len(found["truth"]) > 20
    print_demonstration(made, everything=True)
    shown = capsys.readouterr().out
    for words in (
        "SIMULATED",
        str(made.report),
        "measurand",
        "bench sees",
        str(made.certificate[1]),
    ):
        assert words in shown
    assert shown.endswith("\n".join(first_screen(made)) + "\n")


ROW = re.compile(
    r"(\S.*?)  +(−?[\d.]+) +± +([\d.]+) +(\S+( m)?) +(limit [\d.]+ +)?true +−?[\d.]+ +(inside|outside)"
)


def test_the_first_screen(made: Demonstration, capsys: pytest.CaptureFixture[str]) -> None:
    """One screen of eighty by twenty-four, line by line: verdict, numbers, what to look out for, what comes next."""
    print_demonstration(made)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= HEIGHT
    folder = str(made.order.folder)
    assert max(len(line) for line in lines if folder not in line) <= 80
    verdict, limits = made.campaign.verdict.verdict, made.campaign.verdict.lines
    passed = sum(line.outcome == "PASS" for line in limits)
    assert (
        lines[0].split()
        == f"SIMULATED CSF-25-120-2UH SIM-0003 {verdict} {passed} of {len(limits)} limits".split()
    )
    assert len(lines[0]) == 80
    *rows, certificate, following = lines[1:]
    assert certificate == f"certificate  {folder}/certificate.pdf"
    assert following == f"next         rig live --runs {folder}"
    found = [line for line in rows if ROW.match(line)]
    assert 4 <= len(found) <= ROWS
    assert len({line.index("±") for line in found}) == 1
    points = {
        line.index(".", 0, line.index("±")) for line in found if "." in line.partition("±")[0]
    }
    assert len(points) == 1
    judged = {line.name.removesuffix(" forward").removesuffix(" reverse") for line in limits}
    told = " ".join(" ".join(line.split()) for line in rows)
    assert all(words in told for name in judged for words in name.split(" at "))
    others = [line for line in rows if line not in found]
    assert all(line.startswith(("Look out: ", "  ")) for line in others)
    assert 1 <= sum(line.startswith("Look out: ") for line in others) <= SENTENCES


def test_two_directions_that_differ_are_two_rows(made: Demonstration) -> None:
    (one,) = [f for f in made.fits if f.result.kind == "kinematic-error"]
    name = "transmission_accuracy_forward"
    other = dataclasses.replace(
        one.result.estimates[name], value=2.0 * one.result.estimates[name].value
    )
    told = [
        (kind, dataclasses.replace(row, estimate=other) if row.estimate.name == name else row)
        for kind, row in made.truth
    ]
    screen = first_screen(dataclasses.replace(made, truth=tuple(told)))
    assert sum(line.startswith("transmission accuracy  ") for line in screen) == 2
    assert [line for line in screen if line in ("  forward", "  reverse")] == [
        "  forward",
        "  reverse",
    ]


def test_progress_says_where_it_stands_when_nothing_happens(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = Lines()
    lines.beat()
    lines.show(Step("friction", 3.0, 41.0, "running"))
    lines.beat()
    lines.show(
        Finished(
            protocol=demo.ORDER[-1], path=Path("a"), outcome="COMPLETED", message="", seconds=2.0
        )
    )
    lines.beat()
    lines.beat()
    said = capsys.readouterr().err.splitlines()
    assert said[1:] == [
        "friction: running, 41 s of the rig left",
        f"{demo.ORDER[-1]}: COMPLETED in 2.0 s",
        "writing report and certificate",
    ]
    beaten = threading.Event()
    lines.beat = beaten.set  # pyright: ignore[reportAttributeAccessIssue]
    with beating(lines, every=0.0):
        assert beaten.wait(600.0)


def report_of(order: DemoOrder, outcome: str, crashed: str = "") -> CampaignReport:
    """A campaign that ended so after its first run."""
    wanted = demo.campaign_order(order, beside=False)
    begun = journals.begin(order.folder, wanted.walk.plan, order.serial, {}, CREATED)
    done = DoneStage(index=0, protocol="motor-tare", run="a.h5", outcome=outcome, message="because")
    return CampaignReport(
        walk=wanted.walk,
        journal=begun.with_stage(done),
        outcome=outcome,
        verdict=not_judged("nothing"),
        verdict_rests_on=0,
        analysed=(Analysed(run=Path("a.h5"), crashed=crashed),),
    )


@pytest.mark.parametrize(
    ("outcome", "crashed", "error", "words"),
    [
        ("ABORTED", "", KeyboardInterrupt, "what was recorded is kept"),
        ("TRIPPED", "", RigError, "motor-tare TRIPPED: because"),
        ("COMPLETED", "no memory", RigError, "a.h5: no memory"),
    ],
)
def test_a_campaign_that_did_not_reach_its_end_ends_the_demonstration(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    outcome: str,
    crashed: str,
    error: type[BaseException],
    words: str,
) -> None:
    order = DemoOrder(tmp_path, 1, lambda: CREATED, SHORT)
    monkeypatch.setattr(demo, "conduct", lambda wanted, crew: report_of(order, outcome, crashed))
    with pytest.raises(error, match=words):
        demonstrate(order, beside=False)


def test_a_stop_while_running_seals_the_run(tmp_path: Path) -> None:
    stop = StopRequest()
    seen: list[Step | Finished] = []

    def show(message: Step | Finished) -> None:
        seen.append(message)
        if isinstance(message, Step) and message.done > 0.0:
            stop.stop()

    with pytest.raises(KeyboardInterrupt):
        demonstrate(
            DemoOrder(tmp_path, 1, lambda: CREATED, SHORT), stop=stop, beside=False, show=show
        )
    (done,) = [message for message in seen if isinstance(message, Finished)]
    assert done.outcome == "ABORTED"
    assert done.path.is_file()


def test_a_wrong_parameter_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="out of range"):
        demonstrate(DemoOrder(tmp_path, 1, lambda: CREATED, {"velocity-steps": {"repeats": -1}}))
    assert not list(tmp_path.glob("*.h5"))
