"""What an analysis asks of a recording, and by which names the channels go that it may ask for."""

from __future__ import annotations

from dataclasses import dataclass

ANGLES = ("input_angle", "position", "output_angle")
NOMINAL_ANGLE = "nominal_angle"
"""The angle of the input of a log at constant speed that has none: the stated speed times the time."""
TURNING = (*ANGLES, NOMINAL_ANGLE)
"""Angles over which orders are looked for."""
SPEEDS = ("speed", "input_speed", "output_speed")
EFFORTS = ("torque", "drive_torque", "force", "current", "motor_current", "voltage")
TORQUES = ("torque", "drive_torque")
MEASURED = ("any other channel",)
"""In place of alternatives: whatever else was recorded."""
BOTH_ANGLES = (("input_angle",), ("output_angle",))


@dataclass(frozen=True, kw_only=True)
class Need:
    """What an analysis asks of a recording that was made elsewhere.

    `channels` is a list of alternatives, of each of which one must be there; `labels` are the
    segments that it looks for, of which one must be there; `gear_off` where the motor must have run
    alone; `revolutions` where a length in metres is no angle. `time` is False where rows are enough,
    `is_table` where its recordings are tables that have no time base at all.
    """

    channels: tuple[tuple[str, ...], ...]
    time: bool = True
    is_table: bool = False
    ratio: bool = False
    labels: tuple[str, ...] = ()
    gear_off: bool = False
    revolutions: bool = False
