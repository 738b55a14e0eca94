"""Velocity steps: what a run does."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.errors import PlanError
from experiments.planning.parts import between_zeros, checked, stop
from experiments.planning.speeds import first_resonances, refuse_speed
from experiments.protocols.velocity_steps.declaration import Parameters
from experiments.protocols.velocity_steps.quantities import NAME
from experiments.steps.vocabulary import HoldTime, MoveToAngle, SegmentLabel, SpeedStep, Step
from model.gear import HarmonicDrive
from model.units import REVOLUTION, RPM


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; for each repeat, speed and direction: a stated wave-generator angle, rest, step,
    stop; torque zero.
    """
    checked(parameters, Parameters, NAME)
    if not parameters.speeds_rpm:
        raise PlanError(
            "the list of speeds is empty",
            where=f"{NAME}.speeds_rpm",
            remedy="Give at least one speed.",
        )
    for rpm in (*parameters.speeds_rpm, parameters.approach_rpm):
        refuse_speed(rpm, gear, f"{NAME}.speeds_rpm")
    expected = first_resonances(gear)[-1] / REVOLUTION
    if expected > RESONANCE_SHARE * parameters.sync_rate:
        raise PlanError(
            "the resonance that the card predicts lies too near half the sampling rate",
            where=f"{NAME}.sync_rate",
            value=f"{expected:.4g} Hz at {parameters.sync_rate:g} Hz",
            limit=f"<= {RESONANCE_SHARE * parameters.sync_rate:.4g} Hz",
            remedy=f"Record at {expected / RESONANCE_SHARE:.0f} Hz or more (--sample-rate).",
        )
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
                    phase,
                    slow,
                    p.acceleration,
                    at_most,
                    SegmentLabel("position", phase, direction, repeat),
                )
                yield HoldTime(p.rest_time, SegmentLabel("rest", setpoint, direction, repeat))
                label = SegmentLabel("step", setpoint, direction, repeat)
                yield SpeedStep(setpoint, p.duration, p.revolutions, label)
                yield stop(p.acceleration)


RESONANCE_SHARE = 0.4
"""Share of the sampling rate above which no resonance is identified."""
