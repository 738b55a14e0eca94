"""Ways out of what is not as it should be: a run left behind, an analysis that is stale, a run that lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from rig.analysis.in_force import in_force
from rig.analysis.store import read_analyses
from rig.gears.card import card_for, now_text, save_card, with_changes
from rig.run.state import RunState, State
from rig.runfile.write import RunWriter
from rig.window.main import MainWindow
from rig.window.review.fit import renewal_of
from rig.window.review.page import ReviewPage
from rig.window.review.passport import lacking_runs
from rig.window.run.outcome_view import OutcomeView
from rig.window.shell.session import WindowSession
from tests.rig.runfile.making import block, header
from tests.rig.window.reviewing import LONGEST, indexed


@pytest.mark.usefixtures("in_process")
def test_what_was_left_behind_is_recovered_by_a_press(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    sealed = session.folder / "00007-friction-SN.h5"
    writer = RunWriter(sealed, header("00007-friction-SN"))
    writer.append(block(0, 200))
    writer.flush()
    writer.abandon()
    page = opened()
    page.show_run(writer.part)
    assert page.details.header.recover.isVisible()
    qtbot.mouseClick(page.details.header.recover, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: page.details.path == sealed, timeout=LONGEST)
    assert sealed.exists()
    assert not page.details.header.recover.isVisible()


@pytest.mark.usefixtures("in_process")
def test_where_an_acquisition_died_its_run_is_recovered_on_the_spot(
    session: WindowSession, qtbot: QtBot
) -> None:
    sealed = session.folder / "00007-friction-SN.h5"
    writer = RunWriter(sealed, header("00007-friction-SN"))
    writer.append(block(0, 200))
    writer.flush()
    writer.abandon()
    view = OutcomeView(session)
    qtbot.addWidget(view)
    view.show_end(RunState(state=State.FINISHED, outcome="ABORTED", ended=True), {}, writer.part)
    assert not view.recover.isVisible()
    view.show_end(RunState(state=State.LOST, ended=True), {}, writer.part)
    assert view.recover.isVisible()
    assert not view.report.isEnabled()
    qtbot.mouseClick(view.recover, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(sealed.exists, timeout=LONGEST)
    qtbot.waitUntil(lambda: not view.recover.isVisible(), timeout=LONGEST)
    assert view.report.isEnabled()
    with qtbot.waitSignal(view.review_requested) as asked:
        view.review.click()
    assert asked.args == [sealed]


@pytest.mark.usefixtures("in_process")
def test_a_stale_analysis_is_renewed_by_a_press(
    opened: Callable[..., ReviewPage], friction: list[Path], session: WindowSession, qtbot: QtBot
) -> None:
    run = friction[1]
    page = opened()
    page.show_run(run)
    assert not page.details.bar.renew.isVisible()
    # Another part on the card: the set that the analysis rests on is another one.
    card = with_changes(
        card_for(session.folder, "SN-0815"),
        {"serial": "SN-0815", "load_inertia_kg_m2": 0.05},
        "A. Example",
        now_text(),
    )
    save_card(session.folder, card)
    assert in_force(run).stale
    page.show_run(friction[0])
    page.show_run(run)
    bar = page.details.bar
    assert "Stale" in bar.says.text()
    assert bar.renew.isVisible()
    qtbot.mouseClick(bar.renew, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not page.details.is_busy, timeout=LONGEST)
    assert len(read_analyses(run)) == 2
    assert not in_force(run).stale
    assert not bar.renew.isVisible()


def test_what_was_chosen_by_hand_is_not_renewed_by_a_press(friction: list[Path]) -> None:
    found = in_force(friction[1])
    assert found.analysis is not None
    order = renewal_of(friction[1], found)
    assert order is not None
    assert (order.kind, order.tare, order.keep) == ("friction", None, True)
    content = {**found.analysis.content, "no_tare": ["left away by hand"]}
    by_hand = replace(found, analysis=replace(found.analysis, content=content))
    assert renewal_of(friction[1], by_hand) is None


def test_the_runs_that_a_gear_lacks_are_those_of_its_acceptance(tmp_path: Path) -> None:
    assert lacking_runs(tmp_path, "SN-1", ()) == ()
    values = {"serial": "SN-1", "acceptance": "demonstration"}
    save_card(tmp_path, with_changes(None, values, "A. Example", now_text()))
    all_kinds = lacking_runs(tmp_path, "SN-1", ())
    assert set(all_kinds) >= {"kinematic-error", "friction", "starting-torque"}
    library = [
        indexed(1, gear_serial="SN-1"),
        indexed(2, gear_serial="SN-2", protocol="kinematic-error"),
        indexed(3, gear_serial="SN-1", protocol="starting-torque", outcome="ABORTED"),
    ]
    left = lacking_runs(tmp_path, "SN-1", library)
    assert left == tuple(kind for kind in all_kinds if kind != "friction")


def test_a_run_that_lacks_is_prepared_by_a_press(
    opened: Callable[..., ReviewPage], friction: list[Path], session: WindowSession, qtbot: QtBot
) -> None:
    values = {"serial": "SN-0815", "acceptance": "demonstration"}
    save_card(session.folder, with_changes(None, values, "A. Example", now_text()))
    page = opened()
    page.show_passport("SN-0815")
    passport = page.passport
    qtbot.waitUntil(lambda: passport.passport is not None, timeout=LONGEST)
    (first, *_) = lacking_runs(session.folder, "SN-0815", page.library.model.runs)
    assert passport.prepare.text() == f"&Prepare {first}"
    with qtbot.waitSignal(page.run_requested) as asked:
        qtbot.mouseClick(passport.prepare, Qt.MouseButton.LeftButton)
    assert asked.args == ["SN-0815", first]


def test_the_page_prepare_takes_gear_and_protocol(session: WindowSession, qtbot: QtBot) -> None:
    values = {"serial": "SN-9"}
    save_card(session.folder, with_changes(None, values, "A. Example", now_text()))
    window = MainWindow(session)
    qtbot.addWidget(window)
    window.review.run_requested.emit("SN-9", "starting-torque")
    assert window.stack.currentIndex() == 0
    assert window.prepare.protocol.protocol == "starting-torque"
    facts = window.prepare.gear.facts
    assert facts is not None
    assert facts.serial == "SN-9"
    window.prepare.looking_ahead.wait()
