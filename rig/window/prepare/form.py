"""A form made from a parameter model: a line per parameter with its unit, its range and what it is.

The model is the only definition: the same annotations make the flags of the command line and the
tables of the documentation. A value that the model refuses is marked at its field, with the model's
own words.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from PySide6.QtCore import QObject, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QCheckBox, QComboBox, QGridLayout, QLineEdit, QWidget

from experiments.errors import ExperimentError, PlanError
from experiments.parameters import ParameterField
from model import units
from rig.content.phrase import phrase
from rig.window.prepare.request import heading
from rig.window.shell.stack import (
    mark_invalid,
    restyled,
    set_tip,
    text_label,
)

_Checker = Callable[[str, Any], None]
"""Raises `PlanError` for a value of a field that the model refuses."""


class CalmComboBox(QComboBox):
    """A choice that the mouse wheel does not change by accident while the form is scrolled."""

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the scroll area."""
        event.ignore()


class _EditableChoice(CalmComboBox):
    """A choice of known words in which any other may be written."""

    def __init__(self) -> None:
        super().__init__()
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)


class _FieldRow(QObject):
    """One parameter: label, editor, unit, and a line below with its help and range, or what is wrong with it."""

    changed = Signal(str)

    def __init__(
        self,
        field: ParameterField,
        choices: tuple[str, ...] = (),
        optional: bool = False,
        suggestions: tuple[str, ...] = (),
    ) -> None:
        super().__init__()
        self.field, self.choices, self.suggestions = field, choices, suggestions
        self._optional = optional or field.optional
        self.label = text_label(heading(field.name))
        self.unit = text_label(printed(field.unit) if field.unit != "1" else "", "muted")
        self.note = text_label(wraps=True)
        self.editor = self._new_editor()
        self.editor.setObjectName(field.name)
        self.editor.setAccessibleName(f"{self.label.text()} {self.unit.text()}".strip())
        self.editor.setAccessibleDescription(field.help)
        self.label.setBuddy(self.editor)
        self.problem = ""
        self.set_value(field.default)
        self.set_problem("")

    def _new_editor(self) -> QLineEdit | QComboBox | QCheckBox:
        name = self.field.name
        if self.choices or self.suggestions:
            box = _EditableChoice() if self.suggestions else CalmComboBox()
            box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            words = [*self.choices, *self.suggestions]
            box.addItems(["", *words] if self._optional or self.suggestions else words)
            box.currentTextChanged.connect(lambda _: self.changed.emit(name))
            return box
        if self.field.kind is bool:
            tick = QCheckBox("yes")
            tick.toggled.connect(lambda _: self.changed.emit(name))
            return tick
        line = QLineEdit()
        if self.field.kind is tuple:
            line.setPlaceholderText("numbers, with spaces between them")
        elif self.field.content:
            line.setPlaceholderText(f"path of a {self.field.content} file")
        elif self._optional:
            line.setPlaceholderText("not known")
        line.textChanged.connect(lambda _: self.changed.emit(name))
        return line

    @property
    def value(self) -> Any:
        """What stands in the editor: text, or a truth value."""
        if isinstance(self.editor, QCheckBox):
            return self.editor.isChecked()
        return (
            self.editor.currentText() if isinstance(self.editor, QComboBox) else self.editor.text()
        ).strip()

    def set_value(self, value: Any) -> None:
        """Show a value; None is nothing."""
        if isinstance(self.editor, QCheckBox):
            self.editor.setChecked(bool(value))
        elif isinstance(self.editor, QComboBox):
            self.editor.setCurrentText(as_text(value))
        else:
            self.editor.setText(as_text(value))
            self.editor.setCursorPosition(0)

    def set_problem(self, text: str) -> None:
        """Mark the field as wrong, in these words; "" shows its help and range again."""
        self.problem = text
        self.note.setText(phrase("✗ {}", text) or self.hint)
        restyled(self.note, "bad" if text else "muted")
        mark_invalid(self.editor, bool(text))
        set_tip(self.editor, text or self.hint)

    @property
    def hint(self) -> str:
        """What the parameter is, its range, and its default where it has been changed."""
        parts = [self.field.help]
        if self.field.limit:
            parts.append(printed(self.field.limit))
        default = self.field.default
        if default not in (None, "", ()) and self.differs:
            parts.append(f"default {as_text(default)}")
        return "; ".join(part for part in parts if part)

    @property
    def differs(self) -> bool:
        """Whether something else than the default stands here."""
        if isinstance(self.editor, QCheckBox):
            return self.value != bool(self.field.default)
        return str(self.value) != as_text(self.field.default)

    def mark_difference(self) -> None:
        """Show by the weight of the label that this is not the default."""
        font = self.label.font()
        font.setBold(self.differs and self.field.default not in (None, ""))
        self.label.setFont(font)


class ParameterForm(QWidget):
    """The fields of one model, one below the other; `changed` tells that one was edited."""

    changed = Signal()

    def __init__(
        self,
        fields: Iterable[ParameterField],
        checker: _Checker,
        choices: Mapping[str, tuple[str, ...]] | None = None,
        suggestions: Mapping[str, tuple[str, ...]] | None = None,
    ) -> None:
        super().__init__()
        self.rows: dict[str, _FieldRow] = {}
        self._checker = checker
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(1)
        grid.setColumnStretch(1, 1)
        for index, field in enumerate(fields):
            words = (choices or {}).get(field.name, ())
            row = _FieldRow(
                field,
                words,
                optional=bool(words) and not field.default,
                suggestions=(suggestions or {}).get(field.name, ()),
            )
            row.setParent(self)
            row.changed.connect(self._edited)
            self.rows[field.name] = row
            line = 2 * index
            grid.addWidget(row.label, line, 0)
            grid.addWidget(row.editor, line, 1)
            grid.addWidget(row.unit, line, 2)
            grid.addWidget(row.note, line + 1, 0, 1, 3)
            grid.setRowMinimumHeight(line + 1, 22)
            row.note.setContentsMargins(0, 0, 0, 6)

    def values(self) -> dict[str, Any]:
        """What stands in every field, as typed."""
        return {name: row.value for name, row in self.rows.items()}

    def differing(self) -> dict[str, Any]:
        """What stands in the fields that do not show their default."""
        return {name: row.value for name, row in self.rows.items() if row.differs}

    def set_values(self, values: Mapping[str, Any]) -> None:
        """Show these values, and the default in every other field; tells of it once."""
        with QSignalBlocker(self):
            for name, row in self.rows.items():
                row.set_value(values.get(name, row.field.default))
        self.check()
        self.changed.emit()

    def check(self) -> bool:
        """Ask the model about every field and mark what it refuses; whether nothing was refused."""
        for name, row in self.rows.items():
            row.mark_difference()
            row.set_problem(self._refusal(name, row))
        return self.is_valid

    @property
    def is_valid(self) -> bool:
        """Whether no field is marked."""
        return not any(row.problem for row in self.rows.values())

    def mark(self, where: str, text: str) -> bool:
        """Mark the field that a refusal names ("friction.highest_rpm"); whether there is one."""
        row = self.rows.get(where.rpartition(".")[2])
        if row is None:
            return False
        row.set_problem(text)
        return True

    def _edited(self, name: str) -> None:
        row = self.rows[name]
        row.mark_difference()
        row.set_problem(self._refusal(name, row))
        self.changed.emit()

    def _refusal(self, name: str, row: _FieldRow) -> str:
        text = str(row.value)
        if (
            row.field.kind in (float, tuple)
            and (pointed := _DECIMAL_COMMA.sub(r"\1.\2", text)) != text
        ):
            # In a list 7,5 could be 7.5 or 7 and 5: nothing is guessed.
            return f"Write decimals with a point: {pointed}" + (
                ", and spaces between numbers" if row.field.kind is tuple else ""
            )
        try:
            self._checker(name, row.value)
        except PlanError as error:
            return refusal_text(error)
        return ""


_DECIMAL_COMMA = re.compile(r"(\d),(\d)")
_POWER = re.compile(r"\b(\d(?:\.\d+)?e[+-]?\d+)\b")


def printed(text: str) -> str:
    """Units and ranges as they are printed: kg m2 is kg m², um is µm, >= is ≥, 1e+06 is 1 000 000."""
    text = _POWER.sub(
        lambda m: f"{float(m[1]):,.0f}".replace(",", "\u202f") if float(m[1]) >= 1.0 else m[1], text
    )
    return units.printed(text.replace(">=", "≥").replace("<=", "≤"))


def refusal_text(error: ExperimentError) -> str:
    """The model's refusal without the path, which the field itself shows."""
    if error.what == "is of the wrong kind":
        return f"{error.value} is not {error.limit}"
    text = error.what
    if error.value is not None:
        text += f": {printed(str(error.value))}"
    if error.limit:
        text += f", allowed {printed(error.limit)}"
    return text + phrase(". {}", error.remedy)


def as_text(value: Any) -> str:
    """A value as it stands in a field; nothing for None."""
    if value is None:
        return ""
    if isinstance(value, tuple):
        return " ".join(f"{number:g}" for number in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
