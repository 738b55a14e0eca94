"""A `.part` file whose writer died, made into a run with outcome INTERRUPTED; and the compacting of a finished one.

The only way into a file whose SWMR writer was killed is to open it as a SWMR reader and to copy it.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import RunFileError
from rig.runfile import layout
from rig.runfile.closing import Closing, read_closing, write_closing
from rig.runfile.damage import close_without_writing, reason, refusing_damage
from rig.runfile.empty import PartBytes, part_bytes
from rig.runfile.header import check_format, iso_time, read_header, rows_flushed, write_header
from rig.runfile.layout import BOOKKEEPING, TIME
from rig.runfile.opening import open_for_reading
from rig.runfile.seal import (
    check_seal,
    final_path,
    protect,
    recorded_sha256,
    refuse_live,
    seal_file,
)

_SLAB_ROWS = 8192
_COPY_SUFFIX = ".sealing"
_KEPT_SUFFIX = ".kept"
"""What the name of a `.part` file ends in after the run that could be made of it was sealed."""


@dataclass(frozen=True)
class Recovered:
    """What became of a dead `.part` file: the run, its rows, and whatever had to be cut, in words.

    `unread`: rows that its columns have and that could not be taken over; `beyond`: bytes behind the
    last flush to which nothing points, so that nobody can say how many rows they are. `kept`: the
    untouched `.part` under its new name. `is_removed`: it was proved empty (see `rig.runfile.empty`)
    and taken away; `path` is where it was.
    """

    path: Path
    rows: int
    outcome: str
    notes: tuple[str, ...] = ()
    unread: int = 0
    beyond: int = 0
    kept: Path | None = None
    is_removed: bool = False


@dataclass(frozen=True)
class _Copied:
    """What was copied of a `.part`: rows, rows left, outcome, notes, and whether its writer had completed it."""

    rows: int
    unread: int
    outcome: str
    notes: tuple[str, ...]
    is_complete: bool


def recover_run(part: Path) -> Recovered:
    """Make a run of a `.part` file that nobody writes any more.

    A file that was complete and only not yet sealed keeps its outcome; it goes when its copy is
    sealed. Every other one becomes INTERRUPTED, and stays, byte for byte, beside the run. One that
    is proved empty is taken away. What cannot be read is left as it is: `RunFileError`.
    """
    if not part.name.endswith(layout.PART_SUFFIX):
        raise RunFileError(
            "is not an unfinished run",
            where=str(part),
            limit=f"a name that ends in {layout.PART_SUFFIX}",
            remedy="A sealed run needs no recovery: see `rig verify`.",
        )
    refuse_live(part)
    found = part_bytes(part)
    if found.has_no_header:
        return _removed(part, "its header was never completed, so no row was recorded")
    if found.may_have_no_header:
        raise RunFileError(
            "its header was never completed",
            where=str(part),
            value=f"{found.size} bytes, {found.beyond} of them behind the end that it states",
            remedy="Killed there, its writer had not taken a row; after a power cut that is not proved, "
            "so it is left as it is.",
        )
    final = final_path(part)
    if final.exists():
        return _finish_sealing(part, final, found)
    copied, copy = _copied(part, final)
    if not copied.rows and not copied.unread and found.ends_with_its_header:
        copy.unlink()
        return _removed(part, "a header without rows: it was cut off before anything was recorded")
    _seal_copy(copy, final)
    return _left(part, final, copied, found)


def compact(part: Path, final: Path) -> Path:
    """Compress a complete, closed `.part` into the sealed run; one of which rows cannot be read stays as it is."""
    if final.exists():
        raise _already_there(final)
    copied, copy = _copied(part, final)
    if not copied.is_complete:
        copy.unlink()
        raise RunFileError(
            "was written, and cannot be read again",
            where=str(part),
            value="; ".join(copied.notes),
            remedy="It is left as it is: `rig recover` takes what can be read.",
        )
    _seal_copy(copy, final)
    part.unlink()
    return final


def _copied(part: Path, final: Path) -> tuple[_Copied, Path]:
    """What could be copied of a `.part`, and the copy, which is not sealed yet."""
    copy = final.with_name(final.name + _COPY_SUFFIX)
    copy.unlink(missing_ok=True)
    try:
        remedy = "The .part file is left as it is; is there room on the disk?"
        with (
            refusing_damage(part, "cannot be copied", remedy),
            open_for_reading(part) as held,
            held.use() as source,
        ):
            check_format(source)
            return _copy(source, copy), copy
    except BaseException:
        copy.unlink(missing_ok=True)
        raise
    raise AssertionError


def _seal_copy(copy: Path, final: Path) -> None:
    try:
        seal_file(copy, final)
    except BaseException:
        copy.unlink(missing_ok=True)
        raise


def _left(part: Path, final: Path, copied: _Copied, found: PartBytes) -> Recovered:
    """What is told of a `.part` whose run is sealed. It goes where its writer had completed it, and else stays."""
    if copied.is_complete:
        part.unlink()
        return Recovered(final, copied.rows, copied.outcome, copied.notes)
    notes = list(copied.notes)
    if found.beyond:
        notes.append(
            f"{found.beyond} bytes were written after the last flush: the rows in them cannot be found"
        )
    kept = _keep(part)
    return Recovered(
        path=final,
        rows=copied.rows,
        outcome=copied.outcome,
        notes=tuple(notes),
        unread=copied.unread,
        beyond=found.beyond,
        kept=kept,
    )


def _keep(part: Path) -> Path:
    """Give a `.part` whose run is sealed another name, so that nobody takes it for one that waits."""
    names = (f"{part.name}{_KEPT_SUFFIX}{number or ''}" for number in itertools.count())
    kept = next(path for path in map(part.with_name, names) if not path.exists())
    with _refusing(part, "cannot be renamed"):
        part.rename(kept)
    return kept


def _removed(part: Path, why: str) -> Recovered:
    size = part.stat().st_size
    with _refusing(part, "cannot be taken away", why):
        part.unlink()
    return Recovered(part, 0, "", (f"{why} ({size} bytes)",), is_removed=True)


@contextlib.contextmanager
def _refusing(part: Path, what: str, value: str | None = None) -> Iterator[None]:
    """Turn a refusal of the operating system into one line."""
    try:
        yield
    except OSError as error:
        raise RunFileError(
            f"{what}: {error.strerror or error}", where=str(part), value=value
        ) from error


def _finish_sealing(part: Path, final: Path, found: PartBytes) -> Recovered:
    """End what was cut off after the run had got its final name. Raises `RunFileError` for another run of that name."""
    if final.samefile(part):
        # The kill came between giving the file its final name and taking the old one away.
        protect(final)
        part.unlink()
        rows, closing, _ = _ending_of(final)
        return Recovered(final, rows, closing.outcome)
    try:
        rows, closing, run_id = _ending_of(final)
        is_ours = run_id == _ending_of(part)[2] and bool(recorded_sha256(final))
    except RunFileError as error:
        raise _already_there(final) from error
    if not is_ours:
        raise _already_there(final)
    check_seal(final)
    note = "it had been recovered before, and only its name was left to be changed"
    return Recovered(final, rows, closing.outcome, (note,), beyond=found.beyond, kept=_keep(part))


def _ending_of(path: Path) -> tuple[int, Closing, str]:
    """Rows as counted, ending and identity of a run file."""
    with refusing_damage(path), open_for_reading(path) as held, held.use() as file:
        process = file[layout.PROCESS]
        assert isinstance(process, h5py.Group)
        rows = int(layout.read_number(process, "rows_written", 0))
        return rows, read_closing(file), read_header(file).metadata.run_id
    raise AssertionError


def _already_there(final: Path) -> RunFileError:
    return RunFileError(
        "there is a run of this name already",
        where=str(final),
        remedy="Move one of the two away.",
    )


def _copy(source: h5py.File, target: Path) -> _Copied:
    header = read_header(source)
    lengths = {
        name: int(source[f"{layout.DATA}/{name}"].shape[0])  # type: ignore[union-attr]
        for name in (*BOOKKEEPING, *(column.name for column in header.columns))
    }
    rows, notes = _rows_to_copy(source, lengths)
    closing = read_closing(source)
    with _new_file(target) as file:
        write_header(file, header)
        datasets = layout.create_data(file, header.columns, _SLAB_ROWS, compress=True)
        rows = _copy_columns(source, datasets, rows, notes)
        unread = max(lengths.values()) - rows
        is_complete = closing.status == layout.COMPLETE and not unread
        segments, events = layout.create_tables(file)
        notes += _copy_segments(source, segments, rows)
        last_ns = int(datasets[TIME][rows - 1]) if rows else 0
        told: list[str] = []
        if not is_complete:
            end_time = closing.end_time or (iso_time(last_ns) if rows else "")
            closing = Closing(end_time, "INTERRUPTED", layout.RECOVERED)
            told = [*notes, f"recovered {rows} rows of a run cut off"]
        _copy_events(source, events, told, last_ns)
        _finish(source, file, rows, closing)
    return _Copied(rows, unread, closing.outcome, tuple(notes), is_complete)


def _rows_to_copy(source: h5py.File, lengths: Mapping[str, int]) -> tuple[int, list[str]]:
    """Rows that every column has and a flush has confirmed, and in words what is more than that."""
    shortest, longest = min(lengths.values()), max(lengths.values())
    notes = []
    if longest > shortest:
        ahead = ", ".join(name for name, length in lengths.items() if length > shortest)
        notes.append(
            f"columns of unequal length cut to {shortest} rows: {ahead} had up to {longest - shortest} more"
        )
    rows = min(shortest, rows_flushed(source))
    if rows < shortest:
        notes.append(f"{shortest - rows} rows left out that no complete flush had confirmed")
    return rows, notes


def _copy_columns(
    source: h5py.File, datasets: Mapping[str, h5py.Dataset], rows: int, notes: list[str]
) -> int:
    """Copy the columns up to the first row that cannot be read in all of them; returns how many rows that is."""
    readable = rows
    for name, dataset in datasets.items():
        dataset.resize((rows,))
        stored = source[f"{layout.DATA}/{name}"]
        assert isinstance(stored, h5py.Dataset)
        for first in range(0, readable, _SLAB_ROWS):
            stop = min(first + _SLAB_ROWS, readable)
            try:
                slab = stored[first:stop]
            except (OSError, RuntimeError, ValueError) as error:
                # A chunk whose checksum does not fit: what lies before it is as it was written.
                notes.append(f"rows from {first} on cannot be read in {name}: {reason(error)}")
                readable = first
                break
            dataset[first:stop] = slab
    if rows and not readable:
        raise RunFileError(
            f"none of its {rows} rows can be read: {notes[-1]}",
            where=source.filename,
            remedy="The .part file is left as it is: take the original, or the backup.",
        )
    for dataset in datasets.values():
        dataset.resize((readable,))
    return readable


@contextlib.contextmanager
def _new_file(target: Path) -> Iterator[h5py.File]:
    """A new file, closed at the end; after a failure closed without another attempt to write."""
    file = h5py.File(target, "x", libver=layout.LIBRARY_VERSION)
    try:
        yield file
        file.flush()
    except BaseException:
        close_without_writing(file)
        raise
    file.close()


def _copy_segments(source: h5py.File, target: h5py.Dataset, rows: int) -> list[str]:
    """Segments within the rows; those beyond go, the one that was open or reaches over the end is closed there."""
    table = source.get(layout.SEGMENTS)
    if not isinstance(table, h5py.Dataset) or table.dtype != layout.SEGMENT_TYPE:
        raise RunFileError("the table of segments is missing or damaged")
    segments: Any = table[:]
    inside = segments[segments["start"] < rows]
    open_or_long = (inside["stop"] == layout.OPEN_STOP) | (inside["stop"] > rows)
    notes = [
        f"segment {row['index']} ({row['label'].decode()}) ends with the last row"
        for row in inside[open_or_long]
    ]
    if len(inside) < len(segments):
        notes.append(f"{len(segments) - len(inside)} segments without rows left out")
    inside["stop"] = np.where(open_or_long, rows, inside["stop"])
    target.resize((len(inside),))
    target[:] = inside
    return notes


def _copy_events(source: h5py.File, target: h5py.Dataset, notes: list[str], time_ns: int) -> None:
    table = source.get(layout.EVENTS)
    if not isinstance(table, h5py.Dataset) or table.dtype != layout.EVENT_TYPE:
        raise RunFileError("the table of events is missing or damaged")
    events: Any = table[:]
    size = layout.EVENT_TYPE["text"].itemsize
    cut = [(layout.fixed_bytes(note, size)) for note in notes]
    added = [
        (time_ns, b"warning", b"RECOVERED", b"recover", raw, truncated) for raw, truncated in cut
    ]
    rows = np.concatenate([events, np.array(added, dtype=layout.EVENT_TYPE)])
    target.resize((len(rows),))
    target[:] = rows


def _finish(source: h5py.File, file: h5py.File, rows: int, closing: Closing) -> None:
    write_closing(file, closing)
    before, after = source[layout.PROCESS], file[layout.PROCESS]
    assert isinstance(before, h5py.Group)
    assert isinstance(after, h5py.Group)
    layout.rewrite_field(after, "rows_written", rows)
    layout.rewrite_field(after, "rows_dropped", int(layout.read_number(before, "rows_dropped", 0)))
