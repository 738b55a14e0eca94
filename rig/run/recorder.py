"""The recorder: what stands between the loop in which the rig turns and the run file.

Two recorders with one interface. In virtual time the writer is inline: one thread, flushed by the
wall clock. In real time a writer thread drains a bounded, preallocated ring, so that the disk never
makes the loop late. A full ring stops the run with an error; nothing is ever dropped in silence.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drivers.clock import Clock, WallClock
from drivers.samples import SampleBlock
from experiments.recording import Event, Segment
from rig.errors import RecorderOverflowError, RigError, RunFileError
from rig.runfile.write import RunWriter

_FLUSH_INTERVAL_S = 0.4
"""s of real time between two flushes of the inline recorder, the first with the first block. It flushes when a
block has come, so that rows lie in the file within 0.5 s wherever a block takes less than 0.1 s.
"""
_SYNCHRONISE_INTERVAL_S = 1.0
_DRAIN_INTERVAL_S = 0.05
_RING_SECONDS = 10.0
_SMALLEST_RING = 10_000
CLOSE_TIMEOUT_S = 60.0


class Recorder(Protocol):
    """Takes what the rig measured and what happened, in order, and seals the run at its end."""

    @property
    def rows(self) -> int:
        """Rows taken so far: the row number that the next block begins with."""
        ...

    def put(self, block: SampleBlock) -> None:
        """Take a block. Raises `RecorderOverflowError` or `RunFileError`; then the run must end."""
        ...

    def segment(self, segment: Segment) -> None:
        """Note a segment; the same index again replaces it, a stop of -1 says that it has not ended yet."""
        ...

    def event(self, event: Event) -> None:
        """Note something that happened."""
        ...

    def flush(self) -> None:
        """Bring everything so far into the file, for a reader of the run that is over but not sealed."""
        ...

    def close(
        self, outcome: str, end_time: str = "", acquisition: Mapping[str, Any] | None = None
    ) -> Path:
        """Write what is left and the figures of the acquisition, seal the run, and return its path."""
        ...

    def abandon(self) -> None:
        """Let go without sealing, after an error; what was flushed can be recovered. Never raises."""
        ...


class InlineRecorder:
    """The recorder of a rig in virtual time: writes in the loop's own thread, flushes by the wall clock."""

    def __init__(
        self,
        writer: RunWriter,
        wall_clock: Clock | None = None,
        flush_interval: float = _FLUSH_INTERVAL_S,
    ) -> None:
        self._writer = writer
        self._flushing = _FlushSchedule(writer, wall_clock or WallClock(), flush_interval)

    @property
    def rows(self) -> int:
        return self._writer.rows

    def put(self, block: SampleBlock) -> None:
        is_first = not self._writer.rows
        self._writer.append(block)
        # A rig in virtual time brings many chunks before the clock asks for the first flush, and
        # without one nothing in the file points to them.
        self._flushing.flush_when_due(at_once=is_first and bool(self._writer.rows))

    def segment(self, segment: Segment) -> None:
        self._writer.segment(segment)

    def event(self, event: Event) -> None:
        self._writer.event(event)
        self._flushing.flush_when_due()

    def flush(self) -> None:
        self._writer.flush()

    def close(
        self, outcome: str, end_time: str = "", acquisition: Mapping[str, Any] | None = None
    ) -> Path:
        return self._writer.seal(outcome, end_time, acquisition)

    def abandon(self) -> None:
        self._writer.abandon()


class ThreadedRecorder:
    """The recorder of a rig in real time: `put` copies into a ring, a writer thread drains it.

    `sample_rate` [Hz] sizes the ring (`ring_seconds` of rows, at least `smallest_ring`). An error
    of the writer is raised by the next call of any method.
    """

    def __init__(
        self,
        writer: RunWriter,
        sample_rate: float,
        *,
        wall_clock: Clock | None = None,
        ring_seconds: float = _RING_SECONDS,
        drain_interval: float = _DRAIN_INTERVAL_S,
        smallest_ring: int = _SMALLEST_RING,
    ) -> None:
        capacity = max(int(np.ceil(sample_rate * ring_seconds)), smallest_ring)
        columns = len(writer.header.columns)
        self._writer, self._capacity, self._drain_interval = writer, capacity, drain_interval
        self._times = np.zeros(capacity, np.int64)
        self._cycles = np.zeros(capacity, np.int64)
        self._flags = np.zeros(capacity, np.uint16)
        self._counts = np.zeros((capacity, columns), np.int64)
        self._taken = self._drained = 0
        self._notes: list[Segment | Event] = []
        self._error: RigError | None = None
        self._closing = self._flush_wanted = False
        self._condition = threading.Condition()
        self._flushing = _FlushSchedule(writer, wall_clock or WallClock(), 0.0)
        self._thread = threading.Thread(
            target=self._write_until_closed, name="recorder", daemon=True
        )
        self._thread.start()

    @property
    def rows(self) -> int:
        return self._taken

    @property
    def capacity(self) -> int:
        """Rows that fit into the ring."""
        return self._capacity

    def put(self, block: SampleBlock) -> None:
        rows = len(block)
        with self._condition:
            self._raise_error()
            waiting = self._taken - self._drained
            if waiting + rows > self._capacity:
                self._error = RecorderOverflowError(
                    "the disk does not keep up: the recorder's ring is full",
                    where=str(self._writer.part),
                    value=f"{waiting} rows waiting and {rows} more",
                    limit=f"{self._capacity} rows",
                    remedy="Lower the sample rate or record to a faster disk; the rows before this are kept.",
                )
                self._writer.count_dropped(rows)
                self._condition.notify_all()
                raise self._error
            self._copy(block, rows)
            self._taken += rows
            if waiting + rows > self._capacity // 2:
                # Otherwise the writer wakes by itself: a flush per block would hold up the loop for
                # as long as it takes.
                self._condition.notify_all()

    def segment(self, segment: Segment) -> None:
        self._note(segment)

    def event(self, event: Event) -> None:
        self._note(event)

    def flush(self) -> None:
        with self._condition:
            self._raise_error()
            self._flush_wanted = True
            self._condition.notify_all()
            if not self._condition.wait_for(
                lambda: not self._flush_wanted or self._error is not None, CLOSE_TIMEOUT_S
            ):
                self._error = self._no_answer()
            self._raise_error()

    def close(
        self, outcome: str, end_time: str = "", acquisition: Mapping[str, Any] | None = None
    ) -> Path:
        self._stop()
        with self._condition:
            self._raise_error()
        return self._writer.seal(outcome, end_time, acquisition)

    def abandon(self) -> None:
        self._stop()
        self._writer.abandon()

    def _note(self, note: Segment | Event) -> None:
        with self._condition:
            self._raise_error()
            self._notes.append(note)

    def _stop(self) -> None:
        with self._condition:
            self._closing = True
            self._condition.notify_all()
        self._thread.join(CLOSE_TIMEOUT_S)
        if self._thread.is_alive():
            with self._condition:
                self._error = self._error or self._no_answer()

    def _no_answer(self) -> RunFileError:
        return RunFileError(
            "the disk does not answer",
            where=str(self._writer.part),
            limit=f"{CLOSE_TIMEOUT_S:g} s",
            remedy="What was flushed stays readable: `rig recover`.",
        )

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error

    def _copy(self, block: SampleBlock, rows: int) -> None:
        done = 0
        while done < rows:
            at = (self._taken + done) % self._capacity
            count = min(rows - done, self._capacity - at)
            here, there = slice(at, at + count), slice(done, done + count)
            self._times[here] = block.time_ns[there]
            self._cycles[here] = np.arange(
                block.first_cycle + done, block.first_cycle + done + count
            )
            self._flags[here] = block.flags[there]
            self._counts[here] = block.counts[there]
            done += count

    def _write_until_closed(self) -> None:
        try:
            while self._drain():
                pass
        except RigError as error:
            self._fail(error)
        except Exception as error:  # noqa: BLE001  nobody else sees it in this thread, and the run would lose its rows
            self._fail(
                RunFileError(
                    f"the run file cannot be written: {error or type(error).__name__}",
                    where=str(self._writer.part),
                    remedy="What was flushed stays readable: `rig recover`.",
                )
            )

    def _fail(self, error: RigError) -> None:
        with self._condition:
            self._error = self._error or error
            self._condition.notify_all()

    def _drain(self) -> bool:
        """Write what waits; False when the recorder is closing and nothing waits any more."""
        with self._condition:
            if not (self._closing or self._flush_wanted):
                self._condition.wait(self._drain_interval)
            flush_wanted = self._flush_wanted
            first, last = self._drained, self._taken
            notes, self._notes = self._notes, []
            closing = self._closing
        # Written without the lock: the loop may go on filling the other end of the ring meanwhile.
        while first < last:
            at = first % self._capacity
            count = min(last - first, self._capacity - at)
            count = self._unbroken(at, count)
            here = slice(at, at + count)
            self._writer.append(
                SampleBlock(
                    int(self._cycles[at]), self._times[here], self._counts[here], self._flags[here]
                )
            )
            first += count
            with self._condition:
                self._drained = first
        for note in notes:
            if isinstance(note, Segment):
                self._writer.segment(note)
            else:
                self._writer.event(note)
        self._flushing.flush_when_due()
        if flush_wanted:
            self._writer.flush()
            with self._condition:
                self._flush_wanted = False
                self._condition.notify_all()
        return not closing

    def _unbroken(self, at: int, count: int) -> int:
        """How many of these rows have consecutive cycles."""
        breaks = np.flatnonzero(np.diff(self._cycles[at : at + count]) != 1)
        return int(breaks[0]) + 1 if len(breaks) else count


class _FlushSchedule:
    """Flushes and synchronises a writer when the clock says so."""

    def __init__(self, writer: RunWriter, clock: Clock, flush_interval: float) -> None:
        self._writer, self._clock = writer, clock
        self._flush_ns = round(flush_interval * 1e9)
        self._flushed_ns = self._synchronised_ns = clock.monotonic_ns()

    def flush_when_due(self, *, at_once: bool = False) -> None:
        now = self._clock.monotonic_ns()
        if now - self._synchronised_ns >= _SYNCHRONISE_INTERVAL_S * 1e9:
            self._writer.synchronise()
            self._flushed_ns = self._synchronised_ns = now
        elif at_once or now - self._flushed_ns >= self._flush_ns:
            self._writer.flush()
            self._flushed_ns = now
