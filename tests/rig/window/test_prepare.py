"""The Prepare page as a person uses it: fill in wrong and right, confirm, sign, start; by keyboard;
at both screen sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import typer
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QWidget,
)
from pytestqt.qtbot import QtBot

from experiments.finding import Finding, Severity
from rig.bench.backends.order import WORDS
from rig.commands.running import read_protocol
from rig.gears.card import card_for, now_text, save_card, with_changes, with_confirmation
from rig.main import app
from rig.run.latch import HISTORY_NAME, LatchedTrip, TripLatch
from rig.run.ordering import order_of
from rig.run.start import plan_order
from rig.window.prepare.checklist import Checklist
from rig.window.prepare.checklist_doctor import checks_from
from rig.window.prepare.latch import AcknowledgeDialog
from rig.window.prepare.page import PreparePage
from rig.window.prepare.training import TrainingDialog, verdict_text
from rig.window.shell.session import WindowSession
from rig.window.work.background import BackgroundCommand, json_object
from rig.window.work.prepared import PreparedRun
from tests.rig.window.conftest import SilentRun

LONGEST = 600_000
"""ms until a test gives up; nothing takes a tenth of it on an idle computer."""
CARD = {
    "serial": "SN-0815",
    "part": "csf-25-120",
    "mounting": "circular-spline-fixed",
    "lubricant": "Harmonic Grease SK-1A",
    "hours": "12",
    "load_inertia_kg_m2": "0.08",
    "load_inertia_uncertainty_kg_m2": "0.002",
}

Settle = Callable[[PreparePage], None]


def is_signed(items: Checklist) -> bool:
    """Whether there are items, none failed, all ticked."""
    return bool(items.checks) and not items.failed and not items.open


@pytest.fixture
def settle(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> Iterator[Settle]:
    """Waits until a page has worked out what it was told last; at the end, until no thread works any more."""
    monkeypatch.setattr("rig.window.prepare.page.TYPING_PAUSE", 15)

    pages: list[PreparePage] = []

    def wait(page: PreparePage) -> None:
        pages.append(page)
        qtbot.waitUntil(lambda: not page.is_stale, timeout=LONGEST)

    yield wait
    for page in pages:
        page.looking_ahead.wait()


@pytest.fixture
def page(session: WindowSession, qtbot: QtBot, settle: Settle) -> PreparePage:
    """A page on which nothing is known yet."""
    return shown(session, qtbot, settle)


def shown(
    session: WindowSession, qtbot: QtBot, settle: Settle, size: tuple[int, int] = (1366, 700)
) -> PreparePage:
    made = PreparePage(session)
    qtbot.addWidget(made)
    made.resize(*size)
    made.show()
    settle(made)
    return made


def stored_card(folder: Path) -> None:
    save_card(
        folder,
        with_confirmation(
            with_changes(None, CARD, "A. Example", now_text()), "A. Example", now_text()
        ),
    )


def type_into(qtbot: QtBot, editor: QWidget, text: str) -> None:
    """Replace what stands in a field, by keyboard."""
    if isinstance(editor, QComboBox):
        editor.setCurrentText(text)
        return
    assert isinstance(editor, QLineEdit)
    editor.setFocus()
    editor.selectAll()
    qtbot.keyClicks(editor, text) if text else editor.clear()


def click(qtbot: QtBot, button: QPushButton) -> None:
    assert button.isEnabled()
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def parsed(arguments: list[str]) -> tuple[dict[str, Any], str, dict[str, Any]]:
    """What `rig run` makes of arguments: its options, the protocol, and the values of the protocol's flags."""
    command: Any = typer.main.get_command(app)
    run = command.commands["run"]
    assert arguments[0] == "run"
    with run.make_context("run", list(arguments[1:])) as context:
        return dict(context.params), *read_protocol(context.args)


def test_a_gear_is_told_confirmed_and_remembered(
    page: PreparePage, session: WindowSession, qtbot: QtBot, settle: Settle
) -> None:
    assert page.gear.facts is None
    assert not page.start_button.isEnabled()
    click(qtbot, page.gear.confirm_button)
    assert "serial number is missing" in page.gear.refused.text()
    assert page.gear.form.rows["serial"].editor.hasFocus()
    type_into(qtbot, page.operator, "A. Example")
    for name, text in CARD.items():
        type_into(qtbot, page.gear.form.rows[name].editor, text)
    settle(page)
    assert "gear card" in page.waiting.text()
    assert not page.gear.is_confirmed
    click(qtbot, page.gear.confirm_button)
    settle(page)
    card = card_for(session.folder, "SN-0815")
    assert card is not None
    assert card.is_confirmed
    assert card.confirmation is not None
    assert card.confirmation.by == "A. Example"
    assert "Confirmed by A. Example" in page.gear.status.text()
    assert [check.what for check in page.checklist.failed] == []
    assert not page.gear.form.isVisible()
    assert "0.08 ± 0.002 kg m²" in page.gear.digest.text()
    click(qtbot, page.gear.details_button)
    assert page.gear.form.isVisible()
    # What is changed afterwards waits for its confirmation; undone, it is as it was.
    type_into(qtbot, page.gear.form.rows["load_inertia_kg_m2"].editor, "0.2")
    settle(page)
    assert [check.what for check in page.checklist.failed] == ["gear card"]
    click(qtbot, page.gear.revert_button)
    settle(page)
    assert page.gear.is_confirmed
    assert page.checklist.failed == ()
    # Another window of another day shows the same gear.
    again = shown(WindowSession(session.folder), qtbot, settle)
    assert again.gear.form.values()["serial"] == "SN-0815"
    assert again.gear.is_confirmed
    assert again.operator.text() == ""


def test_a_known_gear_is_not_forgotten_by_an_empty_form_and_changes_elsewhere_are_seen(
    session: WindowSession, qtbot: QtBot, settle: Settle
) -> None:
    stored_card(session.folder)
    page = shown(session, qtbot, settle)
    assert page.gear.facts is None
    type_into(qtbot, page.operator, "C. Third")
    for name in ("serial", "part", "mounting"):
        type_into(qtbot, page.gear.form.rows[name].editor, CARD[name])
    click(qtbot, page.gear.confirm_button)
    card = card_for(session.folder, "SN-0815")
    assert card is not None
    assert card.facts.lubricant == CARD["lubricant"]
    assert card.confirmation is not None
    assert card.confirmation.by == "A. Example"
    assert page.gear.form.values()["lubricant"] == CARD["lubricant"]
    save_card(
        session.folder, with_changes(card, {"lubricant": "another grease"}, "D. Fourth", now_text())
    )
    page.hide()
    page.show()
    settle(page)
    assert page.gear.form.values()["lubricant"] == "another grease"
    assert not page.gear.is_confirmed
    assert "lubricant by D. Fourth" in page.gear.status.text()


WRONG = {
    "highest_rpm": ("0", "out of range"),
    "points": ("3.5", "a whole number"),
    "settle_time": ("soon", "a number"),
    "speeds_rpm": ("100 -3", "> 0"),
}
"""What is typed into a field of the friction protocol, and a word of the refusal."""


def test_a_wrong_parameter_is_marked_at_its_field_in_the_model_s_words(
    page: PreparePage, qtbot: QtBot, settle: Settle
) -> None:
    page.protocol.choose("friction")
    for name, (text, words) in WRONG.items():
        row = page.protocol.form.rows[name]
        before = str(row.value)
        type_into(qtbot, row.editor, text)
        assert words in row.note.text()
        assert row.editor.property("invalid") == "true"
        settle(page)
        assert words in row.note.text()
        assert page.outlook is not None
        assert page.outlook.preview is None
        assert "a parameter of the protocol is refused" in page.obstacles
        type_into(qtbot, row.editor, before)
        assert page.protocol.form.is_valid
    settle(page)
    assert page.outlook is not None
    assert page.outlook.preview is not None


def test_refusals_of_the_whole_plan_name_step_value_and_limit(
    page: PreparePage, qtbot: QtBot, settle: Settle
) -> None:
    page.protocol.choose("friction")
    # Impossible together: marked at the field that the plan names.
    type_into(qtbot, page.protocol.form.rows["lowest_rpm"].editor, "4000")
    settle(page)
    assert "below the lowest" in page.protocol.form.rows["highest_rpm"].note.text()
    click(qtbot, page.protocol.defaults_button)
    # Possible, but beyond a limit of rig or gear: told with the step, the value, the limit and a remedy.
    type_into(qtbot, page.protocol.form.rows["acceleration"].editor, "19000")
    settle(page)
    told = page.refusal.text()
    for word in ("acceleration", "step ", "19000|1.9e+04", "allowed", "Lower the acceleration"):
        assert any(part in told for part in word.split("|")), told
    assert page.refusal.isVisible()
    assert not page.start_button.isEnabled()


def test_start_hands_over_a_run_whose_arguments_the_command_understands(
    session: WindowSession, qtbot: QtBot, settle: Settle, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    page = shown(session, qtbot, settle)
    type_into(qtbot, page.operator, "--A. Example")
    page.protocol.choose("velocity-steps")
    status = session.folder / "status.html"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *words: (str(status), ""))
    click(qtbot, page.status_page.button)
    type_into(qtbot, page.protocol.form.rows["speeds_rpm"].editor, "300 900")
    type_into(qtbot, page.protocol.form.rows["repeats"].editor, "1")
    settle(page)
    assert page.obstacles == [f"{len(page.checklist.checks)} items of the checklist not signed"]
    click(qtbot, page.sign_button)
    assert is_signed(page.checklist)
    assert "Ready" in page.waiting.text()
    with qtbot.waitSignal(page.start_requested, timeout=LONGEST) as caught:
        click(qtbot, page.start_button)
    assert caught.args is not None
    prepared = caught.args[0]
    assert isinstance(prepared, PreparedRun)
    assert prepared.arguments[-2:] == ["--events", "--stdin-control"]
    options, protocol, values = parsed(prepared.arguments)
    assert (protocol, values) == ("velocity-steps", {"speeds_rpm": "300 900", "repeats": "1"})
    assert options["operator"] == "--A. Example"
    assert options["serial"] == "SN-0815"
    assert options["folder"] == session.folder
    assert options["events"]
    assert options["status"] == status
    click(qtbot, page.status_page.button)
    assert page.status_page.kept is None
    # What the child will plan is what was shown.
    child = plan_order(
        order_of(protocol, values, {k: options[k] for k in WORDS if options.get(k) is not None})
    )
    assert child.as_json() == prepared.planned.as_json()
    assert child.gear.inertia.output == 0.08
    assert prepared.order.conditions["lubricant"] == "Harmonic Grease SK-1A"
    assert prepared.prediction is not None
    assert prepared.notes[0].startswith(
        "checklist signed by --A. Example: gear card, parameters, plan"
    )
    assert any(note.startswith("accepted by --A. Example: ratings: ") for note in prepared.notes)
    # The next run is another run: it is signed anew.
    assert not is_signed(page.checklist)
    assert not page.start_button.isEnabled()


def test_a_latched_trip_and_unsigned_items_stand_in_the_way(
    session: WindowSession, qtbot: QtBot, settle: Settle
) -> None:
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    latch = TripLatch(session.folder).path
    latch.write_text(
        '{"cause": "over-torque", "run": "00007", "time": "2026-01-01", "standstill_verified": true}'
    )
    page = shown(session, qtbot, settle)
    assert any("over-torque" in reason for reason in page.obstacles)
    box = next(
        b
        for b, c in zip(page.checklist.boxes, page.checklist.checks, strict=True)
        if c.what == "trip latch"
    )
    assert not box.isEnabled()
    assert page.acknowledge_button.isVisible()
    assert not page.acknowledge_button.isEnabled()
    latch.unlink()
    session.runs_changed.emit()
    settle(page)
    assert page.obstacles[0] == "no operator is named"
    assert not page.acknowledge_button.isVisible()


def test_a_trip_is_acknowledged_by_name_with_what_was_found(
    session: WindowSession, qtbot: QtBot
) -> None:
    latch = TripLatch(session.folder)
    latch.leave(LatchedTrip("speed", "00007-friction-SN_0815", "2026-01-01", "too fast", False))
    dialog = AcknowledgeDialog(latch, "A. Example")
    qtbot.addWidget(dialog)
    assert "Standstill was NOT verified" in dialog.what.text()
    assert not dialog.accept_button.isEnabled()
    qtbot.keyClicks(dialog.remark, "coupling was loose")
    click(qtbot, dialog.accept_button)
    assert latch.read() is None
    kept = (session.folder / HISTORY_NAME).read_text(encoding="utf-8")
    assert '"acknowledged_by": "A. Example"' in kept
    assert "coupling was loose" in kept
    dialog.acknowledge()
    assert "no trip is latched here" in dialog.problem.text()


def test_without_a_gear_no_card_is_asked_for(
    page: PreparePage, qtbot: QtBot, settle: Settle
) -> None:
    type_into(qtbot, page.operator, "A. Example")
    page.protocol.choose("motor-tare")
    settle(page)
    assert not page.gear_card.isEnabled()
    assert page.outlook is not None
    assert page.outlook.order is not None
    assert page.outlook.order.serial == "unknown"
    assert "gear card" not in [check.what for check in page.checklist.checks]
    assert "mounting" not in page.protocol.form.rows
    click(qtbot, page.sign_button)
    assert page.start_button.isEnabled()


def test_hardware_asks_for_the_rig_s_answer_and_a_typed_confirmation(
    tmp_path: Path, qtbot: QtBot, settle: Settle
) -> None:
    configuration = tmp_path / "rig.toml"
    configuration.write_text(
        (resources.files("rig.bench.config") / "template.toml")
        .read_text(encoding="utf-8")
        .replace('id = ""', 'id = "bench-1"'),
        encoding="utf-8",
    )
    session = WindowSession(tmp_path / "runs", "hardware", configuration)
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    session.remember("protocol", "kinematic-error")
    page = shown(session, qtbot, settle)
    assert page.confirmation.isVisible()
    assert not page.training_button.isVisible()
    type_into(qtbot, page.operator, "A. Example")
    settle(page)
    click(qtbot, page.sign_button)
    assert "the run was not confirmed" in page.obstacles[0]
    assert "the rig has not been asked" in page.obstacles
    type_into(qtbot, page.confirmation, "sn-0815")
    settle(page)
    assert "the run was not confirmed" in page.obstacles[0]
    assert "it will turn" not in page.doctor_button.text()
    type_into(qtbot, page.confirmation, "SN-0815")
    settle(page)
    assert "it will turn" in page.doctor_button.text()
    silent = Finding("nodes", Severity.BLOCKS, "node 1 is silent")
    page.show_doctor({"checks": [silent.as_json()]}, 6, "")
    assert page.obstacles[0] == "nodes: node 1 is silent"
    all_there = Finding("nodes", Severity.PASSED, "3 of 3")
    page.show_doctor({"checks": [all_there.as_json()]}, 0, "")
    click(qtbot, page.sign_button)
    with qtbot.waitSignal(page.start_requested, timeout=LONGEST) as caught:
        click(qtbot, page.start_button)
    assert caught.args is not None
    options, *_ = parsed(caught.args[0].arguments)
    assert (options["backend"], options["confirm"], options["config"]) == (
        "hardware",
        "SN-0815",
        configuration,
    )
    assert page.confirmation.text() == ""
    settle(page)
    assert "the rig has not been asked" in page.obstacles


def test_limits_that_were_set_by_hand_are_typed_again_with_the_gear(
    tmp_path: Path, qtbot: QtBot, settle: Settle
) -> None:
    configuration = tmp_path / "rig.toml"
    configuration.write_text(
        (resources.files("rig.bench.config.examples") / "paper-sgdv-vref.toml")
        .read_text(encoding="utf-8")
        .replace('id = ""', 'id = "bench-1"'),
        encoding="utf-8",
    )
    session = WindowSession(tmp_path / "runs", "hardware", configuration)
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    session.remember("protocol", "kinematic-error")
    page = shown(session, qtbot, settle)
    assert "0.637 N m 3000 r/min" in page.confirmation.placeholderText()
    type_into(qtbot, page.operator, "A. Example")
    type_into(qtbot, page.confirmation, "SN-0815")
    settle(page)
    assert "the run was not confirmed" in page.obstacles[0]
    type_into(qtbot, page.confirmation, "SN-0815 0.637 N m 3000 r/min")
    settle(page)
    assert "it will turn" in page.doctor_button.text()


def test_a_tick_belongs_to_its_evidence(qtbot: QtBot) -> None:
    items = Checklist()
    qtbot.addWidget(items)
    one, two = (
        Finding("zero", Severity.PASSED, "1.2 mN m"),
        Finding("disk", Severity.WARNS, "little left", "Free some."),
    )
    items.set_checks([one, two])
    assert not is_signed(items)
    items.tick_all()
    assert is_signed(items)
    items.set_checks([one, Finding("disk", Severity.WARNS, "less left")])
    assert [check.found for check in items.open] == ["less left"]
    items.set_checks([one, Finding("disk", Severity.BLOCKS, "full")])
    items.tick_all()
    assert not is_signed(items)
    assert not items.boxes[1].isEnabled()


def test_what_the_doctor_says_or_does_not_say() -> None:
    rows = [
        Finding("bus", Severity.NOT_LOOKED_AT, "none").as_json(),
        Finding("zero", Severity.WARNS, "9 mN m", "Trim it.").as_json(),
    ]
    assert checks_from({"ok": True, "checks": rows}, 0, "") == (
        Finding("zero", Severity.WARNS, "9 mN m", "Trim it."),
    )
    stopped = checks_from({"ok": True, "checks": rows}, 4, "")
    assert [check.severity for check in stopped] == ["blocks", "warns"]
    assert checks_from(None, 2, "Error: No such command 'doctor'.")[0].severity is Severity.WARNS
    assert checks_from(None, 6, "first\nthe bus is gone") == (
        Finding(
            "rig doctor", Severity.BLOCKS, "the bus is gone", "Run `rig doctor` in a terminal."
        ),
    )
    assert checks_from({"checks": []}, 1, "")[0].severity is Severity.BLOCKS


def test_a_background_command_gives_what_it_printed_and_is_ended_with_its_window(
    qtbot: QtBot,
) -> None:
    command = BackgroundCommand(["sim", "drill", "--list", "--json"])
    with qtbot.waitSignal(command.done, timeout=LONGEST) as caught:
        command.start()
    assert caught.args is not None
    assert caught.args[0] == 0
    assert "statusword" in caught.args[1]
    assert json_object('{"faults": []}') == {"faults": []}
    assert json_object("no JSON") is json_object("[1]") is None
    longer = BackgroundCommand(["sim", "drill"])
    longer.start()
    longer.cancel()
    assert not longer.is_running


def test_the_rig_is_asked_once_at_a_time(
    page: PreparePage, monkeypatch: pytest.MonkeyPatch, settle: Settle
) -> None:
    started: list[Sequence[str]] = []
    asked = SilentRun()
    monkeypatch.setattr(SilentRun, "is_running", property(lambda self: bool(started)))
    page._start_process = lambda words: started.append(words) or asked
    settle(page)
    page.ask_the_rig()
    page.ask_the_rig()
    assert len(started) == 1
    assert started[0][0] == "doctor"
    assert not page.doctor_button.isEnabled()
    assert "the rig is being asked" in page.obstacles


def test_training_lists_the_drills_and_tells_the_verdict(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(
        BackgroundCommand, "start", lambda self: started.append(self._arguments[2:])
    )
    dialog = TrainingDialog()
    qtbot.addWidget(dialog)
    dialog.show()
    assert dialog.drills.count() > 20
    type_into(qtbot, dialog.search, "E-stop")
    visible = [
        dialog.drills.item(row)
        for row in range(dialog.drills.count())
        if not dialog.drills.item(row).isHidden()
    ]
    assert 0 < len(visible) < 5
    dialog.drills.setCurrentItem(visible[0])
    click(qtbot, dialog.run_button)
    assert started == [["sim", "drill", "--fault", visible[0].text(), "--json"]]
    row = {
        "fault": "E-stop",
        "detected": "sto",
        "cycles": 2,
        "action": "servo off",
        "safe": True,
        "verified": True,
        "outcome": "TRIPPED",
        "expected": "TRIPPED",
        "file_readable": True,
        "passed": True,
    }
    dialog.show_verdict({"faults": [row]}, 0, "")
    assert dialog.verdict.text() == verdict_text(row)
    assert "ended as it must" in dialog.verdict.text()
    dialog.show_verdict(None, 6, "broken")
    assert "broken" in dialog.verdict.text()


def test_nothing_is_cut_off(session: WindowSession, qtbot: QtBot, settle: Settle) -> None:
    stored_card(session.folder)
    session.remember("gear", "SN-0815")
    page = shown(session, qtbot, settle)
    type_into(qtbot, page.operator, "Somebody With-Quite-A-Long Name")
    page.protocol.choose("velocity-steps")
    for size in ((1366, 700), (1920, 1012), (1120, 580)):
        page.resize(*size)
        settle(page)
        QApplication.processEvents()
        assert (page.width(), page.height()) == size
        for shown_card in (False, True):
            page.gear.details_button.setChecked(shown_card)
            QApplication.processEvents()
            refuse_cut_off(page)


def refuse_cut_off(page: PreparePage) -> None:
    """Fail for any widget that has less room than it needs."""
    for button in page.findChildren(QPushButton):
        if button.isVisible():
            assert button.width() >= button.sizeHint().width(), button.text()
            assert button.height() >= button.sizeHint().height(), button.text()
    for area in page.findChildren(QScrollArea):
        if area.isVisible():
            assert area.widget().width() <= area.viewport().width()
    for label in page.findChildren(QLabel):
        if (
            label.isVisible()
            and label.text()
            and not label.wordWrap()
            and label.textFormat() is not Qt.TextFormat.RichText
        ):
            assert label.width() >= label.sizeHint().width(), label.text()
    assert page.start_button.mapTo(page, page.start_button.rect().bottomRight()).y() < page.height()


def test_the_keyboard_reaches_everything(page: PreparePage, qtbot: QtBot, settle: Settle) -> None:
    shortcuts = []
    for widget in (*page.findChildren(QPushButton), *page.findChildren(QLabel)):
        text = widget.text().replace("&&", "")
        if (
            widget.isVisible()
            and "&" in text
            and (isinstance(widget, QPushButton) or widget.buddy() is not None)
        ):
            shortcuts.append(text[text.index("&") + 1].lower())
    shortcuts += [
        page.plots.tabText(i).partition("&")[2][0].lower() for i in range(page.plots.count())
    ]
    assert len(shortcuts) >= 11
    assert len(set(shortcuts)) == len(shortcuts), shortcuts
    page.operator.setFocus()
    reached: list[QWidget] = []
    for _ in range(120):
        found = QApplication.focusWidget()
        if found is None or found in reached:
            break
        reached.append(found)
        qtbot.keyClick(found, Qt.Key.Key_Tab)
    wanted = [
        *(row.editor for row in page.gear.form.rows.values()),
        *(row.editor for row in page.protocol.form.rows.values()),
    ]
    assert set(wanted) <= set(reached)
    assert (
        reached.index(page.gear.choice)
        < reached.index(wanted[0])
        < reached.index(page.protocol.choice)
    )
    assert page.training_button in reached
