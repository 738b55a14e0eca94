"""Columns of a file that were sampled at one and the same time, and several of them brought together.

Streams join row by row where their stamps are equal (times in nanoseconds, or row numbers where
there is no time). Where they are not, nothing is resampled unless that was asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.content.phrase import phrase, quoted
from rig.errors import RunFileError
from rig.runfile.importing.adapters.table import BadCell, Batch, CellReader, Table
from rig.runfile.importing.clocks import LATEST_S, NumberClock, TextClock, is_date
from rig.runfile.importing.units import ISO_TIME
from rig.runfile.importing.wraps import wraps

_LISTED_ROWS = 5
_OUTSIDE = "no sample of the other channels before, after or near enough"
_LARGEST_EXACT = 2.0**53
FIRST_STAYS = "Name it as the first channel, whose samples stay as they are, or import it as a run of its own."
"""What to do with a channel that has no values between its samples."""


@dataclass
class LeftOut:
    """Rows that cannot be used: the first is an error; or, where that was asked for, all are counted."""

    is_allowed: bool
    rows: int = 0
    listed: list[str] = field(default_factory=list)

    def refuse(self, table: Table, bad: BadCell, rows: int = 1) -> None:
        """Leave rows out, or raise `RunFileError` with line, column and value."""
        word = table.line_word
        column = phrase(", column {}", bad.column)
        if not self.is_allowed:
            limit = "a finite number"
            remedy = f"Correct the {word}, or leave such rows out with --drop-bad-rows."
            if "increase" in bad.why:
                limit = "a later time than the row before"
                remedy += (
                    f" Of two recordings make two files, or say --rate in place of {bad.column}."
                )
            elif bad.why.startswith("no row"):
                limit = "the same times in all files"
            elif bad.column and is_date(bad.text):
                remedy = f"It is a date: -c {quoted(f'time={bad.column}:{ISO_TIME}')}"
            raise RunFileError(
                bad.why,
                where=f"{table.path}, {word} {bad.line}{column}",
                value=bad.text,
                limit=limit,
                remedy=remedy,
            )
        self.rows += rows
        if len(self.listed) < _LISTED_ROWS:
            many = phrase(" and the {} after it", rows - 1)
            self.listed.append(f"{word} {bad.line}{many}{column}: {bad.why} ({bad.text})")

    def count(self, rows: int, why: str) -> None:
        """Rows that were left out as was asked for."""
        self.rows += rows
        if rows and why not in self.listed:
            self.listed.append(why)

    @property
    def words(self) -> str:
        """How many rows were left out, and the first of them."""
        is_short = self.rows > len(self.listed) and _OUTSIDE not in self.listed
        more = f", and {self.rows - len(self.listed)} more" if is_short else ""
        return f"{self.rows} rows left out: {'; '.join(self.listed)}{more}"


@dataclass(frozen=True)
class Piece:
    """Rows that are kept: stamps (n,), row numbers (n,), line numbers (n,), values (n, columns)."""

    stamps: NDArray[np.int64]
    cycles: NDArray[np.int64]
    lines: NDArray[np.int64]
    values: NDArray[np.float64]

    def rows(self, chosen: NDArray[np.bool_] | slice) -> Piece:
        """Some of the rows."""
        return Piece(
            self.stamps[chosen], self.cycles[chosen], self.lines[chosen], self.values[chosen]
        )

    def after(self, other: Piece) -> Piece:
        """These rows behind those of another piece."""
        return Piece(
            np.concatenate([other.stamps, self.stamps]),
            np.concatenate([other.cycles, self.cycles]),
            np.concatenate([other.lines, self.lines]),
            np.concatenate([other.values, self.values]),
        )


@dataclass(kw_only=True)
class Stream:
    """The wanted columns of one file with their time.

    `names` of the channels that the columns become; `counted` says which must be whole numbers;
    `angles` holds how many rad one of the column's own units is, 0 for what is no angle. `time` is
    the column of time and `clock` what reads it, both None where there is none.
    """

    table: Table
    columns: Sequence[int]
    names: Sequence[str]
    counted: Sequence[bool]
    angles: Sequence[float]
    time: int | None
    clock: NumberClock | TextClock | None
    readers: Mapping[int, CellReader]
    left_out: LeftOut
    notes: list[str] = field(default_factory=list)
    _latest: int = -(2**63)
    _row: int = 0
    _blank: tuple[int, int] = (0, 0)
    """First line and number of rows in which no wanted cell holds anything, as long as none followed."""

    def pieces(self) -> Iterator[Piece]:
        """The rows that are kept, a batch at a time."""
        timed = self.time is not None
        wanted = list(self.columns)
        if self.time is not None:
            wanted.insert(0, self.time)
        for batch in self.table.batches(wanted, self.readers):
            good = self._good_rows(batch)
            cycles = self._row + np.arange(len(batch.lines))
            self._row += len(batch.lines)
            stamps = self._stamps(batch, good) if timed else cycles
            if good.any():
                values = batch.values[:, int(timed) :]
                yield Piece(stamps, cycles, batch.lines, values).rows(good)
        if self._blank[1]:
            self.notes.append(
                f"{', '.join(self.names)}: ended at {self.table.line_word} {self._blank[0] - 1}, "
                f"while others of the file go on"
            )

    def _good_rows(self, batch: Batch) -> NDArray[np.bool_]:
        """Which rows are kept; raises at the first bad one unless they are to be left out."""
        good = np.ones(len(batch.lines), dtype=bool)
        good[list(batch.blank)] = False
        good[list(batch.bad)] = False
        for row in sorted(batch.bad):
            self.left_out.refuse(self.table, batch.bad[row])
        self._watch_the_end(batch, good)
        first = int(self.time is not None)
        for index, (name, counted) in enumerate(zip(self.names, self.counted, strict=True)):
            if counted:
                self._check_counts(batch, good, first + index, name)
        return good

    def _watch_the_end(self, batch: Batch, good: NDArray[np.bool_]) -> None:
        """Blank rows are the end of a column, unless rows follow: then they are holes."""
        if not batch.blank and not self._blank[1]:
            return
        last = int(np.flatnonzero(good).max(initial=-1))
        blank = np.array(sorted(batch.blank), dtype=np.intp)
        self._see_blank(batch.lines[blank[blank < last]])
        first, count = self._blank
        if last >= 0 and count:
            bad = BadCell(first, "", f"{count} such rows", "the cells are empty, and rows follow")
            self.left_out.refuse(self.table, bad, count)
            self._blank = (0, 0)
        self._see_blank(batch.lines[blank[blank > last]])

    def _see_blank(self, lines: NDArray[np.int64]) -> None:
        """Take more blank rows to those before."""
        first, count = self._blank
        if len(lines) and not count:
            first = int(lines[0])
        self._blank = (first, count + len(lines))

    def _check_counts(self, batch: Batch, good: NDArray[np.bool_], index: int, name: str) -> None:
        values = batch.values[:, index]
        with np.errstate(invalid="ignore"):
            wrong = good & ((values != np.rint(values)) | (np.abs(values) >= _LARGEST_EXACT))
        heading = self.table.headings[self.columns[index - int(self.time is not None)]]
        for row in np.flatnonzero(wrong):
            good[row] = False
            text = repr(float(values[row]))
            bad = BadCell(int(batch.lines[row]), heading, text, f"{name} is no whole count")
            self.left_out.refuse(self.table, bad)

    def _stamps(self, batch: Batch, good: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Times [ns] of the good rows; rows whose time does not increase are none."""
        assert self.clock is not None
        assert self.time is not None
        heading = self.table.headings[self.time]
        stamps = np.zeros(len(good), dtype=np.int64)
        rows = np.flatnonzero(good)
        with np.errstate(over="ignore"):
            seconds = self.clock.seconds(batch.values[rows, 0])
        beyond = ~(np.abs(seconds) <= LATEST_S)
        self._refuse_times(batch, good, rows[beyond], heading, "beyond any calendar")
        rows, seconds = rows[~beyond], seconds[~beyond]
        times = self.clock.nanoseconds(seconds)
        reached = np.maximum.accumulate(np.concatenate([[self._latest], times]))
        back = times <= reached[:-1]
        self._refuse_times(batch, good, rows[back], heading, "the time does not increase")
        self._latest = int(reached[-1])
        stamps[rows] = times
        return stamps

    def _refuse_times(
        self,
        batch: Batch,
        good: NDArray[np.bool_],
        rows: NDArray[np.intp],
        heading: str,
        why: str,
    ) -> None:
        for row in rows:
            good[row] = False
            text = repr(float(batch.values[row, 0]))
            self.left_out.refuse(self.table, BadCell(int(batch.lines[row]), heading, text, why))


def joined(
    streams: Sequence[Stream], left_out: LeftOut, *, interpolate: bool, gap: float
) -> Iterator[Piece]:
    """The rows of all streams together, on the stamps of the first one.

    Rows whose stamp is not in all of them are refused (or left out, where that was asked for).
    With `interpolate` the others are brought onto the stamps of the first by straight lines; rows
    before their first sample, after their last, and in their gaps (steps longer than `gap` usual ones) are left out.
    """
    if len(streams) == 1:
        yield from streams[0].pieces()
        return
    if interpolate:
        others = [_Line(stream, gap) for stream in streams[1:]]
        for piece in streams[0].pieces():
            parts = [other.at(piece.stamps) for other in others]
            inside = np.all([np.isfinite(part).all(axis=1) for part in parts], axis=0)
            left_out.count(int(np.count_nonzero(~inside)), _OUTSIDE)
            if inside.any():
                values = np.column_stack([piece.values, *parts])
                yield Piece(piece.stamps, piece.cycles, piece.lines, values).rows(inside)
        return
    yield from _matched(streams, left_out)


def _matched(streams: Sequence[Stream], left_out: LeftOut) -> Iterator[Piece]:
    """Rows with equal stamps; the first stamp that is not in all streams is refused, or left out."""
    sources = [stream.pieces() for stream in streams]
    waiting: list[Piece | None] = [None] * len(streams)
    ended = [False] * len(streams)
    while True:
        for index, source in enumerate(sources):
            held = waiting[index]
            if not ended[index] and (held is None or not len(held.stamps)):
                waiting[index] = next(source, None)
                ended[index] = waiting[index] is None
        held = [piece for piece in waiting if piece is not None and len(piece.stamps)]
        if not held:
            return
        # Up to here every stream that goes on has shown all that it has.
        reach = min(int(piece.stamps[-1]) for piece in held)
        parts = [_up_to(piece, reach) for piece in waiting]
        waiting = [_beyond(piece, reach) for piece in waiting]
        common = parts[0].stamps
        for part in parts[1:]:
            common = np.intersect1d(common, part.stamps, assume_unique=True)
        for stream, part in zip(streams, parts, strict=True):
            _refuse_unmatched(stream, part, common, left_out)
        if len(common):
            chosen = [part.rows(np.isin(part.stamps, common)) for part in parts]
            values = np.column_stack([part.values for part in chosen])
            yield Piece(common, chosen[0].cycles, chosen[0].lines, values)


_NOTHING = Piece(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 0))
)


def _up_to(piece: Piece | None, reach: int) -> Piece:
    return _NOTHING if piece is None else piece.rows(piece.stamps <= reach)


def _beyond(piece: Piece | None, reach: int) -> Piece | None:
    return None if piece is None else piece.rows(piece.stamps > reach)


def _refuse_unmatched(
    stream: Stream, part: Piece, common: NDArray[np.int64], left_out: LeftOut
) -> None:
    """Refuse the rows of a stream that the others don't have; one message for all of a batch."""
    lonely = np.flatnonzero(~np.isin(part.stamps, common))
    if not len(lonely):
        return
    stamp = int(part.stamps[lonely[0]])
    text, what, limit = f"row {stamp + 1}", "number", "as many rows in all"
    if stream.time is not None:
        text, what, limit = f"{stamp * 1e-9:.9g} s", "time", "the same times in all of them"
    why = f"no row of the other columns has this {what}"
    if not left_out.is_allowed:
        raise RunFileError(
            why,
            where=f"{stream.table.path}, {stream.table.line_word} {int(part.lines[lonely[0]])}, "
            f"{', '.join(stream.names)}",
            value=text,
            limit=limit,
            remedy="Import each as a run of its own; or bring them onto the times of the first channel with "
            "--interpolate, or leave such rows out with --drop-bad-rows.",
        )
    left_out.refuse(stream.table, BadCell(int(part.lines[lonely[0]]), "", text, why), len(lonely))


def _without_jumps(stream: Stream) -> Iterator[Piece]:
    """The rows of a stream. Raises `RunFileError` where an angle jumps: a line across the jump is no angle."""
    tail = np.zeros((0, len(stream.columns)))
    for piece in stream.pieces():
        seen = np.concatenate([tail, piece.values])
        for place, scale in enumerate(stream.angles):
            if not scale:
                continue
            jumps = wraps(seen[:, place], scale)
            if len(jumps):
                line = int(piece.lines[max(int(jumps[0]) - len(tail), 0)])
                raise RunFileError(
                    "the angle jumps as if it were wrapped, and no line goes across that",
                    where=f"{stream.table.path}, {stream.table.line_word} {line}, channel {stream.names[place]}",
                    value=f"{abs(seen[jumps[0], place] - seen[jumps[0] - 1, place]):.6g} of the column",
                    limit="steps as those beside it",
                    remedy=FIRST_STAYS,
                )
        tail = seen[-3:]
        yield piece


class _Line:
    """A stream as straight lines between its samples."""

    def __init__(self, stream: Stream, gap: float) -> None:
        self._source = _without_jumps(stream)
        self._gap = gap
        self._columns = len(stream.columns)
        self._held: Piece | None = next(self._source, None)
        self._step = float("nan")

    def at(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Values at these times (n, columns); NaN outside, and in gaps."""
        while self._held is not None and self._held.stamps[-1] < stamps[-1]:
            more = next(self._source, None)
            if more is None:
                break
            self._held = more.after(self._held)
        values = np.full((len(stamps), self._columns), np.nan)
        held = self._held
        if held is None or len(held.stamps) < 2:
            return values
        if np.isnan(self._step):
            self._step = float(np.median(np.diff(held.stamps)))
        right = np.clip(np.searchsorted(held.stamps, stamps), 1, len(held.stamps) - 1)
        width = held.stamps[right] - held.stamps[right - 1]
        inside = (stamps >= held.stamps[0]) & (stamps <= held.stamps[-1])
        exact = (stamps == held.stamps[right]) | (stamps == held.stamps[right - 1])
        inside &= exact | (width <= self._gap * self._step)
        share = ((stamps - held.stamps[right - 1]) / width)[:, np.newaxis]
        lines = (1.0 - share) * held.values[right - 1] + share * held.values[right]
        values[inside] = lines[inside]
        # The two samples around the last time are needed by the next rows.
        keep = max(int(np.searchsorted(held.stamps, stamps[-1])) - 2, 0)
        self._held = held.rows(slice(keep, None))
        return values
