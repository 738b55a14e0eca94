"""No-load starting torque: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import TORQUES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import Acceleration, Repeats, SlowSpeed, ZeroTime
from experiments.protocols.starting_torque.quantities import QUANTITIES
from experiments.setting import DRY_PER_KELVIN, OUTPUT_BEARING, PER_KELVIN_SOURCE
from experiments.terms import MOTOR_AND_GEAR, Term

NAME = "starting-torque"


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a starting-torque run can be told.

    The usual 23 positions share no factor with the orders at which motors cog (12, 24, 36, 48, 72):
    on 8 positions order 24 stands at the same phase in all of them and is read as friction.
    """

    positions: Annotated[
        int,
        Ge(2),
        Le(360),
        Unit(""),
        Help("wave-generator positions per direction, evenly over a revolution"),
    ] = 23
    repeats: Repeats = 1
    rate: Annotated[float, Gt(0.0), Le(1.0), Unit("N m/s"), Help("rate of the torque ramp")] = 0.02
    torque_limit: Annotated[
        float,
        Gt(0.0),
        Le(10.0),
        Unit("N m"),
        Help("torque at which a ramp that moves nothing ends"),
    ] = 0.4
    motion_deg: Annotated[
        float, Gt(0.0), Le(30.0), Unit("deg"), Help("input motion that ends a ramp")
    ] = 1.0
    approach_rpm: SlowSpeed = 20.0
    travel_rpm: Annotated[
        float,
        Gt(0.0),
        Le(3000.0),
        Unit("r/min"),
        Help("input speed between positions, which are spread over a turn of the output"),
    ] = 300.0
    acceleration: Acceleration = 50.0
    zero_time: ZeroTime = 3.0


SETTINGS = (*OUTPUT_BEARING, DRY_PER_KELVIN, PER_KELVIN_SOURCE)

EXPERIMENT = Experiment(
    name=NAME,
    title="No-load starting torque",
    summary="slow torque ramps at several wave-generator positions, ended by first motion",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.starting_torque.plan:plan"),
    analyse=Deferred("experiments.protocols.starting_torque.analysis:analyse"),
    asks=Need(channels=(("input_angle",), TORQUES), labels=("torque-ramp",)),
    short={"zero_time": 0.5, "positions": 4},
    needs=("input_angle", "torque"),
    quantities=QUANTITIES,
    version=6,
    live=("speed", "starting points", "torque"),
    setpoint="position",
    terms=(
        Term(
            "No-load starting torque",
            "Quasi-static torque at which the input begins to turn, with nothing on the output.",
        ),
        MOTOR_AND_GEAR,
    ),
    settings=SETTINGS,
)
