"""Columns that other packages read from a file a block of rows at a time: Parquet, TDMS, MDF.

Such a file says itself which columns are times. They come in seconds: moments of the calendar count
from `start_ns` of the file, steps that are only stated become a column of their own.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError, RunFileError
from rig.runfile.importing.adapters.arrays import NUMERIC, refuse_lengths, refuse_texts
from rig.runfile.importing.adapters.table import (
    BATCH_ROWS,
    Batch,
    CellReader,
    heading_units,
    not_finite,
)
from rig.runfile.importing.clocks import in_zone

_EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)
"""Moments before this are the zero of a clock that nobody set."""
DAMAGE = (
    OSError, ValueError, KeyError, IndexError, EOFError, MemoryError, ArithmeticError, struct.error, RuntimeError,
)  # fmt: skip
"""What reading packages raise of a file that is damaged."""


MOST_SAID, LONGEST_SAID = 12, 200
"""Comments of a file that are kept, and letters of each."""


@dataclass(frozen=True, kw_only=True)
class FileColumn:
    """One column: heading, unit as the file says it, number of rows, heading of its column of time.

    `is_moment`: its numbers are seconds since `start_ns` of the file.
    """

    heading: str
    unit: str
    rows: int
    time: str = ""
    is_moment: bool = False


class BlockTable(ABC):
    """Columns read by `blocks`; units, times and lengths as the columns state them."""

    line_word = "row"
    period: float | None = None
    may_be_retimed = True
    notes: tuple[str, ...] = ()

    def __init__(self, path: Path, columns: Sequence[FileColumn], kind: str, start_ns: int) -> None:
        if not columns:
            raise RunFileError(
                "has no numeric columns", where=str(path), remedy="Is this the right file?"
            )
        self.path = path
        self.headings = tuple(column.heading for column in columns)
        said = heading_units(self.headings)
        self.units = tuple(c.unit or unit for c, unit in zip(columns, said, strict=True))
        self.times = tuple(
            self.headings.index(column.time) if column.time else None for column in columns
        )
        self.stamped: Collection[int] = frozenset(
            index for index, column in enumerate(columns) if column.is_moment
        )
        self.start_ns = start_ns if self.stamped else 0
        self.kind = kind
        self.notes = (f"{kind} with {len(columns)} columns", *self.notes)
        self._rows = tuple(column.rows for column in columns)

    def take_note(self, said: Sequence[str]) -> None:
        """Keep what the reading package says of the file, each once."""
        self.notes += tuple(note for note in said if note not in self.notes)

    def take_said(self, said: Mapping[str, object]) -> None:
        """Keep what the file says of itself in words, by name; nothing for what it leaves empty."""
        texts = {name: " ".join(str(text).split()) for name, text in said.items() if text}
        listed = [f"{name} {text[:LONGEST_SAID]}" for name, text in texts.items() if text]
        if listed:
            self.take_note([f"the file says: {', '.join(listed[:MOST_SAID])}"])

    @abstractmethod
    def blocks(self, columns: Sequence[int]) -> Iterator[NDArray[np.float64]]:
        """The rows of these columns, a block (n, columns) at a time; what is not there is NaN."""

    def batches(
        self, columns: Sequence[int], readers: Mapping[int, CellReader] | None = None
    ) -> Iterator[Batch]:
        """The rows of these columns, a batch at a time. Raises `RunFileError` for a file that is damaged."""
        refuse_texts(self.path, readers)
        names = [self.headings[index] for index in columns]
        refuse_lengths(self.path, {self.headings[index]: self._rows[index] for index in columns})
        first = 1
        with refused_damage(self.path, self.kind):
            for values in self.blocks(columns):
                lines = np.arange(first, first + len(values))
                first += len(values)
                yield Batch(lines, values, not_finite(values, lines, names))


@contextmanager
def refused_damage(path: Path, kind: str) -> Iterator[None]:
    """Say in one sentence which file cannot be read, whatever its package calls it. Raises `RunFileError`."""
    try:
        yield
    except RigError:
        raise
    except DAMAGE as error:
        text = " ".join(str(error).split())[:120] or type(error).__name__
        raise RunFileError(f"is not a readable {kind} ({text})", where=str(path)) from error


def steps_of_rows(rows: int) -> Iterator[slice]:
    """The rows of a column, a batch at a time."""
    for first in range(0, rows, BATCH_ROWS):
        yield slice(first, min(first + BATCH_ROWS, rows))


def as_numbers(values: object, path: Path, heading: str) -> NDArray[np.float64]:
    """A column as numbers. Raises `RunFileError` for texts and for rows that are arrays themselves."""
    array = np.asarray(values)
    if array.ndim != 1 or array.dtype.kind not in NUMERIC:
        raise RunFileError(
            "holds no numbers",
            where=f"{path}, column {heading}",
            value=f"{array.dtype}, {array.ndim} dimensions",
            limit="one number in each row",
        )
    return array.astype(np.float64)


def seconds_since(moments: NDArray[np.datetime64], start_ns: int) -> NDArray[np.float64]:
    """Seconds from `start_ns` to each moment, exact to a nanosecond over days; NaN for none."""
    stamps = moments.astype("datetime64[ns]")
    seconds = np.multiply(stamps.astype(np.int64) - start_ns, 1e-9, dtype=np.float64)
    seconds[np.isnat(stamps)] = np.nan
    return seconds


def calendar_ns(moment: object) -> int:
    """A moment as nanoseconds since 1970; 0 for none and for the zero of a clock that nobody set.

    A moment without a zone is taken as UTC.
    """
    if isinstance(moment, np.datetime64) and not np.isnat(moment):
        stamp = int(moment.astype("datetime64[us]").astype(np.int64)) * 1000
    elif isinstance(moment, datetime):
        since = in_zone(moment) - datetime(1970, 1, 1, tzinfo=UTC)
        stamp = round(since.total_seconds() * 1e6) * 1000
    else:
        return 0
    return stamp if stamp >= _EARLIEST.timestamp() * 1e9 else 0


def only_one(headings: Sequence[str]) -> str:
    """The heading that is the only one; "" for none and for several."""
    return headings[0] if len(headings) == 1 else ""


def headings_of(places: Sequence[tuple[str, str]]) -> list[str]:
    """Headings for columns of groups, (group, name) each: the name where it is one in the file, else `group/name`."""
    counts = Counter(name for _, name in places)
    return [name if counts[name] == 1 else f"{group}/{name}" for group, name in places]
