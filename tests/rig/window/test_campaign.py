"""A campaign in the window: chosen first, walked, started, watched run by run, ended with verdict and certificate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from experiments.finding import Finding, Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.bench.backends.order import Order
from rig.run.progress import in_words
from rig.run.state import STOOD, RunState, State
from rig.trial.campaign import journal as journals
from rig.trial.campaign.journal import DoneStage
from rig.trial.campaign.plan import load_plan, shipped_plan
from rig.trial.campaign.walk import walk
from rig.window.main import MainWindow
from rig.window.prepare.campaign import campaign_arguments, joined
from rig.window.prepare.page import PreparePage
from rig.window.prepare.protocol import CAMPAIGN, PLAN_FILE
from rig.window.run.campaign_end import limit_lines
from rig.window.run.live_numbers import NOTHING, LiveNumbers
from rig.window.run.outcome_view import campaign_lines
from rig.window.shell.session import WindowSession
from rig.window.work.live_file import Block
from rig.window.work.prepared import PreparedCampaign
from tests.rig.window.conftest import LONGEST, SilentRun, child
from tests.rig.window.test_prepare import Settle, settle, shown, stored_card

__all__ = ["settle"]

PLAN = """format = "campaign-1"
name = "two"
title = "Two runs"

[[protocol]]
name = "home"

[[protocol]]
name = "friction"
values = { points = 6 }
"""
DONE = {
    "outcome": "COMPLETED",
    "make_safe": {"safe": True, "action": "zero torque", "verified_by": ["statusword"]},
}
TRIPPED = {**DONE, "outcome": "TRIPPED", "trip": {"cause": "over_speed"}, "message": "too fast"}


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "two.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


@pytest.fixture
def prepared(session: WindowSession, plan: Path) -> PreparedCampaign:
    request = Order(
        protocol="home",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=session.folder,
        serial="SN",
    )
    return PreparedCampaign(walk(load_plan(plan), request), [], "Two runs · SN")


@pytest.fixture
def page(session: WindowSession, qtbot: QtBot, settle: Settle) -> PreparePage:
    """A page with a confirmed gear and an operator, as it opens."""
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    made = shown(session, qtbot, settle)
    made.operator.setText("A. Example")
    settle(made)
    return made


def test_the_first_choice_is_the_acceptance_campaign_and_it_is_walked(page: PreparePage) -> None:
    assert page.protocol.campaign == "acceptance"
    assert page.outlook is not None
    assert page.outlook.walk is not None
    names = [stage.protocol for stage in shipped_plan("acceptance").stages]
    assert page.walk.texts("protocol") == names
    assert page.preview.currentWidget() is page.walk
    assert all(text.endswith("%") for text in page.walk.texts("margin left"))
    assert page.summary.text().startswith("Acceptance of a gear: 7 runs, ")
    assert page.start_button.text() == "&Start the campaign"
    # A protocol of its own shows its plan again.
    page.protocol.choose("friction")
    assert page.start_button.text() == "&Start the run"


def test_start_hands_over_the_campaign(page: PreparePage, qtbot: QtBot) -> None:
    page.checklist.tick_all()
    assert page.obstacles == []
    with qtbot.waitSignal(page.start_requested) as asked:
        qtbot.mouseClick(page.start_button, Qt.MouseButton.LeftButton)
    assert asked.args is not None
    (prepared,) = asked.args
    assert isinstance(prepared, PreparedCampaign)
    assert prepared.arguments[:2] == ["campaign", "acceptance"]
    assert prepared.arguments[-2:] == ["--events", "--stdin-control"]
    assert "--gear=SN-0815" in prepared.arguments
    assert "--operator=A. Example" in prepared.arguments
    assert any("checklist signed by A. Example" in note for note in prepared.notes)
    assert page._session.recall("protocol") == f"{CAMPAIGN}acceptance"


def test_a_plan_file_joins_the_choices_and_a_bad_one_is_refused_by_name(
    page: PreparePage, plan: Path, settle: Settle
) -> None:
    told: list[str] = []
    page._session.message.connect(told.append)
    bad = plan.with_name("bad.toml")
    bad.write_text(PLAN.replace("friction", "frication"), encoding="utf-8")
    page.protocol._choose_plan = lambda: bad
    page.protocol.choose(PLAN_FILE)
    assert page.protocol.campaign == "acceptance"
    assert "bad.toml" in told[-1]
    assert "frication" in told[-1]
    page.protocol._choose_plan = lambda: plan
    page.protocol.choose(PLAN_FILE)
    settle(page)
    assert page.protocol.campaign == str(plan)
    assert page.walk.texts("protocol") == ["home", "friction"]


def test_an_unfinished_campaign_goes_on_or_begins_anew(
    page: PreparePage, session: WindowSession, settle: Settle
) -> None:
    done = DoneStage(index=0, protocol="motor-tare", run="00001-x.h5", outcome="COMPLETED")
    journals.begin(session.folder, shipped_plan("acceptance"), "SN-0815", {}, "now").with_stage(
        done
    )
    page.showEvent(None)  # type: ignore[arg-type]
    settle(page)
    assert page.walk.texts("done as") == ["00001-x.h5", *[""] * 6]
    assert "goes on: 1 of 7 are done" in page.summary.text()
    assert page.protocol.anew.isVisible()
    page.protocol.anew.setChecked(True)
    settle(page)
    assert page.walk.texts("done as") == [""] * 7
    assert page.outlook is not None
    assert page.outlook.order is not None
    words = campaign_arguments(page.outlook.order, "acceptance", anew=page.intent.anew)
    assert "--anew" in words


def test_checks_of_many_runs_are_said_once_with_the_runs_that_they_hold_for() -> None:
    warning, good = (
        Finding("ratings", Severity.WARNS, "recalled"),
        Finding("disk space", Severity.PASSED, "82 GB"),
    )
    told = joined([("home", warning), ("home", good), ("friction", good), ("friction", warning)])
    assert [(check.what, check.found) for check in told] == [
        ("ratings", "home, friction: recalled"),
        ("disk space", "good for every run"),
    ]


def test_a_campaign_is_watched_run_by_run_to_its_certificate(
    window: MainWindow, prepared: PreparedCampaign, qtbot: QtBot
) -> None:
    page = window.run
    page._start_process = lambda _: child("campaign")
    opened: list[Path] = []
    page.campaign_end.open_paper = lambda path: bool(opened.append(path)) or True
    window.start(prepared)
    assert page.stages.words == ["○ home", "○ friction"]
    for words in (["▶ home", "○ friction"], ["✓ home", "▶ friction"]):
        qtbot.waitUntil(lambda words=words: page.stages.words == words, timeout=LONGEST)
        qtbot.waitUntil(lambda: page.state.state is State.RUNNING, timeout=LONGEST)
        later = page.stages.left
        assert later == (prepared.walk.stages[1].planned.nominal if words[0] == "▶ home" else 0.0)
        assert page.process is not None
        page.process.note("go on")
    qtbot.waitUntil(lambda: page.state.ended, timeout=LONGEST)
    assert page.banner.word == "COMPLETED: MARGINAL"
    end = page.campaign_end
    assert (end.isVisible(), page.watched.isVisible(), page.outcome.isVisible()) == (
        True,
        False,
        False,
    )
    assert end.gear.text() == "SN: 1 of 2 limits kept"
    assert end.reasons.text() == "the tare is of another day", "the picture says the rest"
    assert [line.outcome for line in end.picture.lines] == ["MARGINAL", "PASS"]
    qtbot.mouseClick(end.open_button, Qt.MouseButton.LeftButton)
    qtbot.mouseClick(end.print_button, Qt.MouseButton.LeftButton)
    assert [path.suffix for path in opened] == [".html", ".pdf"]
    # The next gear is one more of the same part; its run finds the page as every run does.
    asked: list[str] = []
    window.prepare.gear = SimpleNamespace(begin_next=lambda: asked.append("next"))  # type: ignore[assignment]
    qtbot.mouseClick(end.next_button, Qt.MouseButton.LeftButton)
    assert (window.stack.currentWidget(), asked) == (window.prepare, ["next"])
    page._start_process = lambda _: SilentRun()
    window.start(prepared)
    assert (end.isVisible(), page.watched.isVisible()) == (False, True)


def test_an_analysis_that_is_waited_for_is_named_with_the_time_left(
    window: MainWindow, prepared: PreparedCampaign
) -> None:
    page, run = window.run, SilentRun()
    page._start_process = lambda _: run
    window.start(prepared)
    run.analysing.emit(
        {"what": "analysing 00002-friction-SN, 1 behind it", "waiting": 1, "left": 41.0}
    )
    assert page._step.text() == "analysing 00002-friction-SN, 1 behind it"
    assert page._times.text() == f"about {in_words(41.0)} left"
    run.analysing.emit({"what": "analysing 00003-home-SN", "waiting": 0, "left": None})
    assert page._times.text() == ""


LIMIT = {
    "name": "starting torque",
    "quantity": "starting-torque.starting_torque",
    "value": 0.0619,
    "unit": "N m",
    "expanded_uncertainty": 0.0023,
    "limit": 0.070,
    "limit_is": "upper",
    "outcome": "PASS",
    "because": "",
}


def test_a_limit_is_drawn_by_its_share_and_told_in_its_unit(window: MainWindow) -> None:
    told = [
        {**LIMIT, "name": "kept"},
        {**LIMIT, "name": "broken", "value": 0.09, "outcome": "FAIL"},
        {**LIMIT, "name": "lower", "limit": 0.05, "limit_is": "lower"},
        {**LIMIT, "name": "unknown", "value": None, "outcome": "NOT JUDGED"},
    ]
    lines = limit_lines({"limits": told})
    assert [line.name for line in lines] == ["unknown", "broken", "kept", "lower"]
    kept = lines[2]
    assert (kept.value_text, kept.limit_text) == ("61.9 ± 2.3 mN m", "≤ 70 mN m")
    assert kept.share == pytest.approx(0.0619 / 0.070)
    assert kept.room == pytest.approx((0.070 - 0.0619) / 0.0023)
    assert (lines[0].value_text, lines[3].limit_text) == ("–", "≥ 50 mN m")
    picture = window.run.campaign_end.picture
    picture.show_lines(lines)
    assert picture.end == pytest.approx(1.05 * (0.0900 + 0.0023) / 0.070)
    picture.show_lines([replace(kept, share=9.0)])
    assert picture.end == 2.0
    # In every theme, with an arrow for what lies beyond the end, and without any limit.
    for these in ([replace(kept, share=9.0)], lines, []):
        picture.show_lines(these)
        assert not picture.grab().isNull()


def test_stop_in_a_campaign_is_sent_and_not_forgotten_by_the_next_run(
    window: MainWindow, prepared: PreparedCampaign, qtbot: QtBot
) -> None:
    page, run = window.run, SilentRun()
    page._start_process = lambda _: run
    window.start(prepared)
    begun = {"protocol": "home", "state": "begun"}
    run.stage.emit({**begun, "index": 0})
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert run.said == ["STOP"]
    ended = {**begun, "state": "ended", "outcome": "COMPLETED", "report": {**DONE, "path": ""}}
    run.stage.emit({**ended, "index": 0})
    run.stage.emit({**begun, "index": 1})
    assert page.banner.word == "STOPPING"
    page._change(RunState())


def test_what_a_campaign_does_to_the_state() -> None:
    running = RunState().armed()
    between = running.stage_ended(DONE, "home is done")
    assert (between.state, between.safe, between.outcome) == (State.ANALYSING, True, "")
    # A process that dies while it analyses: the rig stood.
    assert between.gone(reported=False, complaint="").remedy == STOOD
    assert between.stage_begun().state is State.ARMED
    tripped = running.stage_ended(TRIPPED, "")
    assert (tripped.state, tripped.cause) == (State.TRIPPED, "over_speed")
    stopped = tripped.campaign_reported({"complete": False, "outcome": "TRIPPED"})
    assert (stopped.state, stopped.outcome, stopped.verdict) == (State.TRIPPED, "TRIPPED", "")
    whole = {"complete": True, "verdict": "NOT JUDGED", "because": ["no limit"]}
    judged = between.campaign_reported(whole)
    assert (judged.state, judged.verdict, judged.what) == (State.FINISHED, "NOT JUDGED", "no limit")


def test_an_incomplete_campaign_says_how_it_goes_on() -> None:
    lines = campaign_lines(
        {"complete": False, "verdict": "NOT JUDGED", "because": list("abcdef"), "problems": ["x"]}
    )
    assert lines == [
        "Verdict: NOT JUDGED (a; b; c; d; 2 more: see the certificate)",
        "Analysis: x",
        "Start the same campaign again: it goes on from here.",
    ]
    alarm = {"sentence": "running torque is larger by 3 mN m", "decides": "One run decides."}
    told = campaign_lines({"complete": True, "verdict": "PASS", "because": [], "alarms": [alarm]})
    assert told[-1] == "CHANGED: running torque is larger by 3 mN m. One run decides."
    lost = {
        "complete": True,
        "verdict": "PASS",
        "because": [],
        "alarms_untold": "run 3 was altered",
    }
    assert (
        campaign_lines(lost)[-1] == "Whether the gear has changed cannot be told: run 3 was altered"
    )


@pytest.mark.parametrize("missing", ["", "torque"])
def test_large_numbers_tell_the_latest_rows(
    session: WindowSession, missing: str, qtbot: QtBot
) -> None:
    numbers = LiveNumbers()
    qtbot.addWidget(numbers)
    assert set(numbers.texts.values()) == {NOTHING}
    has: Callable[[str], bool] = lambda name: name != missing  # noqa: E731
    recording: Any = SimpleNamespace(has=has, metadata=SimpleNamespace(sample_rate=1000.0))
    numbers.begin(recording)
    time = np.arange(1000, dtype=np.float64) * 1e-3
    torque = "drive_torque" if missing else "torque"
    assert torque in numbers.wanted
    late = time > 0.7
    channels = {
        "input_angle": -1200.0 * RPM * time,
        torque: np.where(late, -0.0123, 0.5),
        "housing_temperature": np.where(late, 31.26, 0.0),
    }
    good = np.ones(1000, dtype=bool)
    good[-1] = False
    channels[torque][-1] = 99.0
    numbers.take(Block(0, time, channels, good))
    numbers.show_latest()
    numbers.show_left(61.0, 120.0)
    assert numbers.texts == {
        "speed": "−1200 r/min",
        "torque": "−12.3 mN m",
        "temperature": "31.3 °C",
        "time left": "3 min 01 s",
    }
    numbers.clear()
    assert set(numbers.texts.values()) == {NOTHING}
