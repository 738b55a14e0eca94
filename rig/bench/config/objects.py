"""Entries of an object dictionary as people write them: "0x6004:0 I32"."""

from __future__ import annotations

import re

from drivers.bus.cia301 import DATA_TYPES, DataType, ObjectRef

_OBJECT = re.compile(r"^0[xX]([0-9A-Fa-f]{1,4}):([0-9]{1,3}) +([A-Za-z]+[0-9]*)$")
_LETTERS = {"I": "INTEGER", "U": "UNSIGNED", "R": "REAL", "F": "REAL"}


def read_object(text: str, name: str = "") -> ObjectRef:
    """The entry that a text names: index (hexadecimal), sub-index, type. Raises `ValueError` for any other text."""
    match = _OBJECT.match(text)
    if match is None:
        raise ValueError(
            f'{text!r} is no object; write index, sub-index and type as in "0x6004:0 I32"'
        )
    index, subindex = int(match[1], 16), int(match[2])
    if subindex > 255:
        raise ValueError(f"the sub-index {subindex} of {text!r} is above 255")
    return ObjectRef(index, subindex, _data_type(match[3].upper(), text), name)


def _data_type(word: str, text: str) -> DataType:
    spelled = _LETTERS.get(word[0], "") + word[1:] if word[1:].isdigit() else word
    for kind in DATA_TYPES.values():
        if kind.is_number and kind.name == spelled:
            return kind
    names = ", ".join(kind.name for kind in DATA_TYPES.values() if kind.is_number)
    raise ValueError(f"{word!r} in {text!r} is no type; known: {names}, or short I32, U16, R32")
