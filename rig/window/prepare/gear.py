"""The gear on the Prepare page: the cards of known gears to choose from, the card as a form, its
confirmation by name.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from PySide6.QtCore import QFileSystemWatcher, Signal
from PySide6.QtWidgets import QComboBox, QPushButton, QWidget

from experiments.errors import PlanError
from experiments.finding import Severity
from experiments.parameters import parameter_fields
from model.errors import ParameterError
from model.gear_file import load_gear
from rig.errors import RigError
from rig.gears.acceptance import shipped_names
from rig.gears.card import (
    GearCard,
    ListedCard,
    card_for,
    list_cards,
    now_text,
    with_changes,
    with_confirmation,
)
from rig.gears.card_places import above, cards_folder
from rig.gears.facts import CHOICES, GearFacts, make_facts, stated_facts
from rig.gears.making import write_card
from rig.run.gear import acceptance_checks_of_card
from rig.window.prepare.form import CalmComboBox, ParameterForm
from rig.window.prepare.new_gear import NewGearForm
from rig.window.prepare.preview_plot import short_name
from rig.window.shell.sentence import give_or_take
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    restyled,
    room_for,
    set_tip,
    text_label,
)
from rig.window.work.background import single_shot

_NEW_GEAR = "another gear …"
_PAUSE_MS = 250
"""ms without a further change after which the cards are read again."""


class GearSection(QWidget):
    """What is mounted. `changed` tells that the facts, or what is stored of them, are others."""

    changed = Signal()
    wanted = Signal(object)
    """What a refusal waits for: a field of this card; None: the operator's name."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._stored: GearCard | None = None
        self._operator = ""
        self.choice: QComboBox = CalmComboBox()
        self.choice.setAccessibleName("Gear")
        # A long serial number must not make the whole column wider than the window shows.
        self.choice.setSizeAdjustPolicy(
            QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
        )
        self.choice.setMinimumContentsLength(12)
        self.choice.activated.connect(lambda _: self.choose(self.choice.currentData() or ""))
        self.form = ParameterForm(
            parameter_fields(GearFacts),
            _check_fact,
            CHOICES,
            {"part": _shipped_parts(), "acceptance": shipped_names()},
        )
        self.form.rows["serial"].editor.setAccessibleName("Serial number of the gear")
        self.status = text_label(wraps=True)
        self.digest = text_label(wraps=True)
        self.details_button = QPushButton("Card d&etails")
        self.details_button.setCheckable(True)
        self.details_button.toggled.connect(self._show_details)
        self.confirm_button = push_button("&Confirm this card", act=self.confirm)
        self.refused = text_label("", "bad", wraps=True)
        self.refused.hide()
        self.revert_button = push_button(
            "&Undo changes", act=lambda: self.choose(self._stored.serial if self._stored else "")
        )
        self.new_button = push_button(
            "Ne&w gear …",
            tip="Make parameter set and card of a gear from its part number",
            act=lambda: self.show_new(True),
        )
        self.new = NewGearForm(session)
        self.new.hide()
        self.new.made.connect(self._take_new)
        self.new.given_up.connect(lambda: self.show_new(False))
        self.form.changed.connect(self._show_status)
        self.form.changed.connect(self.changed)
        self._lay_out()
        self._watcher = QFileSystemWatcher(self)
        self._watcher.directoryChanged.connect(lambda _: self._pause.start())
        self._pause = single_shot(self, _PAUSE_MS, self._follow)
        self._refresh_choice()
        remembered = str(session.recall("gear", ""))
        self.choose(remembered if remembered in self._serials() else "")

    def _lay_out(self) -> None:
        label = text_label("&Gear", buddy=self.choice)
        row = in_row(label, (self.choice, 1), self.details_button)
        head = in_row((self.status, 1), self.new_button)
        buttons = in_row(self.confirm_button, self.revert_button, (None, 1))
        self.card_part = room_for(
            in_column(head, self.digest, self.form, buttons, self.refused, margins=(0, 0, 0, 0))
        )
        self.setLayout(in_column(row, self.new, self.card_part, margins=(0, 0, 0, 0)))

    def show_new(self, shown: bool) -> None:
        """The form for a new gear in the place of the card, or the card again."""
        self.new.setVisible(shown)
        self.card_part.setVisible(not shown)
        self.details_button.setEnabled(not shown)
        if shown:
            self.new.product.editor.setFocus()

    def begin_next(self) -> None:
        """The form for the next gear, of the part that was tested last: its serial number is all that is missing."""
        part = "" if self._stored is None else _product_of(self._stored)
        self.show_new(True)
        if part and not self.new.product.text:
            self.new.product.editor.setText(part)
            self.new.look_up()
            self.new.serial.editor.setFocus()

    def _take_new(self, serial: str) -> None:
        self.show_new(False)
        self._refresh_choice()
        self.choose(serial)
        # What was made is looked at from its beginning.
        self.choice.setFocus()

    @property
    def facts(self) -> GearFacts | None:
        """The gear as the form has it; None while something is refused or there is no serial number."""
        try:
            return make_facts(self.form.values())
        except PlanError:
            return None

    @property
    def card(self) -> GearCard | None:
        """The card as it is stored, if the form shows just that; None while changes wait for their confirmation."""
        facts = self.facts
        if self._stored is not None and facts is not None and facts == self._stored.facts:
            return self._stored
        return None

    @property
    def is_confirmed(self) -> bool:
        """Whether what the form shows is stored and confirmed."""
        card = self.card
        return card is not None and card.is_confirmed

    def set_operator(self, name: str) -> None:
        """Who would confirm."""
        self._operator = name.strip()
        self.new.set_operator(name)
        self._show_status()

    def choose(self, serial: str) -> None:
        """Show the card of a gear; "" an empty one."""
        self.show_new(False)
        try:
            self._stored = card_for(self._session.folder, serial)
        except RigError as error:
            self._stored = None
            self._session.message.emit(str(error))
        self.choice.setCurrentIndex(max(self.choice.findData(serial if self._stored else ""), 0))
        self.form.set_values(stated_facts(self._stored.facts) if self._stored else {})
        # A confirmed card needs no room; one that is not has to be looked at.
        self.details_button.setChecked(not self.is_confirmed)
        self._show_details(not self.is_confirmed)

    def refresh(self) -> None:
        """Look again which cards there are, and whether this one was changed elsewhere; what is being edited stays."""
        self._refresh_choice()
        stored = self._stored
        if stored is None or self.facts != stored.facts:
            return
        try:
            if card_for(self._session.folder, stored.serial) != stored:
                self.choose(stored.serial)
        except RigError as error:
            self._session.message.emit(str(error))

    def _follow(self) -> None:
        """Take over what was made or changed elsewhere; not under a list that somebody is choosing from."""
        if self.choice.view().isVisible():
            self._pause.start()
        elif self.isVisible():
            self.refresh()

    def _watch(self) -> None:
        """The folders in which cards lie, or would: what another program writes there is a change."""
        folder = self._session.folder
        cards = (cards_folder(place) for place in (folder, *above(folder)))
        wanted = {str(place) for place in (folder, *cards) if Path(place).is_dir()}
        if fresh := wanted - set(self._watcher.directories()):
            self._watcher.addPaths(sorted(fresh))

    def _refresh_choice(self) -> None:
        """Look again which cards there are."""
        self._watch()
        chosen = self.choice.currentData()
        self.choice.clear()
        for listed in list_cards(self._session.folder):
            self._add(listed)
        self.choice.addItem(_NEW_GEAR, "")
        self.choice.setCurrentIndex(
            max(self.choice.findData(chosen), 0) if chosen else self.choice.count() - 1
        )

    def _add(self, listed: ListedCard) -> None:
        if listed.card is not None:
            facts = stated_facts(listed.card.facts)
            words = f"{listed.card.serial} · {_file_words(facts.get('part', 'part not known'))}"
            self.choice.addItem(
                words if listed.card.is_confirmed else f"{words} · not confirmed",
                listed.card.serial,
            )
        else:
            self._session.message.emit(listed.problem)

    def _serials(self) -> set[str]:
        return {str(self.choice.itemData(i)) for i in range(self.choice.count())}

    def confirm(self) -> None:
        """Store what the form shows, and that the operator confirms it."""
        self.form.check()
        if why := self._why_not(self.facts):
            waited_for = self._first_refused()
            if waited_for is self.form.rows["serial"].editor:
                self.form.mark("serial", "has to be known before the card is confirmed")
            self._refuse(why, waited_for)
            return
        try:
            values: dict[str, Any] = self.form.values()
            folder = self._session.folder
            before = card_for(folder, str(values["serial"]))
            if before is not None and (
                self._stored is None or self._stored.serial != before.serial
            ):
                # Empty fields of a fresh form must not make the card forget what is known.
                self.choose(before.serial)
                self._session.message.emit(
                    f"Gear {before.serial} is known: this is its card. Look at it, then confirm it."
                )
                return
            card = with_changes(before, values, self._operator, now_text())
            self._stored = with_confirmation(card, self._operator, now_text())
            write_card(folder, self._stored)
        except PlanError as error:
            self.form.mark(error.where, error.what)
            self._refuse(str(error), self._first_refused())
            return
        except RigError as error:
            missing = [name for name in str(error.value).split(", ") if name in self.form.rows]
            for name in missing:
                self.form.mark(name, "has to be known before the card is confirmed")
            self._refuse(str(error), self._first_refused() if missing else self.confirm_button)
            return
        self.refused.hide()
        self._session.remember("gear", self._stored.serial)
        self._refresh_choice()
        self.choose(self._stored.serial)

    def _refuse(self, text: str, field: QWidget | None) -> None:
        """Say at the button why not, and bring what it waits for into view."""
        self.refused.setText(f"✗ {text}")
        self.refused.show()
        self.wanted.emit(field)

    def _first_refused(self) -> QWidget | None:
        """The field that the confirmation waits for; None: it waits for the operator's name."""
        rows = self.form.rows
        marked = next((row.editor for row in rows.values() if row.problem), None)
        missing = None if self.facts is not None and self.facts.serial else rows["serial"].editor
        return marked or missing

    def _show_details(self, shown: bool) -> None:
        self.form.setVisible(shown)
        self.details_button.setText("Hide d&etails" if shown else "Card d&etails")
        self.digest.setVisible(not shown)
        for button in (self.confirm_button, self.revert_button):
            button.setVisible(shown)
        self.refused.hide()

    def _why_not(self, shown: GearFacts | None) -> str:
        """What the confirmation waits for; "" when it may be given."""
        if not self.form.is_valid:
            return "A field is refused: put it right first."
        if shown is None or not shown.serial:
            return "The serial number is missing."
        return "" if self._operator else "The operator has to be named first."

    def _show_status(self) -> None:
        stored, shown = self._stored, self.facts
        self.revert_button.setEnabled(stored is not None and shown != stored.facts)
        who = (
            f"&Confirm as {short_name(self._operator)}" if self._operator else "&Confirm this card"
        )
        self.confirm_button.setText(who)
        set_tip(self.confirm_button, self._why_not(shown))
        if not self._why_not(shown):
            self.refused.hide()
        last = stored and stored.confirmation
        if stored is None or shown != stored.facts:
            text, part = (
                "Look at the gear, fill in what is known, then confirm it by name.",
                "warning",
            )
            if stored is not None:
                text = "Changed, not confirmed."
            if why := self._why_not(shown):
                text += f" {why}"
        elif stored.is_confirmed and last is not None:
            text, part = f"✓ Confirmed by {last.by}, {_day(last.at)}", "good"
        else:
            text, part = f"Not confirmed: {stored.warning}.", "warning"
        doubts = [
            f"! {check.found}"
            for check in acceptance_checks_of_card(stored)
            if check.severity is not Severity.PASSED
        ]
        digest = [_digest_of(stored.facts)] if stored is not None else []
        self.digest.setText("\n".join((*digest, *doubts)))
        self.status.setText(text if part == "good" else f"! {text}")
        restyled(self.status, part)


def _digest_of(facts: GearFacts) -> str:
    """A card in two lines."""
    values = stated_facts(facts)
    words = [
        _file_words(values[name]) for name in ("part", "mounting", "lubricant") if name in values
    ]
    if "acceptance" in values:
        words.append(f"must show what {_file_words(values['acceptance'])} lists")
    if facts.hours is not None:
        words.append(f"{facts.hours:g} h")
    if facts.load_inertia_kg_m2 is not None:
        doubt = facts.load_inertia_uncertainty_kg_m2
        words.append(f"load inertia {facts.load_inertia_kg_m2:g}{give_or_take(doubt)} kg m²")
    return " · ".join(words)


def _product_of(card: GearCard) -> str:
    """The part number of a gear, as its parameter set has it; "" where that cannot be read."""
    try:
        return load_gear(card.facts.part).name
    except ParameterError:
        return ""


def _file_words(told: object) -> str:
    """What a fact of the card says; of a file its name alone."""
    text = str(told)
    return Path(text).name if text.lower().endswith(".toml") else text


def _check_fact(name: str, value: Any) -> None:
    """Raises `PlanError` for a fact that the card's model refuses."""
    if name == "serial":
        # An empty card is not wrong, it is empty: it says so itself.
        make_facts({"serial": value or "?"})
        return
    values = {"serial": "?", name: value}
    if name == "load_inertia_uncertainty_kg_m2" and value:
        values["load_inertia_kg_m2"] = 1.0
    make_facts(values)


def _shipped_parts() -> tuple[str, ...]:
    """The parameter sets that come with the program, by name."""
    folder = resources.files("model") / "gears"
    return tuple(
        sorted(
            entry.name.removesuffix(".toml")
            for entry in folder.iterdir()
            if entry.name.endswith(".toml")
        )
    )


def _day(at: str) -> str:
    return at.replace("T", " ").replace("+00:00", " UTC")
