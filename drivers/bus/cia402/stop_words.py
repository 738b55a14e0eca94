"""The drive's stop words: what the controlword (0x6040) says to stop it (CiA 402, transitions 7 and 9 to 12)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from drivers.drive_state import DriveState
from drivers.port import Ask

QUICK_STOP: Final = 0x02
"""Quick stop: the ramp of 0x6085, then what 0x605A says."""
DISABLE_VOLTAGE: Final = 0x00
"""The power stage off, from every state; it does not depend on an option code."""

STOP_WORDS: Final[Mapping[Ask, int]] = {
    Ask.QUICK_STOP: QUICK_STOP,
    Ask.SERVO_OFF: DISABLE_VOLTAGE,
}
"""What the drive is told by SDO when it hears no process data."""

TO_OFF: Final[Mapping[DriveState, int]] = {
    DriveState.SWITCH_ON_DISABLED: DISABLE_VOLTAGE,
    DriveState.READY: DISABLE_VOLTAGE,
    DriveState.SWITCHED_ON: DISABLE_VOLTAGE,
    DriveState.ENABLED: DISABLE_VOLTAGE,
    DriveState.QUICK_STOP: DISABLE_VOLTAGE,
}
"""Controlword that takes the power off in each state (transitions 7, 9, 10 and 12)."""
