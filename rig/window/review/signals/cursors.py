"""Two cursors over the signals of a run: what lies between them, in numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QCheckBox, QDoubleSpinBox, QWidget

from rig.content.grid import Grid, columns
from rig.content.wording import fixed, number
from rig.window.plot.plots import LabPlot
from rig.window.review.grid import GridTable
from rig.window.review.signals.stretch import IntervalStatistics
from rig.window.shell.flow import in_flow, labelled
from rig.window.shell.palette import Palette
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    room_for,
    set_tip,
    text_label,
)

NAMES = ("A", "B")
_SHARES = (0.25, 0.75)
"""Where the cursors stand in the view when they are asked for."""
_DECIMALS = 4
"""Decimals of a cursor's time [s]: a tenth of a cycle at 1 kHz."""
DIGITS = 6
"""Digits of a number between the cursors: counts need no more."""
COLUMNS = columns(
    "channel",
    ("unit", "unit"),
    ("at A", "number"),
    ("at B", "number"),
    ("B − A", "number"),
    ("mean", "number"),
    ("std. dev.", "number"),
    ("min", "number"),
    ("max", "number"),
    ("slope [/s]", "number"),
)
_FIELD_WIDTH = 110
"""Pixels of a field for a time."""
_MOST_HEIGHT = 150
"""Pixels of the table at most: the plots come first."""


class Cursors(QWidget):
    """Their switch, their times, and a table of what lies between. `moved` asks for that to be worked out."""

    moved = Signal()

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._lines: dict[str, list[Any]] = {name: [] for name in NAMES}
        self.switch = QCheckBox("&Cursors")
        set_tip(self.switch, "Two upright lines to be moved: what lies between them in numbers")
        self.switch.toggled.connect(self._show)
        self.times = {name: self._time_field(name) for name in NAMES}
        self.says = text_label("", selectable=True)
        self.table = GridTable(session, "Between the cursors")
        labels = [text_label(name, buddy=self.times[name]) for name in NAMES]
        fields = (labelled(label, self.times[n]) for label, n in zip(labels, NAMES, strict=True))
        self.fields = room_for(in_flow(*fields, self.says))
        head = in_row(self.switch, (self.fields, 1), spacing=12)
        self.setLayout(in_column(head, self.table, margins=(0, 0, 0, 0), spacing=3))
        session.theme_changed.connect(self._restyle)
        self._show(on=False)

    def _time_field(self, name: str) -> QDoubleSpinBox:
        field = QDoubleSpinBox()
        set_tip(field, "Read at the nearest complete row within the stretch")
        field.setAccessibleName(f"Cursor {name}, time since the first row [s]")
        field.setMinimumWidth(_FIELD_WIDTH)
        field.setDecimals(_DECIMALS)
        field.setSuffix(" s")
        field.setRange(0.0, 0.0)
        field.setKeyboardTracking(False)
        field.valueChanged.connect(lambda _: self._follow())
        return field

    @property
    def is_on(self) -> bool:
        """Whether they are shown."""
        return self.switch.isChecked()

    @property
    def stretch(self) -> tuple[float, float]:
        """From the earlier one to the later one [s]."""
        a, b = self.moments
        return min(a, b), max(a, b)

    @property
    def moments(self) -> tuple[float, float]:
        """Where A and B stand [s]; either may be the earlier one."""
        a, b = (self.times[name].value() for name in NAMES)
        return a, b

    def place(self, a: float, b: float) -> None:
        """Put them at two times [s]."""
        for name, moment in zip(NAMES, (a, b), strict=True):
            with QSignalBlocker(self.times[name]):
                self.times[name].setValue(moment)
        self._follow()

    def place_within(self, begin: float, end: float) -> None:
        """Put them into a view [s], at a quarter and three quarters of it."""
        self.place(*(begin + share * (end - begin) for share in _SHARES))

    def limit(self, end: float) -> None:
        """A run of this length [s]."""
        for field in self.times.values():
            with QSignalBlocker(field):
                field.setRange(0.0, end)
                field.setSingleStep(max(end / 1000.0, 10.0**-_DECIMALS))

    def draw_in(self, plots: Iterable[LabPlot]) -> None:
        """Lines in these plots, and in no others: those of before went with their plots."""
        self._lines = {name: [] for name in NAMES}
        for plot in plots:
            for name in NAMES:
                line = pg.InfiniteLine(angle=90, movable=True, label=name)
                line.label.setPosition(0.94)
                line.sigPositionChanged.connect(lambda line, name=name: self._dragged(name, line))
                plot.item.addItem(line, ignoreBounds=True)
                self._lines[name].append(line)
        self._restyle(self._session.palette)
        self._follow()

    def show_stretches(self, stretches: Sequence[IntervalStatistics]) -> None:
        """What lies between them."""
        a, b = self.moments
        rows = [stretch_row(one, crossed=b < a) for one in stretches]
        self.table.show_grid(Grid("Between the cursors", COLUMNS, rows))
        wanted = self.table.horizontalHeader().height() + 4
        wanted += self.table.horizontalScrollBar().sizeHint().height()
        wanted += sum(self.table.rowHeight(row) for row in range(self.table.rowCount()))
        self.table.setFixedHeight(min(wanted, _MOST_HEIGHT))
        self.says.setText(between_words(a, b, stretches))

    def _show(self, on: bool) -> None:
        self.fields.setVisible(on)
        self.table.setVisible(on)
        self._follow()

    def _dragged(self, name: str, line: Any) -> None:
        self.times[name].setValue(float(line.value()))

    def _follow(self) -> None:
        """The lines where their times say."""
        for name, lines in self._lines.items():
            for line in lines:
                with QSignalBlocker(line):
                    line.setVisible(self.is_on)
                    line.setValue(self.times[name].value())
        if self.is_on:
            self.moved.emit()

    def _restyle(self, palette: Palette) -> None:
        for line in (line for lines in self._lines.values() for line in lines):
            line.setPen(pg.mkPen(palette.text, width=1.3, style=Qt.PenStyle.DashLine))
            line.setHoverPen(pg.mkPen(palette.accent, width=2.5))
            line.label.setColor(palette.text)


def between_words(a: float, b: float, stretches: Sequence[IntervalStatistics]) -> str:
    """How long it is from A to B [s], what frequency has that period, and how many rows lie in between."""
    words = [f"B − A {fixed(b - a, _DECIMALS)} s"]
    if a != b:
        words.append(f"1/(B − A) {number(1.0 / (b - a), 5)} Hz")
    if stretches:
        rows, incomplete = stretches[0].rows, stretches[0].incomplete
        words.append(f"{fixed(rows, 0)} rows")
        if incomplete:
            words.append(f"{incomplete} incomplete left out")
    return "   ·   ".join(words)


def stretch_row(one: IntervalStatistics, *, crossed: bool = False) -> tuple[str, ...]:
    """A channel between the cursors, under `COLUMNS`; `crossed`: B is the earlier one."""
    way = -1 if crossed else 1
    ends = (one.first, one.last)[::way]
    inside = (one.mean, one.std, one.smallest, one.largest, one.slope)
    numbers = (number(value, DIGITS) for value in (*ends, way * one.change, *inside))
    return (one.name.replace("_", " "), one.unit, *numbers)
