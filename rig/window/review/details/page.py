"""One run in the review: its head, and pages of results, figures, signals, events, conditions and files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QTimer, QUrl, Signal
from PySide6.QtWidgets import QStackedLayout, QTabWidget, QTextBrowser, QWidget

from experiments import catalogue
from experiments.recording import Recording
from experiments.result import Result
from model.errors import WordedError
from model.gear import HarmonicDrive
from rig.analysis.in_force import in_force
from rig.analysis.judging import GearVerdict, judge_run, not_judged, stored_result
from rig.analysis.store import Analysis, read_analyses
from rig.analysis.tare import takes_tare
from rig.errors import RigError
from rig.gears.acceptance import Part, acceptance_for
from rig.library.index import IndexedRun
from rig.runfile.header import ORIGIN_WORDS
from rig.runfile.read import follow, open_run
from rig.window.plot.result_plot import PlotGallery
from rig.window.review.details.comparison import ComparisonView
from rig.window.review.details.events import RunEventsView
from rig.window.review.details.facts import Facts, facts_of
from rig.window.review.details.files import RunFilesView
from rig.window.review.details.header import RunHeaderView
from rig.window.review.details.parameters import ParameterDesk
from rig.window.review.fit import (
    FitDesk,
    FitOrder,
    ResultCache,
    order_of,
    renewal_of,
    tares_among,
)
from rig.window.review.library_table import HTML, PDF
from rig.window.review.results import ChooseFile, FitBar, ResultsView
from rig.window.review.signals.view import SignalsView
from rig.window.review.words import plot_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, text_label
from rig.window.work.background import LatestTask
from rig.window.work.recovery import Recovery
from rig.window.work.verdicts import read_run

GROWING_MS = 1000
"""ms between two looks at a run that is being written."""
PAGES = ("Results", "Figures", "Signals", "Events && notes", "Conditions && calibration", "Files")


class RunDetails(QWidget):
    """The details of one run. `show_run` opens a file; a file that cannot be read says why in its place."""

    report_requested = Signal(object, str)
    """Carries the list of the one path, and the suffix of the report."""

    def __init__(
        self,
        session: WindowSession,
        cache: ResultCache,
        opener: Callable[[QUrl], object],
        choose_file: ChooseFile | None = None,
    ) -> None:
        super().__init__()
        self._session = session
        self.path: Path | None = None
        self.recording: Recording | None = None
        self._state = "sealed"
        self._library: tuple[IndexedRun, ...] = ()
        self._analyses: tuple[Analysis, ...] = ()
        self._wanted: FitOrder | None = None
        self._facts: Facts | None = None
        self._points_of = ""
        self._recovery = Recovery(self)
        self.header = RunHeaderView(session)
        self.desk = FitDesk(cache, self)
        self.bar = FitBar(session, choose_file)
        self.parameters = ParameterDesk(self.bar, lambda: self._gear, self)
        self.results = ResultsView(session, self.bar)
        self.gallery = PlotGallery(session)
        self.signals = SignalsView(session)
        self.events = RunEventsView(session)
        self.conditions = QTextBrowser()
        self.files = RunFilesView(session, opener)
        self.comparison = ComparisonView(session)
        self.problem = text_label(wraps=True)
        self._reader = LatestTask(self, self._take_facts, self.conditions.setPlainText)
        self._judging = LatestTask(self, self.header.show_verdict)
        self._growing = QTimer(self)
        self._growing.setInterval(GROWING_MS)
        self._lay_out()
        self._connect()

    def _lay_out(self) -> None:
        self.tabs = QTabWidget()
        self.figures = QWidget()
        self._figure_stack = QStackedLayout(self.figures)
        self.figure_hint = text_label("", "muted", wraps=True)
        self.figure_hint.setMargin(24)
        self._figure_stack.addWidget(self.figure_hint)
        self._figure_stack.addWidget(self.gallery)
        pages = (self.results, self.figures, self.signals, self.events, self.conditions, self.files)
        for name, page in zip(PAGES, pages, strict=True):
            self.tabs.addTab(page, name)
        self.problem.setMargin(24)
        self.setLayout(
            in_column(
                self.header, (self.problem, 1), (self.tabs, 1), margins=(4, 8, 8, 4), spacing=6
            )
        )
        self.problem.hide()

    def _connect(self) -> None:
        self.header.report.clicked.connect(lambda: self.report_requested.emit([self.path], HTML))
        self.header.pdf.clicked.connect(lambda: self.report_requested.emit([self.path], PDF))
        self.header.recover.clicked.connect(self.recover)
        self._recovery.recovered.connect(self._take_recovered)
        self._recovery.refused.connect(self._take_not_recovered)
        self.bar.renew_requested.connect(self.fit)
        self.results.points_requested.connect(self._show_points)
        self.tabs.currentChanged.connect(lambda _: self._fill_page())
        self.bar.fit_requested.connect(self.fit)
        self.bar.compare_requested.connect(self.parameters.compare)
        self.bar.save_requested.connect(self.parameters.save)
        self.parameters.compared.connect(self._show_comparison)
        self.bar.cancelled.connect(self.cancel)
        self.desk.fitted.connect(self._take_result)
        self.desk.refused.connect(self._take_refusal)
        self.events.moment_chosen.connect(self._jump)
        self.files.analysis_chosen.connect(self._show_analysis)
        self._growing.timeout.connect(self.refresh)
        self._session.theme_changed.connect(lambda _: self._write_conditions())

    @property
    def is_busy(self) -> bool:
        """Whether a fit or a comparison is at work."""
        return self.desk.is_running or self.parameters.is_running

    def set_library(self, runs: Sequence[IndexedRun]) -> None:
        """The runs of the folder: where tares come from."""
        self._library = tuple(runs)

    def show_run(self, path: Path, state: str = "sealed") -> None:
        """Open a run. `state` as the library knows it."""
        if path == self.path and state == self._state and self.recording is not None:
            return
        self.cancel()
        self._reader.forget()
        self._facts = None
        self.path, self._state = path, state
        try:
            self.recording = open_run(path, rows=False)
        except RigError as error:
            self._show_problem(path, str(error))
            return
        self.problem.hide()
        self.tabs.show()
        self.header.show_recording(self.recording, path, state)
        self.header.show_verdict(None)
        self.signals.clear()
        self._read_analyses()
        self._show_newest()
        self._forget_comparison()
        self._growing.stop()
        if state == "being written":
            self._growing.start()
        self._fill_page()

    def refresh(self) -> None:
        """Look at a growing run again; one that was sealed meanwhile is opened under its new name."""
        if self.path is None or self.recording is None or self._state != "being written":
            return
        final = self.path.with_name(self.path.name.removesuffix(".part"))
        if not self.path.exists():
            if final.exists():
                self.show_run(final)
            else:
                self._growing.stop()
            return
        self.recording = follow(self.recording)
        self.header.show_recording(self.recording, self.path, self._state)
        if self.tabs.currentWidget() in (self.signals, self.events):
            self._fill_page()

    def fit(self, order: FitOrder) -> None:
        """Fit in a process of its own."""
        self._wanted = order
        self.bar.set_busy(True, f"Fitting {order.run.name} …")
        self.desk.ask(order)

    def recover(self) -> None:
        """Make a run file of what was left behind, in a process of its own, and open it."""
        if self.path is not None:
            self.header.recover.setEnabled(False)
            self._recovery.start(self.path)

    def _take_recovered(self, path: Path, final: Path) -> None:
        self.header.recover.setEnabled(True)
        self._session.message.emit(f"Recovered: {final}")
        self._session.runs_changed.emit()
        if self.path == path:
            self.show_run(final)

    def _take_not_recovered(self, path: Path, why: str) -> None:
        self.header.recover.setEnabled(True)
        self._session.message.emit(f"Not recovered: {path.name}: {why}")

    def cancel(self) -> None:
        """Give up what is at work."""
        busy = self.is_busy
        self.desk.cancel()
        self.parameters.cancel()
        self._wanted = None
        self.bar.set_busy(False)
        if busy:
            self.bar.say("Given up.")
            self.figure_hint.setText("Given up. Choose this page again to work the figures out.")

    def _show_problem(self, path: Path, problem: str) -> None:
        self.recording = None
        self._growing.stop()
        self.header.show_problem(path, self._state)
        self.tabs.hide()
        self.problem.setText(f"This file cannot be read.\n\n{problem}")
        self.problem.show()

    def _read_analyses(self) -> None:
        assert self.path is not None
        assert self.recording is not None
        problem = ""
        try:
            self._analyses = read_analyses(self.path)
        except RigError as error:
            self._analyses, problem = (), str(error)
        self.files.show_run(self.path, self.recording.metadata.seal, self._analyses, problem)
        self._judge()

    def _judge(self) -> None:
        """The verdict on the run as the library tells it, worked out beside the window."""
        assert self.path is not None
        path = self.path
        if self._state == "sealed":
            self._judging.start(lambda: read_run(path).verdict)

    @property
    def _gear(self) -> HarmonicDrive | None:
        return self.recording.metadata.gear if self.recording is not None else None

    def _show_newest(self) -> None:
        """The analysis in force, and the fit bar set as it was made."""
        assert self.path is not None
        assert self.recording is not None
        metadata = self.recording.metadata
        newest = self._in_force()
        used = order_of(newest, self.path, self._sealed_runs()) if newest else None
        tares = [r for r in tares_among(self._library, metadata.origin) if r.path != self.path]
        self.bar.show_run(self.path, metadata.experiment, tares, used)
        self.bar.setEnabled(self._state != "being written")
        self._set_figures((), self._why_no_figures())
        if newest is not None:
            self._show_analysis(newest, front=False)
        elif self._state == "being written":
            self.results.show_nothing(
                "The run is being written. Its results can be fitted once it is sealed."
            )
        else:
            self.results.show_nothing("Nothing has been identified from this run yet. Press Fit.")

    def _in_force(self) -> Analysis | None:
        """The analysis that everybody reads of this run."""
        assert self.path is not None
        return in_force(self.path).analysis if self._analyses else None

    def _sealed_runs(self) -> Mapping[str, Path]:
        return {run.run_id: run.path for run in self._library if run.state == "sealed"}

    def _show_analysis(self, analysis: Analysis, *, front: bool = True) -> None:
        try:
            result = analysis.result
        except RigError as error:
            self.results.show_nothing(f"Analysis {analysis.number} cannot be read: {error}.")
            return
        self.results.show_result(result, self._gear, self._verdict_on(analysis))
        heading = f"Analysis {analysis.number}, {analysis.content.get('created', '')[:16].replace('T', ' ')}"
        tare = str(analysis.content.get("tare", {}).get("run", ""))
        said = f"{heading}, {analysis.kind}{self._tare_words(tare, analysis.kind)}."
        assert self.path is not None
        found = in_force(self.path, analysis.kind)
        stale = found.stale if found.number == analysis.number else ()
        self.bar.offer_renewal(renewal_of(self.path, found) if stale else None)
        if stale:
            self.bar.say(f"{said} Stale: {'; '.join(stale)}. ", "warning")
        else:
            self.bar.say(said)
        if front:
            self.tabs.setCurrentWidget(self.results)

    def _verdict_on(self, analysis: Analysis) -> GearVerdict:
        """What this analysis is worth by the acceptance file of the gear, as it is now."""
        assert self.path is not None
        assert self.recording is not None
        m = self.recording.metadata
        try:
            acceptance = acceptance_for(self.path.parent, m.gear_serial)
        except WordedError as error:
            return not_judged(f"the acceptance file cannot be read: {error}")
        found = in_force(self.path, analysis.kind)
        stored = stored_result(
            found,
            m.origin,
            m.outcome,
            m.gear_serial,
            part=Part.of(m),
            other=analysis,
            path=self.path,
        )
        return judge_run(stored, acceptance)

    def _tare_words(self, tare: str, kind: str) -> str:
        """Which tare an analysis was made with; nothing for a kind that has none."""
        if not takes_tare(kind):
            return ""
        if tare:
            return f", less the motor by {tare}"
        ready = self.bar.tare.currentData()
        return ", of motor and gear together: no tare" + (
            ". Fit subtracts the tare that is chosen" if ready else ""
        )

    def _fill_page(self) -> None:
        """What the page in front shows is read when it is looked at."""
        if self.recording is None or self.path is None:
            return
        page, recording = self.tabs.currentWidget(), self.recording
        if page is self.figures and not self.gallery.plots:
            self._ask_figures()
        elif page is self.signals:
            self.signals.show_recording(recording, self._mark)
        elif page is self.events:
            self.events.show_recording(recording)
        elif page is self.conditions and self._facts is None:
            self.conditions.setPlainText("Reading …")
            self._reader.start(lambda: facts_of(recording))

    @property
    def _mark(self) -> str:
        return ORIGIN_WORDS[self.recording.metadata.origin] if self.recording is not None else ""

    def _why_no_figures(self) -> str:
        assert self.recording is not None
        if self._state == "being written":
            return (
                "The run is being written. Its figures can be worked out once it is "
                "sealed; its signals are on the next page."
            )
        if not self._analyses and self.recording.metadata.experiment not in catalogue.kinds():
            return (
                "This recording was not made by a protocol of this program. Choose the "
                "kind of fit on the page Results."
            )
        return ""

    def _ask_figures(self) -> None:
        """The figures of the analysis in force, worked out again without leaving a trace."""
        assert self.path is not None
        why = self._why_no_figures()
        if why or self.desk.is_running:
            self.figure_hint.setText(why or self.figure_hint.text())
            return
        newest = self._in_force()
        if newest:
            order = order_of(newest, self.path, self._sealed_runs())
        else:
            order = self.bar.order(keep=False)
        self._set_figures((), "Working out the figures …")
        self.fit(order)

    def _set_figures(self, plots: Sequence[object], hint: str = "") -> None:
        self.gallery.show_plots(plots, self._mark, keep=True)  # type: ignore[arg-type]
        self.figure_hint.setText(hint)
        self._figure_stack.setCurrentWidget(self.gallery if plots else self.figure_hint)
        self._choose_points()

    def _take_result(self, order: FitOrder, result: Result) -> None:
        if order != self._wanted:
            return
        self.bar.set_busy(False)
        tare = order.tare.name.removesuffix(".h5") if order.tare else ""
        self.bar.say(
            f"Fitted as {result.kind}{self._tare_words(tare, result.kind)}." if order.keep else ""
        )
        self._set_figures(result.plots, "" if result.plots else "This fit has no figures.")
        if order.keep:
            self.bar.offer_renewal(None)
            self._read_analyses()
            self._session.runs_changed.emit()
        self._show_fitted(order, result)

    def _show_fitted(self, order: FitOrder, result: Result) -> None:
        """The numbers of a fit with the verdict on them; figures alone of one that only draws what is in force."""
        kept = [analysis for analysis in self._analyses if analysis.kind == result.kind]
        if not kept:
            self.results.show_result(result, self._gear, not_judged("the fit was not kept"))
        elif order.keep:
            self.results.show_result(result, self._gear, self._verdict_on(kept[-1]))

    def _take_refusal(self, order: FitOrder, complaint: str) -> None:
        if order != self._wanted:
            return
        self.bar.set_busy(False)
        self.bar.say(complaint, "bad")
        self._set_figures((), complaint)

    def _show_comparison(self, content: Mapping[str, Any], parameters: Path) -> None:
        self.comparison.show_comparison(content, parameters)
        if self.tabs.indexOf(self.comparison) < 0:
            self.tabs.insertTab(1, self.comparison, "Comparison")
        self.tabs.setCurrentWidget(self.comparison)

    def _forget_comparison(self) -> None:
        place = self.tabs.indexOf(self.comparison)
        if place >= 0:
            self.tabs.removeTab(place)

    def _show_points(self, number: str) -> None:
        """The figure that shows the points of a number, as soon as figures are there."""
        self._points_of = number
        self.tabs.setCurrentWidget(self.figures)
        self._choose_points()

    def _choose_points(self) -> None:
        if self._points_of and self.gallery.plots:
            self.gallery.choose(plot_of(self.gallery.plots, self._points_of))
            self._points_of = ""

    def _jump(self, moment: float) -> None:
        self.tabs.setCurrentWidget(self.signals)
        self.signals.jump(moment)

    def _take_facts(self, facts: Facts) -> None:
        self._facts = facts
        self._write_conditions()

    def _write_conditions(self) -> None:
        if self._facts is not None:
            self.conditions.setHtml(self._facts.page(self._session.palette))
