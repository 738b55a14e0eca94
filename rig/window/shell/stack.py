"""What the window is put together from: words, buttons, and parts above and beside each other.

A layout is written in one place, in the order in which it is seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import Qt, SignalInstance
from PySide6.QtWidgets import (
    QBoxLayout,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLayout,
    QPushButton,
    QScrollArea,
    QSplitter,
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


def text_label(
    text: str = "",
    part: str = "",
    *,
    wraps: bool = False,
    plain: bool = False,
    selectable: bool = False,
) -> QLabel:
    """Words on the window, a `part` of the style sheet; `plain`: what looks like markup stands as it is."""
    label = QLabel(text)
    label.setWordWrap(wraps)
    if part:
        label.setProperty("part", part)
    if plain:
        label.setTextFormat(Qt.TextFormat.PlainText)
    if selectable:
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def push_button(
    text: str,
    part: str = "",
    *,
    tip: str = "",
    act: Callable[..., Any] | SignalInstance | None = None,
) -> QPushButton:
    """A button, a `part` of the style sheet; `tip` says what it does, `act` does it."""
    button = QPushButton(text)
    button.setToolTip(tip)
    if part:
        button.setProperty("part", part)
    if act is not None:
        button.clicked.connect(act)
    return button


def scrolled(inner: QWidget) -> QScrollArea:
    """A part that is scrolled where it is too high for its room, never sideways."""
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    area.setWidget(inner)
    return area


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
