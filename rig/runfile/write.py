"""The writer of a run file: rows, segments and events of one run, appended in SWMR mode to `<run>.h5.part`.

Everything is created before SWMR starts. Rows are collected to whole chunks; `flush` brings what is
there to the operating system, so that it survives the death of this process, and `synchronise` to
the disk. `seal` closes the file for good.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.samples import SampleBlock
from experiments.recording import Event, Segment
from rig.errors import RigError, RunFileError
from rig.runfile import layout
from rig.runfile.chunks import ChunkWriter
from rig.runfile.closing import Closing, acquisition_text, write_closing
from rig.runfile.damage import close_without_writing, reason
from rig.runfile.header import RunHeader, write_header
from rig.runfile.layout import CYCLE, FLAGS, TIME
from rig.runfile.recover import compact
from rig.runfile.seal import hold_while_writing, part_path, seal_file

OUTCOMES = ("COMPLETED", "ABORTED", "TRIPPED", "ERROR", "INTERRUPTED", "")
"""What a run can come to; "" for a recording of another rig. What the gear is worth is never written into a run."""

_CHUNK_ROWS = 8192
_CHUNK_CACHE = 256 * 1024
"""Bytes of each column that stay in memory: a few chunks, all that an appending writer needs. The
library's own 8 MB per
column would grow for half an hour of every run."""
_INT32 = np.iinfo(np.int32)
_BUFFERS = {"float64": np.float64}
"""What the numbers of a column are taken in until they are written, by its type; counts in 64 bits."""


class RunWriter:
    """One run that is being written to `<path>.part`; `path` is its final name, `<number>-<protocol>-<serial>.h5`.

    `compress`: compress while writing (for rigs in virtual time, whose rows come in whole chunks).
    Without it the chunks are stored as they are, may be flushed as often as one likes without
    growing the file, and are compressed when it is sealed. Every failure of the disk is a
    `RunFileError`; afterwards the writer refuses everything but `abandon`.
    """

    def __init__(
        self, path: Path, header: RunHeader, *, compress: bool = True, chunk_rows: int = _CHUNK_ROWS
    ) -> None:
        self.path, self.part, self.header = path, part_path(path), header
        self._compress, self._chunk_rows, self._epoch_ns = compress, chunk_rows, header.epoch_ns
        self._buffers: list[NDArray[Any]] = [
            np.empty(chunk_rows, np.int64),
            np.empty(chunk_rows, np.int64),
        ]
        self._buffers.append(np.empty(chunk_rows, np.uint16))
        kinds = [_BUFFERS.get(column.dtype, np.int64) for column in header.columns]
        self._buffers += [np.empty(chunk_rows, kind) for kind in kinds]
        self._start = self._filled = self._stored = 0
        self._next_cycle: int | None = None
        self._segments: list[Segment] = []
        self._changed_segments: set[int] = set()
        self._segment_rows: dict[int, int] = {}
        self._events: list[Event] = []
        self._dropped = 0
        self._failure: RunFileError | None = None
        self._file, self._datasets = self._create(header)
        self._chunks = [ChunkWriter(dataset) for dataset in self._datasets if compress]
        self._release = hold_while_writing(self.part)

    def _create(self, header: RunHeader) -> tuple[h5py.File, list[h5py.Dataset]]:
        if self.path.exists():
            raise RunFileError(
                "there is a run of this name already",
                where=str(self.path),
                remedy="Take a new number.",
            )
        with self._disk("cannot be created"):
            # The library's own lock is gone as soon as SWMR begins; `hold_while_writing` keeps one.
            file = h5py.File(
                self.part,
                "x",
                libver=layout.LIBRARY_VERSION,
                rdcc_nbytes=_CHUNK_CACHE,
                locking=False,
            )
            try:
                write_header(file, header)
                datasets = layout.create_data(
                    file, header.columns, self._chunk_rows, compress=self._compress
                )
                layout.create_tables(file)
                # Everything exists and is on its way to the disk before SWMR begins: what is created later is lost,
                # and the library says nothing.
                file.flush()
                file.swmr_mode = True
            except BaseException:
                close_without_writing(file)
                raise
            names = [TIME, CYCLE, FLAGS, *(column.name for column in header.columns)]
            return file, [datasets[name] for name in names]
        raise AssertionError

    @property
    def rows(self) -> int:
        """Rows taken so far, flushed or not."""
        return self._start + self._filled

    @property
    def rows_stored(self) -> int:
        """Rows that the file holds: those of the latest flush or later."""
        return self._start + self._stored

    @property
    def rows_dropped(self) -> int:
        """Cycles that never became a row: gaps in the cycle index, and rows that a full ring refused."""
        return self._dropped

    def append(self, block: SampleBlock) -> None:
        """Take the rows of a block; a gap to the block before is counted and noted as an event."""
        self._refuse_after_failure()
        if not len(block):
            return
        if self._next_cycle is not None and block.first_cycle != self._next_cycle:
            missing = block.first_cycle - self._next_cycle
            if missing < 0:
                raise RunFileError(
                    "a block came out of order",
                    where=str(self.part),
                    value=f"first cycle {block.first_cycle}",
                    limit=f">= {self._next_cycle}",
                )
            self._dropped += missing
            text = (
                f"{missing} cycles are missing before cycle {block.first_cycle} (row {self.rows})"
            )
            self.event(
                Event(
                    int(block.time_ns[0]) + self._epoch_ns,
                    "warning",
                    "CYCLES_MISSING",
                    "recorder",
                    text,
                )
            )
        self._next_cycle = block.first_cycle + len(block)
        cycles = np.arange(block.first_cycle, self._next_cycle)
        times = block.time_ns + self._epoch_ns if self._epoch_ns else block.time_ns
        self.append_rows(
            times, cycles, block.flags, [block.counts[:, i] for i in range(block.counts.shape[1])]
        )

    def append_rows(
        self,
        time_ns: NDArray[np.int64],
        cycles: NDArray[np.int64],
        flags: NDArray[np.uint16],
        stored: Sequence[NDArray[Any]],
    ) -> None:
        """Take rows column by column: calendar times [ns], cycle indices, flags, and the stored
        numbers of each channel.
        """
        self._refuse_after_failure()
        parts = [time_ns, cycles, flags, *stored]
        if len(parts) != len(self._buffers) or len({len(part) for part in parts}) != 1:
            raise RunFileError(
                "rows do not fit the channels of the run",
                where=str(self.part),
                value=f"{len(stored)} columns of {sorted({len(part) for part in parts})} rows",
                limit=f"{len(self._buffers) - 3} columns of one length",
            )
        done, total = 0, len(time_ns)
        while done < total:
            count = min(total - done, self._chunk_rows - self._filled)
            for buffer, part in zip(self._buffers, parts, strict=True):
                buffer[self._filled : self._filled + count] = part[done : done + count]
            self._filled += count
            done += count
            if self._filled == self._chunk_rows:
                self._store_rows()

    def segment(self, segment: Segment) -> None:
        """Note a segment; the same index again replaces it. A stop of -1 says that it has not ended yet."""
        self._refuse_after_failure()
        row = self._segment_rows.setdefault(segment.index, len(self._segments))
        if row == len(self._segments):
            self._segments.append(segment)
        else:
            self._segments[row] = segment
        self._changed_segments.add(row)

    def event(self, event: Event) -> None:
        """Note something that happened."""
        self._refuse_after_failure()
        self._events.append(event)

    def count_dropped(self, rows: int) -> None:
        """Count rows that never reached the writer."""
        self._dropped += rows

    def flush(self) -> None:
        """Bring everything so far to the operating system: from here on it survives the death of this process."""
        self._refuse_after_failure()
        self._store_rows()
        with self._disk("cannot be written"):
            self._store_tables()
            self._file.flush()
            # The counters come last: a full disk may lengthen columns whose rows it did not take.
            process = self._file[layout.PROCESS]
            assert isinstance(process, h5py.Group)
            layout.rewrite_field(process, "rows_written", self.rows)
            layout.rewrite_field(process, "rows_dropped", self._dropped)

    def synchronise(self) -> None:
        """Flush, bring it to the disk (fsync), and make sure that the file is still where it was."""
        self.flush()
        with self._disk("cannot be written"):
            descriptor = self._file.id.get_vfd_handle()
            os.fsync(descriptor)
            here, there = os.fstat(descriptor), os.stat(self.part)
            if here.st_ino and (here.st_ino, here.st_dev) != (there.st_ino, there.st_dev):
                raise FileNotFoundError("it was replaced by another file")

    def seal(
        self, outcome: str, end_time: str = "", acquisition: Mapping[str, Any] | None = None
    ) -> Path:
        """Write outcome, end time and the figures of the acquisition, close, hash, rename and protect the file.

        Returns its final path.
        """
        if outcome not in OUTCOMES:
            raise RunFileError(
                "is no outcome of a run",
                where="outcome",
                value=outcome,
                limit=", ".join(OUTCOMES[:-1]),
            )
        self.flush()
        with self._disk("cannot be completed"):
            write_closing(
                self._file,
                Closing(end_time, outcome, layout.COMPLETE, acquisition_text(acquisition or {})),
            )
            self._file.flush()
            # A file that was unlinked while it was open takes every write, and is gone when it is closed.
            if not self.part.exists():
                raise FileNotFoundError("it was removed")
            self._file.close()
        self._release()
        if self._compress:
            return seal_file(self.part, self.path)
        return compact(self.part, self.path)

    def abandon(self) -> None:
        """Let go of the file as it is, to be recovered; never raises."""
        if self._failure is None:
            self._failure = RunFileError("the run was abandoned", where=str(self.part))
        close_without_writing(self._file)
        self._release()

    def _store_rows(self) -> None:
        """Write the rows of the buffer that the file does not hold yet; start a new chunk when this one is full."""
        first, last = self._start + self._stored, self._start + self._filled
        is_whole = bool(self._chunks) and last - first == self._chunk_rows
        if last > first:
            with self._disk("cannot be written"):
                for i, (buffer, dataset) in enumerate(
                    zip(self._buffers, self._datasets, strict=True)
                ):
                    part = buffer[self._stored : self._filled]
                    if dataset.dtype == np.int32:
                        self._refuse_wide_counts(part, str(dataset.name))
                    if is_whole:
                        self._chunks[i].append(first, part)
                    else:
                        _append(dataset, first, last, part)
        self._stored = self._filled
        if self._filled == self._chunk_rows:
            self._start += self._filled
            self._filled = self._stored = 0

    def _store_tables(self) -> None:
        if self._changed_segments:
            table = self._file[layout.SEGMENTS]
            assert isinstance(table, h5py.Dataset)
            first = min(self._changed_segments)
            rows = [_segment_row(segment) for segment in self._segments[first:]]
            table.resize((len(self._segments),))
            table[first:] = np.array(rows, dtype=layout.SEGMENT_TYPE)
            self._changed_segments.clear()
        if self._events:
            table = self._file[layout.EVENTS]
            assert isinstance(table, h5py.Dataset)
            before = table.shape[0]
            table.resize((before + len(self._events),))
            table[before:] = np.array(
                [_event_row(event) for event in self._events], dtype=layout.EVENT_TYPE
            )
            self._events.clear()

    def _refuse_wide_counts(self, counts: NDArray[np.int64], name: str) -> None:
        if counts.min() < _INT32.min or counts.max() > _INT32.max:
            worst = counts[np.argmax(np.abs(counts))]
            raise RunFileError(
                "a count does not fit its column",
                where=f"{self.part}: {name}",
                value=int(worst),
                limit="32 bits",
                remedy="Check the scale of this channel.",
            )

    def _refuse_after_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    @contextlib.contextmanager
    def _disk(self, what: str) -> Iterator[None]:
        """Turn a failure of the disk into a `RunFileError`, and remember it."""
        try:
            yield
        except RigError as error:
            self._failure = error if isinstance(error, RunFileError) else None
            raise
        except (OSError, RuntimeError, ValueError, KeyError) as error:
            remedy = "What was flushed stays readable: make room or name another folder, then `rig recover`."
            if what == "cannot be created":
                remedy = "Name a folder that exists and can be written."
            self._failure = RunFileError(
                f"the run file {what}: {reason(error)}", where=str(self.part), remedy=remedy
            )
            raise self._failure from error


def _append(dataset: h5py.Dataset, first: int, last: int, part: NDArray[Any]) -> None:
    """Rows [first, last) at the end of a column, by the library's own calls.

    In a run in real time every microsecond of the interpreter is taken from the loop:
    `dataset[first:last] = part` costs three times as many.
    """
    column = dataset.id
    column.set_extent((last,))
    place = column.get_space()
    place.select_hyperslab((first,), (last - first,))
    column.write(h5py.h5s.create_simple((last - first,)), place, np.ascontiguousarray(part))


def _segment_row(segment: Segment) -> tuple[Any, ...]:
    label, _ = layout.fixed_bytes(segment.label, layout.SEGMENT_TYPE["label"].itemsize)
    return (
        segment.index,
        label,
        segment.start,
        segment.stop,
        segment.setpoint,
        segment.direction,
        segment.repeat,
    )


def _event_row(event: Event) -> tuple[Any, ...]:
    cut = [
        layout.fixed_bytes(getattr(event, name), layout.EVENT_TYPE[name].itemsize)
        for name in ("level", "code", "source", "text")
    ]
    return (event.time_ns, *(raw for raw, _ in cut), any(truncated for _, truncated in cut))
