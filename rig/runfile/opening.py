"""Run files opened for reading; one that still grows is opened once in a process, and all its readers share it.

The HDF5 library loses the place of a column's chunks when the column is looked at anew
(`H5Drefresh`) while the same process has it open a second time: from then on every row is read from
the first chunk, in silence. So a growing file is opened once, each of its columns once, and its
readers take turns by one lock.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import h5py
from h5py._objects import phil

from rig.content.phrase import quoted
from rig.errors import RunFileError
from rig.runfile.damage import refusing_damage
from rig.runfile.layout import PART_SUFFIX
from rig.runfile.structure import refuse_foreign_structure

_READ_ATTEMPTS = 22
"""Reads of a block of metadata before it counts as damaged: the last wait is 2 ms."""

_FileNumber = tuple[int, int]
"""Device and number of a file: what it is, whatever it is called."""


@dataclass
class _Shared:
    """One opened file, how many readers it has, and the datasets that they read."""

    file: h5py.File
    number: _FileNumber | None = None
    readers: int = 1
    lock: threading.RLock = field(default_factory=threading.RLock)
    datasets: dict[str, h5py.Dataset] = field(default_factory=dict)


_growing: dict[_FileNumber, _Shared] = {}
_registry = threading.RLock()


class OpenFile:
    """One reader's hold of a run file; the file is closed when the last one lets go."""

    def __init__(self, shared: _Shared) -> None:
        self._shared = shared
        self._held = True

    @property
    def grows(self) -> bool:
        """Whether it was opened as a file that a writer may still lengthen."""
        return self._shared.number is not None

    @contextlib.contextmanager
    def use(self) -> Iterator[h5py.File]:
        """The file, for as long as no other reader needs it. What is opened in it must not outlive the block."""
        with self._shared.lock:
            if not self._held:
                raise RunFileError("the run was closed and cannot be read any more")
            yield self._shared.file

    def dataset(self, path: str) -> h5py.Dataset:
        """A dataset, opened once for all readers; to be read within `use`. Raises `RunFileError`
        where there is none.
        """
        datasets = self._shared.datasets
        if path not in datasets:
            dataset = self._shared.file.get(path)
            if not isinstance(dataset, h5py.Dataset):
                raise RunFileError("a column or table of the run is missing", where=path)
            datasets[path] = dataset
        return datasets[path]

    def refresh(self, path: str) -> h5py.Dataset:
        """A dataset as long as its writer has made it by now; to be called within `use`."""
        dataset = self.dataset(path)
        if self.grows:
            dataset.refresh()
        return dataset

    def close(self) -> None:
        """Let go of the file; nothing can be read any more by this reader."""
        with _registry:
            if not self._held:
                return
            self._held = False
            shared = self._shared
            shared.readers -= 1
            if shared.readers:
                return
            if shared.number is not None and _growing.get(shared.number) is shared:
                del _growing[shared.number]
            shared.datasets.clear()
            shared.file.close()

    def __enter__(self) -> OpenFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_for_reading(path: Path, *, leave_out: str = "", is_known: bool = False) -> OpenFile:
    """A run file opened as a SWMR reader where a writer is at work or was killed, plainly otherwise.

    Raises `RunFileError` for a file that is built as no run is; `leave_out` is the path of a group
    that will not be looked into, so that it need not be examined. Nor need a file that `is_known`:
    whoever asks is writing it, or has had these very bytes examined before.
    """
    with refusing_damage(path):
        require_hdf5(path)
        if path.name.endswith(PART_SUFFIX):
            return _open_growing(path, is_known=is_known)
        # Another driver than that of a growing file: where one process holds a run open as growing
        # and opens it again sealed, the library would take both for one file.
        file = h5py.File(path, "r", driver="stdio")
        if not is_known:
            _examine(file, grows=False, leave_out=leave_out)
        return OpenFile(_Shared(file))
    raise AssertionError


def _examine(file: h5py.File, *, grows: bool, leave_out: str = "") -> None:
    """Close a file again that is built as no run is."""
    try:
        refuse_foreign_structure(file, grows=grows, leave_out=leave_out)
    except BaseException:
        file.close()
        raise


def require_hdf5(path: Path) -> None:
    """Raise `RunFileError` for a folder, and for a file that does not begin as HDF5 does."""
    if path.is_dir():
        remedy = f"Name a run in it: rig runs {quoted(path)} lists them."
        raise RunFileError("is a folder, not a run file", where=str(path), remedy=remedy)
    with path.open("rb") as stream:
        head = stream.read(8)
    if head != b"\x89HDF\r\n\x1a\n":
        raise RunFileError(
            "is empty" if not head else "is not an HDF5 file",
            where=str(path),
            remedy="Import a recording of another rig with `rig import`.",
        )


def _open_growing(path: Path, *, is_known: bool) -> OpenFile:
    with _registry:
        status = path.stat()
        number = (status.st_dev, status.st_ino)
        shared = _growing.get(number)
        if shared is not None:
            shared.readers += 1
            if shared.file:
                return OpenFile(shared)
        file = _open_as_swmr_reader(path)
        if not is_known:
            _examine(file, grows=True)
        shared = _Shared(file, number)
        _growing[number] = shared
        return OpenFile(shared)


def _open_as_swmr_reader(path: Path) -> h5py.File:
    """A file that is being written, or whose writer was killed.

    The HDF5 library repeats a failed read of such a file a hundred times and doubles its wait each
    time: on a damaged one it would never come back. A writer at work is caught up with in a few of
    these attempts.
    """
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    # A lock on this file says that somebody writes it; whoever only watches takes none.
    access.set_file_locking(False, False)
    library = ctypes.CDLL(h5py.h5p.__file__)
    with contextlib.suppress(
        AttributeError
    ):  # Where the symbol cannot be reached the library's own patience stays.
        limit_attempts = library.H5Pset_metadata_read_attempts
        limit_attempts.argtypes, limit_attempts.restype = (
            (ctypes.c_int64, ctypes.c_uint),
            ctypes.c_int,
        )
        # The library is not made for threads: h5py takes turns by this lock, and whoever goes past
        # it has to take it as well.
        with phil:
            limit_attempts(access.id, _READ_ATTEMPTS)
    flags = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
    return h5py.File(h5py.h5f.open(os.fsencode(path), flags, access))
