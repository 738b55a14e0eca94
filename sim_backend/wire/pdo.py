"""Process data of a simulated slave: mappings changed at run time, transmission types, event timers (CiA 301, 7.5.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from sim_backend.wire.dictionary import U8, U16, U32, Abort, AbortError, Entry, Number, ObjectDictionary, decode, encode

INVALID = 0x8000_0000
"""Bit 31 of a PDO's COB-ID: the PDO does not exist."""
NO_RTR = 0x4000_0000
MAPPING_SLOTS = 8

Send = Callable[[int, bytes], None]
Mapping = tuple[tuple[int, int, int], ...]
"""(index, sub, bits) of each mapped object in the order of the frame."""


def communication_entries(
    number: int, *, transmit: bool, cob_id: int, transmission: int, mapping: tuple[int, ...]
) -> list[Entry]:
    """Communication and mapping records of PDO `number` (1...): `mapping` as 32-bit words index << 16 | sub << 8 | bits."""
    base, kind = (0x1800, "TPDO") if transmit else (0x1400, "RPDO")
    index, mapped = base + number - 1, base + 0x200 + number - 1
    name = f"{kind} {number} communication"
    found = [
        Entry(index, 0, f"{name}: highest sub-index", U8, "const", 5),
        Entry(index, 1, f"{name}: COB-ID", U32, "rw", cob_id),
        Entry(index, 2, f"{name}: transmission type", U8, "rw", transmission),
        Entry(index, 3, f"{name}: inhibit time", U16, "rw", 0),
        Entry(index, 5, f"{name}: event timer", U16, "rw", 0),
        Entry(mapped, 0, f"{kind} {number} mapping: number of objects", U8, "rw", len(mapping), high=MAPPING_SLOTS),
    ]
    for slot in range(MAPPING_SLOTS):
        word = mapping[slot] if slot < len(mapping) else 0
        found.append(Entry(mapped, slot + 1, f"{kind} {number} mapping: object {slot + 1}", U32, "rw", word))
    return found


@dataclass
class Pdo:
    """One PDO of a slave; reads its own records in the object dictionary and watches over their changes."""

    dictionary: ObjectDictionary
    index: int
    transmit: bool
    syncs: int = 0
    changed: bool = False
    next_event_ns: int | None = None
    last_sent: bytes | None = None
    received: bytes | None = None
    mapping: Mapping = field(default=())

    def __post_init__(self) -> None:
        self.mapped_index = self.index + 0x200
        self.reload()
        self.dictionary.on_write(self.index, 1, self._check_cob_id)
        self.dictionary.on_write(self.index, 2, self._check_transmission)
        self.dictionary.on_write(self.mapped_index, 0, self._check_count)
        for slot in range(1, MAPPING_SLOTS + 1):
            self.dictionary.on_write(self.mapped_index, slot, self._check_slot)

    @property
    def cob_id(self) -> int:
        return self.dictionary.number(self.index, 1)

    @property
    def exists(self) -> bool:
        return not self.cob_id & INVALID

    @property
    def transmission(self) -> int:
        return self.dictionary.number(self.index, 2)

    @property
    def length(self) -> int:
        """Bytes of the frame."""
        return sum(bits for _, _, bits in self.mapping) // 8

    def reload(self) -> None:
        """Take the mapping from the dictionary (start, reset)."""
        count = self.dictionary.number(self.mapped_index, 0)
        words = (self.dictionary.number(self.mapped_index, slot) for slot in range(1, count + 1))
        self.mapping = tuple((w >> 16, (w >> 8) & 0xFF, w & 0xFF) for w in words)
        self.syncs, self.next_event_ns, self.last_sent, self.received = 0, None, None, None

    def pack(self) -> bytes:
        """The frame with the present values."""
        parts = []
        for index, sub, _ in self.mapping:
            entry = self.dictionary.entry(index, sub)
            parts.append(encode(entry.type, self.dictionary.value(index, sub)))
        return b"".join(parts)

    def unpack(self, data: bytes) -> None:
        """Write a received frame into the mapped objects; the frame has been checked for its length."""
        at = 0
        for index, sub, bits in self.mapping:
            width = bits // 8
            if index >= 0x20:
                entry = self.dictionary.entry(index, sub)
                self.dictionary.write(entry, decode(entry.type, data[at : at + width]))
            at += width

    def _check_cob_id(self, value: Number) -> None:
        wanted = int(value)
        if self.exists and not wanted & INVALID and (wanted ^ self.cob_id) & 0x7FF:
            raise AbortError(Abort.VALUE)
        if not wanted & INVALID and wanted & 0x7FF in (0x000, 0x080, *range(0x581, 0x680), *range(0x701, 0x780)):
            raise AbortError(Abort.VALUE)
        self.syncs, self.next_event_ns = 0, None

    def _check_transmission(self, value: Number) -> None:
        if 241 <= int(value) <= 251 or (not self.transmit and int(value) in (252, 253)):
            raise AbortError(Abort.VALUE)
        self.syncs = 0

    def _check_count(self, value: Number) -> None:
        if self.exists:
            raise AbortError(Abort.DEVICE_STATE)
        words = [self.dictionary.number(self.mapped_index, slot) for slot in range(1, int(value) + 1)]
        found = tuple((w >> 16, (w >> 8) & 0xFF, w & 0xFF) for w in words)
        for word in words:
            self._check_object(word)
        if sum(bits for _, _, bits in found) > 64:
            raise AbortError(Abort.PDO_LENGTH)
        self.mapping = found

    def _check_slot(self, value: Number) -> None:
        if self.exists or self.dictionary.number(self.mapped_index, 0):
            raise AbortError(Abort.DEVICE_STATE)
        if int(value):
            self._check_object(int(value))

    def _check_object(self, word: int) -> None:
        index, sub, bits = word >> 16, (word >> 8) & 0xFF, word & 0xFF
        if not self.transmit and 0 < index < 0x20:
            return
        entry = self.dictionary.entry(index, sub)
        if ("t" if self.transmit else "r") not in entry.mappable:
            raise AbortError(Abort.NOT_MAPPABLE)
        if entry.type.length * 8 != bits:
            raise AbortError(Abort.NOT_MAPPABLE)


def due_on_sync(pdo: Pdo) -> bool:
    """Whether a TPDO is sent with this SYNC; counts the SYNCs of types 1 to 240."""
    kind = pdo.transmission
    if kind == 0:
        due, pdo.changed = pdo.changed, False
        return due
    if 1 <= kind <= 240:
        pdo.syncs += 1
        if pdo.syncs >= kind:
            pdo.syncs = 0
            return True
    return False
