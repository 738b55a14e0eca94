"""A CANopen slave by CiA 301: boot-up, NMT, heartbeat both ways, SDO server, process data, emergency messages.

It is driven from outside: `receive` for each frame, `tick` when time has passed (at the latest at
`next_due_ns`), and at a SYNC `hear_sync`, `latch`, `apply_synchronous`, `send_synchronous` in this order. What
it sends goes to the function it was given. Nothing here knows what the device is for; drive,
counter and analogue input add their objects and their behaviour.
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
    entry,
)
from sim_backend.wire.pdo import (
    INVALID,
    LAST_SYNCHRONOUS,
    NO_RTR,
    Pdo,
    Send,
    communication_entries,
    due_on_sync,
)
from sim_backend.wire.sdo_server import SdoServer

CONSUMERS = 4
HISTORY = 8
MILLISECOND = 1_000_000
GENERIC, COMMUNICATION = 0x01, 0x10
"""Bits of the error register 0x1001."""
_SYNC_ERROR = 0x8100
"""Emergency of a SYNC that stayed away for longer than `_SYNC_TOLERANCE` periods of 0x1006."""
_SYNC_TOLERANCE = 1.5
HEARTBEAT_ERROR, SHORT_PDO, LONG_PDO, REFUSED_VALUE = 0x8130, 0x8210, 0x8220, 0x6320
NEVER = 2**63


class NmtState(IntEnum):
    """The state byte of a heartbeat."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class PdoPlan:
    """A default PDO of a device: number, direction, transmission type, mapping words, and whether it exists at once."""

    def __init__(
        self,
        number: int,
        *,
        transmit: bool,
        mapping: tuple[int, ...],
        transmission: int = 1,
        exists: bool = True,
    ) -> None:
        self.number, self.transmit, self.mapping, self.transmission = (
            number,
            transmit,
            mapping,
            transmission,
        )
        self.exists = exists

    def entries(self, node_id: int) -> list[Entry]:
        """The records 0x1400 and 0x1600, or 0x1800 and 0x1A00."""
        base = (0x180 if self.transmit else 0x200) + 0x100 * (self.number - 1)
        cob_id = base + node_id | (NO_RTR if self.transmit else 0) | (0 if self.exists else INVALID)
        return communication_entries(
            self.number,
            transmit=self.transmit,
            cob_id=cob_id,
            transmission=self.transmission,
            mapping=self.mapping,
        )


def standard_entries(
    node_id: int, device_type: int, name: str, product: int, serial: int
) -> list[Entry]:
    """The communication profile area that every slave here has. Vendor-ID 0: nobody's."""
    identity = (
        ("vendor-ID", U32, "const", 0),
        ("product code", U32, "const", product),
        ("revision number", U32, "const", 0x0001_0000),
        ("serial number", U32, "const", serial),
    )
    return [
        entry(0x1000, 0, "Device type", U32, "const", device_type),
        entry(0x1001, 0, "Error register", U8, "ro", 0, mappable="t"),
        entry(0x1003, 0, "Pre-defined error field: number of errors", U8, "rw", 0),
        *(entry(0x1003, i, f"Pre-defined error field: error {i}", U32, "ro") for i in range(1, HISTORY + 1)),
        entry(0x1005, 0, "COB-ID SYNC message", U32, "rw", 0x80),
        entry(0x1006, 0, "Communication cycle period", U32, "rw", 0),
        entry(0x1008, 0, "Manufacturer device name", TEXT, "const", name),
        entry(0x1009, 0, "Manufacturer hardware version", TEXT, "const", "simulated"),
        entry(0x100A, 0, "Manufacturer software version", TEXT, "const", "1.0"),
        entry(0x1014, 0, "COB-ID EMCY", U32, "rw", 0x80 + node_id),
        *array(0x1016, "Consumer heartbeat time", [(f"consumer {i}", U32, "rw", 0) for i in range(1, CONSUMERS + 1)]),
        entry(0x1017, 0, "Producer heartbeat time", U16, "rw", 0),
        *array(0x1018, "Identity object", identity),  # type: ignore[arg-type]
        entry(0x1019, 0, "Synchronous counter overflow value", U8, "rw", 0),
        *array(0x1029, "Error behaviour", [("communication error", U8, "rw", 0)], high=2),
    ]  # fmt: skip


class Slave:
    """One node: its dictionary, its state, and what it does with frames and with time."""

    def __init__(
        self, node_id: int, entries: Iterable[Entry], pdos: Iterable[PdoPlan], send: Send
    ) -> None:
        planned = list(pdos)
        self.node_id = node_id
        self.dictionary = ObjectDictionary(
            [*entries, *(e for p in planned for e in p.entries(node_id))]
        )
        self.state = NmtState.INITIALISING
        self.sdo = SdoServer(self.dictionary)
        self.rpdos = [
            Pdo(dictionary=self.dictionary, index=0x1400 + p.number - 1, transmit=False)
            for p in planned
            if not p.transmit
        ]
        self.tpdos = [
            Pdo(dictionary=self.dictionary, index=0x1800 + p.number - 1, transmit=True)
            for p in planned
            if p.transmit
        ]
        self._send = send
        self._now_ns = 0
        self._next_heartbeat_ns = self._sync_due_ns = NEVER
        self._synced_ns: int | None = None
        self._watched: dict[int, int] = {}
        self._heard: dict[int, int] = {}
        self._lost: set[int] = set()
        self._errors: dict[int, int] = {}
        self._history: list[int] = []
        self._hook()

    def _hook(self) -> None:
        d = self.dictionary
        d.on_write(0x1003, 0, self._clear_history)
        for sub in range(1, HISTORY + 1):
            d.on_read(0x1003, sub, lambda sub=sub: self._past_error(sub))
        d.on_write(0x1005, 0, self._write_sync_cob_id)
        d.on_write(0x1006, 0, self._watch_sync)
        d.on_write(0x1014, 0, self._write_emcy_cob_id)
        for sub in range(1, CONSUMERS + 1):
            d.on_write(0x1016, sub, lambda value, sub=sub: self._watch(sub, int(value)))
        d.on_write(0x1017, 0, self._start_heartbeat)
        d.on_write(0x1019, 0, self._write_counter_overflow)

    # What a device adds -------------------------------------------------------------------------------------------

    def on_heartbeat_lost(self, producer: int) -> None:
        """A consumed heartbeat stayed away."""

    def on_sync_lost(self) -> None:
        """The SYNC that is supervised (0x1006) stayed away."""

    def on_nmt(self, state: NmtState) -> None:
        """The NMT state has changed."""

    def on_reset(self, application: bool) -> None:
        """The communication has been reset, and the application with it if `application`."""

    def latch(self) -> None:
        """At a SYNC, first of all: freeze what the synchronous TPDOs will show."""

    # Frames and time ----------------------------------------------------------------------------------------------

    @property
    def sync_cob_id(self) -> int:
        """The COB-ID of the SYNC that it follows."""
        return self.dictionary.number(0x1005) & 0x7FF

    def boot(self, now_ns: int) -> None:
        """Power on or reset: boot-up message, then pre-operational."""
        self._now_ns = now_ns
        self.sdo.reset()
        self._heard.clear()
        self._lost.clear()
        self._errors.clear()
        self._watched = self._consumers()
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.reload()
        self._send(0x700 + self.node_id, bytes([0]))
        self._enter(NmtState.PRE_OPERATIONAL)
        self._start_heartbeat(self.dictionary.value(0x1017))

    def restart(self, now_ns: int, application: bool = True) -> None:
        """Reset node, or reset communication only; also what a dip of its supply does."""
        self._now_ns = now_ns
        self.state = NmtState.INITIALISING
        self.dictionary.reset(lambda index: application or 0x1000 <= index < 0x2000)
        self.on_reset(application)
        self.boot(now_ns)

    def receive(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """One frame from the bus, except the SYNC."""
        self._now_ns = now_ns
        if self.state is NmtState.OPERATIONAL and self._receive_pdo(cob_id, data):
            return
        if cob_id == 0x000:
            if len(data) == 2 and data[1] in (0, self.node_id):
                self._nmt(data[0], now_ns)
        elif cob_id == 0x600 + self.node_id:
            if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
                answer = self.sdo.handle(data)
                if answer is not None:
                    self._send(0x580 + self.node_id, answer)
        elif 0x700 < cob_id < 0x780 and len(data) == 1:
            self._hear(cob_id - 0x700, now_ns)

    def hear_sync(self, now_ns: int) -> None:
        """At a SYNC, before all else: its supervision goes on from here."""
        if now_ns > self._sync_due_ns:
            self._lose_sync()
        if self.state is not NmtState.OPERATIONAL:
            return
        self._synced_ns = now_ns
        self._watch_sync(self.dictionary.value(0x1006))
        if _SYNC_ERROR in self._errors:
            self.recover(_SYNC_ERROR)

    def next_due_ns(self) -> int:
        """The next instant at which `tick` has something to do."""
        due = min(self._next_heartbeat_ns, self._sync_due_ns)
        for producer, limit_ns in self._watched.items():
            if producer in self._heard and producer not in self._lost:
                due = min(due, self._heard[producer] + limit_ns + 1)
        if self.state is NmtState.OPERATIONAL:
            for pdo in self.tpdos:
                if pdo.transmission >= 254 and pdo.exists:
                    if pdo.event_ns:
                        due = min(
                            due, self._now_ns if pdo.next_event_ns is None else pdo.next_event_ns
                        )
                    due = min(due, pdo.free_from_ns if pdo.is_due else NEVER)
        return due

    def tick(self, now_ns: int) -> None:
        """Time has passed: heartbeats due, heartbeats missed, event timers and inhibit times over."""
        self._now_ns = now_ns
        if now_ns >= self._next_heartbeat_ns:
            period_ns = self.dictionary.number(0x1017) * MILLISECOND
            # A beat on its grid; after a long gap the grid begins anew.
            self._next_heartbeat_ns += period_ns
            if self._next_heartbeat_ns <= now_ns:
                self._next_heartbeat_ns = now_ns + period_ns
            self._send(0x700 + self.node_id, bytes([self.state]))
        if now_ns >= self._sync_due_ns:
            self._lose_sync()
        for producer, limit_ns in self._watched.items():
            heard = self._heard.get(producer)
            if heard is not None and producer not in self._lost and now_ns - heard > limit_ns:
                self._lost.add(producer)
                self._lose(producer)
        if self.state is NmtState.OPERATIONAL:
            for pdo in self.tpdos:
                if pdo.transmission >= 254 and pdo.exists:
                    self._run_timers(pdo, now_ns)

    def apply_synchronous(self) -> None:
        """At a SYNC, second: synchronous set-points received since the last one take effect."""
        if self.state is NmtState.OPERATIONAL:
            for pdo in self.rpdos:
                if pdo.received is not None:
                    data, pdo.received = pdo.received, None
                    self._apply(pdo, data)

    def send_synchronous(self) -> None:
        """At a SYNC, last: the values latched at this SYNC are sent."""
        if self.state is NmtState.OPERATIONAL:
            for pdo in self.tpdos:
                if not pdo.cob_id & INVALID and due_on_sync(pdo):
                    self._send(pdo.cob_id & 0x7FF, pdo.pack())

    # Errors and events --------------------------------------------------------------------------------------------

    def emergency(self, code: int, register: int = GENERIC, vendor: bytes = b"") -> None:
        """An error has come: one emergency message when it comes, kept in the history 0x1003, until `recover`."""
        if code in self._errors:
            return
        self._errors[code] = register | GENERIC
        store, value = self.dictionary.store, self.dictionary.number
        count = min(value(0x1003) + 1, HISTORY)
        past = [self._history[i] for i in range(min(count - 1, len(self._history)))]
        self._history = [code, *past]
        store(0x1003, 0, count)
        self._send_emergency(code, vendor)

    def recover(self, *codes: int) -> None:
        """Errors have gone (all of them without a code): the message "error reset" with what is
        left of the register.
        """
        gone = [
            code
            for code in codes or tuple(self._errors)
            if self._errors.pop(code, None) is not None
        ]
        if gone:
            self._send_emergency(0)

    def value_changed(self, index: int, sub: int = 0) -> None:
        """A value has changed by an event: TPDOs of types 0, 254 and 255 that carry it are due."""
        for pdo in self.tpdos:
            if pdo.takes_events and pdo.carries(index, sub):
                pdo.is_due = True
                if pdo.is_event_driven:
                    self._transmit_event(pdo)

    # Inside -------------------------------------------------------------------------------------------------------

    def _send_emergency(self, code: int, vendor: bytes = b"") -> None:
        register = 0
        for bits in self._errors.values():
            register |= bits
        self.dictionary.store(0x1001, 0, register)
        cob_id = self.dictionary.number(0x1014)
        if not cob_id & INVALID and self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            self._send(cob_id & 0x7FF, struct.pack("<HB5s", code, register, vendor))

    def _past_error(self, sub: int) -> int:
        if sub > self.dictionary.number(0x1003):
            raise AbortError(Abort.NO_DATA)
        return self._history[sub - 1]

    def _clear_history(self, value: Number) -> None:
        if int(value):
            raise AbortError(Abort.VALUE)
        self._history = []

    def _nmt(self, command: int, now_ns: int) -> None:
        states = {
            0x01: NmtState.OPERATIONAL,
            0x02: NmtState.STOPPED,
            0x80: NmtState.PRE_OPERATIONAL,
        }
        if command in states:
            self._enter(states[command])
        elif command in (0x81, 0x82):
            self.restart(now_ns, command == 0x81)

    def _enter(self, state: NmtState) -> None:
        if state is self.state:
            return
        self.state = state
        self._synced_ns, self._sync_due_ns = None, NEVER
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.rest()
        self.on_nmt(state)
        if state is NmtState.OPERATIONAL:
            for pdo in self.tpdos:
                if pdo.is_event_driven and pdo.exists:
                    pdo.is_due = True
                    self._transmit_event(pdo)

    def _start_heartbeat(self, period_ms: Number) -> None:
        period_ns = int(period_ms) * MILLISECOND
        self._next_heartbeat_ns = self._now_ns + period_ns if period_ns else NEVER

    def _write_counter_overflow(self, value: Number) -> None:
        if int(value) == 1 or int(value) > LAST_SYNCHRONOUS:
            raise AbortError(Abort.VALUE)
        if self.dictionary.number(0x1006):
            raise AbortError(Abort.DEVICE_STATE)

    def _write_sync_cob_id(self, value: Number) -> None:
        # It consumes the SYNC and cannot produce it (bit 30); identifiers have 11 bits (bit 29).
        if int(value) & 0xE000_0000 or not 0x80 <= int(value) & 0x7FF <= 0x6FF:
            raise AbortError(Abort.VALUE)

    def _write_emcy_cob_id(self, value: Number) -> None:
        present, wanted = self.dictionary.number(0x1014), int(value)
        if wanted & 0x6000_0000 or (
            not (present | wanted) & INVALID and (present ^ wanted) & 0x7FF
        ):
            raise AbortError(Abort.VALUE)

    def _consumers(self, but: int = 0) -> dict[int, int]:
        words = (
            self.dictionary.number(0x1016, sub) for sub in range(1, CONSUMERS + 1) if sub != but
        )
        return {
            (w >> 16) & 0xFF: (w & 0xFFFF) * MILLISECOND
            for w in words
            if w & 0xFFFF and 1 <= (w >> 16) & 0xFF <= 127
        }

    def _watch(self, sub: int, word: int) -> None:
        """A consumer entry is written: its monitoring begins with the first heartbeat heard after that."""
        producer, others = (word >> 16) & 0xFF, self._consumers(but=sub)
        is_used = bool(word & 0xFFFF) and 1 <= producer <= 127
        if is_used and producer in others:
            raise AbortError(Abort.PARAMETER)
        before = (self.dictionary.number(0x1016, sub) >> 16) & 0xFF
        for node_id in (before, producer):
            self._heard.pop(node_id, None)
            self._lost.discard(node_id)
        self._watched = others | ({producer: (word & 0xFFFF) * MILLISECOND} if is_used else {})

    def _hear(self, producer: int, now_ns: int) -> None:
        if producer in self._watched:
            self._heard[producer] = now_ns
            if producer in self._lost:
                self._lost.discard(producer)
                if not self._lost:
                    self.recover(HEARTBEAT_ERROR)

    def _watch_sync(self, period_us: Number) -> None:
        """0x1006 supervises from the latest SYNC heard while OPERATIONAL; 0 does not."""
        supervises = period_us and self._synced_ns is not None
        limit_ns = round(_SYNC_TOLERANCE * int(period_us) * 1000)
        self._sync_due_ns = (self._synced_ns or 0) + limit_ns if supervises else NEVER

    def _lose_sync(self) -> None:
        """The SYNC is overdue: the same as a lost heartbeat; the supervision begins anew with the next SYNC."""
        self._synced_ns, self._sync_due_ns = None, NEVER
        self.emergency(_SYNC_ERROR, COMMUNICATION)
        self.on_sync_lost()
        self._leave_operational()

    def _lose(self, producer: int) -> None:
        """A consumed heartbeat is lost: emergency, the device's own reaction, then the error behaviour 0x1029."""
        self.emergency(HEARTBEAT_ERROR, COMMUNICATION, bytes([producer]))
        self.on_heartbeat_lost(producer)
        self._leave_operational()

    def _leave_operational(self) -> None:
        """The error behaviour 0x1029 after an error of the communication."""
        behaviour = self.dictionary.number(0x1029, 1)
        if self.state is NmtState.OPERATIONAL and behaviour != 1:
            self._enter(NmtState.PRE_OPERATIONAL if behaviour == 0 else NmtState.STOPPED)

    def _receive_pdo(self, cob_id: int, data: bytes) -> bool:
        for pdo in self.rpdos:
            if pdo.cob_id & 0x8000_07FF != cob_id or not pdo.mapping:
                continue
            if len(data) < pdo.length:
                self.emergency(SHORT_PDO, COMMUNICATION)
                return True
            if len(data) > pdo.length:
                self.emergency(LONG_PDO, COMMUNICATION)
            elif self._errors:
                self.recover(SHORT_PDO, LONG_PDO)
            if pdo.transmission <= LAST_SYNCHRONOUS:
                pdo.received = data
            else:
                self._apply(pdo, data)
            return True
        return False

    def _apply(self, pdo: Pdo, data: bytes) -> None:
        try:
            pdo.unpack(data)
        except AbortError:
            self.emergency(REFUSED_VALUE)

    def _run_timers(self, pdo: Pdo, now_ns: int) -> None:
        if pdo.event_ns:
            if pdo.next_event_ns is None:
                pdo.next_event_ns = now_ns + pdo.event_ns
            elif now_ns >= pdo.next_event_ns:
                pdo.is_due = True
        if pdo.is_due:
            self._transmit_event(pdo)

    def _transmit_event(self, pdo: Pdo) -> None:
        """Send an event-driven TPDO unless it is inhibited; the event timer begins anew with each transmission."""
        if (
            not pdo.exists
            or self.state is not NmtState.OPERATIONAL
            or self._now_ns < pdo.free_from_ns
        ):
            return
        pdo.is_due = False
        pdo.free_from_ns = self._now_ns + pdo.inhibit_ns
        pdo.next_event_ns = self._now_ns + pdo.event_ns if pdo.event_ns else None
        self._send(pdo.cob_id & 0x7FF, pdo.pack())
