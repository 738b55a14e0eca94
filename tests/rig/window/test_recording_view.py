"""Somebody's recording in the window: proposed with pictures, asked, corrected, imported, fitted; never guessed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtWidgets import QPushButton
from pytestqt.qtbot import QtBot

from rig.library.folder import run_files
from rig.runfile.read import open_run
from rig.window.main import MainWindow
from rig.window.review.page import ReviewPage
from rig.window.review.recording.view import RecordingView
from rig.window.shell.session import WindowSession
from tests.rig.window.reviewing import LONGEST, destroy


def recording(
    path: Path, headings: str = "time [s],position [rad],torque [N m]", rows: int = 4000
) -> Path:
    """A joint that swings, with dry and viscous friction."""
    t = np.arange(rows) * 1e-3
    angle, speed = 2.0 * np.sin(3.0 * t), 6.0 * np.cos(3.0 * t)
    torque = 0.5 * np.tanh(speed / 0.01) + 0.1 * speed - 0.02 * 18.0 * np.sin(3.0 * t)
    np.savetxt(
        path, np.column_stack([t, angle, torque]), delimiter=",", header=headings, comments=""
    )
    return path


@pytest.fixture
def looked(opened: Callable[..., ReviewPage], qtbot: QtBot) -> Callable[..., ReviewPage]:
    """The page with files looked at."""

    def look(*files: Path) -> ReviewPage:
        page = opened()
        page.show_recording(files)
        qtbot.waitUntil(lambda: not page.recording.is_busy, timeout=LONGEST)
        return page

    return look


def press(view: RecordingView, text: str, qtbot: QtBot) -> None:
    """Press the button of that text, once it is shown."""

    def shown() -> list[QPushButton]:
        return [
            one for one in view.findChildren(QPushButton) if one.text() == text and one.isVisible()
        ]

    qtbot.waitUntil(lambda: bool(shown()), timeout=LONGEST)
    qtbot.mouseClick(shown()[0], Qt.MouseButton.LeftButton)


def imported(view: RecordingView, qtbot: QtBot) -> None:
    """Press Import, and wait for its end."""
    qtbot.mouseClick(view.make, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not view.is_busy, timeout=LONGEST)


@pytest.mark.usefixtures("in_process")
def test_what_its_headings_tell_is_imported_and_fitted_by_two_presses(
    looked: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    page = looked(recording(tmp_path / "joint.csv"))
    view = page.recording
    assert view.make.isEnabled()
    assert view.columns.rowCount() == 3
    assert len(view.pictures) == 2
    imported(view, qtbot)
    (run,) = run_files(session.folder)
    assert "4000 rows imported" in view.says.text()
    press(view, "Fit motion", qtbot)
    assert page.details.path == run
    qtbot.waitUntil(lambda: page.details.results.result is not None, timeout=LONGEST)
    result = page.details.results.result
    assert result is not None
    assert result.estimates["coulomb"].value == pytest.approx(0.5, rel=0.05)


def test_the_run_says_what_was_proposed_and_who_accepted_it(
    looked: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    imported(looked(recording(tmp_path / "joint.csv")).recording, qtbot)
    process = open_run(run_files(session.folder)[0], rows=False).metadata.process
    assert process["stated"]["accepted_by"]
    assert any("position [rad]" in one for one in process["stated"]["proposed"])


def test_nothing_is_imported_before_what_stays_open_is_answered(
    looked: Callable[..., ReviewPage], qtbot: QtBot, tmp_path: Path
) -> None:
    view = looked(recording(tmp_path / "joint.csv", "time [s],position,torque")).recording
    assert not view.make.isEnabled()
    texts = [question.text for question in view.proposal.questions] if view.proposal else []
    assert len(texts) == len(view.questions.fields) == 2
    place = next(at for at, text in enumerate(texts) if "(position)" in text)
    view.questions.fields[place].setCurrentText("r/min")
    line = view.questions.fields[place].lineEdit()
    assert line is not None
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert "is no unit of it" in view.questions.told[place].text()
    assert not view.make.isEnabled()
    view.questions.fields[place].setCurrentText("deg")
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert len(view.questions.fields) == 1
    press(view, "Leave out", qtbot)
    assert view.make.isEnabled()
    assert view.proposal is not None
    assert [(one.channel, one.unit) for one in view.proposal.used] == [
        ("time", "s"),
        ("position", "deg"),
    ]


def test_a_column_can_be_said_to_be_another(
    looked: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    view = looked(recording(tmp_path / "joint.csv", "time [s],foo,bar [N m]")).recording
    assert view.proposal is not None
    at = [one.heading for one in view.proposal.used_first].index("foo")
    view.columns.selectRow(at)
    assert view.correction.isVisible()
    view.correction.channel.setCurrentText("position")
    view.correction.unit.setText("N m")
    qtbot.mouseClick(view.correction.take, Qt.MouseButton.LeftButton)
    assert "is no unit of it" in view.says.text()
    view.correction.unit.setText("rad")
    qtbot.mouseClick(view.correction.take, Qt.MouseButton.LeftButton)
    imported(view, qtbot)
    made = open_run(run_files(session.folder)[0], rows=False)
    assert set(made.signals) == {"position", "torque"}


def test_a_ratio_that_is_no_number_is_refused_at_the_button(
    looked: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    view = looked(recording(tmp_path / "joint.csv")).recording
    view.ratio.setText("1:100")
    imported(view, qtbot)
    assert "'1:100' is no number" in view.says.text()
    assert not run_files(session.folder)


def test_a_file_that_is_no_recording_says_why(
    looked: Callable[..., ReviewPage], tmp_path: Path
) -> None:
    letter = tmp_path / "letter.txt"
    letter.write_text("Dear colleague,\nthe gear is fine.\n")
    view = looked(letter).recording
    assert not view.make.isEnabled()
    assert "letter.txt" in view.says.text() or "No column is recognised" in view.says.text()


def test_a_file_dropped_on_the_window_is_looked_at_on_its_page(
    session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    main = MainWindow(session)
    main.show()
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(recording(tmp_path / "joint.csv"))), QUrl("ftp://else/x")])
    main.dropEvent(
        QDropEvent(
            QPointF(10, 10),
            Qt.DropAction.CopyAction,
            data,
            Qt.MouseButton.LeftButton,
            Qt.KeyboardModifier.NoModifier,
        )
    )
    view = main.review.recording
    qtbot.waitUntil(lambda: not view.is_busy, timeout=LONGEST)
    assert main.review.right.currentWidget() is view
    assert view.make.isEnabled()
    destroy(main)
