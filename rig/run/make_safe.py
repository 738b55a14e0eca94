"""Make-safe: how every run ends, whatever happened. Commands it, verifies it, escalates, and says so if it failed.

Standstill is verified by the statusword *and* by both encoders over a window in which each of them
was heard. Each action is a list of stages; a stage that is not obeyed in time leads to the next
one, and every list ends with the servo off.

    controlled stop   ramp down        -> quick stop -> servo off
    quick stop        quick stop       -> servo off
    zero torque       servo off        -> quick stop -> servo off
    drive is deaf     quick stop       -> servo off       by SDO as well, from the first cycle on

A rig without a quick stop (`Abilities.has_quick_stop`) has the reference of zero in its place, and is called so.

A drive is deaf while it hears no process data: it is not OPERATIONAL, or there is no SYNC. What it and
the other silent devices are asked beside the cyclic data is the table of `rig.run.direct_line`; nobody
waits for their answers, the cycles go on meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

from drivers.channel import STATUSWORD
from drivers.drive_state import DriveState
from drivers.port import DirectLine, Mode, Reach
from drivers.samples import SampleBlock
from experiments.steps.profile import cycles_of, ramp
from rig.run.direct_line import STOP, requests_for
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
    ZERO_REFERENCE = "zero reference"
    SERVO_OFF = "servo off"


STAGES: dict[Action, tuple[Stage, ...]] = {
    Action.CONTROLLED_STOP: (Stage.RAMP_DOWN, Stage.QUICK_STOP, Stage.SERVO_OFF),
    Action.QUICK_STOP: (Stage.QUICK_STOP, Stage.SERVO_OFF),
    Action.ZERO_TORQUE: (Stage.SERVO_OFF, Stage.QUICK_STOP, Stage.SERVO_OFF),
}
"""The stages of each action, each taken when the one before was not obeyed; the servo is off at the
end of all of them.
"""
_WITHOUT_QUICK_STOP: dict[Stage, Stage] = {Stage.QUICK_STOP: Stage.ZERO_REFERENCE}
"""What stands in the place of a stage on a rig that has no quick stop."""
_DEAF: tuple[Stage, ...] = (Stage.QUICK_STOP, Stage.SERVO_OFF)
"""The stages of a drive that hears no process data, whatever the action: a ramp would not be heard, and power is taken
away only once it stands or its ramp is over.
"""
GLANCES = 10
"""Looks per window at who is heard, and at what the others answer."""


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
    stages: list[str] = field(default_factory=list[str])
    verified_by: tuple[str, ...] = ()
    safe: bool = False
    rows: int = 0
    problem: str = ""
    escalated: list[str] = field(default_factory=list[str])
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
        *,
        has_quick_stop: bool = True,
    ) -> None:
        self._instead = {} if has_quick_stop else _WITHOUT_QUICK_STOP
        self._stage = Stage.SERVO_OFF
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
        self._asked_in: Mode | None = None
        self._asked: dict[str, Reach] = {}
        self._start = machine.rows
        self._runner = PhaseRunner(self._walk(), machine, block_cycles)

    def next(self, block: SampleBlock | None) -> Turn | None:
        """The next turn after `block`, or None when the rig is safe or nothing more can be done."""
        return self._runner.next(block)

    def give_up(self, problem: str) -> None:
        """Nothing can be commanded any more (the bus is gone): say that standstill was not verified."""
        self._finish(False, problem)

    def _walk(self) -> Phases:
        named = _DEAF if self._is_deaf() else STAGES[self.report.action]
        stages = [self._instead.get(stage, stage) for stage in named]
        while stages:
            stage = stages.pop(0)
            yield from self._take(stage)
            if stage is not Stage.SERVO_OFF and not self._observers.moving():
                # Obeyed: what is left is to take the power away.
                yield from self._take(Stage.SERVO_OFF)
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

    def _take(self, stage: Stage) -> Phases:
        """One stage; the report says whether the drive is told by SDO as well."""
        by_sdo = self._insists() or self._is_deaf()
        self._stage = stage
        self.report.stages.append(f"{stage.value} by SDO" if by_sdo else stage.value)
        yield from self._STAGES[stage](self)

    def _is_deaf(self) -> bool:
        """Whether the drive can be spoken to one by one, and hears no process data."""
        line, m = self._line, self._machine
        return (
            line is not None
            and m.has(STATUSWORD)
            and line.reach(STATUSWORD) is not Reach.PROCESS_DATA
        )

    def _insists(self) -> bool:
        """Whether the drive hears process data, and was not seen to obey them."""
        return self._line is not None and bool(self.report.escalated)

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
        m = self._machine
        # What was commanded counts where nothing is measured any more.
        speed = max(abs(m.speed(cycles=20)), abs(m.setpoint) if self._is_deaf() else 0.0)
        # Bounded: a speed that a slipped encoder has made up must not keep us from the next stage.
        needed = min(speed / self._deceleration, 60.0)
        yield from self._wait(Mode.QUICK_STOP, self._patience.quick_stop + 2.0 * needed)

    def _servo_off(self) -> Phases:
        yield from self._wait(Mode.OFF, self._patience.servo_off, unpowered=True)

    def _wait(self, mode: Mode, patience: float, unpowered: bool = False) -> Phases:
        """In `mode` until the rig stands (and has no power), or patience is over."""
        for _ in range(self._windows(patience)):
            for cycles in self._glances():
                yield from self._look(mode, cycles)
                # Cyclic data are judged by whole windows, answers as soon as they are a window apart.
                if self._is_deaf() and self._is_over(unpowered):
                    return
            if self._is_over(unpowered):
                return

    def _is_over(self, unpowered: bool) -> bool:
        return not self._observers.moving() and not (unpowered and self._observers.powered())

    def _inquire(self) -> Phases:
        """Wait for the observers that can still be asked, with the servo off, until they say that the rig stands."""
        observers = self._observers
        for _ in range(self._windows(self._patience.servo_off)):
            for cycles in self._glances():
                can_tell = set(observers.unheard()) - observers.mute
                missing = observers.problem() or can_tell & set(observers.silent())
                if self._line is None or not self._machine.rows or not can_tell or not missing:
                    return
                yield from self._look(Mode.OFF, cycles)

    def _glances(self) -> list[int]:
        """A window, cut into the cycles after which somebody looks at who is heard."""
        whole, rest = divmod(self._window, GLANCES)
        return [cycles for i in range(GLANCES) if (cycles := whole + (i < rest))]

    def _look(self, mode: Mode, cycles: int) -> Phases:
        """Some cycles in `mode`; devices that are silent are asked meanwhile."""
        line, stage = self._line, f"{self._stage.value} by SDO"
        if line is not None:
            if mode is not self._asked_in:
                self._asked_in = mode
                line.withdraw(STATUSWORD)
            reach = {name: line.reach(name) for name in self._observers.wanted}
            # Not while it is being asked, unless it must be asked otherwise now.
            due = [n for n, by in reach.items() if line.is_idle(n) or by is not self._asked.get(n)]
            insists, self._asked = self._insists(), reach
            line.hand([r for n in due for r in requests_for(line, n, mode, insists=insists)])
            if self._is_deaf() and mode in STOP and self.report.stages[-1] != stage:
                self.report.stages.append(stage)
        # The drive leaves operation here on purpose: its state is waited for, not guarded.
        yield Phase(mode, cycles, enabled=False)
        if line is not None:
            self._observers.hear(line.answers())

    def _windows(self, patience: float) -> int:
        return max(1, math.ceil(patience / self._patience.window))

    _STAGES: ClassVar[dict[Stage, Callable[[MakeSafe], Phases]]] = {
        Stage.RAMP_DOWN: _ramp_down,
        Stage.QUICK_STOP: _quick_stop,
        Stage.ZERO_REFERENCE: _quick_stop,
        Stage.SERVO_OFF: _servo_off,
    }
