"""The nodes of a CAN bus: who is there, what each says of itself, its state and heartbeat, what it
lacks, what it told.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from drivers.bus.analog.amplifier import ReferenceAmplifier
from drivers.bus.cia301 import NmtState, ObjectRef
from drivers.bus.cia402.drive import ServoAmplifier
from drivers.bus.device import Identity, Missing, RemoteDevice
from drivers.bus.discover import GUARD_TIME, LIFE_FACTOR
from drivers.bus.network import NodeWatch, PumpedBus
from drivers.bus.rig_nodes import RigNodes
from drivers.bus.sdo import SdoAbortError, SdoProtocolError, SdoTimeoutError
from drivers.port import DeviceEvent
from experiments.finding import Finding, Severity, passed_if
from rig.trial.doctor.drive import inspect_drive
from rig.trial.doctor.reference import inspect_reference
from rig.trial.doctor.second_client import SecondClient, read_again
from rig.trial.doctor.standing import gravity

_PROFILES = {
    "servo amplifier": 402,
    "amplifier by analog reference": 401,
    "counter": 406,
    "analog module": 401,
}
"""The device profile that belongs to each kind of node."""
_LOST_AFTER = 3
"""Heartbeats that may stay away before a node counts as lost: the drivers arm that much."""
_SLOW_HEARTBEAT = 1.5
"""Periods that may pass from one heartbeat to the next."""
_GRAVE_EVENTS = frozenset({"counts-per-revolution"})
"""What the drivers only warn of, and what makes every angle wrong."""
_BETWEEN_NS = 1_000_000
LEVELS: Mapping[str, Severity] = {"error": Severity.BLOCKS, "warning": Severity.WARNS}


def inspect_bus(nodes: RigNodes, heard: Mapping[int, Sequence[int]]) -> Iterable[Finding]:
    """Everything about the nodes; `heard` are the instants [ns] at which each node's heartbeat was heard."""
    for (name, identity), device in zip(nodes.identities.items(), nodes.devices, strict=True):
        group = f"node {device.node_id}, {name}"
        yield _identity(group, name, _told_again(device, identity))
        yield _firmware(group, identity)
        yield _state(group, device)
        yield _heartbeat(group, device.watch, heard.get(device.node_id, ()))
        yield from _guarding(group, device)
        yield _missing(group, device.missing)
    drive = nodes.drive
    with read_again(drive.device):
        if isinstance(drive, ServoAmplifier):
            yield from inspect_drive(drive, drive.device.bus.own_node_id)
        if isinstance(drive, ReferenceAmplifier):
            yield from inspect_reference(drive)


def _told_again(device: RemoteDevice, identity: Identity) -> Identity:
    """Who it says that it is, read by another client than the drivers'; what they read where it is silent."""
    with contextlib.suppress(SdoTimeoutError), read_again(device):
        return device.identity()
    return identity


def heartbeat_period_ns(watch: NodeWatch) -> int:
    """The heartbeat period that a node was asked for, or told; 0 where it produces none."""
    return watch.timeout_ns // _LOST_AFTER


def _identity(group: str, name: str, identity: Identity) -> Finding:
    kinds = [kind for kind in _PROFILES if kind in name]
    text = (
        f"{identity.name or 'no name'}, profile {identity.profile}, vendor 0x{identity.vendor_id:08X}, product "
        f"0x{identity.product_code:08X}, serial number {identity.serial_number or 'not told'}"
    )
    # A coupler's terminals count under its own profile.
    wanted = {_PROFILES[kind] for kind in kinds} or {identity.profile}
    return passed_if(
        "identity",
        identity.profile in wanted,
        text,
        "Is this the node that the configuration means? Check its node-ID.",
        where=group,
        allowed=f"profile {' or '.join(str(profile) for profile in sorted(wanted))}",
        otherwise=Severity.WARNS,
    )


def _firmware(group: str, identity: Identity) -> Finding:
    versions = [text for text in (identity.hardware_version, identity.software_version) if text]
    text = (
        f"hardware {identity.hardware_version or '-'}, software {identity.software_version or '-'}"
    )
    text += f", revision 0x{identity.revision:08X}"
    remedy = "The device does not tell its version: note it from the nameplate."
    return passed_if(
        "firmware",
        bool(versions) or identity.revision != 0,
        text,
        remedy,
        where=group,
        otherwise=Severity.WARNS,
    )


def _state(group: str, device: RemoteDevice) -> Finding:
    watch = device.watch
    text = (
        f"NMT {watch.state.name.replace('_', '-')}, {watch.boots} boot-up messages, "
        f"{watch.emergencies} emergency messages"
    )
    remedy = "Check supply, cable and termination."
    if watch.is_lost:
        text = (
            f"lost: no heartbeat for more than {watch.timeout_ns * 1e-6:.0f} ms; before that {text}"
        )
        return Finding("state", Severity.BLOCKS, text, remedy, where=group)
    if watch.state is NmtState.UNKNOWN:
        return Finding(
            "state", Severity.WARNS, "its NMT state was never heard", remedy, where=group
        )
    if watch.state is not NmtState.OPERATIONAL:
        return Finding("state", Severity.BLOCKS, text, remedy, where=group, allowed="OPERATIONAL")
    return passed_if(
        "state",
        not watch.emergencies,
        text,
        "Look the emergency code up in the manual.",
        where=group,
        allowed="OPERATIONAL, no emergency",
        otherwise=Severity.WARNS,
    )


def _heartbeat(group: str, watch: NodeWatch, heard: Sequence[int]) -> Finding:
    asked = heartbeat_period_ns(watch) * 1e-6
    remedy = "Does the node have object 0x1017?"
    if not asked:
        text = "none is produced: the loss of this node is only seen by its missing data"
        return Finding("heartbeat", Severity.WARNS, text, remedy, where=group)
    if len(heard) < 3:
        text = f"{len(heard)} heard where one every {asked:g} ms was asked for"
        return Finding(
            "heartbeat",
            Severity.BLOCKS,
            text,
            remedy,
            where=group,
            allowed=f"<= {_SLOW_HEARTBEAT * asked:g} ms",
            unit="ms",
        )
    period = float(np.median(np.diff(np.asarray(heard)))) * 1e-6
    text = f"every {period:.0f} ms over {len(heard)} of them, asked for every {asked:g} ms"
    return passed_if(
        "heartbeat",
        period <= _SLOW_HEARTBEAT * asked,
        text,
        "The node beats more slowly than it was asked to.",
        where=group,
        allowed=f"<= {_SLOW_HEARTBEAT * asked:g} ms",
        value=period,
        unit="ms",
        otherwise=Severity.WARNS,
    )


def _guarding(group: str, device: RemoteDevice) -> Iterable[Finding]:
    """Node guarding, which this program does not do: said where a node is set to it."""
    period, factor = (_optional(device, entry) for entry in (GUARD_TIME, LIFE_FACTOR))
    if not (period and factor):
        return
    beats = bool(device.watch.timeout_ns)
    yield Finding(
        "node guarding",
        gravity(beats),
        f"it waits to be guarded every {period} ms (0x100C), {factor} times (0x100D): nobody does that here",
        "Set 0x100C to 0; this program watches nodes by their heartbeat (0x1017).",
        where=group,
        allowed="0",
        value=float(period),
        unit="ms",
    )


def _optional(device: RemoteDevice, entry: ObjectRef) -> int:
    """A number of a device; 0 where it has none."""
    try:
        return device.read_integer(entry)
    except (SdoAbortError, SdoTimeoutError):
        return 0


def _missing(group: str, missing: Sequence[Missing]) -> Finding:
    if not missing:
        return Finding(
            "objects", Severity.PASSED, "every object that is used is there", where=group, value=0.0
        )
    by_consequence: dict[str, list[str]] = {}
    for entry in missing:
        by_consequence.setdefault(entry.consequence or "nothing follows from it", []).append(
            f"0x{entry.index:04X}:{entry.subindex} {entry.name}".rstrip()
        )
    consequences = "; ".join(
        f"{', '.join(entries)}: {consequence}" for consequence, entries in by_consequence.items()
    )
    text = f"{len(missing)} are missing. {consequences}"
    return Finding(
        "objects",
        Severity.WARNS,
        text,
        "Decide whether the rig can do without.",
        where=group,
        value=float(len(missing)),
    )


def inspect_events(events: Iterable[DeviceEvent]) -> Iterable[Finding]:
    """What the devices and the drivers told while they were brought up and watched; the same words once."""
    counted: dict[tuple[str, str, str], tuple[Severity, int]] = {}
    for event in events:
        severity = LEVELS.get(event.level)
        if event.code in _GRAVE_EVENTS:
            severity = Severity.BLOCKS
        if severity is not None:
            key = (event.source, event.code, event.text)
            counted[key] = (severity, counted.get(key, (severity, 0))[1] + 1)
    for (source, code, text), (severity, times) in counted.items():
        often = f" ({times} times)" if times > 1 else ""
        yield Finding(
            code,
            severity,
            f"{source}: {text}{often}",
            where="told by the devices",
            value=float(times),
        )
    if not counted:
        yield Finding(
            "events", Severity.PASSED, "no warning and no error", where="told by the devices"
        )


def scan(bus: PumpedBus, patience_ns: int = 300_000_000) -> dict[int, int]:
    """Who answers on the bus: node-ID to device profile, asked by SDO for object 0x1000 at all 127
    node-IDs; 0 where a node does not tell its profile.
    """
    answering: set[int] = set()
    for node_id in range(1, 128):
        bus.subscribe(
            0x580 + node_id, lambda data, stamp_ns, node_id=node_id: answering.add(node_id)
        )
        bus.send(0x600 + node_id, bytes([0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0]))
        # One frame at a time: the send buffer of an adapter is a few frames deep.
        bus.idle(_BETWEEN_NS)
    bus.idle(patience_ns)
    return {node_id: _profile(bus, node_id) for node_id in sorted(answering)}


def _profile(bus: PumpedBus, node_id: int) -> int:
    try:
        return int.from_bytes(SecondClient(bus, node_id).upload(0x1000, 0)[:2], "little")
    except (SdoAbortError, SdoTimeoutError, SdoProtocolError):
        return 0
