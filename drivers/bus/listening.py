"""Listening before bring-up: whether another master commands the bus. Two masters would fight over one drive.

Nothing is sent until the listening is over. Then, only if need be: where SYNC was heard, 0x1005 of
our own nodes is read and a producer among them is switched off (bit 30 cleared, read back, silence
heard); a node that is not ours and sends heartbeats is asked what it is. Everything else that only a
master sends refuses the opening, in the words of what was heard.

| COB-ID | what only a master sends (CiA 301, CiA 305) |
|---|---|
| 0x000 | NMT command |
| 0x080 | SYNC |
| 0x200, 0x300, 0x400, 0x500 + node | set-points for one of our nodes |
| 0x600 + node | SDO request |
| 0x700 + computer | heartbeat with our own node-ID |
| 0x700 + node, remote frame | node guarding |
| 0x7E5 | layer setting service |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from drivers.bus.cia301 import (
    HEARTBEAT_BASE,
    HIGHEST_NODE_ID,
    SDO_REQUEST_BASE,
    SYNC_COB_ID,
    U32,
    ObjectRef,
)
from drivers.bus.device import DEVICE_TYPE, SYNC_COB, SYNC_GENERATE_BIT, RemoteDevice
from drivers.bus.network import Pump, PumpedBus, RawBus
from drivers.bus.sdo import SdoProtocolError, SdoTimeoutError
from drivers.clock import Clock
from drivers.errors import DriverError, OtherMasterError, ReadbackError
from drivers.event import Event
from drivers.python_can import can

LEAST_TIME_NS: Final = 1_500_000_000
"""How long is listened at least [ns]."""
_BEATS: Final = 3
"""Periods of the computer's heartbeat that are listened for at least: so would a second one of us be heard."""
_NMT_STARTUP: Final = ObjectRef(0x1F80, 0, U32, "NMT startup")
"""Bit 0: this node is the NMT master (CiA 302)."""
_LSS_REQUEST: Final = 0x7E5
_RPDOS: Final = (0x200, 0x300, 0x400, 0x500)
_REMEDY: Final = (
    "Nothing was moved. End the other run, program or controller, or unplug it; then start again."
)


class ListeningBus(PumpedBus):
    """A bus whose frames are counted, by (COB-ID, whether it is a remote frame), and go nowhere else."""

    def __init__(self, raw: RawBus, clock: Clock, pump: Pump | None) -> None:
        super().__init__(raw, clock, pump=pump)
        self.heard: Counter[tuple[int, bool]] = Counter()
        self.errors_heard = 0

    def listen(self, duration_ns: int) -> None:
        """Count afresh for `duration_ns` of the clock. Sends nothing."""
        self.heard.clear()
        self.idle(duration_ns)

    def _dispatch(self, message: can.Message) -> None:
        self.errors_heard += message.is_error_frame
        if not message.is_error_frame and not message.is_extended_id:
            self.heard[message.arbitration_id, message.is_remote_frame] += 1
        super()._dispatch(message)


def listening_time_ns(heartbeat_ms: int) -> int:
    """How long is listened [ns] by a computer whose own heartbeat has this period."""
    return max(LEAST_TIME_NS, _BEATS * heartbeat_ms * 1_000_000)


def listen_for_masters(
    raw: RawBus,
    clock: Clock,
    pump: Pump | None,
    *,
    node_ids: Sequence[int],
    own_node_id: int,
    duration_ns: int,
) -> list[Event]:
    """Listen for `duration_ns`, refuse another master, switch SYNC producers among our nodes off: what was done.

    Raises `OtherMasterError`, and `BusLostError` where the bus goes away meanwhile. The raw bus stays open.
    """
    bus = ListeningBus(raw, clock, pump)
    bus.listen(duration_ns)
    syncs = bus.heard[SYNC_COB_ID, False]
    masters = masters_heard(bus.heard, node_ids, own_node_id)
    if masters:
        masters += [_often("SYNC", SYNC_COB_ID, syncs)] if syncs else []
        raise refusal(masters, duration_ns)
    strangers = {
        node_id: count
        for (cob_id, _), count in bus.heard.items()
        if (node_id := _node_of(cob_id, HEARTBEAT_BASE)) and node_id not in node_ids
    }
    if syncs:
        _silence_producers(bus, node_ids, syncs, duration_ns)
    for node_id, count in sorted(strangers.items()):
        _ask_who_it_is(bus, node_id, count, duration_ns)
    return bus.events()


def masters_heard(
    heard: Counter[tuple[int, bool]], node_ids: Sequence[int], own_node_id: int
) -> list[str]:
    """What was heard that only a master sends, in words; the SYNC aside, which a node of ours may produce."""
    named = [
        (what, cob_id, count)
        for (cob_id, is_remote), count in sorted(heard.items())
        if (what := _only_a_master(cob_id, is_remote, node_ids, own_node_id))
    ]
    return [_often(what, cob_id, count) for what, cob_id, count in named]


def _only_a_master(cob_id: int, is_remote: bool, node_ids: Sequence[int], own_node_id: int) -> str:
    """What a frame is if only a master sends it, else ""."""
    beats, asked = _node_of(cob_id, HEARTBEAT_BASE), _node_of(cob_id, SDO_REQUEST_BASE)
    driven = [node for base in _RPDOS if (node := _node_of(cob_id, base)) in node_ids]
    meanings = (
        (is_remote and beats, f"node guarding of node {beats}"),
        (is_remote, ""),
        (cob_id == 0x000, "NMT commands"),
        (cob_id == _LSS_REQUEST, "layer setting commands"),
        (asked, f"SDO requests to node {asked}"),
        (driven, f"set-points for node {driven[0] if driven else 0}"),
        (beats == own_node_id, f"heartbeat of node {beats}, this computer's own node-ID"),
    )
    return next((words for applies, words in meanings if applies), "")


def _node_of(cob_id: int, base: int) -> int:
    """The node-ID in a COB-ID of the predefined connection set, 0 where it is none of this base."""
    return cob_id - base if 0 < cob_id - base <= HIGHEST_NODE_ID else 0


def _often(what: str, cob_id: int, count: int) -> str:
    return f"{what} (COB-ID 0x{cob_id:03X}) {count} times"


def refusal(heard: Sequence[str], duration_ns: int) -> OtherMasterError:
    """What is raised where a master was heard, in words."""
    return OtherMasterError(
        "another master is on this bus",
        where="bus",
        value=f"heard within {duration_ns / 1e9:g} s: {', '.join(heard)}",
        limit="one master",
        remedy=_REMEDY,
    )


def _silence_producers(
    bus: ListeningBus, node_ids: Sequence[int], syncs: int, duration_ns: int
) -> None:
    """Switch the SYNC producers among our nodes off and hear that it is silent. Raises `OtherMasterError`."""
    producers = [node_id for node_id in node_ids if _stops_producing(bus, node_id)]
    if producers:
        bus.listen(duration_ns)
        syncs = bus.heard[SYNC_COB_ID, False]
    if syncs:
        whose = (
            f"nodes {producers} were switched off" if producers else "none of our nodes sends it"
        )
        raise refusal([f"{_often('SYNC', SYNC_COB_ID, syncs)}, and {whose}"], duration_ns)


def _stops_producing(bus: ListeningBus, node_id: int) -> bool:
    """Whether the node produced SYNC and, read back, does so no more. Raises `OtherMasterError` if it insists."""
    device = RemoteDevice(bus, node_id)
    try:
        value = int(device.read_optional(SYNC_COB) or 0)
    except (SdoTimeoutError, SdoProtocolError):
        # Off, stopped or without an SDO server: bring-up says so, and it is not this node that sends SYNC.
        return False
    if not value & SYNC_GENERATE_BIT:
        return False
    try:
        is_off = device.write_checked(SYNC_COB, value & ~SYNC_GENERATE_BIT)
    except ReadbackError:
        is_off = False
    text = "it produced the SYNC (0x1005 bit 30)"
    if not is_off:
        raise OtherMasterError(
            f"{text} and cannot be told not to",
            where=device.where,
            value=f"0x{value:08X}",
            limit="bit 30 clear",
            remedy="Switch its SYNC producer off with the vendor's tool.",
        )
    bus.emit("warning", "sync-producer", device.where, f"{text}: switched off")
    return True


def _ask_who_it_is(bus: ListeningBus, node_id: int, count: int, duration_ns: int) -> None:
    """A node that is not configured: a slave says what it is and is left alone. Raises
    `OtherMasterError` for others.
    """
    device = RemoteDevice(bus, node_id)
    beats = _often(f"heartbeat of node {node_id}", HEARTBEAT_BASE + node_id, count)
    try:
        device.read(DEVICE_TYPE)
        is_master = bool(int(device.read_optional(_NMT_STARTUP) or 0) & 1)
    except DriverError:
        raise refusal([f"{beats}, which does not say what it is"], duration_ns) from None
    if is_master:
        raise refusal([f"{beats}, which calls itself NMT master (0x1F80)"], duration_ns)
    bus.emit(
        "warning", "stranger", device.where, f"{beats}: it is not configured and is left alone"
    )
