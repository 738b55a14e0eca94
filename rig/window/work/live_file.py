"""The growing run file as the window reads it: every row once, block by block, within a time allowed per look.

Rows become envelopes (smallest and largest value per bin), whose bins are joined in pairs when
there are too many: memory stays the same however long the run is, and no peak is lost on the way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.samples import CycleFlag
from experiments.recording import Segment
from rig.errors import RunFileError
from rig.runfile.read import close_recording, follow, open_run

FloatArray = NDArray[np.float64]
BLOCK_ROWS = 8192
"""Rows that are read at once: a chunk of the file."""
_TABLE_INTERVAL = 0.25
"""s between two looks at the tables of segments and events, which are read whole."""


@dataclass(frozen=True)
class Block:
    """New rows: index of the first, time since the first row of the run [s], channels in SI, which
    rows are complete.
    """

    start: int
    time: FloatArray
    si: Mapping[str, FloatArray]
    good: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time)


class LiveFile:
    """A run file that may still grow. Raises `RunFileError` for a file that cannot be opened.

    `want` says which channels are read; `rows_read` counts every row that was handed on.
    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self.path, self._clock = path, clock
        self.recording = open_run(path, digest=False)
        self.rows_read = 0
        self._names: tuple[str, ...] = ()
        self._segments_seen = 0
        self._is_open = True
        self._looked = -_TABLE_INTERVAL
        self._origin_ns: int | None = None
        self._latest_ns = np.iinfo(np.int64).min

    def want(self, names: Collection[str]) -> None:
        """The channels to be read; those that the run lacks are left out."""
        self._names = tuple(name for name in sorted(names) if self.recording.has(name))

    @property
    def rows(self) -> int:
        """Rows in the file at the latest look."""
        return self.recording.rows

    @property
    def behind(self) -> int:
        """Rows that the file has and that were not handed on yet."""
        return self.rows - self.rows_read

    def look(self) -> None:
        """See how far the file has grown, and now and then what its tables say."""
        now = self._clock()
        if now - self._looked >= _TABLE_INTERVAL:
            self._looked = now
            self.recording = follow(self.recording)
        else:
            refresh = getattr(self.recording.source, "refresh", None)
            if refresh is not None:
                refresh()

    def read(self, allowed: float, take: Callable[[Block], None]) -> int:
        """Hand on new rows until there are none or the time allowed [s] is up; returns how many."""
        begin, before = self._clock(), self.rows_read
        while self.behind and (self._clock() - begin < allowed or self.rows_read == before):
            # Blocks end where the chunks of the file end: each chunk is unpacked once.
            stop = min((self.rows_read // BLOCK_ROWS + 1) * BLOCK_ROWS, self.rows)
            take(self._block(self.rows_read, stop))
            self.rows_read = stop
        return self.rows_read - before

    def next_segment(self) -> Segment | None:
        """The next segment that has ended and whose rows were handed on; each is told once."""
        segments = self.recording.segments
        if (
            self._segments_seen >= len(segments)
            or segments[self._segments_seen].stop > self.rows_read
        ):
            return None
        self._segments_seen += 1
        return segments[self._segments_seen - 1]

    def continue_in(self, path: Path) -> None:
        """Go on in the sealed file: the same rows under another name. The growing file is let go of first."""
        if path == self.path and self._is_open:
            return
        self.close()
        self.path, self.recording = path, open_run(path, digest=False)
        self._is_open = True
        self._looked = -_TABLE_INTERVAL

    def close(self) -> None:
        """Let go of the file."""
        self._is_open = False
        close_recording(self.recording)

    def _block(self, start: int, stop: int) -> Block:
        recording, rows = self.recording, slice(start, stop)
        stamps = recording.source.time_ns(start, stop)
        if self._origin_ns is None:
            self._origin_ns = int(stamps[0])
        good = (recording.flags(rows) & CycleFlag.INCOMPLETE) == 0
        # A clock that was set back does not draw a curve backwards: such rows stay in the file and out of the plots.
        latest = np.maximum.accumulate(np.append(self._latest_ns, stamps))
        good &= stamps > latest[:-1]
        self._latest_ns = int(latest[-1])
        channels = {name: recording.si(name, rows) for name in self._names}
        return Block(
            start, np.asarray((stamps - self._origin_ns) * 1e-9, dtype=np.float64), channels, good
        )


class Envelope:
    """Smallest and largest value of a signal per bin of rows, at most `bins` of them; two bins
    become one when it is full.
    """

    def __init__(self, bins: int = 768) -> None:
        self._bins, self._span = bins, 1
        self._time = np.empty(bins)
        self._low, self._high = np.empty(bins), np.empty(bins)
        self._count = 0
        self._rest_time: FloatArray = np.empty(0)
        self._rest: FloatArray = np.empty(0)

    def add(self, time_s: FloatArray, values: FloatArray) -> None:
        """Take in rows."""
        stamps, rows = time_s, values
        if len(self._rest):
            stamps = np.concatenate([self._rest_time, time_s])
            rows = np.concatenate([self._rest, values])
        while True:
            whole = len(rows) // self._span
            room = self._bins - self._count
            taken = min(whole, room)
            if taken:
                cut = taken * self._span
                fresh = slice(self._count, self._count + taken)
                self._time[fresh] = stamps[: cut : self._span]
                self._low[fresh] = np.fmin.reduce(rows[:cut].reshape(taken, -1), axis=1)
                self._high[fresh] = np.fmax.reduce(rows[:cut].reshape(taken, -1), axis=1)
                self._count += taken
                stamps, rows = stamps[cut:], rows[cut:]
            if self._count == self._bins:
                self._halve()
            if len(rows) < self._span:
                break
        self._rest_time, self._rest = stamps.copy(), rows.copy()

    def _halve(self) -> None:
        half = self._bins // 2
        self._time[:half] = self._time[: 2 * half : 2]
        self._low[:half] = np.fmin(self._low[: 2 * half : 2], self._low[1 : 2 * half : 2])
        self._high[:half] = np.fmax(self._high[: 2 * half : 2], self._high[1 : 2 * half : 2])
        self._count, self._span = half, 2 * self._span

    def curve(self) -> tuple[FloatArray, FloatArray]:
        """A line that touches the smallest and the largest value of every bin, rows that fill no bin yet included."""
        n = self._count
        stamps, low, high = self._time[:n], self._low[:n], self._high[:n]
        if len(self._rest):
            stamps = np.append(stamps, self._rest_time[0])
            low, high = (
                np.append(low, np.fmin.reduce(self._rest)),
                np.append(high, np.fmax.reduce(self._rest)),
            )
        if self._span == 1:
            return stamps.copy(), low.copy()
        across = np.repeat(stamps, 2)
        along = np.empty(2 * len(stamps))
        # Up and down in turn, so that neighbouring bins join without crossing strokes.
        along[0::4], along[1::4] = low[0::2], high[0::2]
        along[2::4], along[3::4] = high[1::2], low[1::2]
        return across, along


class RollingEnvelope:
    """Smallest and largest value per bin of time over the latest `span` seconds: a ring of fixed size."""

    def __init__(self, span: float = 20.0, bins: int = 600) -> None:
        self._width, self._bins = span / bins, bins
        self._low, self._high = np.full(bins, np.nan), np.full(bins, np.nan)
        self._last = -1

    def add(self, time_s: FloatArray, values: FloatArray) -> None:
        """Take in rows in the order of time."""
        if not len(time_s):
            return
        index = np.floor(time_s / self._width).astype(np.int64)
        last = int(index[-1])
        first_bin = last - self._bins + 1
        keep = index >= first_bin
        index, values = index[keep], values[keep]
        # Bins that nothing fell into yet are empty again.
        fresh = np.arange(max(self._last + 1, first_bin), last + 1) % self._bins
        self._low[fresh] = self._high[fresh] = np.nan
        edges = np.flatnonzero(np.diff(index, prepend=index[0] - 1))
        where = index[edges] % self._bins
        self._low[where] = np.fmin(self._low[where], np.fmin.reduceat(values, edges))
        self._high[where] = np.fmax(self._high[where], np.fmax.reduceat(values, edges))
        self._last = max(self._last, last)

    def curve(self) -> tuple[FloatArray, FloatArray]:
        """A line that touches the smallest and the largest value of every bin."""
        index = np.arange(max(self._last - self._bins + 1, 0), self._last + 1)
        where = index % self._bins
        along = np.empty(2 * len(index))
        along[0::2], along[1::2] = self._low[where], self._high[where]
        keep = np.isfinite(along)
        return np.asarray(np.repeat(index * self._width, 2)[keep], dtype=np.float64), along[keep]


class SlidingSpeed:
    """Speed from an angle, as its difference over a fixed time: counts are too coarse for the
    difference of two cycles.
    """

    def __init__(self, period: float, window: float = 0.02) -> None:
        self._lag = max(1, round(window / period))
        self._angle: FloatArray = np.empty(0)
        self._time: FloatArray = np.empty(0)

    def of(self, block: Block, name: str) -> tuple[FloatArray, FloatArray]:
        """Times [s] and speeds [rad/s] of the complete rows of a block; shorter than the block only at the start."""
        angle = np.concatenate([self._angle, block.si[name][block.good]])
        stamps = np.concatenate([self._time, block.time[block.good]])
        self._angle, self._time = angle[-self._lag :], stamps[-self._lag :]
        if len(angle) <= self._lag:
            return np.empty(0), np.empty(0)
        passed = stamps[self._lag :] - stamps[: -self._lag]
        return stamps[self._lag :], (angle[self._lag :] - angle[: -self._lag]) / np.maximum(
            passed, 1e-9
        )


def open_live(path: Path) -> LiveFile | None:
    """A live file, or None while it cannot be opened yet (its writer is just making it, or has just renamed it)."""
    for candidate in (path, path.with_name(path.name.removesuffix(".part"))):
        try:
            return LiveFile(candidate)
        except RunFileError:
            continue
    return None
