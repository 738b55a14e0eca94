"""The nodes of a CAN bus: who is there, what each says of itself, its state and heartbeat, what it lacks, how it is set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from drivers.cia301 import NmtState
from drivers.cyclic import CanRig
from drivers.device import Identity, RemoteDevice
from drivers.drive_state import POWERED_STATES, DriveState
from drivers.errors import DriverError
from rig.doctor.finding import Finding, judged

PROFILES = {"servo amplifier": 402, "counter": 406, "analog module": 401}
"""The device profile that belongs to each kind of node."""
HEARTBEAT_MS = 100.0
"""Heartbeat that the drivers ask of every node."""
SHOWN_MISSING = 4
"""Missing objects that are listed by name."""


def inspect_bus(port: CanRig, heard: Mapping[int, Sequence[int]]) -> Iterable[Finding]:
    """Everything about the nodes; `heard` are the instants [ns] at which each node's heartbeat was heard."""
    nodes = port.nodes
    for (name, identity), device in zip(nodes.identities.items(), nodes.devices, strict=True):
        group = f"node {device.node_id}, {name}"
        yield _identity(group, name, identity)
        yield _firmware(group, identity)
        yield _state(group, device)
        yield _heartbeat(group, device, heard.get(device.node_id, ()))
        yield _missing(group, device)
    yield from _drive(port)


def _identity(group: str, name: str, identity: Identity) -> Finding:
    kind = next((kind for kind in PROFILES if name.startswith(kind)), "")
    text = (
        f"{identity.name or 'no name'}, profile {identity.profile}, vendor 0x{identity.vendor_id:08X}, product "
        f"0x{identity.product_code:08X}, serial number {identity.serial_number or 'not told'}"
    )
    wanted = PROFILES.get(kind, identity.profile)
    return judged(
        group, "identity", identity.profile == wanted, text, limit=f"profile {wanted}", otherwise="warning",
        remedy="Is this the node that the configuration means? Check its node-ID.",
    )  # fmt: skip


def _firmware(group: str, identity: Identity) -> Finding:
    told = [text for text in (identity.hardware_version, identity.software_version) if text]
    text = f"hardware {identity.hardware_version or '-'}, software {identity.software_version or '-'}"
    text += f", revision 0x{identity.revision:08X}"
    remedy = "The device does not tell its version: note it from the nameplate."
    return judged(group, "firmware", bool(told) or identity.revision != 0, text, remedy=remedy, otherwise="warning")


def _state(group: str, device: RemoteDevice) -> Finding:
    watch = device.watch
    text = f"NMT {watch.state.name.replace('_', '-')}, {watch.boots} boot-up messages, {watch.emergencies} emergency messages"
    fine = watch.state in (NmtState.OPERATIONAL, NmtState.UNKNOWN) and not watch.is_lost
    finding = judged(group, "state", fine, text, limit="OPERATIONAL", remedy="Check supply, cable and termination.")
    if fine and watch.emergencies:
        return judged(group, "state", False, text, otherwise="warning", remedy="Look the emergency code up in the manual.")
    return finding


def _heartbeat(group: str, device: RemoteDevice, heard: Sequence[int]) -> Finding:
    if len(heard) < 3:
        text = f"{len(heard)} heartbeats heard: a node that dies is only seen by its missing data"
        return judged(group, "heartbeat", False, text, otherwise="warning", remedy="Does the node have object 0x1017?")
    period = float(np.median(np.diff(np.asarray(heard)))) * 1e-6
    fine = period <= 1.5 * HEARTBEAT_MS
    return judged(
        group, "heartbeat", fine, f"every {period:.0f} ms", value=period, unit="ms", limit=f"<= {1.5 * HEARTBEAT_MS:g} ms",
        otherwise="warning", remedy="The node beats more slowly than it was asked to.",
    )  # fmt: skip


def _missing(group: str, device: RemoteDevice) -> Finding:
    missing = device.missing
    if not missing:
        return Finding(group, "objects", "ok", "every object that is used is there")
    named = [f"0x{m.index:04X}:{m.subindex} {m.name} ({m.consequence})" for m in missing[:SHOWN_MISSING]]
    more = f" and {len(missing) - SHOWN_MISSING} more" if len(missing) > SHOWN_MISSING else ""
    text = f"{len(missing)} are missing: {'; '.join(named)}{more}"
    return Finding(group, "objects", "warning", text, float(len(missing)), "", "", "Decide whether the rig can do without.")


def _drive(port: CanRig) -> Iterable[Finding]:
    group, drive = "drive", port.nodes.drive
    try:
        state, word = drive.state(), drive.statusword()
        text = f"statusword 0x{word:04X}, {state.value}"
        if state in (DriveState.FAULT, DriveState.FAULT_REACTION):
            yield Finding(group, "state", "failed", f"{text}: {drive.error_text()}", remedy="Remove the cause, reset the fault.")
        else:
            yield judged(group, "state", state not in POWERED_STATES, text, remedy="The servo must be off here.")
    except DriverError as error:
        yield Finding(group, "state", "failed", str(error), remedy="Check the drive's supply.")
    readings = drive.readings
    modes = [mode.name.replace("_", " ").lower() for mode in (readings.speed_mode, readings.torque_mode) if mode is not None]
    yield judged(
        group, "modes", len(modes) == 2, ", ".join(modes) or "none", limit="one of speed, one of torque", otherwise="warning",
        remedy="Protocols that need the missing mode cannot run.",
    )  # fmt: skip
    units = f"rated torque {readings.rated_torque:g} N m, speed unit {readings.velocity_unit:g} rad/s"
    counts = f"{readings.counts_per_revolution:g} counts per revolution" if readings.counts_per_revolution else "counts not told"
    known = readings.rated_torque > 0.0 and readings.velocity_unit > 0.0
    yield judged(group, "units", known, f"{units}, {counts}", remedy="Give them in [drive] of the configuration.")
    shown = ", ".join(f"{name} {value:g}" for name, value in readings.settings.items())
    yield judged(
        group, "settings", bool(readings.settings), shown or "none could be read", otherwise="warning",
        remedy="Electronic gear, option codes and gains are not known: read them with the vendor's tool.",
    )  # fmt: skip
