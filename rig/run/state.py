"""What a run is doing, in one word: a pure function of what the run tells, without any widget.

idle -> armed -> running <-> waiting for you
                    |
                    +-> stopping -> finished
                    |           |
                    +-> tripped +-> tripped, and "lost" when the process is gone without a report

`CHANGES` is the table of all that may follow upon what; anything else that is told changes nothing. Once the report
of the whole was told nothing that is pressed, asked or told changes the word: only the end of the process and the
verdict of the analysis still belong to it.
"""

from __future__ import annotations

from collections.abc import Mapping
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


_ENDINGS = frozenset({State.FINISHED, State.TRIPPED, State.LOST})
CHANGES: Mapping[State, frozenset[State]] = {
    State.IDLE: frozenset({State.ARMED}),
    State.ARMED: frozenset({State.RUNNING, State.WAITING, State.STOPPING, State.ANALYSING})
    | _ENDINGS
    | {State.REFUSED},
    State.RUNNING: frozenset({State.ARMED, State.WAITING, State.STOPPING, State.ANALYSING})
    | _ENDINGS,
    State.WAITING: frozenset({State.ARMED, State.RUNNING, State.STOPPING, State.ANALYSING})
    | _ENDINGS
    | {State.REFUSED},
    # Each run is brought to standstill at its end: one of a campaign is analysed then.
    State.STOPPING: frozenset({State.ARMED, State.ANALYSING}) | _ENDINGS | {State.REFUSED},
    State.ANALYSING: frozenset({State.ARMED, State.WAITING, State.STOPPING}) | _ENDINGS,
    State.TRIPPED: frozenset({State.ARMED, State.FINISHED, State.LOST}),
    State.FINISHED: frozenset({State.ARMED, State.LOST}),
    State.REFUSED: frozenset({State.ARMED}),
    State.LOST: frozenset({State.ARMED}),
}
"""What a word may change to. ARMED begins the next run: that of a campaign, a stage, or another one altogether."""
OVER = frozenset({State.FINISHED, State.TRIPPED, State.REFUSED, State.LOST})
"""The words of a run whose process is gone."""


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
    told: bool = False
    """Whether the report of the whole was told: the rig stands, or is said not to, and nothing changes that."""

    @property
    def active(self) -> bool:
        """Whether a process may be turning the rig."""
        return self.state is not State.IDLE and not self.ended

    @property
    def may_turn(self) -> bool:
        """Whether there is something to stop."""
        return self.active and not self.told

    def _to(self, state: State, **fields: Any) -> RunState:
        """With another word, if that may follow upon this one; else as it was."""
        if self.told or (state is not self.state and state not in CHANGES[self.state]):
            return self
        return replace(self, state=state, **fields)

    def armed(self) -> RunState:
        """The process was started: it looks whether the rig is fit."""
        return RunState(state=State.ARMED, what="looking whether the rig is fit to run")

    def after(self, event: Event) -> RunState:
        """After an event."""
        if self.told:
            return self
        if event.code == MADE_SAFE:
            return replace(self, safe=True)
        if event.code == NOT_SAFE:
            return self._to(
                State.TRIPPED,
                safe=False,
                cause=self.cause or event.code,
                what=event.text,
                remedy=rule_of("make_safe_failed").remedy,
            )
        if event.source != "session":
            return self
        if event.code in ("STOP", "ABORT"):
            return self._to(State.STOPPING, what=event.text)
        tripped = event.level == "error" and event.code not in SESSION_ERRORS
        if tripped and not self.cause:
            rule = rule_of(event.code)
            told = {"cause": event.code, "what": rule.what, "remedy": rule.remedy}
            return self._to(State.TRIPPED, **told)
        return self

    def went_on(self, progress: Progress) -> RunState:
        """After a line of progress."""
        if self.ended or self.told:
            return self
        if progress.what == MAKING_SAFE:
            text = "bringing the rig to a verified standstill"
            return self._to(State.STOPPING, moved=True, what=text)
        if self.state in (State.STOPPING, State.WAITING):
            return replace(self, moved=True)
        return self._to(State.RUNNING, moved=True, what=progress.what)

    def asked(self, question: str) -> RunState:
        """After a question of the run; one that comes while the rig is being stopped changes nothing."""
        if self.state not in (State.ARMED, State.RUNNING, State.ANALYSING):
            return self
        return self._to(State.WAITING, what=question)

    def answered(self) -> RunState:
        """After the operator's answer."""
        if self.state is not State.WAITING:
            return self
        return self._to(State.RUNNING, what="going on")

    def pressed(self, word: str) -> RunState:
        """After the operator's STOP or ABORT, before the run says that it obeys."""
        if not self.may_turn:
            return self
        return self._to(State.STOPPING, what=f"{word} sent", stop_asked=True)

    def reported(self, report: dict[str, Any]) -> RunState:
        """After the report of the whole: the outcome, and what it means."""
        return self if self.told else replace(self._reported(report), told=True)

    def _reported(self, report: dict[str, Any]) -> RunState:
        """After the report of one run."""
        outcome = str(report.get("outcome", ""))
        made_safe: dict[str, Any] = report.get("make_safe") or {}
        trip: dict[str, Any] = report.get("trip") or {}
        # What was said not to stand stands by no later word of the same run.
        safe = bool(made_safe.get("safe")) and self.safe is not False
        cause = str(trip.get("cause", "")) or ("" if outcome != "TRIPPED" else self.cause)
        state = State.TRIPPED if outcome == "TRIPPED" or not safe else State.FINISHED
        message = str(report.get("message", ""))
        remedy = rule_of(cause).remedy if cause else self.remedy
        if not safe:
            message = message or "Standstill was not verified."
            remedy = rule_of("make_safe_failed").remedy
        return self._to(
            state,
            outcome=outcome,
            verdict=str(report.get("verdict", "")),
            cause=cause,
            safe=safe,
            what=message,
            remedy=remedy,
        )

    def stage_begun(self) -> RunState:
        """After the begin of a campaign's next run; a STOP that was pressed before it is not forgotten."""
        return self if self.stop_asked or self.told else self.armed()

    def stage_ended(self, report: dict[str, Any], what: str) -> RunState:
        """After the end of one run of a campaign; one that was completed is followed by `what`."""
        if self.told:
            return self
        ended = self._reported(report)
        if ended.outcome != "COMPLETED" or not ended.safe:
            return ended
        state = State.STOPPING if self.stop_asked else State.ANALYSING
        if state is not self.state and state not in CHANGES[self.state]:
            return ended
        return replace(ended, state=state, outcome="", what=what, moved=True)

    def campaign_reported(self, report: dict[str, Any]) -> RunState:
        """After the report of a campaign: the verdict of all its runs, or what stopped it."""
        if self.told:
            return self
        because = "; ".join(str(why) for why in report.get("because", ()))
        outcome = str(report.get("outcome", ""))
        if not report.get("complete") or self.safe is False:
            # What stopped it was told by its latest run; a STOP between two runs was told by nobody.
            tripped = self.state is State.TRIPPED or self.safe is False
            over = self if tripped else self._to(State.FINISHED)
            return replace(over, outcome=outcome, told=True)
        fields = {"outcome": "COMPLETED", "verdict": str(report.get("verdict", ""))}
        return replace(self._to(State.FINISHED, what=because, remedy="", **fields), told=True)

    def judged(self, verdict: str) -> RunState:
        """After the analysis of a completed run: what its gear is worth by it."""
        return replace(self, verdict=verdict)

    def gone(self, reported: bool, complaint: str, killed: bool = False) -> RunState:
        """After the end of the process. Without a report: refused before anything moved, or lost."""
        if self.ended or self.state is State.IDLE:
            return self
        if reported and self.told:
            return replace(self, ended=True)
        if not self.moved and not killed and State.REFUSED in CHANGES[self.state]:
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
