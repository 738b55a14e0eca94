"""Home: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from experiments.contract import Deferred, Experiment
from experiments.need import BOTH_ANGLES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import Acceleration, Mounted, SlowSpeed, ZeroTime
from experiments.quantity import (
    ANGLES_IN_ITS_BUDGET,
    Quantity,
)

NAME = "home"

QUANTITIES = (
    Quantity(
        name="{encoder}_index",
        title="{encoder} index",
        unit="rad",
        definition="where the motor's forward turn meets the index mark, within the revolution of its encoder and "
        "without the errors of the encoder; met from the other side the mark lies its own width away",
        target_uncertainty=1e-3,
        target_reason="three counts of the motor encoder: phases of low orders are carried to another run",
        is_signed=True,
        is_circular=True,
        rests_on=ANGLES_IN_ITS_BUDGET,
    ),
    Quantity(name="{encoder}_index_spread", title="{encoder} index spread", unit="rad"),
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a homing run can be told."""

    input_speed_rpm: SlowSpeed = 6.0
    output_speed_rpm: SlowSpeed = 60.0
    input_passes: Annotated[
        int, Ge(1), Le(50), Unit(""), Help("how often the input mark is passed, always forward")
    ] = 3
    output_passes: Annotated[
        int,
        Ge(1),
        Le(10),
        Unit(""),
        Help("how often the output mark is passed; each takes one output revolution"),
    ] = 1
    mounting: Mounted = "circular-spline-fixed"
    acceleration: Acceleration = 50.0
    zero_time: ZeroTime = 3.0


EXPERIMENT = Experiment(
    name=NAME,
    title="Index marks",
    summary="index marks of both encoders, slowly, from one side",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.home.plan:plan"),
    analyse=Deferred("experiments.protocols.home.analysis:analyse"),
    asks=Need(channels=BOTH_ANGLES, ratio=True, labels=("home-input", "home-output")),
    short={"zero_time": 0.5, "input_passes": 1, "input_speed_rpm": 30.0, "output_speed_rpm": 120.0},
    needs=("input_angle", "input_index", "index_seen"),
    quantities=QUANTITIES,
    version=4,
)
