"""The object dictionary of a simulated device: one table that the SDO server, the PDO mapping and
the EDS are made from.

Types and access as in CiA 301 section 7.4; abort codes as in table 22 of that standard.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Literal

Access = Literal["ro", "rw", "wo", "const"]


class Abort(IntEnum):
    """SDO abort codes that a slave answers with."""

    TOGGLE = 0x05030000
    TIMEOUT = 0x05040000
    COMMAND = 0x05040001
    OUT_OF_MEMORY = 0x05040005
    ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH = 0x06040042
    PARAMETER = 0x06040043
    HARDWARE = 0x06060000
    LENGTH = 0x06070010
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    VALUE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    STORE = 0x08000020
    LOCAL_CONTROL = 0x08000021
    DEVICE_STATE = 0x08000022
    NO_DATA = 0x08000024


class AbortError(Exception):
    """An SDO access that the device refuses; carries the abort code."""

    def __init__(self, code: Abort) -> None:
        self.code = code
        super().__init__(f"{code.name} (0x{int(code):08X})")


@dataclass(frozen=True)
class DataType:
    """A CiA 301 data type: its EDS code, the struct format ("" for text) and its length in bytes (0: variable)."""

    code: int
    form: str
    length: int


BOOLEAN = DataType(0x01, "<?", 1)
I8 = DataType(0x02, "<b", 1)
I16 = DataType(0x03, "<h", 2)
I32 = DataType(0x04, "<i", 4)
U8 = DataType(0x05, "<B", 1)
U16 = DataType(0x06, "<H", 2)
U32 = DataType(0x07, "<I", 4)
F32 = DataType(0x08, "<f", 4)
TEXT = DataType(0x09, "", 0)

Number = int | float | str


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One sub-object. `low` and `high` bound what may be written; `mappable` "t", "r" or "tr" says into which PDOs."""

    index: int
    sub: int
    name: str
    type: DataType
    access: Access
    default: Number = 0
    mappable: Literal["", "t", "r", "tr"] = ""
    low: float | None = None
    high: float | None = None


def entry(
    index: int,
    sub: int,
    name: str,
    type: DataType,
    access: Access,
    default: Number = 0,
    **bounds: Any,
) -> Entry:
    """One line of a table of objects: what every line has by place, what few have by name."""
    return Entry(
        index=index, sub=sub, name=name, type=type, access=access, default=default, **bounds
    )


def encode(kind: DataType, value: Number) -> bytes:
    """A value as the bytes that travel."""
    if kind is TEXT:
        return str(value).encode("latin-1", "replace")
    return struct.pack(kind.form, value)


def decode(kind: DataType, data: bytes) -> Number:
    """The value in bytes that came; refuses a wrong length."""
    if kind is TEXT:
        return data.decode("latin-1")
    if len(data) > kind.length:
        raise AbortError(Abort.TOO_LONG)
    if len(data) < kind.length:
        raise AbortError(Abort.TOO_SHORT)
    return struct.unpack(kind.form, data)[0]


class ObjectDictionary:
    """The values of a device's objects, with the hooks that make some of them live.

    `on_write(index, sub, hook)`: called with the decoded value before it is stored; may raise `AbortError`.
    `on_read(index, sub, hook)`: its return value is what is read; may raise `AbortError`.
    `on_change(hook)`: called with index and sub-index after a value has been written from outside.
    """

    def __init__(self, entries: Iterable[Entry]) -> None:
        self._entries: dict[tuple[int, int], Entry] = {}
        for entry in entries:
            self._entries[entry.index, entry.sub] = entry
        self._values: dict[tuple[int, int], Number] = {
            k: e.default for k, e in self._entries.items()
        }
        self._writers: dict[tuple[int, int], Callable[[Number], None]] = {}
        self._readers: dict[tuple[int, int], Callable[[], Number]] = {}
        self._watchers: list[Callable[[int, int], None]] = []

    def __iter__(self) -> Iterator[Entry]:
        return iter(sorted(self._entries.values(), key=lambda e: (e.index, e.sub)))

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self._entries

    def entry(self, index: int, sub: int) -> Entry:
        """The definition of an object; aborts with "no such object" or "no such sub-index"."""
        entry = self._entries.get((index, sub))
        if entry is None:
            has_index = any(i == index for i, _ in self._entries)
            raise AbortError(Abort.NO_SUBINDEX if has_index else Abort.NO_OBJECT)
        return entry

    def on_write(self, index: int, sub: int, hook: Callable[[Number], None]) -> None:
        self._writers[index, sub] = hook

    def on_read(self, index: int, sub: int, hook: Callable[[], Number]) -> None:
        self._readers[index, sub] = hook

    def on_change(self, hook: Callable[[int, int], None]) -> None:
        self._watchers.append(hook)

    def value(self, index: int, sub: int = 0) -> Number:
        """The present value, as the device itself sees it."""
        reader = self._readers.get((index, sub))
        return reader() if reader is not None else self._values[index, sub]

    def values(self, keys: Iterable[tuple[int, int]]) -> list[Number]:
        """The present values of several objects, for a frame."""
        readers, values = self._readers, self._values
        return [readers[key]() if key in readers else values[key] for key in keys]

    def number(self, index: int, sub: int = 0) -> int:
        """The present value of an integer object."""
        return int(self.value(index, sub))

    def store(self, index: int, sub: int, value: Number) -> None:
        """Set a value from inside the device: no access check, no hook."""
        self._values[index, sub] = value

    def take_out(self, index: int) -> None:
        """The device has no such object."""
        self._entries = {key: e for key, e in self._entries.items() if key[0] != index}

    def reset(self, indices: Callable[[int], bool]) -> None:
        """Back to the default for every object whose index the predicate names."""
        for key, entry in self._entries.items():
            if indices(key[0]):
                self._values[key] = entry.default

    def upload(self, index: int, sub: int) -> bytes:
        """What an SDO upload answers."""
        entry = self.entry(index, sub)
        if entry.access == "wo":
            raise AbortError(Abort.WRITE_ONLY)
        return encode(entry.type, self.value(index, sub))

    def download(self, index: int, sub: int, data: bytes) -> None:
        """What an SDO download does."""
        entry = self.writable(index, sub)
        self.write(entry, decode(entry.type, data))

    def writable(self, index: int, sub: int) -> Entry:
        """The definition of an object that may be written; aborts if it may not."""
        entry = self.entry(index, sub)
        if entry.access in ("ro", "const"):
            raise AbortError(Abort.READ_ONLY)
        return entry

    def write(self, entry: Entry, value: Number) -> None:
        """Write a decoded value from outside (SDO or RPDO): range, then hook, then store."""
        if not isinstance(value, str):
            if entry.low is not None and value < entry.low:
                raise AbortError(Abort.TOO_LOW)
            if entry.high is not None and value > entry.high:
                raise AbortError(Abort.TOO_HIGH)
        hook = self._writers.get((entry.index, entry.sub))
        if hook is not None:
            hook(value)
        self._values[entry.index, entry.sub] = value
        for watcher in self._watchers:
            watcher(entry.index, entry.sub)


def array(
    index: int, name: str, subs: Iterable[tuple[str, DataType, Access, Number]], **common: object
) -> list[Entry]:
    """An array or record: sub-index 0 with the highest sub-index, then the sub-objects from 1."""
    listed = list(subs)
    head = Entry(
        index=index,
        sub=0,
        name=f"{name}: highest sub-index",
        type=U8,
        access="const",
        default=len(listed),
    )
    rest = [
        replace(
            Entry(index=index, sub=i, name=f"{name}: {n}", type=t, access=a, default=d), **common
        )  # type: ignore[arg-type]
        for i, (n, t, a, d) in enumerate(listed, 1)
    ]
    return [head, *rest]
