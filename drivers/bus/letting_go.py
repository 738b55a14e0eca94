"""How a segment is let go: servo off, and what is left to be said to a drive that does not obey."""

from __future__ import annotations

import contextlib

import numpy as np

from drivers.bus.amplifier import Amplifier
from drivers.bus.cia301 import SYNC_COB_ID, NmtCommand
from drivers.bus.network import PumpedBus
from drivers.bus.rig_nodes import RigNodes
from drivers.bus.sdo import SdoTimeoutError
from drivers.errors import DriverError
from drivers.port import Mode


def command_once(drive: Amplifier, mode: Mode) -> list[tuple[int, bytes]]:
    """(COB-ID, data) of every RPDO in a mode with set-points of zero."""
    none = np.zeros(1, dtype=np.int64)
    frames = drive.frames(mode, none, none)
    return [(pdo.cob_id, data) for pdo, (data,) in zip(drive.commands, frames, strict=True)]


def let_go(bus: PumpedBus, nodes: RigNodes) -> None:
    """Servo off, the drive's watch over the computer off, every node PRE-OPERATIONAL. Never raises."""
    drive = nodes.drive
    for cob_id in (SYNC_COB_ID, *(pdo.cob_id for pdo in drive.commands)):
        # No cycle goes on that a stranger could spoil: what comes back of these is not looked at any more.
        bus.subscribe(cob_id, lambda data, stamp_ns: None)
    try:
        drive.to_off(resets_fault=False)
        drive.device.release_consumer()
        bus.start_heartbeat(0)
        for device in nodes.devices:
            bus.nmt(NmtCommand.PRE_OPERATIONAL, device.node_id)
    except DriverError as error:
        bus.emit("warning", "close", "rig", f"while closing: {error}")
        with contextlib.suppress(DriverError):
            _insist(bus, drive, is_silent=isinstance(error, SdoTimeoutError))


def _insist(bus: PumpedBus, drive: Amplifier, *, is_silent: bool) -> None:
    """The drive does not obey: servo off by process data all the same, then NMT STOP, to which it reacts by 0x6007.

    One that `is_silent` may have been STOPPED by somebody, and hears neither SDO nor process data before it is woken.
    """
    for cob_id, data in command_once(drive, Mode.OFF):
        bus.send(cob_id, data)
    bus.send(SYNC_COB_ID, b"")
    if is_silent:
        bus.nmt(NmtCommand.PRE_OPERATIONAL, drive.device.node_id)
        with contextlib.suppress(DriverError):
            drive.to_off(resets_fault=False)
            drive.device.release_consumer()
            return
    bus.nmt(NmtCommand.STOP, drive.device.node_id)
