"""A campaign goes on where it stopped, does again what went out of date, and has one verdict."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

import pytest

from experiments.errors import PlanError
from experiments.quantity import bare_quantity
from experiments.result import Verdict, VerdictOutcome
from model.gear_file import shipped_gear
from model.identify.estimate import Estimate
from model.motor import shipped_motor
from rig.analysis.in_force import in_force
from rig.analysis.store import read_analyses
from rig.bench.backends.order import Order
from rig.errors import ConfigurationError
from rig.run import start
from rig.run.parts import RunReport
from rig.run.start import bench_for
from rig.run.stop import StopRequest
from rig.trial.campaign import journal as journals
from rig.trial.campaign.analyst import Analysed, Analysing, Analyst
from rig.trial.campaign.conduct import CampaignCallbacks, CampaignOrder, CampaignReport, conduct
from rig.trial.campaign.junit import write_junit
from rig.trial.campaign.plan import CampaignPlan, Stage
from rig.trial.campaign.walk import walk

SERIAL = "SN-7"
FIRST_DAY = "2026-01-01T08:00:00+00:00"
TARE = {"lowest_rpm": 50.0, "points": 7, "measure_time": 0.3, "settle_time": 0.2}
PLAN = CampaignPlan(
    name="short",
    title="short",
    stages=(Stage("motor-tare", TARE), Stage("home", {})),
    path="short.toml",
)
TYPED = "I-HAVE-LOOKED-AT-THE-RIG"


def order(folder: Path, **changes: object) -> CampaignOrder:
    pattern = Order(
        protocol="home",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        serial=SERIAL,
        operator="A. Example",
    )
    wanted = CampaignOrder(
        walk=walk(PLAN, pattern),
        bench=bench_for(pattern).id,
        now=lambda: FIRST_DAY,
    )
    return replace(wanted, **changes)


@dataclass
class Ran:
    """A crew that remembers what was run, and may press STOP when a stage begins."""

    stop_at: str = ""
    protocols: list[str] = field(default_factory=list)
    confirmed: list[str] = field(default_factory=list)
    stop: StopRequest = field(default_factory=StopRequest)
    analysing: list[Analysing] = field(default_factory=list)

    def crew(self) -> CampaignCallbacks:
        def begun(index: int, stage: object) -> None:
            name = PLAN.stages[index].protocol
            self.protocols.append(name)
            if name == self.stop_at:
                self.stop.stop()

        def confirm(order: Order, planned: object) -> str:
            self.confirmed.append(order.protocol)
            return TYPED

        return CampaignCallbacks(
            stop=self.stop,
            ask=lambda prompt: prompt.consent or "done",
            confirm=confirm,
            begun=begun,
            analysing=self.analysing.append,
        )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CampaignReport]:
    folder = tmp_path_factory.mktemp("whole")
    ran = Ran()
    report = conduct(order(folder), ran.crew())
    assert ran.protocols == ["motor-tare", "home"]
    assert ran.confirmed == ran.protocols
    # The first analysis has nothing by which its time could be told; the next takes as long per byte as those before.
    assert [one.run.name for one in ran.analysing] == [run.run for run in report.runs]
    assert [math.isfinite(one.left) for one in ran.analysing] == [False, True]
    assert [one.waiting for one in ran.analysing] == [0, 0]
    return folder, report


def copied(whole: tuple[Path, CampaignReport], folder: Path) -> Path:
    """The folder of a whole campaign once more, to be spoiled."""
    import shutil

    target = folder / "copy"
    shutil.copytree(whole[0], target)
    return target


def test_a_whole_campaign_is_complete_analysed_and_not_judged_without_limits(
    whole: tuple[Path, CampaignReport],
) -> None:
    folder, report = whole
    assert report.is_complete
    assert [run.outcome for run in report.runs] == ["COMPLETED", "COMPLETED"]
    assert all(in_force(folder / run.run, run.protocol).analysis for run in report.runs)
    assert report.verdict.verdict == "NOT JUDGED"
    assert not report.problems
    assert report.as_json()["complete"] is True


def test_what_arms_its_runs_is_asked_for_each_and_kept_nowhere(
    whole: tuple[Path, CampaignReport],
) -> None:
    folder, report = whole
    kept = {path.suffix: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert {".jsonl", ".h5", ".json"} <= set(kept)
    for path in folder.rglob("*"):
        assert not path.is_file() or TYPED.encode() not in path.read_bytes(), path
    assert TYPED not in str(report.as_json())


def test_a_stop_ends_it_and_the_same_order_goes_on_behind_what_counts(tmp_path: Path) -> None:
    ran = Ran(stop_at="home")
    stopped = conduct(order(tmp_path), ran.crew())
    assert (stopped.outcome, stopped.is_complete) == ("ABORTED", False)
    assert [run.protocol for run in stopped.runs] == ["motor-tare"]
    again = Ran()
    report = conduct(order(tmp_path), again.crew())
    assert again.protocols == ["home"]
    assert report.is_complete
    assert report.journal.path == stopped.journal.path
    assert [run.outcome for run in report.journal.stages] == ["COMPLETED", "ABORTED", "COMPLETED"]


def test_a_campaign_that_is_done_turns_nothing(
    whole: tuple[Path, CampaignReport], tmp_path: Path
) -> None:
    ran = Ran()
    report = conduct(order(copied(whole, tmp_path)), ran.crew())
    assert ran.protocols == []
    assert report.is_complete
    assert report.verdict_rests_on == 2


def _older(folder: Path) -> CampaignOrder:
    return order(folder, now=lambda: "2026-01-09T08:00:00+00:00")


def _changed_file(folder: Path) -> CampaignOrder:
    run = next(folder.glob("*home*.h5"))
    run.chmod(0o644)
    content = bytearray(run.read_bytes())
    content[len(content) // 2] ^= 1
    run.write_bytes(bytes(content))
    return order(folder)


def _mounted_anew(folder: Path) -> CampaignOrder:
    from rig.gears.card import now_text, save_card, with_changes

    values = {"serial": SERIAL, "mounted_on": "2026-01-02"}
    save_card(folder, with_changes(None, values, "A. Example", now_text()))
    return order(folder)


@pytest.mark.parametrize(
    ("spoil", "again", "words"),
    [
        (_older, ["motor-tare"], "8.0 days old, limit 7"),
        (_changed_file, ["home"], "its file cannot be used"),
        (_mounted_anew, ["home"], "another mounted on"),
    ],
)
def test_what_went_out_of_date_is_done_again_and_said(
    whole: tuple[Path, CampaignReport],
    tmp_path: Path,
    spoil: Callable[[Path], CampaignOrder],
    again: list[str],
    words: str,
) -> None:
    wanted = spoil(copied(whole, tmp_path))
    ran = Ran()
    report = conduct(wanted, ran.crew())
    assert ran.protocols == again
    assert report.is_complete
    assert words in " ".join(report.resumed)


def test_another_bench_and_another_plan_are_refused_and_anew_begins_again(
    whole: tuple[Path, CampaignReport], tmp_path: Path
) -> None:
    folder = copied(whole, tmp_path)
    with pytest.raises(ConfigurationError, match="on another bench"):
        conduct(order(folder, bench="elsewhere"), Ran().crew())
    wanted = order(folder)
    other = replace(wanted.walk, plan=replace(PLAN, stages=PLAN.stages[:1]))
    with pytest.raises(ConfigurationError, match="by another plan"):
        conduct(replace(wanted, walk=other), Ran().crew())
    ran = Ran(stop_at="motor-tare")
    report = conduct(order(folder, anew=True), ran.crew())
    assert report.journal.number == 2
    assert not report.runs


def test_a_plan_whose_last_protocol_breaks_a_limit_does_not_begin(tmp_path: Path) -> None:
    fast = replace(PLAN, stages=(*PLAN.stages, Stage("friction", {"highest_rpm": 9000.0})))
    with pytest.raises(PlanError, match="rated for"):
        walk(fast, order(tmp_path).walk.stages[0].order)


def test_a_trip_ends_it_with_its_outcome(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = start.run_order

    def tripping(*arguments: object, **named: object) -> RunReport:
        report = real(*arguments, **named)  # type: ignore[arg-type]
        report.outcome = "TRIPPED"
        return report

    monkeypatch.setattr(start, "run_order", tripping)
    ran = Ran()
    report = conduct(order(tmp_path), ran.crew())
    assert ran.protocols == ["motor-tare"]
    assert (report.outcome, report.is_complete) == ("TRIPPED", False)


def test_an_analysis_that_crashes_is_a_problem_and_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object, **named: object) -> None:
        raise ZeroDivisionError("of the program")

    monkeypatch.setattr("rig.analysis.fit.run.fit_run", broken)
    report = conduct(order(tmp_path), Ran().crew())
    assert report.is_complete
    assert len(report.problems) == 2
    assert "ZeroDivisionError" in report.problems[0]


def test_junit_tells_runs_and_limits(whole: tuple[Path, CampaignReport], tmp_path: Path) -> None:
    _, report = whole
    begun = journals.begin(tmp_path, PLAN, SERIAL, {}, FIRST_DAY)
    path = tmp_path / "deep" / "junit.xml"
    write_junit(replace(report, journal=begun.with_stage(report.journal.stages[0])), path)
    root = ElementTree.parse(path).getroot()
    runs, limits = root
    assert (runs.get("tests"), runs.get("errors")) == ("2", "1")
    assert [len(case) for case in runs] == [0, 1]
    assert limits.get("tests") == str(len(report.verdict.lines))


@pytest.mark.parametrize(
    ("outcome", "required", "told"),
    [
        ("PASS", False, None),
        ("FAIL", False, ("failure", "FAIL: breaks its limit")),
        (
            "MARGINAL",
            False,
            ("skipped", "MARGINAL: the limit is neither kept nor broken for certain"),
        ),
        (
            "MARGINAL",
            True,
            ("skipped", "MARGINAL: the limit is neither kept nor broken for certain"),
        ),
        ("NOT JUDGED", False, ("skipped", "NOT JUDGED: nobody confirmed it")),
        ("NOT JUDGED", True, ("failure", "NOT JUDGED: nobody confirmed it")),
    ],
)
def test_junit_says_why_a_limit_is_no_pass(
    outcome: VerdictOutcome,
    required: bool,
    told: tuple[str, str] | None,
    whole: tuple[Path, CampaignReport],
    tmp_path: Path,
) -> None:
    _, report = whole
    line = Verdict(
        quantity=bare_quantity("torque", "N m"),
        estimate=Estimate(name="torque", value=1.0, unit="N m", low=0.9, high=1.1),
        limit=1.0,
        limit_source="",
        limit_standing="",
        outcome=outcome,
        because="nobody confirmed it" if outcome == "NOT JUDGED" else "",
    )
    judged = replace(report, verdict=replace(report.verdict, lines=(line,)))
    path = tmp_path / "junit.xml"
    write_junit(judged, path, require_verdict=required)
    limits = ElementTree.parse(path).getroot()[1]
    assert [(case.tag, case.get("message")) for case in limits[0]] == ([told] if told else [])
    counts = {name: int(limits.get(name) or 0) for name in ("failures", "skipped")}
    assert counts == {
        "failures": int(told is not None and told[0] == "failure"),
        "skipped": int(told is not None and told[0] == "skipped"),
    }


def test_each_analysis_bears_the_time_at_which_it_was_made(tmp_path: Path) -> None:
    """Not that at which the command began, before any of its runs was there."""
    days = (f"2026-01-{day:02d}T08:00:00+00:00" for day in range(1, 29))
    conduct(order(tmp_path, now=lambda: next(days)), Ran().crew())
    made = [read_analyses(run)[0].content["created"] for run in sorted(tmp_path.glob("*.h5"))]
    assert len(made) >= 2
    assert made == sorted(set(made))
    assert made[0] > FIRST_DAY


def test_who_waits_for_several_analyses_hears_of_each_and_how_long_the_rest_takes(
    tmp_path: Path,
) -> None:
    runs = [tmp_path / f"{number}.h5" for number in range(3)]
    for path in runs:
        path.write_bytes(bytes(1000))
    told: list[Analysing] = []
    futures: list[Future[Analysed]] = []

    class Beside:
        """A process beside that has done nothing yet."""

        def submit(self, *_: object) -> Future[Analysed]:
            futures.append(Future())
            return futures[-1]

    def hear(one: Analysing) -> None:
        told.append(one)
        futures[len(told) - 1].set_result(Analysed(run=one.run, took=2.0))

    analyses = Analyst(lambda: FIRST_DAY, cast(Any, Beside()), hear)
    for path in runs:
        analyses.take(path)
    assert [one.run for one in analyses.all()] == runs
    assert [one.waiting for one in told] == [2, 1, 0]
    assert [one.left for one in told[1:]] == pytest.approx([4.0, 2.0])
    assert analyses.all() == ()
