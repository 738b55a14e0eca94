"""Process data as it came off the bus: one fixed record of raw bytes per SYNC cycle, decoded for a whole block at once.

Each expected TPDO has a slot of eight bytes in the record. A frame is copied into its slot and
nothing else is done with it until the block is complete; then one structured view of the buffer
gives all channels of all cycles.

Pairing is by SYNC index: what arrives after a SYNC went out belongs to that SYNC, unless a frame of
its COB-ID is still owed from before. Then frames are counted in their order, and cycles are marked
LATE until the count comes out or the line has been quiet for so long that the frame must be lost.
LATE and DOUBLED stand at the cycle in which they were noticed, because a block that was handed out
is never changed.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.bus.cia301 import DataType, ObjectRef
from drivers.bus.pdo import MappedPdo
from drivers.errors import DriverError
from drivers.samples import CycleFlag

SLOT_BYTES: Final = 8
_FORMATS: Final = {
    (1, True): "<i1",
    (1, False): "<u1",
    (2, True): "<i2",
    (2, False): "<u2",
    (4, True): "<i4",
    (4, False): "<u4",
    (8, True): "<i8",
    (8, False): "<u8",
}


@dataclass(frozen=True)
class Field:
    """One number in the record of a cycle: its name, the slot of its frame, its byte in the frame, its type."""

    name: str
    slot: int
    offset: int
    data_type: DataType
    quantum: float = 0.0
    """For floating-point objects: the size of one count, in the object's unit."""

    @property
    def numpy_format(self) -> str:
        """The number's type for numpy. Raises `DriverError` for odd widths."""
        kind = self.data_type
        if kind.is_float:
            return "<f4" if kind.size == 4 else "<f8"
        if (kind.size, kind.signed) not in _FORMATS:
            raise DriverError(
                "this type cannot be acquired",
                where=self.name,
                value=kind.name,
                limit="1, 2, 4 or 8 bytes",
            )
        return _FORMATS[kind.size, kind.signed]


class Fields:
    """The fields that the channels of a rig need, each made once, where a mapped PDO has its object."""

    def __init__(self, pdos: Sequence[MappedPdo]) -> None:
        self.made: list[Field] = []
        self._pdos = tuple(pdos)
        self._place: dict[tuple[int, tuple[int, int], int], int] = {}

    def number(self, node_id: int, entry: ObjectRef, quantum: float = 0.0) -> int:
        """The field of an object of a node, made where it is new; -1 where no PDO has it."""
        key = (node_id, entry.key, entry.offset)
        if key not in self._place:
            field = self._field(node_id, entry, quantum)
            if field is None:
                return -1
            self._place[key] = len(self.made)
            self.made.append(field)
        return self._place[key]

    def _field(self, node_id: int, entry: ObjectRef, quantum: float) -> Field | None:
        for slot, pdo in enumerate(self._pdos):
            offset = pdo.offset_of(entry.key)
            if pdo.node_id == node_id and offset is not None:
                mapped = next(e for e in pdo.entries if e.key == entry.key)
                kind = mapped.data_type if entry.part is None else entry.value_type
                return Field(f"node {node_id} {entry}", slot, offset + entry.offset, kind, quantum)
        return None


class FrameLayout:
    """Which COB-ID fills which slot, and where each field stands in the record of a cycle."""

    def __init__(self, pdos: Sequence[MappedPdo], fields: Sequence[Field]) -> None:
        self.pdos, self.fields = tuple(pdos), tuple(fields)
        self.lengths = tuple(pdo.length for pdo in pdos)
        self.stride = SLOT_BYTES * max(1, len(pdos))
        self.all_slots = (1 << len(pdos)) - 1
        for field in fields:
            if field.data_type.is_float and not field.quantum > 0.0:
                raise DriverError(
                    "a floating-point channel needs the size of one count", where=field.name
                )
        self._row = _row_struct(fields, self.stride)
        self._dtype = np.dtype(
            {
                "names": [field.name for field in fields],
                "formats": [field.numpy_format for field in fields],
                "offsets": [field.slot * SLOT_BYTES + field.offset for field in fields],
                "itemsize": self.stride,
            }
        )

    def decode(
        self, buffer: bytes | bytearray | memoryview, rows: int
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Raw counts (rows, fields) and where a number is none (NaN, infinite, too large): there the count is 0."""
        records = np.empty(0, dtype=self._dtype)
        if rows:
            records = np.frombuffer(buffer, dtype=self._dtype, count=rows)
        counts = np.empty((rows, len(self.fields)), dtype=np.int64)
        bad = np.zeros((rows, len(self.fields)), dtype=bool)
        for column, field in enumerate(self.fields):
            values = records[field.name]
            if field.data_type.is_float:
                scaled = np.asarray(values, dtype=np.float64) / field.quantum
                bad[:, column] = ~(np.abs(scaled) < 2.0**62)
                scaled = np.where(bad[:, column], 0.0, scaled)
                counts[:, column] = np.rint(scaled).astype(np.int64)
            else:
                counts[:, column] = values
                if field.data_type.size == 8 and not field.data_type.signed:
                    bad[:, column] = values > np.uint64(2**63 - 1)
                    counts[bad[:, column], column] = 0
        return counts, bad

    def decode_row(self, record: bytes) -> list[int]:
        """Raw counts of one record, in the order of the fields; a number that is none becomes 0, as in `decode`."""
        structure, order = self._row
        values = structure.unpack_from(record)
        counts = [0] * len(values)
        for value, column in zip(values, order, strict=True):
            if type(value) is float:
                scaled = value / self.fields[column].quantum
                counts[column] = round(scaled) if abs(scaled) < 2.0**62 else 0
            else:
                counts[column] = value if value < 2**63 else 0
        return counts


def _row_struct(fields: Sequence[Field], stride: int) -> tuple[struct.Struct, list[int]]:
    """One format for a whole record, and the column of each of its values."""
    order = sorted(range(len(fields)), key=lambda i: fields[i].slot * SLOT_BYTES + fields[i].offset)
    form, at = "<", 0
    for column in order:
        field = fields[column]
        start = field.slot * SLOT_BYTES + field.offset
        if start < at:
            raise DriverError("two channels share bytes of one frame", where=field.name)
        letter = {
            "i1": "b",
            "u1": "B",
            "i2": "h",
            "u2": "H",
            "i4": "i",
            "u4": "I",
            "i8": "q",
            "u8": "Q",
            "f4": "f",
            "f8": "d",
        }
        form += "x" * (start - at) + letter[field.numpy_format[1:]]
        at = start + field.data_type.size
    return struct.Struct(form + "x" * (stride - at)), order


class CycleStore:
    """The raw records of a block, and who has arrived in the present cycle. Frames are put in by COB-ID's slot."""

    def __init__(self, layout: FrameLayout) -> None:
        self.layout = layout
        count = len(layout.pdos)
        self.lost = [0] * count
        self.surplus = [0] * count
        """By slot: frames that came beside the first of a cycle, since the rig was opened; late ones are among them."""
        self.surplus_frames = 0
        """All of them."""
        self.rows = 0
        self._buffer = bytearray(layout.stride)
        self._last = bytes(layout.stride)
        self._absent_before = self._absent_now = layout.all_slots
        self._flags: list[int] = []
        self._absent: list[int] = []
        self._received = [0] * count
        self._owed = [0] * count
        self._stamps = [0] * count
        self._to_come = 0
        self._pending = 0
        self._is_open = self._awaits_echo = False

    def begin_block(self, cycles: int) -> None:
        """Make room for `cycles` records."""
        if len(self._buffer) < cycles * self.layout.stride:
            self._buffer = bytearray(cycles * self.layout.stride)
        self.rows, self._flags, self._absent = 0, [], []

    def begin_cycle(self, awaits_echo: bool) -> None:
        """Open the next record: it starts as a copy of the one before, so that a missing frame
        leaves its last values.
        """
        start = self.rows * self.layout.stride
        self._buffer[start : start + self.layout.stride] = self._last
        self._flags.append(self._pending)
        self._absent.append(0)
        self._pending = 0
        self._received = [0] * len(self._received)
        self._to_come = len(self._received)
        self._is_open, self._awaits_echo = True, awaits_echo
        self.rows += 1

    def echo(self) -> None:
        """The SYNC itself has come back from the bus: what was sent before it has been handed over."""
        self._awaits_echo = False

    @property
    def has_all(self) -> bool:
        """Whether a frame of every COB-ID is there (and the SYNC itself, where it comes back)."""
        return not self._to_come and not self._awaits_echo

    def forgive(self) -> None:
        """The line has been quiet for long: what was owed of the COB-IDs that have answered since is lost for good.

        The present cycle stays marked, because its frame may have been the one owed.
        """
        for slot, received in enumerate(self._received):
            if received and self._owed[slot]:
                self._flags[-1] |= CycleFlag.LATE
                self._owed[slot] = 0

    @property
    def is_owed(self) -> bool:
        """Whether a frame of an earlier cycle may still come and be mistaken."""
        return any(self._owed)

    @property
    def is_silent(self) -> bool:
        """Whether some COB-ID has been missing for two cycles or more."""
        return max(self._owed, default=0) > 1

    def receiver(self, slot: int) -> Callable[[bytes, int], None]:
        """What takes the frames of a slot's COB-ID: data and time stamp [ns]."""
        put = self.put
        return lambda data, stamp_ns: put(slot, data, stamp_ns)

    def put(self, slot: int, data: bytes, stamp_ns: int) -> None:
        """Take a frame."""
        if not self._is_open or (self._awaits_echo and self._owed[slot]):
            # It was on the bus before this cycle's SYNC: owed from an earlier cycle, or one too many.
            flag = CycleFlag.LATE if self._owed[slot] else CycleFlag.DOUBLED
            self._owed[slot] = max(0, self._owed[slot] - 1)
            self.surplus[slot] += 1
            self.surplus_frames += 1
            if self._is_open:
                self._flags[-1] |= flag
            else:
                self._pending |= flag
            return
        self._received[slot] += 1
        if self._received[slot] == 1:
            self._to_come -= 1
        else:
            self.surplus[slot] += 1
            self.surplus_frames += 1
            if not self._owed[slot]:
                self._flags[-1] |= CycleFlag.DOUBLED
                return
            # Frames of a COB-ID keep their order: the one before this was owed from an earlier cycle.
            self._owed[slot] -= 1
            self._flags[-1] |= CycleFlag.LATE
        self._stamps[slot] = stamp_ns
        if len(data) < self.layout.lengths[slot]:
            self._flags[-1] |= CycleFlag.SHORT | CycleFlag.INCOMPLETE
            self._absent[-1] |= 1 << slot
            return
        start = (self.rows - 1) * self.layout.stride + slot * SLOT_BYTES
        self._buffer[start : start + self.layout.lengths[slot]] = data[: self.layout.lengths[slot]]

    def drop_open(self) -> None:
        """Forget the cycle that is open, because the bus went away under it."""
        if self._is_open:
            self._is_open = False
            self.rows -= 1
            self._flags.pop()
            self._absent.pop()

    def stamps(self) -> list[int]:
        """The time stamps [ns] of the present cycle's frames, 0 for a frame that has not come."""
        return [
            stamp if received else 0
            for stamp, received in zip(self._stamps, self._received, strict=True)
        ]

    def end_cycle(self) -> int:
        """Close the record and return its flags."""
        self._is_open = False
        if self._to_come or any(self._owed):
            self._settle_accounts()
        start = (self.rows - 1) * self.layout.stride
        self._last = bytes(self._buffer[start : start + self.layout.stride])
        self._absent_before, self._absent_now = self._absent_now, self._absent[-1]
        return self._flags[-1]

    def _settle_accounts(self) -> None:
        for slot, received in enumerate(self._received):
            if not received:
                self._flags[-1] |= CycleFlag.INCOMPLETE
                self._absent[-1] |= 1 << slot
                self._owed[slot] += 1
                self.lost[slot] += 1
            elif self._owed[slot]:
                # Fewer frames than were due: the latest may still be one of an earlier cycle.
                self._flags[-1] |= CycleFlag.LATE

    @property
    def last_record(self) -> bytes:
        """The record of the cycle that was closed last."""
        return self._last

    def is_absent(self, slot: int) -> bool:
        """Whether a slot had no usable frame in the two cycles that were closed last: more than one lost frame."""
        return bool((self._absent_before & self._absent_now) >> slot & 1)

    def missing_slots(self) -> list[int]:
        """The slots whose frame did not come in the cycle that was closed last."""
        return [slot for slot, owed in enumerate(self._owed) if owed]

    def missing_text(self) -> str:
        """Who did not answer in the cycle that was closed last, in words."""
        pdos = [self.layout.pdos[slot] for slot in self.missing_slots()]
        return ", ".join(f"node {pdo.node_id} (0x{pdo.cob_id:03X})" for pdo in pdos) or "bus"

    def decoded(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """All records of the block, decoded at once."""
        return self.layout.decode(
            memoryview(self._buffer)[: self.rows * self.layout.stride], self.rows
        )

    def flags(self) -> NDArray[np.uint16]:
        """The flags of the block's cycles."""
        return np.array(self._flags, dtype=np.uint16)

    def absent(self) -> NDArray[np.int64]:
        """For each of the block's cycles the slots without a usable frame, one bit each."""
        return np.array(self._absent, dtype=np.int64)
