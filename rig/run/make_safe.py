"""Make-safe: how every run ends, whatever happened. Commands it, verifies it, escalates, and says so if it failed.

Standstill is verified by the statusword *and* by both encoders over a window in which each of them
was heard. Each action is a list of stages; a stage that is not obeyed in time leads to the next
one, and every list ends with the servo off. Observers whose cyclic data stay away are asked one by
one in the end, and a drive that hears no process data is switched off by SDO.

    controlled stop   ramp down        -> quick stop -> servo off
    quick stop        quick stop       -> servo off
    zero torque       servo off        -> quick stop -> servo off
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from drivers.channel import STATUSWORD
from drivers.drive_state import DriveState
from drivers.port import Mode
from drivers.samples import SampleBlock
from experiments.steps.profile import cycles_of, ramp
from rig.run.direct_line import DirectLine
from rig.run.observers import WORDS, Observers
from rig.run.phases import Journal, Machine, Phase, PhaseRunner, Phases, Turn


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
"""The stages of each action, each taken when the one before was not obeyed; the servo is off at the
end of all of them.
"""


@dataclass(frozen=True)
class Patience:
    """How long a stage may take [s], the window over which standstill is judged, and what counts as
    standing [rad/s].
    """

    ramp: float = 1.0
    quick_stop: float = 1.0
    servo_off: float = 3.0
    window: float = 0.1
    input_speed: float = 0.2
    output_speed: float = 1.0
    """At the input: output speed times ratio. One count of the output encoder in a window must be below it."""


@dataclass(kw_only=True)
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
    silent: tuple[str, ...] = ()
    """Observers that this rig has and that said nothing, neither in the cyclic data nor when they were asked."""

    def as_json(self) -> dict[str, object]:
        """The report as the run file and `--json` keep it."""
        return {
            "action": self.action.value,
            "stages": list(self.stages),
            "safe": self.safe,
            "verified_by": list(self.verified_by),
            "rows": self.rows,
            "problem": self.problem,
            "escalated": list(self.escalated),
            "silent": list(self.silent),
        }


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
        line: DirectLine | None = None,
    ) -> None:
        self.report = MakeSafeReport(action=action)
        self._machine = machine
        self._journal = journal
        self._deceleration = deceleration
        self._patience = patience or Patience()
        self._line = line
        self._window = cycles_of(self._patience.window, machine.period)
        self._observers = Observers(
            machine, ratio, self._window, self._patience.input_speed, self._patience.output_speed
        )
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
            if stage is not Stage.SERVO_OFF and not self._observers.moving():
                # Obeyed: what is left is to take the power away.
                self.report.stages.append(Stage.SERVO_OFF.value)
                yield from self._servo_off()
                # What is left of the list would only repeat the servo off that was just taken.
                stages = stages if stages != [Stage.SERVO_OFF] else []
            problem = self._observers.problem()
            if problem is None:
                break
            # Not seen to stand is not the same as moving; both are answered by the next stage.
            if stages:
                self.report.escalated.append(stage.value)
                text = f"{stage.value} was not seen to be obeyed ({problem}): going on with {stages[0].value}"
                self._journal.event("error", "make-safe-escalated", "make-safe", text)
        # Only now: asking takes SDOs, and nothing may delay what stops the rig.
        yield from self._inquire()
        problem = self._observers.problem()
        self._finish(problem is None, problem or "")

    def _finish(self, safe: bool, problem: str = "") -> None:
        report = self.report
        report.safe, report.problem, report.rows = safe, problem, self._machine.rows - self._start
        report.silent = self._observers.silent()
        if safe:
            report.verified_by = self._observers.names()
            text = f"{report.action.value}: standstill verified by {', '.join(report.verified_by)}"
            text += "".join(f"; the {WORDS[name]} is silent" for name in report.silent)
            self._journal.event(
                "warning" if report.silent else "info", "made-safe", "make-safe", text
            )
        else:
            text = f"STANDSTILL NOT VERIFIED after {', '.join(report.stages)}: {problem}. Press the emergency stop."
            self._journal.event("error", "make-safe-failed", "make-safe", text)

    def _ramp_down(self) -> Phases:
        m = self._machine
        # Under torque control there is no speed set-point: a ramp from zero would be a jump for the drive.
        begin = m.setpoint if m.mode is Mode.SPEED else m.speed()
        # A drive that is not in operation follows no ramp; what it does is for the next stage.
        if m.mode in (Mode.SPEED, Mode.TORQUE) and m.state in (None, DriveState.ENABLED):
            profile = ramp(begin, 0.0, self._deceleration, m.period)
            yield Phase(Mode.SPEED, max(profile.cycles, 1), profile, enabled=False)
            yield from self._wait(Mode.SPEED, self._patience.ramp)

    def _quick_stop(self) -> Phases:
        needed = abs(self._machine.speed(cycles=20)) / self._deceleration
        # Bounded: a speed that a slipped encoder has made up must not keep us from the next stage.
        yield from self._wait(Mode.QUICK_STOP, self._patience.quick_stop + 2.0 * min(needed, 60.0))

    def _servo_off(self) -> Phases:
        yield from self._wait(Mode.OFF, self._patience.servo_off, unpowered=True)

    def _wait(self, mode: Mode, patience: float, unpowered: bool = False) -> Phases:
        """Windows in `mode` until the rig stands (and has no power), or patience is over."""
        for _ in range(self._windows(patience)):
            # The drive leaves operation here on purpose: its state is waited for, not guarded.
            yield Phase(mode, self._window, enabled=False)
            if not self._observers.moving() and not (unpowered and self._observers.powered()):
                return

    def _inquire(self) -> Phases:
        """Ask the observers that were not heard, twice with a window between, until they say that the rig stands."""
        observers, line = self._observers, self._line
        unheard = observers.unheard()
        if line is None or not unheard or not self._machine.rows:
            return
        if STATUSWORD in unheard:
            # A drive whose process data stay away may not hear ours either.
            self.report.stages.append(f"{Stage.SERVO_OFF.value} by SDO")
            line.switch_off()
        for _ in range(self._windows(self._patience.servo_off)):
            # Two answers a window apart: one count says where an encoder is, not that it stands.
            before = line.ask(unheard)
            if not before:
                return
            yield Phase(Mode.OFF, self._window, enabled=False)
            observers.hear(before, line.ask(unheard))
            if observers.problem() is None:
                return

    def _windows(self, patience: float) -> int:
        return max(1, math.ceil(patience / self._patience.window))


_STAGES = {
    Stage.RAMP_DOWN: MakeSafe._ramp_down,
    Stage.QUICK_STOP: MakeSafe._quick_stop,
    Stage.SERVO_OFF: MakeSafe._servo_off,
}
