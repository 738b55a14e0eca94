"""Tables of text in the window: the grids of the report, with the colours of verdicts."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHeaderView, QTableWidget, QTableWidgetItem

from rig.content.grid import Grid, tone_of
from rig.window.shell.palette import Palette
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    row_by_row,
    set_tip,
)

WIDEST = 320
"""Pixels of a column at first; the last one takes what is left."""


class GridTable(QTableWidget):
    """A table of text. `judged` names the columns whose words are coloured as verdicts."""

    def __init__(
        self, session: WindowSession, name: str, judged: Sequence[str] = (), *, widest: int = WIDEST
    ) -> None:
        super().__init__(0, 0)
        self._session, self._judged, self._widest = session, judged, widest
        self._columns: tuple[str, ...] = ()
        row_by_row(self, name)
        session.theme_changed.connect(self._colour)

    def show_grid(self, grid: Grid) -> None:
        """Other contents; a word of a verdict has the colour of its tone."""
        self._judged = [one.heading for one in grid.columns if one.kind == "word"]
        self.show_rows(grid.headings, grid.rows, [one.kind == "number" for one in grid.columns])

    def show_rows(
        self, columns: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[bool] = ()
    ) -> None:
        """Other contents."""
        self._columns = tuple(columns)
        self.setColumnCount(len(columns))
        self.setHorizontalHeaderLabels(list(columns))
        self.setRowCount(len(rows))
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        for place, numbers in enumerate(numeric):
            if numbers:
                heading = self.horizontalHeaderItem(place)
                assert heading is not None
                heading.setTextAlignment(right)
        for number, row in enumerate(rows):
            for place, text in enumerate(row):
                item = QTableWidgetItem(text)
                set_tip(item, text)
                if place < len(numeric) and numeric[place]:
                    item.setTextAlignment(right)
                self.setItem(number, place, item)
        self._colour(self._session.palette)
        self._fit_columns()

    def texts(self, column: str) -> list[str]:
        """What stands in a column."""
        place = self._columns.index(column)
        return [self._cell(row, place).text() for row in range(self.rowCount())]

    def _cell(self, row: int, place: int) -> QTableWidgetItem:
        item = self.item(row, place)
        assert item is not None
        return item

    def _fit_columns(self) -> None:
        header = self.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        header.setStretchLastSection(True)
        self.resizeColumnsToContents()
        for place in range(self.columnCount()):
            if self.columnWidth(place) > self._widest:
                self.setColumnWidth(place, self._widest)

    def _colour(self, palette: Palette) -> None:
        for place, name in enumerate(self._columns):
            if name not in self._judged:
                continue
            for row in range(self.rowCount()):
                item = self._cell(row, place)
                tone = tone_of(item.text())
                item.setForeground(QColor(getattr(palette, tone or "text")))
                font = item.font()
                font.setBold(tone is not None)
                item.setFont(font)
