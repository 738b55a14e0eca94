"""The power drive state machine of CiA 402-2 as a table: (state, command) -> state, and what a controlword commands."""

from __future__ import annotations

from drivers.drive_state import DriveState

SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP = (
    "shutdown",
    "switch on",
    "enable",
    "disable voltage",
    "quick stop",
)
FAULT_RESET_BIT, HALT_BIT = 0x0080, 0x0100

S = DriveState
TRANSITIONS: dict[tuple[DriveState, str], DriveState] = {
    (S.SWITCH_ON_DISABLED, SHUTDOWN): S.READY,
    (S.READY, SWITCH_ON): S.SWITCHED_ON,
    (S.READY, ENABLE): S.ENABLED,
    (S.READY, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.READY, QUICK_STOP): S.SWITCH_ON_DISABLED,
    (S.SWITCHED_ON, SHUTDOWN): S.READY,
    (S.SWITCHED_ON, ENABLE): S.ENABLED,
    (S.SWITCHED_ON, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.SWITCHED_ON, QUICK_STOP): S.SWITCH_ON_DISABLED,
    (S.ENABLED, SHUTDOWN): S.READY,
    (S.ENABLED, SWITCH_ON): S.SWITCHED_ON,
    (S.ENABLED, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.ENABLED, QUICK_STOP): S.QUICK_STOP,
    (S.QUICK_STOP, DISABLE_VOLTAGE): S.SWITCH_ON_DISABLED,
    (S.QUICK_STOP, ENABLE): S.ENABLED,
}
"""Transitions 2 to 12 and 16. Everything else leaves the state as it is. READY goes to ENABLED on "enable operation" by
transitions 3 and 4 in one, as the standard allows; 16 holds only where the quick stop option code
lets the drive stay.
"""


def command_of(controlword: int) -> str:
    """The command that a controlword's bits 0-3 stand for (CiA 402-2, table of command coding)."""
    if not controlword & 0x02:
        return DISABLE_VOLTAGE
    if not controlword & 0x04:
        return QUICK_STOP
    if not controlword & 0x01:
        return SHUTDOWN
    return ENABLE if controlword & 0x08 else SWITCH_ON
