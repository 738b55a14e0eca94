"""Ticks look like ticks and arrows like arrows: what is drawn inside them, in both themes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QRect
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QDoubleSpinBox,
    QStyle,
    QStyleOptionButton,
    QStyleOptionSpinBox,
    QWidget,
)
from pytestqt.qtbot import QtBot

from rig.window.shell.theme import apply_theme


@pytest.fixture(params=["light", "dark"])
def themed(request: pytest.FixtureRequest, qapp: QApplication) -> Iterator[None]:
    apply_theme(qapp, request.param)
    yield
    apply_theme(qapp, "light")


def ink(widget: QWidget, area: QRect) -> int:
    """How many pixels of an area are not of the colour that most of them have."""
    image = widget.grab(area).toImage()
    pixels = [image.pixel(x, y) for x in range(image.width()) for y in range(image.height())]
    return len(pixels) - max(map(pixels.count, set(pixels)))


def indicator(box: QCheckBox) -> QRect:
    option = QStyleOptionButton()
    box.initStyleOption(option)
    whole = box.style().subElementRect(QStyle.SubElement.SE_CheckBoxIndicator, option, box)
    return whole.adjusted(3, 3, -3, -3)


@pytest.mark.usefixtures("themed")
@pytest.mark.parametrize("enabled", [True, False])
def test_a_tick_is_seen_in_its_box(enabled: bool, qtbot: QtBot) -> None:
    box = QCheckBox("x")
    qtbot.addWidget(box)
    box.setEnabled(enabled)
    box.show()
    assert ink(box, indicator(box)) == 0
    box.setChecked(True)
    assert ink(box, indicator(box)) > 10


@pytest.mark.usefixtures("themed")
def test_a_spin_box_has_two_arrows(qtbot: QtBot) -> None:
    box = QDoubleSpinBox()
    qtbot.addWidget(box)
    box.show()
    option = QStyleOptionSpinBox()
    box.initStyleOption(option)
    for button in (QStyle.SubControl.SC_SpinBoxUp, QStyle.SubControl.SC_SpinBoxDown):
        place = QStyle.ComplexControl.CC_SpinBox
        area = box.style().subControlRect(place, option, button, box)
        assert 4 < ink(box, area) < area.width() * area.height() / 2
