"""Names that no file may have on one of the systems that people carry folders between.

Windows keeps CON, NUL, COM1 and the like for devices, whatever suffix stands behind them, and drops a dot or a blank at
the end. They are refused, or written otherwise, on every system: a folder of runs is copied from one to another.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path, PurePath
from typing import Final

_DEVICES = frozenset(
    {"CON", "PRN", "AUX", "NUL", *(f"{port}{n}" for port in ("COM", "LPT") for n in range(1, 10))}
)


_LONGEST_ON_WINDOWS: Final = 259
"""Letters of a whole path, where long ones are not switched on."""
_BESIDE: Final = 40
"""Letters that names beside a file have more than its own: analyses, notes, frames, exports."""


def too_long(path: Path) -> str:
    """Why a file, and what comes to lie beside it, cannot be had on this system for its length; "" where it can."""
    if os.name != "nt":
        return ""
    letters = len(os.path.abspath(path)) + _BESIDE
    if letters <= _LONGEST_ON_WINDOWS:
        return ""
    return f"its path, and what lies beside it, would have {letters} letters, allowed {_LONGEST_ON_WINDOWS}"


def is_device(name: str) -> bool:
    """Whether a name is one of a device of Windows: CON, con.pdf, com1.tar.gz."""
    return name.partition(".")[0].rstrip(" ").upper() in _DEVICES


def unportable(path: PurePath) -> str:
    """Why a path cannot be had on every system, in words; "" where it can."""
    for part in _names(path):
        if is_device(part):
            return f"{part} is the name of a device on Windows"
        if part.strip(".") and part != part.rstrip(". "):
            return f"{part!r} ends with a dot or a blank, which Windows drops"
    return ""


def _names(path: PurePath) -> Iterable[str]:
    return (part for part in path.parts if part != path.anchor)
