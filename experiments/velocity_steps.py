"""Velocity steps: the input jumps to a speed, the output follows; simulated output against measured output per speed.

(2) with the measured input prescribed; figure 19.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from experiments.errors import PlanError
from experiments.parameters import Help, Unit
from experiments.plan_parts import between_zeros, checked, stop
from experiments.shared_parameters import Acceleration, Repeats, SlowSpeed, ZeroTime
from experiments.speeds import refuse_speed
from experiments.steps import HoldTime, MoveToAngle, SegmentLabel, SpeedStep, Step
from model.gear import HarmonicDrive
from model.units import REVOLUTION, RPM

NAME = "velocity-steps"


@dataclass(frozen=True)
class Parameters:
    """What a velocity-step run can be told."""

    speeds_rpm: Annotated[
        tuple[float, ...], Gt(0.0), Le(10000.0), Unit("r/min"), Help("input speeds of the steps")
    ] = (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 2400.0, 3000.0)  # fmt: skip
    repeats: Repeats = 2
    duration: Annotated[float, Ge(0.05), Le(600.0), Unit("s"), Help("time at speed, long enough for the ring-down")] = (
        1.5
    )
    revolutions: Annotated[float, Ge(3.0), Le(1000.0), Unit("rev"), Help("least input revolutions of a step")] = 3.0
    rest_time: Annotated[float, Ge(0.1), Le(60.0), Unit("s"), Help("standstill before each step")] = 0.5
    approach_rpm: SlowSpeed = 30.0
    acceleration: Acceleration = 500.0
    zero_time: ZeroTime = 3.0


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; for each repeat, speed and direction: a stated wave-generator angle, rest, step, stop; torque zero."""
    checked(parameters, Parameters, NAME)
    if not parameters.speeds_rpm:
        raise PlanError("the list of speeds is empty", where=f"{NAME}.speeds_rpm", remedy="Give at least one speed.")
    for rpm in (*parameters.speeds_rpm, parameters.approach_rpm):
        refuse_speed(rpm, gear, f"{NAME}.speeds_rpm")
    return between_zeros(_steps(parameters), parameters.zero_time)


def start_phase(repeat: int, repeats: int) -> float:
    """The wave-generator angle [rad] from which the steps of one repeat start."""
    return REVOLUTION * repeat / repeats


def _steps(p: Parameters) -> Iterator[Step]:
    slow = p.approach_rpm * RPM
    at_most = 5.0 * REVOLUTION / slow + 10.0
    for repeat in range(p.repeats):
        phase = start_phase(repeat, p.repeats)
        for rpm in p.speeds_rpm:
            for direction in (1, -1):
                setpoint = direction * rpm * RPM
                yield MoveToAngle(
                    phase, slow, p.acceleration, at_most, SegmentLabel("position", phase, direction, repeat)
                )
                yield HoldTime(p.rest_time, SegmentLabel("rest", setpoint, direction, repeat))
                label = SegmentLabel("step", setpoint, direction, repeat)
                yield SpeedStep(setpoint, p.duration, p.revolutions, label)
                yield stop(p.acceleration)
