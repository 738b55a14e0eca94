"""What one count of a channel means: scale, offset, direction, wrap, and the certificate that says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

# The words for what a rig measures. Every rig uses these names; a rig that lacks one does not list it.
INPUT_ANGLE: Final = "input_angle"
"""Motor encoder (wave generator) [rad]."""
OUTPUT_ANGLE: Final = "output_angle"
"""Output encoder, in the encoder's own sense of rotation [rad]."""
TORQUE: Final = "torque"
"""Torque monitor port of the servo amplifier [N m at the motor]."""
DRIVE_TORQUE: Final = "drive_torque"
"""Torque that the drive reports over the bus (0x6077) [N m at the motor]."""
TARGET_SPEED: Final = "target_speed"
"""Speed set-point that acted in this cycle, as the drive received it [rad/s]; 0 in other modes."""
TARGET_TORQUE: Final = "target_torque"
"""Torque set-point that acted in this cycle, as the drive received it [N m]; 0 in other modes."""
INPUT_INDEX: Final = "input_index"
"""Input angle latched at the latest index mark of the motor encoder [rad]; raw 0 before the first one."""
OUTPUT_INDEX: Final = "output_index"
"""Output angle latched at the latest index mark of the output encoder [rad]; raw 0 before the first one."""
INDEX_SEEN: Final = "index_seen"
"""Bit 0: an input index mark has been seen, bit 1: an output index mark has been seen."""
STATUSWORD: Final = "statusword"
"""CiA 402 statusword of the drive."""
GUARD_CLOSED: Final = "guard_closed"
"""1 while the contact of the rig's guard is closed, 0 while it is open."""
HOUSING_TEMPERATURE: Final = "housing_temperature"
"""Temperature of the gear housing [degC]."""
AMBIENT_TEMPERATURE: Final = "ambient_temperature"
"""Temperature of the room [degC]."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Why a channel's scale can be believed. Uncertainties are standard uncertainties in the
    channel's unit or relative.
    """

    certificate: str = ""
    date: str = ""
    due: str = ""
    scale_relative_uncertainty: float = 0.0
    offset_uncertainty: float = 0.0
    accuracy: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One measured quantity: SI = direction * scale * counts + offset.

    `scale` is in `unit` per count and positive; `modulus` is the wrap range of the device's counter
    (0: it does not wrap; blocks always carry unwrapped counts). For encoders `lines` and
    `multiplication` are kept apart.
    """

    name: str
    unit: str
    scale: float
    offset: float = 0.0
    direction: int = 1
    modulus: int = 0
    long_name: str = ""
    model: str = ""
    serial_number: str = ""
    lines: int = 0
    multiplication: int = 0
    calibration: Calibration = Calibration()

    def __post_init__(self) -> None:
        if not self.scale > 0.0:
            raise DriverError(
                "the scale of a channel must be positive",
                where=self.name,
                value=self.scale,
                limit="> 0",
            )
        if self.direction not in (-1, 1):
            raise DriverError(
                "the direction of a channel is +1 or -1", where=self.name, value=self.direction
            )

    def to_si(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """Counts of any shape as SI values."""
        return counts.astype(np.float64) * (self.direction * self.scale) + self.offset

    def to_counts(self, value: float) -> int:
        """The nearest count of an SI value."""
        return round((value - self.offset) / (self.direction * self.scale))


def encoder_channel(
    name: str,
    *,
    lines: int,
    multiplication: int,
    direction: int = 1,
    modulus: int = 0,
    **details: object,
) -> Channel:
    """An angle channel of an incremental encoder with `lines` per revolution counted `multiplication`-fold."""
    if lines <= 0 or multiplication <= 0:
        raise DriverError(
            "an encoder needs a positive number of lines and multiplication",
            where=name,
            value=f"{lines} lines, x{multiplication}",
            limit="> 0",
        )
    scale = 2.0 * np.pi / (lines * multiplication)
    return Channel(
        name=name,
        unit="rad",
        scale=scale,
        direction=direction,
        modulus=modulus,
        lines=lines,
        multiplication=multiplication,
        **details,  # type: ignore[arg-type]
    )
