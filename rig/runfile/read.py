"""A run file as a `Recording`: lazy, in constant memory, from a sealed, a growing or a recovered file."""

from __future__ import annotations

import dataclasses
from collections import OrderedDict
from pathlib import Path

from experiments.recording import Event, Recording, RunMetadata
from rig.errors import RunFileError, UnsealedError
from rig.runfile import layout
from rig.runfile.checks import require_sound
from rig.runfile.damage import refusing_damage
from rig.runfile.header import RunHeader, check_format, read_header, read_metadata, rows_flushed
from rig.runfile.layout import TIME, Column
from rig.runfile.opening import open_for_reading, require_hdf5
from rig.runfile.seal import Seal, check_seal, hash_path
from rig.runfile.source import FileSource, read_events, require_column

_SOUND_KEPT = 256
"""Runs of which a process remembers that it found them sound."""


@dataclasses.dataclass(frozen=True)
class _Sound:
    """What was found of the bytes of a run: its channels, and whether its rows were looked at as well."""

    columns: tuple[Column, ...] = ()
    rows: bool = False


_sound: OrderedDict[str, _Sound] = OrderedDict()
"""The latest runs that were built as runs are and passed the checks, by the SHA-256 of their bytes."""


def _remember(seal: Seal, found: _Sound) -> None:
    if seal.sha256:
        _sound[seal.sha256] = found
        if len(_sound) > _SOUND_KEPT:
            _sound.popitem(last=False)


def open_run(
    path: str | Path, *, verify: bool = False, digest: bool = True, rows: bool = True
) -> Recording:
    """The recording of a run file; rows are read when they are asked for.

    The file is held against its seal, and its content to the checks that `rig verify` makes; without
    `rows` to those alone that read no row, and without `digest` to neither seal nor checks. `verify`
    reads the whole file for its hash even where an earlier look would do, and requires a seal. Bytes
    that were found sound once, by their hash, are not examined and checked again in the same process.
    Raises `RunFileError` for a file that is missing, foreign, damaged, changed, cut off, or of
    another format version.
    """
    path = Path(path)
    # The seal comes first: of a changed file that, and not what the change made of it, is the thing to say.
    with refusing_damage(path):
        require_hdf5(path)
    seal = _seal_of(path, anew=verify) if digest or verify else Seal()
    if verify and not seal.is_whole:
        raise RunFileError(
            "has no note of its SHA-256",
            where=str(path),
            limit=f"a file {hash_path(path).name} beside it",
            remedy="Take the original, or the backup.",
        )
    known = _sound.get(seal.sha256, _Sound())
    source = FileSource(path, known.columns)
    try:
        with source.file() as file:
            metadata = read_metadata(file, seal)
        segments, events = source.tables()
        signals = {column.name: column.channel for column in source.columns}
        recording = Recording(metadata, signals, segments, events, source)
        if (digest or verify) and not (known.columns and known.rows >= rows):
            require_sound(recording, source, rows=rows)
            _remember(seal, _Sound(source.columns, rows))
    except BaseException:
        source.close()
        raise
    return recording


def open_own_run(part: Path, header: RunHeader) -> Recording:
    """The rows of a run that the caller itself is writing, with what it was begun with.

    Nothing of that is read again, and no check is made: of a file that somebody else wrote `open_run` is the reader.
    """
    source = FileSource(part, header.columns)
    try:
        segments, events = source.tables()
    except BaseException:
        source.close()
        raise
    signals = {column.name: column.channel for column in header.columns}
    return Recording(header.metadata, signals, segments, events, source)


def _seal_of(path: Path, *, anew: bool) -> Seal:
    """The seal of a run; of a file without a note that is no run at all, that is the thing to say."""
    try:
        return check_seal(path, anew=anew)
    except UnsealedError:
        with open_for_reading(path) as held, refusing_damage(path), held.use() as file:
            check_format(file)
        raise


def follow(recording: Recording) -> Recording:
    """The same growing run with the rows, segments and events that have been added since."""
    source = recording.source
    if not isinstance(source, FileSource):
        return recording
    source.refresh()
    segments, events = source.tables()
    return dataclasses.replace(recording, segments=segments, events=events)


@dataclasses.dataclass(frozen=True)
class _Glance:
    """What a list of runs says of one: metadata, rows, time from the first to the last row [s], events."""

    metadata: RunMetadata
    rows: int
    duration: float
    events: tuple[Event, ...]


def glance(path: Path) -> _Glance:
    """What a list of runs says of a run file, without looking at its columns: several times quicker than opening it.

    Raises `RunFileError` as `open_run` does, but for damage in what it does not look at.
    """
    with (
        open_for_reading(path, leave_out=layout.INSTRUMENT) as held,
        refusing_damage(path),
        held.use() as file,
    ):
        check_format(file)
        metadata, events = read_metadata(file), read_events(held)
        require_column(held, TIME)
        stamps = held.refresh(f"{layout.DATA}/{TIME}")
        rows = min(rows_flushed(file), int(stamps.shape[0]))
        duration = (int(stamps[rows - 1]) - int(stamps[0])) * 1e-9 if rows else 0.0
        return _Glance(metadata, rows, duration, events)


def close_recording(recording: Recording) -> None:
    """Close the file behind a recording, if there is one."""
    if isinstance(recording.source, FileSource):
        recording.source.close()


def read_run_header(path: Path) -> RunHeader:
    """The header that a run was begun with: metadata, channels, limits, devices, truth."""
    with FileSource(path) as source, source.file() as file:
        return read_header(file)
