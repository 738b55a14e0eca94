"""A file of JSON that the process which wrote it holds locked: whoever reads it knows whether that process lives.

The lock is the operating system's and goes with the process, however that ends. The first byte of
the file is blank: where a lock keeps readers out (Windows) it keeps them out of that byte alone.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

GLANCES, GLANCE_S = 6, 0.01
"""Looks at a lock before it counts as held, and s between two: whoever else only looks holds it for less."""


class HeldFile:
    """One file, open and locked by this process. Every method raises `OSError`, but `close`."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self._descriptor: int | None = descriptor

    @classmethod
    def hold(cls, path: Path, *, new: bool = False) -> HeldFile | None:
        """Open and lock a file; None where another process holds it.

        `new`: the file must not exist yet. One that exists may be another user's.
        """
        from filelock import lock_descriptor

        descriptor = _opened(path, os.O_CREAT | (os.O_EXCL if new else 0))
        try:
            # Of a new file another process can have a glance only; that is waited for.
            if lock_descriptor(descriptor, blocking=new, poll_interval=GLANCE_S):
                return cls(path, descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        return None

    def write(self, content: Mapping[str, Any]) -> None:
        """Replace what the file says, and bring it to the disk with its name."""
        assert self._descriptor is not None
        os.ftruncate(self._descriptor, 0)
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, f"\n{json.dumps(content, indent=2)}\n".encode())
        os.fsync(self._descriptor)
        synchronise_folder(self.path.parent)

    def remove(self) -> None:
        """Take the file away and let go of it. At once where a name can go before its lock."""
        if self._descriptor is None:
            return
        if os.name == "nt":
            self.close()
        self.path.unlink(missing_ok=True)
        synchronise_folder(self.path.parent)
        self.close()

    def close(self) -> None:
        """Let go of the file and leave it as it is; once is enough."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with contextlib.suppress(OSError):
                os.close(descriptor)


def is_held(path: Path) -> bool:
    """Whether a living process holds a file. Raises `OSError` where nobody can tell."""
    from filelock import lock_descriptor

    descriptor = _opened(path)
    try:
        for _ in range(GLANCES):
            if lock_descriptor(descriptor, blocking=False):
                return False
            time.sleep(GLANCE_S)
        return True
    finally:
        os.close(descriptor)


def read_held(path: Path) -> dict[str, Any]:
    """What a held file says; {} while its process has not written it yet. Raises `OSError`, `ValueError`."""
    with path.open("rb") as stream:
        stream.seek(1)
        text = stream.read()
    content = json.loads(text or b"{}")
    if not isinstance(content, dict):
        raise ValueError("is no object of JSON")
    return content


def synchronise_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk, where folders can be opened (not on Windows)."""
    if sys.platform == "win32":
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _opened(path: Path, creating: int = 0) -> int:
    """A descriptor to be locked; for everybody who may use the folder, whatever this user's mask."""
    try:
        descriptor = os.open(path, os.O_RDWR | creating, 0o666)
    except PermissionError:
        # Another user's file: it can be locked all the same.
        return os.open(path, os.O_RDONLY)
    if creating and sys.platform != "win32":
        with contextlib.suppress(OSError):
            os.fchmod(descriptor, 0o666)
    return descriptor
