"""How the run ended: verdict, what was found with its unit, what to do next, and the ways on to review and report.

What was found stands beside the run: `rig run` analyses what it has sealed, and here that is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QUrl, Signal
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QApplication,
    QFrame,
    QLineEdit,
)

from experiments.quantity import key_names
from experiments.result import Result
from rig.analysis.tare import takes_tare
from rig.bench.identity import option_of
from rig.content.phrase import phrase
from rig.content.wording import show
from rig.run.state import RunState, State
from rig.run.trips import rule_of
from rig.runfile.layout import PART_SUFFIX
from rig.window.run.campaign_end import reasons_of, remarks_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, in_row, push_button, text_label
from rig.window.work.background import BackgroundCommand, LatestTask
from rig.window.work.recovery import Recovery
from rig.window.work.verdicts import ReadRun, read_run

READING = "Reading the results …"
MOST_LINES = 6
"""Results that are named here; all of them stand in review and report."""
_OBSERVERS = {
    "statusword": "the drive",
    "input_angle": "the input encoder",
    "output_angle": "the output encoder",
}
"""What each observer of the standstill is called in words."""


class OutcomeView(QFrame):
    """Hidden until a run has ended."""

    review_requested = Signal(Path)
    judged = Signal(str)
    """What the gear is worth by the analysis of the run that is shown."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.setProperty("part", "card")
        self.headline = text_label("", "title", wraps=True, selectable=True)
        self.text = text_label(wraps=True, selectable=True)
        self.results = text_label(wraps=True, selectable=True)
        self.review = push_button("Review this run", "primary", act=self._ask_review)
        self.report = push_button(
            "Open report",
            tip="Writes the report of this run and opens it in the browser",
            act=self._make_report,
        )
        self.certificate = push_button(
            "Open certificate", "primary", tip="The certificate of the campaign, in the browser"
        )
        self.certificate_pdf = push_button("Certificate as PDF", tip="The same for paper")
        self.certificate.clicked.connect(lambda: self._open_certificate(".html"))
        self.certificate_pdf.clicked.connect(lambda: self._open_certificate(".pdf"))
        self.recover = push_button(
            "&Recover this run",
            "primary",
            tip="Make a run file of the rows that the acquisition left behind, and seal it",
            act=self._recover,
        )
        self.recover.hide()
        words = in_column(self.headline, self.text, self.results, (None, 1))
        papers = (self.certificate, self.certificate_pdf)
        ways = in_column(*papers, self.recover, self.review, self.report, (None, 1))
        self.setLayout(in_row((words, 1), ways, margins=(14, 8, 14, 8)))
        self._path: Path | None = None
        self._certificates: list[Path] = []
        self._work: list[BackgroundCommand] = []
        self._reading = LatestTask(self, self._show_read, self.results.setText)
        self._analysis_error = ""
        self._recovery = Recovery(self)
        self._recovery.recovered.connect(self._take_recovered)
        self._recovery.refused.connect(self._take_not_recovered)
        self.open_report = True
        """Whether a report that was written is opened in the browser."""
        self.hide()

    def clear(self) -> None:
        """A new run begins."""
        for command in self._work:
            command.cancel()
        self._work.clear()
        self._reading.forget()
        self._path = None
        self._offer_certificates(())
        self.hide()

    def show_end(self, state: RunState, report: dict[str, Any], path: Path | None) -> None:
        """The end of a run. `path` is its sealed file, None where there is none."""
        self._path = path
        self.review.setText("Review this run")
        self.headline.setText(_headline_of(state, report))
        session = self._session
        bench = option_of(session.backend, session.folder, session.configuration)
        self.text.setText(sentence_of(state, report, bench))
        self.text.setVisible(bool(self.text.text()))
        self.review.setEnabled(path is not None)
        self.report.setEnabled(path is not None and not str(path).endswith(PART_SUFFIX))
        self._offer_recovery(state)
        self.results.hide()
        self.show()
        # The way on, under Enter; what somebody is writing is not taken out of their hands.
        if self.review.isEnabled() and not isinstance(QApplication.focusWidget(), QLineEdit):
            self.review.setFocus()
        if path is not None and state.outcome == "COMPLETED":
            self._analysis_error = str(report.get("analysis_error", ""))
            self.results.setText(READING)
            self.results.show()
            self._reading.start(lambda: read_run(path))

    def show_campaign(
        self, state: RunState, report: dict[str, Any], run: dict[str, Any], path: Path | None
    ) -> None:
        """A campaign that was stopped, or a commissioning; `run` is how its latest run ended, `path` the file of it."""
        self._path = path
        self.review.setText("Review the last run")
        self.headline.setText(
            _campaign_headline(state, report) if report else _headline_of(state, run)
        )
        session = self._session
        bench = option_of(session.backend, session.folder, session.configuration)
        # Of a completed campaign the verdict is told below; of a stopped one what stopped it comes first.
        self.text.setText("" if report.get("complete") else sentence_of(state, run, bench))
        self.text.setVisible(bool(self.text.text()))
        self.results.setText("\n".join(campaign_lines(report)))
        self.results.setVisible(bool(report))
        self.review.setEnabled(path is not None)
        self._offer_recovery(state)
        self._offer_certificates(report.get("certificate", ()))
        self.show()

    def _offer_recovery(self, state: RunState) -> None:
        """Where the acquisition died its file waits to be made a run of."""
        left = state.state is State.LOST and self._path is not None and self._path.exists()
        self.recover.setVisible(left and str(self._path).endswith(PART_SUFFIX))

    def _recover(self) -> None:
        if self._path is not None:
            self.recover.setEnabled(False)
            self._recovery.start(self._path)

    def _take_recovered(self, path: Path, final: Path) -> None:
        self.recover.setEnabled(True)
        self._session.message.emit(f"Recovered: {final}")
        self._session.runs_changed.emit()
        if self._path == path:
            self._path = final
            self.recover.hide()
            self.report.setEnabled(True)

    def _take_not_recovered(self, path: Path, why: str) -> None:
        self.recover.setEnabled(True)
        self._session.message.emit(f"Not recovered: {path.name}: {why}")

    def _offer_certificates(self, paths: Sequence[str]) -> None:
        self._certificates = [Path(path) for path in paths]
        self.report.setVisible(not paths)
        suffixes = {path.suffix for path in self._certificates}
        self.certificate.setVisible(".html" in suffixes)
        self.certificate_pdf.setVisible(".pdf" in suffixes)

    def _open_certificate(self, suffix: str) -> None:
        for path in self._certificates:
            if path.suffix == suffix:
                self._session.message.emit(f"Certificate: {path}")
                if self.open_report:
                    self._open(path)

    def _run(self, arguments: list[str], then: Any) -> None:
        command = BackgroundCommand(arguments, self, then)
        self._work.append(command)
        command.start()

    def _show_read(self, read: ReadRun) -> None:
        """What the run says by the analysis that the run itself made at its end, and nothing fitted anew."""
        lines = ["   ·   ".join(result_lines(read.result))] if read.result is not None else []
        if read.verdict is not None:
            judged = read.verdict.judged
            lines.append(verdict_line(judged.verdict, judged.because))
            self.judged.emit(judged.verdict)
        lines += remarks(read.result) if read.result is not None else []
        if self._analysis_error:
            lines.append(f"The analysis failed: {self._analysis_error}. The run is sealed.")
        self.results.setText("\n".join(lines))

    def _ask_review(self) -> None:
        if self._path is not None:
            self.review_requested.emit(self._path)

    def _make_report(self) -> None:
        if self._path is None:
            return
        page = self._path.with_name(self._path.name.removesuffix(".h5") + ".html")
        self.report.setEnabled(False)
        self.report.setText("Writing the report …")

        def written(code: int, out: str, complaint: str) -> None:
            self.report.setText("Open report")
            self.report.setEnabled(True)
            if code == 6 or not page.exists():
                self._session.message.emit(
                    complaint.strip()[-300:] or "The report could not be written."
                )
            else:
                self._session.message.emit(f"Report: {page}")
                if self.open_report:
                    self._open(page)

        self._run(["report", str(self._path), "--output", str(page)], written)

    def _open(self, page: Path) -> None:
        if not QDesktopServices.openUrl(QUrl.fromLocalFile(str(page.resolve()))):
            self._session.message.emit(f"Written, but nothing here opens it: {page}")


def _headline_of(state: RunState, report: dict[str, Any]) -> str:
    """One line: outcome and run."""
    if state.state is State.REFUSED:
        return "The run was not started"
    if state.state is State.LOST:
        return "The acquisition is gone"
    if state.safe is False:
        return "STANDSTILL WAS NOT VERIFIED: press the emergency stop, do not touch the rig"
    return f"{state.outcome}   {report.get('run', '')}"


def _campaign_headline(state: RunState, report: dict[str, Any]) -> str:
    """One line: how a campaign stands, and of which gear it is."""
    if state.safe is False:
        return _headline_of(state, report)
    what = f"Campaign {report.get('campaign', '')}, gear {report.get('gear', '')}"
    if "lines" in report:
        what = "Commissioning"
    if report.get("complete"):
        return f"{what}: COMPLETED, {report.get('verdict', '')}"
    return f"{what}: INCOMPLETE, {report.get('outcome', '')}"


def campaign_lines(report: dict[str, Any]) -> list[str]:
    """What a campaign found: the verdict with its reasons, what was done again, what went wrong, how it goes on."""
    if not report:
        return []
    if "lines" in report:
        return [str(line) for line in report["lines"]]
    lines = [verdict_line(str(report["verdict"]), reasons_of(report)), *remarks_of(report)]
    if not report.get("complete"):
        lines.append("Start the same campaign again: it goes on from here.")
    return lines


def sentence_of(state: RunState, report: dict[str, Any], bench: str) -> str:
    """What happened and what to do next."""
    parts: list[str] = []
    trip = report.get("trip") or {}
    if state.cause:
        rule = rule_of(state.cause)
        parts.append(f"Cause: {state.cause.replace('_', ' ')}, {rule.what}.")
        if trip.get("value") is not None and trip.get("limit") is not None:
            unit = phrase(" {}", trip.get("unit"))
            parts.append(f"Found {trip['value']:.4g}{unit}, limit {trip['limit']:.4g}{unit}.")
    elif state.what:
        parts.append(state.what.rstrip(".") + ".")
    if state.remedy:
        parts.append(f"What to do: {state.remedy}")
    made_safe = report.get("make_safe") or {}
    if made_safe.get("safe"):
        parts.append(
            f"Made safe ({made_safe.get('action', '')}), standstill verified by "
            f"{', '.join(_OBSERVERS.get(str(w), str(w)) for w in made_safe.get('verified_by', ()))}."
        )
    if state.outcome == "TRIPPED":
        parts.append(
            "The trip is latched: acknowledge it by name on the page Prepare, "
            f"or with rig acknowledge --operator NAME {bench}"
        )
    return " ".join(parts)


def verdict_line(verdict: str, because: Sequence[str]) -> str:
    """The verdict on the gear with its reasons."""
    return f"Verdict: {verdict}" + phrase(" ({})", "; ".join(because))


def result_lines(result: Result) -> list[str]:
    """The first results, each with its uncertainty and unit; what the data cannot tell is said beside it."""
    doubts = {"weakly": " (weakly identifiable)", "no": " (not identifiable)"}
    names = dict.fromkeys((*key_names(result.quantities, result.estimates), *result.estimates))
    lines = []
    for name in list(names)[:MOST_LINES]:
        estimate, quantity = result.estimates[name], result.quantity(name)
        value = show(estimate, quantity).with_uncertainty
        doubt = doubts.get(estimate.identifiable, "")
        lines.append(f"{quantity.titled(name)} {value}{doubt}")
    return lines


def remarks(result: Result) -> list[str]:
    """What must not be missed beside the numbers: whose torque it is."""
    lines = []
    if result.options.get("torque_is_of") == "motor + gear":
        way = ""
        if takes_tare(result.kind):
            way = " Review fits it with a motor-tare run."
        lines.append(f"Motor + gear: no tare was subtracted.{way}")
    return lines
