"""Warm-up: what a run does."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.planning.parts import (
    between_zeros,
    checked,
    longest,
    ramp,
    stop,
    whole_revolutions,
    window_of,
)
from experiments.planning.speeds import incommensurate, refuse_speed
from experiments.protocols.warm_up.declaration import NAME, Parameters
from experiments.steps.vocabulary import HoldRevolutions, SegmentLabel, Settle, Step
from model.gear import HarmonicDrive
from model.units import RPM


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; forward until steady, then the same number of revolutions of one window in reverse; torque zero."""
    checked(parameters, Parameters, NAME)
    refuse_speed(parameters.speed_rpm, gear, f"{NAME}.speed_rpm")
    return between_zeros(_turns(parameters), parameters.zero_time)


def _turns(p: Parameters) -> Iterator[Step]:
    speed = incommensurate(p.speed_rpm * RPM, p.sync_rate, p.window)
    yield ramp(speed, p.acceleration, 1)
    yield Settle(
        window_of(speed, p.window), p.tolerance, p.at_most, SegmentLabel("warm-up", speed, 1)
    )
    turns = whole_revolutions(speed, min(p.window, 5.0))
    for direction in (1, -1):
        setpoint = direction * speed
        yield ramp(setpoint, p.acceleration, direction)
        yield HoldRevolutions(
            turns, longest(turns, speed), SegmentLabel("settle", setpoint, direction)
        )
        yield HoldRevolutions(
            turns, longest(turns, speed), SegmentLabel("hold", setpoint, direction)
        )
        yield stop(p.acceleration)
