"""What a step sees of the rig while it turns, and what its conditions mean in counts.

A step speaks of angles and index marks (`experiments.steps.course`), a port of counts and bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import assert_never

from drivers.channel import INDEX_SEEN, INPUT_ANGLE, INPUT_INDEX, OUTPUT_INDEX
from drivers.port import Bound, Mode
from experiments.steps.course import Displaced, Goal, IndexPassed, Turned, Until
from model.units import RPM
from rig.errors import RigError
from rig.run.phases import Journal, Machine


class StepFailedError(RigError):
    """A step of the plan that the rig did not complete within its time."""


@dataclass(frozen=True, slots=True)
class MachineView:
    """The machine as the `RigView` of a step; events go to the journal as the engine's."""

    machine: Machine
    journal: Journal

    @property
    def period(self) -> float:
        """SYNC period [s]."""
        return self.machine.period

    @property
    def setpoint(self) -> float:
        """The present speed set-point [rad/s]."""
        return self.machine.setpoint

    def speed(self) -> float:
        """The set-point, under torque control the speed as measured [rad/s]."""
        m = self.machine
        return m.speed() if m.mode is Mode.TORQUE else m.setpoint

    def input_angle(self) -> float:
        """The latest input angle [rad]."""
        return self.machine.si(INPUT_ANGLE)

    def phase_origin(self) -> float:
        """The latest input index mark, else where the run started [rad]."""
        m = self.machine
        if m.has(INPUT_INDEX) and m.has(INDEX_SEEN) and m.counts(INDEX_SEEN) & 1:
            return m.si(INPUT_INDEX)
        channel = m.channels[INPUT_ANGLE]
        first = int(m.first[m.column[INPUT_ANGLE]])
        return first * channel.direction * channel.scale + channel.offset

    def index_angle(self, which: str) -> float:
        """The angle at the latest index mark of an encoder [rad]."""
        return self.machine.si(_latch(which)[0])

    def note(self, level: str, code: str, text: str) -> None:
        """An event."""
        self.journal.event(level, code, "engine", text)


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


def overdue(kind: str, goal: Goal, machine: Machine) -> StepFailedError:
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


def _latch(which: str) -> tuple[str, int]:
    """The channel that latches an index mark, and its bit of `INDEX_SEEN`."""
    return (INPUT_INDEX, 1) if which == "input" else (OUTPUT_INDEX, 2)


def _index_bound(which: str, machine: Machine) -> Bound:
    latch, bit = _latch(which)
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
