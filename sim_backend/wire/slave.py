"""A CANopen slave by CiA 301: boot-up, NMT, heartbeat both ways, SDO server, process data, emergency messages.

It is driven from outside: `receive` for each frame, `tick` when time has passed, `latch` and `act` around a SYNC. What it
sends goes to the function it was given. Nothing here knows what the device is for; drive, counter and analogue input add
their objects and their behaviour.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from enum import IntEnum

from sim_backend.wire.dictionary import (
    TEXT,
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    Entry,
    Number,
    ObjectDictionary,
    array,
)  # fmt: skip
from sim_backend.wire.pdo import Pdo, Send, communication_entries, due_on_sync
from sim_backend.wire.sdo_server import SdoServer

CONSUMERS = 4
HISTORY = 8


class NmtState(IntEnum):
    """The state byte of a heartbeat."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class PdoPlan:
    """A default PDO of a device: number, direction, transmission type, mapping words."""

    def __init__(self, number: int, *, transmit: bool, mapping: tuple[int, ...], transmission: int = 1) -> None:
        self.number, self.transmit, self.mapping, self.transmission = number, transmit, mapping, transmission

    def entries(self, node_id: int) -> list[Entry]:
        base = (0x180 if self.transmit else 0x200) + 0x100 * (self.number - 1)
        return communication_entries(
            self.number, transmit=self.transmit, cob_id=base + node_id, transmission=self.transmission, mapping=self.mapping
        )


def standard_entries(node_id: int, device_type: int, name: str, product: int, serial: int) -> list[Entry]:
    """The communication profile area that every slave here has."""
    identity = (
        ("vendor-ID", U32, "const", 0), ("product code", U32, "const", product),
        ("revision number", U32, "const", 0x0001_0000), ("serial number", U32, "const", serial),
    )  # fmt: skip
    return [
        Entry(0x1000, 0, "Device type", U32, "const", device_type),
        Entry(0x1001, 0, "Error register", U8, "ro", 0, "t"),
        Entry(0x1003, 0, "Pre-defined error field: number of errors", U8, "rw", 0, high=0),
        *(Entry(0x1003, i, f"Pre-defined error field: error {i}", U32, "ro") for i in range(1, HISTORY + 1)),
        Entry(0x1005, 0, "COB-ID SYNC message", U32, "rw", 0x80),
        Entry(0x1008, 0, "Manufacturer device name", TEXT, "const", name),
        Entry(0x1009, 0, "Manufacturer hardware version", TEXT, "const", "simulated"),
        Entry(0x100A, 0, "Manufacturer software version", TEXT, "const", "1.0"),
        Entry(0x1014, 0, "COB-ID EMCY", U32, "rw", 0x80 + node_id),
        *array(0x1016, "Consumer heartbeat time", [(f"consumer {i}", U32, "rw", 0) for i in range(1, CONSUMERS + 1)]),
        Entry(0x1017, 0, "Producer heartbeat time", U16, "rw", 0),
        *array(0x1018, "Identity object", identity),  # type: ignore[arg-type]
        Entry(0x1019, 0, "Synchronous counter overflow value", U8, "rw", 0, high=240),
        *array(0x1029, "Error behaviour", [("communication error", U8, "rw", 0)]),
    ]


class Slave:
    """One node: its dictionary, its state, and what it does with frames and with time."""

    def __init__(self, node_id: int, entries: Iterable[Entry], pdos: Iterable[PdoPlan], send: Send) -> None:
        planned = list(pdos)
        self.node_id = node_id
        self.dictionary = ObjectDictionary([*entries, *(e for p in planned for e in p.entries(node_id))])
        self.state = NmtState.INITIALISING
        self.sdo = SdoServer(self.dictionary)
        self.rpdos = [Pdo(self.dictionary, 0x1400 + p.number - 1, False) for p in planned if not p.transmit]
        self.tpdos = [Pdo(self.dictionary, 0x1800 + p.number - 1, True) for p in planned if p.transmit]
        self.is_powered = True
        self._send = send
        self._now_ns = 0
        self._next_heartbeat_ns: int | None = None
        self._consumed: dict[int, int] = {}
        self._lost: set[int] = set()
        self.dictionary.on_write(0x1017, 0, self._start_heartbeat)
        self.dictionary.on_write(0x1003, 0, lambda _value: self._clear_history())
        self.dictionary.on_write(0x1019, 0, self._check_counter)
        for sub in range(1, CONSUMERS + 1):
            self.dictionary.on_write(0x1016, sub, lambda value, sub=sub: self._watch(sub, int(value)))

    # What a device adds -------------------------------------------------------------------------------------------

    def on_heartbeat_lost(self, producer: int) -> None:
        """A consumed heartbeat stayed away."""

    def on_nmt(self, state: NmtState) -> None:
        """The NMT state has changed."""

    def on_reset(self) -> None:
        """The application has been reset."""

    # Frames and time ----------------------------------------------------------------------------------------------

    def boot(self, now_ns: int) -> None:
        """Power on or reset: boot-up message, then pre-operational."""
        self._now_ns = now_ns
        self.sdo.reset()
        self._consumed.clear()
        self._lost.clear()
        self._send(0x700 + self.node_id, bytes([0]))
        self._enter(NmtState.PRE_OPERATIONAL)
        self._start_heartbeat(self.dictionary.value(0x1017))

    def receive(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """One frame from the bus, except the SYNC."""
        if not self.is_powered:
            return
        self._now_ns = now_ns
        if cob_id == 0x000 and len(data) == 2:
            if data[1] in (0, self.node_id):
                self._nmt(data[0], now_ns)
        elif cob_id == 0x600 + self.node_id and self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            answer = self.sdo.handle(data)
            if answer is not None:
                self._send(0x580 + self.node_id, answer)
        elif 0x700 < cob_id < 0x780 and len(data) == 1:
            self._hear(cob_id - 0x700, now_ns)
        elif self.state is NmtState.OPERATIONAL:
            self._receive_pdo(cob_id, data)

    def tick(self, now_ns: int) -> None:
        """Time has passed: heartbeats due, heartbeats missed, event timers."""
        if not self.is_powered:
            return
        self._now_ns = now_ns
        if self._next_heartbeat_ns is not None and now_ns >= self._next_heartbeat_ns:
            self._next_heartbeat_ns += self.dictionary.number(0x1017) * 1_000_000
            self._send(0x700 + self.node_id, bytes([self.state]))
        for producer, limit_ns in self._consumers().items():
            heard = self._consumed.get(producer)
            if heard is not None and producer not in self._lost and now_ns - heard > limit_ns:
                self._lost.add(producer)
                self._communication_error(0x8130)
                self.on_heartbeat_lost(producer)
        if self.state is NmtState.OPERATIONAL:
            for pdo in self.tpdos:
                self._event_timer(pdo, now_ns)

    def apply_synchronous(self) -> None:
        """At a SYNC, first half: synchronous set-points received since the last one take effect."""
        if not self.is_powered or self.state is not NmtState.OPERATIONAL:
            return
        for pdo in self.rpdos:
            if pdo.received is not None and pdo.transmission <= 240:
                data, pdo.received = pdo.received, None
                self._apply(pdo, data)

    def send_synchronous(self) -> None:
        """At a SYNC, second half: the values latched at this SYNC are sent."""
        if not self.is_powered or self.state is not NmtState.OPERATIONAL:
            return
        for pdo in self.tpdos:
            if pdo.exists and due_on_sync(pdo):
                self._transmit(pdo)

    def emergency(self, code: int, register: int = 0x01, vendor: bytes = b"") -> None:
        """Send an emergency message (code 0: error reset) and keep it in the history 0x1003."""
        self.dictionary.store(0x1001, 0, register if code else 0)
        if code:
            count = min(int(self.dictionary.value(0x1003)) + 1, HISTORY)
            for i in range(count, 1, -1):
                self.dictionary.store(0x1003, i, self.dictionary.value(0x1003, i - 1))
            self.dictionary.store(0x1003, 1, code)
            self.dictionary.store(0x1003, 0, count)
        cob_id = self.dictionary.number(0x1014)
        if not cob_id & 0x8000_0000 and self.state is not NmtState.STOPPED:
            self._send(cob_id & 0x7FF, struct.pack("<HB5s", code, register if code else 0, vendor))

    def value_changed(self, index: int, sub: int = 0) -> None:
        """A mapped value has changed by an event: TPDOs of types 0, 254 and 255 that carry it are due."""
        for pdo in self.tpdos:
            if any((i, s) == (index, sub) for i, s, _ in pdo.mapping):
                pdo.changed = True
                if pdo.transmission >= 254 and pdo.exists and self.state is NmtState.OPERATIONAL:
                    self._transmit(pdo)

    # Inside -------------------------------------------------------------------------------------------------------

    def _nmt(self, command: int, now_ns: int) -> None:
        states = {0x01: NmtState.OPERATIONAL, 0x02: NmtState.STOPPED, 0x80: NmtState.PRE_OPERATIONAL}
        if command in states:
            self._enter(states[command])
        elif command == 0x81:
            self.dictionary.reset(lambda _index: True)
            self._reload()
            self.on_reset()
            self.boot(now_ns)
        elif command == 0x82:
            self.dictionary.reset(lambda index: 0x1000 <= index < 0x2000)
            self._reload()
            self.boot(now_ns)

    def _reload(self) -> None:
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.reload()

    def _enter(self, state: NmtState) -> None:
        if state is not self.state:
            self.state = state
            for pdo in (*self.rpdos, *self.tpdos):
                pdo.syncs, pdo.received, pdo.next_event_ns = 0, None, None
            self.on_nmt(state)

    def _start_heartbeat(self, period_ms: Number) -> None:
        period_ns = int(period_ms) * 1_000_000
        self._next_heartbeat_ns = self._now_ns + period_ns if period_ns else None

    def _check_counter(self, value: Number) -> None:
        if int(value) == 1:
            raise AbortError(Abort.VALUE)

    def _clear_history(self) -> None:
        for sub in range(1, HISTORY + 1):
            self.dictionary.store(0x1003, sub, 0)

    def _consumers(self, but: int = 0) -> dict[int, int]:
        words = (self.dictionary.number(0x1016, sub) for sub in range(1, CONSUMERS + 1) if sub != but)
        return {(w >> 16) & 0x7F: (w & 0xFFFF) * 1_000_000 for w in words if w & 0xFFFF and (w >> 16) & 0x7F}

    def _watch(self, sub: int, word: int) -> None:
        producer = (word >> 16) & 0x7F
        if word & 0xFFFF and producer in self._consumers(but=sub):
            raise AbortError(Abort.PARAMETER)
        self._lost.discard(producer)
        self._consumed.pop(producer, None)

    def _hear(self, producer: int, now_ns: int) -> None:
        if producer in self._consumers():
            self._consumed[producer] = now_ns
            if producer in self._lost:
                self._lost.discard(producer)
                self.emergency(0)

    def _communication_error(self, code: int) -> None:
        self.emergency(code, 0x11)
        behaviour = self.dictionary.number(0x1029, 1)
        if self.state is NmtState.OPERATIONAL and behaviour != 1:
            self._enter(NmtState.PRE_OPERATIONAL if behaviour == 0 else NmtState.STOPPED)

    def _receive_pdo(self, cob_id: int, data: bytes) -> None:
        for pdo in self.rpdos:
            if pdo.exists and pdo.cob_id & 0x7FF == cob_id:
                if len(data) < pdo.length:
                    self.emergency(0x8210, 0x11)
                elif pdo.transmission <= 240:
                    pdo.received = data
                else:
                    self._apply(pdo, data)
                if len(data) > pdo.length:
                    self.emergency(0x8220, 0x11)

    def _apply(self, pdo: Pdo, data: bytes) -> None:
        try:
            pdo.unpack(data)
        except AbortError:
            self.emergency(0x6000, 0x01)

    def _event_timer(self, pdo: Pdo, now_ns: int) -> None:
        period_ns = self.dictionary.number(pdo.index, 5) * 1_000_000
        if pdo.transmission < 254 or not period_ns or not pdo.exists:
            return
        if pdo.next_event_ns is None:
            pdo.next_event_ns = now_ns + period_ns
        elif now_ns >= pdo.next_event_ns:
            pdo.next_event_ns += period_ns
            self._transmit(pdo)

    def _transmit(self, pdo: Pdo) -> None:
        pdo.last_sent = pdo.pack()
        self._send(pdo.cob_id & 0x7FF, pdo.last_sent)

