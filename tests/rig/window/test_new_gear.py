"""A new gear in the window: from its part number to a card, what is refused is said at its field."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from model.catalogue.proportions import NAMEPLATE
from model.gear_file import load_gear
from rig.gears.card import card_for
from rig.window.prepare.gear import GearSection
from rig.window.shell.session import WindowSession

PRODUCT = "SHG-32-100-2UH"
RATED = "ratings.rated_torque"
LIMIT = "ratings.average_input_speed"


@pytest.fixture
def section(session: WindowSession, qtbot: QtBot) -> GearSection:
    made = GearSection(session)
    qtbot.addWidget(made)
    made.show()
    made.set_operator("A. Example")
    qtbot.mouseClick(made.new_button, Qt.MouseButton.LeftButton)
    return made


def test_a_part_number_makes_a_set_and_a_card(section: GearSection, session: WindowSession) -> None:
    form = section.new
    assert form.isVisible()
    assert not section.card_part.isVisible()
    form.product.editor.setText(PRODUCT.lower())
    form.serial.editor.setText("SN-7")
    form.look_up()
    assert form.nameplate[RATED].editor.placeholderText() == "178.0 N m"
    assert form.nameplate[RATED].note.text().startswith("catalogue: ")
    assert form.nameplate[LIMIT].note.text().startswith("assumed: ")
    assert form.nameplate[LIMIT].note.property("part") == "warning"
    assert not form.more.isVisible(), "one screen: part, serial number, mounting"
    form.more_button.click()
    assert form.nameplate[RATED].editor.isVisible()
    assert f"3 of {len(NAMEPLATE)} nameplate values are only assumed" in form.says.text()
    form.nameplate[LIMIT].editor.setText("3000 r/min")
    assert f"2 of {len(NAMEPLATE)}" in form.says.text()
    form.make_button.click()
    assert section.card_part.isVisible()
    card = card_for(session.folder, "SN-7")
    assert card is not None
    gear = load_gear(card.facts.part)
    assert gear.name == PRODUCT
    assert gear.value(LIMIT).origin.provenance == "catalogue"
    assert "A. Example" in gear.value(LIMIT).origin.source
    facts = section.facts
    assert facts is not None
    assert facts.serial == "SN-7"
    assert facts.mounting == "circular-spline-fixed"
    assert section.is_confirmed
    assert card.confirmation is not None
    assert card.confirmation.by == "A. Example"


def test_the_next_gear_is_one_more_of_the_same_part(section: GearSection) -> None:
    form = section.new
    form.product.editor.setText(PRODUCT)
    form.serial.editor.setText("SN-7")
    form.make()
    section.begin_next()
    assert form.isVisible()
    assert (form.product.text, form.serial.text) == (PRODUCT, "")
    assert form.gear is not None
    form.serial.editor.setText("SN-8")
    form.make()
    assert section.facts is not None
    assert section.facts.serial == "SN-8"


def test_what_is_refused_is_said_at_its_field(section: GearSection, session: WindowSession) -> None:
    form = section.new
    form.product.editor.setText("no gear")
    form.look_up()
    assert form.product.note.text().startswith("✗ names no series, size, ratio and unit type")
    assert PRODUCT in form.product.note.text()
    form.make_button.click()
    assert "Type the part number." in form.refused.text()
    assert not form.nameplate[RATED].editor.isVisible()
    form.product.editor.setText(PRODUCT)
    form.serial.editor.setText("SN-7")
    form.nameplate[RATED].editor.setText("178")
    form.make_button.click()
    assert "A value of the nameplate is refused." in form.refused.text()
    assert "is no number with its unit" in form.nameplate[RATED].note.text()
    form.nameplate[RATED].editor.setText("-3 N m")
    form.make()
    assert form.nameplate[RATED].note.property("part") == "bad"
    assert card_for(session.folder, "SN-7") is None


def test_a_gear_that_has_a_part_is_not_made_again(
    section: GearSection, session: WindowSession
) -> None:
    form = section.new
    for number in (1, 2):
        section.show_new(True)
        form.product.editor.setText(PRODUCT)
        form.serial.editor.setText("SN-7")
        form.look_up()
        form.make_button.click()
        assert form.isVisible() == (number == 2)
    assert "has a card that names its part already" in form.serial.note.text()
    form.cancel_button.click()
    assert section.card_part.isVisible()


def test_nobody_is_named(section: GearSection, session: WindowSession) -> None:
    section.set_operator("")
    form = section.new
    form.product.editor.setText(PRODUCT)
    form.serial.editor.setText("SN-7")
    form.look_up()
    form.make_button.click()
    assert "operator has to be named" in form.refused.text()
    assert "operator has to be named" in form.says.text()
