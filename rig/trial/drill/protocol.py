"""The run in which a fault happens: every state that a run can be in, in three seconds, and an
analysis that sees whether counts were lost.

The analysis asks what a lost, doubled or invented count would spoil: whether the output has turned
by 1/N of the input over each hold, within what the gear's compliance allows. Where it cannot say,
it refuses; a broken rig must never fail a gear.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from experiments.contract import Evidence, Experiment
from experiments.errors import ExperimentError
from experiments.evidence import check_recording, usable
from experiments.quantity import Quantity
from experiments.recording import Recording, Segment
from experiments.result import Result
from experiments.steps import vocabulary as s
from model.compensation import table_of_set
from model.errors import ModelError
from model.gear import HarmonicDrive
from model.identify.estimate import Estimate
from model.units import REVOLUTION
from rig.errors import RigError
from rig.run.parts import RunReport
from rig.runfile.read import close_recording, open_run

SPEED = 60.0
"""rad/s at the input."""
ACCELERATION = 1500.0
CLOSURE_LIMIT = math.radians(0.2)
"""rad at the output: far above the gear's wind-up and kinematic error, far below a lost revolution
of the input (3 deg).
"""


@dataclass(frozen=True)
class DrillParameters:
    """Whether the rig takes set-points of torque, and whether it turns along a compensation table."""

    has_torque: bool = True
    is_compensated: bool = False


_ONE_MARK = 0.126
"""s in which the input passes its index mark at that speed."""


def plan(parameters: DrillParameters, gear: HarmonicDrive) -> Iterator[s.Step]:
    """Servo off, forward, reverse, standstill with the servo on, a torque that moves nothing, servo off."""
    yield s.ServoOff(0.1, s.SegmentLabel("zero-before"))
    yield s.Ramp(SPEED, ACCELERATION)
    # Long enough for two index marks of the input before and after the middle.
    yield from _turning(0.61, 1, parameters, gear)
    yield s.Ramp(-SPEED, ACCELERATION, s.SegmentLabel("reversal"))
    yield from _turning(0.15, -1, parameters, gear)
    yield s.Ramp(0.0, ACCELERATION)
    # Long enough for a creep that begins in the middle to be told from a drive that brakes.
    yield s.HoldTime(0.9, s.SegmentLabel("stand"))
    if parameters.has_torque:
        yield s.TorqueRamp(0.2, 0.02, 0.05, s.SegmentLabel("torque-ramp"))
    yield s.ServoOff(0.08, s.SegmentLabel("zero-after"))


def _turning(
    seconds: float, direction: int, parameters: DrillParameters, gear: HarmonicDrive
) -> Iterator[s.Step]:
    """A steady speed for so long, along the whole orders of the gear's own series where that is asked for."""
    speed, label = direction * SPEED, s.SegmentLabel("hold", direction * SPEED, direction)
    if not parameters.is_compensated:
        yield s.HoldTime(seconds, label)
        return
    if direction > 0:
        # One index mark of the input, from which the table counts.
        yield s.HoldTime(_ONE_MARK)
        seconds -= _ONE_MARK
    table = table_of_set(gear, "circular-spline-fixed")
    revolutions = seconds * SPEED / REVOLUTION
    yield s.FollowTable(revolutions, speed, table, 2.0 * seconds, 0.0, label)


QUANTITIES = (
    Quantity(name="closure", title="closure", unit="rad", shown="arcmin"),
    Quantity(name="running_torque", title="running torque", unit="N m"),
    Quantity(name="flagged", title="flagged", unit="1"),
)


def breaks_closure(report: RunReport, gear: HarmonicDrive) -> bool:
    """Whether a run that was completed says that revolutions of the input were lost.

    Where its recording cannot be analysed it says nothing: a broken rig must never fail a gear.
    """
    if report.outcome != "COMPLETED" or not report.readable:
        return False
    try:
        recording = open_run(report.path)
    except RigError:
        return False
    try:
        closure = EXPERIMENT.analyse(recording, Evidence(gear)).estimates["closure"]
    except (ExperimentError, ModelError):
        return False
    finally:
        close_recording(recording)
    return closure.value - closure.expanded_uncertainty > CLOSURE_LIMIT


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """|theta_o - theta_i/N| turned over each hold, in complete cycles: the worst of them."""
    checked = check_recording(recording, "drill", 0.05)
    holds = recording.labelled("hold")
    worst = max((_closure(recording, hold) for hold in holds), default=math.nan)
    torque = float(
        np.mean(
            [abs(np.mean(recording.si("torque", hold)[usable(recording, hold)])) for hold in holds]
        )
    )
    # Input and output encoder: a count each, and the gear's kinematic error.
    doubt = 2e-4
    estimate = Estimate(
        name="closure", value=worst, unit="rad", low=worst - doubt, high=worst + doubt
    )
    metrics = {"closure": worst, "running_torque": torque, "flagged": float(checked.missed)}
    return Result(
        run=recording.metadata.run_id,
        kind="drill",
        quantities=QUANTITIES,
        estimates={"closure": estimate},
        metrics=metrics,
        warnings=checked.warnings,
    )


def _closure(recording: Recording, hold: Segment) -> float:
    good = np.flatnonzero(usable(recording, hold))
    inner, outer = recording.si("input_angle", hold)[good], recording.output_angle(hold)[good]
    return abs(float(outer[-1] - outer[0]) - float(inner[-1] - inner[0]) / recording.metadata.ratio)


EXPERIMENT = Experiment(
    name="drill",
    title="fault drill",
    summary="a short run in which something goes wrong",
    parameters=DrillParameters,
    plan=plan,
    analyse=analyse,
    needs=("input_angle", "output_angle", "torque"),
    quantities=QUANTITIES,
)
