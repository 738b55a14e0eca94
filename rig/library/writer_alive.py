"""Whether somebody is still writing a file, asked without disturbing whoever writes."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from rig.errors import RunFileError

_LOCKS = Path("/proc/locks")
"""Where Linux tells which files are locked."""


def is_being_written(part: Path) -> bool:
    """Whether a living writer holds a `.part` file.

    The writer's mark is a shared lock. Trying to lock the file could come between a writer and its
    mark at the very moment that it begins, so the system's list of locks is read first; only where
    that does not name the file is a lock tried, as on file systems that are shared by several
    computers.
    """
    return _is_listed(part) or _is_held(part)


def _is_listed(part: Path) -> bool:
    if sys.platform == "win32":
        return False
    try:
        status = os.stat(part)
        locks = _LOCKS.read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    number = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    return any("FLOCK" in line and number in line.split() for line in locks.splitlines())


def _is_held(part: Path) -> bool:
    from rig.runfile.seal import refuse_live

    try:
        refuse_live(part)
    except RunFileError:
        return True
    return False
