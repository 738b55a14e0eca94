"""Texts of files and people in the window: shown letter by letter, never taken for markup."""

import re
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import Qt as GuiQt
from PySide6.QtGui import QTextDocument
from PySide6.QtWidgets import QLabel, QPushButton
from pytestqt.qtbot import QtBot

from rig.gears.card import now_text, save_card, with_changes
from rig.window.main import MainWindow
from rig.window.plot.plots import LabPlot
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import plain_tip, set_tip, text_label

EVIL = "SN[/x] <b>bold</b> <img src='no.png'> &amp;"
WINDOW = Path(__file__).parents[3] / "rig" / "window"


def seen(markup: str) -> str:
    """What somebody reads of a text that Qt takes for HTML."""
    document = QTextDocument()
    document.setHtml(markup)
    return document.toPlainText().replace("\xa0", " ")


def test_words_and_tips_stand_as_they_are(session: WindowSession) -> None:
    label, button = text_label(EVIL), QPushButton()
    assert label.textFormat() is Qt.TextFormat.PlainText
    set_tip(button, f"{EVIL}\nsecond line")
    assert seen(button.toolTip()) == f"{EVIL}\nsecond line"
    assert plain_tip("a < b, twice") == "a < b, twice"


def test_a_plot_shows_names_from_files_as_they_are(session: WindowSession, qtbot: QtBot) -> None:
    plot = LabPlot(session, EVIL, EVIL, EVIL, mark=EVIL)
    qtbot.addWidget(plot)
    plot.curve(EVIL)
    assert plot._title.textFormat() is Qt.TextFormat.PlainText
    assert EVIL in seen(plot._legend.text())
    for side in ("left", "bottom"):
        assert EVIL in seen(plot.item.getAxis(side).labelString())
    assert EVIL in seen(plot.item.titleLabel.item.toHtml())


def test_no_label_of_the_window_reads_markup_in_what_people_write(
    session: WindowSession, qtbot: QtBot
) -> None:
    """Operator, gear and its card: every label in which they stand is a plain one, or they are escaped in it."""
    card = with_changes(
        None, {"serial": "SN-7", "lubricant": EVIL, "mounting_notes": EVIL}, EVIL, now_text()
    )
    save_card(session.folder, card)
    window = MainWindow(session)
    qtbot.addWidget(window)
    session.message.emit(EVIL)
    guessing = [
        label.text()
        for label in window.findChildren(QLabel)
        if label.textFormat().name == "AutoText"
    ]
    assert not [text for text in guessing if GuiQt.mightBeRichText(text) or "SN-7" in text]


@pytest.mark.parametrize(
    "past", [r"\.setToolTip\(", r"(?<!\[)QLabel\((?=[^)])", r"\.setToolTip\b(?!\()", r"QMessageBox"]
)
def test_nothing_in_the_window_makes_words_past_it(past: str) -> None:
    """One place makes words and tips plain; a label of its own says what it takes (`class ...(QLabel)`)."""
    found = [
        f"{path.name}: {line.strip()}"
        for path in WINDOW.rglob("*.py")
        if path.name != "stack.py"
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.search(past, line) and not line.startswith("class ")
    ]
    assert found == (
        ["plots.py: self._title, self._legend = QLabel(title), QLabel()"]
        if "QLabel" in past
        else []
    )
