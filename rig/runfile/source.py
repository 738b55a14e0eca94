"""The stored numbers of a run file: lazy, in constant memory, from a sealed, a growing or a recovered file."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from experiments.recording import Event, Segment
from rig.errors import RunFileError
from rig.runfile import layout
from rig.runfile.damage import refusing_damage
from rig.runfile.header import check_format, read_columns, rows_flushed
from rig.runfile.layout import BOOKKEEPING, FLAGS, TIME, Column
from rig.runfile.opening import OpenFile, open_for_reading


class FileSource:
    """The stored numbers of a run file. Only the rows asked for are loaded; the file is closed with this object.

    `rows` stands still until `refresh` looks for rows that a writer has added.
    """

    def __init__(self, path: Path, columns: tuple[Column, ...] = ()) -> None:
        """`columns` where they are known: the caller is writing the file, or has read these very bytes before."""
        self.path = path
        self._open = open_for_reading(path, is_known=bool(columns))
        self._closer = weakref.finalize(self, self._open.close)
        self._rows = 0
        with self.file() as file:
            if not columns:
                check_format(file)
            self.columns = columns or read_columns(file)
            self._names = (*BOOKKEEPING, *(column.name for column in self.columns))
            for name in self._names:
                require_column(self._open, name)
            self._rows = self._count_rows(file)

    @property
    def grows(self) -> bool:
        """Whether the file is not sealed, so that rows may still be added."""
        return self._open.grows

    @contextmanager
    def file(self, what: str = "is not a readable run file") -> Iterator[h5py.File]:
        """The opened file, for looking at what is no row; damage found within is a `RunFileError` that says `what`."""
        with refusing_damage(self.path, what), self._open.use() as file:
            yield file

    @property
    def rows(self) -> int:
        """Rows that every column has."""
        return self._rows

    def refresh(self) -> int:
        """Look for rows added since; returns how many there are now."""
        with self.file() as file:
            self._rows = self._count_rows(file)
        return self._rows

    def stored(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Stored numbers of a channel, rows [start, stop)."""
        return self._read(name, start, stop)

    def time_ns(self, start: int, stop: int) -> NDArray[np.int64]:
        """Time stamps [ns since 1970-01-01 UTC]."""
        return self._read(TIME, start, stop)

    def flags(self, start: int, stop: int) -> NDArray[np.uint16]:
        """Cycle flags."""
        return self._read(FLAGS, start, stop)

    def cycles(self, start: int, stop: int) -> NDArray[np.int64]:
        """Index of the SYNC cycle of each row."""
        return self._read(layout.CYCLE, start, stop)

    def close(self) -> None:
        """Let go of the file; nothing can be read any more."""
        self._closer()

    def __enter__(self) -> FileSource:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def tables(self) -> tuple[tuple[Segment, ...], tuple[Event, ...]]:
        """Segments and events as they are by now."""
        with self.file():
            return _segments(self._open, self.rows), read_events(self._open)

    def _read(self, name: str, start: int, stop: int) -> NDArray[Any]:
        with self.file(f"the rows of {name} cannot be read"):
            return self._open.dataset(f"{layout.DATA}/{name}")[start : min(stop, self._rows)]

    def _count_rows(self, file: h5py.File) -> int:
        """Rows that every column has; of a file that is not sealed no more than the latest complete flush brought."""
        flushed = rows_flushed(file)
        if self.grows and flushed <= self._rows:
            # Most looks find nothing new, and looking at every column costs a window a tenth of its frame.
            return self._rows
        return min(
            flushed,
            *(int(self._open.refresh(f"{layout.DATA}/{name}").shape[0]) for name in self._names),
        )


def require_column(file: OpenFile, name: str) -> None:
    """Raise `RunFileError` unless there is a column of this name, of the type that the bookkeeping has."""
    path = f"{layout.DATA}/{name}"
    dataset = file.dataset(path)
    if dataset.ndim != 1:
        raise RunFileError(
            "is not a column of rows", where=path, value=f"{dataset.ndim} dimensions", limit="1"
        )
    expected = {TIME: "i8", layout.CYCLE: "i8", FLAGS: "u2"}.get(name)
    if expected and dataset.dtype.str[1:] != expected:
        raise RunFileError(
            "has the wrong type", where=path, value=str(dataset.dtype), limit=expected
        )


def _table(file: OpenFile, path: str, dtype: np.dtype[Any]) -> Any:
    table = file.refresh(path)
    if table.dtype != dtype:
        raise RunFileError("a table of the run has another form", where=path)
    return table[:]


def _segments(file: OpenFile, rows: int) -> tuple[Segment, ...]:
    segments = []
    for row in _table(file, layout.SEGMENTS, layout.SEGMENT_TYPE):
        start, stop = int(row["start"]), int(row["stop"])
        stop = rows if stop == layout.OPEN_STOP else stop
        if not 0 <= start <= stop:
            raise RunFileError(
                "a segment ends before it begins", where=layout.SEGMENTS, value=f"[{start}, {stop})"
            )
        segments.append(
            Segment(
                index=int(row["index"]),
                label=row["label"].decode(),
                start=start,
                stop=stop,
                setpoint=float(row["setpoint"]),
                direction=int(row["direction"]),
                repeat=int(row["repeat"]),
            )
        )
    return tuple(segments)


def read_events(file: OpenFile) -> tuple[Event, ...]:
    """What happened by now."""
    return tuple(
        Event(
            int(row["time"]), *(row[name].decode() for name in ("level", "code", "source", "text"))
        )
        for row in _table(file, layout.EVENTS, layout.EVENT_TYPE)
    )
