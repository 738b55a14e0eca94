"""The files of a run: the run file with its checks, and the analyses that lie beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QUrl, Signal
from PySide6.QtWidgets import QWidget

from experiments.finding import Finding
from rig.analysis.store import Analysis, analysis_folder
from rig.content.grid import Grid, columns
from rig.runfile.verify import verify_run
from rig.window.review.grid import GridTable
from rig.window.review.table_model import local_time
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, in_row, push_button, text_label
from rig.window.work.background import LatestTask

COLUMNS = columns(("#", "number"), "kind of fit", "made", "tare", "program", "file")
_Opener = Callable[[QUrl], object]


class RunFilesView(QWidget):
    """The files. `analysis_chosen` carries the `Analysis` that was opened."""

    analysis_chosen = Signal(object)

    def __init__(self, session: WindowSession, opener: _Opener) -> None:
        super().__init__()
        self._opener = opener
        self._path: Path | None = None
        self._analyses: tuple[Analysis, ...] = ()
        self.file = text_label(wraps=True, selectable=True)
        self.findings = text_label(wraps=True, selectable=True)
        self.verify = push_button(
            "Ch&eck the file",
            tip="Is the file what was recorded? Hash, counters, time, flags, segments, calibrations",
            act=self._verify,
        )
        self.folder = push_button("Open its f&older", act=self._open_folder)
        self.table = GridTable(session, "Analyses")
        self.table.activated.connect(
            lambda index: self.analysis_chosen.emit(self._analyses[index.row()])
        )
        self.says = text_label("", "muted", wraps=True)
        self._verifying = LatestTask(self, self._show_findings, self.findings.setText)
        buttons = in_column(in_row(self.verify, self.folder), (None, 1))
        head = in_row((self.file, 1), buttons)
        self.setLayout(
            in_column(head, self.findings, (self.table, 1), self.says, margins=(8, 8, 8, 4))
        )

    def show_run(
        self, path: Path, seal: str, analyses: Sequence[Analysis], problem: str = ""
    ) -> None:
        """The files of a run and its seal in words; `problem` says why its analyses cannot be read."""
        if path != self._path:
            self.findings.clear()
            self.findings.hide()
            self._verifying.forget()
        self._path, self._analyses = path, tuple(analyses)
        self.file.setText(f"{path}\nSHA-256: {seal}")
        rows = []
        for a in self._analyses:
            tare = str(a.content.get("tare", {}).get("run", "")) or "none"
            version = str(a.content.get("program_version", ""))
            created = local_time(str(a.content.get("created", "")))
            rows.append(
                (
                    str(a.number),
                    a.kind,
                    created,
                    tare,
                    version,
                    a.path.name,
                )
            )
        self.table.show_grid(Grid("Analyses", COLUMNS, rows))
        where = analysis_folder(path).name
        says = "No analysis yet: use Fit on the page Results."
        if rows:
            says = (
                f"Analyses in {where}, appended and never edited. Enter or double click shows one."
            )
        self.says.setText(problem or says)

    def _verify(self) -> None:
        path = self._path
        if path is not None:
            self.findings.setText("Reading the file from end to end …")
            self.findings.show()
            self._verifying.start(lambda: verify_run(path))

    def _show_findings(self, findings: Sequence[Finding]) -> None:
        lines = [f"{one.severity.mark}   {one.sentence}" for one in findings]
        self.findings.setText("\n".join(lines))

    def _open_folder(self) -> None:
        if self._path is not None:
            self._opener(QUrl.fromLocalFile(str(self._path.parent)))
