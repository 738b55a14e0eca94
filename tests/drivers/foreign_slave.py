"""CANopen slaves written from CiA 301 alone, in every legal shape that the tests ask for.

They share no code with the simulated rig: an object dictionary of bytes, an SDO server, NMT, heartbeat and PDOs on bare
frames, in virtual time. `Traits` says in what one differs from the others.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.clock import VirtualClock
from drivers.python_can import can

MS = 1_000_000
READ_ONLY, NOT_MAPPABLE, NOT_NOW, BAD_VALUE = 0x06010002, 0x06040041, 0x08000022, 0x06090030
NO_OBJECT, NO_SUB, TOO_LONG, TOO_SHORT, BAD_COMMAND = (
    0x06020000,
    0x06090011,
    0x06070012,
    0x06070013,
    0x05040001,
)
NOT_READY, DISABLED, READY, ON, ENABLED, QUICK, REACTION, FAULT = range(8)
Words = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Traits:
    """In what a slave differs: where it starts, what it lacks, how it answers; of a drive, how slowly it moves."""

    nmt: int = 0x7F
    absent: frozenset[int] = frozenset()
    values: dict[tuple[int, int], int] = field(default_factory=dict)
    refused: dict[tuple[int, int], int] = field(default_factory=dict)
    """Entries whose writes are aborted, with the code."""
    unreadable: frozenset[tuple[int, int]] = frozenset()
    mapping: str = "free"
    tpdo_cobs: tuple[int, ...] = ()
    tpdo_maps: Words = ((), (), (), ())
    rpdo_maps: Words = ((), (), (), ())
    tpdo_type: int = 255
    is_type_locked: bool = False
    """A transmission type changes only while the PDO does not exist."""
    most_objects: int = 4
    """Objects that one PDO takes, whatever their length."""
    unsized: bool = False
    segmented: bool = False
    wrong_toggle: bool = False
    answer_ms: float = 0.0
    state: int = DISABLED
    transition_ms: int = 0
    mode_ms: int = 0
    reset_ms: int = 0
    refuses_reset: bool = False
    drops_to: dict[int, int] = field(default_factory=dict)
    """States that it leaves again by itself at once, and where to."""
    set_bits: int = 0x0210
    quick_stop_ramp: int = 50
    trembles: int = 0
    """Counts by which the speed is read wrong at standstill, up and down."""


class Wire:
    """A bus in virtual time: what the computer sends reaches every node at once, what nodes send
    waits to be received.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.nodes: list[Slave | Stranger] = []
        self.waiting = deque[can.Message]()

    def send(self, msg: can.Message) -> None:
        for node in self.nodes:
            node.receive(msg.arbitration_id, bytes(msg.data))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self.waiting.popleft() if self.waiting else None

    def shutdown(self) -> None:
        return

    def feed(self, cob_id: int, data: bytes, **kind: bool) -> None:
        kind.setdefault("is_extended_id", False)
        self.waiting.append(
            can.Message(
                arbitration_id=cob_id,
                data=data,
                timestamp=1.0 + self.clock.monotonic_ns() * 1e-9,
                **kind,
            )
        )

    def pump(self, deadline_ns: int) -> None:
        for node in self.nodes:
            node.tick(self.clock.monotonic_ns())


class Stranger:
    """Something else on the bus that hears every frame."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        wire.nodes.insert(0, self)

    def receive(self, cob_id: int, data: bytes) -> None:
        return

    def tick(self, now: int) -> None:
        return


Rows = dict[tuple[int, int], tuple[int, int]]
"""Factory values: (index, sub-index) -> (value, bytes)."""


class Slave:
    """A node on the wire; `rows` are what it adds to the communication profile, `fixed` the objects
    nobody may write.
    """

    fixed: frozenset[int] = frozenset()

    def __init__(self, wire: Wire, traits: Traits | None, node_id: int, rows: Rows) -> None:
        self.wire, self.traits, self.node_id, self._rows = wire, traits or Traits(), node_id, rows
        wire.nodes.append(self)
        self.segments: tuple[bytes, int] = (b"", 0)
        self.download: tuple[tuple[int, int], bytes, int] | None = None
        self.power_up()
        self.nmt = self.traits.nmt

    def power_up(self) -> None:
        """What a reset does: everything as it came from the factory."""
        self.nmt = 0x7F
        self.rpdo_data: dict[int, bytes] = {}
        self.pending: deque[tuple[int, Callable[[], None]]] = deque()
        self.heard_ns: int | None = None
        self.od = self._factory()
        self.heartbeat_due_ns = self.wire.clock.monotonic_ns()

    # What a device adds

    def live(self) -> Rows:
        """Values that are made when they are read."""
        return {}

    def on_store(self, key: tuple[int, int], data: bytes) -> None:
        """An entry has been written."""

    def on_sync(self) -> None:
        """What happens at a SYNC before it is answered."""

    def accepts(self, key: tuple[int, int], data: bytes) -> bool:
        """Whether a value is allowed for an entry."""
        return True

    # Frames

    def value(self, index: int, sub: int = 0, signed: bool = False) -> int:
        return (
            int.from_bytes(self.od[index, sub], "little", signed=signed)
            if (index, sub) in self.od
            else 0
        )

    def receive(self, cob_id: int, data: bytes) -> None:
        now = self.wire.clock.monotonic_ns()
        if cob_id == 0 and data[1:2] in (b"\0", bytes([self.node_id])):
            self.network(data[0])
        elif cob_id == 0x600 + self.node_id and self.nmt != 4:
            self.pending.append((now + round(self.traits.answer_ms * MS), lambda: self.serve(data)))
        elif cob_id == 0x080 and self.nmt == 5:
            self.synchronise()
        elif cob_id == 0x77F:
            self.heard_ns = now
        elif self.nmt == 5:
            for n in range(4):
                cob, kind = self.value(0x1400 + n, 1), self.value(0x1400 + n, 2)
                if (0x1400 + n, 1) not in self.od or cob >> 31 or cob & 0x7FF != cob_id:
                    continue
                if kind <= 240:
                    self.rpdo_data[n] = data
                else:
                    self.take(n, data)

    def network(self, command: int) -> None:
        if command in (0x81, 0x82):
            self.reboot()
        else:
            self.nmt = {1: 5, 2: 4, 0x80: 0x7F}.get(command, self.nmt)

    def reboot(self) -> None:
        """Reset, or a dip of the supply: boot-up message, defaults."""
        self.power_up()
        self.wire.feed(0x700 + self.node_id, b"\0")

    def emergency(self, code: int) -> None:
        self.wire.feed(0x080 + self.node_id, struct.pack("<HB5x", code, 0x21 if code else 0))

    def take(self, n: int, data: bytes) -> None:
        at = 0
        for sub in range(1, self.value(0x1600 + n) + 1):
            word = self.value(0x1600 + n, sub)
            size = (word & 0xFF) // 8
            if word >> 16 >= 0x1000:
                self.store((word >> 16, word >> 8 & 0xFF), data[at : at + size])
            at += size

    def synchronise(self) -> None:
        for n in list(self.rpdo_data):
            self.take(n, self.rpdo_data.pop(n))
        self.on_sync()
        for n in range(4):
            cob = self.value(0x1800 + n, 1)
            if cob >> 31 or self.value(0x1800 + n, 2) != 1:
                continue
            words = [self.value(0x1A00 + n, sub) for sub in range(1, self.value(0x1A00 + n) + 1)]
            data = b"".join(self.read((w >> 16, w >> 8 & 0xFF))[: (w & 0xFF) // 8] for w in words)
            self.wire.feed(cob & 0x7FF, data)

    def tick(self, now: int) -> None:
        while self.pending and self.pending[0][0] <= now:
            self.pending.popleft()[1]()
        period = self.value(0x1017) * MS
        if period and now >= self.heartbeat_due_ns:
            self.heartbeat_due_ns = now + period
            self.wire.feed(0x700 + self.node_id, bytes([self.nmt]))

    # SDO

    def answer(self, head: int, key: tuple[int, int], data: bytes = b"") -> None:
        self.wire.feed(
            0x580 + self.node_id, bytes([head]) + struct.pack("<HB", *key) + data.ljust(4, b"\0")
        )

    def serve(self, request: bytes) -> None:
        command, key = request[0] >> 5, (int.from_bytes(request[1:3], "little"), request[3])
        if command == 2:
            self.upload(key)
        elif command == 3:
            self.next_segment(request[0] >> 4 & 1)
        elif command == 1 and request[0] & 2:
            size = 4 - (request[0] >> 2 & 3) if request[0] & 1 else len(self.od.get(key, b""))
            self.acknowledge(key, self.write(key, request[4 : 4 + size]))
        elif command == 1:
            self.download = (key, b"", 0)
            self.answer(0x60, key)
        elif command == 0 and self.download:
            key, data, toggle = self.download
            data += request[1 : 8 - (request[0] >> 1 & 7)]
            self.download = (key, data, toggle ^ 1)
            if request[0] & 1 and (code := self.write(key, data)):
                self.acknowledge(key, code)
            else:
                self.wire.feed(0x580 + self.node_id, bytes([0x20 | toggle << 4]) + bytes(7))
        elif command != 4:
            self.acknowledge(key, BAD_COMMAND)

    def acknowledge(self, key: tuple[int, int], code: int) -> None:
        self.answer(0x80 if code else 0x60, key, code.to_bytes(4, "little") if code else b"")

    def missing(self, key: tuple[int, int]) -> int:
        if key in self.od:
            return 0
        return NO_SUB if any(index == key[0] for index, _ in self.od) else NO_OBJECT

    def upload(self, key: tuple[int, int]) -> None:
        code = self.missing(key) or (0x06010001 if key in self.traits.unreadable else 0)
        if code:
            self.acknowledge(key, code)
            return
        data = self.read(key)
        if 0 < len(data) <= 4 and not self.traits.segmented:
            # What follows a value whose size is not told means nothing.
            filled = data.ljust(4, b"\xa5") if self.traits.unsized else data
            self.answer(0x42 if self.traits.unsized else 0x43 | (4 - len(data)) << 2, key, filled)
            return
        self.segments = (data, 0)
        self.answer(
            0x40 if self.traits.unsized else 0x41,
            key,
            b"" if self.traits.unsized else struct.pack("<I", len(data)),
        )

    def next_segment(self, toggle: int) -> None:
        data, at = self.segments
        piece, told = data[at : at + 7], toggle ^ self.traits.wrong_toggle
        self.segments = (data, at + 7)
        head = bytes([told << 4 | (7 - len(piece)) << 1 | (at + 7 >= len(data))])
        self.wire.feed(0x580 + self.node_id, head + piece.ljust(7, b"\0"))

    def read(self, key: tuple[int, int]) -> bytes:
        live = self.live()
        if key in live and key in self.od:
            value, size = live[key]
            return (int(value) & (1 << 8 * size) - 1).to_bytes(size, "little")
        return self.od.get(key, b"")

    def write(self, key: tuple[int, int], data: bytes) -> int:
        """The abort code of a download, 0 when it is taken."""
        if code := self.missing(key) or self.traits.refused.get(key, 0):
            return code
        if key[0] in self.fixed or key[0] in (0x1000, 0x1001, 0x1008, 0x1018):
            return READ_ONLY
        if len(data) != len(self.od[key]):
            return TOO_LONG if len(data) > len(self.od[key]) else TOO_SHORT
        if 0x1400 <= key[0] < 0x1C00 and (
            code := self.refuses_pdo(key, int.from_bytes(data, "little"))
        ):
            return code
        if not self.accepts(key, data):
            return BAD_VALUE
        self.store(key, data)
        return 0

    def refuses_pdo(self, key: tuple[int, int], value: int) -> int:
        index, sub = key
        is_mapping = index & 0x200
        if is_mapping and self.traits.mapping != "free":
            entries = {
                "read-only": READ_ONLY,
                "present state": NOT_NOW,
                "not mappable": NOT_MAPPABLE,
            }[self.traits.mapping]
            return 0 if self.traits.mapping == "not mappable" and sub == 0 else entries
        exists = not self.value(index & ~0x200, 1) >> 31
        if not is_mapping:
            if sub == 1 and exists and not value >> 31 and (value ^ self.value(index, 1)) & 0x7FF:
                return BAD_VALUE
            # CiA 301: an inhibit time does not change while the PDO exists.
            is_locked = sub == 3 or (sub == 2 and self.traits.is_type_locked)
            return NOT_NOW if exists and is_locked else 0
        if exists or (sub and self.value(index)):
            return NOT_NOW
        if (sub or value) > self.traits.most_objects:
            return NO_SUB if sub else 0x06040042
        words = [value] if sub else [self.value(index, i) for i in range(1, value + 1)]
        for word in words:
            mapped = (word >> 16, word >> 8 & 0xFF)
            if (code := self.missing(mapped)) or word & 0xFF != 8 * len(self.od[mapped]):
                return code or NOT_MAPPABLE
        return 0x06040042 if not sub and sum(w & 0xFF for w in words) > 64 else 0

    def store(self, key: tuple[int, int], data: bytes) -> None:
        self.od[key] = data
        if key == (0x1017, 0):
            self.heartbeat_due_ns = self.wire.clock.monotonic_ns()
        elif key[0] == 0x1016:
            self.heard_ns = None
        self.on_store(key, data)

    def _factory(self) -> dict[tuple[int, int], bytes]:
        """The entries and their factory values as bytes."""
        traits, node_id = self.traits, self.node_id
        rows: Rows = {
            (0x1001, 0): (0, 1), (0x1005, 0): (0x80, 4), (0x1014, 0): (0x80 + node_id, 4), (0x1016, 0): (1, 1),
            (0x1016, 1): (0, 4), (0x1017, 0): (0, 2), (0x1018, 0): (4, 1), (0x1018, 1): (0x123, 4), (0x1018, 2): (7, 4),
            (0x1018, 3): (1, 4), (0x1018, 4): (42, 4),
        }  # fmt: skip
        cobs = traits.tpdo_cobs or tuple(0x40000180 + 0x100 * n + node_id for n in range(4))
        for n in range(4):
            rows |= {
                (0x1400 + n, 0): (2, 1),
                (0x1400 + n, 1): (0x200 + 0x100 * n + node_id, 4),
                (0x1400 + n, 2): (255, 1),
            }
            rows |= {
                (0x1800 + n, 0): (5, 1),
                (0x1800 + n, 1): (cobs[n], 4),
                (0x1800 + n, 2): (traits.tpdo_type, 1),
            }
            rows |= {(0x1800 + n, 3): (0, 2), (0x1800 + n, 5): (0, 2)}
            for index, words in (
                (0x1600 + n, traits.rpdo_maps[n]),
                (0x1A00 + n, traits.tpdo_maps[n]),
            ):
                rows |= {(index, 0): (len(words), 1)}
                rows |= {
                    (index, sub): (words[sub - 1] if sub <= len(words) else 0, 4)
                    for sub in range(1, 5)
                }
        rows |= self._rows
        rows |= {
            key: (value, rows[key][1] if key in rows else 4) for key, value in traits.values.items()
        }
        found = {
            key: value.to_bytes(size, "little")
            for key, (value, size) in rows.items()
            if key[0] not in traits.absent
        }
        if 0x1008 not in traits.absent:
            found[0x1008, 0] = b"Foreign device with a name that needs segments"
        return found
