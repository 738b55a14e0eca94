"""What stays open of a recording, a row a question; and a row in which one column is said to be something else."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QLabel, QVBoxLayout, QWidget

from rig.runfile.importing.proposed import ProposedColumn, Question
from rig.runfile.importing.units import DIMENSIONS
from rig.window.review.recording.pictures import LEFT_OUT
from rig.window.shell.stack import (
    choice_box,
    emptied,
    in_column,
    in_row,
    line_field,
    push_button,
    room_for,
    text_label,
)


class QuestionRows(QWidget):
    """The open questions. `answered` carries a `Question` and what was said."""

    answered = Signal(object, str)

    def __init__(self) -> None:
        super().__init__()
        self.fields: list[QComboBox] = []
        self._rows = QVBoxLayout(self)
        self._rows.setContentsMargins(0, 0, 0, 0)
        self.told: list[QLabel] = []

    def show_questions(self, questions: tuple[Question, ...]) -> None:
        """Other questions; none: nothing is shown."""
        emptied(self._rows)
        self.fields, self.told = [], []
        for question in questions:
            self._rows.addWidget(self._row(question))
        self.setVisible(bool(questions))

    def refuse(self, place: int, why: str) -> None:
        """A sentence under the field whose answer was not understood."""
        self.told[place].setText(why)
        self.told[place].show()
        self.fields[place].setFocus()

    def _row(self, question: Question) -> QWidget:
        is_choice = question.why in ("which", "channel")
        field = choice_box(question.text, question.usual, letters=9)
        field.setEditable(not is_choice)
        if is_choice:
            field.setCurrentText(question.by_evidence)
        else:
            field.setCurrentText("")
        told = text_label("", "bad", wraps=True)

        def tell() -> None:
            self.answered.emit(question, field.currentText())

        take = push_button("Take", tip="Answer this question", act=lambda _: tell())
        if (line := field.lineEdit()) is not None:
            line.returnPressed.connect(tell)
        self.fields.append(field)
        self.told.append(told)
        parts = [text_label(question.text, wraps=True), field, take]
        if question.why == "unit":
            leave = "Import without this column: its unit is not known"
            parts.append(
                push_button("Leave out", tip=leave, act=lambda _: self.answered.emit(question, ""))
            )
        row = in_row((parts[0], 1), *parts[1:])
        told.hide()
        return room_for(in_column(row, told, margins=(0, 0, 0, 0), spacing=2))


class CorrectionRow(QWidget):
    """What the chosen column is, where the proposal is wrong. `said` carries the column, its channel and its unit."""

    said = Signal(object, str, str)

    def __init__(self) -> None:
        super().__init__()
        self._column: ProposedColumn | None = None
        self._about = text_label("")
        self.channel = choice_box(
            "Channel of the chosen column", (LEFT_OUT, *DIMENSIONS), letters=11
        )
        self.channel.setEditable(True)
        self.unit = line_field("Unit of the chosen column", "unit")
        self.take = push_button(
            "Say so", tip="This column is that, whatever was proposed", act=self._tell
        )
        self.unit.returnPressed.connect(self._tell)
        parts = (self._about, (self.channel, 2), text_label("in"), (self.unit, 1), self.take)
        self.setLayout(in_row(*parts, margins=(0, 0, 0, 0)))
        self.show_column(None)

    def show_column(self, column: ProposedColumn | None) -> None:
        """Another column was chosen, or none."""
        self._column = column
        self.setVisible(column is not None)
        if column is not None:
            self._about.setText(f"{column.heading} is")
            self.channel.setCurrentText(column.channel or LEFT_OUT)
            self.unit.setText(column.unit)

    def _tell(self) -> None:
        channel, unit = self.channel.currentText().strip(), self.unit.text().strip()
        if channel in ("", LEFT_OUT):
            channel = unit = ""
        self.said.emit(self._column, channel, unit)
