"""Kinematic error: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import BOTH_ANGLES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import (
    Acceleration,
    Approach,
    Mounted,
    OutputCounts,
    Repeats,
    SyncRate,
    ZeroTime,
)
from experiments.protocols.kinematic_error.quantities import QUANTITIES
from experiments.setting import Setting
from experiments.terms import KINEMATIC_ERROR, NORMALISED_MSE, PaperFigure, Term

NAME = "kinematic-error"


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a kinematic-error run can be told."""

    speed_rpm: Annotated[
        float,
        Gt(0.0),
        Le(300.0),
        Unit("r/min"),
        Help("input speed, incommensurate with SYNC and quasi-static"),
    ] = 30.3
    output_revolutions: Annotated[
        int, Ge(1), Le(100), Unit("rev"), Help("whole output revolutions each way")
    ] = 1
    repeats: Repeats = 1
    approach_revolutions: Approach = 1.5
    mounting: Mounted = "circular-spline-fixed"
    mounted_at_deg: Annotated[
        float | None,
        Ge(-360.0),
        Le(360.0),
        Unit("deg"),
        Help("angle on the output flange at which the gear is mounted anew for this run"),
    ] = None
    acceleration: Acceleration = 100.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0
    output_counts: OutputCounts = 72000


SETTINGS = (
    Setting(
        "highest_order", "whole number", "12", "", "orders of the input beyond it are asked for"
    ),
    Setting(
        "accuracy_order",
        "whole number",
        "the highest",
        "",
        "a catalogue's transmission accuracy is of fewer orders",
    ),
    Setting(
        "edge_triggered", "true, false", "false", "", "the counters latch at edges, not at the SYNC"
    ),
    Setting(
        "output_eccentricity",
        "number",
        "2",
        "arcsec",
        "the seat of the output is trued up better, or worse",
    ),
    Setting("input_eccentricity", "number", "1", "arcsec at the output", "the same of the input"),
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Kinematic error and transmission accuracy",
    summary="kinematic error over whole output revolutions at low speed, both directions",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.kinematic_error.plan:plan"),
    analyse=Deferred("experiments.protocols.kinematic_error.analysis:analyse"),
    asks=Need(channels=BOTH_ANGLES, ratio=True),
    short={"zero_time": 0.5, "speed_rpm": 61.8},
    compare=Deferred("experiments.protocols.kinematic_error.analysis:compare"),
    identified=Deferred("experiments.protocols.kinematic_error.analysis:identified"),
    quantities=QUANTITIES,
    version=8,
    live=("speed", "wave", "torque", "output"),
    terms=(
        KINEMATIC_ERROR,
        Term(
            "Transmission accuracy",
            "Sum of the largest positive and the largest negative deviation of the output from "
            "the ideal over one complete output revolution, one direction. It is taken from the "
            "fitted curve up to the stated order; the raw peak-to-peak, which holds quantisation "
            "and noise, stands beside it.",
        ),
        NORMALISED_MSE,
    ),
    figures=(
        PaperFigure(12, "kinematic error over the input angle"),
        PaperFigure(13, "fitted kinematic error and its orders"),
        PaperFigure(16, "friction torque and kinematic error over the wave-generator angle"),
    ),
    settings=SETTINGS,
)
