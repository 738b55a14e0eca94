"""STOP from wherever the hands are: every page, field, list, menu, tip and dialog, by key and by the red button.

Keys and presses go in as from the screen: to the window, not to the widget that is meant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from PySide6.QtCore import QEvent, QPoint, QStringListModel, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QDateEdit,
    QDialog,
    QDoubleSpinBox,
    QMenu,
    QTableWidget,
    QToolTip,
    QWidget,
)
from pytestqt.qtbot import QtBot

from rig.run.state import RunState
from rig.window.main import MainWindow
from rig.window.plot.plots import LabPlot
from rig.window.prepare.training import TrainingDialog
from rig.window.shell.session import WindowSession
from rig.window.shell.theme import apply_theme
from rig.window.work.child import Ending
from tests.rig.window.conftest import SilentRun, silent_run

SHIFT = Qt.KeyboardModifier.ShiftModifier


@pytest.fixture(scope="module")
def opened_once(
    tmp_path_factory: pytest.TempPathFactory, qapp: QApplication
) -> Iterator[MainWindow]:
    """A window with all its pages: to make one takes longer than all that is done with it."""
    session = WindowSession(tmp_path_factory.mktemp("runs"))
    apply_theme(qapp, session.theme)
    window = MainWindow(session)
    window.resize(1366, 768)
    window.show()
    yield window
    window.close()
    window.deleteLater()


@pytest.fixture
def whole(opened_once: MainWindow, qtbot: QtBot) -> Iterator[MainWindow]:
    """That window, with a run that says nothing."""
    window = opened_once
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    silent_run(window)
    yield window
    window.run._change(RunState())


def press(widget: QWidget) -> None:
    """The left button goes down in the middle of a widget, wherever the screen's events lead then."""
    window = widget.window()
    QTest.mousePress(
        window.windowHandle(),
        Qt.MouseButton.LeftButton,
        pos=widget.mapTo(window, widget.rect().center()),
    )


def stop_button(window: MainWindow) -> QWidget:
    """The red button of the page in front."""
    return window.stop if window.stop.isVisible() else window.run.buttons.stop


def page(name: str) -> Callable[[MainWindow], None]:
    return lambda window: window.show_page(name)


def field(path: str) -> Callable[[MainWindow], None]:
    """Into a field, by its place in the window."""

    def go(window: MainWindow) -> None:
        target: Any = window
        for name in path.split("."):
            target = getattr(target, name)
        window.show_page(path.partition(".")[0])
        target.setFocus()
        assert window.focusWidget() is target

    return go


def open_list(window: MainWindow) -> None:
    window.show_page("prepare")
    window.prepare.protocol.choice.showPopup()


def open_list_of_review(window: MainWindow) -> None:
    window.show_page("review")
    box = next(box for box in window.review.library.findChildren(QComboBox) if box.isVisible())
    box.showPopup()


def open_names(window: MainWindow) -> None:
    """The names that are offered while one is typed."""
    window.show_page("prepare")
    completer = window.prepare.operator.completer()
    completer.setModel(QStringListModel(["A. Example"], completer))
    window.prepare.operator.setFocus()
    completer.setCompletionPrefix("A")
    completer.complete()


def spin(window: MainWindow) -> None:
    """A field of numbers with arrows."""
    window.show_page("run")
    box = QDoubleSpinBox(window)
    box.show()
    box.setFocus()


def date_field(window: MainWindow) -> None:
    window.show_page("review")
    edit = next(iter(window.review.library.findChildren(QDateEdit)))
    edit.setVisible(True)
    edit.setFocus()


def table_editor(window: MainWindow) -> None:
    """An open editor in the cell of a table."""
    window.show_page("review")
    table = QTableWidget(1, 1, window)
    table.show()
    table.setFocus()
    table.setCurrentCell(0, 0)
    table.edit(table.currentIndex())


def field_menu(window: MainWindow) -> None:
    field("prepare.operator")(window)
    menu = window.prepare.operator.createStandardContextMenu()
    menu.setParent(window, menu.windowFlags())
    menu.popup(window.mapToGlobal(QPoint(400, 300)))


def plot_menu(window: MainWindow) -> None:
    window.show_page("prepare")
    plot = window.prepare.findChildren(LabPlot)[0]
    plot.item.getViewBox().menu.popup(window.mapToGlobal(QPoint(400, 300)))


def menu_in_menu(window: MainWindow) -> None:
    window.show_page("run")
    menu = QMenu(window)
    inner = menu.addMenu("more")
    inner.addAction("one")
    menu.popup(window.mapToGlobal(QPoint(300, 300)))
    inner.popup(window.mapToGlobal(QPoint(340, 320)))


def tip(window: MainWindow) -> None:
    window.show_page("run")
    QToolTip.showText(window.mapToGlobal(QPoint(300, 300)), "a tip", window)


def closing(window: MainWindow) -> None:
    assert not window.close()
    assert window.run.close_question.isVisible()
    window.run.close_question.stay.setFocus()


def theme(window: MainWindow) -> None:
    """Another one than before the test: Qt takes seconds to draw a window anew, once is enough."""
    window.show_page("prepare")
    if not hasattr(window, "has_other_theme"):
        window.switch_theme()
        window.has_other_theme = True  # type: ignore[attr-defined]


PLACES: dict[str, Callable[[MainWindow], None]] = {
    "the page Prepare": page("prepare"),
    "the page Run": page("run"),
    "the page Review": page("review"),
    "the page Fleet": page("fleet"),
    "the search of the fleet": field("fleet.text"),
    "the operator's name": field("prepare.operator"),
    "a note": field("run.events.note"),
    "the search of the library": field("review.library.filters.text"),
    "the list of runs": field("review.library.table"),
    "a field of numbers": spin,
    "a date": date_field,
    "an editor in a table": table_editor,
    "an open list": open_list,
    "an open list of Review": open_list_of_review,
    "names that are offered": open_names,
    "the menu of a field": field_menu,
    "the menu of a plot": plot_menu,
    "a menu in a menu": menu_in_menu,
    "a tip": tip,
    "the question before closing": closing,
    "another theme": theme,
}
POPUPS = (
    "an open list",
    "an open list of Review",
    "names that are offered",
    "the menu of a field",
    "the menu of a plot",
    "a menu in a menu",
)


@pytest.mark.parametrize("place", PLACES)
def test_esc_and_the_red_button_stop_from(place: str, whole: MainWindow, qtbot: QtBot) -> None:
    said = whole.run.process.said  # type: ignore[union-attr]
    go = PLACES[place]
    for keys, word in ((Qt.KeyboardModifier.NoModifier, "STOP"), (SHIFT, "ABORT")):
        said.clear()
        go(whole)
        assert (QApplication.activePopupWidget() is not None) == (place in POPUPS)
        QTest.keyClick(whole.windowHandle(), Qt.Key.Key_Escape, keys)
        assert said == [word]
        assert QApplication.activePopupWidget() is None
    said.clear()
    go(whole)
    press(stop_button(whole))
    assert said == ["STOP"]
    assert QApplication.activePopupWidget() is None
    QTest.mouseRelease(whole.windowHandle(), Qt.MouseButton.LeftButton)


def test_a_press_beside_stop_only_closes_the_list(whole: MainWindow) -> None:
    said = whole.run.process.said  # type: ignore[union-attr]
    open_list(whole)
    press(whole._buttons.button(2))
    assert QApplication.activePopupWidget() is None
    assert said == []


def test_a_press_on_what_lies_over_stop_is_not_stop(whole: MainWindow) -> None:
    """A list over the red button: whoever presses an entry of it means the entry."""
    whole.show_page("run")
    menu = QMenu(whole)
    menu.addAction("one")
    button = whole.run.buttons.stop
    menu.popup(QPoint(0, 0))
    menu.move(button.mapToGlobal(button.rect().center() - QPoint(10, 10)))
    press(button)
    assert whole.run.process.said == []  # type: ignore[union-attr]
    menu.close()


def test_abort_by_its_button_beside_an_open_menu(whole: MainWindow) -> None:
    whole.show_page("run")
    menu_in_menu(whole)
    press(whole.run.buttons.abort)
    assert whole.run.process.said == ["ABORT"]  # type: ignore[union-attr]


def test_a_key_that_is_held_is_one_stop(whole: MainWindow) -> None:
    QTest.keyPress(whole.windowHandle(), Qt.Key.Key_Escape)
    held = QKeyEvent(
        QEvent.Type.KeyPress,
        int(Qt.Key.Key_Escape),
        Qt.KeyboardModifier.NoModifier,
        "",
        True,
    )
    QApplication.sendEvent(whole, held)
    assert whole.run.process.said == ["STOP"]  # type: ignore[union-attr]


def test_no_dialog_while_a_run_exists(whole: MainWindow, qtbot: QtBot) -> None:
    """Those of this program are refused in a sentence; one that opens by itself is closed."""
    bar = whole.review.details.bar
    for ask in (
        whole.prepare.open_training,
        whole.prepare.acknowledge_trip,
        bar._save,
        bar._choose_file,
    ):
        whole.statusBar().clearMessage()
        ask()
        assert "nothing may stand before STOP" in whole.statusBar().currentMessage()
        assert QApplication.activeModalWidget() is None
    foreign = QDialog(whole)
    qtbot.addWidget(foreign)
    whole.statusBar().clearMessage()
    foreign.open()
    qtbot.waitUntil(lambda: not foreign.isVisible())
    assert "nothing may stand before STOP" in whole.statusBar().currentMessage()


def test_a_dialog_that_is_open_when_a_run_begins_is_closed(window: MainWindow) -> None:
    training = TrainingDialog(window)
    training.show()
    silent_run(window)
    assert not training.isVisible()


def test_without_a_run_esc_is_what_it_always_was(window: MainWindow, qtbot: QtBot) -> None:
    """It closes a list, and dialogs stay; and after a run it is so again."""
    for _ in range(2):
        box = QComboBox(window)
        box.addItems(["one", "two"])
        box.show()
        box.showPopup()
        QTest.keyClick(window.windowHandle(), Qt.Key.Key_Escape)
        qtbot.waitUntil(lambda: QApplication.activePopupWidget() is None)
        dialog = QDialog(window)
        dialog.show()
        assert dialog.isVisible()
        run = silent_run(window)
        window.run._change(window.run.state.gone(reported=True, complaint=""))
        QTest.keyClick(window.windowHandle(), Qt.Key.Key_Escape)
        assert run.said == []


def test_a_silent_run_is_a_run(window: MainWindow) -> None:
    run = silent_run(window)
    assert isinstance(run, SilentRun)
    assert window.session.run_exists
    window.run.stop()
    assert run.said == ["STOP"]


def test_what_turns_for_the_doctor_is_stopped_like_a_run(
    opened_once: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    window, asked = opened_once, SilentRun()
    monkeypatch.setattr(SilentRun, "is_running", property(lambda self: not self._over))
    window.prepare._start_process = lambda _: asked
    window.show()
    window.show_page("prepare")
    window.prepare.ask_the_rig()
    assert window.stop.isVisible()
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Escape)
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Escape, SHIFT)
    press(window.stop)
    assert asked.said == ["STOP", "ABORT", "STOP"]
    assert not window.session.free_for("A dialog")
    assert not window.close(), "a window stays for as long as the rig may turn"
    asked._end(Ending(4, False, "stopped"))
    assert not window.stop.isVisible()
    assert window.session.free_for("A dialog")
    assert window.prepare.doctor_checks[0].severity == "blocks"
