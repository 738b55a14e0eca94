"""Who is on an unknown bus, found out without touching anybody: listening, then uploads and nothing else.

No NMT command, no SYNC, no write: of all that is sent, every frame is an SDO upload (or the abort of one). Another
master, a SYNC, or a drive with power ends it at once: such a bus is somebody's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from drivers.bus.cia301 import (
    HIGHEST_NODE_ID,
    SDO_REQUEST_BASE,
    SDO_RESPONSE_BASE,
    SYNC_COB_ID,
    U8,
    U16,
    U32,
    ObjectRef,
)
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.plausible import Statement, read_statement
from drivers.bus.cia406 import TOTAL_RANGE, UNITS_PER_REVOLUTION
from drivers.bus.device import (
    HEARTBEAT_CONSUMER,
    HEARTBEAT_PRODUCER,
    SYNC_OVERFLOW,
    Identity,
    RemoteDevice,
)
from drivers.bus.listening import LEAST_TIME_NS, ListeningBus, masters_heard, refusal
from drivers.bus.network import Pump, RawBus
from drivers.bus.sdo import SdoAbortError, SdoProtocolError, SdoTimeoutError
from drivers.clock import Clock
from drivers.drive_state import POWERED_STATES, drive_state
from drivers.errors import BusLostError, DriverError, OtherMasterError

BIT_RATES: Final = (1_000_000, 500_000, 250_000, 125_000, 800_000, 100_000, 50_000, 20_000, 10_000)
"""Bit rates of CiA 301 [bit/s], the usual ones first."""
PASSIVE: Final[Mapping[str, Mapping[str, Any]]] = {
    "slcan": {"listen_only": True},
    "kvaser": {"driver_mode": False},
}
"""Arguments of python-can by which an interface listens only: it acknowledges nothing and disturbs nobody."""
GUARD_TIME: Final = ObjectRef(0x100C, 0, U16, "guard time")
LIFE_FACTOR: Final = ObjectRef(0x100D, 0, U8, "life time factor")
_DIGITAL_INPUTS: Final = ObjectRef(0x60FD, 0, U32, "digital inputs")
_ANALOG_COUNT: Final = ObjectRef(0x6401, 0, U8, "analogue inputs")
_TPDO, _TPDO_MAP, _PDOS = 0x1800, 0x1A00, 4
_FRAME_NS: Final = 1_000_000
"""Between two questions: the send buffer of an adapter is a few frames deep."""
_ANSWER_NS: Final = 300_000_000


@dataclass(frozen=True)
class FoundPdo:
    """A transmit PDO as it is set now: number from 1, COB-ID word, transmission type, entries (index, sub, bits)."""

    number: int
    cob_id: int
    transmission: int
    entries: tuple[tuple[int, int, int], ...]

    @property
    def is_on(self) -> bool:
        """Whether it exists: bit 31 of its COB-ID is clear."""
        return not self.cob_id >> 31


@dataclass(frozen=True, kw_only=True)
class FoundNode:
    """What a node tells of itself. None: it has no such object."""

    node_id: int
    identity: Identity
    pdos: tuple[FoundPdo, ...] = ()
    heartbeat_ms: int | None = None
    has_consumer: bool = False
    guard_time_ms: int = 0
    life_factor: int = 0
    sync_overflow: int = 0
    # a drive
    modes: int | None = None
    statement: Statement = field(default_factory=Statement)
    quick_stop_option: int | None = None
    abort_option: int | None = None
    has_digital_inputs: bool = False
    # an encoder
    counts_per_revolution: int | None = None
    total_range: int | None = None
    # a coupler
    analog_inputs: int = 0

    @property
    def profile(self) -> int:
        """Its device profile: 401, 402, 406 or another."""
        return self.identity.profile

    @property
    def refused(self) -> tuple[str, ...]:
        """What it is set to that this program does not do, by name."""
        found: list[str] = []
        if self.sync_overflow:
            found.append(f"a SYNC with a counter (0x1019 = {self.sync_overflow})")
        if self.guard_time_ms and self.life_factor and not self.heartbeat_ms:
            found.append(f"node guarding (0x100C = {self.guard_time_ms} ms) as its only watch")
        return tuple(found)


def listen_only(
    raw: RawBus, clock: Clock, pump: Pump | None, duration_ns: int = LEAST_TIME_NS
) -> ListeningBus:
    """Listen, and send nothing. Raises `OtherMasterError` for anything that only a master sends, SYNC included."""
    bus = ListeningBus(raw, clock, pump)
    bus.listen(duration_ns)
    heard = masters_heard(bus.heard, range(1, HIGHEST_NODE_ID + 1), 0)
    syncs = bus.heard[SYNC_COB_ID, False]
    if syncs:
        heard.append(f"SYNC (COB-ID 0x080) {syncs} times")
    if heard:
        raise refusal(heard, duration_ns)
    return bus


def find_bit_rate(
    open_at: Callable[[int, Mapping[str, Any]], RawBus],
    interface: str,
    clock: Clock,
    duration_ns: int = LEAST_TIME_NS,
    on_rate: Callable[[int], None] = lambda rate: None,
) -> int:
    """The bit rate [bit/s] of a bus on which somebody talks, by listening alone.

    `open_at` opens the interface at a bit rate with the arguments by which it only listens. Raises `DriverError` for an
    interface that cannot listen without acknowledging, and for a bus on which nothing is heard.
    """
    arguments = PASSIVE.get(interface)
    if arguments is None:
        raise DriverError(
            "the bit rate cannot be found through this interface: it would disturb the bus at a wrong one",
            where=interface,
            limit=f"one that listens only: {', '.join(PASSIVE)}",
            remedy="Give --bit-rate as the devices are set; a socketcan or socketcand interface has its own already.",
        )
    for rate in BIT_RATES:
        on_rate(rate)
        raw = open_at(rate, arguments)
        try:
            bus = ListeningBus(raw, clock, None)
            bus.listen(duration_ns)
            is_right = bool(bus.heard) and not bus.errors_heard
        except BusLostError:
            is_right = False
        finally:
            raw.shutdown()
        if is_right:
            return rate
    raise DriverError(
        "nothing is heard at any bit rate",
        where=interface,
        value=", ".join(f"{rate // 1000} kbit/s" for rate in BIT_RATES),
        remedy="A silent bus does not tell its bit rate: switch a device on that sends heartbeats, or give --bit-rate.",
    )


def scan(
    bus: ListeningBus, on_node: Callable[[int], None] = lambda node_id: None
) -> tuple[int, ...]:
    """Who answers: every node-ID is asked for object 0x1000 by SDO."""
    answering: set[int] = set()
    for node_id in range(1, HIGHEST_NODE_ID + 1):
        bus.subscribe(
            SDO_RESPONSE_BASE + node_id, lambda _, __, node_id=node_id: answering.add(node_id)
        )
        bus.send(SDO_REQUEST_BASE + node_id, bytes([0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0]))
        bus.idle(_FRAME_NS)
        on_node(node_id)
    bus.idle(_ANSWER_NS)
    return tuple(sorted(answering))


def read_node(bus: ListeningBus, node_id: int) -> FoundNode:
    """What a node tells of itself. Raises `OtherMasterError` for a drive that has power."""
    device = RemoteDevice(bus, node_id)
    identity = device.identity()
    number = _Asker(device)
    node = FoundNode(
        node_id=node_id,
        identity=identity,
        heartbeat_ms=number(HEARTBEAT_PRODUCER),
        has_consumer=number(HEARTBEAT_CONSUMER) is not None,
        guard_time_ms=number(GUARD_TIME) or 0,
        life_factor=number(LIFE_FACTOR) or 0,
        sync_overflow=number(SYNC_OVERFLOW) or 0,
        pdos=tuple(_pdos(number)),
    )
    if identity.profile == 402:
        _refuse_power(number, node_id)
        return replace(
            node,
            modes=number(obj.SUPPORTED_MODES),
            statement=read_statement(number, vendor_id=identity.vendor_id),
            quick_stop_option=number(obj.QUICK_STOP_OPTION),
            abort_option=number(obj.ABORT_OPTION),
            has_digital_inputs=number(_DIGITAL_INPUTS) is not None,
        )
    if identity.profile == 406:
        units, whole = number(UNITS_PER_REVOLUTION), number(TOTAL_RANGE)
        return replace(node, counts_per_revolution=units, total_range=whole)
    if identity.profile == 401:
        return replace(node, analog_inputs=number(_ANALOG_COUNT) or 0)
    return node


class _Asker:
    """Reads numbers of a device; None for what it refuses or does not answer."""

    def __init__(self, device: RemoteDevice) -> None:
        self._device = device

    def __call__(self, entry: ObjectRef) -> int | None:
        try:
            return int(self._device.read(entry))
        except (SdoAbortError, SdoTimeoutError, SdoProtocolError, OverflowError, ValueError):
            return None


def _pdos(number: Callable[[ObjectRef], int | None]) -> Iterator[FoundPdo]:
    for k in range(_PDOS):
        cob_id = number(ObjectRef(_TPDO + k, 1, U32, "COB-ID"))
        if cob_id is None:
            continue
        count = number(ObjectRef(_TPDO_MAP + k, 0, U8, "mapped entries")) or 0
        words = [
            number(ObjectRef(_TPDO_MAP + k, sub, U32, "entry")) or 0
            for sub in range(1, min(count, 8) + 1)
        ]
        entries = tuple((word >> 16, word >> 8 & 0xFF, word & 0xFF) for word in words)
        kind = number(ObjectRef(_TPDO + k, 2, U8, "transmission type")) or 0
        yield FoundPdo(k + 1, cob_id, kind, entries)


def _refuse_power(number: Callable[[ObjectRef], int | None], node_id: int) -> None:
    word = number(obj.STATUSWORD)
    if word is None or drive_state(word) not in POWERED_STATES:
        return
    raise OtherMasterError(
        "this drive has power: somebody runs it",
        where=f"node {node_id}",
        value=f"statusword 0x{word:04X}, {drive_state(word).value}",
        limit="servo off",
        remedy="Nothing was changed. End the other run or program, switch the servo off, and begin again.",
    )


def discover(
    raw: RawBus,
    clock: Clock,
    pump: Pump | None = None,
    *,
    on_stage: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Sequence[FoundNode]:
    """Everybody on a bus, and what they tell. The raw bus stays open. Raises `OtherMasterError`, `BusLostError`."""
    on_stage("listening", 0, 1)
    bus = listen_only(raw, clock, pump)
    nodes = scan(bus, lambda node_id: on_stage("node-IDs asked", node_id, HIGHEST_NODE_ID))
    found: list[FoundNode] = []
    for done, node_id in enumerate(nodes):
        on_stage("nodes read", done, len(nodes))
        found.append(read_node(bus, node_id))
    return found
