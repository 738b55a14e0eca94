"""The Fleet page: the gears of a lot on the left; on the right how their quantities lie; from a gear on to its run.

The results are read beside the window, by the same rules as the report of the lot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSignalBlocker, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QShowEvent
from PySide6.QtWidgets import QComboBox, QFileDialog, QGridLayout, QSizePolicy, QWidget

from rig.content.grid import Grid, columns
from rig.extras import require
from rig.fleet.lot import Lot, LotGear, lot_of, why_of
from rig.fleet.lot_quantity import LotQuantity
from rig.fleet.lot_words import limits_words, with_interval
from rig.fleet.questions import results_folder
from rig.window.fleet.plots import LotPlots
from rig.window.fleet.wanted import WantedGears, of_gears
from rig.window.review.grid import GridTable
from rig.window.shell.sentence import listed_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    choice_box,
    in_column,
    in_row,
    line_field,
    push_button,
    room_for,
    set_tip,
    split,
    text_label,
)
from rig.window.work.background import BackgroundCommand, LatestTask, in_words, json_object

NOTHING = "No results of many runs here yet."
_WHAT_TO_DO = (
    "Fit a folder analyses every run below it, each with its tare, and keeps the numbers as one table. "
    "Open … shows a table that is there already."
)
_MOST_LISTED = 2000
"""Gears of the list; the filter finds the others."""
WIDEST = 200
"""Pixels of a column at first: all of them fit beside the plots."""
COLUMNS = columns("gear", "bench", ("verdict", "word"), "why")
_ChooseFolder = Callable[[QWidget], str]


def _ask_for_folder(parent: QWidget) -> str:
    """The folder that somebody chooses; "" where nobody does."""
    return QFileDialog.getExistingDirectory(parent, "Folder of runs, or of results")


class FleetPage(QWidget):
    """The page. `run_chosen` carries the file of a run; tests hand in who chooses the folder."""

    run_chosen = Signal(Path)

    def __init__(
        self, session: WindowSession, *, choose_folder: _ChooseFolder = _ask_for_folder
    ) -> None:
        super().__init__()
        self._session, self._choose_folder = session, choose_folder
        self.folder = session.folder
        self.lot: Lot | None = None
        self._shown: tuple[LotGear, ...] = ()
        self._task = LatestTask(self, self._take, self._refuse)
        self.command: BackgroundCommand | None = None
        """What is at work: a fit of many runs, or a report."""
        self.open_paper = lambda path: QDesktopServices.openUrl(QUrl.fromLocalFile(str(path)))
        """Opens a file with what the desktop has for it; whether there was anything."""
        self.where = text_label("", "muted")
        self.where.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.text = line_field("Search gears", "Search gears, benches, reasons …")
        self.text.setClearButtonEnabled(True)
        self.bench = choice_box("Bench", letters=8)
        self.verdict = choice_box(
            "Verdict", ("every verdict", "FAIL", "MARGINAL", "PASS", "NOT JUDGED"), letters=8
        )
        self.quantity, self.beside = (
            choice_box(name, letters=14) for name in ("Quantity", "Over it")
        )
        self.gears = GridTable(session, "Gears", widest=WIDEST)
        self.plots = LotPlots(session)
        self.count, self.says = text_label("", "muted", wraps=True), text_label("", wraps=True)
        self.open_run = push_button(
            "Open the run", tip="The newest run of the chosen gear (Enter)", act=self._open_run
        )
        self._lay_out()
        self._connect()
        self._show_lot()

    def _lay_out(self) -> None:
        fit = push_button("&Fit a folder …", tip="Analyse every run of a folder", act=self._fit)
        choose = push_button("Open …", tip="Results in another folder", act=self._open_folder)
        again = push_button("Read again", tip="Read the results again", act=self.read)
        lot = push_button("Lot report", tip="Writes lot.html beside the results and opens it")
        gauge = push_button("Gauge report", tip="How well benches tell gears apart: gauge.html")
        lot.clicked.connect(lambda: self._write("report", "lot.html"))
        gauge.clicked.connect(lambda: self._write("rr", "gauge.html"))
        self.papers = (lot, gauge)
        self.makers = (fit, *self.papers)
        head = in_row(
            text_label("Fleet", "title"), (self.where, 1), *self.papers, fit, choose, again
        )
        filters = QGridLayout()
        filters.setSpacing(5)
        filters.addWidget(self.text, 0, 0, 1, 2)
        filters.addWidget(self.bench, 1, 0)
        filters.addWidget(self.verdict, 1, 1)
        left = in_column(
            filters,
            (self.gears, 1),
            in_row(self.open_run, (None, 1)),
            self.count,
            margins=(0, 0, 0, 0),
        )
        chosen = QGridLayout()
        chosen.setSpacing(5)
        chosen.setColumnStretch(1, 1)
        for row, (word, box) in enumerate(
            (("Distribution of", self.quantity), ("with it", self.beside))
        ):
            chosen.addWidget(text_label(word), row, 0)
            chosen.addWidget(box, row, 1)
        right = in_column(chosen, self.says, (self.plots, 1), margins=(0, 0, 0, 0))
        self.both = split((room_for(left), 1), (room_for(right), 3), sizes=[480, 800])
        words = (text_label(NOTHING, "title"), text_label(_WHAT_TO_DO, wraps=True))
        ways = in_row(
            push_button("Fit a folder …", "primary", act=self._fit),
            push_button("Open …", act=self._open_folder),
            (None, 1),
        )
        self.told = text_label("", "muted", wraps=True)
        parts = ((None, 1), *words, ways, self.told, (None, 2))
        self.empty = room_for(in_column(*parts, margins=(60, 0, 60, 0)))
        body = ((self.both, 1), (self.empty, 1))
        self.setLayout(in_column(head, *body, margins=(8, 8, 8, 6)))

    def _connect(self) -> None:
        self.text.textChanged.connect(lambda _: self._show_gears())
        for box in (self.bench, self.verdict):
            box.currentIndexChanged.connect(lambda _: self._show_gears())
        for box in (self.quantity, self.beside):
            box.currentIndexChanged.connect(lambda _: self._draw())
        self.gears.itemSelectionChanged.connect(self._select)
        self.gears.activated.connect(lambda _: self._open_run())
        self.plots.gear_clicked.connect(self.choose_gear)

    @property
    def is_reading(self) -> bool:
        """Whether results are being read."""
        return self._task.is_running

    @property
    def shown(self) -> tuple[LotGear, ...]:
        """The gears that the filter lets pass."""
        return self._shown

    @property
    def chosen(self) -> LotGear | None:
        """The gear that is chosen in the list."""
        rows = self.gears.selectionModel().selectedRows()
        return self._shown[rows[0].row()] if rows else None

    def showEvent(self, event: QShowEvent) -> None:
        """The results are read when the page is looked at first."""
        super().showEvent(event)
        if self.lot is None and not self.is_reading:
            self.read()

    def read(self) -> None:
        """Read the results of the folder, beside the window."""
        folder = self.folder
        self._say("Reading the results …")
        self._task.start(lambda: _read(folder))

    def open_folder(self, folder: Path) -> None:
        """Show the results that lie in another folder."""
        self.folder, self.lot = folder, None
        self._show_lot()
        self.read()

    def choose_gear(self, gear: str) -> None:
        """Choose a gear in the list."""
        for row, one in enumerate(self._shown[:_MOST_LISTED]):
            if one.gear == gear:
                self.gears.selectRow(row)
                self.gears.scrollTo(self.gears.model().index(row, 0))
                return

    def _open_folder(self) -> None:
        if self._session.free_for("Another folder"):
            chosen = self._choose_folder(self)
            if chosen:
                self.open_folder(Path(chosen))

    def _fit(self) -> None:
        """Analyse the runs of a folder that somebody chooses; what is done already is not done again."""
        if self.command is None and self._session.free_for("Another folder"):
            chosen = self._choose_folder(self)
            if chosen:
                self._run(
                    ["fleet", "fit", chosen, "--json"],
                    f"Fitting the runs of {chosen} …",
                    lambda told: self.open_folder(Path(str(told.get("output", chosen)))),
                )

    def _write(self, word: str, file: str) -> None:
        """Write a page of the results and open it."""
        if self.command is None and self.lot is not None and self._session.free_for("A report"):
            target = self.lot.data.folder / file
            arguments = [
                "fleet",
                word,
                str(self.lot.data.folder),
                "--output",
                str(target),
                "--json",
            ]
            self._run(arguments, f"Writing {target} …", lambda _: self._opened(target))

    def _opened(self, target: Path) -> None:
        opened = self.open_paper(target)
        self._session.message.emit(f"{'Opened' if opened else 'Written'}: {target}")
        self._count()

    def _run(
        self, arguments: list[str], meanwhile: str, then: Callable[[dict[str, Any]], None]
    ) -> None:
        """Run a command beside the window; the buttons that begin one rest until it is done."""

        def done(code: int, out: str, complaint: str) -> None:
            self.command = None
            for button in self.makers:
                button.setEnabled(True)
            told = json_object(out)
            if told is None:
                self._count()
                self._say(in_words(complaint))
            else:
                then(told)
            self._offer_papers()

        self.command = BackgroundCommand(arguments, self, done)
        for button in self.makers:
            button.setEnabled(False)
        self._say(meanwhile)
        self.command.start()

    def _offer_papers(self) -> None:
        for button in self.papers:
            button.setEnabled(self.lot is not None and self.command is None)

    def _take(self, lot: Lot | None) -> None:
        self.lot = lot
        self._show_lot()

    def _refuse(self, why: str) -> None:
        self.lot = None
        self._show_lot()
        self._say(why)

    def _show_lot(self) -> None:
        lot = self.lot
        self.both.setVisible(lot is not None)
        self.empty.setVisible(lot is None)
        self._offer_papers()
        self.where.setText(str(lot.data.folder if lot else self.folder))
        set_tip(self.where, self.where.text())
        benches = (
            {bench for gear in lot.gears for bench in gear.bench.split(", ")} if lot else set()
        )
        _offer(self.bench, ["every bench", *sorted(benches - {""})])
        quantities = _measured(lot)
        for place, box in enumerate((self.quantity, self.beside)):
            _offer_quantities(box, quantities, min(place, len(quantities) - 1))
        self._show_gears()

    def _show_gears(self) -> None:
        lot = self.lot
        wanted = WantedGears(self.text.text(), *map(_wanted_in, (self.bench, self.verdict)))
        before = self.chosen
        self._shown = wanted.of(lot) if lot else ()
        rows = [
            (one.gear, one.bench or "–", one.verdict, "; ".join(one.because or why_of(one)))
            for one in self._shown[:_MOST_LISTED]
        ]
        with QSignalBlocker(self.gears):
            self.gears.clearSelection()
            self.gears.show_grid(Grid("Gears", COLUMNS, rows))
        if before is not None:
            self.choose_gear(before.gear)
        self._count()
        self._select()
        self._draw()

    def _say(self, text: str) -> None:
        """How it stands, beside the gears and where there are none yet."""
        self.count.setText(text)
        self.told.setText(text)

    def _count(self) -> None:
        lot = self.lot
        if lot is None:
            self._say("")
            return
        every, shown = len(lot.gears), len(self._shown)
        text = listed_of(shown, every, "gears")
        text += ": " + ", ".join(f"{count} {word}" for word, count in lot.verdicts.items() if count)
        if shown > _MOST_LISTED:
            text += f" · the first {_MOST_LISTED} are listed"
        self._say(" · ".join((text, *lot.notes)))

    def _select(self) -> None:
        gear = self.chosen
        self.open_run.setEnabled(gear is not None and bool(gear.run_files))
        self.plots.choose(gear.gear if gear else "")

    def _quantity(self, box: QComboBox) -> LotQuantity | None:
        quantities = _measured(self.lot)
        place = box.currentIndex()
        return quantities[place] if 0 <= place < len(quantities) else None

    def _draw(self) -> None:
        x, y = self._quantity(self.quantity), self._quantity(self.beside)
        if self.lot is None or x is None or y is None:
            self.says.setText("")
            self.plots.clear()
            return
        gears = {gear.gear for gear in self._shown}
        self.says.setText(_said_of(x))
        self.plots.show_quantities(of_gears(x, gears), of_gears(y, gears), self.lot.data.origin)

    def _open_run(self) -> None:
        """The run of the chosen gear by which the quantity in view was found, or its first one."""
        gear, x = self.chosen, self._quantity(self.quantity)
        if gear is None or not gear.run_files:
            return
        of_x = [row.run_file for row in x.rows if row.gear == gear.gear] if x else []
        path = Path((of_x or list(gear.run_files))[0])
        if path.is_file():
            self.run_chosen.emit(path)
        else:
            self._session.message.emit(f"The run is not at this computer: {path}")


def _read(folder: Path) -> Lot | None:
    """The lot in a folder; None where there are no results. Raises `RigError` where they cannot be read."""
    from rig.errors import ConfigurationError

    require("a lot", "fleet", "pyarrow", "duckdb")
    try:
        found = results_folder(folder)
    except ConfigurationError:
        return None
    return lot_of(found)


def _measured(lot: Lot | None) -> list[LotQuantity]:
    """The quantities of a lot that were measured; none without a lot."""
    return [one for one in lot.quantities if one.measured] if lot else []


def _wanted_in(box: QComboBox) -> str:
    """What is chosen in a box; "" for its first entry, which is every one."""
    return box.currentText() if box.currentIndex() > 0 else ""


def _said_of(one: LotQuantity) -> str:
    """Limit and capability of a quantity, of the whole lot."""
    _, unit = one.shown_in
    limit = f"Limit {limits_words(one)} {unit}".rstrip() if limits_words(one) else "No limit"
    found = one.capability
    if isinstance(found, str):
        return f"{limit}. No capability: {found}."
    index = with_interval(found.actual, found.actual_interval)
    return f"{limit}. Of the whole lot: Cpk {index} (95 %), {found.gears} gears."


def _offer(box: QComboBox, words: Sequence[str]) -> None:
    """Other words to choose from; a choice that is still there stays."""
    chosen = box.currentText()
    with QSignalBlocker(box):
        box.clear()
        box.addItems(list(words))
        box.setCurrentIndex(max(0, box.findText(chosen)))


def _offer_quantities(box: QComboBox, quantities: Sequence[LotQuantity], otherwise: int) -> None:
    """Other quantities to choose from; the protocol stands beside the title where several have that."""
    plain = [one.title for one in quantities]
    titles = [
        one.title if plain.count(one.title) == 1 else f"{one.title} ({one.kind})"
        for one in quantities
    ]
    chosen = box.currentText()
    with QSignalBlocker(box):
        box.clear()
        box.addItems(titles)
        box.setCurrentIndex(titles.index(chosen) if chosen in titles else otherwise)
