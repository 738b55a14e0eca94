"""What a run is doing, in one word: a pure function of what the run tells, without any widget.

idle -> armed -> running <-> waiting for you
                    |
                    +-> stopping -> finished
                    |           |
                    +-> tripped +-> tripped, and "lost" when the process is gone without a report
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from experiments.recording import Event
from rig.run.parts import Progress
from rig.run.trips import SESSION_ERRORS, rule_of

MAKING_SAFE = "making safe"
"""What progress says while the rig is brought to standstill."""
MADE_SAFE, NOT_SAFE = "made-safe", "make-safe-failed"


class State(Enum):
    """The states of the banner."""

    IDLE = "idle"
    ARMED = "armed"
    RUNNING = "running"
    WAITING = "waiting for you"
    STOPPING = "stopping"
    ANALYSING = "analysing"
    TRIPPED = "tripped"
    FINISHED = "finished"
    REFUSED = "refused"
    LOST = "lost"


@dataclass(frozen=True, kw_only=True)
class RunState:
    """The state with what belongs to it: outcome, what happened, what to do next, and whether
    standstill was verified.
    """

    state: State = State.IDLE
    outcome: str = ""
    verdict: str = ""
    """What the gear is worth by the analysis of this run; "" while nobody knows."""
    what: str = ""
    remedy: str = ""
    cause: str = ""
    safe: bool | None = None
    moved: bool = False
    ended: bool = False
    """Whether the process has ended."""
    stop_asked: bool = False
    """Whether STOP or ABORT was pressed: the next run of a campaign will not begin."""

    @property
    def active(self) -> bool:
        """Whether a process may be turning the rig."""
        return self.state is not State.IDLE and not self.ended

    def armed(self) -> RunState:
        """The process was started: it looks whether the rig is fit."""
        return RunState(state=State.ARMED, what="looking whether the rig is fit to run")

    def after(self, event: Event) -> RunState:
        """After an event."""
        if event.code == MADE_SAFE:
            return replace(self, safe=True)
        if event.code == NOT_SAFE:
            return replace(
                self,
                state=State.TRIPPED,
                safe=False,
                cause=self.cause or event.code,
                what=event.text,
                remedy=rule_of("make_safe_failed").remedy,
            )
        if event.source != "session":
            return self
        if event.code in ("STOP", "ABORT"):
            if self.state is State.TRIPPED:
                return self
            return replace(self, state=State.STOPPING, what=event.text)
        tripped = event.level == "error" and event.code not in SESSION_ERRORS
        if tripped and not self.cause:
            rule = rule_of(event.code)
            return replace(
                self, state=State.TRIPPED, cause=event.code, what=rule.what, remedy=rule.remedy
            )
        return self

    def went_on(self, progress: Progress) -> RunState:
        """After a line of progress."""
        if self.state is State.TRIPPED or self.ended:
            return self
        if progress.what == MAKING_SAFE:
            return replace(
                self,
                state=State.STOPPING,
                moved=True,
                what="bringing the rig to a verified standstill",
            )
        if self.state in (State.STOPPING, State.WAITING):
            return replace(self, moved=True)
        return replace(self, state=State.RUNNING, moved=True, what=progress.what)

    def asked(self, question: str) -> RunState:
        """After a question of the run; one that comes while the rig is being stopped changes nothing."""
        if self.state not in (State.ARMED, State.RUNNING, State.ANALYSING):
            return self
        return replace(self, state=State.WAITING, what=question)

    def answered(self) -> RunState:
        """After the operator's answer."""
        return replace(self, state=State.RUNNING, what="going on")

    def pressed(self, word: str) -> RunState:
        """After the operator's STOP or ABORT, before the run says that it obeys."""
        if not self.active or self.state is State.TRIPPED:
            return self
        return replace(self, state=State.STOPPING, what=f"{word} sent", stop_asked=True)

    def reported(self, report: dict[str, Any]) -> RunState:
        """After the report: the outcome, and what it means."""
        outcome = str(report.get("outcome", ""))
        made_safe = report.get("make_safe") or {}
        trip = report.get("trip") or {}
        safe = bool(made_safe.get("safe"))
        cause = str(trip.get("cause", "")) or ("" if outcome != "TRIPPED" else self.cause)
        state = State.TRIPPED if outcome == "TRIPPED" or not safe else State.FINISHED
        message = str(report.get("message", ""))
        remedy = rule_of(cause).remedy if cause else self.remedy
        if not safe:
            message = message or "Standstill was not verified."
            remedy = rule_of("make_safe_failed").remedy
        return replace(
            self,
            state=state,
            outcome=outcome,
            verdict=str(report.get("verdict", "")),
            cause=cause,
            safe=safe,
            what=message,
            remedy=remedy,
        )

    def stage_begun(self) -> RunState:
        """After the begin of a campaign's next run; a STOP that was pressed before it is not forgotten."""
        return self if self.stop_asked else self.armed()

    def stage_ended(self, report: dict[str, Any], what: str) -> RunState:
        """After the end of one run of a campaign; one that was completed is followed by `what`."""
        ended = self.reported(report)
        if ended.outcome != "COMPLETED" or not ended.safe:
            return ended
        state = State.STOPPING if self.stop_asked else State.ANALYSING
        return replace(ended, state=state, outcome="", what=what, moved=True)

    def campaign_reported(self, report: dict[str, Any]) -> RunState:
        """After the report of a campaign: the verdict of all its runs, or what stopped it."""
        because = "; ".join(str(why) for why in report.get("because", ()))
        if not report.get("complete"):
            return replace(self, outcome=str(report.get("outcome", "")))
        return replace(
            self,
            state=State.FINISHED,
            outcome="COMPLETED",
            verdict=str(report.get("verdict", "")),
            what=because,
            remedy="",
        )

    def judged(self, verdict: str) -> RunState:
        """After the analysis of a completed run: what its gear is worth by it."""
        return replace(self, verdict=verdict)

    def gone(self, reported: bool, complaint: str, killed: bool = False) -> RunState:
        """After the end of the process. Without a report: refused before anything moved, or lost."""
        if reported:
            return replace(self, ended=True)
        if not self.moved and not killed:
            return RunState(
                state=State.REFUSED,
                what=complaint or "The run gave no reason.",
                ended=True,
                remedy="Nothing has moved. Correct what is named and start again.",
            )
        if self.safe:
            return replace(
                self,
                state=State.LOST,
                ended=True,
                what=complaint or "The run ended without its report.",
                remedy=STOOD,
            )
        return replace(
            self,
            state=State.LOST,
            safe=None,
            ended=True,
            remedy=LOST,
            what="The process that turned the rig has ended without a report."
            + (f" It said: {complaint}" if complaint else ""),
        )


STOOD = "The rig was made safe before. Recover the file (rig recover), then look at its events."
LOST = (
    "Nobody knows whether the rig stands. Press the emergency stop and look at the rig. "
    "Then recover what was recorded: rig recover"
)
