"""The Review page: the library of runs on the left; on the right a run, an overlay, a difference,
a gear's passport, or a recording that is to become a run.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QShowEvent
from PySide6.QtWidgets import QFileDialog, QStackedWidget, QWidget

from rig.library.index import IndexedRun
from rig.window.review.details.page import RunDetails
from rig.window.review.difference import DifferenceView
from rig.window.review.fit import ResultCache
from rig.window.review.library_table import HTML, LibraryTable
from rig.window.review.models import ModelsView
from rig.window.review.overlay_view import OverlayView
from rig.window.review.passport import PassportView
from rig.window.review.recording.view import RecordingView
from rig.window.review.results import ChooseFile
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_row, split, text_label
from rig.window.work.background import BackgroundCommand, in_words

EMPTY = (
    "Choose a run on the left: its results, figures, signals and files appear here.\n\n"
    "Choose two or more to overlay their figures or to judge models by them, two to see what differs. "
    "Search with Ctrl+F; the arrow keys go through the list.\n\n"
    "Drop a recording of another rig on the window to see what its columns are, and to make a run of it."
)
SIZES = (484, 870)
"""Pixels of library and details at first."""


class ReviewPage(QWidget):
    """The page. `opener` opens a file on the desktop; `choose_file` asks for a parameter set; tests
    hand in their own.
    """

    run_requested = Signal(str, str)
    """Carries the serial number of a gear and the protocol of a run that it lacks."""

    def __init__(
        self,
        session: WindowSession,
        *,
        opener: Callable[[QUrl], object] = QDesktopServices.openUrl,
        choose_file: ChooseFile | None = None,
        today: Callable[[], date] = date.today,
    ) -> None:
        super().__init__()
        self._session, self._opener = session, opener
        self._report: BackgroundCommand | None = None
        self.choose_recording: Callable[[], Sequence[Path]] = self._ask_for_files
        """Asks which files are one recording."""
        cache: ResultCache = {}
        self.library = LibraryTable(session, today)
        self.details = RunDetails(session, cache, opener, choose_file)
        self.overlay = OverlayView(session, cache)
        self.difference = DifferenceView(session)
        self.models = ModelsView(session)
        self.passport = PassportView(session)
        self.recording = RecordingView(session)
        self.empty = text_label(EMPTY, "muted", wraps=True, align=Qt.AlignmentFlag.AlignCenter)
        self.empty.setMargin(40)
        self.right = QStackedWidget()
        several = self.overlay, self.difference, self.models
        for view in (self.empty, self.details, *several, self.passport, self.recording):
            self.right.addWidget(view)
        both = split((self.library, 1), (self.right, 3), sizes=list(SIZES))
        self.setLayout(in_row(both, margins=(0, 0, 0, 0)))
        self._connect()

    def _connect(self) -> None:
        library = self.library
        library.source.changed.connect(self._take_library)
        library.chosen.connect(self._choose)
        library.opened.connect(self.show_run)
        library.overlay_requested.connect(self.show_overlay)
        library.difference_requested.connect(lambda paths: self.show_difference(*paths))
        library.models_requested.connect(self.show_models)
        library.passport_requested.connect(self.show_passport)
        self.passport.run_chosen.connect(self.show_run)
        self.passport.run_requested.connect(self.run_requested)
        self.passport.report_requested.connect(self._make_gear_report)
        library.report_requested.connect(self.make_report)
        library.import_requested.connect(self._ask_for_recording)
        self.recording.opened.connect(self._open_imported)
        self.recording.closed.connect(lambda: self.right.setCurrentWidget(self.empty))
        self.details.report_requested.connect(self.make_report)

    def showEvent(self, event: QShowEvent) -> None:
        """The folder is read when the page is looked at."""
        super().showEvent(event)
        QTimer.singleShot(0, self.library.source.look)

    def refresh(self) -> None:
        """Look at the folder and at the shown run again."""
        self.library.source.look()
        self.details.refresh()

    def show_run(self, path: Path) -> None:
        """Open a run and choose it in the library."""
        path = Path(path)
        if self.library.selected != [path]:
            self.library.select(path)
        self.library.table.setFocus()
        self._open(path)
        self.library.source.look()

    def show_overlay(self, paths: Sequence[Path]) -> None:
        """The figures of several runs over each other."""
        runs = [run for path in paths if (run := self.library.run_of(path)) is not None]
        self.right.setCurrentWidget(self.overlay)
        self.overlay.show_runs(runs, {run.run_id: run.path for run in self.library.model.runs})

    def show_difference(self, first: Path, second: Path) -> None:
        """What differs between two runs."""
        self.right.setCurrentWidget(self.difference)
        self.difference.show_runs(first, second)

    def show_models(self, paths: Sequence[Path]) -> None:
        """Which model predicts runs best that it has not seen."""
        self.right.setCurrentWidget(self.models)
        self.models.show_runs(paths)

    def show_passport(self, serial: str) -> None:
        """The runs of a gear over time."""
        self.right.setCurrentWidget(self.passport)
        self.passport.show_gear(serial, self.library.model.runs)

    def show_recording(self, files: Sequence[Path]) -> None:
        """What the columns of somebody else's recording are, to make a run of it; several files are one recording."""
        self.right.setCurrentWidget(self.recording)
        self.recording.show_files(files)

    def _ask_for_recording(self) -> None:
        if self._session.free_for("Choosing a recording"):
            files = self.choose_recording()
            if files:
                self.show_recording(files)

    def _ask_for_files(self) -> Sequence[Path]:
        chosen, _ = QFileDialog.getOpenFileNames(self, "A recording: the files of one run")
        return [Path(name) for name in chosen]

    def _open_imported(self, run: Path, kind: str) -> None:
        """Open the run that was made of a recording; fit it where a kind of fit is wanted."""
        self.show_run(run)
        if kind:
            self.details.bar.choose_kind(kind)
            self.details.fit(self.details.bar.order(keep=True))

    def make_report(self, paths: Sequence[Path], suffix: str = HTML) -> None:
        """Write the report of runs in a process of its own, then open it."""
        if self._report is not None:
            self._session.message.emit("A report is being written already.")
            return
        page = report_path(paths, suffix)
        self._write_report([str(path) for path in paths], page)

    def _make_gear_report(self, serial: str, suffix: str = HTML) -> None:
        """Write the report of a gear over all its runs of this folder, then open it."""
        if self._report is not None:
            self._session.message.emit("A report is being written already.")
            return
        folder = self._session.folder
        page = folder / f"gear-{re.sub(r'[^A-Za-z0-9_.-]+', '_', serial)[:80]}{suffix}"
        self._write_report(["--gear", serial, "--runs", str(folder)], page)

    def _write_report(self, words: Sequence[str], page: Path) -> None:
        self._say_report(f"Writing the report {page.name} …", busy=True)
        self._report = BackgroundCommand(
            ["report", *words, "--output", str(page)],
            self,
            lambda code, out, aside: self._open_report(page, code, aside),
        )
        self._report.start()

    def _open_report(self, page: Path, code: int, complaint: str) -> None:
        self._report = None
        if code in (2, 6) or not page.exists():
            self._say_report(in_words(complaint), busy=False)
            return
        opened = self._opener(QUrl.fromLocalFile(str(page.resolve())))
        self._say_report(
            f"Report: {page}" + ("" if opened is not False else " (nothing here opens it)"),
            busy=False,
        )

    def _say_report(self, text: str, *, busy: bool) -> None:
        self.library.say(text)
        if not self.isVisible():
            self._session.message.emit(text)
        self.passport.allow_report(not busy)
        self.details.header.allow_report(not busy)

    def _choose(self, paths: Sequence[Path]) -> None:
        """The selection has come to rest: one run is opened; several wait for what is to be done with them."""
        if len(paths) == 1:
            self._open(paths[0])

    def _open(self, path: Path) -> None:
        run = self.library.run_of(path)
        unlisted = "being written" if path.name.endswith(".part") else "sealed"
        state = run.state if run else unlisted
        self.details.set_library(self.library.model.runs)
        self.right.setCurrentWidget(self.details)
        self.details.show_run(path, state)

    def _take_library(self, runs: Sequence[IndexedRun]) -> None:
        self.details.set_library(runs)
        shown = self.details.path
        if shown is None:
            return
        # The shown run may have been sealed, or recovered, since it was opened.
        now = next(
            (
                run
                for run in runs
                if run.path.name.removesuffix(".part") == shown.name.removesuffix(".part")
            ),
            None,
        )
        if now is not None and now.path.name != shown.name:
            self.details.show_run(now.path, now.state)


def report_path(paths: Sequence[Path], suffix: str = HTML) -> Path:
    """Where the report of runs is written: beside the first of them, by its name."""
    first = paths[0]
    more = f"-and-{len(paths) - 1}-more" if len(paths) > 1 else ""
    return first.with_name(f"{first.name.removesuffix('.h5')}{more}{suffix}")
