"""The Prepare page: the gear that is mounted, who runs it, the protocol, what it will do, the checklist, and Start.

The page only gathers and shows; `prepare_request` plans, previews and checks, in a thread of its
own, so that typing is never held up. Start is one button that says what it is waiting for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QHideEvent, QShowEvent
from PySide6.QtWidgets import (
    QCompleter,
    QFrame,
    QHBoxLayout,
    QLineEdit,
    QStackedWidget,
    QWidget,
)

from experiments.errors import ExperimentError
from experiments.finding import Finding, Severity
from model.errors import ModelError
from rig.content.phrase import counted, phrase
from rig.errors import RigError
from rig.window.prepare.campaign import look_ahead_campaign
from rig.window.prepare.checklist import Checklist
from rig.window.prepare.checklist_doctor import checks_from
from rig.window.prepare.form import refusal_text
from rig.window.prepare.gear import GearSection
from rig.window.prepare.handover import handed_over, summary_of
from rig.window.prepare.preview_plot import (
    PreviewPlots,
    short_name,
)
from rig.window.prepare.protocol import ProtocolSection
from rig.window.prepare.request import (
    Intent,
    Outlook,
    RigChoice,
    commission_arguments,
    doctor_arguments,
    is_armed,
    look_ahead,
    obstacles,
    sign_off_notes,
    to_be_typed,
    write_parameters,
)
from rig.window.prepare.status_page import StatusPageChoice
from rig.window.prepare.walk_table import WalkTable
from rig.window.shell.sentence import first_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    in_row,
    line_field,
    push_button,
    restyled,
    room_for,
    scrolled,
    set_tip,
    split,
    text_label,
)
from rig.window.work.background import LatestTask, single_shot
from rig.window.work.child import Ending, RunProcess
from rig.window.work.prepared import PreparedCommission

TYPING_PAUSE = 250
"""ms without a change after which the plan is worked out anew."""
_LEAST_PREVIEW = 120
"""Logical pixels of the height of the preview at least."""
_OPERATORS_KEPT = 12
"""Names that are offered again."""


class PreparePage(QWidget):
    """Everything that is decided before a run. `start_requested` carries a `PreparedRun`; `asking_changed` says that
    `rig doctor` has begun or ended, which may turn the rig.
    """

    start_requested = Signal(object)
    asking_changed = Signal()

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.outlook: Outlook | None = None
        self.looking_ahead = LatestTask(self, self._take_outlook, session.message.emit)
        """Works out what a run as the page says it would do."""
        self.doctor_checks: tuple[Finding, ...] = ()
        """What the rig answered for this run."""
        self._timer = single_shot(self, TYPING_PAUSE, self._look_ahead)
        self.operator = self._operator_field()
        self.gear = GearSection(session)
        self.protocol = ProtocolSection(session)
        self.plots, self.walk = PreviewPlots(session), WalkTable(session)
        self.preview = QStackedWidget()
        self.summary, self.refusal = text_label(wraps=True), text_label(wraps=True)
        self.checklist = Checklist()
        self.confirmation = line_field("Confirmation")
        self.start_button = push_button("&Start the run", "primary", act=self.start)
        self.sign_button = push_button("Sign &all", act=self.checklist.tick_all)
        self.doctor_button = push_button(
            "Ask the &rig",
            tip="Connect and look: nodes, directions, torque zero, limits (rig doctor)",
            act=self.ask_the_rig,
        )
        self.commission_button = push_button(
            "&Commission …",
            tip="Take a new bench through its first hour, stage by stage (rig commission)",
            act=self._commission_bench,
        )
        self.status_page = StatusPageChoice(session)
        self.training_button = push_button("&Training …", act=self.open_training)
        self.acknowledge_button = push_button("Ac&knowledge the trip …", act=self.acknowledge_trip)
        self.waiting = text_label(wraps=True)
        self._start_process: Callable[[Sequence[str]], RunProcess] = RunProcess
        self._doctor: RunProcess | None = None
        self._examination: dict[str, Any] | None = None
        self._lay_out()
        self._connect()
        self._show_for_protocol()
        self._ask_for_outlook()

    def _operator_field(self) -> QLineEdit:
        names = [str(name) for name in self._session.recall("operators", [])]
        last = self._session.operator
        field = line_field("Operator", "your name" + phrase(" (last here: {})", last))
        completer = QCompleter(names)
        completer.setCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        # An open list takes the next click wherever it goes: once the name is whole, it has nothing more to offer.
        offered = completer.popup()
        if offered is not None:
            field.textEdited.connect(
                lambda text: text in names and QTimer.singleShot(0, offered.hide)
            )
        field.setCompleter(completer)
        return field

    def _lay_out(self) -> None:
        label = text_label("&Name", buddy=self.operator)
        holder = room_for(
            in_row(label, (self.operator, 1), self.status_page.button, margins=(0, 0, 0, 0))
        )
        self.gear_card = _card("2  Gear", self.gear)
        inner = room_for(
            in_column(
                _card("1  Operator", holder),
                self.gear_card,
                _card("3  Campaign or protocol", self.protocol),
                (None, 1),
                margins=(8, 8, 8, 8),
                spacing=8,
            )
        )
        scroll = self._scroll = scrolled(inner)
        scroll.setMinimumWidth(340)
        whole = split(scroll, (self._right_side(), 1), sizes=[440, 900])
        self.setLayout(in_column((whole, 1), margins=(0, 0, 0, 0)))

    def _right_side(self) -> QWidget:
        for view in (self.plots, self.walk):
            self.preview.addWidget(view)
        preview = room_for(
            in_column(self.summary, self.refusal, (self.preview, 1), margins=(8, 8, 8, 4))
        )
        title = text_label("4  Pre-flight", "heading")
        # The one whose words change stands first, so that no other moves under the mouse.
        head = in_row(
            title,
            (None, 1),
            self.acknowledge_button,
            self.sign_button,
            self.training_button,
            self.commission_button,
            self.doctor_button,
        )
        checks = room_for(in_column(head, (scrolled(self.checklist), 1), margins=(8, 4, 8, 0)))
        both = split((preview, 3), (checks, 2), sizes=[420, 220], way=Qt.Orientation.Vertical)
        # On a small screen the checklist and Start keep their room, and the preview gives way.
        preview.setMinimumHeight(_LEAST_PREVIEW)
        start = in_row(self._start_row(), margins=(8, 4, 8, 8))
        return room_for(in_column((both, 1), start, margins=(0, 0, 0, 0), spacing=0))

    def _start_row(self) -> QHBoxLayout:
        self.confirmation.setMaximumWidth(240)
        self.confirmation.setVisible(self._session.is_hardware)
        # What has no bus has no devices that could be met.
        has_bus = self._session.is_hardware or self._session.backend.startswith("wire")
        self.commission_button.setVisible(has_bus)
        self.start_button.setMinimumHeight(36)
        return in_row((self.waiting, 1), self.confirmation, self.start_button)

    def _connect(self) -> None:
        self.operator.textChanged.connect(self.gear.set_operator)
        self.gear.wanted.connect(self._show_wanted)
        self.gear.new.wanted.connect(self._show_wanted)
        for signal in (
            self.operator.textChanged,
            self.confirmation.textChanged,
            self.gear.changed,
            self.protocol.changed,
        ):
            signal.connect(lambda *_: self._ask_for_outlook())
        self.status_page.button.clicked.connect(lambda *_: self._ask_for_outlook())
        self.protocol.changed.connect(self._show_for_protocol)
        self.checklist.changed.connect(self._show_readiness)
        self.acknowledge_button.hide()
        self.training_button.setVisible(not self._session.is_hardware)
        self._session.runs_changed.connect(self._ask_for_outlook)

    @property
    def intent(self) -> Intent:
        """What the page says now."""
        shared = self._session
        kept = self.status_page.kept
        rig = RigChoice(shared.backend, shared.folder, shared.configuration, kept)
        mounted = self.protocol.gear_mounted
        return Intent(
            rig=rig,
            protocol=self.protocol.protocol,
            values=self.protocol.values,
            facts=self.gear.facts if mounted else None,
            card=self.gear.card if mounted else None,
            operator=self.operator.text().strip(),
            confirmation=self.confirmation.text(),
            campaign=self.protocol.campaign,
            anew=bool(self.protocol.campaign) and self.protocol.anew.isChecked(),
        )

    @property
    def obstacles(self) -> list[str]:
        """What Start is waiting for, the most important first; nothing when the run may begin."""
        if self.is_stale:
            return ["the plan is being worked out"]
        reasons = obstacles(self.intent, self.outlook)
        if not self.protocol.form.is_valid:
            reasons.insert(0, "a parameter of the protocol is refused")
        if self.is_asking:
            reasons.append("the rig is being asked")
        if self._session.is_hardware and not self.doctor_checks:
            reasons.append("the rig has not been asked")
        reasons += [
            f"{check.what}: {check.found}"
            for check in self.doctor_checks
            if check.severity is Severity.BLOCKS
        ]
        left = len(self.checklist.open)
        if left:
            reasons.append(f"{counted(left, 'item', 'items')} of the checklist not signed")
        return reasons

    @property
    def is_stale(self) -> bool:
        """Whether the preview is not yet that of what the page says."""
        under_way = self._timer.isActive() or self.looking_ahead.is_running
        return self.outlook is None or under_way or self.outlook.intent != self.intent

    def start(self) -> None:
        """Hand the prepared run over, if nothing stands in the way."""
        outlook = self.outlook
        if self.obstacles or outlook is None or outlook.order is None:
            self._show_readiness()
            return
        try:
            parameters = write_parameters(outlook.order)
        except (RigError, ModelError) as error:
            self._session.message.emit(str(error))
            return
        order = outlook.order
        notes = sign_off_notes(self.checklist.checks, order.operator)
        prepared = handed_over(outlook, order, parameters, notes)
        self._remember(order.operator, self.protocol.chosen)
        # A signature and a confirmation are for one run.
        self.checklist.clear_ticks()
        self.confirmation.clear()
        self.doctor_checks = ()
        self.start_requested.emit(prepared)

    def _show_wanted(self, field: QWidget | None) -> None:
        """Bring the field into view that a refusal waits for, and let it be typed into."""
        widget = field or self.operator
        self.scroll_to(widget)
        widget.setFocus()

    def scroll_to(self, widget: QWidget) -> None:
        """Bring something of the left side into view."""
        self._scroll.ensureWidgetVisible(widget)

    def ask_the_rig(self) -> None:
        """Run `rig doctor` on the rig of this window. A rig of hardware turns only once it is armed."""
        if self.is_asking:
            return
        intent, order, parameters = self.intent, None, None
        if self.outlook is not None and not self.is_stale and self.outlook.order is not None:
            order = self.outlook.order
            try:
                parameters = write_parameters(order)
            except (RigError, ModelError) as error:
                self._session.message.emit(str(error))
                return
        confirmation = intent.confirmation.strip() if is_armed(intent) else ""
        words = doctor_arguments(order, intent.rig, confirmation, parameters)
        self._examination = None
        self._doctor = self._start_process(words)
        self._doctor.report.connect(self._keep_examination)
        self._doctor.finished.connect(self._take_doctor)
        self._doctor.start()
        self.doctor_button.setEnabled(False)
        self.doctor_button.setText("Asking the rig … (Esc stops)")
        self.asking_changed.emit()

    def _commission_bench(self) -> None:
        """Begin, or go on with, the commissioning of the bench of this window. A rig of hardware has to be armed."""
        intent, outlook = self.intent, self.outlook
        order = outlook.order if outlook is not None and not self.is_stale else None
        if order is None or not order.operator:
            self._session.message.emit(
                "Name operator and gear first: each stage is recorded with them."
            )
            return
        if intent.rig.is_hardware and not is_armed(intent):
            self._session.message.emit(
                "Type the gear's serial number beside Start: it arms the commissioning."
            )
            return
        try:
            parameters = write_parameters(order)
        except (RigError, ModelError) as error:
            self._session.message.emit(str(error))
            return
        words = commission_arguments(order, intent.confirmation.strip(), parameters)
        self.confirmation.clear()
        self.start_requested.emit(PreparedCommission(words, "Commissioning"))

    def stop_asking(self) -> None:
        """Let what turns for `rig doctor` ramp to standstill, and end it."""
        if self._doctor is not None:
            self._doctor.stop()

    def abort_asking(self) -> None:
        """The same by a quick stop."""
        if self._doctor is not None:
            self._doctor.abort()

    def acknowledge_trip(self) -> None:
        """Show the trip that is latched; it is released by name and with what was found."""
        from rig.window.prepare.latch import AcknowledgeDialog

        if self._session.free_for("The acknowledgement"):
            AcknowledgeDialog(self.intent.rig.latch(), self.operator.text().strip(), self).exec()
            self._ask_for_outlook()

    def open_training(self) -> None:
        """Open the training drills; nothing of them exists where hardware is."""
        if self._session.is_hardware or not self._session.free_for("Training"):
            return
        from rig.window.prepare.training import TrainingDialog

        TrainingDialog(self).exec()

    def showEvent(self, event: QShowEvent) -> None:
        """Coming back, look again: cards, latch and disk may have changed."""
        super().showEvent(event)
        if not self.operator.text():
            self.operator.setFocus()
        self.gear.refresh()
        self._ask_for_outlook()

    def hideEvent(self, event: QHideEvent) -> None:
        """Nothing is worked out for a page that nobody sees."""
        self._timer.stop()
        super().hideEvent(event)

    def _remember(self, operator: str, protocol: str) -> None:
        names = [
            operator,
            *(name for name in self._session.recall("operators", []) if name != operator),
        ]
        self._session.remember("operators", names[:_OPERATORS_KEPT])
        self._session.remember("operator", operator)
        self._session.remember("protocol", protocol)

    def _show_for_protocol(self) -> None:
        self.gear_card.setEnabled(self.protocol.gear_mounted)
        rig = RigChoice(self._session.backend, self._session.folder, self._session.configuration)
        what = to_be_typed(rig, self.protocol.gear_mounted)
        self.confirmation.setPlaceholderText(f"type {what} to arm")
        # A campaign is armed run by run, on the page Run.
        once = not self.protocol.campaign
        self.confirmation.setVisible(self._session.is_hardware and once)
        self.start_button.setText("&Start the run" if once else "&Start the campaign")

    def _ask_for_outlook(self) -> None:
        self._timer.start()
        self._show_readiness()

    def _look_ahead(self) -> None:
        intent = self.intent
        look = look_ahead_campaign if intent.campaign else look_ahead
        self.looking_ahead.start(lambda: look(intent))

    def _take_outlook(self, outlook: Outlook) -> None:
        self.outlook = outlook
        self._show_outlook(outlook)
        self._show_readiness()

    def _show_outlook(self, outlook: Outlook) -> None:
        preview, problem = outlook.preview, outlook.problem
        self.protocol.form.check()
        if isinstance(problem, ExperimentError):
            self.protocol.form.mark(problem.where, refusal_text(problem))
        self.plots.show_preview(preview)
        self.walk.show_walk(outlook.walk, outlook.done)
        self.preview.setCurrentWidget(self.walk if outlook.intent.campaign else self.plots)
        self.protocol.allow_anew(any(outlook.done))
        self.summary.setText(summary_of(outlook))
        lines = [f"! {warning.text}" for warning in preview.warnings] if preview is not None else []
        if problem is not None:
            lines = [f"✗ {problem}"]
        self.refusal.setText("\n".join(lines))
        self.refusal.setVisible(bool(lines))
        restyled(self.refusal, "bad" if problem is not None else "warning")
        self.checklist.set_checks((*outlook.checks, *self.doctor_checks))

    @property
    def is_asking(self) -> bool:
        """Whether `rig doctor` is at work."""
        return self._doctor is not None and self._doctor.is_running

    def _keep_examination(self, examination: dict[str, Any]) -> None:
        self._examination = examination

    def _take_doctor(self, ending: Ending) -> None:
        self.asking_changed.emit()
        self.show_doctor(self._examination, ending.code, ending.complaint)

    def show_doctor(self, answer: dict[str, Any] | None, code: int, complaint: str) -> None:
        """Take over what `rig doctor` said: its JSON object, exit code, standard error."""
        self.doctor_button.setEnabled(True)
        self._name_doctor_button()
        self.doctor_checks = checks_from(answer, code, complaint)
        self.checklist.set_checks(
            (*(self.outlook.checks if self.outlook else ()), *self.doctor_checks)
        )
        self._show_readiness()

    def _name_doctor_button(self) -> None:
        if self.is_asking:
            return
        moves = self._session.is_hardware and is_armed(self.intent)
        self.doctor_button.setText("Ask the &rig (it will turn)" if moves else "Ask the &rig")

    def _show_readiness(self) -> None:
        reasons = self.obstacles
        self._name_doctor_button()
        self.start_button.setEnabled(not reasons)
        name = self.operator.text().strip()
        self.sign_button.setText("Sign &all" + phrase(" as {}", short_name(name)))
        self.sign_button.setEnabled(bool(name) and bool(self.checklist.open))
        self.acknowledge_button.setVisible(
            any(check.what == "trip latch" for check in self.checklist.failed)
        )
        self.acknowledge_button.setEnabled(bool(name))
        set_tip(self.acknowledge_button, "" if name else "The operator has to be named first")
        set_tip(self.start_button, "\n".join(reasons) or "Ctrl+2 shows the run")
        if reasons:
            self.waiting.setText(f"Start waits: {first_of(reasons)}")
            set_tip(self.waiting, "\n".join(reasons))
        else:
            self.waiting.setText("✓ Ready.")
        restyled(self.waiting, "muted" if reasons else "good")


def _card(title: str, content: QWidget) -> QFrame:
    frame = QFrame()
    frame.setProperty("part", "card")
    heading = text_label(title, "heading")
    frame.setLayout(in_column(heading, content, margins=(12, 8, 12, 10)))
    return frame
