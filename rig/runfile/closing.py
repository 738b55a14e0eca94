"""How a run ended: the three words that are written last, and their checksum.

Status, outcome and end time are plain scalars, so that every reader finds them; plain scalars are the one thing in the file
that HDF5 does not checksum, so their CRC-32 lies beside the process.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import h5py

from rig.errors import RunFileError
from rig.runfile import layout

_CHECKSUM = f"{layout.PROCESS}/closing_checksum"
_LENGTHS = {"end_time": 48, "outcome": 32, "status": 32}


@dataclass(frozen=True)
class Closing:
    """Status ("running", "complete", "recovered"), outcome and end time (ISO 8601) of a run."""

    end_time: str = ""
    outcome: str = ""
    status: str = layout.RUNNING

    @property
    def checksum(self) -> int:
        """CRC-32 of the three."""
        return zlib.crc32("\n".join((self.end_time, self.outcome, self.status)).encode())


def create_closing(file: h5py.File, closing: Closing) -> None:
    """Make the fields, before SWMR starts; entry and process are there already."""
    entry = _entry(file)
    for name, length in _LENGTHS.items():
        layout.create_changing_field(entry, name, getattr(closing, name), length)
    file.create_dataset(_CHECKSUM, data=[closing.checksum], dtype="<i8", chunks=(1,), fletcher32=True)


def write_closing(file: h5py.File, closing: Closing) -> None:
    """Rewrite the fields; the checksum last."""
    for name in _LENGTHS:
        layout.rewrite_field(_entry(file), name, getattr(closing, name))
    checksum = file[_CHECKSUM]
    assert isinstance(checksum, h5py.Dataset)
    checksum[0] = closing.checksum
    checksum.flush()


def read_closing(file: h5py.File) -> Closing:
    """How the run ended. Raises `RunFileError` for words that were changed; a writer at work is taken as running."""
    entry = _entry(file)
    found = Closing(*(layout.read_text(entry, name) for name in _LENGTHS))
    checksum = file.get(_CHECKSUM)
    if not isinstance(checksum, h5py.Dataset) or checksum.shape != (1,):
        raise RunFileError("the checksum of outcome and end time is missing", where=_CHECKSUM)
    if int(checksum[0]) == found.checksum:
        return found
    if file.swmr_mode:
        # The writer died, or is, between the first of the three words and their checksum.
        return Closing()
    raise RunFileError("outcome and end time are not what was written", where=layout.ENTRY, value=repr(found.outcome))


def _entry(file: h5py.File) -> h5py.Group:
    entry = file[layout.ENTRY]
    assert isinstance(entry, h5py.Group)
    return entry
