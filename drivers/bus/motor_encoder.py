"""The motor's encoder as whoever counts it reports it: lines and multiplication apart, and where its index mark is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from drivers.bus.cia301 import ObjectRef
from drivers.channel import Calibration, Channel, encoder_channel
from drivers.errors import DriverError


@dataclass(frozen=True, kw_only=True)
class MotorEncoder:
    """The motor encoder as the drive reports it in 0x6064: lines and multiplication apart, sense, and
    the motor's greatest speed [rad/s], with room, which bounds the steps of both encoders' counts.

    `index_position` is the object in which the drive latches the position at the encoder's index
    mark, `index_status` and `index_mask` tell that one has been seen; None: touch probe 1 of CiA
    402, where the drive has it.
    """

    lines: int = 8192
    multiplication: int = 4
    direction: int = 1
    largest_speed: float
    modulus: int = 1 << 32
    index_position: ObjectRef | None = None
    index_status: ObjectRef | None = None
    index_mask: int = 0x0001
    long_name: str = ""
    model: str = ""
    serial_number: str = ""
    calibration: Calibration = field(default_factory=Calibration)

    def __post_init__(self) -> None:
        if not 0.0 < self.largest_speed < math.inf:
            raise DriverError(
                "the motor's greatest speed must be known: jumps of the counts are told by it",
                where="motor encoder, largest speed",
                value=self.largest_speed,
                limit="> 0 rad/s",
            )

    def as_channel(self, name: str) -> Channel:
        """The position as an angle channel."""
        return encoder_channel(
            name,
            lines=self.lines,
            multiplication=self.multiplication,
            direction=self.direction,
            modulus=self.modulus,
            long_name=self.long_name,
            model=self.model,
            serial_number=self.serial_number,
            calibration=self.calibration,
        )
