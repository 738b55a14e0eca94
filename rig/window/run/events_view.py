"""Events of the run and notes of the operator, on one clock: seconds since the run began, as the plots count them."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QBrush, QColor
from PySide6.QtWidgets import (
    QHeaderView,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from experiments.recording import Event
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    line_field,
    push_button,
    set_tip,
)

SIGNS = {"info": "·", "warning": "⚠", "error": "✖"}
LONGEST = 150
"""Characters of an event in the list; the whole of it is in the tip and in the file."""
MOST = 2000
"""Events that are listed; older ones stay in the file."""


class EventsView(QWidget):
    """The list and the field for a note. Times count from the first row of the run, once that is known."""

    note_written = Signal(str)

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._first_ns: int | None = None
        self.table = QTableWidget(0, 3)
        self.table.setHorizontalHeaderLabels(["time [s]", "", "event"])
        self.table.verticalHeader().setVisible(False)
        self.table.verticalHeader().setDefaultSectionSize(22)
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.setSelectionBehavior(QTableWidget.SelectionBehavior.SelectRows)
        self.table.setShowGrid(False)
        self.table.setTabKeyNavigation(False)
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Fixed)
        header.setSectionResizeMode(1, QHeaderView.ResizeMode.Fixed)
        header.setSectionResizeMode(2, QHeaderView.ResizeMode.Stretch)
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        self.table.setColumnWidth(0, 74)
        self.table.setColumnWidth(1, 24)
        self.note = line_field(
            "Note for the run file",
            "Note (Ctrl+N)",
            tip="Goes into the run file with the time of the rig; Enter writes it (Ctrl+N)",
        )
        self.note.setMaxLength(400)
        self.write = push_button("Write note", act=self._write)
        self.note.returnPressed.connect(self._write)
        row = in_row((self.note, 1), self.write)
        self.setLayout(in_column((self.table, 1), row, margins=(0, 0, 0, 0), spacing=6))
        self.set_active(False)
        session.theme_changed.connect(lambda _: self._recolour())

    @property
    def texts(self) -> list[str]:
        """What is listed, in order."""
        return [self._item(row, 2).text() for row in range(self.table.rowCount())]

    @property
    def clocks(self) -> list[str]:
        """The times that are listed, in order [s]."""
        return [self._item(row, 0).text() for row in range(self.table.rowCount())]

    def clear(self) -> None:
        """Begin a new run."""
        self.table.setRowCount(0)
        self._first_ns = None

    def set_origin(self, first_ns: int) -> None:
        """The calendar time of the first row of the run: events count from there."""
        if self._first_ns is None:
            self._first_ns = first_ns
            for row in range(self.table.rowCount()):
                item = self._item(row, 0)
                item.setText(self._clock(int(item.data(Qt.ItemDataRole.UserRole))))

    def add(self, event: Event) -> None:
        """List an event; margins at the end of a run stand in their own bars."""
        if event.code == "margin":
            return
        if self.table.rowCount() >= MOST:
            self.table.removeRow(0)
        row = self.table.rowCount()
        self.table.insertRow(row)
        when = QTableWidgetItem(self._clock(event.time_ns))
        when.setData(Qt.ItemDataRole.UserRole, event.time_ns)
        when.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        sign = QTableWidgetItem("✎" if event.source == "operator" else SIGNS.get(event.level, "·"))
        sign.setData(Qt.ItemDataRole.UserRole, event.level)
        words = event.text if len(event.text) <= LONGEST else event.text[:LONGEST].rstrip() + " …"
        text = QTableWidgetItem(words)
        set_tip(text, f"{event.level}, {event.source}, {event.code}\n{event.text}")
        for column, item in enumerate((when, sign, text)):
            self.table.setItem(row, column, item)
        self._colour(row)
        self.table.resizeRowToContents(row)
        self.table.scrollToBottom()

    def set_active(self, active: bool) -> None:
        """Whether there is a run that takes notes."""
        self.note.setEnabled(active)
        self.write.setEnabled(active)

    def _write(self) -> None:
        text = self.note.text().strip()
        if text:
            self.note_written.emit(text)
            self.note.clear()

    def _item(self, row: int, column: int) -> QTableWidgetItem:
        item = self.table.item(row, column)
        assert item is not None
        return item

    def _clock(self, time_ns: int) -> str:
        return "" if self._first_ns is None else f"{(time_ns - self._first_ns) * 1e-9:.2f}"

    def _colour(self, row: int) -> None:
        palette = self._session.palette
        level = self._item(row, 1).data(Qt.ItemDataRole.UserRole)
        colour = {"warning": palette.warning, "error": palette.bad}.get(level, palette.text)
        for column in range(3):
            self._item(row, column).setForeground(
                QBrush(QColor(palette.muted if column == 0 else colour))
            )

    def _recolour(self) -> None:
        for row in range(self.table.rowCount()):
            self._colour(row)
