"""How near the run has come to every limit, as bars: the peak so far over the limit, the nearest on top."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from rig.run.margins import TRAVEL, number, worded
from rig.window.shell.session import WindowSession

NEAR = 0.1
"""Share of a limit below which its bar warns."""
ROW = 30


class MarginBars(QWidget):
    """One bar per limited quantity: filled as far as the peak came, with peak, limit and unit in words."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._margins: list[tuple[str, float, float, float]] = []
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        session.theme_changed.connect(lambda _: self.update())

    @property
    def shown(self) -> tuple[str, ...]:
        """The quantities, the nearest to its limit first; travel last, whose limit lies near by design."""
        return tuple(entry[0] for entry in self._margins)

    def show_margins(self, margins: Mapping[str, Mapping[str, float]]) -> None:
        """Peak, limit and share left per quantity, as the supervisor tells them."""
        entries = [(name, m["peak"], m["limit"], m["margin"]) for name, m in margins.items()]
        entries.sort(key=lambda e: (e[0] == TRAVEL, e[3]))
        count = len(self._margins)
        self._margins = entries
        self.setAccessibleName("Margins: " + "; ".join(self._text(e) for e in entries[:3]))
        if len(entries) != count:
            self.setMinimumHeight(ROW * max(len(entries), 1))
            self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        """As high as its bars."""
        return QSize(280, ROW * max(len(self._margins), 1))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the bars."""
        palette = self._session.palette
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = painter.font()
        font.setPointSizeF(9.0)
        painter.setFont(font)
        if not self._margins:
            painter.setPen(QColor(palette.muted))
            painter.drawText(
                self.rect(),
                Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignTop,
                "Shown while a run goes on.",
            )
        for index, entry in enumerate(self._margins):
            self._paint_bar(painter, index, entry)
        painter.end()

    def _paint_bar(
        self, painter: QPainter, index: int, entry: tuple[str, float, float, float]
    ) -> None:
        palette, (name, _, _, margin) = self._session.palette, entry
        near = margin < (0.0 if name == TRAVEL else NEAR)
        top, width = index * ROW, self.width() - 8
        words, inside, sign = palette.text, palette.accent, ""
        if near:
            words, inside, sign = palette.warning, palette.warning, "⚠ "
        painter.setPen(QColor(words))
        label, numbers = self._label(entry), self._numbers(entry)
        wide = painter.fontMetrics().horizontalAdvance(numbers)
        left = painter.fontMetrics().elidedText(
            label, Qt.TextElideMode.ElideRight, max(width - wide - 8, 40)
        )
        line = QRectF(0, top, width, 18)
        painter.drawText(
            line,
            Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter,
            sign + left,
        )
        painter.drawText(line, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, numbers)
        bar = QRectF(0, top + 19, width, 6)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(palette.raised))
        painter.drawRoundedRect(bar, 3, 3)
        share = min(max(1.0 - margin, 0.0), 1.0)
        painter.setBrush(QColor(palette.bad if margin < 0.0 else inside))
        painter.drawRoundedRect(QRectF(0, top + 19, max(share * width, 2.0), 6), 3, 3)

    def _label(self, entry: tuple[str, float, float, float]) -> str:
        return worded(entry[0])[0]

    def _numbers(self, entry: tuple[str, float, float, float]) -> str:
        _, unit, factor = worded(entry[0])
        return f"{number(entry[1] / factor)} of {number(entry[2] / factor)} {unit}"

    def _text(self, entry: tuple[str, float, float, float]) -> str:
        return f"{self._label(entry)} {self._numbers(entry)}"
