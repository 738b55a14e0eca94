"""What the HDF5 library and the disk do when something is wrong, turned into one line; and letting
go of a file then.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

import h5py

from rig.errors import RigError, RunFileError

_COPY_REMEDY = (
    "Was it copied completely? A run that was cut off keeps its .part file: see `rig recover`."
)


@contextlib.contextmanager
def refusing_damage(
    path: Path, what: str = "is not a readable run file", remedy: str = _COPY_REMEDY
) -> Iterator[None]:
    """Turn whatever the HDF5 library says about a damaged or foreign file into one line."""
    try:
        yield
    except RigError:
        raise
    except FileNotFoundError as error:
        raise _missing(path) from error
    except PermissionError as error:
        raise RunFileError(
            "may not be read", where=str(path), remedy="Check its permissions."
        ) from error
    except (
        OSError,
        KeyError,
        RuntimeError,
        ValueError,
        TypeError,
        IndexError,
        AttributeError,
        MemoryError,
        OverflowError,
        AssertionError,
    ) as error:
        raise RunFileError(f"{what} ({reason(error)})", where=str(path), remedy=remedy) from error


def refuse_missing(*paths: Path) -> None:
    """Raises `RunFileError` for the first of these that is neither a file nor a folder."""
    for path in paths:
        if not path.exists():
            raise _missing(path)


def _missing(path: Path) -> RunFileError:
    return RunFileError(
        "there is no such file", where=str(path), remedy="Check the path, or list the runs."
    )


def reason(error: BaseException) -> str:
    """The operating system's sentence out of whatever the HDF5 library made of it, in at most one line."""
    match = re.search(r"error message = '([^']*)'", str(error))
    if match:
        return match.group(1)
    text = (
        getattr(error, "strerror", None)
        or " ".join(str(error).strip().strip("'\"").split())
        or type(error).__name__
    )
    return text if len(text) <= 160 else text[:157] + "..."


def close_without_writing(file: h5py.File) -> None:
    """Close a file whose disk has failed, leaving it as its last flush left it.

    Closing writes what is cached. On a full disk that fails half-way and the HDF5 library then crashes when the process
    ends, so its descriptor is pointed at the null device first; that also releases the lock on the file.
    """
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        nowhere = os.open(os.devnull, os.O_RDWR)
        try:
            os.dup2(nowhere, file.id.get_vfd_handle())
        finally:
            os.close(nowhere)
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        file.close()
