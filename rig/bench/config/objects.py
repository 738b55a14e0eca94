"""Entries of an object dictionary as people write them: "0x6004:0 I32", and numbers in some bytes of one:
"0x2C00:1 U16 at byte 1 of 6".
"""

from __future__ import annotations

import re

from drivers.bus.cia301 import DATA_TYPES, DataType, ObjectRef, Part

_OBJECT = re.compile(
    r"^0[xX]([0-9A-Fa-f]{1,4}):([0-9]{1,3}) +([A-Za-z]+[0-9]*)(?: +at +byte +([0-9]) +of +([1-8]))?$"
)
_LETTERS = {"I": "INTEGER", "U": "UNSIGNED", "R": "REAL", "F": "REAL"}


def read_object(text: str, name: str = "") -> ObjectRef:
    """The entry that a text names: index (hexadecimal), sub-index, type, and where the number is some bytes of the
    object, the first of them (from 0) and how many the object has. Raises `ValueError` for any other text.
    """
    match = _OBJECT.match(text)
    if match is None:
        raise ValueError(
            f'{text!r} is no object; write index, sub-index and type as in "0x6004:0 I32", '
            'or bytes of one as in "0x2C00:1 U16 at byte 1 of 6"'
        )
    index, subindex = int(match[1], 16), int(match[2])
    if subindex > 255:
        raise ValueError(f"the sub-index {subindex} of {text!r} is above 255")
    kind = _data_type(match[3].upper(), text)
    if match[4] is None:
        return ObjectRef(index, subindex, kind, name)
    offset, size = int(match[4]), int(match[5])
    if offset + kind.size > size:
        raise ValueError(f"{kind.name} at byte {offset} in {text!r} ends behind its {size} bytes")
    whole = _data_type(f"U{8 * size}", text)
    return ObjectRef(index, subindex, whole, name, Part(offset, kind))


def _data_type(word: str, text: str) -> DataType:
    spelled = _LETTERS.get(word[0], "") + word[1:] if word[1:].isdigit() else word
    for kind in DATA_TYPES.values():
        if kind.is_number and kind.name == spelled:
            return kind
    names = ", ".join(kind.name for kind in DATA_TYPES.values() if kind.is_number)
    raise ValueError(f"{word!r} in {text!r} is no type; known: {names}, or short I32, U16, R32")
