"""A gear's passport in the window: its control charts and spectra, what each chart says, its runs,
and what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QProgressBar,
    QTabWidget,
    QWidget,
)

from model.errors import WordedError
from rig.analysis.fit.recorded import TARE_DECLINED
from rig.analysis.in_force import InForce, in_force
from rig.analysis.judging import GearVerdict, not_judged
from rig.analysis.passport.followed import watched_kinds
from rig.analysis.passport.rows import missing_grid, series_grid
from rig.analysis.tare import find_tare, takes_tare
from rig.content.grid import Grid, columns
from rig.content.phrase import phrase
from rig.gears.acceptance import acceptance_for
from rig.library.index import IndexedRun, LibraryIndex
from rig.present.certificate.gather import certified
from rig.runfile.read import close_recording, open_run
from rig.window.plot.result_plot import PlotGallery
from rig.window.review.fit import FitDesk, FitOrder, renewal_of
from rig.window.review.grid import GridTable
from rig.window.review.table_model import local_time, outcome_of, with_sign
from rig.window.shell.sentence import first_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    restyled,
    set_tip,
    text_label,
)
from rig.window.work.background import LatestTask
from rig.window.work.verdicts import COLOURS as VERDICT_COLOURS
from rig.window.work.verdicts import SIGNS, ListedVerdict, listed_verdict, verdict_text

if TYPE_CHECKING:
    from rig.analysis.passport.content import Passport

_RUN_COLUMNS = columns(
    ("#", "number"), "started", "protocol", "outcome", "verdict", "operator", "file"
)


class PassportView(QWidget):
    """The passport of one gear. `show_gear` reads it beside the window; `run_chosen` carries a run that was opened."""

    run_chosen = Signal(Path)
    report_requested = Signal(str, str)
    """Carries the serial number and the suffix of the report."""
    run_requested = Signal(str, str)
    """Carries the serial number and the protocol of a run that the gear lacks."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._serial = ""
        self._library: tuple[IndexedRun, ...] = ()
        self._refusals: list[str] = []
        self.desk = FitDesk(parent=self)
        self.passport: Passport | None = None
        self.title, self.mark = text_label("Passport", "title"), text_label("", "mark")
        self.verdict = text_label()
        self.because = text_label("", "muted", wraps=True, selectable=True)
        self.because.hide()
        self.says = text_label("", "muted", wraps=True)
        self.analyse = push_button(
            "Fit what is &missing",
            tip="Fit every run of this gear that has no analysis yet, or a stale one, each with the tare "
            "that belongs to it; kept beside its run",
            act=self._fit_missing,
        )
        self._lacking: tuple[str, ...] = ()
        self.prepare = push_button("&Prepare a run", "primary", act=self._prepare)
        self.prepare.hide()
        self.report = push_button(
            "Gear r&eport",
            tip="The report of this gear over all its runs, as a web page (HTML), and open it",
            act=lambda: self.report_requested.emit(self._serial, ".html"),
        )
        self.pdf = push_button(
            "PDF",
            tip="The report of this gear over all its runs, for paper (PDF), and open it",
            act=lambda: self.report_requested.emit(self._serial, ".pdf"),
        )
        self.charts = PlotGallery(session)
        self.state = GridTable(session, "What the charts say")
        self.runs = GridTable(session, "Runs of the gear")
        self.missing = GridTable(session, "What is missing")
        self.runs.activated.connect(lambda index: self._open_run(index.row()))
        self.busy, self.cancel = QProgressBar(), push_button("Cancel", act=self.desk.cancel)
        self.busy.setFormat("fitted %v of %m")
        self.busy.setFixedWidth(150)
        self.desk.progressed.connect(self._progress)
        self.desk.refused.connect(
            lambda order, why: self._refusals.append(f"{order.run.name}: {why}")
        )
        self._reading = LatestTask(self, self._take, self.says.setText)
        self._ordering = LatestTask(self, self._take_orders, self.says.setText)
        self._lay_out()
        self._show_busy(False)

    def _lay_out(self) -> None:
        ways = (self.busy, self.cancel, self.prepare, self.analyse, self.report, self.pdf)
        head = in_row((self.title, 1), self.mark, self.verdict, spacing=14)
        self.tabs = QTabWidget()
        for page, name in (
            (self.charts, "Charts"),
            (self.state, "What they say"),
            (self.runs, "Runs"),
            (self.missing, "Missing"),
        ):
            self.tabs.addTab(page, name)
        self.setLayout(
            in_column(
                head,
                self.because,
                self.says,
                in_row((None, 1), *ways),
                (self.tabs, 1),
                margins=(8, 8, 8, 4),
            )
        )

    @property
    def is_busy(self) -> bool:
        """Whether it is still being read, or runs are being fitted."""
        return self._reading.is_running or self._ordering.is_running or self.desk.is_running

    def show_gear(self, serial: str, library: Sequence[IndexedRun] = ()) -> None:
        """The passport of a gear by its serial number; `library` are the runs of the folder."""
        self.desk.cancel()
        self._serial, self._library, self._refusals = serial, tuple(library), []
        self._read()

    def _read(self) -> None:
        serial, self.passport = self._serial, None
        self.title.setText(f"Passport of {serial}")
        self.mark.clear()
        self.verdict.clear()
        self.because.hide()
        self.charts.show_plots((), "")
        self.says.setText("Reading the analyses of its runs …")
        self._reading.start(_reader(self._session.folder, serial))

    def _fit_missing(self) -> None:
        """Fit what has no analysis yet, each run in a process of its own, and read the passport again."""
        library, serial = self._library, self._serial
        self.analyse.setDisabled(True)
        self._ordering.start(lambda: missing_fits(library, serial))

    def _take_orders(self, orders: list[FitOrder]) -> None:
        self.analyse.setEnabled(True)
        if not orders:
            self.says.setText("Every run of this gear that can be fitted has been.")
            return
        self._refusals = []
        self._show_busy(True)
        self.desk.ask(*orders)

    def allow_report(self, allowed: bool) -> None:
        """Whether a report can be asked for: not while one is being written."""
        for button in (self.report, self.pdf):
            button.setEnabled(allowed)

    def _show_busy(self, busy: bool) -> None:
        self.busy.setVisible(busy)
        self.cancel.setVisible(busy)
        self.analyse.setDisabled(busy)

    def _progress(self, done: int, asked: int) -> None:
        self.busy.setRange(0, max(asked, 1))
        self.busy.setValue(done)
        if done == asked:
            self._show_busy(False)
            if asked:
                self._read()
                self._session.runs_changed.emit()

    def _take(self, read: _ReadGear) -> None:
        passport, self.passport = read.passport, read.passport
        self.verdict.setText(f"{SIGNS[read.judged.verdict]} {read.judged.verdict}")
        restyled(self.verdict, VERDICT_COLOURS[read.judged.verdict])
        reasons = read.judged.because
        self.because.setText(first_of(reasons))
        set_tip(self.because, "\n".join(reasons))
        self.because.setVisible(bool(reasons))
        self.title.setText(f"Passport of {passport.serial}" + phrase(" · {}", passport.gear))
        self.mark.setText(passport.mark)
        self.charts.show_plots(passport.plots, passport.mark, keep=True)
        self.state.show_grid(series_grid(passport.series))
        rows = [
            (
                str(run.number),
                local_time(run.start),
                run.protocol,
                with_sign(outcome_of(run)),
                read.words(run),
                run.operator,
                run.path.name,
            )
            for run in passport.runs
        ]
        self.runs.show_grid(Grid("Runs of the gear", _RUN_COLUMNS, rows))
        gaps = missing_grid((*passport.missing, *passport.left_out))
        self.missing.show_grid(gaps)
        self.tabs.setTabText(3, f"Missing ({len(gaps.rows)})" if gaps.rows else "Nothing missing")
        self.says.setText("\n".join((summary(passport), *self._refusals)))
        self._show_lacking()

    def _show_lacking(self) -> None:
        """The way to the next run that the gear's acceptance asks for and that nobody has made."""
        self._lacking = lacking_runs(self._session.folder, self._serial, self._library)
        self.prepare.setVisible(bool(self._lacking))
        if self._lacking:
            self.prepare.setText(f"&Prepare {self._lacking[0]}")
            set_tip(
                self.prepare,
                f"The acceptance of this gear asks for runs that it lacks: {', '.join(self._lacking)}",
            )

    def _prepare(self) -> None:
        if self._lacking:
            self.run_requested.emit(self._serial, self._lacking[0])

    def _open_run(self, row: int) -> None:
        if self.passport is not None:
            self.run_chosen.emit(self.passport.runs[row].path)


@dataclass(frozen=True)
class _ReadGear:
    """A gear as its page shows it: the passport, the verdict on the gear, and that on each of its runs."""

    passport: Passport
    judged: GearVerdict
    listed: Mapping[Path, ListedVerdict | None]

    def words(self, run: IndexedRun) -> str:
        """The verdict on a run in a word or two."""
        return verdict_text(self.listed.get(run.path))


def _reader(folder: Path, serial: str) -> Callable[[], _ReadGear]:
    def read() -> _ReadGear:
        from rig.analysis.passport.build import passport

        made = passport(folder, serial)
        listed = {run.path: listed_verdict(run) for run in made.runs}
        return _ReadGear(made, _gear_verdict(folder, serial), listed)

    return read


def _gear_verdict(folder: Path, serial: str) -> GearVerdict:
    """The verdict on a gear as its certificate has it; NOT JUDGED, and why, where none could be written."""
    try:
        with certified(folder, serial) as gathered:
            return gathered.verdict
    except WordedError as error:
        return not_judged(str(error))


def lacking_runs(folder: Path, serial: str, library: Sequence[IndexedRun]) -> tuple[str, ...]:
    """The protocols that the gear's acceptance file has limits for, and of which it has no completed run.

    Nothing for a gear without an acceptance file, or with one that cannot be read: its verdict says so.
    """
    try:
        acceptance = acceptance_for(folder, serial)
    except WordedError:
        return ()
    if acceptance is None:
        return ()
    made = {
        run.protocol
        for run in library
        if run.gear_serial == serial and run.is_complete and run.outcome == "COMPLETED"
    }
    kinds = dict.fromkeys(limit.kind for limit in acceptance.limits)
    return tuple(kind for kind in kinds if kind not in made)


def missing_fits(library: Sequence[IndexedRun], serial: str) -> list[FitOrder]:
    """The analyses that the passport of a gear waits for: where there is none, where one is stale, and where one is
    of motor and gear together though there is a tare by now. Which tare belongs to a run the analysis finds itself.
    """
    kinds = watched_kinds()
    orders = []
    for run in library:
        if run.gear_serial != serial or not run.is_complete or run.protocol not in kinds:
            continue
        try:
            found = in_force(run.path, run.protocol)
            order = _order_for(run, found)
        except WordedError:
            continue
        if order is not None:
            orders.append(order)
    return orders


def _order_for(run: IndexedRun, found: InForce) -> FitOrder | None:
    """The fit that a run waits for; None where its analysis stands, or was made by hand as nobody can repeat it."""
    anew = FitOrder(run.path, keep=True)
    if found.analysis is None or not found.of_this_run:
        return anew
    if found.stale:
        return renewal_of(run.path, found)
    lacks_tare = takes_tare(run.protocol) and not found.analysis.tare
    if not lacks_tare or found.analysis.content.get("no_tare") == [TARE_DECLINED]:
        return None
    recording = open_run(run.path, rows=False)
    try:
        return anew if find_tare(recording, LibraryIndex(run.path.parent)).path else None
    finally:
        close_recording(recording)


def summary(passport: Passport) -> str:
    """The passport in a sentence."""
    count = f"{len(passport.runs)} runs, {len(passport.series)} charts"
    if not passport.series:
        return f"{count}. Nothing has been fitted yet: fit what is missing."
    changed = "; ".join(f"{one.sentence}. {one.decides}" for one in passport.alarms)
    return f"{count}. {changed or 'No change seen.'}"
