"""Tables of text in the window: the grids of the report, with the colours of verdicts."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHeaderView, QTableWidget, QTableWidgetItem

from rig.content.grid import Column, Grid, tone_of
from rig.window.shell.palette import Palette
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    row_by_row,
    set_tip,
)

WIDEST = 320
"""Pixels of a column at first; the last one takes what is left."""


class GridTable(QTableWidget):
    """A table of text. `show_grid` fills it; words of a verdict have the colours of their tones."""

    def __init__(self, session: WindowSession, name: str, *, widest: int = WIDEST) -> None:
        super().__init__(0, 0)
        self._session, self._widest = session, widest
        self._columns: tuple[Column, ...] = ()
        row_by_row(self, name)
        session.theme_changed.connect(self._colour)

    def show_grid(self, grid: Grid) -> None:
        """Other contents."""
        self._columns = grid.columns
        self.setColumnCount(len(grid.columns))
        self.setHorizontalHeaderLabels(grid.headings)
        self.setRowCount(len(grid.rows))
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        for place, column in enumerate(grid.columns):
            if column.kind == "number":
                heading = self.horizontalHeaderItem(place)
                assert heading is not None
                heading.setTextAlignment(right)
        for number, row in enumerate(grid.rows):
            for place, (text, column) in enumerate(zip(row, grid.columns, strict=True)):
                item = QTableWidgetItem(text)
                set_tip(item, text)
                if column.kind == "number":
                    item.setTextAlignment(right)
                self.setItem(number, place, item)
        self._colour(self._session.palette)
        self._fit_columns()

    def texts(self, column: str) -> list[str]:
        """What stands in a column."""
        place = [one.heading for one in self._columns].index(column)
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
        for place, column in enumerate(self._columns):
            if column.kind != "word":
                continue
            for row in range(self.rowCount()):
                item = self._cell(row, place)
                tone = tone_of(item.text())
                item.setForeground(QColor(getattr(palette, tone or "text")))
                font = item.font()
                font.setBold(tone is not None)
                item.setFont(font)
