"""The states of a CiA 402 drive, decoded from its statusword by one table (CiA 402-2, power drive state machine)."""

from __future__ import annotations

from enum import Enum


class DriveState(Enum):
    """Where the drive's state machine is, in the words of the standard."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


_STATE_TABLE: tuple[tuple[int, int, DriveState], ...] = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP),
)
"""Mask, value under the mask, state."""

STATUSWORD_OF: dict[DriveState, int] = {
    DriveState.NOT_READY: 0x0000,
    DriveState.SWITCH_ON_DISABLED: 0x0250,
    DriveState.READY: 0x0231,
    DriveState.SWITCHED_ON: 0x0233,
    DriveState.ENABLED: 0x0237,
    DriveState.QUICK_STOP: 0x0217,
    DriveState.FAULT_REACTION: 0x021F,
    DriveState.FAULT: 0x0218,
}
"""A statusword that a healthy drive on the bus (remote bit 9, voltage enabled bit 4) shows in each state."""

FOLLOWS_BIT = 0x1000
"""Bit 12 of the statusword in the cyclic modes: the drive follows its set-point."""

POWERED_STATES = frozenset({DriveState.ENABLED, DriveState.QUICK_STOP, DriveState.FAULT_REACTION})
"""States in which the drive may still produce torque."""


def drive_state(statusword: int) -> DriveState:
    """The state that a statusword stands for."""
    for mask, value, state in _STATE_TABLE:
        if statusword & mask == value:
            return state
    return DriveState.UNKNOWN
