"""What an error of an estimate comes from, and what two results must have in common for it to be the same in both.

An error that is the same in two results cancels in their difference (correlation one; GUM, F.1.2.3).
Scatter of the data never does; it has no cause here.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class Ground(StrEnum):
    """Something that a result rests on and that another result may rest on too."""

    TORQUE_CHANNEL = "torque channel"
    TARE = "tare"
    PARAMETER_SET = "parameter set"
    OUTPUT_ENCODER = "output encoder as mounted"
    MOTOR_ENCODER = "motor encoder as mounted"


class Cause(StrEnum):
    """Where an error comes from that two results may share."""

    TORQUE_SCALE = "torque scale"
    TARE = "tare"
    BEARING_TORQUE = "bearing torque"
    OUTPUT_ENCODER = "output encoder"
    MOTOR_ENCODER = "motor encoder"
    BOTH_ENCODERS = "both encoders"

    @property
    def grounds(self) -> frozenset[Ground]:
        """What must be the same for the error to be the same."""
        return _GROUNDS[self]


_GROUNDS: Mapping[Cause, frozenset[Ground]] = {
    Cause.TORQUE_SCALE: frozenset({Ground.TORQUE_CHANNEL}),
    Cause.TARE: frozenset({Ground.TORQUE_CHANNEL, Ground.TARE}),
    Cause.BEARING_TORQUE: frozenset({Ground.PARAMETER_SET}),
    Cause.OUTPUT_ENCODER: frozenset({Ground.OUTPUT_ENCODER}),
    Cause.MOTOR_ENCODER: frozenset({Ground.MOTOR_ENCODER}),
    Cause.BOTH_ENCODERS: frozenset({Ground.OUTPUT_ENCODER, Ground.MOTOR_ENCODER}),
}
