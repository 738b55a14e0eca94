"""What the window is put together from: words, buttons, and parts above and beside each other.

A layout is written in one place, in the order in which it is seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Protocol

from PySide6.QtCore import Qt, SignalInstance
from PySide6.QtGui import Qt as GuiQt
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QListWidget,
    QPushButton,
    QScrollArea,
    QSplitter,
    QTableView,
    QVBoxLayout,
    QWidget,
)

Item = QWidget | QLayout | tuple[QWidget | QLayout | None, int]
"""A part of a layout with its share of the room left over; None with a share is room that stays empty."""

Margins = tuple[int, int, int, int]
"""Room around a layout: left, top, right, bottom [px]."""


def in_column(
    *items: Item, margins: Margins | None = None, spacing: int | None = None
) -> QVBoxLayout:
    """Parts above each other, the first on top."""
    layout = QVBoxLayout()
    _fill(layout, items, margins, spacing)
    return layout


def in_row(*items: Item, margins: Margins | None = None, spacing: int | None = None) -> QHBoxLayout:
    """Parts beside each other, the first on the left."""
    layout = QHBoxLayout()
    _fill(layout, items, margins, spacing)
    return layout


def split(
    *items: QWidget | tuple[QWidget, int],
    sizes: Sequence[int] = (),
    way: Qt.Orientation = Qt.Orientation.Horizontal,
) -> QSplitter:
    """Parts whose border can be moved, none of them away altogether; `sizes` [px] to begin with."""
    splitter = QSplitter(way)
    splitter.setChildrenCollapsible(False)
    for place, item in enumerate(items):
        part, share = item if isinstance(item, tuple) else (item, 0)
        splitter.addWidget(part)
        splitter.setStretchFactor(place, share)
    if sizes:
        splitter.setSizes(sizes)
    return splitter


class _HasTip(Protocol):
    """A widget, or a row of a list: whatever shows words where the pointer rests."""

    def setToolTip(self, text: str, /) -> None:
        """Give it these words."""


def plain_tip(text: str) -> str:
    """Words for a tip, in which what looks like markup stands as it is: Qt guesses, and a tip has no other way."""
    if not GuiQt.mightBeRichText(text):
        return text
    return f"<qt>{escape(text).replace(chr(10), '<br>')}</qt>"


def set_tip(thing: _HasTip, text: str) -> None:
    """What is shown where the pointer rests on it."""
    thing.setToolTip(plain_tip(text))


def text_label(
    text: str = "",
    part: str = "",
    *,
    wraps: bool = False,
    selectable: bool = False,
    align: Qt.AlignmentFlag | None = None,
    buddy: QWidget | None = None,
) -> QLabel:
    """Words on the window, a `part` of the style sheet; what looks like markup in them stands as it is.

    The letter after an ampersand leads to the `buddy`.
    """
    label = QLabel(text)
    label.setWordWrap(wraps)
    if part:
        label.setProperty("part", part)
    label.setTextFormat(Qt.TextFormat.PlainText)
    if selectable:
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    if align is not None:
        label.setAlignment(align)
    if buddy is not None:
        label.setBuddy(buddy)
    return label


def line_field(name: str, hint: str = "", *, tip: str = "") -> QLineEdit:
    """A line to be written in: its `name` for those who do not see it, a `hint` while it is empty."""
    field = QLineEdit()
    field.setAccessibleName(name)
    field.setPlaceholderText(hint)
    set_tip(field, tip)
    return field


def choice_box(name: str, words: Sequence[str] = (), *, letters: int = 0) -> QComboBox:
    """Words to choose from; `letters`: so many are in view, however long the longest is."""
    box = QComboBox()
    box.setAccessibleName(name)
    box.addItems(words)
    if letters:
        # A long word must not make the whole row wider than the window shows.
        box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        box.setMinimumContentsLength(letters)
    return box


def side_list(name: str, width: int, *, spacing: int = 2, wraps: bool = True) -> QListWidget:
    """A list beside what is chosen in it, at least so wide [px], never scrolled sideways."""
    entries = QListWidget()
    entries.setAccessibleName(name)
    entries.setMinimumWidth(width)
    entries.setSpacing(spacing)
    entries.setWordWrap(wraps)
    entries.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    return entries


def read_only(table: QTableView, name: str) -> None:
    """Make a table one that is looked at: nothing is edited in it, and Tab leads out of it."""
    table.setAccessibleName(name)
    table.verticalHeader().hide()
    table.setEditTriggers(QTableView.EditTrigger.NoEditTriggers)
    table.setTabKeyNavigation(False)
    table.setWordWrap(False)


def row_by_row(table: QTableView, name: str) -> None:
    """Make a table one that is looked at and chosen from by whole rows."""
    read_only(table, name)
    table.setSelectionBehavior(QTableView.SelectionBehavior.SelectRows)
    table.verticalHeader().setDefaultSectionSize(26)
    table.setAlternatingRowColors(True)
    table.setShowGrid(False)
    table.horizontalHeader().setHighlightSections(False)


def room_for(layout: QLayout) -> QWidget:
    """A part of the window that holds a layout."""
    part = QWidget()
    part.setLayout(layout)
    return part


def emptied(layout: QLayout) -> None:
    """Take every part out of a layout, and away."""
    while (item := layout.takeAt(0)) is not None:
        if (part := item.widget()) is not None:
            part.hide()
            part.deleteLater()


def push_button(
    text: str,
    part: str = "",
    *,
    tip: str = "",
    act: Callable[..., Any] | SignalInstance | None = None,
) -> QPushButton:
    """A button, a `part` of the style sheet; `tip` says what it does, `act` does it."""
    button = QPushButton(text)
    set_tip(button, tip)
    if part:
        button.setProperty("part", part)
    if act is not None:
        button.clicked.connect(act)
    return button


def scrolled(inner: QWidget) -> QScrollArea:
    """A part that is scrolled where it is too high for its room, and never sideways."""
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    area.setWidget(inner)
    return area


def restyled(widget: QWidget, part: str) -> None:
    """Give a widget another part of the style sheet, at once."""
    widget.setProperty("part", part)
    _polish(widget)


def mark_invalid(editor: QWidget, is_invalid: bool) -> None:
    """Draw a field as a refused one, or as it is without, at once."""
    editor.setProperty("invalid", str(is_invalid).lower())
    _polish(editor)


def _polish(widget: QWidget) -> None:
    widget.style().unpolish(widget)
    widget.style().polish(widget)


def check_state(is_checked: bool) -> Qt.CheckState:
    """How the box of an entry of a list stands."""
    return Qt.CheckState.Checked if is_checked else Qt.CheckState.Unchecked


def _fill(
    layout: QBoxLayout, items: Sequence[Item], margins: Margins | None, spacing: int | None
) -> None:
    if margins is not None:
        layout.setContentsMargins(*margins)
    if spacing is not None:
        layout.setSpacing(spacing)
    for item in items:
        part, share = item if isinstance(item, tuple) else (item, 0)
        if part is None:
            layout.addStretch(share)
        elif isinstance(part, QWidget):
            layout.addWidget(part, share)
        else:
            layout.addLayout(part, share)
