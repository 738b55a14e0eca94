"""The engine: turns the steps of a plan into commands, opens and closes segments, and ends feedback
steps on what it sees.

Each kind of step is one short generator of phases. Conditions are either bounds that the port
watches in every cycle, or means over windows that end at fixed cycles: nothing depends on how the
run is cut into blocks. A step that does not end within its `at_most` is a `StepFailedError`: a rig
that is broken must not fail a gear.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from drivers.channel import DRIVE_TORQUE, INDEX_SEEN, INPUT_ANGLE, INPUT_INDEX, OUTPUT_INDEX, TORQUE
from drivers.drive_state import POWERED_STATES, DriveState
from drivers.port import Bound, Mode
from drivers.samples import SampleBlock
from experiments import steps as s
from model.units import REVOLUTION, RPM
from rig.errors import RigError
from rig.run.phases import Machine, Phase, PhaseRunner, Phases, Turn
from rig.run.trajectory import Constant, cruise_speed, cycles_of, ramp, stopping_distance

ENABLE_WINDOW = 0.05
"""s; the drive's state is looked at after each window while it is switched on or off."""
ENABLE_PATIENCE = 2.0
"""s until a drive that does not switch on or off is an error."""
STAND_TIME = 0.05
"""s of standstill at the end of a move."""
SHORTEST_APPROACH = 0.1
"""rad; an angle that is nearer than this is approached by a whole revolution, so that it is reached
from the stated side.
"""
CUT = " (cut)"
"""Added to the label of a segment that was ended by a stop or a trip, so that no analysis takes it for a whole one."""


class StepFailedError(RigError):
    """A step of the plan that the rig did not complete within its time."""


class Journal(Protocol):
    """Where segments (rows [start, stop)) and events go."""

    def segment(self, label: s.SegmentLabel, start: int, stop: int) -> None:
        """Keep a finished segment."""
        ...

    def event(self, level: str, code: str, source: str, text: str) -> None:
        """Keep an event."""
        ...


Ask = Callable[[s.Prompt], "str | None"]
"""Puts a prompt to the operator: the answer, or None while there is none yet."""


class Engine:
    """Walks a plan on a rig. `next(block)` gives the next turn, None when the plan is over."""

    def __init__(
        self,
        plan: Sequence[s.Step],
        machine: Machine,
        journal: Journal,
        ask: Ask,
        block_cycles: int = 1000,
    ) -> None:
        self.plan = tuple(plan)
        self.index = 0
        self._machine = machine
        self._journal = journal
        self._ask = ask
        self._open: tuple[s.SegmentLabel, int] | None = None
        self._runner = PhaseRunner(self._walk(), machine, block_cycles)

    def next(self, block: SampleBlock | None) -> Turn | None:
        """The next turn after `block`, or None when the plan is over. Raises `StepFailedError`."""
        return self._runner.next(block)

    @property
    def step(self) -> s.Step | None:
        """The step that is being executed."""
        return self.plan[self.index] if self.index < len(self.plan) else None

    def cut(self) -> None:
        """Close the open segment because the plan ends here, and mark it as cut."""
        if self._open is not None:
            label, start = self._open
            self._open = (
                s.SegmentLabel(label.label + CUT, label.setpoint, label.direction, label.repeat),
                start,
            )
            self._close_segment()

    def _walk(self) -> Phases:
        for index, step in enumerate(self.plan):
            self.index = index
            if isinstance(step, s.Mark):
                self._journal.event("info", step.code, "protocol", step.text)
            elif isinstance(step, s.Prompt):
                yield from self._prompt(step)
            else:
                yield from self._prepare(step)
                if step.segment is not None:
                    self._open = (step.segment, self._machine.rows)
                yield from _WALK[type(step)](step, self._machine, self._journal)
                self._close_segment()
        self.index = len(self.plan)

    def _close_segment(self) -> None:
        if self._open is None:
            return
        label, start = self._open
        self._open = None
        if self._machine.rows > start:
            self._journal.segment(label, start, self._machine.rows)

    def _prompt(self, prompt: s.Prompt) -> Phases:
        """Hold what is (servo off, or the present set-point) in windows until there is an answer."""
        m = self._machine
        answer = self._ask(prompt)
        while answer is None:
            mode = Mode.SPEED if m.mode is Mode.SPEED else Mode.OFF
            yield Phase(mode, cycles_of(ENABLE_WINDOW, m.period), Constant(m.setpoint))
            answer = self._ask(prompt)
        text = f"{prompt.text} {answer}".strip()
        self._journal.event("info", prompt.key or "prompt", "operator", text)

    def _prepare(self, step: s.Step) -> Phases:
        """Bring the drive into the mode that the step needs, before its segment opens."""
        m = self._machine
        wanted = _mode_of(step)
        window = cycles_of(ENABLE_WINDOW, m.period)
        if wanted is Mode.OFF and m.mode is not Mode.OFF:
            yield from self._until_state(
                Mode.OFF, lambda state: state not in POWERED_STATES, "switch off", window
            )
        elif wanted is not Mode.OFF and m.mode not in (Mode.SPEED, Mode.TORQUE):
            yield from self._until_state(
                wanted, lambda state: state is DriveState.ENABLED, "switch on", window
            )
        elif m.mode is Mode.TORQUE and wanted is Mode.SPEED and not isinstance(step, s.Ramp):
            yield Phase(Mode.SPEED, window)

    def _until_state(
        self, mode: Mode, good: Callable[[DriveState], bool], what: str, window: int
    ) -> Phases:
        m = self._machine
        for _ in range(math.ceil(ENABLE_PATIENCE / ENABLE_WINDOW)):
            yield Phase(mode, window, enabled=False)
            state = m.state
            if state is None or good(state):
                return
        raise StepFailedError(
            f"the drive does not {what}",
            where=self._where(),
            value=m.state.value if m.state else "unknown state",
            limit=f"within {ENABLE_PATIENCE:g} s",
            remedy="Look at the drive's display: fault, enable input, safe torque off.",
        )

    def _where(self) -> str:
        return f"step {self.index + 1} of {len(self.plan)}"


def _mode_of(step: s.Step) -> Mode:
    if isinstance(step, s.ServoOff):
        return Mode.OFF
    return Mode.TORQUE if isinstance(step, s.TorqueRamp) else Mode.SPEED


def turned(machine: Machine, angle: float, direction: float) -> Bound:
    """The bound that ends a phase once the input has turned by `angle` [rad] >= 0 in `direction`
    from where it is now.
    """
    channel = machine.channels[INPUT_ANGLE]
    weight = math.copysign(channel.scale, direction) * channel.direction
    # Half a count less: the count nearest to the angle already ends the phase.
    return Bound(
        cause="turned",
        weights={INPUT_ANGLE: weight},
        high=max(angle - 0.5 * channel.scale, 0.0),
        offset=-weight * machine.counts(INPUT_ANGLE),
        is_trip=False,
    )


def _servo_off(step: s.ServoOff, m: Machine, journal: Journal) -> Phases:
    yield Phase(Mode.OFF, cycles_of(step.duration, m.period))


def _ramp(step: s.Ramp, m: Machine, journal: Journal) -> Phases:
    begin = m.speed() if m.mode is Mode.TORQUE else m.setpoint
    profile = ramp(begin, step.speed, step.acceleration, m.period)
    yield Phase(Mode.SPEED, max(profile.cycles, 1), profile)


def _hold_time(step: s.HoldTime, m: Machine, journal: Journal) -> Phases:
    yield Phase(Mode.SPEED, cycles_of(step.duration, m.period), Constant(m.setpoint))


def _speed_step(step: s.SpeedStep, m: Machine, journal: Journal) -> Phases:
    start = m.counts(INPUT_ANGLE)
    enough = turned(m, step.least_revolutions * REVOLUTION, step.speed)
    yield Phase(Mode.SPEED, cycles_of(step.duration, m.period), Constant(step.speed))
    done = abs(m.counts(INPUT_ANGLE) - start) * m.channels[INPUT_ANGLE].scale
    missing = step.least_revolutions * REVOLUTION - done
    if missing > 0.0 and step.speed != 0.0:
        patience = cycles_of(1.5 * missing / abs(step.speed) + 2.0, m.period)
        end = yield Phase(Mode.SPEED, patience, Constant(step.speed), (enough,))
        if end.broken is None:
            raise _overdue(step, m, f"{step.least_revolutions:g} revolutions", patience * m.period)


def _hold_revolutions(step: s.HoldRevolutions, m: Machine, journal: Journal) -> Phases:
    if m.setpoint == 0.0:
        raise StepFailedError(
            "revolutions cannot be counted at standstill", where="HoldRevolutions", value="0 r/min"
        )
    until = turned(m, step.revolutions * REVOLUTION, m.setpoint)
    end = yield Phase(Mode.SPEED, cycles_of(step.at_most, m.period), Constant(m.setpoint), (until,))
    if end.broken is None:
        raise _overdue(step, m, f"{step.revolutions:g} revolutions", step.at_most)


def _settle(step: s.Settle, m: Machine, journal: Journal) -> Phases:
    name = TORQUE if m.has(TORQUE) else DRIVE_TORQUE
    window, left = cycles_of(step.window, m.period), cycles_of(step.at_most, m.period)
    previous = math.nan
    while left >= window:
        end = yield Phase(Mode.SPEED, window, Constant(m.setpoint), tally=name)
        left -= window
        mean = m.channels[name].scale * end.total / end.samples if end.samples else math.nan
        if abs(mean - previous) <= step.tolerance:
            return
        previous = mean
    journal.event(
        "warning",
        "not-settled",
        "engine",
        f"torque at {m.setpoint / RPM:.4g} r/min still changed by more than {step.tolerance:g} "
        f"N m per {step.window:.3g} s "
        f"after {step.at_most:g} s",
    )


def _approach(step: Any, m: Machine, distance: float) -> Phases:
    """Ramp, cruise, brake in time and stand: ends `distance` [rad, signed] from here without coming back."""
    speed = cruise_speed(step.speed, step.acceleration, distance, m.period)
    brake = stopping_distance(speed, step.acceleration, m.period)
    until = turned(m, max(abs(distance) - brake, 0.0), distance)
    away = ramp(m.setpoint, math.copysign(speed, distance), step.acceleration, m.period)
    end = yield Phase(Mode.SPEED, cycles_of(step.at_most, m.period), away, (until,))
    if end.broken is None:
        raise _overdue(step, m, f"{distance / REVOLUTION:.4g} revolutions", step.at_most)
    stop = ramp(m.setpoint, 0.0, step.acceleration, m.period)
    yield Phase(Mode.SPEED, max(stop.cycles, 1), stop)
    yield Phase(Mode.SPEED, cycles_of(STAND_TIME, m.period))


def _move_to_angle(step: s.MoveToAngle, m: Machine, journal: Journal) -> Phases:
    channel = m.channels[INPUT_ANGLE]
    origin = (
        int(m.first[m.column[INPUT_ANGLE]]) * channel.direction * channel.scale + channel.offset
    )
    if m.has(INPUT_INDEX) and m.has(INDEX_SEEN) and m.counts(INDEX_SEEN) & 1:
        origin = m.si(INPUT_INDEX)
    ahead = math.copysign(1.0, step.speed) * (origin + step.phase - m.si(INPUT_ANGLE))
    ahead %= REVOLUTION
    if ahead < max(SHORTEST_APPROACH, step.speed**2 / step.acceleration):
        ahead += REVOLUTION
    yield from _approach(step, m, math.copysign(ahead, step.speed))


def _move_revolutions(step: s.MoveRevolutions, m: Machine, journal: Journal) -> Phases:
    yield from _approach(step, m, step.revolutions * REVOLUTION)


def _find_index(step: s.FindIndex, m: Machine, journal: Journal) -> Phases:
    latch, bit = (INPUT_INDEX, 1) if step.which == "input" else (OUTPUT_INDEX, 2)
    if not (m.has(latch) and m.has(INDEX_SEEN)):
        raise StepFailedError(
            "this rig does not report index marks",
            where="FindIndex",
            value=step.which,
            limit=f"channels {latch}, {INDEX_SEEN}",
        )
    if m.counts(INDEX_SEEN) & bit:
        until = Bound(
            cause="index",
            weights={latch: 1.0},
            low=-0.5,
            high=0.5,
            offset=-float(m.counts(latch)),
            is_trip=False,
        )
    else:
        until = Bound(cause="index", weights={INDEX_SEEN: 1.0}, high=0.5, mask=bit, is_trip=False)
    end = yield Phase(Mode.SPEED, cycles_of(step.at_most, m.period), Constant(step.speed), (until,))
    if end.broken is None:
        raise _overdue(step, m, f"the {step.which} index mark", step.at_most)
    angle = m.si(latch)
    journal.event(
        "info",
        f"index-{step.which}",
        "engine",
        f"{step.which} index mark latched at {angle:.6f} rad",
    )


def _torque_ramp(step: s.TorqueRamp, m: Machine, journal: Journal) -> Phases:
    limit = math.copysign(step.limit, step.rate)
    profile = ramp(0.0, limit, abs(step.rate), m.period)
    channel = m.channels[INPUT_ANGLE]
    moved = Bound(
        cause="motion",
        weights={INPUT_ANGLE: channel.scale},
        low=-step.motion,
        high=step.motion,
        offset=-channel.scale * m.counts(INPUT_ANGLE),
        is_trip=False,
    )
    end = yield Phase(Mode.TORQUE, max(profile.cycles, 1), profile, (moved,))
    torque = float(profile.targets(end.cycles - 1, 1)[0])
    if end.broken is None:
        journal.event("warning", "no-motion", "engine", f"no motion up to {torque:.4g} N m")
    else:
        journal.event(
            "info", "first-motion", "engine", f"first motion at {torque:.4g} N m of set-point"
        )


def _overdue(step: s.Step, m: Machine, what: str, allowed: float) -> StepFailedError:
    return StepFailedError(
        f"{type(step).__name__} did not reach {what} in time",
        where=f"row {m.rows}",
        value=f"input speed {m.speed(cycles=100) / RPM:.4g} r/min at set-point {m.setpoint / RPM:.4g} r/min",
        limit=f"{allowed:g} s",
        remedy="Is the input free to turn, and does the encoder count?",
    )


_WALK: dict[type[Any], Callable[[Any, Machine, Journal], Phases]] = {
    s.ServoOff: _servo_off,
    s.Ramp: _ramp,
    s.SpeedStep: _speed_step,
    s.HoldRevolutions: _hold_revolutions,
    s.HoldTime: _hold_time,
    s.Settle: _settle,
    s.MoveToAngle: _move_to_angle,
    s.MoveRevolutions: _move_revolutions,
    s.FindIndex: _find_index,
    s.TorqueRamp: _torque_ramp,
}


def describe(step: s.Step | None) -> str:
    """A step in a few words, for the progress line and for messages."""
    if step is None:
        return "finished"
    label = getattr(step, "segment", None)
    name = label.label if label is not None else type(step).__name__
    if isinstance(step, (s.Ramp, s.SpeedStep, s.FindIndex)):
        return f"{name} {step.speed / RPM:.4g} r/min"
    if label is not None and label.direction and label.label not in ("torque-ramp", "position"):
        return f"{name} {label.setpoint / RPM:.4g} r/min"
    return name
