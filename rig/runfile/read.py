"""A run file as a `Recording`: lazy, in constant memory, from a sealed, a growing or a recovered file."""

from __future__ import annotations

import dataclasses
import threading
import weakref
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.channel import Channel
from experiments.recording import Event, Recording, Segment
from rig.errors import RunFileError
from rig.runfile import layout
from rig.runfile.damage import open_for_reading, refusing_damage
from rig.runfile.header import RunHeader, check_format, read_columns, read_header, read_metadata, rows_flushed
from rig.runfile.layout import BOOKKEEPING, FLAGS, TIME
from rig.runfile.seal import file_sha256, recorded_sha256


class FileSource:
    """The stored numbers of a run file. Only the rows asked for are loaded; the file is closed with this object.

    `rows` stands still until `refresh` looks for rows that a writer has added.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = open_for_reading(path)
        self._closer = weakref.finalize(self, self.file.close)
        self._lock = threading.Lock()
        with refusing_damage(path):
            check_format(self.file)
            self.columns = read_columns(self.file)
            names = (*BOOKKEEPING, *(column.name for column in self.columns))
            self._datasets = {name: _dataset(self.file, name) for name in names}
            self._rows = self._count_rows()

    @property
    def rows(self) -> int:
        """Rows that every column has."""
        return self._rows

    def refresh(self) -> int:
        """Look for rows added since; returns how many there are now."""
        with self._lock, refusing_damage(self.path):
            self._rows = self._count_rows()
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

    def _read(self, name: str, start: int, stop: int) -> NDArray[Any]:
        with self._lock, refusing_damage(self.path, f"the rows of {name} cannot be read"):
            return self._datasets[name][start : min(stop, self._rows)]

    def _count_rows(self) -> int:
        """Rows that every column has; of a file that is not sealed no more than the latest complete flush brought."""
        flushed = rows_flushed(self.file)
        if self.file.swmr_mode:
            for dataset in self._datasets.values():
                dataset.refresh()
        return min(flushed, *(int(dataset.shape[0]) for dataset in self._datasets.values()))


def open_run(path: str | Path, *, verify: bool = False, digest: bool = True) -> Recording:
    """The recording of a run file; rows are read when they are asked for.

    `verify` compares the SHA-256 of the whole file with the one noted when it was sealed; without `digest` the hash is
    neither compared nor looked up. Raises `RunFileError` for a file that is missing, foreign, damaged, cut off, or of another
    format version.
    """
    path = Path(path)
    source = FileSource(path)
    try:
        sha256 = _digest(path, verify=verify) if verify or digest else ""
        with refusing_damage(path):
            metadata = read_metadata(source.file, sha256)
            segments, events = _segments(source.file, source.rows), _events(source.file)
    except BaseException:
        source.close()
        raise
    signals = {column.name: column.signal() for column in source.columns}
    return Recording(metadata, signals, segments, events, source)


def follow(recording: Recording) -> Recording:
    """The same growing run with the rows, segments and events that have been added since."""
    source = recording.source
    if not isinstance(source, FileSource):
        return recording
    rows = source.refresh()
    with refusing_damage(source.path):
        for name in (layout.SEGMENTS, layout.EVENTS):
            table = source.file[name]
            if source.file.swmr_mode and isinstance(table, h5py.Dataset):
                table.refresh()
        segments, events = _segments(source.file, rows), _events(source.file)
    return dataclasses.replace(recording, segments=segments, events=events)


def close_recording(recording: Recording) -> None:
    """Close the file behind a recording, if there is one."""
    if isinstance(recording.source, FileSource):
        recording.source.close()


def read_channels(path: Path) -> tuple[Channel, ...]:
    """The rig's channels that a run was recorded from, for replaying it; a recording that was not in counts is refused."""
    with FileSource(path) as source:
        floats = [column.name for column in source.columns if column.dtype == "float64"]
        if floats:
            raise RunFileError(
                "was not recorded in counts and cannot be replayed", where=str(path), value=", ".join(floats)
            )
        return tuple(column.channel() for column in source.columns)


def read_run_header(path: Path) -> RunHeader:
    """The header that a run was begun with: metadata, channels, limits, devices, truth."""
    with FileSource(path) as source, refusing_damage(path):
        return read_header(source.file)


def _digest(path: Path, *, verify: bool) -> str:
    if path.name.endswith(layout.PART_SUFFIX):
        return ""
    noted = recorded_sha256(path)
    if noted and not verify:
        return noted
    with refusing_damage(path):
        found = file_sha256(path)
    if verify and noted != found:
        raise RunFileError(
            "is not the file that was sealed: its SHA-256 differs" if noted else "has no note of its SHA-256",
            where=str(path), value=found, limit=noted or f"a file {path.name}{layout.HASH_SUFFIX} beside it",
            remedy="Take the original, or the backup.",
        )  # fmt: skip
    return found


def _dataset(file: h5py.File, name: str) -> h5py.Dataset:
    found = file[f"{layout.DATA}/{name}"]
    if not isinstance(found, h5py.Dataset) or found.ndim != 1:
        raise RunFileError("a column of the run is missing", where=f"{layout.DATA}/{name}")
    expected = {TIME: "i8", layout.CYCLE: "i8", FLAGS: "u2"}.get(name)
    if expected and found.dtype.str[1:] != expected:
        raise RunFileError("has the wrong type", where=f"{layout.DATA}/{name}", value=str(found.dtype), limit=expected)
    return found


def _table(file: h5py.File, path: str, dtype: np.dtype[Any]) -> Any:
    found = file.get(path)
    if not isinstance(found, h5py.Dataset) or found.dtype != dtype:
        raise RunFileError("a table of the run is missing or has another form", where=path)
    return found[:]


def _segments(file: h5py.File, rows: int) -> tuple[Segment, ...]:
    found = []
    for row in _table(file, layout.SEGMENTS, layout.SEGMENT_TYPE):
        start, stop = int(row["start"]), int(row["stop"])
        stop = rows if stop == layout.OPEN_STOP else stop
        if not 0 <= start <= stop:
            raise RunFileError("a segment ends before it begins", where=layout.SEGMENTS, value=f"[{start}, {stop})")
        found.append(Segment(
            int(row["index"]), row["label"].decode(), start, stop, float(row["setpoint"]), int(row["direction"]),
            int(row["repeat"]),
        ))  # fmt: skip
    return tuple(found)


def _events(file: h5py.File) -> tuple[Event, ...]:
    return tuple(
        Event(int(row["time"]), *(row[name].decode() for name in ("level", "code", "source", "text")))
        for row in _table(file, layout.EVENTS, layout.EVENT_TYPE)
    )
