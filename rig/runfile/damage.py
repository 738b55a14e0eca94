"""What the HDF5 library and the disk do when something is wrong, turned into one line; and letting go of a file then."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
from collections.abc import Iterator
from pathlib import Path

import h5py
from h5py._objects import phil

from rig.errors import RigError, RunFileError
from rig.runfile.layout import PART_SUFFIX

READ_ATTEMPTS = 22
"""Reads of a block of metadata before it counts as damaged: the last wait is 2 ms."""
COPY_REMEDY = "Was it copied completely? A run that was cut off keeps its .part file: see `rig recover`."


@contextlib.contextmanager
def refusing_damage(path: Path, what: str = "is not a readable run file", remedy: str = COPY_REMEDY) -> Iterator[None]:
    """Turn whatever the HDF5 library says about a damaged or foreign file into one line."""
    try:
        yield
    except RigError:
        raise
    except FileNotFoundError as error:
        raise RunFileError("there is no such file", where=str(path), remedy="Check the path, or list the runs.") from error
    except PermissionError as error:
        raise RunFileError("may not be read", where=str(path), remedy="Check its permissions.") from error
    except (OSError, KeyError, RuntimeError, ValueError, TypeError, IndexError, AttributeError, MemoryError,
            OverflowError, AssertionError) as error:  # fmt: skip
        raise RunFileError(f"{what} ({reason(error)})", where=str(path), remedy=remedy) from error


def open_for_reading(path: Path) -> h5py.File:
    """A run file opened as a SWMR reader where a writer is at work or was killed, plainly otherwise."""
    with refusing_damage(path):
        if path.is_dir():
            raise RunFileError("is a folder, not a run file", where=str(path))
        with path.open("rb") as stream:
            head = stream.read(8)
        if head != b"\x89HDF\r\n\x1a\n":
            raise RunFileError(
                "is empty" if not head else "is not an HDF5 file", where=str(path),
                remedy="Import a recording of another rig with `rig import`.",
            )  # fmt: skip
        if path.name.endswith(PART_SUFFIX):
            return _open_growing(path)
        # Another driver than that of a growing file: where one process holds a run open as growing and opens it again sealed,
        # the library takes both for one file and hands out the wrong chunks, in silence.
        return h5py.File(path, "r", driver="stdio")
    raise AssertionError


def _open_growing(path: Path) -> h5py.File:
    """A file that is being written, or whose writer was killed.

    The HDF5 library repeats a failed read of such a file a hundred times and doubles its wait each time: on a damaged one it
    would never come back. A writer at work is caught up with in a few of these attempts.
    """
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    library = ctypes.CDLL(h5py.h5p.__file__)
    with contextlib.suppress(AttributeError):  # Where the symbol cannot be reached the library's own patience stays.
        limit_attempts = library.H5Pset_metadata_read_attempts
        limit_attempts.argtypes, limit_attempts.restype = (ctypes.c_int64, ctypes.c_uint), ctypes.c_int
        # The library is not made for threads: h5py takes turns by this lock, and whoever goes past it has to take it as well.
        with phil:
            limit_attempts(access.id, READ_ATTEMPTS)
    flags = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
    return h5py.File(h5py.h5f.open(os.fsencode(path), flags, access))


def reason(error: BaseException) -> str:
    """The operating system's sentence out of whatever the HDF5 library made of it, in at most one line."""
    found = re.search(r"error message = '([^']*)'", str(error))
    if found:
        return found.group(1)
    text = getattr(error, "strerror", None) or " ".join(str(error).strip().strip("'\"").split()) or type(error).__name__
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
