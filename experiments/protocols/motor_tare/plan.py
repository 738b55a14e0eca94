"""Motor tare: what a run does."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.planning.parts import between_zeros, checked
from experiments.protocols.friction import declaration as friction_declaration
from experiments.protocols.friction import plan as friction_plan
from experiments.protocols.motor_tare.declaration import NAME, Parameters
from experiments.steps.vocabulary import Prompt, Step
from model.gear import HarmonicDrive


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; every speed in both directions, settled, over whole revolutions of the bare motor; torque zero."""
    checked(parameters, Parameters, NAME)
    settings = _as_friction(parameters)
    speeds = friction_plan.sweep_speeds(settings, gear, NAME)
    return between_zeros(_points(parameters, settings, speeds), parameters.zero_time)


def _as_friction(p: Parameters) -> friction_declaration.Parameters:
    """The friction protocol with these speeds, so that the tare runs exactly the speeds that it is for."""
    return friction_declaration.Parameters(
        lowest_rpm=p.lowest_rpm,
        highest_rpm=p.highest_rpm,
        points=p.points,
        speeds_rpm=p.speeds_rpm,
        measure_time=p.measure_time,
        settle_time=p.settle_time,
        acceleration=p.acceleration,
        sync_rate=p.sync_rate,
    )


def _points(
    p: Parameters, settings: friction_declaration.Parameters, speeds: tuple[float, ...]
) -> Iterator[Step]:
    yield Prompt(
        "Take the gear off, and have the motor as warm as in the run that this tare is for.",
        "gear-removed",
        consent="The gear is removed and the motor is warm",
    )
    for repeat in range(p.repeats):
        for speed in speeds:
            for direction in (1, -1):
                yield from friction_plan.constant_speed(settings, direction * speed, "hold", repeat)
