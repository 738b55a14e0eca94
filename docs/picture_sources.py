"""From which sources the pictures of the window were made, so that none is older than the window without a word."""

from __future__ import annotations

import hashlib
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parent / "rig" / "window"
KEPT = HERE / "picture_sources.sha256"


def digest() -> str:
    """SHA-256 over what stands in the window's files, but for empty lines and comments of a line of their own."""
    found = hashlib.sha256()
    for path in sorted(SOURCES.rglob("*.py")):
        lines = (line.rstrip() for line in path.read_text(encoding="utf-8").splitlines())
        code = "\n".join(line for line in lines if line and not line.lstrip().startswith("#"))
        found.update(f"{path.relative_to(SOURCES).as_posix()}\n{code}\n".encode())
    return found.hexdigest()


def keep() -> None:
    """Note from what the pictures that have just been made were made."""
    KEPT.write_text(f"{digest()}\n", encoding="utf-8")


def are_new() -> bool:
    """Whether the pictures were made from the window as it is."""
    return KEPT.read_text(encoding="utf-8").strip() == digest()
