"""A CANopen node on durand, a stack of other authors, stepped from outside in virtual time.

The stack's: NMT slave, SDO server, PDOs and their mapping, SYNC consumer, EMCY and heartbeat producer. It has no
heartbeat consumer (0x1016), no error behaviour (0x1029), produces no SYNC, and a node that is reset keeps what was
written to it; these four are here, by CiA 301.
"""

from __future__ import annotations

import contextlib
import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from durand import scheduler
from durand.datatypes import DatatypeEnum
from durand.network import NetworkABC
from durand.node import MinimalNode
from durand.object_dictionary import Record, Variable
from durand.services.nmt import StateEnum

U8, U16, U32 = DatatypeEnum.UNSIGNED8, DatatypeEnum.UNSIGNED16, DatatypeEnum.UNSIGNED32
I8, I16, I32 = DatatypeEnum.INTEGER8, DatatypeEnum.INTEGER16, DatatypeEnum.INTEGER32
NEVER = 1 << 62
HEARTBEAT_ERROR, COMMUNICATION_ERROR = 0x8130, 0x11
CONSUMERS = 2


@dataclass(order=True)
class Timer:
    """An entry of the stack's scheduler."""

    due_ns: int
    number: int
    call: Callable[[], object] = field(compare=False)
    is_cancelled: bool = field(default=False, compare=False)


class Timers(scheduler.AbstractScheduler[Timer]):
    """The stack's scheduler on the bench's clock: nothing happens but in `run`."""

    def __init__(self) -> None:
        self.now_ns = self._numbers = 0
        self._entries: list[Timer] = []

    def add(
        self,
        delay: float,
        callback: Callable[..., object],
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Timer:
        self._numbers += 1
        due_ns = self.now_ns + round(delay * 1e9)
        entry = Timer(due_ns, self._numbers, partial(callback, *args, **(kwargs or {})))
        heapq.heappush(self._entries, entry)
        return entry

    def cancel(self, entry: Timer) -> None:
        entry.is_cancelled = True

    @property
    def lock(self) -> contextlib.AbstractContextManager[None]:
        """One thread: nothing has to be locked."""
        return contextlib.nullcontext()

    @property
    def next_due_ns(self) -> int:
        while self._entries and self._entries[0].is_cancelled:
            heapq.heappop(self._entries)
        return self._entries[0].due_ns if self._entries else NEVER

    def run(self, now_ns: int) -> None:
        self.now_ns = now_ns
        while self.next_due_ns <= now_ns:
            heapq.heappop(self._entries).call()


class Line(NetworkABC):
    """The stack's network: one callback per COB-ID, as its own. Dead until the power is on."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        self._send, self.is_on = send, False
        self._takers: dict[int, Callable[[int, bytes], None]] = {}

    def add_subscription(self, cob_id: int, callback: Callable[[int, bytes], None]) -> None:
        self._takers[cob_id] = callback

    def remove_subscription(self, cob_id: int) -> None:
        self._takers.pop(cob_id)

    def send(self, cob_id: int, msg: bytes) -> None:
        if self.is_on:
            self._send(cob_id, bytes(msg))

    def hear(self, cob_id: int, data: bytes) -> None:
        taker = self._takers.get(cob_id)
        if taker is not None:
            taker(cob_id, data)


class DurandNode:
    """One node: `receive` a frame, `synchronise` at a SYNC, `tick` when time has passed. `build` adds the objects."""

    def __init__(self, node_id: int, send: Callable[[int, bytes], None]) -> None:
        self.node_id = node_id
        self.timers = Timers()
        # The stack has one scheduler for all nodes of a process; the latest bench has it.
        scheduler.set_scheduler(self.timers)
        self.line = Line(send)
        self.stack = MinimalNode(self.line, node_id)
        self.od = self.stack.object_dictionary
        self._lapses: dict[int, Timer] = {}
        self._heard_by: dict[int, int] = {}
        self._next_sync: Timer | None = None
        consumers = Record(name="Consumer Heartbeat Time")
        for sub in range(1, CONSUMERS + 1):
            consumers[sub] = Variable(U32, "rw", 0)
            self.od.update_callbacks[(0x1016, sub)].add(partial(self._watch, sub))
        self.od[0x1016] = consumers
        behaviour = Record(name="Error Behaviour")
        behaviour[1] = Variable(U8, "rw", 0)
        self.od[0x1029] = behaviour
        self.od[0x1006] = Variable(U32, "rw", 0)
        for index in (0x1005, 0x1006):
            self.od.update_callbacks[(index, 0)].add(self._produce_sync)
        self.build()
        self._defaults = {
            key: self.od.read(*key) for key, variable in self._variables() if variable.writable
        }
        self.stack.nmt.state_callbacks.add(self._changed)

    # What a device adds -----------------------------------------------------------------------------------------------

    def build(self) -> None:
        """Add the device's own objects."""

    def on_nmt(self, state: StateEnum) -> None:
        """The NMT state has changed; INITIALISATION is a reset."""

    def on_heartbeat_lost(self) -> None:
        """A heartbeat that 0x1016 watches stayed away."""

    # Frames and time --------------------------------------------------------------------------------------------------

    @property
    def sync_cob_id(self) -> int:
        return self.od.read(0x1005, 0) & 0x7FF

    @property
    def nmt(self) -> StateEnum:
        return self.stack.nmt.state

    def boot(self, now_ns: int) -> None:
        """The power comes on."""
        self.timers.now_ns = now_ns
        self.line.is_on = True
        self.stack.nmt.reset()

    def restart(self, now_ns: int) -> None:
        """A dip of the supply."""
        self.timers.now_ns = now_ns
        self.stack.nmt.reset()

    def receive(self, cob_id: int, data: bytes, now_ns: int) -> None:
        self.timers.now_ns = now_ns
        self.line.hear(cob_id, data)

    def synchronise(self) -> None:
        self.line.hear(self.sync_cob_id, b"")

    def tick(self, now_ns: int) -> None:
        self.timers.run(now_ns)

    def next_due_ns(self) -> int:
        return self.timers.next_due_ns

    def emergency(self, code: int, register: int, vendor: bytes = b"") -> None:
        self.stack.emcy.set(code, register, vendor)

    # What the stack leaves out ----------------------------------------------------------------------------------------

    def _variables(self) -> list[tuple[tuple[int, int], Variable]]:
        found = []
        for index, entry in self.od:
            parts = [(0, entry)] if isinstance(entry, Variable) else entry
            found += [((index, sub), variable) for sub, variable in parts]
        return found

    def _changed(self, state: StateEnum) -> None:
        if state is StateEnum.INITIALISATION:
            for key, value in self._defaults.items():
                if self.od.read(*key) != value:
                    self.od.write(*key, value, downloaded=True)
        self.on_nmt(state)

    def _watch(self, sub: int, word: int) -> None:
        """0x1016 is written: the watch begins with the first heartbeat heard after that."""
        if (lapse := self._lapses.pop(sub, None)) is not None:
            self.timers.cancel(lapse)
        if (cob_id := self._heard_by.pop(sub, None)) is not None:
            self.line.remove_subscription(cob_id)
        producer, milliseconds = word >> 16 & 0x7F, word & 0xFFFF
        if producer and milliseconds:
            self._heard_by[sub] = 0x700 + producer
            self.line.add_subscription(
                0x700 + producer, lambda _cob_id, _data: self._beat(sub, milliseconds)
            )

    def _beat(self, sub: int, milliseconds: int) -> None:
        if (lapse := self._lapses.get(sub)) is not None:
            self.timers.cancel(lapse)
        self._lapses[sub] = self.timers.add(milliseconds * 1e-3, self._lose)

    def _lose(self) -> None:
        self.emergency(HEARTBEAT_ERROR, COMMUNICATION_ERROR)
        self.on_heartbeat_lost()
        if self.nmt is StateEnum.OPERATIONAL and self.od.read(0x1029, 1) != 1:
            stops = self.od.read(0x1029, 1) == 2
            self.stack.nmt.set_state(StateEnum.STOPPED if stops else StateEnum.PRE_OPERATIONAL)

    def _produce_sync(self, _value: int = 0) -> None:
        """Bit 30 of 0x1005: this node produces the SYNC, every 0x1006 microseconds."""
        if self._next_sync is not None:
            self.timers.cancel(self._next_sync)
        period_us = self.od.read(0x1006, 0)
        if self.od.read(0x1005, 0) >> 30 & 1 and period_us:
            self._next_sync = self.timers.add(period_us * 1e-6, self._send_sync)

    def _send_sync(self) -> None:
        self.line.send(self.sync_cob_id, b"")
        self._produce_sync()
