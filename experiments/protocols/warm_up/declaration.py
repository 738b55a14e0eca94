"""Warm-up: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import TORQUES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import Acceleration, SyncRate, ZeroTime
from experiments.quantity import (
    OF_TORQUE_DIFFERENCES,
    Quantity,
)
from experiments.terms import MOTOR_AND_GEAR, RUNNING_TORQUE

NAME = "warm-up"

QUANTITIES = (
    Quantity(
        name="running_torque",
        title="running torque",
        unit="N m",
        definition="half-difference of the directions at the speed of the warm-up: the friction of all that the motor "
        "turns (itself, the gear, the bench's output bearing), as warm as in the two holds",
        target_uncertainty=0.01,
        target_reason="a tenth of what catalogues state for this size, 0.1 N m",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(name="speed", title="speed of the running torque", unit="rad/s"),
    Quantity(name="housing_temperature", title="housing temperature", unit="°C"),
    Quantity(
        name="torque_constant_factor",
        title="torque constant over that at 20 °C",
        unit="1",
        definition="by the housing's temperature; the running torque is what the port showed, times this",
    ),
    Quantity(name="last_change", title="last change", unit="N m"),
    Quantity(name="total_change", title="total change", unit="N m"),
    Quantity(name="time_until_steady", title="time until steady", unit="s"),
    Quantity(name="steady", title="steady", unit="1"),
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a warm-up run can be told."""

    speed_rpm: Annotated[float, Gt(0.0), Le(10000.0), Unit("r/min"), Help("input speed")] = 1500.0
    window: Annotated[
        float,
        Gt(0.0),
        Le(600.0),
        Unit("s"),
        Help("window of the mean torque, rounded up to whole revolutions"),
    ] = 30.0
    tolerance: Annotated[
        float, Gt(0.0), Le(1.0), Unit("N m"), Help("largest change of torque from window to window")
    ] = 0.0005
    at_most: Annotated[float, Gt(0.0), Le(86400.0), Unit("s"), Help("longest time")] = 1800.0
    acceleration: Acceleration = 500.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0


EXPERIMENT = Experiment(
    name=NAME,
    title="Warm-up",
    summary="turn until the running torque is steady",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.warm_up.plan:plan"),
    analyse=Deferred("experiments.protocols.warm_up.analysis:analyse"),
    asks=Need(channels=(("input_angle",), TORQUES), labels=("warm-up",)),
    short={"zero_time": 0.5, "window": 5.0, "at_most": 60.0},
    needs=("input_angle", "torque"),
    quantities=QUANTITIES,
    version=5,
    live=("speed", "temperature", "torque"),
    terms=(RUNNING_TORQUE, MOTOR_AND_GEAR),
)
