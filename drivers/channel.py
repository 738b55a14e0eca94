"""What a rig measures: the names that every rig uses for its channels, and the channel itself.

What one count of a channel means is described once for all floors, in `model.channel`; this module is the only door
through which the hardware knows it.
"""

from __future__ import annotations

from typing import Final

from model.channel import Calibration, Channel, encoder_channel

__all__ = ["Calibration", "Channel", "encoder_channel"]

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
