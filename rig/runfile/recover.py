"""A `.part` file whose writer died, made into a run with outcome INTERRUPTED; and the compacting of a finished one.

The only way into a file whose SWMR writer was killed is to open it as a SWMR reader and to copy it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import RunFileError
from rig.runfile import layout
from rig.runfile.closing import Closing, read_closing, write_closing
from rig.runfile.damage import close_without_writing, refusing_damage
from rig.runfile.header import check_format, iso_time, read_header, rows_flushed, write_header
from rig.runfile.layout import BOOKKEEPING, TIME
from rig.runfile.opening import open_for_reading
from rig.runfile.seal import final_path, protect, refuse_live, seal_file

SLAB_ROWS = 8192
COPY_SUFFIX = ".sealing"
UNFINISHED_HEADER = b"\x89HDF\r\n\x1a\n\x03\x08\x08\x01"
"""How a file begins whose header is not complete: signature, version, sizes, and the mark of its writer."""
STORED_ROWS = b"EAHD"
"""Where the rows of a channel are found: it stands in the file as soon as the first of them is stored."""
LARGEST_HEADER = 1 << 20
"""Bytes. A file above it is never taken away: headers have less than a tenth of that."""


@dataclass(frozen=True)
class Recovered:
    """What became of a dead `.part` file: the run, its rows, and whatever had to be cut, in words.

    `is_removed`: it held no row and was taken away; `path` is where it was.
    """

    path: Path
    rows: int
    outcome: str
    notes: tuple[str, ...] = ()
    is_removed: bool = False


def recover_run(part: Path) -> Recovered:
    """Make a run of a `.part` file that nobody writes any more; the `.part` goes only when the run is sealed.

    A file that was complete and only not yet sealed keeps its outcome; every other one becomes
    INTERRUPTED. A header without rows is taken away.
    """
    if not part.name.endswith(layout.PART_SUFFIX):
        raise RunFileError(
            "is not an unfinished run",
            where=str(part),
            limit=f"a name that ends in {layout.PART_SUFFIX}",
            remedy="A sealed run needs no recovery: see `rig verify`.",
        )
    refuse_live(part)
    if _has_no_header(part):
        return _removed(part, "its header was never completed, so no row was recorded")
    return _copy_and_seal(part, final_path(part))


def compact(part: Path, final: Path) -> Path:
    """Compress a complete, closed `.part` into the sealed run."""
    return _copy_and_seal(part, final).path


def _copy_and_seal(part: Path, final: Path) -> Recovered:
    if final.exists() and final.samefile(part):
        # The sealing was cut off between giving the file its final name and taking the old one away.
        return _finish_sealing(part, final)
    if final.exists():
        raise RunFileError(
            "there is a run of this name already",
            where=str(final),
            remedy="Move one of the two away.",
        )
    copy = final.with_name(final.name + COPY_SUFFIX)
    copy.unlink(missing_ok=True)
    try:
        remedy = "The .part file is left as it is; is there room on the disk?"
        with (
            refusing_damage(part, "cannot be copied", remedy),
            open_for_reading(part) as held,
            held.use() as source,
        ):
            check_format(source)
            rows, outcome, notes = _copy(source, copy)
            is_bare = not rows and outcome == "INTERRUPTED" and _stores_no_rows(part)
        if is_bare:
            copy.unlink()
            return _removed(
                part, "a header without rows: it was cut off before anything was recorded"
            )
        seal_file(copy, final)
    except BaseException:
        copy.unlink(missing_ok=True)
        raise
    part.unlink()
    return Recovered(final, rows, outcome, tuple(notes))


def _has_no_header(part: Path) -> bool:
    """Whether the writer died before it had written its header: no row was ever taken then.

    The library keeps the mark of a writer in the superblock until rows may be appended (SWMR).
    """
    with refusing_damage(part), part.open("rb") as stream:
        start = stream.read(len(UNFINISHED_HEADER))
    return not start or (start == UNFINISHED_HEADER and _stores_no_rows(part))


def _stores_no_rows(part: Path) -> bool:
    """What its bytes say, whatever its header says: a mark on the disk can be older than the rows behind it."""
    with refusing_damage(part):
        return part.stat().st_size < LARGEST_HEADER and STORED_ROWS not in part.read_bytes()


def _removed(part: Path, why: str) -> Recovered:
    size = part.stat().st_size
    try:
        part.unlink()
    except OSError as error:
        raise RunFileError(
            f"cannot be taken away: {error.strerror or error}", where=str(part), value=why
        ) from error
    return Recovered(part, 0, "", (f"{why} ({size} bytes)",), is_removed=True)


def _finish_sealing(part: Path, final: Path) -> Recovered:
    protect(final)
    part.unlink()
    with refusing_damage(final), open_for_reading(final) as held, held.use() as file:
        process = file[layout.PROCESS]
        assert isinstance(process, h5py.Group)
        rows = int(layout.read_number(process, "rows_written", 0))
        return Recovered(final, rows, read_closing(file).outcome)


def _copy(source: h5py.File, target: Path) -> tuple[int, str, list[str]]:
    header = read_header(source)
    lengths = {
        name: int(source[f"{layout.DATA}/{name}"].shape[0])  # type: ignore[union-attr]
        for name in (*BOOKKEEPING, *(column.name for column in header.columns))
    }
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
    closing = read_closing(source)
    complete = closing.status == layout.COMPLETE
    with _new_file(target) as file:
        write_header(file, header)
        datasets = layout.create_data(file, header.columns, SLAB_ROWS, compress=True)
        for name, dataset in datasets.items():
            dataset.resize((rows,))
            stored = source[f"{layout.DATA}/{name}"]
            assert isinstance(stored, h5py.Dataset)
            for first in range(0, rows, SLAB_ROWS):
                dataset[first : first + SLAB_ROWS] = stored[first : min(first + SLAB_ROWS, rows)]
        segments, events = layout.create_tables(file)
        notes += _copy_segments(source, segments, rows)
        last_ns = int(datasets[TIME][rows - 1]) if rows else 0
        if not complete:
            closing = Closing(
                closing.end_time or (iso_time(last_ns) if rows else ""),
                "INTERRUPTED",
                layout.RECOVERED,
            )
        _copy_events(
            source,
            events,
            [] if complete else [*notes, f"recovered {rows} rows of a run cut off"],
            last_ns,
        )
        _finish(source, file, rows, closing)
    return rows, closing.outcome, notes


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
    inside = segments[segments["start"] < rows] if len(segments) else segments
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
