"""Motor tare: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import TORQUES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import (
    Acceleration,
    HighestSpeed,
    MeasureTime,
    Points,
    Repeats,
    SettleTime,
    Speeds,
    SyncRate,
    ZeroTime,
)
from experiments.protocols.friction.quantities import at_reference
from experiments.quantity import (
    ANGLES_IN_ITS_BUDGET,
    OF_TORQUE_DIFFERENCES,
    Quantity,
)
from experiments.shape import Shape

NAME = "motor-tare"

NAMES = ("motor_coulomb", "motor_viscous")

QUANTITIES = (
    Quantity(
        name="motor_coulomb",
        title="motor, Coulomb friction",
        unit="N m",
        target_uncertainty=3e-3,
        target_reason="subtracted from a gear's torque, of which it is a thirtieth",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="motor_viscous",
        title="motor, viscous friction",
        unit="N m s/rad",
        target_uncertainty=1e-5,
        target_reason="3 mN m at 3000 r/min: as of Coulomb friction",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name=at_reference("motor_coulomb"),
        title="motor, Coulomb friction at 20 °C",
        unit="N m",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name=at_reference("motor_viscous"),
        title="motor, viscous friction at 20 °C",
        unit="N m s/rad",
        rests_on=OF_TORQUE_DIFFERENCES,
    ),
    Quantity(
        name="offset",
        title="offset",
        unit="N m",
        definition="half-sum of the directions: rest of the zero and asymmetry",
        is_signed=True,
        rests_on={"torque": "proportional", **ANGLES_IN_ITS_BUDGET},
    ),
    Quantity(name="speeds", title="speeds", unit="1"),
    Quantity(name="housing_temperature", title="housing temperature", unit="°C"),
    Quantity(name="torque_zero_drift", title="torque zero drift", unit="N m"),
    Quantity(
        name="cogging_peak_to_peak",
        title="cogging seen through the servo's closed loop, peak to peak",
        unit="N m",
        definition="torque over angle that the drive asks for at constant speed: of the motor's cogging "
        "what the speed loop follows",
    ),
    Quantity(
        name="strongest_cogging_order",
        title="strongest order of the cogging seen through the servo's closed loop",
        unit="1",
    ),
)

LINE = Shape(
    title="the motor's friction over speed",
    numbers=len(NAMES),
    names=(*NAMES, *(at_reference(name) for name in NAMES)),
    labels=("hold",),
)
"""The straight line through the half-differences of the holds."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a motor-tare run can be told; speeds are those of the friction protocol."""

    lowest_rpm: Annotated[float, Gt(0.0), Le(6000.0), Unit("r/min"), Help("lowest input speed")] = (
        1.0
    )
    highest_rpm: HighestSpeed = 3000.0
    points: Points = 30
    speeds_rpm: Speeds = ()
    repeats: Repeats = 1
    measure_time: MeasureTime = 1.0
    settle_time: SettleTime = 0.6
    acceleration: Acceleration = 800.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0


EXPERIMENT = Experiment(
    name=NAME,
    title="Motor tare",
    summary="friction and cogging of the bare motor, gear removed",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.motor_tare.plan:plan"),
    analyse=Deferred("experiments.protocols.motor_tare.analysis:analyse"),
    asks=Need(channels=(("input_angle",), TORQUES), labels=("hold",), gear_off=True),
    short={
        "zero_time": 0.5,
        "points": 6,
        "lowest_rpm": 60.0,
        "measure_time": 0.2,
        "settle_time": 0.2,
    },
    needs=("input_angle", "torque"),
    gear_mounted=False,
    quantities=QUANTITIES,
    version=11,
    live=("speed", "torque points", "torque"),
    gives_tare=True,
    shapes=(LINE,),
)
