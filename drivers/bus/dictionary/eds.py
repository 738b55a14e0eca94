"""Vendors' EDS and DCF files (CiA 306): what a device says that it has. Tolerant of their defects, which it lists.

The canopen library reads them too, and first: `drivers.bus.dictionary.device_file`. It refuses what is read here.

A file is read line by line and never refused for a single wrong entry: an empty `VendorNumber`, a
comment count that does not match, an empty `PDOMapping`, sub-objects without their object, foreign
encodings. What could not be understood stands in `DeviceDescription.defects`; only a file in which
no object at all is described is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from drivers.bus.cia301 import DATA_TYPES, DataType, ObjectRef, data_type_named, object_text
from drivers.bus.dictionary.numbers import NODE_ID, bare, integer, number_of, unquoted, value_of
from drivers.errors import DecodeError, DriverError

_OBJECT = re.compile(r"^(?:0x)?([0-9a-f]{1,4})(?:\s*sub\s*(?:0x)?([0-9a-f]{1,2}))?$")
_COMPACT = re.compile(r"^(?:0x)?([0-9a-f]{1,4})(name|value)$")
_LIKE_AN_OBJECT = re.compile(r"^\W*(?:0x)?[0-9a-f]{4}(?!.*(?:denotation|objectlinks)$)")
_OBJECT_TYPES: Final = {
    "domain": 2,
    "deftype": 5,
    "defstruct": 6,
    "var": 7,
    "array": 8,
    "record": 9,
}
_ACCESS: Final = {
    "ro": "ro",
    "wo": "wo",
    "rw": "rw",
    "rwr": "rwr",
    "rww": "rww",
    "const": "const",
    "r": "ro",
    "w": "wo",
    "r/w": "rw",
    "constant": "const",
    "read": "ro",
    "readonly": "ro",
    "read only": "ro",
    "writeonly": "wo",
    "write only": "wo",
    "readwrite": "rw",
    "read/write": "rw",
    "wr": "rw",
}
"""Access types, and how they are spelled elsewhere."""
_LONGEST_FILE: Final = 32 << 20
_MOST_COMPACT: Final = 254
_MOST_ENTRIES: Final = 100_000
"""Entries that are taken from one file: more than any device has, and few enough for any memory."""
_DEFECTS_KEPT: Final = 1000
_DOMAIN: Final = 0x0F
_WHAT_IT_IS: Final = "Is this an EDS or DCF file (text with sections like [1000])?"
_XML: Final = "This is XML (XDD, CiA 311): ask for the EDS of the device."
_BIT_RATES: Final = (10, 20, 50, 125, 250, 500, 800, 1000)
"""kbit/s that a file can claim."""

Section = dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class EdsEntry:
    """One entry of the object dictionary as the file describes it; numbers are None where the file gives none."""

    index: int
    subindex: int
    name: str
    data_type: DataType
    access: str
    is_pdo_mappable: bool
    default: int | float | str | None = None
    configured: int | float | str | None = None
    low: int | float | None = None
    high: int | float | None = None

    @property
    def ref(self) -> ObjectRef:
        """The entry as a reference."""
        return ObjectRef(self.index, self.subindex, self.data_type, self.name)


@dataclass(frozen=True, kw_only=True)
class DeviceDescription:
    """What an EDS or DCF says of a device: who made it, its entries by (index, sub-index), and the file's defects."""

    vendor_name: str = ""
    vendor_number: int | None = None
    product_name: str = ""
    product_number: int | None = None
    revision_number: int | None = None
    bit_rates: tuple[int, ...] = ()
    entries: Mapping[tuple[int, int], EdsEntry] = field(
        default_factory=dict[tuple[int, int], EdsEntry]
    )
    defects: tuple[str, ...] = ()

    def entry(self, index: int, subindex: int = 0) -> EdsEntry | None:
        """The entry, or None if the file does not describe it."""
        return self.entries.get((index, subindex))


def file_bytes(path: str | Path) -> bytes:
    """The bytes of an EDS or DCF file. Raises `DriverError` when it cannot be read or is none."""
    try:
        if Path(path).exists() and not Path(path).is_file() and not Path(path).is_dir():
            # A pipe or a device could be waited for without end.
            raise DriverError("this is not a file", where=str(path), remedy=_WHAT_IT_IS)
        if Path(path).stat().st_size > _LONGEST_FILE:
            raise DriverError(
                "this is not an EDS file",
                where=str(path),
                limit=f"at most {_LONGEST_FILE >> 20} MiB",
            )
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise DriverError(f"the EDS file cannot be read: {error}", where=str(path)) from error


def parse_eds(
    data: bytes | str, node_id: int | None = None, *, where: str = "EDS"
) -> DeviceDescription:
    """The description in the bytes of a file; `node_id` is what `$NODEID` stands for. Raises `DecodeError`."""
    defects: list[str] = []
    sections = _sections(data if isinstance(data, str) else text_of(data, defects), defects)
    entries = _objects(sections, _node_of(sections) if node_id is None else node_id, defects)
    if not entries:
        remedy = _XML if _is_xml(data) else _WHAT_IT_IS
        raise DecodeError("no object is described in it", where=where, remedy=remedy)
    _check_lists(sections, entries, defects)
    info = sections.get("deviceinfo", {})
    _check_info(info, defects)
    return DeviceDescription(
        vendor_name=unquoted(info.get("vendorname", "")),
        vendor_number=integer(info.get("vendornumber", "")),
        product_name=unquoted(info.get("productname", "")),
        product_number=integer(info.get("productnumber", "")),
        revision_number=integer(info.get("revisionnumber", "")),
        bit_rates=tuple(r * 1000 for r in _BIT_RATES if integer(info.get(f"baudrate_{r}", ""))),
        entries=entries,
        defects=tuple(defects[:_DEFECTS_KEPT]),
    )


def _node_of(sections: Mapping[str, Section]) -> int | None:
    """The node's number as the file has it; the standard spells its section with one m, not every tool does."""
    named = sections.get("devicecomissioning") or sections.get("devicecommissioning") or {}
    return integer(named.get("nodeid", ""))


def _objects(
    sections: Mapping[str, Section], node_id: int | None, defects: list[str]
) -> dict[tuple[int, int], EdsEntry]:
    """Every object and sub-object that is described, compact lists filled in."""
    entries: dict[tuple[int, int], EdsEntry] = {}
    matches = [
        (match, section) for name, section in sections.items() if (match := _OBJECT.match(name))
    ]
    # Objects before their sub-objects, which say more, wherever they stand.
    matches.sort(key=lambda match: match[0][2] is not None)
    _check_families(matches, defects)
    defects += [
        f"section [{name[:40]}] is not an object's"
        for name in sections
        if _LIKE_AN_OBJECT.match(name) and not _OBJECT.match(name) and not _COMPACT.match(name)
    ]
    for match, section in matches:
        if len(entries) >= _MOST_ENTRIES:
            defects.insert(0, f"only the first {_MOST_ENTRIES} entries were taken")
            break
        _take_object(int(match[1], 16), match[2], section, node_id, entries, defects)
    for name, section in sections.items():
        if match := _COMPACT.match(name):
            rename_or_fill = _rename_compact if match[2] == "name" else _fill_compact
            rename_or_fill(int(match[1], 16), section, entries, node_id)
    return entries


def _is_xml(data: bytes | str) -> bool:
    """Whether it begins as XML does."""
    start = data.encode("utf-8", "replace") if isinstance(data, str) else data
    return start.lstrip(b"\xef\xbb\xbf \r\n").startswith(b"<")


def _check_info(info: Section, defects: list[str]) -> None:
    """What is missing, or no number, of the section about the device."""
    if not info:
        defects.append("[DeviceInfo] is missing")
    for key in ("vendornumber", "productnumber", "revisionnumber"):
        if key in info and integer(info[key]) is None:
            defects.append(f"[DeviceInfo] {key} is {info[key]!r}, not a number")


def text_of(data: bytes, defects: list[str]) -> str:
    """Bytes as text: by the byte order mark, else UTF-8, else what Windows editors write."""
    for mark, encoding in (
        (b"\xef\xbb\xbf", "utf-8"),
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
    ):
        if data.startswith(mark):
            return data[len(mark) :].decode(encoding, "replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        defects.append("the file is neither ASCII nor UTF-8; read as Windows-1252")
        return data.decode("cp1252", "replace")


def _sections(text: str, defects: list[str]) -> dict[str, Section]:
    """Sections by lower-case name, each with its values by lower-case key; of doubled keys the last one holds."""
    sections: dict[str, Section] = {}
    current: Section | None = None
    for number, raw in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        line = raw.strip(" \t\0\f\v\ufeff\x1a")
        if not line or line[0] in ";#" or line.startswith("//"):
            continue
        if line[0] == "[":
            name = line[1:].split("]")[0].strip().lower()
            if name in sections:
                defects.append(f"line {number}: section [{name}] stands twice; merged")
            current = sections.setdefault(name, {})
        elif "=" not in line or current is None:
            if len(defects) < _DEFECTS_KEPT:
                defects.append(f"line {number}: neither a section nor a value: {line[:40]!r}")
        else:
            key, value = (part.strip() for part in line.split("=", 1))
            if current.get(key.lower(), value) != value and len(defects) < _DEFECTS_KEPT:
                defects.append(
                    f"line {number}: {key} stands twice in its section; the last one holds"
                )
            current[key.lower()] = value
    return sections


def _check_families(matches: Sequence[tuple[re.Match[str], Section]], defects: list[str]) -> None:
    """Note sub-objects without their object, and objects whose sub-objects are not those that they count."""
    families: dict[int, set[int]] = {}
    for match, _ in matches:
        subs = families.setdefault(int(match[1], 16), set())
        if match[2] is not None:
            subs.add(int(match[2], 16))
    parents = {int(match[1], 16): section for match, section in matches if match[2] is None}
    for index, subs in families.items():
        section = parents.get(index)
        if section is None:
            defects += [
                f"{object_text(index, sub)}: a sub-object without its object"
                for sub in sorted(subs)
            ]
            continue
        if _object_type(section.get("objecttype", "7")) not in (8, 9) or integer(
            section.get("compactsubobj", "")
        ):
            continue
        counted = integer(section.get("subnumber", ""))
        if not subs:
            defects.append(f"0x{index:04X}: an array or record without sub-objects")
        elif 0 not in subs:
            defects.append(f"0x{index:04X}: its sub-index 0 is not described")
        elif counted is not None and counted != len(subs):
            defects.append(f"0x{index:04X}: counts {counted} sub-objects, describes {len(subs)}")


def _take_object(
    index: int,
    sub: str | None,
    section: Section,
    node_id: int | None,
    entries: dict[tuple[int, int], EdsEntry],
    defects: list[str],
) -> None:
    """Take an object's or a sub-object's section into `entries`."""
    subindex = int(sub, 16) if sub is not None else 0
    where = object_text(index, subindex)
    if sub is None:
        object_type = _object_type(section.get("objecttype", "7"))
        if object_type is None:
            defects.append(f"{where}: objecttype is {section['objecttype']!r}; taken as VAR")
        if compact := _number_or(section, "compactsubobj", 0, where, defects):
            count = max(0, min(int(compact), _MOST_COMPACT))
            entries[index, 0] = EdsEntry(
                index=index,
                subindex=0,
                name="Number of entries",
                data_type=DATA_TYPES[0x05],
                access="ro",
                is_pdo_mappable=False,
                default=count,
            )
            each = _entry(index, 1, section, node_id, defects)
            entries.update(
                {(index, number): replace(each, subindex=number) for number in range(1, count + 1)}
            )
            return
        if object_type in (8, 9):
            return
    entries[index, subindex] = _entry(index, subindex, section, node_id, defects)


def _entry(
    index: int, subindex: int, section: Section, node_id: int | None, defects: list[str]
) -> EdsEntry:
    where = object_text(index, subindex)
    data_type = _data_type(section.get("datatype", ""))
    if data_type is None:
        if _object_type(section.get("objecttype", "7")) != 2:
            defects.append(
                f"{where}: data type {section.get('datatype', 'missing')!r} is not known; taken as DOMAIN"
            )
        data_type = DATA_TYPES[_DOMAIN]
    spelled = " ".join(bare(section.get("accesstype", "")).lower().split())
    access = _ACCESS.get(spelled, "rw")
    if access != spelled:
        defects.append(f"{where}: access type {spelled!r}; taken as {access}")
    if data_type.is_number:
        _check_numbers(section, data_type, node_id, where, defects)
    low, high = (
        number_of(section.get(key), data_type, node_id) for key in ("lowlimit", "highlimit")
    )
    if low is not None and high is not None and low > high:
        defects.append(
            f"{where}: its lowest value {low} is above its highest {high}; both left out"
        )
        low = high = None
    return EdsEntry(
        index=index,
        subindex=subindex,
        name=unquoted(section.get("parametername", "")),
        data_type=data_type,
        access=access,
        is_pdo_mappable=bool(_number_or(section, "pdomapping", 0, where, defects)),
        default=value_of(section.get("defaultvalue"), data_type, node_id),
        configured=value_of(section.get("parametervalue"), data_type, node_id),
        low=low,
        high=high,
    )


def _check_numbers(
    section: Section, data_type: DataType, node_id: int | None, where: str, defects: list[str]
) -> None:
    """Note values and limits that are no numbers, or that the entry cannot hold."""
    for key in ("defaultvalue", "parametervalue", "lowlimit", "highlimit"):
        text = section.get(key, "")
        if not bare(text) or (node_id is None and NODE_ID.search(text)):
            continue
        number = number_of(text, data_type, node_id)
        if number is None:
            defects.append(f"{where}: {key} is {text[:40]!r}, not a number; left out")
        elif (
            not data_type.is_float
            and not -(1 << data_type.size * 8 - 1) <= number < 1 << data_type.size * 8
        ):
            defects.append(f"{where}: {key} is {text[:40]!r}, which {data_type.name} cannot hold")


def _data_type(text: str) -> DataType | None:
    """The data type by its code, or by its name as some tools write it."""
    code = integer(text)
    if code is not None:
        return DATA_TYPES.get(code)
    try:
        return data_type_named(bare(text))
    except DriverError:
        return None


def _object_type(text: str) -> int | None:
    """The kind of object by its code, or by its name as some tools write it."""
    number = integer(text)
    return number if number is not None else _OBJECT_TYPES.get(bare(text).lower())


def _rename_compact(
    index: int, section: Section, entries: dict[tuple[int, int], EdsEntry], node_id: int | None
) -> None:
    """Give the sub-objects of a compact array the names of its [xxxxName] section."""
    for key, name in section.items():
        subindex = integer(key)
        entry = entries.get((index, subindex)) if subindex is not None else None
        if entry is not None and subindex:
            entries[index, subindex] = EdsEntry(
                index=index,
                subindex=subindex,
                name=name,
                data_type=entry.data_type,
                access=entry.access,
                is_pdo_mappable=entry.is_pdo_mappable,
                default=entry.default,
                configured=entry.configured,
                low=entry.low,
                high=entry.high,
            )


def _fill_compact(
    index: int, section: Section, entries: dict[tuple[int, int], EdsEntry], node_id: int | None
) -> None:
    """Give the sub-objects of a compact array the configured values of its [xxxxValue] section."""
    for key, text in section.items():
        subindex = integer(key)
        entry = entries.get((index, subindex)) if subindex is not None else None
        if entry is not None and subindex:
            entries[index, subindex] = EdsEntry(
                index=index,
                subindex=subindex,
                name=entry.name,
                data_type=entry.data_type,
                access=entry.access,
                is_pdo_mappable=entry.is_pdo_mappable,
                default=entry.default,
                configured=value_of(text, entry.data_type, node_id),
                low=entry.low,
                high=entry.high,
            )


def _check_lists(
    sections: Mapping[str, Section], entries: Mapping[tuple[int, int], EdsEntry], defects: list[str]
) -> None:
    """Note what the file's own lists and counts get wrong."""
    described = {index for index, _ in entries}
    for name in ("mandatoryobjects", "optionalobjects", "manufacturerobjects"):
        section = sections.get(name)
        if section is None:
            defects.append(f"[{name}] is missing")
            continue
        listed = [integer(value) for key, value in section.items() if key.isdigit()]
        if integer(section.get("supportedobjects", "")) != len(listed):
            defects.append(
                f"[{name}] counts {section.get('supportedobjects', 'nothing')!r} objects, lists {len(listed)}"
            )
        for index in listed:
            if index is not None and index not in described:
                defects.append(f"[{name}] lists 0x{index:04X}, which is not described")
    comments = sections.get("comments", {})
    lines = sum(1 for key in comments if key.startswith("line") and key != "lines")
    if comments and integer(comments.get("lines", "")) != lines:
        defects.append(f"[comments] counts {comments.get('lines', 'nothing')!r} lines, has {lines}")


def _number_or(section: Section, key: str, fallback: int, where: str, defects: list[str]) -> int:
    text = section.get(key)
    if text is None:
        return fallback
    number = integer(text)
    if number is None:
        defects.append(f"{where}: {key} is {text!r}; taken as {fallback}")
        return fallback
    return number
