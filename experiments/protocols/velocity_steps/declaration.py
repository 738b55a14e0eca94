"""Velocity steps: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import BOTH_ANGLES, Need
from experiments.parameters import Help, Unit
from experiments.planning.shared_parameters import (
    Acceleration,
    Repeats,
    SlowSpeed,
    SyncRate,
    ZeroTime,
)
from experiments.protocols.velocity_steps.quantities import NAME, QUANTITIES
from experiments.setting import OUTPUT_BEARING, Setting
from experiments.terms import KINEMATIC_ERROR, NORMALISED_MSE, PaperFigure, Term


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a velocity-step run can be told."""

    speeds_rpm: Annotated[
        tuple[float, ...], Gt(0.0), Le(10000.0), Unit("r/min"), Help("input speeds of the steps")
    ] = (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 2400.0, 3000.0)
    repeats: Repeats = 2
    duration: Annotated[
        float, Ge(0.05), Le(600.0), Unit("s"), Help("time at speed, long enough for the ring-down")
    ] = 1.5
    revolutions: Annotated[
        float, Ge(3.0), Le(1000.0), Unit("rev"), Help("least input revolutions of a step")
    ] = 3.0
    rest_time: Annotated[
        float, Ge(0.1), Le(60.0), Unit("s"), Help("standstill before each step")
    ] = 0.5
    approach_rpm: SlowSpeed = 30.0
    acceleration: Acceleration = 500.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0


SETTINGS = (
    Setting(
        "kinematic_error",
        "auto, set, run",
        "auto",
        "",
        "that of the set is another mounting's: run",
    ),
    Setting(
        "ladder",
        "linear, hardening, full",
        "full",
        "",
        "hysteresis is not asked for: hardening, in about a quarter of the time",
    ),
    *OUTPUT_BEARING,
)

EXPERIMENT = Experiment(
    name=NAME,
    title="Velocity steps",
    summary="speed steps, simulated output against measured output per speed",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.velocity_steps.plan:plan"),
    analyse=Deferred("experiments.protocols.velocity_steps.analysis:analyse"),
    asks=Need(channels=BOTH_ANGLES, ratio=True, labels=("step",)),
    short={"zero_time": 0.5, "repeats": 1, "duration": 0.1, "speeds_rpm": (300.0, 600.0, 1000.0)},
    compare=Deferred("experiments.protocols.velocity_steps.analysis:compare"),
    identified=Deferred("experiments.protocols.velocity_steps.identified:identified"),
    quantities=QUANTITIES,
    version=22,
    live=("speed", "steps", "torque"),
    builds_on=("kinematic-error",),
    terms=(
        KINEMATIC_ERROR,
        NORMALISED_MSE,
        Term(
            "Secant stiffness over inertia, K/J",
            "Torque over torsion between reversals at a stated torque, a quarter of T1, over the "
            "output's inertia. The stiffness grows with torque; this is not the static torsional "
            "stiffness of the catalogue, and the square of the mode's frequency is higher, because "
            "damping stiffens.",
        ),
        Term(
            "Rung",
            "One of the models that are tried on all steps, the simplest first. A richer one "
            "is chosen only where it explains them better by more than 12 squares of the noise.",
        ),
        Term(
            "Skill",
            "One minus the squared error of the model over that of a null model (a rigid gear; a "
            "rigid gear with the kinematic error). Zero is no better than the null model, one is "
            "perfect.",
        ),
    ),
    figures=(PaperFigure(19, "output speed after velocity steps, simulated and measured"),),
    settings=SETTINGS,
)
