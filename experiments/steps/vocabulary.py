"""The vocabulary of plans: every kind of step that a protocol can ask of a rig."""

from __future__ import annotations

from experiments.steps.follow import FollowTable
from experiments.steps.hold import HoldRevolutions, HoldTime, Settle
from experiments.steps.kind import SegmentLabel as SegmentLabel
from experiments.steps.move import MoveRevolutions, MoveToAngle
from experiments.steps.note import Mark, Prompt
from experiments.steps.servo_off import ServoOff
from experiments.steps.sine import Sine
from experiments.steps.speed import FindIndex, Ramp, SpeedStep
from experiments.steps.torque_ramp import TorqueRamp

Step = (
    ServoOff
    | Ramp
    | SpeedStep
    | HoldRevolutions
    | FollowTable
    | HoldTime
    | Settle
    | MoveToAngle
    | MoveRevolutions
    | FindIndex
    | TorqueRamp
    | Sine
    | Prompt
    | Mark
)
