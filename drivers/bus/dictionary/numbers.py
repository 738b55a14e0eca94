"""Numbers and texts as they stand in EDS and DCF files: in vendors' spellings, with `$NODEID`, comments and quotes."""

from __future__ import annotations

import math
import re
from typing import Final

from drivers.bus.cia301 import DataType

_NUMBER = re.compile(r"^([+-]?)(0x[0-9a-f]+|[0-9a-f]+h|[0-9]+)(?:\.0*|u?l{0,2})$")
_LOOSE: Final = str.maketrans("|", "+", " ()")
_TERM = re.compile(r"([+-]?)([^+-]+)")
_TERMS = re.compile(r"[+-]?[^+-]+(?:[+-][^+-]+)*[+]?")
NODE_ID = re.compile(r"\$?node_?id", re.IGNORECASE)
_YES: Final = {"yes": 1, "true": 1, "no": 0, "false": 0}


def integer(text: str) -> int | None:
    """A number as vendors write it (0x1F, 1Fh, 31, 31UL, 31.0, 037 octal, 08 decimal after all, yes), or None."""
    token = bare(text).replace(" ", "").replace("_", "").lower()
    if token in _YES:
        return _YES[token]
    match = _NUMBER.match(token) if len(token) <= 64 else None
    if match is None:
        return None
    sign, digits = (-1 if match[1] == "-" else 1), match[2]
    if digits.startswith("0x"):
        return sign * int(digits, 16)
    if digits.endswith("h"):
        return sign * int(digits[:-1], 16)
    if not digits.isdigit():
        return None
    if len(digits) > 1 and digits[0] == "0" and all(d in "01234567" for d in digits):
        return sign * int(digits, 8)
    return sign * int(digits)


def value_of(
    text: str | None, data_type: DataType, node_id: int | None
) -> int | float | str | None:
    """A default or configured value: a number for numbers ($NODEID resolved), else the text itself."""
    if text is None or text == "":
        return None
    if not data_type.is_number:
        return unquoted(text)
    return number_of(text, data_type, node_id)


def bare(text: str) -> str:
    """A value without what vendors put around it: comments and quotes."""
    for mark in (";", "//", "#"):
        text = text.split(mark)[0]
    return unquoted(text.strip())


def unquoted(text: str) -> str:
    """A text without the quotes around it."""
    return text[1:-1] if len(text) >= 2 and text[0] == text[-1] and text[0] in "\"'" else text


def number_of(text: str | None, data_type: DataType, node_id: int | None) -> int | float | None:
    """A number of the entry's type: $NODEID resolved, hexadecimal negatives in two's complement, IEEE floats as hex."""
    if text is None:
        return None
    spelled = bare(text)
    if data_type.is_float:
        return _real(spelled, data_type)
    number = _sum(spelled, node_id)
    if number is None:
        return None
    bits = data_type.size * 8
    if data_type.signed and bits and (1 << (bits - 1)) <= number < (1 << bits):
        number -= 1 << bits
    return number


def _sum(spelled: str, node_id: int | None) -> int | None:
    """A number, or a sum of numbers and of the node-ID: $NODEID+0x180, 0x80000180 + $NodeId, NODEID+384."""
    terms = NODE_ID.sub("n", spelled).translate(_LOOSE)
    if len(terms) > 64 or not _TERMS.fullmatch(terms):
        return None
    total = 0
    for sign, term in _TERM.findall(terms):
        value = node_id if term == "n" else integer(term)
        if value is None:
            return None
        total += -value if sign == "-" else value
    return total


def _real(spelled: str, data_type: DataType) -> float | None:
    number = integer(spelled) if spelled.lower().startswith("0x") else None
    if number is not None:
        return (
            float(data_type.decode(number.to_bytes(8, "little"))) if 0 <= number < 1 << 64 else None
        )
    try:
        value = float(spelled)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
