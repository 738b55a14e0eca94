"""Channels of MDF files (ASAM measurement data, versions 3 and 4), as CANape, INCA and many loggers write them."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rig.extras import optional
from rig.runfile.importing.adapters.arrays import NUMERIC
from rig.runfile.importing.adapters.blocks import (
    DAMAGE,
    BlockTable,
    FileColumn,
    as_numbers,
    calendar_ns,
    headings_of,
    refused_damage,
    steps_of_rows,
)
from rig.runfile.importing.adapters.listening import heard

KIND = "MDF file"
_SYNC_BY_TIME = 1
_WHOSE = ("author", "department", "project", "subject")
NUMBERS_3, NUMBERS_4 = (*range(4), *range(9, 17)), tuple(range(6))
"""Types of data that are numbers."""


@dataclass(frozen=True)
class _Place:
    """Where a channel stands: its group, its number there (None: the master), rows, and whether it is a time."""

    group: int
    index: int | None
    rows: int
    is_time: bool = False


class MdfTable(BlockTable):
    """The channels of an MDF file, converted as the file says; the master of a group is the time of its channels.

    Words that stand for numbers are left as those numbers. Samples that the file marks as invalid are
    holes. A master over angle or distance is a column like others.
    """

    def __init__(self, path: Path) -> None:
        self._package = optional("asammdf", "reading MDF files", "import")
        found: list[tuple[str, str, str, _Place]] = []
        with self._open(path) as file:
            start_ns = calendar_ns(file.header.start_time)
            said = _comments(file)
            for number, group in enumerate(file.groups):
                found += _channels_of(file, number, group)
        headings = headings_of([(group, name) for group, name, _, _ in found])
        self._places = {h: place for h, (_, _, _, place) in zip(headings, found, strict=True)}
        clocks = {place.group: h for h, place in self._places.items() if place.is_time}
        columns = [
            FileColumn(
                heading=heading,
                unit=unit,
                rows=place.rows,
                time="" if place.is_time else clocks.get(place.group, ""),
                is_moment=place.is_time and bool(start_ns),
            )
            for heading, (_, _, unit, place) in zip(headings, found, strict=True)
        ]
        super().__init__(path, columns, KIND, start_ns)
        self.take_said(said)

    @contextmanager
    def _open(self, path: Path) -> Iterator[Any]:
        """The file, closed whatever happens. Raises `RunFileError` for one that cannot be read."""
        # The stream is our own: the package leaves it open where the file is damaged.
        with refused_damage(path, KIND), path.open("rb") as stream:
            with heard("asammdf") as said:
                file = self._begun(stream)
            self.take_note(said)
            try:
                yield file
            finally:
                file.close()

    def _begun(self, stream: BinaryIO) -> Any:
        """The opened file. Raises `ValueError` with what the package says of one that is damaged."""
        damage = (self._package.blocks.utils.MdfException, AttributeError, TypeError, *DAMAGE)
        why = ""
        told, sys.unraisablehook = sys.unraisablehook, lambda _: None
        try:
            return self._package.MDF(stream)
        except damage as error:
            why = str(error) or type(error).__name__
        finally:
            if why:
                # The package fails to clear away what it began, and would say so on the terminal.
                gc.collect()
            sys.unraisablehook = told
        raise ValueError(why)

    def blocks(self, columns: Sequence[int]) -> Iterator[NDArray[np.float64]]:
        names = [self.headings[index] for index in columns]
        with self._open(self.path) as file:
            for part in steps_of_rows(self._rows[columns[0]]):
                with heard("asammdf") as said:
                    values = np.column_stack([self._read(file, name, part) for name in names])
                self.take_note(said)
                yield values

    def _read(self, file: Any, name: str, part: slice) -> NDArray[np.float64]:
        place = self._places[name]
        rows: dict[str, Any] = {
            "record_offset": part.start,
            "record_count": part.stop - part.start,
        }
        if place.index is None:
            return as_numbers(file.get_master(place.group, **rows), self.path, name)
        rows |= {"group": place.group, "index": place.index, "samples_only": True}
        samples, invalid = file.get(ignore_invalidation_bits=True, **rows)
        if np.asarray(samples).dtype.kind not in NUMERIC:
            samples, invalid = file.get(ignore_invalidation_bits=True, raw=True, **rows)
        values = as_numbers(samples, self.path, name)
        if invalid is not None:
            values[np.asarray(invalid, dtype=bool)] = np.nan
        return values


def _comments(file: Any) -> Mapping[str, object]:
    """The comment of the file, who made it and of what, and the comment of each channel."""
    own = {"comment": file.header.description}
    own |= {name: getattr(file.header, name, "") for name in _WHOSE}
    channels = [channel for group in file.groups for channel in group.channels]
    return own | {channel.name: channel.comment or _older(channel) for channel in channels}


def _older(channel: Any) -> str:
    """The description of a channel of version 3, which has no comment."""
    text = getattr(channel, "description", b"")
    return text.rstrip(b"\0").decode("latin-1") if isinstance(text, bytes) else ""


def _channels_of(file: Any, number: int, group: Any) -> list[tuple[str, str, str, _Place]]:
    """The channels of a group that are numbers: its name, theirs, the unit, and the place of each."""
    rows = int(group.channel_group.cycles_nr)
    if not rows:
        return []
    is_older = file.version < "4"
    called = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {number + 1}"
    found: list[tuple[str, str, str, _Place]] = []
    for index, channel in enumerate(group.channels):
        if index == file.masters_db.get(number):
            is_time = is_older or channel.sync_type == _SYNC_BY_TIME
            # The standard has the master in seconds where it is a time.
            unit = "s" if is_time else file.get_channel_unit(group=number, index=index)
            found.append((called, channel.name, unit, _Place(number, None, rows, is_time)))
        elif channel.data_type in (NUMBERS_3 if is_older else NUMBERS_4):
            unit = file.get_channel_unit(group=number, index=index) or ""
            found.append((called, channel.name, unit, _Place(number, index, rows)))
    return found
