"""A log of bus frames played to the decoders: what each COB-ID is, how often it came, what the nodes told.

Any log that python-can reads, of this program or of another; the nodes' heartbeats, boot-ups and emergencies are taken
by the same code that takes them in a run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.bus.cia301 import (
    EMCY_BASE,
    HEARTBEAT_BASE,
    HIGHEST_NODE_ID,
    SDO_REQUEST_BASE,
    SDO_RESPONSE_BASE,
    SYNC_COB_ID,
    NmtCommand,
    nmt_state,
)
from drivers.bus.frame_log import read_frames
from drivers.bus.network import PumpedBus
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.event import Event
from drivers.python_can import can

_TPDOS = {0x180: 1, 0x280: 2, 0x380: 3, 0x480: 4}
_RPDOS = {0x200: 1, 0x300: 2, 0x400: 3, 0x500: 4}
LATEST = 20
"""Frames that are kept in words."""


@dataclass(frozen=True)
class _SaidFrame:
    """One frame in words: time since the first one [s], COB-ID, whether this computer sent it, data, what it says."""

    at: float
    cob_id: int
    is_sent: bool
    data: str
    words: str


@dataclass
class _Traffic:
    """What one COB-ID carried: what it is, frames sent and received, its latest data."""

    what: str
    sent: int = 0
    received: int = 0
    latest: str = ""


@dataclass
class Played:
    """A log that was played: its frames by COB-ID, what the nodes told, the latest frames, its length [s]."""

    frames: int = 0
    seconds: float = 0.0
    traffic: dict[int, _Traffic] = field(default_factory=dict)
    events: list[tuple[float, Event]] = field(default_factory=list)
    latest: list[_SaidFrame] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """The object that `rig show --frames --json` prints."""
        return {
            "frames": self.frames,
            "seconds": self.seconds,
            "traffic": [
                {"cob_id": cob_id, **vars(one)} for cob_id, one in sorted(self.traffic.items())
            ],
            "events": [
                {
                    "at": at,
                    "level": one.level,
                    "code": one.code,
                    "source": one.source,
                    "text": one.text,
                }
                for at, one in self.events
            ],
            "latest": [vars(one) for one in self.latest],
        }


class _Log:
    """A bus that says what is in a log, one frame at a time."""

    def __init__(self) -> None:
        self.next: can.Message | None = None

    def send(self, msg: can.Message, /) -> None:
        raise DriverError("nothing is sent to a log", where="log")

    def recv(self, timeout: float | None = None, /) -> can.Message | None:
        message, self.next = self.next, None
        return message

    def shutdown(self) -> None:
        """There is nothing to let go of."""


def play(path: Path, latest: int = LATEST) -> Played:
    """Play a log. Raises `DriverError` where it cannot be read."""
    raw, clock, played = _Log(), VirtualClock(), Played()
    bus = PumpedBus(raw, clock)
    first: float | None = None
    for message in _plain(read_frames(path)):
        first = message.timestamp if first is None else first
        at = message.timestamp - first
        behind = round(at * 1e9) - clock.monotonic_ns()
        if behind > 0:
            clock.advance_ns(behind)
        _count(played, message, at, latest)
        if message.is_rx:
            _take(bus, raw, message)
            played.events += [(at, event) for event in bus.events()]
    return played


def _plain(messages: Iterator[can.Message]) -> Iterator[can.Message]:
    return (message for message in messages if not message.is_extended_id)


def _take(bus: PumpedBus, raw: _Log, message: can.Message) -> None:
    """Hand a frame to the decoders; a node that is heard for the first time is watched from now on."""
    for base in (HEARTBEAT_BASE, EMCY_BASE):
        node_id = message.arbitration_id - base
        if 0 < node_id <= HIGHEST_NODE_ID and node_id not in bus.nodes:
            bus.watch(node_id)
    raw.next = message
    bus.drain()


def _count(played: Played, message: can.Message, at: float, latest: int) -> None:
    cob_id, data = message.arbitration_id, bytes(message.data)
    one = played.traffic.setdefault(cob_id, _Traffic(meaning(cob_id)))
    one.sent += not message.is_rx
    one.received += message.is_rx
    one.latest = data.hex(" ")
    played.frames += 1
    played.seconds = at
    said = words(cob_id, data)
    played.latest.append(_SaidFrame(at, cob_id, not message.is_rx, one.latest, said))
    del played.latest[: max(0, len(played.latest) - latest)]


def meaning(cob_id: int) -> str:
    """What a COB-ID of the predefined connection set carries (CiA 301)."""
    if cob_id == 0x000:
        return "NMT commands"
    if cob_id == SYNC_COB_ID:
        return "SYNC"
    named: Mapping[int, str] = {
        EMCY_BASE: "emergencies of node",
        **{base: f"TPDO {number} of node" for base, number in _TPDOS.items()},
        **{base: f"RPDO {number} of node" for base, number in _RPDOS.items()},
        SDO_RESPONSE_BASE: "SDO answers of node",
        SDO_REQUEST_BASE: "SDO requests to node",
        HEARTBEAT_BASE: "heartbeat of node",
    }
    for base, what in named.items():
        if 0 < cob_id - base <= HIGHEST_NODE_ID:
            return f"{what} {cob_id - base}"
    return "not of the predefined set"


def words(cob_id: int, data: bytes) -> str:
    """What one frame says, as far as it says it by itself."""
    what = meaning(cob_id)
    if cob_id == 0x000 and len(data) == 2:
        names = {command.value: command.name.lower().replace("_", " ") for command in NmtCommand}
        return f"NMT {names.get(data[0], f'0x{data[0]:02X}')}, {f'node {data[1]}' if data[1] else 'all nodes'}"
    if what.startswith("SDO") and len(data) == 8:
        index, sub = int.from_bytes(data[1:3], "little"), data[3]
        is_abort = data[0] == 0x80
        text = f", abort 0x{int.from_bytes(data[4:8], 'little'):08X}" if is_abort else ""
        return f"{what}: 0x{index:04X}:{sub}{text}"
    if what.startswith("heartbeat") and data:
        return f"{what}: {nmt_state(data[0]).name.replace('_', '-')}"
    if what.startswith("emergencies") and len(data) >= 2:
        return f"{what}: 0x{int.from_bytes(data[:2], 'little'):04X}"
    return what
