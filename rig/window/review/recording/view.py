"""A recording before it is a run: its columns with the evidence, their pictures, and what stays open.

It shows what `rig import FILE` asks at a terminal: nothing is imported before every question has its answer, and what
was proposed and accepted stands in the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QVBoxLayout, QWidget

from rig.errors import ConfigurationError
from rig.library.folder import claim_run
from rig.runfile.importing.accepting import accepted, good_for, is_useless, proposal_grid
from rig.runfile.importing.answers import answered, corrected
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.convert import Imported, import_tables
from rig.runfile.importing.opening import open_tables
from rig.runfile.importing.proposed import Proposal, ProposedColumn, Question
from rig.window.plot.plots import LabPlot
from rig.window.review.grid import GridTable
from rig.window.review.recording.pictures import Looked, look_at, pictures_of
from rig.window.review.recording.questions import CorrectionRow, QuestionRows
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    choice_box,
    emptied,
    in_column,
    in_row,
    line_field,
    push_button,
    restyled,
    room_for,
    scrolled,
    split,
    text_label,
)
from rig.window.work.background import LatestTask

_SENSES = {"not said": 0, "with the input": 1, "against the input": -1}
_PICTURE_HEIGHT = 190
"""Pixels of one picture; more of them are scrolled."""
_FITS_IN_A_ROW = 3
_OPEN = "Answer what stays open: nothing is guessed."


@dataclass(frozen=True)
class _ImportResult:
    run: Imported
    kinds: list[str]


class RecordingView(QWidget):
    """The view of one recording. `show_files` looks at it; the run that is made of it is opened, or fitted."""

    opened = Signal(Path, str)
    """Carries the run that was made, and the kind of fit that is wanted of it ("": none)."""
    closed = Signal()

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._looked: Looked | None = None
        self.proposal: Proposal | None = None
        self._looking = LatestTask(self, self._take_look, self._refuse)
        self._making = LatestTask(self, self._take_run, self._refuse)
        self.title = text_label("", "title")
        self.columns = GridTable(session, "Columns of the recording")
        self.correction = CorrectionRow()
        self.questions = QuestionRows()
        self.serial = line_field("Serial number of the gear", "serial number")
        self.ratio = line_field("Ratio of the gear", "turns of the input for one of the output")
        self.sense = choice_box("Sense of the output angle", tuple(_SENSES))
        self.make = push_button("&Import", "primary", tip="Make a run of it", act=self._make)
        self.says = text_label(wraps=True, selectable=True)
        self.pictures: list[LabPlot] = []
        self._pictures, self._fits = QVBoxLayout(), QGridLayout()
        self._fits.setContentsMargins(0, 0, 0, 0)
        self._lay_out()
        self.columns.itemSelectionChanged.connect(self._choose)
        self.correction.said.connect(self._correct)
        self.questions.answered.connect(self._answer)

    def _lay_out(self) -> None:
        close = push_button("Close", tip="Leave the recording as it is", act=self.closed)
        gear = in_row(text_label("gear"), (self.serial, 1), text_label("ratio"), (self.ratio, 1))
        sense = in_row(text_label("its output counts"), self.sense, (None, 1))
        below = (self.correction, self.questions, gear, sense, in_row(self.make, (self.says, 1)))
        fits = room_for(self._fits)
        table = room_for(in_column((self.columns, 1), *below, fits, margins=(0, 0, 0, 0)))
        pictures = scrolled(room_for(self._pictures))
        both = split((table, 1), (pictures, 1), sizes=[430, 380])
        head = in_row((self.title, 1), close)
        self.setLayout(in_column(head, (both, 1), margins=(6, 8, 8, 6), spacing=6))

    @property
    def is_busy(self) -> bool:
        """Whether a file is being read or a run made."""
        return self._looking.is_running or self._making.is_running

    @property
    def _may_make(self) -> bool:
        """Whether a run can be made of what is shown: nothing stays open, and something is recognised."""
        made_of = self.proposal
        return made_of is not None and not made_of.questions and not is_useless(made_of)

    def show_files(self, files: Sequence[Path]) -> None:
        """Look at the files of one recording, beside the window."""
        self._looked = self.proposal = None
        self.title.setText(", ".join(file.name for file in files))
        for field in (self.serial, self.ratio):
            field.clear()
        self.sense.setCurrentIndex(0)
        self._clear()
        self._say("Looking at the first rows …")
        self._looking.start(lambda: look_at(files))

    def _clear(self) -> None:
        self.columns.setRowCount(0)
        self.correction.show_column(None)
        self.questions.show_questions(())
        emptied(self._pictures)
        emptied(self._fits)
        self.make.setEnabled(False)

    def _take_look(self, looked: Looked) -> None:
        self._looked = looked
        self._propose(looked.proposal)

    def _propose(self, proposal: Proposal) -> None:
        """Show a proposal, with all that follows from it."""
        assert self._looked is not None
        self.proposal = proposal
        self.columns.show_grid(proposal_grid(proposal, all_columns=True))
        self.correction.show_column(None)
        self.questions.show_questions(proposal.questions)
        if math.isfinite(proposal.ratio) and not self.ratio.text():
            self.ratio.setText(f"{proposal.ratio:g}")
        if proposal.output_sense:
            self.sense.setCurrentIndex(list(_SENSES.values()).index(proposal.output_sense))
        emptied(self._pictures)
        self.pictures = []
        for plot in pictures_of(self._looked, proposal):
            picture = LabPlot(self._session)
            picture.setMinimumHeight(_PICTURE_HEIGHT)
            picture.show_data(plot)
            self._pictures.addWidget(picture)
            self.pictures.append(picture)
        if is_useless(proposal):
            self._say("No column is recognised: choose one in the table and say what it is.")
        else:
            self._say(_OPEN if proposal.questions else "Nothing stays open.")
        self.make.setEnabled(self._may_make)

    def _choose(self) -> None:
        rows = self.columns.selectionModel().selectedRows()
        if self.proposal is not None and rows:
            self.correction.show_column(self.proposal.used_first[rows[0].row()])

    def _correct(self, column: ProposedColumn, channel: str, unit: str) -> None:
        assert self.proposal is not None
        try:
            self._propose(corrected(self.proposal, column.key, channel, unit))
        except ConfigurationError as error:
            self._refuse(str(error))

    def _answer(self, question: Question, answer: str) -> None:
        assert self.proposal is not None
        if question not in self.proposal.questions:
            # Enter in an editable box is told twice.
            return
        place = self.proposal.questions.index(question)
        try:
            self._propose(answered(self.proposal, question, answer))
        except ConfigurationError as error:
            self.questions.refuse(place, str(error))

    def _make(self) -> None:
        looked, proposal = self._looked, self.proposal
        assert looked is not None
        assert proposal is not None
        ratio = _number(self.ratio.text())
        if ratio is None:
            self.ratio.setFocus()
            self._refuse(f"ratio: {self.ratio.text()!r} is no number")
            return
        said = ImportOptions(
            channels=(),
            gear_serial=self.serial.text().strip(),
            ratio=ratio,
            output_sense=_SENSES[self.sense.currentText()],
            operator=self._session.operator,
        )
        options = accepted(said, proposal)
        folder = self._session.folder
        self.make.setEnabled(False)
        self._say("Importing …")
        self._making.start(lambda: _import_run(looked, options, folder))

    def _take_run(self, made: _ImportResult) -> None:
        run = made.run.path
        self._session.runs_changed.emit()
        notes = (note for note in made.run.brief_notes if note.startswith(("WARNING", "not said")))
        text = f"{made.run.rows} rows imported into {run.name} (IMPORTED)."
        self._say("\n".join((text, *notes)), "good")
        emptied(self._fits)
        for place, kind in enumerate((*made.kinds, "")):
            tip = f"Fit it as {kind}, and open it" if kind else "Open the run"
            button = push_button(
                f"Fit {kind}" if kind else "Open",
                tip=tip,
                act=lambda _, kind=kind: self.opened.emit(run, kind),
            )
            self._fits.addWidget(button, place // _FITS_IN_A_ROW, place % _FITS_IN_A_ROW)

    def _refuse(self, why: str) -> None:
        self._say(why, "bad")
        self.make.setEnabled(self._may_make)

    def _say(self, text: str, part: str = "muted") -> None:
        self.says.setText(text)
        restyled(self.says, part)


def _import_run(looked: Looked, options: ImportOptions, folder: Path) -> _ImportResult:
    """Make the run, and find out what it is good for."""
    name = options.gear_serial or looked.files[0].stem
    tables = open_tables(looked.kind, looked.files)
    place = options.experiment or "import"
    run = import_tables(tables, options, lambda: claim_run(folder, place, name).path)
    return _ImportResult(run, good_for(looked.kind, looked.files, options))


def _number(text: str) -> float | None:
    """The number in a field, NaN where it is empty; None where it is no number."""
    try:
        return float(text) if text.strip() else math.nan
    except ValueError:
        return None
