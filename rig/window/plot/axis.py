"""An axis of a plot in the lab's manner: plain numbers, on logarithmic axes too (1, 2, 5, 10, 20 ...)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QFontMetricsF, QPaintEngine, QPainter, QPixmap

LABELLED, BARE = 1.0, 0.5
"""What pyqtgraph calls the spacing of a level of ticks; here it says whether they carry numbers."""
WIDE_DECADES, NARROW_DECADES = 3.0, 0.7
"""From so many decades on only powers of ten are numbered; under so many the ticks are those of a linear axis."""
EDGE = 2.0
"""Pixels by which the end of a line may stand out of an axis."""


class LabAxis(pg.AxisItem):
    """The axis of a `LabPlot`. On a screen it is painted from a picture that is kept until a tick,
    a number, a colour or the
    size changes: in most frames of a run it is the same, and making it takes longer than the curves."""

    def __init__(self, orientation: str) -> None:
        self._label_shown = ""
        super().__init__(orientation)
        self._drawn: QPixmap | None = None
        self._drawn_for: tuple[Any, ...] = ()
        self.times_drawn = 0
        """How often the picture was made."""

    def labelString(self) -> str:
        """The label, or its unit alone where the axis is too short for it: the title says what is drawn."""
        whole = self.labelText
        # The library takes it for HTML; names of channels come from files.
        self.labelText = escape(self._fitting(whole)).replace("\n", "<br>")
        try:
            return super().labelString()
        finally:
            self.labelText = whole

    def resizeEvent(self, ev: Any = None) -> None:
        """The label as the new length allows."""
        text = self.labelString()
        if text != self._label_shown and self.label is not None:
            self._label_shown = text
            self.label.setHtml(text)
        super().resizeEvent(ev)

    def _fitting(self, label: str) -> str:
        """A label, or the unit at its end, whichever fits along the axis."""
        assert self.label is not None
        length = self.width() if self.orientation in ("top", "bottom") else self.height()
        wanted = QFontMetricsF(self.label.font()).horizontalAdvance(label)
        unit = re.search(r"\[[^\]]*\]$", label)
        return label if unit is None or wanted <= length else unit[0]

    def paint(self, p: QPainter, opt: Any, widget: Any) -> None:
        """Ticks, numbers, and the lines of the grid."""
        place = p.worldTransform()
        drawing = p.paintEngine().type() is QPaintEngine.Type.SVG
        if widget is None or drawing or place.isScaling() or place.isRotating():
            # Into a file or a printer: lines and letters, no pixels.
            super().paint(p, opt, widget)
            return
        rect, ratio = (
            self.boundingRect().adjusted(-EDGE, -EDGE, EDGE, EDGE),
            p.deviceTransform().m11(),
        )
        # The picture begins at a whole pixel; where its content stands between two pixels belongs to it.
        left, top = place.dx() + rect.x(), place.dy() + rect.y()
        first = QPointF(math.floor(left * ratio) / ratio, math.floor(top * ratio) / ratio)
        within = QPointF(left - first.x(), top - first.y())
        wanted = (rect, ratio, within)
        if self._drawn is None or self.picture is None or self._drawn_for != wanted:
            self._drawn, self._drawn_for = (
                self._draw_picture(rect, ratio, within, opt, widget),
                wanted,
            )
        p.drawPixmap(QPointF(first.x() - place.dx(), first.y() - place.dy()), self._drawn)

    def _draw_picture(
        self, rect: QRectF, ratio: float, within: QPointF, opt: Any, widget: Any
    ) -> QPixmap:
        self.times_drawn += 1
        picture = QPixmap(
            math.ceil((rect.width() + 1.0) * ratio), math.ceil((rect.height() + 1.0) * ratio)
        )
        picture.setDevicePixelRatio(ratio)
        picture.fill(Qt.GlobalColor.transparent)
        painter = QPainter(picture)
        painter.translate(within - rect.topLeft())
        super().paint(painter, opt, widget)
        painter.end()
        return picture

    def logTickValues(
        self,
        minVal: float,
        maxVal: float,
        size: float,
        stdTicks: Sequence[tuple[float, Sequence[float]]],
    ) -> list[tuple[float, list[float]]]:
        """Places (log10) of numbered and of bare ticks."""
        numbered, bare = log_ticks(minVal, maxVal)
        return [(LABELLED, numbered), (BARE, bare)]

    def logTickStrings(
        self, values: Sequence[float], scale: float, spacing: float | None
    ) -> list[str]:
        """The numbers as people write them."""
        if spacing == BARE:
            return [""] * len(values)
        return [plain(10.0**value * scale) for value in values]


def log_ticks(low: float, high: float) -> tuple[list[float], list[float]]:
    """Numbered and bare ticks between 10**low and 10**high, as log10."""
    decades = high - low
    if decades < NARROW_DECADES:
        return _narrow(low, high), []
    wanted = (1,) if decades > WIDE_DECADES else (1, 2, 5)
    numbered, bare = [], []
    for decade in range(math.floor(low), math.ceil(high) + 1):
        for digit in range(1, 10):
            place = decade + math.log10(digit)
            if low - 1e-9 <= place <= high + 1e-9:
                (numbered if digit in wanted else bare).append(place)
    return numbered, bare


def _narrow(low: float, high: float) -> list[float]:
    begin, end = 10.0**low, 10.0**high
    rough = (end - begin) / 5.0
    if not rough > 0.0:
        return []
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= rough)
    places = np.arange(math.ceil(begin / step - 1e-6), math.floor(end / step + 1e-6) + 1) * step
    return [float(math.log10(place)) for place in places if place > 0.0]


def plain(value: float) -> str:
    """A tick's number: 0.001 and 100000, powers of ten only beyond."""
    if 1e-4 <= abs(value) < 1e5:
        return f"{value:.4g}"
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
