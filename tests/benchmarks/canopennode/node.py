"""A node on CANopenNode, stepped from outside in virtual time, with the face of `tests.drivers.durand_node`.

All of CiA 301 is the stack's: NMT, heartbeats both ways with what a lost one does to the NMT state, EMCY with its
register, SDO server, SYNC and its supervision, PDOs and their mapping. Here are the dictionary and the clock.
"""

from __future__ import annotations

import ctypes
import functools
import weakref
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from durand.datatypes import DatatypeEnum
from durand.object_dictionary import Record, Variable
from durand.services.nmt import StateEnum

from tests.benchmarks.canopennode import library
from tests.drivers.durand_node import NEVER, U8, U16, U32, Timers

Key = tuple[int, int]
READ, WRITE, IN_TPDO, IN_RPDO, MULTI_BYTE, TEXT = 0x01, 0x02, 0x04, 0x08, 0x40, 0x80
"""What CANopenNode calls an object's attributes."""
INVALID_VALUE = 15
"""ODR_INVALID_VALUE: abort 0x06090030."""
LONGEST_US = 50_000
"""Time after which the stack is looked at though it has nothing to do."""
CONSUMERS, PDOS, MAPPED, HISTORY = 4, 4, 8, 8
STATES = {
    0: StateEnum.INITIALISATION,
    127: StateEnum.PRE_OPERATIONAL,
    5: StateEnum.OPERATIONAL,
    4: StateEnum.STOPPED,
}
COMMANDS = {StateEnum.OPERATIONAL: 1, StateEnum.STOPPED: 2, StateEnum.PRE_OPERATIONAL: 128}
EMCY_BITS = 16


@functools.cache
def stack() -> ctypes.CDLL:
    """The library, loaded once."""
    return library.load()


class Hooks:
    """What is called when an object is written."""

    def __init__(self) -> None:
        self.calls: list[Callable[[int], object]] = []

    def add(self, call: Callable[[int], object]) -> None:
        self.calls.append(call)


class Dictionary:
    """The node's objects: described in Python until it starts, then in the stack's memory."""

    def __init__(self) -> None:
        self._objects: dict[int, Variable | Record] = {}
        self._memory: dict[Key, tuple[Variable, Any]] = {}
        self.validate_callbacks: dict[Key, Hooks] = defaultdict(Hooks)
        self.update_callbacks: dict[Key, Hooks] = defaultdict(Hooks)
        self.download_callbacks: dict[Key, Hooks] = defaultdict(Hooks)

    def __getitem__(self, index: int) -> Any:
        return self._objects[index]

    def __setitem__(self, index: int, entry: Variable | Record) -> None:
        self._objects[index] = entry

    def variables(self) -> list[tuple[Key, Variable]]:
        """Every sub-index in ascending order."""
        found: list[tuple[Key, Variable]] = []
        for index in sorted(self._objects):
            entry = self._objects[index]
            parts = [(0, entry)] if isinstance(entry, Variable) else list(entry)
            found += [((index, sub), variable) for sub, variable in parts]
        return found

    def is_record(self, index: int) -> bool:
        return isinstance(self._objects[index], Record)

    def is_hooked(self, index: int) -> bool:
        hooked = (*self.validate_callbacks, *self.update_callbacks, *self.download_callbacks)
        return index in {key[0] for key in hooked}

    def lies_at(self, key: Key, variable: Variable, address: int) -> None:
        """From now on its value is in the stack's memory."""
        size = variable.size or 0
        self._memory[key] = (variable, (ctypes.c_uint8 * size).from_address(address))

    def read(self, index: int, sub: int) -> int:
        if (index, sub) not in self._memory:
            entry = self._objects[index]
            variable = entry if isinstance(entry, Variable) else entry[sub]
            return int(variable.value or 0)
        variable, memory = self._memory[index, sub]
        return int(variable.unpack(bytes(memory)))

    def write(self, index: int, sub: int, value: int, *, downloaded: bool = False) -> None:
        key = (index, sub)
        if key not in self._memory:
            entry = self._objects[index]
            (entry if isinstance(entry, Variable) else entry[sub]).value = value
        else:
            variable, memory = self._memory[key]
            memory[:] = variable.pack(value)
        self._call(self.update_callbacks, key, value)
        if downloaded:
            self._call(self.download_callbacks, key, value)

    @staticmethod
    def _call(hooks: dict[Key, Hooks], key: Key, value: int) -> None:
        if key in hooks:
            for call in hooks[key].calls:
                call(value)

    def accepts(self, key: Key, data: bytes) -> bool:
        """Whether this may be downloaded."""
        variable, _ = self._memory[key]
        try:
            self._call(self.validate_callbacks, key, int(variable.unpack(data)))
        except ValueError:
            return False
        return True

    def downloaded(self, key: Key, data: bytes) -> None:
        """This was downloaded."""
        variable, _ = self._memory[key]
        value = int(variable.unpack(data))
        self._call(self.update_callbacks, key, value)
        self._call(self.download_callbacks, key, value)


class CanopennodeNode:
    """One node: `receive` a frame, `synchronise` at a SYNC, `tick` when time has passed. `build` adds the objects."""

    def __init__(self, node_id: int, send: Callable[[int, bytes], None]) -> None:
        self.node_id = node_id
        self.timers = Timers()
        self.od = Dictionary()
        self._send, self._stack = send, stack()
        self._stepped_ns = 0
        self._due_ns = NEVER
        self._errors: dict[int, int] = {}
        self._is_on = False
        self._standard_objects()
        self.build()
        self._hand_over()

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
        return STATES[self._stack.node_state(self._node)]

    def put_nmt(self, state: StateEnum) -> None:
        """As another master may have left it."""
        self._stack.node_set_state(self._node, COMMANDS[state])
        self._step()

    def boot(self, now_ns: int) -> None:
        """The power comes on, or back: everything at its default."""
        self.timers.now_ns = self._stepped_ns = now_ns
        wrong = self._stack.node_start(self._node)
        if wrong:
            raise RuntimeError(f"CANopenNode refuses the dictionary: 0x{wrong:08X}")
        self._is_on = True
        self._errors.clear()
        self._step()

    restart = boot

    def receive(self, cob_id: int, data: bytes, now_ns: int) -> None:
        if self._is_on and len(data) <= 8:
            self.timers.now_ns = now_ns
            self._step()
            self._stack.node_receive(self._node, cob_id, data, len(data))
            self._step()

    def synchronise(self) -> None:
        self._stack.node_receive(self._node, self.sync_cob_id, b"", 0)
        self._step()

    def tick(self, now_ns: int) -> None:
        self.timers.run(now_ns)
        self._step()

    def next_due_ns(self) -> int:
        return min(self.timers.next_due_ns, self._due_ns)

    def emergency(self, code: int, register: int, vendor: bytes = b"") -> None:
        """An error of the device's own; code 0 takes all of them back. The register is the stack's."""
        if code:
            bit = self._errors.setdefault(code, len(self._errors) % EMCY_BITS)
            info = int.from_bytes(vendor[1:5], "little")
            self._stack.node_error(self._node, bit, code, info, 1)
        else:
            for bit in self._errors.values():
                self._stack.node_error(self._node, bit, 0, 0, 0)
            self._errors.clear()
        self._due_ns = min(self._due_ns, self.timers.now_ns)

    def _step(self) -> None:
        """The stack does what there is to do now."""
        if not self._is_on:
            return
        elapsed_us = (self.timers.now_ns - self._stepped_ns) // 1000
        self._stepped_ns += elapsed_us * 1000
        waits_us = self._stack.node_process(self._node, elapsed_us, LONGEST_US)
        self._due_ns = self._stepped_ns + max(waits_us, 1) * 1000

    # The stack's side -------------------------------------------------------------------------------------------------

    def _hand_over(self) -> None:
        self._callbacks = (
            library.Send(self._on_send),
            library.Write(self._on_write),
            library.State(self._on_state),
            library.Lost(lambda _node: self.on_heartbeat_lost()),
        )
        self._node = self._stack.node_new(self.node_id, *self._callbacks)
        self.finalize = weakref.finalize(self, self._stack.node_delete, self._node)
        for key, variable in self.od.variables():
            value = variable.pack(0 if variable.value is None else variable.value)
            is_record, is_hooked = self.od.is_record(key[0]), self.od.is_hooked(key[0])
            there = self._stack.node_object(
                self._node, *key, is_record, attributes(key, variable), value, len(value), is_hooked
            )
            if not there:
                raise RuntimeError("more objects than node.c has room for")
            if variable.size is not None:
                self.od.lies_at(key, variable, self._stack.node_memory(self._node, *key))

    def _on_send(self, cob_id: int, data: Any, length: int) -> None:
        self._send(cob_id, bytes(data[:length]))

    def _on_write(self, index: int, sub: int, data: Any, length: int, is_done: int) -> int:
        key, value = (index, sub), bytes(data[:length])
        if is_done:
            self.od.downloaded(key, value)
            return 0
        return 0 if self.od.accepts(key, value) else INVALID_VALUE

    def _on_state(self, state: int) -> None:
        self.on_nmt(STATES[state])

    def _standard_objects(self) -> None:
        od = self.od
        for index, kind, access, value in (
            (0x1000, U32, "ro", 0), (0x1001, U8, "ro", 0), (0x1005, U32, "rw", 0x80), (0x1006, U32, "rw", 0),
            (0x1007, U32, "rw", 0), (0x1014, U32, "rw", 0x80), (0x1015, U16, "rw", 0), (0x1017, U16, "rw", 0),
            (0x1019, U8, "rw", 0),
        ):  # fmt: skip
            od[index] = Variable(kind, access, value)
        for index in (0x1008, 0x100A):
            od[index] = Variable(DatatypeEnum.VISIBLE_STRING, "const", b"")
        od[0x1003] = _record([(U32, "ro", 0)] * HISTORY, is_counted=True)
        od[0x1016] = _record([(U32, "rw", 0)] * CONSUMERS)
        od[0x1018] = _record([(U32, "const", 0)] * 4)
        od[0x1200] = _record([(U32, "ro", 0x600 + self.node_id), (U32, "ro", 0x580 + self.node_id)])
        for number in range(PDOS):
            receives, sends = 0x8000_0200 + 0x100 * number, 0xC000_0180 + 0x100 * number
            od[0x1400 + number] = _record([(U32, "rw", receives), (U8, "rw", 255)])
            od[0x1800 + number] = _record(
                [(U32, "rw", sends), (U8, "rw", 255), (U16, "rw", 0)], {5: (U16, "rw", 0), 6: (U8, "rw", 0)}
            )  # fmt: skip
            od[0x1600 + number] = _record([(U32, "rw", 0)] * MAPPED, is_counted=True)
            od[0x1A00 + number] = _record([(U32, "rw", 0)] * MAPPED, is_counted=True)


class CountedRecord(Record):
    """A record whose sub-index 0 is written: mapped objects, errors kept."""

    def __init__(self) -> None:
        super().__init__()
        self.count = Variable(U8, "rw", 0)

    def __getitem__(self, subindex: int) -> Variable:
        return self.count if subindex == 0 else super().__getitem__(subindex)


def _record(
    parts: list[tuple[Any, str, int]],
    more: dict[int, tuple[Any, str, int]] | None = None,
    *,
    is_counted: bool = False,
) -> Record:
    record = CountedRecord() if is_counted else Record()
    for sub, (kind, access, value) in {**dict(enumerate(parts, 1)), **(more or {})}.items():
        record[sub] = Variable(kind, access, value)
    return record


def attributes(key: Key, variable: Variable) -> int:
    """What may be done with an object, in the stack's words: what is read or written may be mapped."""
    found = (READ if variable.readable else 0) | (WRITE if variable.writable else 0)
    if variable.size is None:
        return found | TEXT
    if key[0] >= 0x6000:
        found |= (IN_TPDO if variable.readable else 0) | (IN_RPDO if variable.writable else 0)
    return found | (MULTI_BYTE if variable.size > 1 else 0)
