"""A new gear from its part number: makers' tables fill its parameter set, what they lack is scaled and marked assumed,
and the nameplate has the last word.
"""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QCompleter, QGridLayout, QLineEdit, QWidget

from experiments.errors import PlanError
from model.catalogue.proportions import NAMEPLATE, open_questions
from model.catalogue.table import products, read_product
from model.errors import ParameterError
from model.gear import HarmonicDrive
from model.gear_file import SECTIONS
from model.quantities import readable
from rig.content.phrase import phrase
from rig.errors import RigError
from rig.gears.card import now_text, with_confirmation
from rig.gears.facts import CHOICES
from rig.gears.making import made_gear, write_card, write_new_gear
from rig.gears.stating import declared, value_of
from rig.window.prepare.form import CalmComboBox
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    line_field,
    mark_invalid,
    push_button,
    restyled,
    room_for,
    set_tip,
    text_label,
)
from rig.window.work.background import single_shot

TYPING_PAUSE = 200
"""ms without a change after which a part number is looked up."""
_EXAMPLE = "SHG-32-100-2UH"
ASSUMED = ("assumed", "recalled")
"""Provenances that nobody has looked up."""


class _NewGearField(QObject):
    """A line of the form: its editor, and a note below, which says where its value is from or what is wrong."""

    changed = Signal()

    def __init__(self, name: str, hint: str = "") -> None:
        super().__init__()
        self.editor: QLineEdit = line_field(name, hint)
        self.label = text_label(name, buddy=self.editor)
        self.note = text_label("", "muted", wraps=True)
        self.editor.textChanged.connect(lambda _: self.changed.emit())

    @property
    def text(self) -> str:
        """What was typed."""
        return self.editor.text().strip()

    def say(self, text: str, part: str = "muted") -> None:
        """A note under the field."""
        self.note.setText(text)
        restyled(self.note, part)
        mark_invalid(self.editor, part == "bad")

    def refuse(self, error: ParameterError | PlanError | RigError) -> None:
        """Say at the field what is wrong, what is allowed, and what to do."""
        limit, remedy = phrase(", allowed {}", error.limit), phrase(" {}", error.remedy)
        self.say(f"✗ {error.what}{limit}.{remedy}", "bad")


class NewGearForm(QWidget):
    """The form. `made` carries the serial number of a gear that was made, `given_up` that nobody wants one."""

    made = Signal(str)
    given_up = Signal()
    wanted = Signal(object)
    """What a refusal waits for: a field of this form; None: the operator's name."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._operator = ""
        self._known = declared(SECTIONS)
        self.gear: HarmonicDrive | None = None
        """What the part number alone makes; None while it names no product."""
        self.product = _NewGearField("Part number", f"such as {_EXAMPLE}")
        self.serial = _NewGearField("Serial number", "from the plate of the gear")
        self.nameplate = {path: _NewGearField("") for path in NAMEPLATE}
        self.says = text_label("", "muted", wraps=True)
        self.mounting = CalmComboBox()
        self.mounting.setAccessibleName("Mounting")
        self.mounting.addItems(CHOICES["mounting"])
        set_tip(
            self.mounting,
            "Which member is fixed: circular spline (ratio N) or flexspline (ratio N + 1)",
        )
        self.make_button = push_button(
            "&Make and confirm",
            "primary",
            tip="Writes parameter set and card, and that you confirm the gear as it is mounted",
            act=self.make,
        )
        self.more_button = push_button(
            "M&ore", tip="The values of the nameplate, each with where it is from"
        )
        self.more_button.setCheckable(True)
        self.more_button.toggled.connect(self._show_more)
        self.refused = text_label("", "bad", wraps=True)
        self.refused.hide()
        self.cancel_button = push_button("Do not make it", act=self.given_up)
        self._pause = single_shot(self, TYPING_PAUSE, self.look_up)
        completer = QCompleter([str(product) for product in products()])
        completer.setCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        completer.setFilterMode(Qt.MatchFlag.MatchContains)
        self.product.editor.setCompleter(completer)
        self.product.changed.connect(self._pause.start)
        self.serial.changed.connect(self._show_state)
        for field in self.nameplate.values():
            field.changed.connect(self._show_state)
        self._lay_out()
        self.look_up()

    def _lay_out(self) -> None:
        grid = QGridLayout()
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setVerticalSpacing(1)
        grid.setColumnStretch(1, 1)
        _place(grid, (self.product, self.serial))
        grid.addWidget(text_label("Mounting", buddy=self.mounting), grid.rowCount(), 0)
        grid.addWidget(self.mounting, grid.rowCount() - 1, 1)
        below = QGridLayout()
        below.setContentsMargins(0, 0, 0, 0)
        below.setVerticalSpacing(1)
        below.setColumnStretch(1, 1)
        _place(below, tuple(self.nameplate.values()))
        self.more = room_for(below)
        self.more.hide()
        buttons = in_row(self.make_button, self.more_button, self.cancel_button, (None, 1))
        parts = (self.says, grid, buttons, self.refused, self.more)
        self.setLayout(in_column(*parts, margins=(0, 0, 0, 0)))

    def _show_more(self, shown: bool) -> None:
        self.more.setVisible(shown)

    def set_operator(self, name: str) -> None:
        """Who would make it."""
        self._operator = name.strip()
        self._show_state()

    def look_up(self) -> None:
        """What the tables have of the part number."""
        self._pause.stop()
        self.gear = None
        self.product.say("Read it from the plate: series, size, ratio and unit type.")
        if self.product.text:
            try:
                part = read_product(self.product.text)
                self.gear = made_gear(part, {}, self._operator, now_text())
                popup = self.product.editor.completer().popup()
                if popup is not None:
                    # What is found needs no suggestions any more, which would lie over the next fields.
                    popup.hide()
            except ParameterError as error:
                self.product.refuse(error)
        self._show_nameplate()
        self._show_state()

    def make(self) -> None:
        """Write parameter set and card; what is refused is said at its field."""
        self.look_up()
        stated = self._nameplate()
        if stated is None:
            self.more_button.setChecked(True)
        if self.gear is None or stated is None or self._waits_for():
            self._refuse(self._waits_for() or "A value of the nameplate is refused.")
            return
        self.refused.hide()
        by, at = self._operator, now_text()
        try:
            gear = made_gear(read_product(self.product.text), stated, by, at)
        except ParameterError as error:
            self.more_button.setChecked(
                error.where in self.nameplate or self.more_button.isChecked()
            )
            self.nameplate.get(error.where, self.product).refuse(error)
            self._refuse(error.what)
            return
        facts = {"serial": self.serial.text, "mounting": self.mounting.currentText()}
        try:
            made = write_new_gear(self._session.folder, gear, facts, by, at)
            write_card(self._session.folder, with_confirmation(made.card, by, at))
        except (PlanError, RigError) as error:
            self.serial.refuse(error)
            self._refuse(error.what)
            return
        left = phrase("; {} values of its nameplate are only assumed", len(made.open_questions))
        self._session.message.emit(
            f"Gear {made.card.serial}, {gear.name}, is made and confirmed{left}."
        )
        self.clear()
        self.made.emit(made.card.serial)

    def _refuse(self, text: str) -> None:
        """Say at the button why not, and bring the field into view that it waits for."""
        self.refused.setText(f"✗ {text}")
        self.refused.show()
        fields = (self.product, self.serial, *self.nameplate.values())
        marked = (one for one in fields if one.editor.property("invalid") == "true")
        empty = (one for one in (self.product, self.serial) if not one.text)
        field = next(marked, None) or next(empty, None)
        self.wanted.emit(None if field is None else field.editor)

    def clear(self) -> None:
        """Nothing is stated."""
        for field in (self.product, self.serial, *self.nameplate.values()):
            field.editor.clear()
        self.more_button.setChecked(False)
        self.look_up()

    def _nameplate(self) -> dict[str, float] | None:
        """What was read off the nameplate [SI]; None while a field is refused, which says why."""
        stated, refused = {}, False
        for path, field in self.nameplate.items():
            if not field.text:
                continue
            try:
                stated[path] = value_of(path, field.text, self._known[path])
            except ParameterError as error:
                field.refuse(error)
                refused = True
        return None if refused else stated

    def _show_nameplate(self) -> None:
        """Each value of the nameplate as the tables have it, and whether anybody has looked it up."""
        for path, field in self.nameplate.items():
            for part in (field.label, field.editor, field.note):
                part.setVisible(self.gear is not None)
            if self.gear is None:
                continue
            value = self.gear.value(path)
            (text,), unit = readable([value.value], value.unit)
            words = value.description[:1].upper() + value.description[1:]
            field.label.setText(_short_label(path))
            field.editor.setAccessibleName(words)
            set_tip(field.editor, words)
            field.editor.setPlaceholderText(f"{text} {unit}".rstrip())
            origin = value.origin
            part = "warning" if origin.provenance in ASSUMED else "muted"
            # The document and its conditions are read once, by the few who doubt: they stand in the tip.
            field.say(f"{origin.provenance}: {origin.source.partition(': ')[0]}", part)
            set_tip(field.note, origin.source)

    def _waits_for(self) -> str:
        """What has to be typed before a gear can be made; "" where nothing is missing."""
        if self.gear is None:
            return "Type the part number."
        if not self.serial.text:
            return "Type the serial number."
        return "" if self._operator else "The operator has to be named first (top of the page)."

    def _show_state(self) -> None:
        """What it waits for, and what is still assumed."""
        waits = self._waits_for()
        self.more_button.setEnabled(self.gear is not None)
        if not waits:
            self.refused.hide()
        if self.gear is None:
            self.says.setText(f"! {waits}")
            return
        asked = [path for path in open_questions(self.gear) if not self.nameplate[path].text]
        assumed = "Every nameplate value is looked up."
        if asked:
            assumed = (
                f"{len(asked)} of {len(NAMEPLATE)} nameplate values are only assumed: read them off the "
                "plate or the papers (More), or leave them marked."
            )
        self.says.setText(phrase("! {} ", waits) + assumed)


def _place(grid: QGridLayout, fields: Sequence[_NewGearField]) -> None:
    """Fields under each other, each with its note below."""
    for place, field in enumerate(fields):
        grid.addWidget(field.label, 2 * place, 0)
        grid.addWidget(field.editor, 2 * place, 1)
        grid.addWidget(field.note, 2 * place + 1, 0, 1, 2)
        field.note.setContentsMargins(0, 0, 0, 6)


def _short_label(path: str) -> str:
    """What a value of the nameplate is called beside its field."""
    section, _, name = path.rpartition(".")
    words = name if section == "ratings" else f"{section} {name}"
    return words.replace("_", " ")
