"""The library of runs: search, filters, the table, and what can be done with the runs that are chosen in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date, timedelta
from pathlib import Path

from PySide6.QtCore import (
    QDate,
    QItemSelection,
    QItemSelectionModel,
    QSignalBlocker,
    Qt,
    Signal,
)
from PySide6.QtGui import QHideEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDateEdit,
    QGridLayout,
    QHeaderView,
    QTableView,
    QWidget,
)

from experiments.catalogue import ladders
from rig.gears.card import UNNAMED
from rig.library.index import IndexedRun
from rig.window.review.table_model import (
    COLUMNS,
    RUN_ROLE,
    LibraryFilter,
    LibraryModel,
    Wanted,
    outcome_of,
)
from rig.window.review.table_source import LibrarySource
from rig.window.shell.flow import FlowLayout, in_flow
from rig.window.shell.sentence import listed_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    choice_box,
    in_column,
    in_row,
    line_field,
    push_button,
    row_by_row,
    set_tip,
    text_label,
)
from rig.window.work.background import single_shot
from rig.window.work.verdicts import VerdictDesk

_CHOSEN_PAUSE_MS = 120
"""ms that the selection must rest before the run is opened: arrow keys run through the table
without waiting for each.
"""
_WIDTHS = {
    "#": 36,
    "protocol": 108,
    "gear": 78,
    "outcome": 122,
    "verdict": 116,
    "started": 130,
    "operator": 96,
    "time": 84,
    "origin": 92,
    "part": 96,
}
JUDGED_AT_ONCE = 300
"""Runs from the first row in view on whose verdicts are worked out: what nobody looks at needs none."""
_SCROLLED_PAUSE_MS = 150
"""ms that the rows must rest before the verdicts of those in view are worked out."""
_MANY = 20
"""Files to be read from which on the progress is shown."""
HTML, PDF = ".html", ".pdf"
PERIODS = ("any time", "today", "last 7 days", "last 30 days", "this year", "between …")


class _FilterBar(QWidget):
    """Search text, gear, protocol, outcome and period. `changed` carries what is wanted."""

    changed = Signal(object)

    def __init__(self, today: Callable[[], date] = date.today) -> None:
        super().__init__()
        self._today = today
        self.text = line_field("Search", "Search runs, gears, operators, notes …  (Ctrl+F)")
        self.text.setClearButtonEnabled(True)
        self.gear, self.protocol, self.outcome = (
            _choice(name) for name in ("gear", "protocol", "outcome")
        )
        self.period = choice_box("Period", PERIODS)
        self.since, self.until = QDateEdit(), QDateEdit()
        for edit, word in ((self.since, "first day"), (self.until, "last day")):
            edit.setCalendarPopup(True)
            edit.setDisplayFormat("yyyy-MM-dd")
            edit.setAccessibleName(word)
            set_tip(edit, word.capitalize())
            edit.setDate(_day(today()))
            edit.dateChanged.connect(lambda _: self._tell())
            edit.hide()
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(5)
        grid.addWidget(self.text, 0, 0, 1, 2)
        for place, widget in enumerate(
            (self.gear, self.protocol, self.outcome, self.period, self.since, self.until)
        ):
            grid.addWidget(widget, 1 + place // 2, place % 2)
            grid.setColumnStretch(place % 2, 1)
        self.text.textChanged.connect(lambda _: self._tell())
        for box in (self.gear, self.protocol, self.outcome):
            box.currentIndexChanged.connect(lambda _: self._tell())
        self.period.currentTextChanged.connect(self._change_period)

    @property
    def wanted(self) -> Wanted:
        """What is wanted now."""
        since, until = self._days()
        gear, protocol, outcome = (
            str(box.currentData() or "") for box in (self.gear, self.protocol, self.outcome)
        )
        return Wanted(self.text.text().strip(), gear, protocol, outcome, since, until)

    def offer(self, runs: Sequence[IndexedRun]) -> None:
        """The words that can be chosen are those that occur; a choice stays."""
        for box, words in (
            (self.gear, {run.gear_serial for run in runs}),
            (self.protocol, {run.protocol for run in runs}),
            (self.outcome, {outcome_of(run) for run in runs}),
        ):
            _offer(box, sorted(words - {""}))

    def clear(self) -> None:
        """Every run again."""
        self.text.clear()
        for box in (self.gear, self.protocol, self.outcome, self.period):
            box.setCurrentIndex(0)

    def _days(self) -> tuple[str, str]:
        today, chosen = self._today(), self.period.currentText()
        if chosen == PERIODS[-1]:
            return str(self.since.date().toString("yyyy-MM-dd")), str(
                self.until.date().toString("yyyy-MM-dd")
            )
        first = {
            "today": today,
            "last 7 days": today - timedelta(days=6),
            "last 30 days": today - timedelta(days=29),
            "this year": today.replace(month=1, day=1),
        }.get(chosen)
        return ("", "") if first is None else (first.isoformat(), "")

    def _change_period(self, chosen: str) -> None:
        for edit in (self.since, self.until):
            edit.setVisible(chosen == PERIODS[-1])
        self._tell()

    def _tell(self) -> None:
        self.changed.emit(self.wanted)


class LibraryTable(QWidget):
    """The library. `chosen` carries the paths of the selected runs, `opened` one that was opened by
    Enter or double click.
    """

    chosen = Signal(object)
    opened = Signal(Path)
    overlay_requested = Signal(object)
    difference_requested = Signal(object)
    models_requested = Signal(object)
    passport_requested = Signal(str)
    report_requested = Signal(object, str)
    """Carries the paths and the suffix of the report."""
    import_requested = Signal()

    def __init__(self, session: WindowSession, today: Callable[[], date] = date.today) -> None:
        super().__init__()
        self.source = LibrarySource(session.folder, self)
        self.model = LibraryModel(lambda: session.palette, self)
        self.filtered = LibraryFilter(self)
        self.filtered.setSourceModel(self.model)
        self.filters = _FilterBar(today)
        self.table = _table(self.filtered)
        self.count = text_label("Reading the runs …", "muted", wraps=True)
        self.says = text_label(wraps=True, selectable=True)
        self.says.hide()
        self.bring = push_button(
            "&Import …",
            tip="Make a run of somebody else's recording; a file can also be dropped on the window",
            act=self.import_requested,
        )
        self._pause = single_shot(self, _CHOSEN_PAUSE_MS, lambda: self.chosen.emit(self.selected))
        self._waited_for: Path | None = None
        self.setLayout(
            in_column(
                self.filters,
                (self.table, 1),
                self._actions(),
                in_row((self.count, 1), self.bring),
                self.says,
                margins=(8, 8, 4, 6),
                spacing=6,
            )
        )
        self.setMinimumWidth(300)
        self.desk = VerdictDesk(self)
        self.desk.judged.connect(self.model.take_verdicts)
        self._connect(session)

    def _connect(self, session: WindowSession) -> None:
        self.filters.changed.connect(self._filter)
        self.source.changed.connect(self._take)
        self.source.looked.connect(self._judge)
        self.source.failed.connect(self.count.setText)
        self.source.progressed.connect(self._progress)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._selection_changed())
        self.table.activated.connect(lambda index: self.opened.emit(index.data(RUN_ROLE).path))
        self._rest = single_shot(self, _SCROLLED_PAUSE_MS, self._judge)
        self.table.verticalScrollBar().valueChanged.connect(lambda _: self._rest.start())
        self.table.horizontalHeader().sortIndicatorChanged.connect(lambda *_: self._rest.start())
        session.theme_changed.connect(lambda _: self.model.restyle())
        session.runs_changed.connect(self.source.look)
        find = QShortcut(QKeySequence.StandardKey.Find, self)
        find.activated.connect(self.filters.text.setFocus)
        self.filters.text.returnPressed.connect(self._into_table)
        self._selection_changed()

    def _actions(self) -> FlowLayout:
        self.buttons = {
            "overlay": push_button(
                "O&verlay",
                tip="Draw the figures of two or more chosen runs over each other",
                act=lambda: self.overlay_requested.emit(self.selected),
            ),
            "difference": push_button(
                "&Difference",
                tip="What differs between two chosen runs, and only that",
                act=lambda: self.difference_requested.emit(self.selected),
            ),
            "models": push_button(
                "&Models",
                tip="Judge models by two or more runs of one protocol, each by a fit of the others",
                act=lambda: self.models_requested.emit(self.selected),
            ),
            "passport": push_button(
                "Pass&port",
                tip="The chosen run's gear over time, and its report; needs a serial number",
                act=lambda: self.passport_requested.emit(self._serial()),
            ),
            "report": push_button(
                "Repor&t",
                tip="Write the report of the chosen runs as a web page (HTML) and open it",
                act=lambda: self.report_requested.emit(self.selected, HTML),
            ),
            "pdf": push_button(
                "PD&F",
                tip="Write the report of the chosen runs for paper (PDF) and open it",
                act=lambda: self.report_requested.emit(self.selected, PDF),
            ),
        }
        return in_flow(*self.buttons.values(), spacing=5)

    @property
    def selected(self) -> list[Path]:
        """The chosen runs, from the first number on."""
        runs = [index.data(RUN_ROLE) for index in self.table.selectionModel().selectedRows()]
        return [run.path for run in sorted(runs, key=lambda run: (run.number, run.path.name))]

    def run_of(self, path: Path) -> IndexedRun | None:
        """What the library knows of a file."""
        return next((run for run in self.model.runs if run.path == path), None)

    def select(self, *paths: Path) -> None:
        """Choose runs; one that is not listed yet is chosen when it comes."""
        self._waited_for = None
        listed = {run.path for run in self.model.runs}
        if len(paths) == 1 and paths[0] not in listed:
            self._waited_for = paths[0]
        if not all(
            self.filtered.wanted.passes(run) for run in self.model.runs if run.path in paths
        ):
            self.filters.clear()
        chosen = QItemSelection()
        for row in range(self.filtered.rowCount()):
            index = self.filtered.index(row, 0)
            if index.data(RUN_ROLE).path in paths:
                chosen.select(index, self.filtered.index(row, len(COLUMNS) - 1))
                self.table.scrollTo(index)
        flags = QItemSelectionModel.SelectionFlag
        self.table.selectionModel().select(chosen, flags.ClearAndSelect | flags.Rows)
        if not chosen.isEmpty():
            index = chosen.indexes()[0]
            self.table.selectionModel().setCurrentIndex(index, flags.NoUpdate)

    def say(self, text: str) -> None:
        """A sentence under the table."""
        self.says.setText(text)
        self.says.setVisible(bool(text))

    def _serial(self) -> str:
        serials = (run.gear_serial for path in self.selected if (run := self.run_of(path)))
        return next((serial for serial in serials if serial not in UNNAMED), "")

    def _take(self, runs: Sequence[IndexedRun]) -> None:
        before = [path.name.removesuffix(".part") for path in self.selected]
        self.model.set_runs(runs)
        self.filters.offer(runs)
        waited = self._waited_for
        if waited is not None and any(run.path == waited for run in runs):
            self.select(waited)
        else:
            # A run that has been sealed meanwhile goes by its new name.
            again = [run.path for run in runs if run.path.name.removesuffix(".part") in before]
            if again and again != self.selected:
                self.select(*again)
        self._count()

    def hideEvent(self, event: QHideEvent) -> None:
        """What nobody looks at is not judged."""
        super().hideEvent(event)
        self.desk.stop()

    def _judge(self) -> None:
        """Verdicts of what is in view and a few pages on; of all runs where the rows are in the order of them."""
        if not self.isVisible():
            return
        last = self.filtered.rowCount()
        first = min(max(self.table.rowAt(0), 0), max(last - 1, 0))
        rows = [*range(first, last), *range(first)]
        if not self.model.is_sorted_by_verdict:
            rows = rows[:JUDGED_AT_ONCE]
        self.desk.look([self.filtered.index(row, 0).data(RUN_ROLE) for row in rows])

    def _filter(self, wanted: Wanted) -> None:
        self.filtered.set_wanted(wanted)
        self._rest.start()
        self._count()

    def _progress(self, done: int, of: int) -> None:
        # One run that grows is read within a blink; a whole folder is read once, and people wait for it.
        if of >= _MANY:
            self.count.setText(f"Reading the runs: {done} of {of}, once for this folder …")
        elif not of:
            self._count()

    def _count(self) -> None:
        every, shown = self.model.rowCount(), self.filtered.rowCount()
        bad = sum(bool(run.problem) for run in self.model.runs)
        text = listed_of(shown, every, "runs")
        if not every:
            text = f"No runs in {self.source.folder} yet. Prepare one and run it: it is listed here at once."
        if bad:
            text += f" · {bad} cannot be read"
        self.count.setText(text)

    def _selection_changed(self) -> None:
        selected = self.selected
        readable = [run for path in selected if (run := self.run_of(path)) and not run.problem]
        whole = len(readable) == len(selected)
        self.buttons["overlay"].setEnabled(len(selected) >= 2 and whole)
        self.buttons["difference"].setEnabled(len(selected) == 2 and whole)
        self.buttons["models"].setEnabled(
            len(selected) >= 2 and whole and _have_one_ladder(readable)
        )
        self.buttons["passport"].setEnabled(bool(self._serial()))
        sealed = bool(selected) and whole and all(run.state == "sealed" for run in readable)
        for name in ("report", "pdf"):
            self.buttons[name].setEnabled(sealed)
        self._pause.start()

    def _into_table(self) -> None:
        """Enter in the search field: on to the first run that was found."""
        if self.filtered.rowCount():
            self.table.setFocus()
            self.table.selectRow(0)


def _choice(what: str) -> QComboBox:
    box = choice_box(what.capitalize(), letters=8)
    box.addItem(f"every {what}", "")
    return box


def _offer(box: QComboBox, words: Sequence[str]) -> None:
    if [box.itemText(i) for i in range(1, box.count())] == list(words):
        return
    chosen = str(box.currentData() or "")
    with QSignalBlocker(box):
        while box.count() > 1:
            box.removeItem(1)
        for word in words:
            box.addItem(word, word)
        box.setCurrentIndex(max(0, box.findData(chosen)))
    if chosen and box.currentIndex() == 0:
        box.currentIndexChanged.emit(0)


def _day(day: date) -> QDate:
    return QDate(day.year, day.month, day.day)


def _table(model: LibraryFilter) -> QTableView:
    table = QTableView()
    table.setModel(model)
    row_by_row(table, "Runs")
    table.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
    table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
    for place, column in enumerate(COLUMNS):
        table.setColumnWidth(place, _WIDTHS[column.heading])
    table.setSortingEnabled(True)
    table.sortByColumn(0, Qt.SortOrder.DescendingOrder)
    return table


def _have_one_ladder(runs: Sequence[IndexedRun]) -> bool:
    """Whether all are of one protocol, of which there are models to judge."""
    protocols = {run.protocol for run in runs}
    return len(protocols) == 1 and protocols <= set(ladders())
