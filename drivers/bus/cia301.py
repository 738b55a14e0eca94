"""The tables of CANopen's application layer (CiA 301): data types, SDO aborts, emergency codes,
NMT, well-known COB-IDs.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final

from drivers.errors import DecodeError, DriverError

SYNC_COB_ID: Final = 0x080
EMCY_BASE: Final = 0x080
SDO_RESPONSE_BASE: Final = 0x580
SDO_REQUEST_BASE: Final = 0x600
HEARTBEAT_BASE: Final = 0x700
HIGHEST_NODE_ID: Final = 127
COB_ID_INVALID_BIT: Final = 1 << 31
"""Bit 31 of a COB-ID entry: the PDO (or the service) does not exist."""
COB_ID_EXTENDED_BIT: Final = 1 << 29
"""Bit 29 of a COB-ID entry: the frame has a 29-bit identifier, which this rig neither sends nor hears."""


class NmtCommand(IntEnum):
    """What the NMT master can tell a node."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(Enum):
    """The NMT state that a node announces in its heartbeat; bit 7 is node guarding's toggle bit."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F
    UNKNOWN = -1


def nmt_state(byte: int) -> NmtState:
    """The state that a heartbeat's byte stands for."""
    try:
        return NmtState(byte & 0x7F)
    except ValueError:
        return NmtState.UNKNOWN


@dataclass(frozen=True, slots=True)
class DataType:
    """A basic data type: CiA 301 code, name, length on the wire in bytes (0: variable), signedness, float or not."""

    code: int
    name: str
    size: int = 0
    signed: bool = False
    is_float: bool = False

    @property
    def is_number(self) -> bool:
        """Whether it decodes to a number."""
        return self.size > 0

    def decode(self, data: bytes) -> int | float:
        """Little-endian bytes as a number. Raises `DecodeError` when there are fewer bytes than the type has.

        More bytes than the type has are tolerated: servers are known to answer four bytes for every expedited upload.
        """
        if not self.is_number:
            raise DecodeError("a data type without fixed length is not a number", where=self.name)
        if len(data) < self.size:
            raise DecodeError(
                "too few bytes",
                where=self.name,
                value=data.hex(" ") or "none",
                limit=f"{self.size} bytes",
            )
        if self.is_float:
            return struct.unpack("<f" if self.size == 4 else "<d", data[: self.size])[0]
        return int.from_bytes(data[: self.size], "little", signed=self.signed)

    def encode(self, value: float) -> bytes:
        """A number as little-endian bytes. Raises `DriverError` when it does not fit."""
        if not self.is_number:
            raise DriverError(
                "a data type without fixed length takes no number", where=self.name, value=value
            )
        try:
            if self.is_float:
                return struct.pack("<f" if self.size == 4 else "<d", value)
            return int(value).to_bytes(self.size, "little", signed=self.signed)
        except (OverflowError, struct.error, ValueError) as error:
            raise DriverError(
                "the value does not fit the object's type", where=self.name, value=value
            ) from error


_ROWS: tuple[DataType, ...] = (
    DataType(0x01, "BOOLEAN", 1),
    DataType(0x02, "INTEGER8", 1, signed=True),
    DataType(0x03, "INTEGER16", 2, signed=True),
    DataType(0x04, "INTEGER32", 4, signed=True),
    DataType(0x05, "UNSIGNED8", 1),
    DataType(0x06, "UNSIGNED16", 2),
    DataType(0x07, "UNSIGNED32", 4),
    DataType(0x08, "REAL32", 4, signed=True, is_float=True),
    DataType(0x09, "VISIBLE_STRING"),
    DataType(0x0A, "OCTET_STRING"),
    DataType(0x0B, "UNICODE_STRING"),
    DataType(0x0C, "TIME_OF_DAY"),
    DataType(0x0D, "TIME_DIFFERENCE"),
    DataType(0x0F, "DOMAIN"),
    DataType(0x10, "INTEGER24", 3, signed=True),
    DataType(0x11, "REAL64", 8, signed=True, is_float=True),
    DataType(0x12, "INTEGER40", 5, signed=True),
    DataType(0x13, "INTEGER48", 6, signed=True),
    DataType(0x14, "INTEGER56", 7, signed=True),
    DataType(0x15, "INTEGER64", 8, signed=True),
    DataType(0x16, "UNSIGNED24", 3),
    DataType(0x18, "UNSIGNED40", 5),
    DataType(0x19, "UNSIGNED48", 6),
    DataType(0x1A, "UNSIGNED56", 7),
    DataType(0x1B, "UNSIGNED64", 8),
)
DATA_TYPES: Final[Mapping[int, DataType]] = {row.code: row for row in _ROWS}
"""Data type by its CiA 301 code."""

I8, I16, I32 = DATA_TYPES[0x02], DATA_TYPES[0x03], DATA_TYPES[0x04]
U8, U16, U32 = DATA_TYPES[0x05], DATA_TYPES[0x06], DATA_TYPES[0x07]
REAL32 = DATA_TYPES[0x08]
VISIBLE_STRING = DATA_TYPES[0x09]


def data_type_named(name: str) -> DataType:
    """The data type of a name such as "INTEGER32", "I32" or "U16". Raises `DriverError` for an unknown one."""
    spelled = name.strip().upper()
    if len(spelled) > 1 and spelled[0] in "IU" and spelled[1:].isdigit():
        spelled = ("INTEGER" if spelled[0] == "I" else "UNSIGNED") + spelled[1:]
    for row in _ROWS:
        if row.name == spelled:
            return row
    names = ", ".join(row.name for row in _ROWS)
    raise DriverError("unknown data type", value=name, limit=names)


@dataclass(frozen=True, slots=True)
class Part:
    """Bytes within an object that hold a number of their own: the first of them, and the number's type."""

    offset: int
    data_type: DataType


@dataclass(frozen=True, slots=True)
class ObjectRef:
    """An entry of an object dictionary: index, sub-index, data type, and what it is called.

    With a `part` the number that is meant lies in some of its bytes: couplers hand over a terminal's
    status, counter and latch as one object.
    """

    index: int
    subindex: int
    data_type: DataType
    name: str = ""
    part: Part | None = None

    @property
    def value_type(self) -> DataType:
        """The type of the number that is meant."""
        return self.data_type if self.part is None else self.part.data_type

    @property
    def offset(self) -> int:
        """The byte of the object at which that number begins."""
        return 0 if self.part is None else self.part.offset

    @property
    def mapping(self) -> int:
        """The entry of a PDO mapping: index, sub-index, length in bits."""
        return self.index << 16 | self.subindex << 8 | self.data_type.size * 8

    @property
    def key(self) -> tuple[int, int]:
        """(index, sub-index)."""
        return self.index, self.subindex

    def __str__(self) -> str:
        place = object_text(self.index, self.subindex)
        if self.part is not None:
            place += f" {self.value_type.name} at byte {self.offset}"
        return place + (f" {self.name}" if self.name else "")


def object_text(index: int, subindex: int) -> str:
    """An entry as the manuals write it: 0x6041:0."""
    return f"0x{index:04X}:{subindex}"


_SDO_ABORTS: Final[Mapping[int, str]] = {
    0x05030000: "toggle bit not alternated",
    0x05040000: "SDO protocol timed out",
    0x05040001: "command specifier not valid or unknown",
    0x05040002: "invalid block size",
    0x05040003: "invalid sequence number",
    0x05040004: "CRC error",
    0x05040005: "out of memory",
    0x06010000: "unsupported access to an object",
    0x06010001: "attempt to read a write-only object",
    0x06010002: "attempt to write a read-only object",
    0x06010003: "sub-index cannot be written, sub-index 0 must be 0 for write access",
    0x06010004: "complete access not supported",
    0x06010005: "object length exceeds the mailbox",
    0x06010006: "object mapped to an RPDO, download blocked",
    0x06020000: "object does not exist in the object dictionary",
    0x06040041: "object cannot be mapped to the PDO",
    0x06040042: "number and length of the objects would exceed the PDO",
    0x06040043: "general parameter incompatibility",
    0x06040047: "general internal incompatibility in the device",
    0x06060000: "access failed due to a hardware error",
    0x06070010: "data type does not match, length of service parameter does not match",
    0x06070012: "data type does not match, length of service parameter too high",
    0x06070013: "data type does not match, length of service parameter too low",
    0x06090011: "sub-index does not exist",
    0x06090030: "invalid value for the parameter",
    0x06090031: "value of the parameter written too high",
    0x06090032: "value of the parameter written too low",
    0x06090036: "maximum value is less than the minimum value",
    0x060A0023: "resource not available: SDO connection",
    0x08000000: "general error",
    0x08000020: "data cannot be transferred or stored to the application",
    0x08000021: "data cannot be transferred because of local control",
    0x08000022: "data cannot be transferred because of the present device state",
    0x08000023: "object dictionary not present or its generation failed",
    0x08000024: "no data available",
}
ABORT_MISSING: Final = frozenset({0x06020000, 0x06090011})
"""Aborts that say that the device simply has no such entry."""


def abort_text(code: int) -> str:
    """An SDO abort code in words."""
    return _SDO_ABORTS.get(code, "abort code of the manufacturer or of a later standard")


_EMCY_CODES: Final[Mapping[int, str]] = {
    0x0000: "error reset or no error",
    0x1000: "generic error",
    0x2000: "current",
    0x2100: "current on the device's input side",
    0x2200: "current inside the device",
    0x2300: "current on the device's output side",
    0x3000: "voltage",
    0x3100: "mains voltage",
    0x3200: "voltage inside the device",
    0x3300: "output voltage",
    0x4000: "temperature",
    0x4100: "ambient temperature",
    0x4200: "device temperature",
    0x5000: "device hardware",
    0x6000: "device software",
    0x6100: "internal software",
    0x6200: "user software",
    0x6300: "data set",
    0x7000: "additional modules",
    0x8000: "monitoring",
    0x8100: "communication",
    0x8110: "CAN overrun, objects lost",
    0x8120: "CAN in error passive mode",
    0x8130: "life guard or heartbeat error",
    0x8140: "recovered from bus-off",
    0x8150: "CAN-ID collision",
    0x8200: "protocol error",
    0x8210: "PDO not processed because of a length error",
    0x8220: "PDO length exceeded",
    0x8230: "destination address mode PDO not processed, object not available",
    0x8240: "unexpected SYNC data length",
    0x8250: "RPDO timed out",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "device specific",
}
_ERROR_REGISTER_BITS: Final[tuple[str, ...]] = (
    "generic",
    "current",
    "voltage",
    "temperature",
    "communication",
    "device profile",
    "reserved",
    "manufacturer",
)


def error_code_text(code: int, profile: Mapping[int, str] | None = None) -> str:
    """An error code in words: the profile's own text, else CiA 301's, else that of the group that it belongs to."""
    for table in (profile or {}, _EMCY_CODES):
        for candidate in (code, code & 0xFFF0, code & 0xFF00, code & 0xF000):
            if candidate in table and (candidate == code or candidate):
                text = table[candidate]
                return text if candidate == code else f"{text} (0x{code:04X})"
    return f"unknown error (0x{code:04X})"


def error_register_text(register: int) -> str:
    """The bits of the error register 0x1001 in words."""
    return (
        ", ".join(name for bit, name in enumerate(_ERROR_REGISTER_BITS) if register >> bit & 1)
        or "none"
    )
