"""Kinematic error: what a run does."""

from __future__ import annotations

import math
from collections.abc import Iterator

from experiments.errors import PlanError
from experiments.planning.parts import between_zeros, checked, longest, output_travel, ramp, stop
from experiments.planning.speeds import (
    CORRECTED,
    JUDGED_ORDER,
    QUASI_STATIC,
    first_resonances,
    quiet_speed,
    refuse_speed,
)
from experiments.protocols.kinematic_error.declaration import NAME, Parameters
from experiments.steps.vocabulary import HoldRevolutions, Mark, Prompt, SegmentLabel, Step
from model.gear import HarmonicDrive
from model.units import REVOLUTION, RPM


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; forward and reverse over whole output revolutions at constant speed, repeated; torque zero.

    A speed at which samples fall on the output counts again and again is moved by up to 1.5 %.
    Raises `PlanError` for one at which the orders come near the first torsional mode.
    """
    checked(parameters, Parameters, NAME)
    refuse_speed(parameters.speed_rpm, gear, f"{NAME}.speed_rpm")
    output_travel(gear, parameters.mounting, 1.0, NAME)
    speed = quiet_speed(
        parameters.speed_rpm,
        gear,
        parameters.mounting,
        parameters.sync_rate,
        parameters.output_counts,
        f"{NAME}.speed_rpm",
    )
    _refuse_near_mode(speed, gear)
    return between_zeros(_traverses(parameters, gear, speed), parameters.zero_time)


def _traverses(p: Parameters, gear: HarmonicDrive, speed: float) -> Iterator[Step]:
    travel = output_travel(gear, p.mounting, p.output_revolutions, NAME)
    if p.mounted_at_deg is not None:
        place = f"at {p.mounted_at_deg:g} degrees on the output flange"
        yield Prompt(
            f"Take the gear off and mount it {place}, counted as the output encoder counts up.",
            "mounted-at",
            consent=f"The gear is mounted {place}",
        )
    yield from _remarks(p, gear, speed)
    for repeat in range(p.repeats):
        for direction in (1, -1):
            setpoint = direction * speed
            yield ramp(setpoint, p.acceleration, direction)
            approach = SegmentLabel("approach", setpoint, direction, repeat)
            yield HoldRevolutions(
                p.approach_revolutions, longest(p.approach_revolutions, speed), approach
            )
            yield HoldRevolutions(
                travel,
                longest(travel, speed, 0.1),
                SegmentLabel("traverse", setpoint, direction, repeat),
            )
            yield stop(p.acceleration)


def _judged_order(gear: HarmonicDrive) -> float:
    return max(JUDGED_ORDER, *(h.order for h in gear.kinematic_error), 0.0)


def _refuse_near_mode(speed: float, gear: HarmonicDrive) -> None:
    """Raise `PlanError` where the torsional vibration would make too much of the highest order."""
    order, first = _judged_order(gear), first_resonances(gear)[0]
    highest = math.sqrt(CORRECTED) * first / order
    if speed > highest * (1.0 + 1e-9):
        raise PlanError(
            f"order {order:g} of the kinematic error comes near the first torsional mode, "
            f"{first / REVOLUTION:.3g} Hz by the parameter set",
            where=f"{NAME}.speed_rpm",
            value=f"{speed / RPM:.4g} r/min",
            limit=f"<= {math.floor(10.0 * highest / RPM) / 10.0:g} r/min",
            remedy="Choose a slower speed, or a smaller inertia at the output.",
        )


def _remarks(p: Parameters, gear: HarmonicDrive, speed: float) -> Iterator[Step]:
    """Events that say how far the speed is from the first mode and from the lattice of the output counts."""
    order = _judged_order(gear)
    margin = first_resonances(gear)[0] / (order * speed)
    text = f"order {order:g} at {speed / RPM:.4g} r/min is {margin:.1f} times below the first torsional mode"
    quasi_static = margin**-2 <= QUASI_STATIC
    yield Mark("quasi-static" if quasi_static else "not-quasi-static", text)
    if speed != p.speed_rpm * RPM:
        text = (
            f"{p.speed_rpm:g} r/min at {p.sync_rate:g} Hz samples the output counts almost in step with the "
            f"input: the run turns at {speed / RPM:.5g} r/min, where their rounding averages out"
        )
        yield Mark("speed-moved", text)
