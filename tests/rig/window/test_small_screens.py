"""On a small or magnified screen: what stops, what starts, and the banner are wholly on the screen, and not covered."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import QApplication, QLayout, QScrollArea, QWidget
from pytestqt.qtbot import QtBot

from experiments.steps.note import Prompt
from rig.run.parts import Progress
from rig.run.state import RunState
from rig.window.main import SMALLEST, MainWindow
from rig.window.review.results import FitBar
from rig.window.shell.flow import FlowLayout
from rig.window.shell.session import WindowSession
from rig.window.shell.theme import apply_theme
from tests.rig.window.conftest import silent_run

SCREENS = {
    "1366 x 768 at 1.25": (1093, 614),
    "1366 x 768 at 1.5": (911, 512),
    "1920 x 1080 at 2": (960, 540),
}
TAKEN = (0, 72)
"""Logical pixels that the desktop's bar and the window's title take of a screen."""
BOARD = (640, 420)
"""Logical pixels that a board of four plots takes at least."""
LONG = "Take the gear off, and have the motor as warm as in the run that this tare is for. " * 2
PROMPTS = {
    "consent": Prompt(LONG, "gear-removed", consent="The gear is removed and the motor is warm"),
    "text": Prompt(LONG, "temperature"),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, qapp: QApplication) -> Iterator[MainWindow]:
    """A window with all its pages over a folder with a long name."""
    session = WindowSession(tmp_path_factory.mktemp("runs-of-a-laboratory-with-a-long-name"))
    apply_theme(qapp, session.theme)
    window = MainWindow(session)
    window.run.plots.setMinimumSize(*BOARD)
    window.show()
    yield window
    window.run._change(RunState())
    window.close()
    window.deleteLater()


def fit(window: MainWindow, screen: str, qtbot: QtBot) -> None:
    """As large as the screen leaves room for."""
    width, height = (a - b for a, b in zip(SCREENS[screen], TAKEN, strict=True))
    window.resize(width, height)
    qtbot.waitUntil(lambda: (window.width(), window.height()) == (width, height))


def on_screen(window: MainWindow, *widgets: QWidget) -> None:
    """Each as large as it asks for, inside the window, and under the mouse at its corners and its middle."""
    QApplication.processEvents()
    for widget in widgets:
        assert widget.isVisible(), widget
        room = QRect(widget.mapToGlobal(QPoint(0, 0)), widget.size())
        outer = QRect(window.mapToGlobal(QPoint(0, 0)), window.size())
        assert outer.contains(room), (widget, room, outer)
        least = widget.minimumSizeHint().expandedTo(widget.minimumSize())
        assert widget.width() >= least.width(), (widget, widget.size(), least)
        assert widget.height() >= least.height(), (widget, widget.size(), least)
        inner = widget.rect().adjusted(2, 2, -2, -2)
        for point in (inner.center(), inner.topLeft(), inner.bottomRight()):
            there = window.childAt(widget.mapTo(window, point))
            assert there is widget or (there is not None and widget.isAncestorOf(there)), (
                widget,
                there,
            )


@pytest.mark.parametrize("screen", SCREENS)
def test_what_stops_and_starts_is_wholly_on_the_screen(
    screen: str, whole: MainWindow, qtbot: QtBot
) -> None:
    page = whole.run
    fit(whole, screen, qtbot)
    whole.show_page("prepare")
    on_screen(whole, whole.prepare.start_button, *whole._buttons.buttons())
    run = silent_run(whole)
    whole.show_page("run")
    stops = (page.banner, page.banner._word, page.buttons.stop, page.buttons.abort)
    on_screen(whole, *stops)
    now = Progress(step=1, steps=2, what="hold", elapsed=0.0, left=1.0, speed=0.0, events=0)
    run.progress.emit(now)
    on_screen(whole, *stops)
    for prompt in PROMPTS.values():
        run.prompt.emit(prompt)
        fields = (
            (page.prompt.give, page.prompt.question) if prompt.consent else (page.prompt.field,)
        )
        on_screen(whole, *stops, page.prompt, *fields)
        page.prompt.answered.emit("x")
    assert not whole.close()
    on_screen(whole, *stops, page.close_question.stay, page.close_question.leave)
    page.close_question.stay.click()
    for name in ("prepare", "review", "fleet"):
        whole.show_page(name)
        on_screen(whole, whole.stop, *whole._buttons.buttons())
        page.prompt.ask(PROMPTS["consent"])
        run.prompt.emit(PROMPTS["consent"])
        on_screen(whole, whole.stop, *whole._buttons.buttons())
        page.prompt.answered.emit("x")
    whole.show_page("prepare")
    on_screen(whole, whole.prepare.start_button)
    page._change(RunState())


def of_one_row(layout: QLayout) -> list[QWidget]:
    items = [layout.itemAt(place) for place in range(layout.count())]
    widgets = [item.widget() for item in items if item is not None]
    return [widget for widget in widgets if widget is not None and widget.isVisible()]


def uncut(*rows: list[QWidget]) -> None:
    """Every button of a row has the room that its words ask for, and lies over no other."""
    for row in rows:
        assert row
        for place, widget in enumerate(row):
            assert widget.width() >= widget.minimumSizeHint().width(), widget
            assert widget.height() >= widget.minimumSizeHint().height(), widget
            others = (other.geometry() for other in row[place + 1 :])
            assert not any(widget.geometry().intersects(other) for other in others), widget


@pytest.mark.parametrize("screen", SCREENS)
def test_review_and_fleet_cut_no_button_and_scroll_nothing_sideways(
    screen: str, whole: MainWindow, qtbot: QtBot
) -> None:
    fit(whole, screen, qtbot)
    for page in (whole.review, whole.fleet):
        whole.show_page("review" if page is whole.review else "fleet")
        area = page.parentWidget().parentWidget()
        assert isinstance(area, QScrollArea)
        room = area.viewport()
        qtbot.waitUntil(lambda page=page, room=room: page.width() == room.width() > 600)
    whole.show_page("review")
    review = whole.review
    review.right.setCurrentWidget(review.details)
    bar = review.details.findChild(FitBar)
    assert bar is not None
    for widget in (review.details.header, bar):
        widget.show()
    QApplication.processEvents()
    uncut(list(review.library.buttons.values()))
    layouts = [one for one in bar.findChildren(FlowLayout)]
    assert layouts
    for layout in layouts:
        row = of_one_row(layout)
        if row:
            uncut(row)


def test_the_smallest_window_is_no_larger_than_the_smallest_screen(whole: MainWindow) -> None:
    for width, height in SCREENS.values():
        assert whole.minimumWidth() <= width - TAKEN[0]
        assert whole.minimumHeight() <= height - TAKEN[1]
    assert (whole.minimumWidth(), whole.minimumHeight()) == SMALLEST


@pytest.mark.parametrize(
    ("screen", "folded"), [(name, w < 1000) for name, (w, _) in SCREENS.items()]
)
def test_the_side_column_folds_and_a_note_brings_it_back(
    screen: str, folded: bool, whole: MainWindow, qtbot: QtBot
) -> None:
    page = whole.run
    silent_run(whole)
    whole.show_page("run")
    whole.resize(1366, 700)
    page.fold.setChecked(True)
    qtbot.waitUntil(page.side.isVisible)
    fit(whole, screen, qtbot)
    qtbot.waitUntil(lambda: page.side.isVisible() != folded)
    page._write_note()
    assert page.side.isVisible()
    page.fold.click()
    assert not page.side.isVisible()
    page._change(RunState())
