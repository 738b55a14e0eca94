"""Make-safe: how every run ends, whatever happened. Commands it, verifies it, escalates, and says so if it failed.

Standstill is verified by the statusword *and* by both encoders over a window of complete cycles. Each action is a list of
stages; a stage that is not obeyed in time leads to the next one, and every list ends with the servo off.

    controlled stop   ramp down        -> quick stop -> servo off
    quick stop        quick stop       -> servo off
    zero torque       servo off        -> quick stop -> servo off
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from drivers.channel import INPUT_ANGLE, OUTPUT_ANGLE
from drivers.drive_state import POWERED_STATES, DriveState
from drivers.port import Mode
from drivers.samples import SampleBlock
from rig.run.engine import Journal
from rig.run.phases import Machine, Phase, PhaseRunner, Phases, Turn
from rig.run.trajectory import cycles_of, ramp


class Action(Enum):
    """How the rig is brought to a standstill."""

    CONTROLLED_STOP = "controlled stop"
    QUICK_STOP = "quick stop"
    ZERO_TORQUE = "zero torque"


class Stage(Enum):
    """One way of stopping."""

    RAMP_DOWN = "ramp down"
    QUICK_STOP = "quick stop"
    SERVO_OFF = "servo off"


STAGES: dict[Action, tuple[Stage, ...]] = {
    Action.CONTROLLED_STOP: (Stage.RAMP_DOWN, Stage.QUICK_STOP, Stage.SERVO_OFF),
    Action.QUICK_STOP: (Stage.QUICK_STOP, Stage.SERVO_OFF),
    Action.ZERO_TORQUE: (Stage.SERVO_OFF, Stage.QUICK_STOP, Stage.SERVO_OFF),
}
"""The stages of each action, each taken when the one before was not obeyed; the servo is off at the end of all of them."""


@dataclass(frozen=True)
class Patience:
    """How long a stage may take [s], the window over which standstill is judged, and what counts as standing [rad/s]."""

    ramp: float = 1.0
    quick_stop: float = 1.0
    servo_off: float = 3.0
    window: float = 0.1
    input_speed: float = 0.2
    output_speed: float = 1.0
    """At the input: output speed times ratio. One count of the output encoder in a window must be below it."""


@dataclass
class MakeSafeReport:
    """How it went: action, the stages taken, what standstill was verified by, and what is wrong if it was not."""

    action: Action
    stages: list[str] = field(default_factory=list)
    verified_by: tuple[str, ...] = ()
    safe: bool = False
    rows: int = 0
    problem: str = ""
    escalated: list[str] = field(default_factory=list)
    """The stages that were not seen to be obeyed."""

    def as_json(self) -> dict[str, object]:
        """The report as the run file and `--json` keep it."""
        return {
            "action": self.action.value, "stages": list(self.stages), "safe": self.safe,
            "verified_by": list(self.verified_by), "rows": self.rows, "problem": self.problem,
            "escalated": list(self.escalated),
        }  # fmt: skip


class MakeSafe:
    """Brings the rig to a verified standstill with the servo off. `next(block)` as the engine; None when it is over."""

    def __init__(
        self,
        action: Action,
        machine: Machine,
        journal: Journal,
        deceleration: float,
        ratio: float = math.nan,
        block_cycles: int = 100,
        patience: Patience | None = None,
    ) -> None:
        self.report = MakeSafeReport(action)
        self._machine = machine
        self._journal = journal
        self._deceleration = deceleration
        self._ratio = ratio
        self._patience = patience or Patience()
        self._start = machine.rows
        self._runner = PhaseRunner(self._walk(), machine, block_cycles)

    def next(self, block: SampleBlock | None) -> Turn | None:
        """The next turn after `block`, or None when the rig is safe or nothing more can be done."""
        return self._runner.next(block)

    def give_up(self, problem: str) -> None:
        """Nothing can be commanded any more (the bus is gone): say that standstill was not verified."""
        self._finish(False, problem)

    def _walk(self) -> Phases:
        stages = list(STAGES[self.report.action])
        while stages:
            stage = stages.pop(0)
            self.report.stages.append(stage.value)
            yield from _STAGES[stage](self)
            if stage is not Stage.SERVO_OFF and not self._moving():
                # Obeyed: what is left is to take the power away.
                self.report.stages.append(Stage.SERVO_OFF.value)
                yield from self._servo_off()
                stages = stages if stages != [Stage.SERVO_OFF] else []
            if self._problem() is None:
                return self._finish(True)
            if stages:
                self.report.escalated.append(stage.value)
                text = f"{stage.value} was not seen to be obeyed ({self._problem()}): going on with {stages[0].value}"
                self._journal.event("error", "make-safe-escalated", "make-safe", text)
        self._finish(False, self._problem() or "")

    def _finish(self, safe: bool, problem: str = "") -> None:
        report = self.report
        report.safe, report.problem, report.rows = safe, problem, self._machine.rows - self._start
        if safe:
            report.verified_by = self._witnesses()
            text = f"{report.action.value}: standstill verified by {', '.join(report.verified_by)}"
            self._journal.event("info", "made-safe", "make-safe", text)
        else:
            text = f"STANDSTILL NOT VERIFIED after {', '.join(report.stages)}: {problem}. Press the emergency stop."
            self._journal.event("error", "make-safe-failed", "make-safe", text)

    def _ramp_down(self) -> Phases:
        m = self._machine
        begin = m.setpoint if m.mode is Mode.SPEED else m.speed()
        if m.mode in (Mode.SPEED, Mode.TORQUE) and m.state in (None, DriveState.ENABLED):
            profile = ramp(begin, 0.0, self._deceleration, m.period)
            yield Phase(Mode.SPEED, max(profile.cycles, 1), profile, enabled=False)
            yield from self._wait(Mode.SPEED, self._patience.ramp)

    def _quick_stop(self) -> Phases:
        needed = abs(self._machine.speed(cycles=20)) / self._deceleration
        yield from self._wait(Mode.QUICK_STOP, self._patience.quick_stop + 2.0 * min(needed, 60.0))

    def _servo_off(self) -> Phases:
        yield from self._wait(Mode.OFF, self._patience.servo_off, unpowered=True)

    def _wait(self, mode: Mode, patience: float, unpowered: bool = False) -> Phases:
        """Windows in `mode` until the rig stands (and has no power), or patience is over."""
        window = cycles_of(self._patience.window, self._machine.period)
        for _ in range(max(1, math.ceil(patience / self._patience.window))):
            yield Phase(mode, window, enabled=False)
            if not self._moving() and not (unpowered and self._powered()):
                return

    def _moving(self) -> str | None:
        """Which encoder shows motion over the latest window, or why that cannot be said; None at standstill."""
        m, p = self._machine, self._patience
        window = cycles_of(p.window, m.period)
        if not m.rows or not m.complete(window):
            return "cycles are incomplete"
        inner = abs(m.speed(INPUT_ANGLE, window))
        if inner > p.input_speed:
            return f"the input turns at {inner:.3g} rad/s"
        if m.has(OUTPUT_ANGLE) and math.isfinite(self._ratio):
            outer = abs(m.speed(OUTPUT_ANGLE, window)) * self._ratio
            if outer > p.output_speed:
                return f"the output turns at {outer / self._ratio:.3g} rad/s"
        return None

    def _powered(self) -> str | None:
        """Why the drive may still have power, or None."""
        state = self._machine.state
        return f"the drive is in {state.value}" if state in POWERED_STATES or state is DriveState.UNKNOWN else None

    def _problem(self) -> str | None:
        return self._moving() or self._powered()

    def _witnesses(self) -> tuple[str, ...]:
        m = self._machine
        found = [INPUT_ANGLE]
        if m.has(OUTPUT_ANGLE) and math.isfinite(self._ratio):
            found.append(OUTPUT_ANGLE)
        return ("statusword", *found) if m.state is not None else tuple(found)


_STAGES = {
    Stage.RAMP_DOWN: MakeSafe._ramp_down,
    Stage.QUICK_STOP: MakeSafe._quick_stop,
    Stage.SERVO_OFF: MakeSafe._servo_off,
}
