"""PDO communication and mapping (CiA 301, 7.5.2.35-38): written by the standard's procedure, read back, never assumed.

Procedure: invalidate the COB-ID (bit 31), set the number of entries to 0, write the entries, set
their number, write the transmission type, make the COB-ID valid again. A device with fixed mapping
keeps its own, and is used as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from drivers.bus.cia301 import (
    COB_ID_EXTENDED_BIT,
    COB_ID_INVALID_BIT,
    I32,
    U8,
    U16,
    U32,
    DataType,
    ObjectRef,
    object_text,
)
from drivers.bus.device import RemoteDevice
from drivers.bus.sdo import SdoAbortError
from drivers.errors import DriverError, ReadbackError

_MOST_PDOS: Final = 8
"""PDO numbers that are tried; CiA 301 allows 512, of which the first four have pre-defined COB-IDs."""
_EVERY_SYNC: Final = 1
LAST_SYNCHRONOUS: Final = 240
"""RPDO types 0 to 240 act with the next SYNC after the frame; for a TPDO only type 1 answers every SYNC."""
_PREDEFINED_PDOS: Final = 4
"""PDO numbers that have a COB-ID by the pre-defined connection set."""
_KEPT_BIT: Final = 0x40000000
"""Of a COB-ID (bit 30, no RTR): written back as the device has it."""


class UntiedPdoError(DriverError):
    """A TPDO that a device does not send with every SYNC."""


@dataclass(frozen=True)
class MappedPdo:
    """A PDO as the device confirmed it: direction, number (from 1), COB-ID, transmission type, entries in order."""

    node_id: int
    is_transmit: bool
    number: int
    cob_id: int
    transmission_type: int
    entries: tuple[ObjectRef, ...]

    @property
    def length(self) -> int:
        """Bytes of a frame."""
        return sum(entry.data_type.size for entry in self.entries)

    def offset_of(self, key: tuple[int, int]) -> int | None:
        """The byte at which an entry starts, None if it is not in this PDO."""
        offset = 0
        for entry in self.entries:
            if entry.key == key:
                return offset
            offset += entry.data_type.size
        return None

    def __str__(self) -> str:
        kind = "TPDO" if self.is_transmit else "RPDO"
        inside = ", ".join(str(entry) for entry in self.entries)
        return f"node {self.node_id} {kind}{self.number} (0x{self.cob_id:03X}): {inside}"


def pack(entries: Sequence[ObjectRef], most_bytes: int = 8) -> list[list[ObjectRef]]:
    """Entries in frames of at most eight bytes, in order, first fit."""
    frames: list[list[ObjectRef]] = []
    for entry in entries:
        for frame in frames:
            if sum(e.data_type.size for e in frame) + entry.data_type.size <= most_bytes:
                frame.append(entry)
                break
        else:
            frames.append([entry])
    return frames


def map_objects(
    device: RemoteDevice,
    entries: Sequence[ObjectRef],
    *,
    is_transmit: bool,
    optional: frozenset[tuple[int, int]] = frozenset(),
) -> list[MappedPdo]:
    """Map `entries` into the device's PDOs, every SYNC; entries in `optional` may stay out and are
    then noted as missing.

    Raises `DriverError` when an entry that is not optional cannot be transferred, `ReadbackError` when a mapping reads
    back differently.
    """
    wanted = [_as_answered(device, entry) for entry in entries]
    mapped, untied = _map_in_turn(device, wanted, is_transmit)
    refused = [entry for entry in wanted if not _holds(mapped, entry)]
    mapped += _as_preset(device, is_transmit, refused, {p.number for p in mapped})
    for entry in refused:
        if _holds(mapped, entry):
            continue
        if entry.key in optional:
            device.note_missing(entry, "cannot be mapped into a PDO")
            continue
        raise untied or DriverError(
            "an object cannot be transferred by PDO",
            where=device.where,
            value=str(entry),
            remedy="The device can neither map it nor has it mapped: configure its PDOs with the vendor's tool.",
        )
    if is_transmit:
        _silence_others(device, {p.number for p in mapped})
    return mapped


def _holds(mapped: Sequence[MappedPdo], entry: ObjectRef) -> bool:
    """Whether one of these PDOs carries the entry."""
    return any(pdo.offset_of(entry.key) is not None for pdo in mapped)


def _map_in_turn(
    device: RemoteDevice, wanted: Sequence[ObjectRef], is_transmit: bool
) -> tuple[list[MappedPdo], UntiedPdoError | None]:
    """What the device takes, PDO by PDO; and the first one that could not be tied to SYNC."""
    mapped: list[MappedPdo] = []
    untied: UntiedPdoError | None = None
    pending = pack(wanted)
    for number in range(1, _MOST_PDOS + 1):
        if not pending:
            break
        frame = pending.pop(0)
        try:
            pdo = _write_longest(device, number, is_transmit, frame)
        except UntiedPdoError as error:
            # The type of one TPDO may be fixed, and that of the next not.
            untied, pdo = untied or error, None
        if pdo is None:
            pending.insert(0, frame)
            continue
        mapped.append(pdo)
        rest = [entry for entry in frame if pdo.offset_of(entry.key) is None]
        if rest and len(rest) < len(frame):
            pending.insert(0, rest)
    return mapped, untied


def _as_answered(device: RemoteDevice, entry: ObjectRef) -> ObjectRef:
    """The entry with the type that the EDS gives it, unless the device itself answers in the standard's length."""
    typed = device.typed(entry)
    if typed.data_type.size == entry.data_type.size:
        return typed
    try:
        length = len(device.sdo.upload(*entry.key))
    except SdoAbortError:
        return typed
    if length != entry.data_type.size:
        return typed
    device.bus.emit(
        "warning",
        "eds-type",
        device.where,
        f"the EDS has {entry} as {typed.data_type.name}, the device answers {length} bytes: "
        f"{entry.data_type.name} is taken",
    )
    return entry


def read_pdo(device: RemoteDevice, number: int, *, is_transmit: bool) -> MappedPdo | None:
    """A PDO as it stands in the device; None when it does not exist or is switched off."""
    communication, mapping = _indices(number, is_transmit)
    try:
        cob_id = int(device.sdo.read_as(communication, 1, U32))
        if cob_id & (COB_ID_INVALID_BIT | COB_ID_EXTENDED_BIT):
            return None
        kind = int(device.sdo.read_as(communication, 2, U8))
        count = int(device.sdo.read_as(mapping, 0, U8))
        words = [int(device.sdo.read_as(mapping, sub, U32)) for sub in range(1, min(count, 64) + 1)]
    except SdoAbortError:
        return None
    entries = _whole_bytes(device, words)
    if entries is None:
        return None
    return MappedPdo(device.node_id, is_transmit, number, cob_id & 0x7FF, kind, entries)


def _write_longest(
    device: RemoteDevice, number: int, is_transmit: bool, frame: list[ObjectRef]
) -> MappedPdo | None:
    """Write as many leading entries of `frame` as the device takes into PDO `number`; None if it takes none."""
    communication, mapping = _indices(number, is_transmit)
    try:
        cob_id = int(device.sdo.read_as(communication, 1, U32))
        own = 0 if cob_id & COB_ID_EXTENDED_BIT else cob_id & 0x7FF
        if not own and number > _PREDEFINED_PDOS:
            # It has no COB-ID, and none that is surely free can be given to it.
            return None
        predefined = (0x180 if is_transmit else 0x200) + 0x100 * (number - 1) + device.node_id
        valid = cob_id & _KEPT_BIT | (own or predefined)
        _try_download(device, communication, 1, U32.encode(COB_ID_INVALID_BIT | valid))
        device.sdo.download(mapping, 0, U8.encode(0))
    except SdoAbortError:
        _restore(device, communication)
        return None
    written = _write_entries(device, mapping, frame)
    if not written:
        _restore_entries(device, mapping)
        _restore(device, communication)
        return None
    by_sync = _try_download(device, communication, 2, U8.encode(_EVERY_SYNC))
    if is_transmit:
        _quieten(device, communication)
    _try_download(device, communication, 1, U32.encode(valid))
    return _read_back(device, number, is_transmit, written, by_sync=by_sync, valid=valid)


def _read_back(
    device: RemoteDevice,
    number: int,
    is_transmit: bool,
    written: Sequence[ObjectRef],
    *,
    by_sync: bool,
    valid: int,
) -> MappedPdo:
    """The PDO as the device has it now, with the names of what was written; `by_sync`: it took the type,
    `valid`: its COB-ID. Raises `UntiedPdoError`, `ReadbackError`.
    """
    communication, mapping = _indices(number, is_transmit)
    pdo = read_pdo(device, number, is_transmit=is_transmit)
    is_timed = pdo is not None and pdo.transmission_type == _EVERY_SYNC
    if pdo is not None and not is_transmit and not by_sync:
        _tell_type(device, pdo)
        is_timed = True
    if pdo is not None and is_transmit and not is_timed:
        _try_download(device, communication, 1, U32.encode(COB_ID_INVALID_BIT | valid))
        raise _not_by_sync(device, communication, pdo)
    expected = [entry.mapping for entry in written]
    if pdo is None or not is_timed or [e.mapping for e in pdo.entries] != expected:
        raise ReadbackError(
            "the PDO mapping reads back differently",
            where=f"{device.where}, {object_text(mapping, 0)}",
            value=str(pdo),
            limit=", ".join(str(entry) for entry in written),
        )
    named = {entry.key: entry for entry in written}
    return replace(pdo, entries=tuple(named[e.key] for e in pdo.entries))


def _try_download(device: RemoteDevice, index: int, subindex: int, data: bytes) -> bool:
    """Write what some devices keep fixed; what stands there afterwards is read back anyway."""
    try:
        device.sdo.download(index, subindex, data)
    except SdoAbortError:
        return False
    return True


def _write_entries(device: RemoteDevice, mapping: int, frame: list[ObjectRef]) -> list[ObjectRef]:
    """Write entries until the device refuses one, then their number; what was written."""
    written: list[ObjectRef] = []
    for entry in frame:
        try:
            device.sdo.download(mapping, len(written) + 1, U32.encode(entry.mapping))
        except SdoAbortError as error:
            if error.code in (0x06090011, 0x06040042):
                break
            # Not mappable itself; the others may be.
            continue
        written.append(entry)
    while written:
        try:
            device.sdo.download(mapping, 0, U8.encode(len(written)))
            return written
        except SdoAbortError:
            written.pop()
    return written


def _as_preset(
    device: RemoteDevice, is_transmit: bool, wanted: list[ObjectRef], used: set[int]
) -> list[MappedPdo]:
    """PDOs of a fixed mapping that carry any of the wanted entries, switched to every SYNC where the device lets."""
    mapped: list[MappedPdo] = []
    if not wanted:
        return mapped
    for number in range(1, _MOST_PDOS + 1):
        pdo = read_pdo(device, number, is_transmit=is_transmit) if number not in used else None
        if pdo is None or not any(pdo.offset_of(e.key) is not None for e in wanted):
            continue
        if pdo.transmission_type != _EVERY_SYNC:
            communication, _ = _indices(number, is_transmit)
            _set_type(device, communication)
            pdo = read_pdo(device, number, is_transmit=is_transmit) or pdo
            if is_transmit and pdo.transmission_type != _EVERY_SYNC:
                raise _not_by_sync(device, communication, pdo)
            if not is_transmit:
                _tell_type(device, pdo)
        typed = {e.key: e for e in wanted}
        entries = tuple(
            typed.get(e.key, e) if typed.get(e.key, e).mapping == e.mapping else e
            for e in pdo.entries
        )
        mapped.append(
            MappedPdo(
                device.node_id, is_transmit, number, pdo.cob_id, pdo.transmission_type, entries
            )
        )
    return mapped


def _set_type(device: RemoteDevice, communication: int) -> None:
    """Tie a PDO to every SYNC; some devices let its type be changed only while the PDO does not exist."""
    data = U8.encode(_EVERY_SYNC)
    if _try_download(device, communication, 2, data):
        return
    cob_id = int(device.sdo.read_as(communication, 1, U32))
    if _try_download(device, communication, 1, U32.encode(cob_id | COB_ID_INVALID_BIT)):
        _try_download(device, communication, 2, data)
        _try_download(device, communication, 1, U32.encode(cob_id))


def _tell_type(device: RemoteDevice, pdo: MappedPdo) -> None:
    """Say that set-points act with their frame, where a device does not keep them for the SYNC."""
    if pdo.transmission_type > LAST_SYNCHRONOUS:
        device.bus.emit(
            "warning",
            "rpdo-type",
            device.where,
            f"RPDO{pdo.number} keeps transmission type {pdo.transmission_type}: set-points act "
            "before SYNC, not with it",
        )


def _not_by_sync(device: RemoteDevice, communication: int, pdo: MappedPdo) -> UntiedPdoError:
    """A TPDO that is not sent with every SYNC cannot be paired: on change, by timer, or on request only."""
    return UntiedPdoError(
        "a TPDO cannot be tied to every SYNC",
        where=f"{device.where}, {object_text(communication, 2)}",
        value=f"transmission type {pdo.transmission_type}",
        limit=str(_EVERY_SYNC),
        remedy="Set transmission type 1 with the vendor's tool, or use another TPDO or device for this signal.",
    )


def _silence_others(device: RemoteDevice, used: set[int]) -> None:
    """Switch off the device's other TPDOs: they would load the bus with data that nobody reads."""
    for number in range(1, _MOST_PDOS + 1):
        if number in used:
            continue
        communication, _ = _indices(number, True)
        try:
            cob_id = int(device.sdo.read_as(communication, 1, U32))
            if not cob_id & COB_ID_INVALID_BIT:
                device.sdo.download(communication, 1, U32.encode(cob_id | COB_ID_INVALID_BIT))
        except SdoAbortError as error:
            if error.is_missing:
                return


def _quieten(device: RemoteDevice, communication: int) -> None:
    """No inhibit time, no event timer, no SYNC start value: nothing that could delay or add a
    frame; all are optional.
    """
    for subindex, data_type in ((3, U16), (5, U16), (6, U8)):
        try:
            if device.sdo.read_as(communication, subindex, data_type):
                device.sdo.download(communication, subindex, data_type.encode(0))
        except SdoAbortError:
            continue


def _restore_entries(device: RemoteDevice, mapping: int) -> None:
    """Give a PDO whose entries turned out to be fixed its number of entries back."""
    count = 0
    while count < 64:
        try:
            if not device.sdo.read_as(mapping, count + 1, U32):
                break
        except SdoAbortError:
            break
        count += 1
    if count:
        _try_download(device, mapping, 0, U8.encode(count))


def _restore(device: RemoteDevice, communication: int) -> None:
    """Make a PDO valid again whose mapping turned out to be fixed."""
    try:
        cob_id = int(device.sdo.read_as(communication, 1, U32))
        if cob_id & COB_ID_INVALID_BIT and cob_id & 0x7FF:
            device.sdo.download(communication, 1, U32.encode(cob_id & ~COB_ID_INVALID_BIT))
    except SdoAbortError:
        return


def _indices(number: int, is_transmit: bool) -> tuple[int, int]:
    first = 0x1800 if is_transmit else 0x1400
    return first + number - 1, first + 0x200 + number - 1


def _whole_bytes(device: RemoteDevice, words: Sequence[int]) -> tuple[ObjectRef, ...] | None:
    """Mapping words as entries of whole bytes: neighbouring bits are one filler, an entry without bits is none.

    None where an entry starts within a byte, or where they are more than a frame holds.
    """
    if sum(word & 0xFF for word in words) > 64:
        return None
    entries: list[ObjectRef] = []
    bits = 0
    for word in words:
        if word & 0x07 or bits:
            bits += word & 0xFF
            if bits % 8 == 0:
                entries.append(
                    ObjectRef(0, 0, DataType(0x0F, f"{bits} bits", bits // 8), f"{bits} bits")
                )
                bits = 0
            continue
        if word & 0xFF:
            entries.append(_entry(device, word))
    return None if bits else tuple(entries)


def _entry(device: RemoteDevice, word: int) -> ObjectRef:
    """A mapping word as an entry; its type from the EDS where the length agrees, else an integer of that length."""
    index, subindex, bits = word >> 16, word >> 8 & 0xFF, word & 0xFF
    described = device.description.entry(index, subindex) if device.description else None
    if described is not None and described.data_type.size * 8 == bits:
        return described.ref
    size = max(1, (bits + 7) // 8)
    data_type = {1: U8, 2: U16, 4: I32}.get(size, DataType(0x0F, f"{bits} bits", size))
    return ObjectRef(index, subindex, data_type)
