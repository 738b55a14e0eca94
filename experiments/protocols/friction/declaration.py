"""No-load running torque and friction: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

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
from experiments.protocols.friction.quantities import CURVE, QUANTITIES
from experiments.setting import DRY_PER_KELVIN, OUTPUT_BEARING, PER_KELVIN_SOURCE, Setting
from experiments.terms import MOTOR_AND_GEAR, RUNNING_TORQUE, PaperFigure, Term

NAME = "friction"


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a friction run can be told."""

    lowest_rpm: Annotated[
        float,
        Gt(0.0),
        Le(6000.0),
        Unit("r/min"),
        Help("lowest input speed; below a tenth of the Stribeck velocity"),
    ] = 1.0
    highest_rpm: HighestSpeed = 3000.0
    points: Points = 30
    speeds_rpm: Speeds = ()
    up_and_down: Annotated[bool, Help("go up the list and down again")] = True
    repeats: Repeats = 1
    bracket_rpm: Annotated[
        float, Gt(0.0), Le(10000.0), Unit("r/min"), Help("reference speed that brackets the sweep")
    ] = 600.0
    bracket_every: Annotated[
        int, Ge(1), Le(1000), Unit(""), Help("speeds between two brackets")
    ] = 5
    measure_time: MeasureTime = 1.0
    settle_time: SettleTime = 0.6
    settle_tolerance: Annotated[
        float, Gt(0.0), Le(1.0), Unit("N m"), Help("agreement of consecutive torque windows")
    ] = 0.002
    resonance_band: Annotated[
        float,
        Ge(0.0),
        Le(0.5),
        Unit("1"),
        Help("share of a resonance speed that is steered clear of"),
    ] = 0.08
    move_rpm: Annotated[
        float,
        Gt(0.0),
        Le(6000.0),
        Unit("r/min"),
        Help("speed of the moves that spread the start positions"),
    ] = 1500.0
    acceleration: Acceleration = 800.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0


SETTINGS = (
    Setting(
        "channel", "channel", "torque", "", "the drive's own torque is to be used: drive_torque"
    ),
    Setting(
        "balance",
        "energy, published",
        "the gear's own",
        "",
        "the paper's balance of torques is to be compared",
    ),
    Setting(
        "bracket_limit",
        "share",
        "0.03",
        "",
        "speeds that are measured again differ by more, and that is known",
    ),
    Setting(
        "bracket_refusal", "share", "0.25", "", "a run is refused because the gear warmed up in it"
    ),
    Setting(
        "chi_square_limit",
        "number above zero",
        "4",
        "",
        "points scatter by more than their noise, and that is known",
    ),
    Setting("genetic", "true, false", "false", "", "the paper's search is wanted beside the fit"),
    Setting("seed", "whole number", "0", "", "another draw of that search"),
    DRY_PER_KELVIN,
    Setting("viscous_per_kelvin", "value,U", "assumed", "1/K", "the same of viscous friction"),
    PER_KELVIN_SOURCE,
    *OUTPUT_BEARING,
)

EXPERIMENT = Experiment(
    name=NAME,
    title="No-load running torque and friction",
    summary="no-load running torque at constant speeds, both directions, up and down",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.friction.plan:plan"),
    analyse=Deferred("experiments.protocols.friction.analysis:analyse"),
    asks=Need(channels=(("input_angle",), (*TORQUES, "current"))),
    short={
        "zero_time": 0.5,
        "points": 8,
        "lowest_rpm": 60.0,
        "measure_time": 0.2,
        "settle_time": 0.2,
        "up_and_down": False,
    },
    needs=("input_angle", "torque"),
    compare=Deferred("experiments.protocols.friction.analysis:compare"),
    identified=Deferred("experiments.protocols.friction.analysis:identified"),
    quantities=QUANTITIES,
    version=13,
    live=("speed", "torque points", "torque"),
    takes_tare=True,
    learns=Deferred("experiments.protocols.friction.coefficients:per_kelvin"),
    terms=(
        RUNNING_TORQUE,
        MOTOR_AND_GEAR,
        Term(
            "Friction parameters",
            "Parameters of the Stribeck curve of the tooth mesh, equation 19: Coulomb friction "
            "F_c, static friction F_s, Stribeck velocity v_s, shape σ, viscous coefficient c_v. "
            "Their size depends on the torque balance by which the mesh force is referred to the "
            "input; the balance used is named in the provenance.",
        ),
    ),
    shapes=(CURVE,),
    figures=(
        PaperFigure(9, "friction torque at the input over speed"),
        PaperFigure(17, "measured and fitted friction torque, both directions"),
    ),
    settings=SETTINGS,
)
