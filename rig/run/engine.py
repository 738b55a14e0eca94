"""The engine: turns the steps of a plan into commands, opens and closes segments, and ends feedback
steps on what it sees.

The kinds of steps say themselves what they do (`experiments.steps`); here their legs become phases
and their conditions bounds that the port watches in every cycle, so that nothing depends on how the
run is cut into blocks. A step that does not reach its goal in time is a `StepFailedError`: a rig
that is broken must not fail a gear.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import assert_never

from drivers.channel import DRIVE_TORQUE, INDEX_SEEN, INPUT_ANGLE, TORQUE
from drivers.drive_state import POWERED_STATES, DriveState
from drivers.port import Bound, Mode
from drivers.samples import SampleBlock
from experiments.steps.kind import (
    SWITCHING_TIME,
    Displaced,
    Goal,
    IndexPassed,
    LegEnd,
    Motion,
    SegmentLabel,
    Servo,
    Turned,
    Until,
)
from experiments.steps.note import Mark, Prompt
from experiments.steps.profile import Constant, cycles_of
from experiments.steps.vocabulary import Step
from model.units import RPM
from rig.errors import RigError
from rig.run.phases import INDEX_LATCHES, Journal, Machine, Phase, PhaseRunner, Phases, Turn

_ENABLE_PATIENCE = 2.0
"""s until a drive that does not switch on or off is an error."""
MODES = {Servo.OFF: Mode.OFF, Servo.SPEED: Mode.SPEED, Servo.TORQUE: Mode.TORQUE}
CUT = " (cut)"
"""Added to the label of a segment that was ended by a stop or a trip, so that no analysis takes it for a whole one."""


class StepFailedError(RigError):
    """A step of the plan that the rig did not complete within its time."""


Ask = Callable[[Prompt], "str | None"]
"""Puts a prompt to the operator: the answer, or None while there is none yet."""


class Engine:
    """Walks a plan on a rig. `next(block)` gives the next turn, None when the plan is over."""

    def __init__(
        self,
        plan: Sequence[Step],
        machine: Machine,
        journal: Journal,
        ask: Ask,
        block_cycles: int = 1000,
    ) -> None:
        self.plan = tuple(plan)
        self.index = 0
        self.begun: list[int] = []
        """Row at which each step began, so far."""
        self._machine = machine
        self._journal = journal
        self._ask = ask
        self._open: tuple[SegmentLabel, int] | None = None
        self._runner = PhaseRunner(self._walk(), machine, block_cycles)

    def next(self, block: SampleBlock | None) -> Turn | None:
        """The next turn after `block`, or None when the plan is over. Raises `StepFailedError`."""
        return self._runner.next(block)

    @property
    def words(self) -> str:
        """The step that is being executed, in a few words."""
        return self.plan[self.index].words() if self.index < len(self.plan) else "finished"

    def cut(self) -> None:
        """Close the open segment because the plan ends here, and mark it as cut."""
        if self._open is not None:
            label, start = self._open
            self._open = (replace(label, label=label.label + CUT), start)
            self._close_segment()

    def _walk(self) -> Phases:
        for index, step in enumerate(self.plan):
            self.index = index
            self.begun.append(self._machine.rows)
            match step:
                case Mark():
                    self._journal.event("info", step.code, "protocol", step.text)
                case Prompt():
                    yield from self._prompt(step)
                case Motion():
                    # Switching comes before the segment opens: an analysis must not find it inside.
                    yield from self._prepare(step)
                    if step.segment is not None:
                        self._open = (step.segment, self._machine.rows)
                    yield from self._execute(step)
                    self._close_segment()
                case _:
                    assert_never(step)
        self.index = len(self.plan)

    def _execute(self, step: Motion) -> Phases:
        """The legs of a step as phases."""
        m, mode = self._machine, MODES[step.servo]
        torque = TORQUE if m.has(TORQUE) else DRIVE_TORQUE
        course = step.course(m, self._note)
        leg = next(course, None)
        while leg is not None:
            begin = m.counts(INPUT_ANGLE)
            until = () if leg.until is None else (bound_of(leg.until, m),)
            tally = torque if leg.averaged else ""
            end = yield Phase(mode, leg.cycles, leg.profile, until, tally)
            # Out of cycles: the goal's own bound has not ended the leg.
            if leg.goal is not None and end.broken is None:
                raise _overdue(type(step).__name__, leg.goal, m)
            channel = m.channels[INPUT_ANGLE]
            # The counts turned are exact: their difference is taken before anything is scaled.
            turned = (m.counts(INPUT_ANGLE) - begin) * channel.direction * channel.scale
            mean = math.nan
            if end.samples:
                mean = m.channels[torque].scale * end.total / end.samples
            try:
                leg = course.send(LegEnd(end.cycles, end.broken is not None, turned, mean))
            except StopIteration:
                return

    def _note(self, level: str, code: str, text: str) -> None:
        self._journal.event(level, code, "engine", text)

    def _close_segment(self) -> None:
        if self._open is None:
            return
        label, start = self._open
        self._open = None
        # A step that was stopped before its first cycle has left nothing to label.
        if self._machine.rows > start:
            self._journal.segment(label, start, self._machine.rows)

    def _prompt(self, prompt: Prompt) -> Phases:
        """Hold what is (servo off, or the present set-point) in windows until there is an answer."""
        m = self._machine
        answer = self._ask(prompt)
        while answer is None:
            # The rig is not left alone while the operator thinks: every window is guarded and recorded.
            mode = Mode.SPEED if m.mode is Mode.SPEED else Mode.OFF
            yield Phase(mode, cycles_of(SWITCHING_TIME, m.period), Constant(m.setpoint))
            answer = self._ask(prompt)
        text = f"{prompt.text} {answer}".strip()
        self._journal.event("info", prompt.key or "prompt", "operator", text)

    def _prepare(self, step: Motion) -> Phases:
        """Bring the drive into the mode that the step needs, before its segment opens."""
        m = self._machine
        wanted = MODES[step.servo]
        window = cycles_of(SWITCHING_TIME, m.period)
        if wanted is Mode.OFF and m.mode is not Mode.OFF:
            yield from self._until_state(
                Mode.OFF, lambda state: state not in POWERED_STATES, "switch off", window
            )
        elif wanted is not Mode.OFF and m.mode not in (Mode.SPEED, Mode.TORQUE):
            yield from self._until_state(
                wanted, lambda state: state is DriveState.ENABLED, "switch on", window
            )
        elif m.mode is Mode.TORQUE and wanted is Mode.SPEED and not step.takes_speed_over:
            # The speed that the torque has left is unknown to the set-point: stand before going on.
            yield Phase(Mode.SPEED, window)

    def _until_state(
        self, mode: Mode, good: Callable[[DriveState], bool], what: str, window: int
    ) -> Phases:
        m = self._machine
        for _ in range(math.ceil(_ENABLE_PATIENCE / SWITCHING_TIME)):
            yield Phase(mode, window, enabled=False)
            # A rig that reports no state is taken at its word; the supervisor watches what it does.
            state = m.state
            if state is None or good(state):
                return
        raise StepFailedError(
            f"the drive does not {what}",
            where=self._where(),
            value=m.state.value if m.state else "unknown state",
            limit=f"within {_ENABLE_PATIENCE:g} s",
            remedy="Look at the drive's display: fault, enable input, safe torque off.",
        )

    def _where(self) -> str:
        return f"step {self.index + 1} of {len(self.plan)}"


def bound_of(until: Until, machine: Machine) -> Bound:
    """The bound that a condition is, from where the rig is now. Raises `StepFailedError` where it cannot be seen."""
    match until:
        case Turned(angle, direction):
            channel = machine.channels[INPUT_ANGLE]
            weight = math.copysign(channel.scale, direction) * channel.direction
            # Half a count less: the count nearest to the angle already ends the phase.
            high = max(angle - 0.5 * channel.scale, 0.0)
            return _from_here("turned", machine, weight, high=high)
        case Displaced(angle):
            scale = machine.channels[INPUT_ANGLE].scale
            return _from_here("motion", machine, scale, low=-angle, high=angle)
        case IndexPassed(which):
            return _index_bound(which, machine)
        case _:
            assert_never(until)


def _overdue(kind: str, goal: Goal, machine: Machine) -> StepFailedError:
    """The error of a kind of step that did not reach its goal."""
    speed, setpoint = machine.speed(cycles=100) / RPM, machine.setpoint / RPM
    return StepFailedError(
        f"{kind} did not reach {goal.what} in time",
        where=f"row {machine.rows}",
        value=f"input speed {speed:.4g} r/min at set-point {setpoint:.4g} r/min",
        limit=f"{goal.at_most:g} s",
        remedy="Is the input free to turn, and does the encoder count?",
    )


def _from_here(
    cause: str, machine: Machine, weight: float, *, high: float, low: float = -math.inf
) -> Bound:
    """A bound on what the input encoder counts from now on."""
    return Bound(
        cause=cause,
        weights={INPUT_ANGLE: weight},
        low=low,
        high=high,
        offset=-weight * machine.counts(INPUT_ANGLE),
        is_trip=False,
    )


def _index_bound(which: str, machine: Machine) -> Bound:
    latch, bit = INDEX_LATCHES[which]
    if not (machine.has(latch) and machine.has(INDEX_SEEN)):
        raise StepFailedError(
            "this rig does not report index marks",
            where="FindIndex",
            value=which,
            limit=f"channels {latch}, {INDEX_SEEN}",
        )
    if not machine.counts(INDEX_SEEN) & bit:
        return Bound(cause="index", weights={INDEX_SEEN: 1.0}, high=0.5, mask=bit, is_trip=False)
    # A mark was seen before: the next one shows by another count in the latch.
    return Bound(
        cause="index",
        weights={latch: 1.0},
        low=-0.5,
        high=0.5,
        offset=-float(machine.counts(latch)),
        is_trip=False,
    )
