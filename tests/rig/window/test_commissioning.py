"""A commissioning in the window: begun from Prepare, its stages watched and answered on Run."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from rig.bench.commissioning import read_record
from rig.run.state import State
from rig.window.main import MainWindow
from rig.window.prepare.page import PreparePage
from rig.window.shell.session import WindowSession
from rig.window.work.child import RunProcess
from rig.window.work.prepared import PreparedCommission
from tests.rig.window.conftest import LONGEST, child
from tests.rig.window.test_prepare import Settle, settle, shown, stored_card

__all__ = ["settle"]

STAGES = ("listen", "read", "hand")


@pytest.fixture
def page(session: WindowSession, qtbot: QtBot, settle: Settle) -> PreparePage:
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    session.backend = "wire"
    made = shown(session, qtbot, settle)
    settle(made)
    return made


def test_it_is_begun_with_operator_and_gear(
    page: PreparePage, qtbot: QtBot, settle: Settle
) -> None:
    assert page.commission_button.isVisibleTo(page)
    with qtbot.assertNotEmitted(page.start_requested):
        qtbot.mouseClick(page.commission_button, Qt.MouseButton.LeftButton)
    page.operator.setText("A. Example")
    settle(page)
    with qtbot.waitSignal(page.start_requested) as asked:
        qtbot.mouseClick(page.commission_button, Qt.MouseButton.LeftButton)
    assert asked.args is not None
    (prepared,) = asked.args
    assert isinstance(prepared, PreparedCommission)
    assert prepared.arguments[0] == "commission"
    assert prepared.arguments[-2:] == ["--events", "--stdin-control"]
    assert {"--gear=SN-0815", "--operator=A. Example"} <= set(prepared.arguments)


def test_a_rig_without_a_bus_offers_none(
    session: WindowSession, qtbot: QtBot, settle: Settle
) -> None:
    made = shown(session, qtbot, settle)
    assert not made.commission_button.isVisibleTo(made)


def test_its_stages_are_watched_to_their_end(window: MainWindow, qtbot: QtBot) -> None:
    folder = window.session.folder
    words = ["commission", *STAGES, "--backend=wire", f"--runs={folder}", "--sample-rate=50"]
    prepared = PreparedCommission(
        [*words, "--operator=A. Example", "--events", "--stdin-control"], "Commissioning"
    )
    window.start(prepared)
    process = window.run.process
    assert isinstance(process, RunProcess)
    with qtbot.waitSignal(process.finished, timeout=LONGEST):
        pass
    assert [row.protocol for row in window.run.stages.rows] == list(STAGES)
    assert [done.stage for done in read_record(folder)] == list(STAGES)
    assert window.run.state.state is State.FINISHED
    lines = window.run.outcome.results.text()
    assert "3 stages" in lines
    assert "uncoupled (never done)" in lines


def test_a_question_of_a_stage_is_put_and_answered_and_a_stop_is_of_its_stage(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(window.run, "_start_process", lambda words: child("commission"))
    window.start(PreparedCommission([], "Commissioning"))
    run = window.run
    assert run.process is not None
    with qtbot.waitSignal(run.process.prompt, timeout=LONGEST):
        pass
    assert run.state.state is State.WAITING
    assert "Must be seen" in run._step.text()
    run._on_answer("it is pressed")
    with qtbot.waitSignal(run.process.progress, timeout=LONGEST):
        pass
    run.stop()
    with qtbot.waitSignal(run.process.finished, timeout=LONGEST):
        pass
    # The STOP was the purpose of its stage: the next one was no stopping any more.
    assert not run.state.stop_asked
    assert run.outcome.results.text() == "2 stages; every stage is done"
