"""The two plots of the page Fleet: how a quantity is distributed, and one quantity over another, gear by gear."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from rig.content.phrase import phrase
from rig.fleet.lot_figures import MOST_BENCHES, axis_of, core, distribution
from rig.fleet.lot_quantity import LotQuantity
from rig.runfile.header import ORIGIN_WORDS
from rig.window.fleet.wanted import pairs_of
from rig.window.plot.plots import LabPlot
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, split

_CHOSEN_SIZE = 16
"""Pixels of the ring around the gear that is chosen."""


class LotPlots(QWidget):
    """Both plots. `gear_clicked` carries the serial number of a gear whose point was clicked."""

    gear_clicked = Signal(str)

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.distribution, self.scatter = LabPlot(session), LabPlot(session)
        self._places: dict[str, tuple[float, float]] = {}
        self._chosen = ""
        self._ring = pg.ScatterPlotItem(size=_CHOSEN_SIZE, brush=None)
        both = split((self.distribution, 1), (self.scatter, 1), way=Qt.Orientation.Vertical)
        self.setLayout(in_column(both, margins=(0, 0, 0, 0)))
        session.theme_changed.connect(lambda _: self._draw_ring())

    @property
    def places(self) -> dict[str, tuple[float, float]]:
        """Where each gear lies in the scatter, in the units of its axes."""
        return dict(self._places)

    def clear(self) -> None:
        """Nothing to be seen."""
        self._places = {}
        for plot in (self.distribution, self.scatter):
            plot.clear_data()
            plot.set_labels("", "", "")
            plot.set_mark("")

    def show_quantities(self, x: LotQuantity, y: LotQuantity, origin: str) -> None:
        """Draw the distribution of `x`, and `y` over `x`."""
        for plot in (self.distribution, self.scatter):
            plot.set_mark(ORIGIN_WORDS.get(origin, origin.upper()))
        self._draw_distribution(x)
        self._draw_scatter(x, y)

    def choose(self, gear: str) -> None:
        """Put a ring around a gear's point; "" takes it away."""
        self._chosen = gear
        self._draw_ring()

    def _draw_distribution(self, one: LotQuantity) -> None:
        figure, plot = distribution(one), self.distribution
        plot.clear_data()
        plot.set_labels(figure.title, figure.x_label, figure.y_label)
        for series in figure.series:
            style = "bars" if series.style == "bars" else "line"
            plot.add_series(series.label, series.x, series.y, style, role=series.role)
        self._say_beyond(
            plot, figure.title, figure.note.partition("Not in the picture: ")[2].rstrip(".")
        )
        plot.item.enableAutoRange()

    def _say_beyond(self, plot: LabPlot, title: str, words: str) -> None:
        """Name in the title what lies beyond the picture."""
        plot.set_title(title + phrase("; beyond: {}", words))

    def _draw_scatter(self, x: LotQuantity, y: LotQuantity) -> None:
        plot, pairs = self.scatter, pairs_of(x, y)
        plot.clear_data()
        plot.set_labels(f"{y.title}, gear by gear", axis_of(x), axis_of(y))
        scales = x.shown_in[0], y.shown_in[0]
        self._places = {
            a.gear: (a.value / scales[0], b.value / scales[1])
            for a, b in pairs
            if a.value is not None and b.value is not None
        }
        benches = sorted({a.bench for a, _ in pairs})
        for group, bench in enumerate(benches if len(benches) <= MOST_BENCHES else [None]):
            gears = [a.gear for a, _ in pairs if bench is None or a.bench == bench]
            places = np.array([self._places[gear] for gear in gears]).reshape(-1, 2)
            name = "all benches" if bench is None else f"bench {bench or 'not stated'}"
            curve = plot.add_series(name, places[:, 0], places[:, 1], "points", group=group)
            curve.item.sigPointsClicked.connect(
                lambda _item, points, *_, gears=gears: self._click(points, gears)
            )
        self._ring = pg.ScatterPlotItem(size=_CHOSEN_SIZE, brush=None)
        plot.item.addItem(self._ring)
        self._draw_ring()
        self._show_core(f"{y.title}, gear by gear")

    def _show_core(self, title: str) -> None:
        """The whole lot fills the picture: single gears far off are named in the title, and a drag finds them."""
        plot, places = self.scatter, np.array(list(self._places.values())).reshape(-1, 2)
        plot.item.enableAutoRange()
        bounds = [core(places[:, axis]) for axis in (0, 1)]
        near = np.all(
            [(v >= lo) & (v <= hi) for v, (lo, hi) in zip(places.T, bounds, strict=True)], 0
        )
        far = [gear for gear, is_near in zip(self._places, near, strict=True) if not is_near]
        self._say_beyond(plot, title, ", ".join(far))
        if far and near.any():
            (x_low, y_low), (x_high, y_high) = places[near].min(0), places[near].max(0)
            plot.item.setRange(xRange=(x_low, x_high), yRange=(y_low, y_high), padding=0.06)

    def _click(self, points: Any, gears: list[str]) -> None:
        if len(points):
            self.gear_clicked.emit(gears[points[0].index()])

    def _draw_ring(self) -> None:
        place = self._places.get(self._chosen)
        self._ring.setPen(pg.mkPen(self._session.palette.text, width=2))
        self._ring.setData(*([], []) if place is None else ([place[0]], [place[1]]))
