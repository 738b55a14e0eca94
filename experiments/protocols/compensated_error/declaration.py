"""Compensated error: what a run can be told, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le

from experiments.contract import Deferred, Experiment
from experiments.need import BOTH_ANGLES, Need
from experiments.parameters import FileContent, Help, Unit
from experiments.planning.shared_parameters import (
    Acceleration,
    Approach,
    Mounted,
    OutputCounts,
    Repeats,
    SyncRate,
    ZeroTime,
)
from experiments.protocols.compensated_error.quantities import QUANTITIES
from experiments.terms import KINEMATIC_ERROR, Term

NAME = "compensated-error"


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a compensated-error run can be told."""

    table: Annotated[
        str,
        FileContent("TOML"),
        Help(
            "the table that is taken out, by `rig compensate`; the parameter set's series without"
        ),
    ] = ""
    speeds_rpm: Annotated[
        tuple[float, ...],
        Gt(0.0),
        Le(10000.0),
        Unit("r/min"),
        Help("input speeds, three or more, an octave apart or less"),
    ] = (30.3, 60.6, 121.2, 242.4, 484.8, 969.6)
    repeats: Repeats = 1
    approach_revolutions: Approach = 1.5
    mounting: Mounted = "circular-spline-fixed"
    acceleration: Acceleration = 100.0
    zero_time: ZeroTime = 3.0
    sync_rate: SyncRate = 1000.0
    output_counts: OutputCounts = 72000


EXPERIMENT = Experiment(
    name=NAME,
    title="Compensated error",
    summary="the same turn of the output without and with a table that takes the kinematic error out",
    parameters=Parameters,
    plan=Deferred("experiments.protocols.compensated_error.plan:plan"),
    analyse=Deferred("experiments.protocols.compensated_error.analysis:analyse"),
    goes_on="rig compensate {run} --output FILE",
    refuse_gear=Deferred("experiments.protocols.compensated_error.plan:refuse_gear"),
    asks=Need(
        channels=(*BOTH_ANGLES, ("input_index",), ("output_index",), ("target_speed",)),
        labels=("compensated",),
        ratio=True,
    ),
    needs=(
        "input_angle",
        "output_angle",
        "input_index",
        "output_index",
        "index_seen",
        "target_speed",
    ),
    short={"zero_time": 0.5, "speeds_rpm": (247.2, 494.4, 988.8)},
    quantities=QUANTITIES,
    live=("speed", "wave", "torque", "output"),
    terms=(
        KINEMATIC_ERROR,
        Term(
            "Remainder",
            "What is left of the output's deviation from the nominal angle over N, r.m.s. of the orders that were "
            "looked for over one output revolution, the constant left out. Seen: as this bench's encoder shows it. "
            "True: without what the encoder itself adds, which this bench cannot show.",
        ),
        Term(
            "Proof",
            "The seen remainder over what was predicted of it, with its interval (F). PASS: 1 lies inside. FAIL: the "
            "whole interval lies above 1.3, so that sign, phase, gear, mounting, direction, index mark or ratio of "
            "the table is wrong. MARGINAL: between, not proved.",
        ),
    ),
)
