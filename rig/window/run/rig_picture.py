"""A picture of the rig beside a question: what is to be on the bench, and where a hand or an eye belongs.

The bench from the side: motor with its encoder, shaft, gear, output flange with its encoder, guard and emergency stop.
What the question is about is drawn in the accent colour and named; what is to be taken off is dashed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from rig.window.shell.session import WindowSession

Part = Literal["motor", "shaft", "disc", "gear", "flange", "guard", "stop"]


@dataclass(frozen=True)
class _Scene:
    """What is on the bench (`gear`: on it, off it), what is looked at, and in a few words what that is."""

    words: str
    looked_at: frozenset[Part]
    gear_on: bool = True
    disc_on: bool = False
    guard_open: bool = False
    arrow: Literal["", "turn"] = ""


def _scene(words: str, *looked_at: Part, **how: bool | str) -> _Scene:
    return _Scene(words, frozenset(looked_at), **how)  # pyright: ignore[reportArgumentType]  the scene's own words


WHOLE = _Scene("the bench", frozenset())
"""Of a question that the table does not know: one of another package's protocol."""
SCENES: Mapping[str, _Scene] = {
    "gear-removed": _scene("gear off, motor alone", "gear", gear_on=False),
    "disc-mounted": _scene("gear off, disc as told", "disc", gear_on=False, disc_on=True),
    "mounted-at": _scene("gear at the stated angle", "flange", "gear", arrow="turn"),
    "arming": _scene("guard closed, stop in reach", "guard", "stop"),
    "uncoupled": _scene("gear uncoupled", "gear", gear_on=False),
    "coupled": _scene("gear coupled, guard closed", "gear", "guard"),
    "full-speed": _scene("guard closed, nobody near", "guard", "stop"),
    "turn-shaft": _scene("turn the shaft by hand", "shaft", guard_open=True, arrow="turn"),
    "turned-as-told": _scene("did it turn as told?", "shaft", "flange", arrow="turn"),
    "press-emergency-stop": _scene("the emergency stop", "stop"),
    "how-cut-off": _scene("the emergency stop", "stop"),
    "open-guard": _scene("open the guard", "guard", guard_open=True),
    "close-guard": _scene("close the guard", "guard"),
    "seconds": _scene("watch the shaft stop", "shaft"),
    "sounds-right": _scene("how it sounded", "gear", "motor"),
}
"""By the key of a question."""
_SIZE = QSize(300, 132)
_WIDTH, _HEIGHT = 300.0, 132.0
"""Units in which the bench is drawn."""
_AXIS = 66.0
"""Height of the axis of rotation."""
_PLACES: Mapping[Part, QRectF] = {
    "motor": QRectF(22, 42, 74, 48),
    "shaft": QRectF(96, 62, 42, 8),
    "disc": QRectF(112, 34, 10, 64),
    "gear": QRectF(138, 32, 56, 68),
    "flange": QRectF(200, 26, 12, 80),
    "guard": QRectF(104, 12, 136, 96),
    "stop": QRectF(258, 44, 30, 30),
}
_NAMES: Mapping[Part, str] = {"motor": "motor", "gear": "gear", "stop": "STOP"}


def scene_of(key: str) -> _Scene:
    """The scene of a question by its key; stages that ask one thing of several stops have one scene."""
    return SCENES.get(key) or (SCENES["full-speed"] if key.startswith("ready-") else WHOLE)


class RigPicture(QWidget):
    """The bench from the side, drawn for one question."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.scene = WHOLE
        self.setFixedSize(_SIZE)
        session.theme_changed.connect(lambda _: self.update())

    def show_scene(self, scene: _Scene) -> None:
        """Draw this one."""
        self.scene = scene
        self.setAccessibleName(f"Picture of the bench: {scene.words}")
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the bench, then what is looked at over it."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.scale(self.width() / _WIDTH, self.height() / _HEIGHT)
        font = QFont(self.font())
        font.setPixelSize(12)
        painter.setFont(font)
        self._paint_base(painter)
        for part in _PLACES:
            if part != "disc" or self.scene.disc_on:
                self._paint(painter, part)
        if self.scene.arrow:
            self._paint_arrow(painter)
        painter.setPen(QColor(self._session.palette.accent))
        words = QRectF(0, _HEIGHT - 18, _WIDTH, 18)
        painter.drawText(words, Qt.AlignmentFlag.AlignCenter, self.scene.words)
        painter.end()

    def _paint_base(self, painter: QPainter) -> None:
        palette = self._session.palette
        painter.setPen(QPen(QColor(palette.line), 2.0))
        painter.drawLine(QPointF(12, 110), QPointF(248, 110))
        painter.setPen(QPen(QColor(palette.line), 1.0, Qt.PenStyle.DashDotLine))
        painter.drawLine(QPointF(8, _AXIS), QPointF(248, _AXIS))

    def _paint(self, painter: QPainter, part: Part) -> None:
        palette, place = self._session.palette, _PLACES[part]
        is_meant = part in self.scene.looked_at
        is_gone = part in ("gear", "flange") and not self.scene.gear_on
        meant = palette.accent if is_meant else ""
        pen = QPen(QColor(meant or palette.muted), 2.5 if is_meant else 1.2)
        if is_gone or part == "guard":
            pen.setStyle(Qt.PenStyle.DashLine)
        painter.setPen(pen)
        painter.setBrush(
            QColor(palette.raised) if not (is_gone or part == "guard") else Qt.BrushStyle.NoBrush
        )
        if part == "stop":
            # An outline: it is no button, and the one that is stands above.
            painter.setPen(QPen(QColor(meant or palette.stop), 2.5))
            painter.drawEllipse(place)
        elif part == "guard" and self.scene.guard_open:
            # Its lid stands up behind.
            painter.drawLine(place.bottomLeft(), place.topLeft())
            painter.drawLine(place.topLeft(), place.topLeft() + QPointF(60, -10))
        else:
            painter.drawRoundedRect(place, 3, 3)
        if name := _NAMES.get(part):
            words, height = meant or palette.text, 12
            if part == "stop":
                words, height = palette.stop, 9
            painter.setPen(QColor(words))
            painter.save()
            font = QFont(painter.font())
            font.setPixelSize(height)
            painter.setFont(font)
            painter.drawText(place, Qt.AlignmentFlag.AlignCenter, name)
            painter.restore()

    def _paint_arrow(self, painter: QPainter) -> None:
        """A turn about the axis, at the part that is turned."""
        at = _PLACES["shaft" if "shaft" in self.scene.looked_at else "flange"].center().x()
        around = QRectF(at - 9, _AXIS - 30, 18, 60)
        painter.setPen(QPen(QColor(self._session.palette.accent), 2.0))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawArc(around, 60 * 16, 240 * 16)
        tip = around.center() + QPointF(9 * math.cos(-math.pi / 3), 30 * math.sin(math.pi / 3))
        painter.drawLine(tip, tip + QPointF(-7, -2))
        painter.drawLine(tip, tip + QPointF(-1, -8))
