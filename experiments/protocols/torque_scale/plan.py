"""Torque scale: what a run does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

from experiments.errors import PlanError
from experiments.planning.parts import between_zeros, checked, ramp, stop
from experiments.planning.speeds import refuse_speed
from experiments.protocols.torque_scale.declaration import NAME, Parameters
from experiments.protocols.torque_scale.disc import disc_of, is_told_twice
from experiments.steps.vocabulary import HoldTime, Prompt, SegmentLabel, Step
from model.gear import HarmonicDrive
from model.units import RPM

LEAST_ACCELERATIONS = 3
"""So that a scale that depends on the torque is seen."""


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; ramps up and down between two speeds, both ways, at each acceleration; torque zero."""
    checked(parameters, Parameters, NAME)
    if len(set(parameters.accelerations)) < LEAST_ACCELERATIONS:
        raise PlanError(
            "too few accelerations: a scale that depends on the torque would not be seen",
            where=f"{NAME}.accelerations",
            value=", ".join(f"{a:g}" for a in parameters.accelerations),
            limit=f">= {LEAST_ACCELERATIONS} different ones",
        )
    if not parameters.lowest_rpm < parameters.highest_rpm:
        raise PlanError(
            "the ramps have no length",
            where=f"{NAME}.highest_rpm",
            value=parameters.highest_rpm,
            limit=f"> {parameters.lowest_rpm:g} r/min (lowest_rpm)",
        )
    refuse_speed(parameters.highest_rpm, gear, f"{NAME}.highest_rpm")
    if is_told_twice(asdict(parameters)):
        raise PlanError(
            "the disc is stated twice",
            where=f"{NAME}.inertia",
            value=f"{parameters.inertia:g} kg m2 beside a mass",
            limit="either the inertia, or mass and diameters",
        )
    return between_zeros(_ramps(parameters), parameters.zero_time)


def _ramps(p: Parameters) -> Iterator[Step]:
    disc = disc_of(asdict(p))
    on = "nothing on its shaft" if not disc.inertia else f"{disc.words} on its shaft"
    yield Prompt(
        f"Take the gear off and leave the motor with {on}, balanced, tight, and behind a guard.",
        "disc-mounted",
        consent=f"The gear is removed; the motor has {on}",
    )
    low, high = p.lowest_rpm * RPM, p.highest_rpm * RPM
    for acceleration in p.accelerations:
        for direction in (1, -1):
            yield ramp(direction * low, acceleration, direction)
            for _ in range(p.repeats):
                for speed, target in ((low, high), (high, low)):
                    yield HoldTime(p.dwell_time, SegmentLabel("settle", direction * speed))
                    yield ramp(direction * target, acceleration, direction)
            yield HoldTime(p.dwell_time, SegmentLabel("settle", direction * low))
            yield stop(acceleration)
