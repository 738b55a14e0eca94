"""A plot of the window: title, legend and axes with units over a pyqtgraph canvas, and the mark of
what is not hardware.

The legend stands above the canvas, never over the data. The mark (SIMULATED, REPLAY, IMPORTED) lies
in the canvas itself, so that a picture of the plot cannot lose it.
"""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QGraphicsItem, QGridLayout, QLabel, QSizePolicy, QWidget

from experiments.result import Plot, SeriesRole
from rig.present.series import HISTOGRAM_WIDTH, is_histogram
from rig.window.plot.axis import LabAxis
from rig.window.shell.palette import Palette
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column

_KEPT = QGraphicsItem.CacheMode.DeviceCoordinateCache
"""Qt keeps what it painted until the data, the colour or the range change."""
_BEHIND = -5.0
"""Place of null models in the order of painting: under every curve, over bands."""
_MARK_HEIGHT = 16
"""Pixels of the row in which the mark stands."""
CurveStyle = Literal["line", "dashed", "dotted", "points", "steps", "band", "bars"]
_DASHES = {"dashed": [6.0, 4.0], "dotted": [1.5, 3.0]}
_SYMBOLS = ("o", "t", "s", "d", "t1", "p", "h", "star")
_BAR_WIDTH = 0.7
"""Of the distance to the next one that a bar fills which stands for itself."""
_LEGEND_SIGNS = {"dashed": "╌╌", "dotted": "┈┈", "points": "●", "band": "▒▒", "bars": "▮"}


@dataclass
class Curve:
    """One curve of a plot: its item, its name in the legend, its colour group and how it is drawn."""

    item: Any
    name: str
    group: int
    style: CurveStyle
    dense: bool = False
    edges: tuple[Any, ...] = ()
    """The lines between which its band lies."""
    role: SeriesRole = "data"
    """A null model lies thin, grey and behind; a limit has a colour of its own."""

    def move(self, x: NDArray[np.float64]) -> None:
        """The same curve, and its band, over other values of x."""
        for item in (self.item, *self.edges):
            item.setData(x, item.getOriginalDataset()[1])


class _LabBox(pg.ViewBox):
    """The room of the data. The wheel zooms along x alone: to look closer at a moment is not to lose the height of a
    curve. Over an axis it zooms along that.
    """

    moves_along_x = False
    """Whether the mouse moves the view along x alone too, so that its height may go on fitting what is in view."""

    def mouseDragEvent(self, ev: Any, axis: int | None = None) -> None:
        """Move the view, or zoom with the right button."""
        super().mouseDragEvent(ev, axis=0 if axis is None and self.moves_along_x else axis)

    def wheelEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom along x, or along the axis that the wheel was turned over."""
        super().wheelEvent(ev, axis=0 if axis is None else axis)


class LabPlot(QWidget):
    """A plot in the lab's manner. Axis labels carry their unit in brackets and are never rescaled by prefixes."""

    def __init__(
        self,
        session: WindowSession,
        title: str = "",
        x_label: str = "",
        y_label: str = "",
        *,
        mark: str = "",
    ) -> None:
        super().__init__()
        self.setObjectName("plot")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._session, self._curves, self._extras = session, [], []
        self._title, self._legend = QLabel(title), QLabel()
        self._title.setProperty("part", "heading")
        self._title.setTextFormat(Qt.TextFormat.PlainText)
        self._legend.setTextFormat(Qt.TextFormat.RichText)
        self._legend.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self._legend.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        axes = {side: LabAxis(side) for side in ("left", "bottom")}
        self.canvas = pg.PlotWidget(viewBox=_LabBox(), axisItems=axes)
        self.canvas.setMinimumSize(180, 110)
        head = QGridLayout()
        head.setContentsMargins(8, 2, 8, 0)
        head.setVerticalSpacing(0)
        head.addWidget(self._title, 0, 0)
        head.addWidget(self._legend, 0, 1)
        head.setColumnStretch(1, 1)
        self._head, self._legend_below = head, False
        self.setLayout(in_column(head, (self.canvas, 1), margins=(1, 1, 1, 3), spacing=0))
        item = self.item
        item.hideButtons()
        item.layout.setContentsMargins(4, 0, 14, 4)
        item.setMenuEnabled(True)
        for side in ("left", "bottom"):
            item.getAxis(side).enableAutoSIPrefix(False)
            # Lines at the numbers only: the finer ones double the time that a frame takes.
            item.getAxis(side).setStyle(maxTickLevel=0)
        self._mark = item.titleLabel
        self._mark_text = mark
        self.set_labels(title, x_label, y_label)
        self.restyle(session.palette)
        session.theme_changed.connect(self.restyle)

    @property
    def item(self) -> Any:
        """The pyqtgraph plot item."""
        return self.canvas.getPlotItem()

    @property
    def mark(self) -> str:
        """SIMULATED, REPLAY, IMPORTED, or nothing for hardware."""
        return self._mark_text

    @property
    def curves(self) -> tuple[Curve, ...]:
        """What is drawn."""
        return tuple(self._curves)

    def set_labels(self, title: str, x_label: str, y_label: str) -> None:
        """Title and axis labels with their units."""
        self._title.setText(title)
        self.item.setLabel("bottom", x_label)
        self.item.setLabel("left", y_label)
        self.canvas.setAccessibleName(title)

    def rename(self, curve: Curve, name: str) -> None:
        """Give a curve another name in the legend."""
        if name != curve.name:
            curve.name = name
            self._draw_legend(self._session.palette)

    def set_title(self, title: str) -> None:
        """Change the title alone."""
        if title != self._title.text():
            self._title.setText(title)
            self._place_legend()

    def set_x_label(self, label: str) -> None:
        """Change what the horizontal axis is called."""
        if label != self.item.getAxis("bottom").labelText:
            self.item.setLabel("bottom", label)

    def set_mark(self, mark: str) -> None:
        """Say what the data are when they are not from hardware."""
        self._mark_text = mark
        self._draw_mark(self._session.palette)

    def curve(
        self,
        name: str,
        group: int = 0,
        style: CurveStyle = "line",
        *,
        dense: bool = False,
        still: bool = False,
        role: SeriesRole = "data",
    ) -> Curve:
        """A new empty curve; give it data with `curve.item.setData(x, y)`.

        `dense`: thousands of points, up and down, drawn many times a second. Such a curve is drawn
        without smoothing: a smoothed line wider than a pixel takes twelve times as long (67 ms
        instead of 5 ms for 2000 points). `still`: beside others that move, and drawn in every frame
        with them; it is kept as a picture while it is the same.
        """
        item = pg.PlotDataItem(
            connect="finite", stepMode="left" if style == "steps" else None, antialias=not dense
        )
        if _is_segmented(style, dense):
            # Stroke by stroke: as one path a smoothed line wider than a pixel takes four to thirty times as long.
            item.curve.setSegmentedLineMode("on")
        if still:
            item.curve.setCacheMode(_KEPT)
        self.item.addItem(item)
        curve = Curve(item, name, group, style, dense, role=role)
        if role == "null":
            item.setZValue(_BEHIND)
        self._curves.append(curve)
        self._style_curve(curve, self._session.palette)
        self._draw_legend(self._session.palette)
        return curve

    def clear_data(self) -> None:
        """Take every curve away."""
        self.item.clear()
        self._curves, self._extras = [], []
        self._draw_legend(self._session.palette)

    def restyle(self, palette: Palette) -> None:
        """Draw in the colours of a theme."""
        self.canvas.setBackground(palette.surface)
        item = self.item
        for side in ("left", "bottom"):
            axis = item.getAxis(side)
            axis.setPen(pg.mkPen(palette.line))
            axis.setTextPen(pg.mkPen(palette.text))
        item.showGrid(x=True, y=True, alpha=0.18)
        for curve in self._curves:
            self._style_curve(curve, palette)
        for extra in self._extras:
            extra(palette)
        self._draw_legend(palette)
        self._draw_mark(palette)

    def show_data(self, plot: Plot) -> None:
        """Draw a figure of a result: its series, error bars, bands, scales and labels."""
        self.clear_data()
        self.set_labels(plot.title, plot.x_label, plot.y_label)
        self.item.setLogMode(x=plot.x_scale == "log", y=plot.y_scale == "log")
        for series in plot.series:
            self.add_series(
                series.label,
                series.x,
                series.y,
                series.style,
                group=series.group,
                low=series.low,
                high=series.high,
                logs=(plot.x_scale == "log", plot.y_scale == "log"),
            )
        self.item.enableAutoRange()

    def add_series(
        self,
        name: str,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        style: CurveStyle = "line",
        group: int = 0,
        low: NDArray[np.float64] | None = None,
        high: NDArray[np.float64] | None = None,
        *,
        logs: tuple[bool, bool] = (False, False),
        role: SeriesRole = "data",
    ) -> Curve:
        """Draw one series with its error bars (points) or its band (everything else)."""
        if style == "bars":
            return self._bars(name, x, y, group)
        curve = self.curve(
            name,
            group,
            "line" if style == "band" else style,
            still=style != "points",
            role=role,
        )
        curve.item.setData(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        if low is not None and high is not None and len(x):
            if style == "points":
                self._error_bars(x, low, high, group, logs)
            else:
                curve.edges = self._band(x, low, high, group, logs)
        return curve

    def _bars(self, name: str, x: NDArray[np.float64], y: NDArray[np.float64], group: int) -> Curve:
        share = HISTOGRAM_WIDTH if is_histogram(x, y) else _BAR_WIDTH
        item = pg.BarGraphItem(x=x, height=y, width=share * least_gap(x), pen=None)
        self.item.addItem(item)
        curve = Curve(item, name, group, "bars")
        self._curves.append(curve)
        self._style_curve(curve, self._session.palette)
        self._draw_legend(self._session.palette)
        return curve

    def _error_bars(
        self,
        x: NDArray[np.float64],
        low: NDArray[np.float64],
        high: NDArray[np.float64],
        group: int,
        logs: tuple[bool, bool],
    ) -> None:
        item = upright(x, low, high, logs)
        self.item.addItem(item)

        def restyle(palette: Palette) -> None:
            item.setPen(pg.mkPen(palette.series_colour(group), width=1))

        restyle(self._session.palette)
        self._extras.append(restyle)

    def _band(
        self,
        x: NDArray[np.float64],
        low: NDArray[np.float64],
        high: NDArray[np.float64],
        group: int,
        logs: tuple[bool, bool],
    ) -> tuple[Any, ...]:
        edges = []
        for values in (low, high):
            edge = pg.PlotDataItem(
                np.asarray(x, dtype=float), np.asarray(values, dtype=float), pen=pg.mkPen(None)
            )
            edge.setLogMode(*logs)
            self.item.addItem(edge)
            edges.append(edge)
        item = pg.FillBetweenItem(*edges)
        item.setCacheMode(_KEPT)
        item.setZValue(-10)
        self.item.addItem(item)

        def restyle(palette: Palette) -> None:
            item.setBrush(pg.mkBrush(shade(palette.series_colour(group), 60)))

        restyle(self._session.palette)
        self._extras.append(restyle)
        return tuple(edges)

    def _style_curve(self, curve: Curve, palette: Palette) -> None:
        colour = colour_of(curve, palette)
        if curve.style == "bars":
            curve.item.setOpts(brush=pg.mkBrush(colour))
        elif curve.style == "points":
            curve.item.setPen(None)
            curve.item.setSymbol(_SYMBOLS[curve.group % len(_SYMBOLS)])
            curve.item.setSymbolSize(7)
            curve.item.setSymbolPen(pg.mkPen(palette.surface, width=0.5))
            curve.item.setSymbolBrush(pg.mkBrush(colour))
        else:
            width = 1.0 if curve.dense or curve.role == "null" else 1.4
            pen = pg.mkPen(colour, width=width, dash=_DASHES.get(curve.style))
            if _is_segmented(curve.style, curve.dense):
                # Square ends of neighbouring strokes would lie over each other, as knots.
                pen.setCapStyle(Qt.PenCapStyle.FlatCap)
            curve.item.setPen(pen)

    def _draw_legend(self, palette: Palette) -> None:
        parts = []
        for curve in self._curves:
            if curve.name:
                sign = _LEGEND_SIGNS.get(curve.style, "━━")
                name = html.escape(curve.name).replace(" ", "&nbsp;")
                parts.append(
                    f'<span style="color:{colour_of(curve, palette)}">{sign}</span>&nbsp;{name}'
                )
        self._legend.setText("&nbsp;&nbsp; ".join(parts))
        self._place_legend()

    def _place_legend(self) -> None:
        """Beside the title where there is room, below it where there is not."""
        room = self.width() - 30 - self._title.sizeHint().width()
        below = bool(self._legend.text()) and self._legend_width() > room and self.width() > 100
        if below != self._legend_below:
            self._legend_below = below
            self._head.removeWidget(self._legend)
            place = (1, 0, 1, 2) if below else (0, 1, 1, 1)
            self._head.addWidget(self._legend, *place)

    def _legend_width(self) -> float:
        """Pixels that the legend takes beside the title."""
        return self._legend.sizeHint().width()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Place the legend anew."""
        super().resizeEvent(event)
        self._place_legend()

    def _draw_mark(self, palette: Palette) -> None:
        # In a row of its own above the data: part of the picture, and never over a curve.
        self.item.setTitle(
            html.escape(self._mark_text) or None,
            color=palette.warning,
            size="8pt",
            bold=True,
            justify="right",
        )
        if self._mark_text:
            self._mark.setMaximumHeight(_MARK_HEIGHT)
            self.item.layout.setRowFixedHeight(0, _MARK_HEIGHT)
        else:
            self.item.layout.setRowFixedHeight(0, 6)


def least_gap(places: NDArray[np.float64]) -> float:
    """The least distance of two bars over x; of a single one 1."""
    return float(np.min(np.diff(np.sort(places)))) if len(places) > 1 else 1.0


def colour_of(curve: Curve, palette: Palette) -> str:
    """The colour of a curve: that of its group; null models and limits have their own."""
    own = {"null": palette.muted, "limit": palette.bad}
    return own.get(curve.role, palette.series_colour(curve.group))


def upright(
    x: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    logs: tuple[bool, bool],
) -> Any:
    """Upright lines from `low` to `high`, one item for all of them."""
    # One line with gaps: pyqtgraph's own error bars know nothing of logarithmic axes.
    along = np.column_stack([low, high, np.full(len(x), np.nan)]).ravel()
    item = pg.PlotDataItem(np.repeat(np.asarray(x, dtype=float), 3), along, connect="finite")
    item.setLogMode(*logs)
    return item


def shade(colour: str, alpha: int) -> Any:
    """A colour (CSS hex) made transparent: alpha 0..255."""
    shaded = pg.mkColor(colour)
    shaded.setAlpha(alpha)
    return shaded


def _is_segmented(style: CurveStyle, dense: bool) -> bool:
    """Whether a curve is drawn stroke by stroke; dashes go on from one stroke to the next only along a path."""
    return style == "line" and not dense
