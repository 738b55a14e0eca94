"""The figures of a result in the window: the same data drawn by the same rules as in the report.

Colour by group, dash by place within the group, points under lines, bars from zero (or from below the smallest on a
logarithmic axis), error bars and bands, and a sentence for what a logarithmic axis cannot show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, QSize
from PySide6.QtGui import QTextDocument
from PySide6.QtWidgets import QListWidgetItem, QVBoxLayout, QWidget

from experiments.result import Plot, Series
from rig.content.phrase import phrase
from rig.present.decimate import scatter_rows
from rig.present.figure import without_what_logs_lose
from rig.present.series import foot_of
from rig.window.plot.plots import Curve, CurveStyle, LabPlot, least_gap, upright
from rig.window.shell.palette import Palette
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    room_for,
    set_tip,
    side_list,
    split,
    text_label,
)

CROWDED_POINTS = 120
"""More points than this are drawn small."""
_MANY_POINTS = 1500
"""More points than this are thinned to those that fall on different pixels."""
_LONG_LINE = 4000
"""More points than this are thinned to the pixels of the view by their peaks."""
LOWEST_PANEL, AXIS_WIDTH = 80, 70
"""Pixels: least height of a lower panel, and width of the axes at the left where there are panels."""
BAR_WIDTH, ARM_WIDTH = 4.0, 1.2
"""Pixels of a bar and of the arms of its uncertainty."""
_DASHES: tuple[CurveStyle, ...] = ("line", "dashed", "dotted")


class _PanelPlot(LabPlot):
    """One panel of a figure: the first one, or one under it."""

    def show_series(self, plot: Plot, panel: int) -> None:
        """Draw the series of one panel with its scales and its axis."""
        self.clear_data()
        logs = plot.x_scale == "log", plot.y_scale == "log" and not panel
        self.item.setLogMode(x=logs[0], y=logs[1])
        for number, series in enumerate(plot.series):
            if series.panel != panel:
                continue
            if series.style == "bars":
                self._add_bars(plot.series, number, logs)
            else:
                self._add_line_or_points(plot.series, number, logs)
        if not any(np.isfinite(series.y).any() for series in plot.of_panel(panel)):
            self._say_no_data()
        self.item.enableAutoRange()

    def hide_empty_head(self) -> None:
        """Give the room above the canvas to the data where nothing stands there."""
        self._title.setVisible(bool(self._title.text()))
        self._legend.setVisible(bool(self._legend.text()))

    def _add_line_or_points(
        self, all_series: Sequence[Series], number: int, logs: tuple[bool, bool]
    ) -> None:
        series = all_series[number]
        rows = np.arange(len(series.x))
        if series.style == "points" and len(rows) > _MANY_POINTS:
            rows = scatter_rows(series.x, series.y)
        low, high = (
            None if edge is None or len(rows) < len(edge) else edge
            for edge in (series.low, series.high)
        )
        style: CurveStyle = series.style
        if series.style in ("line", "band"):
            style = "dashed" if series.role == "limit" else dash_of(all_series, number)
        curve = self.add_series(
            series.label,
            series.x[rows],
            series.y[rows],
            style,
            group=series.group,
            low=low,
            high=high,
            logs=logs,
            role=series.role,
        )
        if series.style == "points":
            curve.item.setZValue(-1)
            if len(rows) > CROWDED_POINTS:
                curve.item.setSymbol("o")
                curve.item.setSymbolSize(3)
                curve.item.setSymbolPen(None)
        elif len(rows) > _LONG_LINE and np.all(np.diff(series.x) >= 0):
            curve.item.setDownsampling(auto=True, method="peak")
            curve.item.setClipToView(True)

    def _add_bars(self, all_series: Sequence[Series], number: int, logs: tuple[bool, bool]) -> None:
        """Bars as upright lines of a fixed width in pixels: they are seen on any scale, and
        logarithmic axes take them.
        """
        series = all_series[number]
        foot = foot_of(all_series) if logs[1] else 0.0
        x = series.x + _shift_of(all_series, number)
        y = np.where(np.isfinite(series.y), series.y, foot)
        item = upright(x, np.full(len(x), foot), y, logs)
        self.item.addItem(item)
        self._curves.append(Curve(item, series.label, series.group, "line"))
        arms: Any = None
        if series.low is not None and series.high is not None:
            arms = upright(
                x, np.maximum(series.low, foot) if logs[1] else series.low, series.high, logs
            )
            self.item.addItem(arms)

        def restyle(palette: Palette) -> None:
            item.setPen(pg.mkPen(palette.series_colour(series.group), width=BAR_WIDTH))
            if arms is not None:
                arms.setPen(pg.mkPen(palette.text, width=ARM_WIDTH))

        restyle(self._session.palette)
        self._extras.append(restyle)
        self._draw_legend(self._session.palette)

    def _say_no_data(self) -> None:
        text = pg.TextItem("no data", anchor=(0.5, 0.5), color=self._session.palette.muted)
        self.item.addItem(text, ignoreBounds=True)
        text.setPos(0.5, 0.5)
        self.item.setRange(xRange=(0, 1), yRange=(0, 1), disableAutoRange=False)


class ResultPlot(_PanelPlot):
    """One figure of a result, its further panels under the first over the same x. `shown` is what it draws, `remarks`
    what a reader must know about it.
    """

    def __init__(self, session: WindowSession, *, mark: str = "") -> None:
        super().__init__(session, mark=mark)
        self._legend.setWordWrap(True)
        self.shown: Plot | None = None
        self.remarks: tuple[str, ...] = ()
        self.below: tuple[_PanelPlot, ...] = ()
        """The panels under the first one."""

    def show_data(self, plot: Plot) -> None:
        """Draw a figure: its panels with their series, error bars, bands, scales and labels."""
        self.shown = plot
        drawable, self.remarks = without_what_logs_lose(plot)
        drawable = _with_edges_on_the_axis(drawable)
        self._make_panels(len(plot.panels))
        # What all panels are drawn over stands under the last one.
        x_labels = (*("" for _ in plot.panels), plot.x_label)
        self.set_labels(plot.title, x_labels[0], plot.y_label)
        self.show_series(drawable, 0)
        for place, (panel, lower) in enumerate(zip(plot.panels, self.below, strict=True), 1):
            # A low panel has no room for a label in one line.
            label = panel.y_label.replace(" [", "\n[")
            lower.set_labels("", x_labels[place], label)
            lower.show_series(drawable, place)
            lower.item.setXLink(self.item)
            lower.hide_empty_head()
            self._rows.setStretch(place + 1, round(10 * panel.share))
        self._align()

    def clear_figure(self) -> None:
        """Show nothing."""
        self._make_panels(0)
        self.clear_data()
        self.set_labels("", "", "")
        self.shown = None

    def _make_panels(self, count: int) -> None:
        for lower in self.below:
            self._rows.removeWidget(lower)
            lower.item.setXLink(None)
            lower.setParent(None)
            lower.deleteLater()
        self.below = tuple(_PanelPlot(self._session) for _ in range(count))
        for lower in self.below:
            lower.canvas.setMinimumHeight(LOWEST_PANEL)
            self._rows.addWidget(lower)

    @property
    def _rows(self) -> QVBoxLayout:
        rows = self.layout()
        assert isinstance(rows, QVBoxLayout)
        rows.setStretch(1, 10)
        return rows

    def _align(self) -> None:
        """Panels begin at one place: over each other, the same x lies under the same x."""
        for panel in (self, *self.below):
            panel.item.getAxis("left").setWidth(AXIS_WIDTH if self.below else None)

    def _legend_width(self) -> float:
        """That of one line and some air: the label itself is content with as many lines as it likes."""
        text = QTextDocument()
        text.setDefaultFont(self._legend.font())
        text.setHtml(self._legend.text())
        return text.idealWidth() + 10.0


def _with_edges_on_the_axis(plot: Plot) -> Plot:
    """The figure whose lower edges of bands and arms end where a logarithmic axis has no place for them."""
    drawable = []
    for series in plot.series:
        if series.low is not None and plot.y_scale == "log":
            series = replace(series, low=np.where(series.low > 0, series.low, np.nan))
        drawable.append(series)
    return replace(plot, series=tuple(drawable))


def dash_of(all_series: Sequence[Series], number: int) -> CurveStyle:
    """How a line is dashed: by its place among the lines of its group."""
    one = all_series[number]
    earlier = sum(
        (s.group == one.group or s.role == "null")
        and (s.role, s.panel) == (one.role, one.panel)
        and s.style in ("line", "steps", "band")
        for s in all_series[:number]
    )
    return _DASHES[earlier % len(_DASHES)]


def _shift_of(all_series: Sequence[Series], number: int) -> float:
    """By how much bars stand beside those of the other series: within a third of the least distance of two bars."""
    barred = [i for i, s in enumerate(all_series) if s.style == "bars"]
    if len(barred) < 2:
        return 0.0
    places = np.unique(np.concatenate([all_series[i].x for i in barred]))
    return 0.6 * least_gap(places) / len(barred) * (barred.index(number) - 0.5 * (len(barred) - 1))


class PlotGallery(QWidget):
    """The figures of a result: a list of their titles and the chosen one, with its note under it."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._plots: tuple[Plot, ...] = ()
        self.titles = side_list("Figures", 120)
        self.plot = ResultPlot(session)
        self.note = text_label("", "muted", wraps=True)
        self.note.setContentsMargins(6, 0, 6, 0)
        right = room_for(in_column((self.plot, 1), self.note, margins=(0, 0, 0, 0), spacing=3))
        both = split(self.titles, (right, 1), sizes=[170, 700])
        self.setLayout(in_column(both, margins=(4, 6, 4, 4)))
        self.titles.currentRowChanged.connect(self._show)

    @property
    def plots(self) -> tuple[Plot, ...]:
        """The figures that can be chosen."""
        return self._plots

    def show_plots(self, plots: Sequence[Plot], mark: str, *, keep: bool = False) -> None:
        """Other figures; with `keep` the one of the same name stays chosen."""
        row = self.titles.currentRow()
        before = self._plots[row].name if keep and 0 <= row < len(self._plots) else ""
        self._plots = tuple(plots)
        self.plot.set_mark(mark)
        with QSignalBlocker(self.titles):
            self.titles.clear()
            for title in distinct_titles(plots):
                item = QListWidgetItem(title)
                set_tip(item, title)
                self.titles.addItem(item)
        if not plots:
            self.plot.clear_figure()
            self.note.clear()
            return
        names = [plot.name for plot in plots]
        self.titles.setCurrentRow(names.index(before) if before in names else 0)

    def choose(self, name: str) -> None:
        """Show the figure of a name."""
        self.titles.setCurrentRow([plot.name for plot in self._plots].index(name))

    def sizeHint(self) -> QSize:
        """Enough for one figure."""
        return QSize(760, 380)

    def _show(self, row: int) -> None:
        if not 0 <= row < len(self._plots):
            return
        plot = self._plots[row]
        self.plot.show_data(plot)
        figure = phrase("Figure {} of the paper.", plot.figure)
        note = phrase("{}.", f"{plot.note[:1].upper()}{plot.note[1:]}".rstrip("."))
        text = " ".join(part for part in (note, figure, *self.plot.remarks) if part)
        self.note.setText(text)
        self.note.setVisible(bool(text))


def distinct_titles(plots: Sequence[Plot]) -> list[str]:
    """The titles; two figures of one title are told apart by what their name adds."""
    titles = [plot.title for plot in plots]
    twice = {a for a, b in pairwise(sorted(titles)) if a == b}
    return [f"{plot.title} ({plot.name})" if plot.title in twice else plot.title for plot in plots]
