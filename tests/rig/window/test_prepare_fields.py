"""What a person types on the Prepare page: commas, units, very long names; names that are offered;
drills that are searched.
"""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QScrollArea
from pytestqt.qtbot import QtBot

from experiments import catalogue
from experiments.parameters import make_parameters, parameter_fields
from rig.gears.card import card_for, now_text, save_card, with_changes, with_confirmation
from rig.gears.facts import GearFacts
from rig.window.prepare.form import ParameterForm, printed
from rig.window.prepare.gear import GearSection
from rig.window.prepare.page import PreparePage
from rig.window.prepare.training import TrainingDialog
from rig.window.shell.session import WindowSession
from rig.window.work.background import BackgroundCommand
from tests.rig.window.conftest import LONGEST

LONG = "SN 0815/ä that somebody pasted out of a spreadsheet with everything that stood in its row, 1234567890"


@pytest.mark.parametrize(
    ("text", "as_printed"),
    [
        ("kg m2", "kg m²"),
        ("rad/s2", "rad/s²"),
        ("um", "µm"),
        (">= 0 and <= 1e+06", "≥ 0 and ≤ 1\u202f000\u202f000"),
        ("> 0 and <= 0.5 N m", "> 0 and ≤ 0.5 N m"),
        ("1e-05", "1e-05"),
        ("maximum", "maximum"),
    ],
)
def test_units_and_ranges_are_printed_as_people_write_them(text: str, as_printed: str) -> None:
    assert printed(text) == as_printed


def test_what_is_no_number_is_refused_in_plain_words(session: WindowSession, qtbot: QtBot) -> None:
    gear = GearSection(session)
    qtbot.addWidget(gear)
    row = gear.form.rows["load_inertia_kg_m2"]
    assert row.unit.text() == "kg m²"
    for typed, said in (
        ("0,12", "Write decimals with a point: 0.12"),
        ("abc", "'abc' is not a number"),
        ("-5", "is out of range: -5.0 kg m², allowed > 0 and ≤ 1000 kg m²"),
        ("0.12", ""),
    ):
        row.editor.setText(typed)  # type: ignore[union-attr]
        assert row.problem == said


def test_in_a_list_a_comma_is_not_guessed_at(session: WindowSession, qtbot: QtBot) -> None:
    model = catalogue.load("velocity-steps").parameters
    form = ParameterForm(
        parameter_fields(model),
        lambda name, value: make_parameters(model, {name: value}, "velocity-steps"),
    )
    qtbot.addWidget(form)
    row = form.rows["speeds_rpm"]
    row.editor.setText("7,5 15")  # type: ignore[union-attr]
    assert row.problem == "Write decimals with a point: 7.5 15, and spaces between numbers"
    row.editor.setText("7.5 15")  # type: ignore[union-attr]
    assert form.is_valid


def test_a_gear_card_says_what_its_confirmation_waits_for(
    session: WindowSession, qtbot: QtBot
) -> None:
    gear = GearSection(session)
    qtbot.addWidget(gear)
    gear.set_operator("")
    assert "The serial number is missing." in gear.status.text()
    gear.form.rows["serial"].editor.setText("SN-1")  # type: ignore[union-attr]
    assert "The operator has to be named first." in gear.status.text()
    gear.set_operator("A. Example")
    gear.form.rows["hours"].editor.setText("many")  # type: ignore[union-attr]
    assert "A field is refused" in gear.status.text()


@pytest.mark.parametrize(
    ("serial", "hours", "operator", "says", "field"),
    [
        ("", "", "A. Example", "The serial number is missing.", "serial"),
        ("SN-1", "many", "A. Example", "A field is refused", "hours"),
        ("SN-1", "", "", "The operator has to be named first.", None),
    ],
)
def test_a_refused_confirmation_says_why_at_the_button_and_shows_the_field(
    serial: str,
    hours: str,
    operator: str,
    says: str,
    field: str | None,
    session: WindowSession,
    qtbot: QtBot,
) -> None:
    gear = GearSection(session)
    qtbot.addWidget(gear)
    gear.show()
    gear.set_operator(operator)
    for name, text in (("serial", serial), ("hours", hours)):
        gear.form.rows[name].editor.setText(text)  # type: ignore[union-attr]
    with qtbot.waitSignal(gear.wanted) as asked:
        qtbot.mouseClick(gear.confirm_button, Qt.MouseButton.LeftButton)
    assert says in gear.refused.text()
    assert gear.refused.isVisible()
    below = gear.refused.mapTo(gear, QPoint()).y() - gear.confirm_button.mapTo(gear, QPoint()).y()
    assert 0 < below < 100, "it stands at the button"
    assert asked.args == [None if field is None else gear.form.rows[field].editor]
    # Once it is put right, the refusal is gone.
    gear.set_operator("A. Example")
    gear.form.rows["serial"].editor.setText("SN-1")  # type: ignore[union-attr]
    gear.form.rows["hours"].editor.setText("")  # type: ignore[union-attr]
    assert gear.refused.isHidden()
    qtbot.mouseClick(gear.confirm_button, Qt.MouseButton.LeftButton)
    assert "value part, mounting" in gear.refused.text()
    assert gear.form.rows["part"].problem
    assert gear.form.rows["mounting"].problem
    for name, text in (("part", "csf-25-120"), ("mounting", "circular-spline-fixed")):
        gear.form.rows[name].set_value(text)
    qtbot.mouseClick(gear.confirm_button, Qt.MouseButton.LeftButton)
    assert gear.refused.isHidden(), gear.refused.text()
    assert gear.is_confirmed
    assert card_for(session.folder, "SN-1") is not None


@pytest.fixture
def page(session: WindowSession, qtbot: QtBot) -> PreparePage:
    """The page over a folder in which a gear with a very long serial number is known, and who was here last."""
    facts = {"serial": LONG, "part": "csf-25-120", "mounting": "circular-spline-fixed"}
    changed = with_changes(None, facts, "A. Example", now_text())
    save_card(session.folder, with_confirmation(changed, "A. Example", now_text()))
    session.remember("gear", LONG)
    session.remember("operators", ["A. Example"])
    made = PreparePage(session)
    qtbot.addWidget(made)
    made.resize(1366, 700)
    made.show()
    return made


def test_a_very_long_serial_number_cuts_nothing_off(page: PreparePage, qtbot: QtBot) -> None:
    area = page.findChild(QScrollArea)
    assert area is not None
    assert page.gear.choice.currentData() == LONG
    inner = area.widget()
    assert inner is not None
    qtbot.waitUntil(lambda: area.viewport().width() >= inner.width())
    page.looking_ahead.wait()


def test_a_whole_name_is_offered_nothing_more(page: PreparePage, qtbot: QtBot) -> None:
    page.activateWindow()
    completer = page.operator.completer()
    assert completer is not None
    offered = completer.popup()
    assert offered is not None
    qtbot.waitUntil(page.operator.hasFocus)
    qtbot.keyClicks(page.operator, "A. Exampl")
    assert offered.isVisible()
    qtbot.keyClicks(page.operator, "e")
    qtbot.waitUntil(lambda: not offered.isVisible())
    page.looking_ahead.wait()


def test_a_drill_that_the_search_has_hidden_is_not_run(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(
        BackgroundCommand, "start", lambda self: started.append(self._arguments[2:])
    )
    dialog = TrainingDialog()
    qtbot.addWidget(dialog)
    dialog.search.setText("guard")
    qtbot.mouseClick(dialog.run_button, Qt.MouseButton.LeftButton)
    assert started == [["sim", "drill", "--fault", "guard opened in motion", "--json"]]
    dialog.show_verdict(None, 6, "")
    dialog.search.setText("no such thing")
    assert not dialog.run_button.isEnabled()
    assert dialog.what.text() == "No drill is called so."


def test_every_fact_of_a_card_has_a_printed_unit() -> None:
    for field in parameter_fields(GearFacts):
        assert "2" not in printed(field.unit)
        assert printed(field.unit) != "um"


def test_a_card_made_elsewhere_is_offered_while_the_page_is_open(
    page: PreparePage, session: WindowSession, qtbot: QtBot
) -> None:
    page.looking_ahead.wait()
    assert page.gear.choice.findData("SN-7") < 0
    facts = {"serial": "SN-7", "part": "csf-25-120", "mounting": "circular-spline-fixed"}
    save_card(session.folder, with_changes(None, facts, "D. Fourth", now_text()))
    qtbot.waitUntil(lambda: page.gear.choice.findData("SN-7") >= 0, timeout=LONGEST)
    assert page.gear.choice.currentData() == LONG, "what is chosen stays"
    page.looking_ahead.wait()
