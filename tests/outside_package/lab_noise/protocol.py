"""Torque noise: what the torque port shows while the servo holds the input still."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from harmonic_rig.protocols import (
    Deferred,
    Experiment,
    Ge,
    HarmonicDrive,
    Help,
    HoldTime,
    Le,
    Quantity,
    SegmentLabel,
    Step,
    Unit,
    ZeroTime,
    between_zeros,
    checked,
)

NAME = "torque-noise"
QUANTITIES = (
    Quantity(
        name="noise",
        title="noise of the torque port",
        unit="N m",
        shown="mN m",
        definition="standard deviation of the torque at standstill, servo on",
        is_key=True,
        is_watched=True,
    ),
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a run of torque noise can be asked for."""

    duration: Annotated[float, Ge(1.0), Le(600.0), Unit("s"), Help("time at standstill")] = 5.0
    zero_time: ZeroTime = 3.0


def plan(parameters: Parameters, gear: HarmonicDrive) -> Iterator[Step]:
    """Torque zero; standstill with the servo on; torque zero."""
    checked(parameters, Parameters, NAME)
    still = HoldTime(parameters.duration, SegmentLabel("hold"))
    return between_zeros((still,), parameters.zero_time)


EXPERIMENT = Experiment(
    name=NAME,
    title="Torque noise",
    summary="what the torque port shows at standstill, servo on",
    parameters=Parameters,
    plan=plan,
    analyse=Deferred("lab_noise.noise:analyse"),
    needs=("torque",),
    quantities=QUANTITIES,
    live=("speed", "torque"),
    short={"duration": 1.0},
)
