"""A vendor's EDS or DCF file by two readers: the canopen library, and our tolerant one where it refuses or falls short.

The library refuses a whole file for one wrong line, and keeps silent about values that it does not
understand; `drivers.bus.dictionary.eds` survives both and lists them. From the library are taken type, access,
mapping and every number that the type can hold. What it leaves out, texts and defects are the
tolerant reader's. Numbers that the two read differently are told among the defects.
"""

from __future__ import annotations

import io
import logging
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

from drivers.bus.cia301 import DATA_TYPES, DataType, object_text
from drivers.bus.dictionary.eds import DeviceDescription, EdsEntry, file_bytes, parse_eds, text_of

if TYPE_CHECKING:
    from canopen.objectdictionary import ObjectDictionary, ODVariable

_LONGEST_TEXT: Final = 4 << 20
"""Characters of a file that the library is given at most: its parser takes seconds for more."""
_LARGEST_COUNT: Final = 254
"""Sub-objects that a compact array can count: the library would count to any number."""
_FIRST_OBJECT: Final = 0x20
"""Below lie the dummy types."""
_COUNTS = re.compile(r"^\s*NrOfEntries\s*[=:]\s*(\S+)", re.MULTILINE)
_QUIET: Final = logging.NullHandler()
"""Keeps the library's log off the terminal: what is worth telling stands among the defects."""


def load_device_file(path: str | Path, node_id: int | None = None) -> DeviceDescription:
    """The description in a file. Raises `DriverError` when it cannot be read or describes nothing."""
    return read_device_file(file_bytes(path), node_id, where=str(path))


def read_device_file(
    data: bytes, node_id: int | None = None, *, where: str = "EDS"
) -> DeviceDescription:
    """The description in the bytes of a file; `node_id` is what `$NODEID` stands for. Raises `DecodeError`."""
    tolerant = parse_eds(data, node_id, where=where)
    try:
        variables = _library_variables(text_of(data, []), node_id)
    except Exception as error:  # noqa: BLE001  a parser of whatever a vendor wrote may raise anything
        reason = f"{type(error).__name__}: {' '.join(str(error).split())[:80]}"
        told = f"canopen refuses the file ({reason}); read by the tolerant reader alone"
        return replace(tolerant, defects=(*tolerant.defects, told))
    entries, differences = dict(tolerant.entries), list[str]()
    for key, variable in variables.items():
        own = tolerant.entries.get(key)
        if own is not None:
            entries[key] = _completed(variable, own)
            differences += _differences(entries[key], own)
    return replace(tolerant, entries=entries, defects=(*tolerant.defects, *differences))


def _library_variables(text: str, node_id: int | None) -> dict[tuple[int, int], ODVariable]:
    """The library's variables by (index, sub-index). Raises whatever it raises, `ValueError` for what it is spared."""
    from drivers.python_can import without_log_files

    with without_log_files():
        from canopen import import_od

    logging.getLogger("canopen").addHandler(_QUIET)
    if len(text) > _LONGEST_TEXT or any(int(n, 0) > _LARGEST_COUNT for n in _COUNTS.findall(text)):
        raise ValueError("too large for it")
    source = io.StringIO(text)
    # By its name the library tells what it is; a DCF is read as an EDS is.
    source.name = "device.eds"  # type: ignore[attr-defined]
    variables = _variables(import_od(source, node_id))
    return {(v.index, v.subindex): v for v in variables if v.index >= _FIRST_OBJECT}


def _variables(dictionary: ObjectDictionary) -> Iterator[ODVariable]:
    from canopen.objectdictionary import ODArray, ODRecord, ODVariable

    for entry in cast("Mapping[int, object]", dictionary).values():
        if isinstance(entry, ODVariable):
            yield entry
        elif isinstance(entry, ODArray | ODRecord):
            yield from cast("Mapping[int, ODVariable]", entry).values()


def _completed(variable: ODVariable, own: EdsEntry) -> EdsEntry:
    """The entry as the library has it; from the tolerant reader what the library leaves out."""
    data_type = DATA_TYPES.get(variable.data_type or 0, own.data_type)
    entry = replace(own, data_type=data_type, is_pdo_mappable=variable.pdo_mappable)
    if not data_type.is_number:
        return entry
    is_retyped = not own.data_type.is_number
    read = {
        "default": variable.default,
        "configured": variable.value,
        "low": variable.min,
        "high": variable.max,
    }
    # What the tolerant reader left out on purpose (limits that contradict each other) stays out.
    return replace(
        entry,
        **{
            name: value
            for name, value in read.items()
            if _can_hold(data_type, value) and (is_retyped or getattr(own, name) is not None)
        },
    )


def _can_hold(data_type: DataType, value: object) -> bool:
    """Whether it is a number of the type: the library takes 0xFFFF of a signed type for 65535."""
    if data_type.is_float:
        return isinstance(value, float) and math.isfinite(value)
    bits = data_type.size * 8
    low, high = (-(1 << bits - 1), 1 << bits - 1) if data_type.signed else (0, 1 << bits)
    return isinstance(value, int) and low <= value < high


def _differences(entry: EdsEntry, own: EdsEntry) -> list[str]:
    where = object_text(*own.ref.key)
    return [
        f"{where}: {name} is {getattr(entry, name)} by canopen, {getattr(own, name)} by the tolerant reader"
        for name in ("data_type", "default", "configured", "low", "high")
        if getattr(entry, name) != getattr(own, name)
    ]
