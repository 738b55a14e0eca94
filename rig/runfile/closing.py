"""How a run ended: the three words that are written last, the figures of the acquisition, and their checksum.

Status, outcome and end time are plain scalars, so that every reader finds them; plain scalars are
the one thing in the file that HDF5 does not checksum, so their CRC-32 lies beside the process. The
figures of the acquisition (JSON) are known only at the end and have a field of a fixed length that
is made before the first row.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import h5py

from rig.errors import RunFileError
from rig.runfile import layout

CHECKSUM = f"{layout.PROCESS}/closing_checksum"
_LENGTHS = {"end_time": 48, "outcome": 32, "status": 32}
ACQUISITION = "acquisition"
_OUTCOMES_NOW: dict[str, str] = dict.fromkeys(("PASS", "MARGINAL", "FAIL"), "COMPLETED")
"""What versions up to 0.2.0 wrote as the outcome of a run that was brought to its end."""
LONGEST_ACQUISITION = 12_000
"""Bytes of JSON that the figures of the acquisition may take."""


@dataclass(frozen=True)
class Closing:
    """Status ("running", "complete", "recovered"), outcome, end time (ISO 8601) and acquisition (JSON) of a run."""

    end_time: str = ""
    outcome: str = ""
    status: str = layout.RUNNING
    acquisition: str = ""

    @property
    def checksum(self) -> int:
        """CRC-32 of the three words, and of the acquisition where there is one."""
        words = [self.end_time, self.outcome, self.status]
        if self.acquisition:
            words.append(self.acquisition)
        return zlib.crc32("\n".join(words).encode())


def create_closing(file: h5py.File, closing: Closing) -> None:
    """Make the fields, before SWMR starts; entry and process are there already."""
    entry = _entry(file)
    for name, length in _LENGTHS.items():
        layout.create_changing_field(entry, name, getattr(closing, name), length)
    layout.create_changing_field(
        _process(file), ACQUISITION, closing.acquisition, LONGEST_ACQUISITION
    )
    file.create_dataset(
        CHECKSUM, data=[closing.checksum], dtype="<i8", chunks=(1,), fletcher32=True
    )


def write_closing(file: h5py.File, closing: Closing) -> None:
    """Rewrite the fields; the checksum last."""
    for name in _LENGTHS:
        layout.rewrite_field(_entry(file), name, getattr(closing, name))
    layout.rewrite_field(_process(file), ACQUISITION, closing.acquisition)
    checksum = file[CHECKSUM]
    assert isinstance(checksum, h5py.Dataset)
    checksum[0] = closing.checksum
    checksum.flush()


def read_closing(file: h5py.File) -> Closing:
    """How the run ended, in the words of this version; a writer at work is taken as running.

    Raises `RunFileError` for words that were changed.
    """
    entry = _entry(file)
    words = (layout.read_text(entry, name) for name in _LENGTHS)
    closing = Closing(*words, acquisition=layout.read_text(_process(file), ACQUISITION))
    checksum = file.get(CHECKSUM)
    if not isinstance(checksum, h5py.Dataset) or checksum.shape != (1,):
        raise RunFileError("the checksum of outcome and end time is missing", where=CHECKSUM)
    if int(checksum[0]) == closing.checksum:
        return replace(closing, outcome=outcome_read(closing.outcome))
    if file.swmr_mode:
        # The writer died, or is, between the first of the three words and their checksum.
        return Closing()
    raise RunFileError(
        "outcome and end time are not what was written",
        where=layout.ENTRY,
        value=repr(closing.outcome),
    )


def outcome_read(word: str) -> str:
    """The outcome that a word in a file stands for: a verdict was written of a run that reached its end."""
    return _OUTCOMES_NOW.get(word, word)


def acquisition_text(figures: Mapping[str, object]) -> str:
    """The figures of the acquisition as JSON; groups of figures that would not fit are left out and named."""
    if not figures:
        return ""
    remaining = dict(figures)
    left: list[str] = []
    text = layout.to_json(remaining)
    while len(text.encode()) > LONGEST_ACQUISITION:
        left.append(max(remaining, key=lambda name: len(layout.to_json(remaining[name]))))
        del remaining[left[-1]]
        text = layout.to_json({**remaining, "left_out": left})
    return text


def _process(file: h5py.File) -> h5py.Group:
    process = file[layout.PROCESS]
    assert isinstance(process, h5py.Group)
    return process


def _entry(file: h5py.File) -> h5py.Group:
    entry = file[layout.ENTRY]
    assert isinstance(entry, h5py.Group)
    return entry
