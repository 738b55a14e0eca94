"""The Run page: what the rig is doing, as it does it, and the one large STOP.

The page is the parent of the run (`child`), keeps its state (`run_state`) and draws from its
growing file (`live_plots`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence, QResizeEvent, QShortcut
from PySide6.QtWidgets import (
    QProgressBar,
    QWidget,
)

from drivers.clock import Clock
from experiments.recording import Event
from experiments.steps.note import Prompt
from rig.present.preview.plan import PlanPreview, preview_plan
from rig.run.dry_run import PlannedRun
from rig.run.parts import Progress
from rig.run.progress import in_words
from rig.run.state import MAKING_SAFE, RunState, State
from rig.trial.campaign.walk import Walk
from rig.window.run.banner import Banner, StopButtons, look_of
from rig.window.run.campaign_end import CampaignEnd
from rig.window.run.close_question import CloseQuestion
from rig.window.run.events_view import EventsView
from rig.window.run.live_plots import LivePlots
from rig.window.run.margins_view import MarginBars
from rig.window.run.outcome_view import OutcomeView
from rig.window.run.prompt_view import PromptView
from rig.window.run.stages_view import StageRow, StagesView
from rig.window.shell.session import WindowSession, path_of
from rig.window.shell.stack import (
    in_column,
    in_row,
    push_button,
    room_for,
    scrolled,
    split,
    text_label,
)
from rig.window.work.child import Ending, RunProcess
from rig.window.work.prepared import PreparedCampaign, PreparedCommission, PreparedRun

_SIDE_WIDTH = 330
"""Logical pixels of the column of margins and events."""
_FOLDED_UNDER = 1000
"""Logical pixels of the page under which that column is folded away to begin with."""


class RunPage(QWidget):
    """Watches one run at a time, from its start to its verdict."""

    review_requested = Signal(Path)
    next_gear_requested = Signal()
    """The campaign of a gear is over, and the next one waits to be mounted."""
    state_changed = Signal(str)
    """The word of the state, for whoever shows it elsewhere."""
    closed_safely = Signal()
    """The run that the window waited for has ended in verified standstill: it may close."""

    def __init__(
        self,
        session: WindowSession,
        start_process: Callable[[list[str]], RunProcess] = RunProcess,
        clock: Clock | None = None,
    ) -> None:
        super().__init__()
        self._session, self._start_process = session, start_process
        self.process: RunProcess | None = None
        self.state = RunState()
        self.report: dict[str, Any] = {}
        self.run_report: dict[str, Any] = {}
        """How the latest run ended: of a campaign, its latest one."""
        self._walk: Walk | None = None
        self.close_question = CloseQuestion(session)
        self._title = self._campaign_title = ""
        self._closing = False
        self.banner, self.buttons = Banner(), StopButtons()
        self.prompt, self.outcome = PromptView(session, clock), OutcomeView(session)
        self.campaign_end = CampaignEnd(session)
        self.plots, self.margins, self.events = (
            LivePlots(session),
            MarginBars(session),
            EventsView(session),
        )
        self.stages = StagesView(session)
        self._step, self._times = text_label("No run yet.", "heading"), text_label()
        self.bar = QProgressBar()
        self.side = self._side()
        self.fold = push_button(
            "Margins and events", tip="Show or fold away margins, events and notes"
        )
        self.fold.setCheckable(True)
        self.fold.setChecked(True)
        self._is_narrow = False
        self._lay_out()
        self._connect()
        self._show()

    @property
    def is_active(self) -> bool:
        """Whether a process of this window may be turning the rig."""
        return self.state.active

    def start(self, prepared: PreparedRun) -> None:
        """Start a prepared run and watch it."""
        order = prepared.order
        gear = f"gear {order.serial}" if prepared.planned.experiment.gear_mounted else "bare motor"
        self._title = (
            prepared.title
            or f"{prepared.planned.experiment.title}, {gear}, {order.operator or 'no operator'}"
        )
        seen = prepared.prediction if isinstance(prepared.prediction, PlanPreview) else None
        process = self._start_process(list(prepared.arguments))
        self._begin(process, prepared.planned, seen)
        for note in prepared.notes:
            process.note(note)

    def start_campaign(self, prepared: PreparedCampaign) -> None:
        """Start a prepared campaign and watch its runs one after the other."""
        self._title = self._campaign_title = prepared.title or prepared.walk.plan.title
        process = self._start_process(list(prepared.arguments))
        self._begin(process, None, None)
        self._walk = prepared.walk
        self.stages.expect(
            [StageRow(one.order.protocol, one.planned.nominal) for one in prepared.walk.stages]
        )
        for note in prepared.notes:
            process.note(note)

    def start_commission(self, prepared: PreparedCommission) -> None:
        """Start a commissioning and watch its stages as those of a campaign."""
        self._title = self._campaign_title = prepared.title
        process = self._start_process(list(prepared.arguments))
        process.campaign.connect(self._on_commission)
        self._begin(process, None, None)

    def _on_commission(self, told: dict[str, Any]) -> None:
        """The stages that are missing."""
        self.stages.expect([StageRow(str(one["protocol"]), 0.0) for one in told["stages"]])

    def stop(self) -> None:
        """STOP: controlled ramp. Sent whatever the state is, as long as there is a process to hear it."""
        if self.process is not None and self.is_active:
            self.process.stop()
            self._change(self.state.pressed("STOP"))

    def abort(self) -> None:
        """ABORT: quick stop."""
        if self.process is not None and self.is_active:
            self.process.abort()
            self._change(self.state.pressed("ABORT"))

    def may_close(self) -> bool:
        """Whether the window may be closed now; during a run it asks on the page, and closes later if it is told to."""
        if not self.is_active:
            self.outcome.clear()
            self.campaign_end.hide()
            self.plots.close_file()
            return True
        self.close_question.setVisible(not self._closing)
        return False

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fold the side column away where it takes too much of the width; once, then it is as somebody has it."""
        super().resizeEvent(event)
        narrow = self.width() < _FOLDED_UNDER
        if narrow != self._is_narrow:
            self._is_narrow = narrow
            self.fold.setChecked(not narrow)

    def _begin(
        self, process: RunProcess, planned: PlannedRun | None, prediction: PlanPreview | None
    ) -> None:
        self.process, self.report, self._closing = process, {}, False
        self._walk, self.run_report = None, {}
        process.event_received.connect(self._on_event)
        process.progress.connect(self._on_progress)
        process.prompt.connect(self._on_prompt)
        process.stage.connect(self._on_stage)
        process.analysing.connect(self._on_analysing)
        process.report.connect(self._on_report)
        process.finished.connect(self._on_finished)
        self.outcome.clear()
        self._show_campaign_end(False)
        self.stages.clear_stages()
        self._expect(planned, prediction)
        self._change(RunState().armed())
        self.buttons.stop.setFocus()
        process.start()

    def _expect(self, planned: PlannedRun | None, prediction: PlanPreview | None) -> None:
        """A run is about to begin: nothing of the one before is left."""
        self.events.clear()
        self.margins.show_margins({})
        self.plots.expect(planned, prediction)
        self._step.setText("pre-flight")
        self._times.clear()
        self.bar.setRange(0, 0)

    # What the run tells.

    def _on_prompt(self, prompt: Prompt) -> None:
        self.prompt.ask(prompt)
        self._change(self.state.asked(prompt.text))

    def _on_answer(self, answer: str) -> None:
        if self.process is not None:
            self.process.answer(answer)
        self._change(self.state.answered())

    def _on_event(self, event: Event) -> None:
        self.events.add(event)
        self._change(self.state.after(event))

    def _on_progress(self, progress: Progress) -> None:
        self._change(self.state.went_on(progress))
        self.plots.begun[:] = progress.begun
        if progress.file:
            self.plots.open(Path(progress.file))
        if progress.what == MAKING_SAFE:
            self.plots.release()
        if progress.margins:
            self.margins.show_margins(progress.margins)
        self._step.setText(f"step {progress.step} of {progress.steps}:  {progress.what}")
        self._times.setText(f"{in_words(progress.elapsed)} done")
        self.plots.numbers.show_left(progress.left, self.stages.left)
        self.bar.setRange(0, 1000)
        whole = progress.elapsed + progress.left
        self.bar.setValue(round(1000 * progress.elapsed / whole) if whole > 0.0 else 0)
        self._take_origin()

    def _on_stage(self, told: dict[str, Any]) -> None:
        """A run of a campaign has begun or ended, or counts from before."""
        index, protocol = int(told["index"]), str(told["protocol"])
        if told["state"] == "begun":
            self.stages.stands(index, "under way")
            self.run_report = {}
            planned = self._walk and self._walk.stages[index].planned
            self._expect(planned, planned and preview_plan(planned))
            number = f"run {index + 1} of {len(self.stages.rows)}"
            self._title = f"{self._campaign_title}, {number}: {protocol}"
            if "does" in told:
                # A stage of a commissioning: its STOP, if it was pressed, was the one before.
                self._step.setText(f"{told['does']} Must be seen: {told['must_be_seen']}")
                self._change(RunState().armed())
                return
            self._change(self.state.stage_begun())
        elif told["state"] == "counts":
            self.stages.stands(index, "counts")
        else:
            self.stages.stands(index, str(told["outcome"]))
            self.run_report = dict(told["report"])
            if self.run_report.get("path"):
                self.plots.finish(Path(self.run_report["path"]))
            self._take_origin()
            done = f"{protocol} is done"
            what = f"{done}; the last runs are being analysed" if self.stages.is_over else done
            self._change(self.state.stage_ended(self.run_report, what))
            self._session.runs_changed.emit()

    def _on_analysing(self, told: dict[str, Any]) -> None:
        """The campaign waits for an analysis: which one, and how long all that are left take."""
        self._step.setText(str(told["what"]))
        left = told["left"]
        self._times.setText("" if left is None else f"about {in_words(left)} left")
        # How far one analysis has come is not known: a bar that moves says that it goes on.
        self.bar.setRange(0, 0)

    def _show_campaign_end(self, shown: bool) -> None:
        """The end of a campaign in the place of what is watched while it goes on, or that again."""
        self.campaign_end.setVisible(shown)
        self.watched.setVisible(not shown)

    def _on_report(self, report: dict[str, Any]) -> None:
        self.report = report
        if self.stages.is_campaign:
            self._change(self.state.campaign_reported(report))
            return
        self.run_report = report
        if report.get("margins"):
            self.margins.show_margins(report["margins"])
        self._change(self.state.reported(report))

    def _on_finished(self, ending: Ending) -> None:
        self._change(self.state.gone(ending.reported, ending.complaint, ending.killed))
        run = self.run_report
        path = path_of(run.get("path", ""))
        if path is None and self.plots.live is not None:
            path = self.plots.live.path
        if path is not None:
            self.plots.finish(path)
        self._take_origin()
        completed = self.state.outcome == "COMPLETED"
        if completed or self.bar.maximum() == 0:
            self.bar.setRange(0, 1000)
            self.bar.setValue(1000 if completed else 0)
        if run:
            self._step.setText(
                "the plan was completed" if completed else f"ended at {self._step.text()}"
            )
            self._times.setText(f"{run.get('rows', 0)} cycles")
        if self.stages.is_campaign:
            self._title = self._campaign_title
            self._show()
            self._show_end_of_campaign(run, path)
        else:
            self.outcome.show_end(self.state, run, path)
            self.outcome.review.setFocus()
        self._session.runs_changed.emit()
        self._close_if_waiting()

    def _show_end_of_campaign(self, run: dict[str, Any], path: Path | None) -> None:
        """A page of its own for a gear that was judged; what stopped a campaign stands beside what was seen of it."""
        report = self.report
        whole = report.get("complete") and "lines" not in report and self.state.safe is not False
        if whole:
            self._show_campaign_end(True)
            self.campaign_end.show_end(report, path)
        else:
            self.outcome.show_campaign(self.state, report, run, path)
            self.outcome.review.setFocus()

    def _take_origin(self) -> None:
        live = self.plots.live
        if live is not None:
            stamps = live.recording.source.time_ns(0, 1)
            if len(stamps):
                self.events.set_origin(int(stamps[0]))

    # The window wants to close.

    def _answer_to_close(self, leave: bool) -> None:
        if not leave:
            return
        self._closing = True
        if self.is_active:
            self.stop()
        else:
            self._close_if_waiting()

    def _close_if_waiting(self) -> None:
        """Close only where nothing is left to be looked at: the rig stands, or never moved."""
        if not self._closing or self.is_active:
            return
        self._closing = False
        if self.state.safe or self.state.state is State.REFUSED:
            self.closed_safely.emit()

    # How it looks.

    def _change(self, state: RunState) -> None:
        self.state = state
        self._session.run_exists = self.is_active
        if state.state is not State.WAITING:
            self.prompt.withdraw()
        if not self.is_active:
            self.close_question.hide()
        self._show()

    def _show(self) -> None:
        self.banner.show_state(self.state, self._title)
        self.buttons.set_live(self.state.may_turn)
        self.events.set_active(self.is_active)
        # Afterwards the outcome stands in their place.
        self.plots.numbers.setVisible(self.is_active)
        self.state_changed.emit(
            "idle" if self.state.state is State.IDLE else look_of(self.state).word.lower()
        )

    def _lay_out(self) -> None:
        top = in_row((self.banner, 1), self.buttons, spacing=10)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(12)
        self.bar.setRange(0, 1000)
        strip = in_row(self._step, (self.bar, 1), self._times, self.fold, spacing=12)
        body = split((self.plots, 1), self.side, sizes=[10_000, _SIDE_WIDTH])
        # What must be seen and reached stands still; what is only looked at is scrolled where the screen is small.
        self.watched = scrolled(
            room_for(
                in_column(self.plots.numbers, strip, (body, 1), margins=(0, 0, 0, 0), spacing=8)
            )
        )
        shown = (self.close_question, self.prompt, self.stages, self.outcome)
        parts = (*shown, (self.campaign_end, 1), (self.watched, 1))
        self.setLayout(in_column(top, *parts, margins=(10, 8, 10, 6), spacing=8))

    def _side(self) -> QWidget:
        """Margins over events, each with room of its own."""
        margins = _titled("Margins: peak so far of each limit", scrolled(self.margins))
        events = _titled("Events and notes", self.events)
        side = split(margins, events, sizes=[260, 300], way=Qt.Orientation.Vertical)
        side.setMinimumWidth(280)
        return side

    def _connect(self) -> None:
        self.buttons.stop_pressed.connect(self.stop)
        self.buttons.abort_pressed.connect(self.abort)
        self.prompt.answered.connect(self._on_answer)
        self.close_question.answered.connect(self._answer_to_close)
        self.fold.toggled.connect(self.side.setVisible)
        self.events.note_written.connect(lambda text: self.process and self.process.note(text))
        self.outcome.review_requested.connect(self.review_requested)
        self.campaign_end.review_requested.connect(self.review_requested)
        self.campaign_end.next_requested.connect(self.next_gear_requested)
        self.outcome.judged.connect(lambda verdict: self._change(self.state.judged(verdict)))
        # A field that is written in keeps the space bar; everywhere else on the page it is STOP.
        self._key(Qt.Key.Key_Space, self.stop)
        self._key("Ctrl+N", self._write_note)

    def _write_note(self) -> None:
        self.fold.setChecked(True)
        self.events.note.setFocus()

    def _key(self, key: Any, action: Callable[[], Any]) -> None:
        shortcut = QShortcut(QKeySequence(key), self)
        shortcut.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
        shortcut.setAutoRepeat(False)
        shortcut.activated.connect(action)


def _titled(title: str, content: QWidget) -> QWidget:
    heading = text_label(title, "heading")
    return room_for(in_column(heading, (content, 1), margins=(4, 0, 0, 0), spacing=4))
