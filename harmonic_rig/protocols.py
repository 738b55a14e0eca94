"""What a protocol or a fit of another package declares, and the steps of a plan.

A protocol is an `Experiment` behind an entry point of the group `harmonic_rig.protocols`; a fit, which has no plan,
one of the group `harmonic_rig.fits`. Nothing here loads what computes: name the analysis by its place (`Deferred`).
"""

from annotated_types import Ge, Gt, Le, Lt

from experiments.contract import Deferred, Experiment, NoParameters, no_plan
from experiments.errors import PlanError
from experiments.need import ANGLES, EFFORTS, SPEEDS, TORQUES, Need
from experiments.parameters import Help, Unit
from experiments.planning.parts import between_zeros, checked, ramp, stop
from experiments.planning.shared_parameters import Acceleration, Repeats, SlowSpeed, ZeroTime
from experiments.quantity import Quantity
from experiments.setting import Setting
from experiments.steps.vocabulary import (
    HoldRevolutions,
    HoldTime,
    MoveRevolutions,
    MoveToAngle,
    Ramp,
    SegmentLabel,
    Settle,
    SpeedStep,
    Step,
)
from model.gear import HarmonicDrive

__all__ = [
    "ANGLES",
    "EFFORTS",
    "SPEEDS",
    "TORQUES",
    "Acceleration",
    "Deferred",
    "Experiment",
    "Ge",
    "Gt",
    "HarmonicDrive",
    "Help",
    "HoldRevolutions",
    "HoldTime",
    "Le",
    "Lt",
    "MoveRevolutions",
    "MoveToAngle",
    "Need",
    "NoParameters",
    "PlanError",
    "Quantity",
    "Ramp",
    "Repeats",
    "SegmentLabel",
    "Setting",
    "Settle",
    "SlowSpeed",
    "SpeedStep",
    "Step",
    "Unit",
    "ZeroTime",
    "between_zeros",
    "checked",
    "no_plan",
    "ramp",
    "stop",
]
