"""Process data of a simulated slave: mappings changed at run time, transmission types, timers (CiA 301, 7.5.2.35-38).

A mapping changes only while the PDO does not exist (bit 31 of its COB-ID) and its number of objects
is 0; a COB-ID changes only while it is invalid. There are no remote frames: bit 30 of a TPDO's
COB-ID stays set, types 252 and 253 are refused.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from sim_backend.wire.dictionary import (
    BOOLEAN,
    F32,
    I8,
    I16,
    I32,
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    DataType,
    Entry,
    Number,
    ObjectDictionary,
    entry,
)

INVALID = 0x8000_0000
"""Bit 31 of a PDO's COB-ID: the PDO does not exist."""
NO_RTR = 0x4000_0000
"""Bit 30 of a TPDO's COB-ID: it cannot be asked for by a remote frame."""
_EXTENDED = 0x2000_0000
_MAPPING_SLOTS = 8
LAST_SYNCHRONOUS = 240
_EVENT_DRIVEN = 254

Send = Callable[[int, bytes], None]
Mapping = tuple[tuple[int, int, int], ...]
"""(index, sub, bits) of each mapped object in the order of the frame."""

_DUMMIES: dict[int, DataType] = {
    kind.code: kind for kind in (BOOLEAN, I8, I16, I32, U8, U16, U32, F32)
}
"""Data types whose index in the dictionary (0x0001...) may fill a gap of an RPDO."""


def _is_restricted(cob_id: int) -> bool:
    """Whether an 11-bit COB-ID may not be used by a PDO (CiA 301, table of restricted CAN-IDs; 0x080 is the SYNC)."""
    return (
        cob_id <= 0x80
        or 0x101 <= cob_id <= 0x180
        or 0x581 <= cob_id <= 0x5FF
        or 0x601 <= cob_id <= 0x67F
        or 0x6E0 <= cob_id <= 0x6FF
        or cob_id >= 0x701
    )


def communication_entries(
    number: int, *, transmit: bool, cob_id: int, transmission: int, mapping: tuple[int, ...]
) -> list[Entry]:
    """Communication and mapping records of PDO `number` (1...): `mapping` as 32-bit words index <<
    16 | sub << 8 | bits.
    """
    base, kind = (0x1800, "TPDO") if transmit else (0x1400, "RPDO")
    index, mapped = base + number - 1, base + 0x200 + number - 1
    name = f"{kind} {number} communication"
    words = [*mapping, *[0] * (_MAPPING_SLOTS - len(mapping))]
    objects = f"{kind} {number} mapping"
    entries = [
        entry(index, 0, f"{name}: highest sub-index", U8, "const", 5 if transmit else 2),
        entry(index, 1, f"{name}: COB-ID", U32, "rw", cob_id),
        entry(index, 2, f"{name}: transmission type", U8, "rw", transmission),
        entry(index, 3, f"{name}: inhibit time", U16, "rw", 0),
        entry(index, 5, f"{name}: event timer", U16, "rw", 0),
        entry(mapped, 0, f"{objects}: number of objects", U8, "rw", len(mapping), high=_MAPPING_SLOTS),
        *(entry(mapped, i, f"{objects}: object {i}", U32, "rw", word) for i, word in enumerate(words, start=1)),
    ]  # fmt: skip
    # An RPDO has neither inhibit time nor event timer.
    return [one for one in entries if transmit or one.index == mapped or one.sub < 3]


@dataclass(kw_only=True)
class Pdo:
    """One PDO of a slave; reads its own records in the object dictionary and watches over their changes."""

    dictionary: ObjectDictionary
    index: int
    transmit: bool
    syncs: int = 0
    is_due: bool = False
    next_event_ns: int | None = None
    free_from_ns: int = 0
    received: bytes | None = None
    cob_id: int = 0
    transmission: int = 0
    mapping: Mapping = field(default=())

    def __post_init__(self) -> None:
        self.mapped_index = self.index + 0x200
        on_write = self.dictionary.on_write
        on_write(self.index, 1, self._write_cob_id)
        on_write(self.index, 2, self._write_transmission)
        if self.transmit:
            on_write(self.index, 3, self._write_inhibit_time)
            on_write(self.index, 5, self._write_event_timer)
        on_write(self.mapped_index, 0, self._write_count)
        for slot in range(1, _MAPPING_SLOTS + 1):
            on_write(self.mapped_index, slot, self._write_slot)
        self.reload()

    @property
    def exists(self) -> bool:
        """Whether bit 31 of the COB-ID is clear."""
        return not self.cob_id & INVALID

    @property
    def is_event_driven(self) -> bool:
        """Transmission types 254 and 255."""
        return self.transmission >= _EVENT_DRIVEN

    @property
    def takes_events(self) -> bool:
        """Whether a change of a value makes it due: types 0, 254 and 255."""
        return (
            self.transmission == 0 or self.transmission >= _EVENT_DRIVEN
        ) and not self.cob_id & INVALID

    @property
    def length(self) -> int:
        """Bytes of the frame."""
        return self._frame.size

    def carries(self, index: int, sub: int) -> bool:
        """Whether an object is mapped here."""
        return (index, sub) in self._keys

    def reload(self) -> None:
        """Take everything from the dictionary (start, reset)."""
        number = self.dictionary.number
        self.cob_id, self.transmission = number(self.index, 1), number(self.index, 2)
        self.event_ns = number(self.index, 5) * 1_000_000 if self.transmit else 0
        self.inhibit_ns = number(self.index, 3) * 100_000 if self.transmit else 0
        self._adopt(self._words(number(self.mapped_index, 0)))
        self.rest()

    def rest(self) -> None:
        """Forget counters, timers and what was received: the NMT state has changed."""
        self.syncs, self.is_due, self.next_event_ns, self.free_from_ns, self.received = (
            0,
            False,
            None,
            0,
            None,
        )

    def pack(self) -> bytes:
        """The frame with the present values."""
        return self._frame.pack(*self.dictionary.values(self._keys))

    def unpack(self, data: bytes) -> None:
        """Write a received frame into the mapped objects; what follows the mapped bytes is ignored."""
        for mapped, value in zip(self._entries, self._frame.unpack_from(data), strict=True):
            self.dictionary.write(mapped, value)

    def _words(self, count: int) -> list[int]:
        """The first words of the mapping as the dictionary has them."""
        return [self.dictionary.number(self.mapped_index, slot) for slot in range(1, count + 1)]

    def _adopt(self, words: list[int]) -> None:
        mapping = tuple((w >> 16, (w >> 8) & 0xFF, w & 0xFF) for w in words)
        self.mapping: Mapping = mapping
        objects = [(index, sub) for index, sub, _ in mapping if index >= 0x20]
        self._keys = objects
        self._entries = [self.dictionary.entry(index, sub) for index, sub in objects]
        form = "<"
        for index, sub, bits in mapping:
            is_object = index >= 0x20
            form += (
                self.dictionary.entry(index, sub).type.form[1:] if is_object else f"{bits // 8}x"
            )
        self._frame = struct.Struct(form)

    def _write_cob_id(self, value: Number) -> None:
        wanted = int(value)
        if wanted & _EXTENDED or (self.transmit and not wanted & NO_RTR):
            raise AbortError(Abort.VALUE)
        if self.exists and not wanted & INVALID and (wanted ^ self.cob_id) & 0x7FF:
            raise AbortError(Abort.VALUE)
        if not wanted & INVALID and _is_restricted(wanted & 0x7FF):
            raise AbortError(Abort.VALUE)
        self.cob_id = wanted
        self.rest()

    def _write_transmission(self, value: Number) -> None:
        if LAST_SYNCHRONOUS < int(value) < _EVENT_DRIVEN:
            raise AbortError(Abort.VALUE)
        self.transmission = int(value)
        self.rest()

    def _write_inhibit_time(self, value: Number) -> None:
        if self.exists:
            raise AbortError(Abort.DEVICE_STATE)
        self.inhibit_ns = int(value) * 100_000

    def _write_event_timer(self, value: Number) -> None:
        self.event_ns, self.next_event_ns = int(value) * 1_000_000, None

    def _write_count(self, value: Number) -> None:
        if self.exists:
            raise AbortError(Abort.DEVICE_STATE)
        words = self._words(int(value))
        for word in words:
            self._check_object(word)
        if sum(word & 0xFF for word in words) > 64:
            raise AbortError(Abort.PDO_LENGTH)
        self._adopt(words)

    def _write_slot(self, value: Number) -> None:
        if self.exists or self.dictionary.number(self.mapped_index, 0):
            raise AbortError(Abort.DEVICE_STATE)
        if int(value):
            self._check_object(int(value))

    def _check_object(self, word: int) -> None:
        """Aborts unless the object exists, may travel in this direction, and has the length that the word says."""
        index, sub, bits = word >> 16, (word >> 8) & 0xFF, word & 0xFF
        if not self.transmit and index in _DUMMIES and sub == 0:
            if _DUMMIES[index].length * 8 != bits:
                raise AbortError(Abort.NOT_MAPPABLE)
            return
        entry = self.dictionary.entry(index, sub)
        if ("t" if self.transmit else "r") not in entry.mappable or entry.type.length * 8 != bits:
            raise AbortError(Abort.NOT_MAPPABLE)


def due_on_sync(pdo: Pdo) -> bool:
    """Whether a TPDO is sent with this SYNC: type 0 after an event, types 1 to 240 with every n-th."""
    kind = pdo.transmission
    if kind == 1:
        return True
    if kind == 0:
        due, pdo.is_due = pdo.is_due, False
        return due
    if kind <= LAST_SYNCHRONOUS:
        pdo.syncs += 1
        if pdo.syncs >= kind:
            pdo.syncs = 0
            return True
    return False
