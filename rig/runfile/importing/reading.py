"""One pass through the files of a recording: rows joined, times made, wrapped columns unwrapped, oddities noticed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.recording import Segment
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.derived import derived_channels
from rig.runfile.importing.segments import SteadyStretches, TimedSegments
from rig.runfile.importing.streams import LeftOut, Piece, joined
from rig.runfile.importing.wiring import Wiring, wire
from rig.runfile.importing.wraps import range_like, wraps
from rig.runfile.layout import Column

_FASTER = 1.5
"""How many times the speed elsewhere an angle may have gone in a gap; a wrap would be far faster."""
_FASTEST_RAD_S = 4000.0
"""An angle that turns faster than this (38 000 r/min) has the wrong unit."""
ANGLES = ("input_angle", "output_angle", "position")
"""The channels whose direction labels stretches, the first that is there."""


@dataclass(frozen=True)
class Rows:
    """Rows that are kept: times [ns], row numbers of the table, and the stored numbers by channel."""

    time_ns: NDArray[np.int64]
    cycles: NDArray[np.int64]
    stored: list[NDArray[Any]]


class Reading:
    """The state of the pass: what was seen, left out, and is worth a note."""

    def __init__(
        self,
        tables: Sequence[Table],
        options: ImportOptions,
        sources: Sequence[ChannelSource] | None = None,
    ) -> None:
        self._tables, self._options = tables, options
        self._left_out = LeftOut(options.drop_bad_rows)
        self._wiring: Wiring = wire(tables, sources or options.channels, options, self._left_out)
        self._recorded: tuple[Column, ...] = self._wiring.columns
        self.written = {
            column.name: text
            for column, text in zip(self._recorded, self._wiring.written, strict=True)
        }
        self.derived = derived_channels(options, self._recorded)
        self.columns: tuple[Column, ...] = (*self._recorded, *(one.column for one in self.derived))
        self.rate, self.start_ns = self._wiring.rate, self._wiring.start_ns
        self._is_timed = self._wiring.streams[0].time is not None
        self._turns = np.zeros(len(self.columns))
        self._last = np.full(len(self.columns), np.nan)
        self._tails = [np.zeros(0) for _ in self.columns]
        self.gaps = 0
        self._timed_segments = TimedSegments(options.segments)
        self._stretches = SteadyStretches()
        self._deciding = self._deciding_channel()
        self._first_ns: int | None = None
        self.last_ns = -(2**63)
        self.rows = 0
        self._fastest: dict[str, float] = {}
        self._jumps: dict[str, tuple[int, float]] = {}
        self.notes: list[str] = [note for table in tables for note in table.notes]
        self.notes += self._wiring.remarks
        self.notes += [f"{one.column.name} is {one.origin}" for one in self.derived]

    @property
    def dropped(self) -> int:
        """Rows that were left out."""
        return self._left_out.rows

    def batches(self) -> Iterator[Rows]:
        """The rows that are kept, a batch at a time."""
        wiring = self._wiring
        options = self._options
        for piece in joined(
            wiring.streams, self._left_out, interpolate=options.interpolate, gap=options.gap
        ):
            times = self._times(piece)
            stored = [
                self._stored(column, index, piece.values[:, place], piece)
                for index, (column, place) in enumerate(
                    zip(self._recorded, wiring.places, strict=True)
                )
            ]
            stored += self._computed_columns(times, stored)
            self._watch(times, stored, piece)
            self.rows += len(times)
            self.last_ns = int(times[-1])
            yield Rows(times, piece.cycles, stored)

    def _computed_columns(
        self, times: NDArray[np.int64], stored: list[NDArray[Any]]
    ) -> list[NDArray[Any]]:
        """The numbers of the channels that no column holds."""
        if not self.derived:
            return []
        assert self._first_ns is not None
        seconds = np.asarray((times - self._first_ns) * 1e-9, dtype=np.float64)
        si = {
            column.name: column.channel.to_si(values)
            for column, values in zip(self._recorded, stored, strict=True)
        }
        return [one.values(si, seconds) for one in self.derived]

    def close_notes(self, rate: float) -> None:
        """What can be said only after the last row."""
        self.notes += [n for table in self._tables for n in table.notes if n not in self.notes]
        for stream in self._wiring.streams:
            self.notes += stream.notes
        if self.dropped:
            self.notes.append(self._left_out.words)
        for name, speed in self._fastest.items():
            if speed > _FASTEST_RAD_S:
                self.notes.append(
                    f"WARNING: {name} turns at up to {speed:.3g} rad/s: is its unit right?"
                )
        for name, (count, size) in self._jumps.items():
            self.notes.append(
                f"WARNING: {name} jumps {count} times, by {size:.6g} of its column, as if it were wrapped"
            )
        if self._is_timed and not 0.01 <= rate <= 10e6:
            self.notes.append(
                f"WARNING: the sample rate is {rate:.3g} Hz: is the unit of the time column right?"
            )
        if self._is_timed and self.gaps:
            self.notes.append(
                f"WARNING: {self.gaps} steps of the time are longer than {self._options.gap:g} times the usual one"
            )

    def segments(self, rows: int) -> Iterator[Segment]:
        """The segments as rows: those of the table of times, then those of a column or of set-points."""
        timed = list(self._timed_segments.segments(rows))
        yield from timed
        if self._options.segments_from is not None:
            found = self._stretches.segments(self._options.segments_from, self._wiring.words)
            for index, segment in enumerate(found, len(timed)):
                yield Segment(**{**segment.__dict__, "index": index})

    def _deciding_channel(self) -> int | None:
        """The channel of set-points that makes segments, None where there is none."""
        wanted = self._options.segments_from
        if wanted is None or not wanted.setpoint:
            return None
        names = [column.name for column in self.columns]
        if wanted.setpoint not in names:
            raise ConfigurationError(
                "there is no such channel",
                where="segments_from.setpoint",
                value=wanted.setpoint,
                limit=", ".join(names),
            )
        return names.index(wanted.setpoint)

    def _times(self, piece: Piece) -> NDArray[np.int64]:
        if self._is_timed:
            times = piece.stamps
        elif self.rate is not None:
            times = np.rint(piece.cycles * (1e9 / self.rate)).astype(np.int64)
        else:
            times = piece.cycles.astype(np.int64)
        if self._first_ns is None:
            self._first_ns = int(times[0])
        self._timed_segments.see(times, self._first_ns)
        return times

    def _stored(
        self, column: Column, index: int, values: NDArray[np.float64], piece: Piece
    ) -> NDArray[Any]:
        modulus = self._wiring.sources[index].modulus
        if modulus:
            outside = np.flatnonzero(np.abs(values) > modulus)
            if len(outside):
                table = self._wiring.streams[0].table
                raise RunFileError(
                    "the column goes beyond the range after which it should wrap",
                    where=f"{table.path}, {table.line_word} {int(piece.lines[outside[0]])}, "
                    f"channel {column.name}",
                    value=float(values[outside[0]]),
                    limit=f"{modulus:g}",
                    remedy="Correct the modulus of the channel.",
                )
            before = values[0] if np.isnan(self._last[index]) else self._last[index]
            turns = self._turns[index] - np.cumsum(
                np.rint(np.diff(values, prepend=before) / modulus)
            )
            self._turns[index] = turns[-1]
            values = values + turns * modulus
            self._last[index] = values[-1] - turns[-1] * modulus
        if column.channel.unit == "rad":
            self._watch_jumps(column, index, values, piece)
        return np.rint(values).astype(np.int64) if column.dtype == "int64" else values

    def _watch_jumps(
        self, column: Column, index: int, values: NDArray[np.float64], piece: Piece
    ) -> None:
        """Notice an angle that is wrapped, and refuse it unless the jumps were said to be real."""
        tail = self._tails[index]
        seen = np.concatenate([tail, values])
        self._tails[index] = seen[-3:]
        jumps = wraps(seen, column.channel.scale)
        # What lies in the tail was looked at with the rows before.
        jumps = jumps[jumps + 1 >= len(tail)] - len(tail)
        jumps = jumps[~np.isin(jumps, self._gone_in_gaps(piece, values))]
        if not len(jumps):
            return
        size = float(np.abs(seen[jumps + len(tail)] - seen[jumps + len(tail) - 1]).max())
        if not self._options.allow_jumps:
            table = self._wiring.streams[0].table
            raise RunFileError(
                "the angle jumps as if it were wrapped",
                where=f"{table.path}, {table.line_word} {int(piece.lines[max(jumps[0], 0)])}, "
                f"channel {column.name}",
                value=f"{size:.6g} of the column, back while it goes on",
                limit="steps as those beside it",
                remedy=f"Give the range of the column, for instance --modulus {column.name}={range_like(size):g}; "
                "or say with --allow-jumps that it jumped so.",
            )
        count, largest = self._jumps.get(column.name, (0, 0.0))
        self._jumps[column.name] = (count + len(jumps), max(largest, size))

    def _gone_in_gaps(self, piece: Piece, values: NDArray[np.float64]) -> NDArray[np.intp]:
        """The rows of a piece before which a gap of the time was long enough for the way that was gone in it."""
        lasting, way = np.diff(piece.stamps), np.abs(np.diff(values))
        if not self._is_timed or not len(lasting):
            return np.zeros(0, dtype=np.intp)
        is_gap = lasting > self._options.gap * np.median(lasting)
        fastest = float((way / lasting)[~is_gap].max(initial=0.0))
        return np.flatnonzero(is_gap & (way <= _FASTER * fastest * lasting)) + 1

    def _watch(self, times: NDArray[np.int64], stored: list[NDArray[Any]], piece: Piece) -> None:
        """Look for numbers that point to a wrong unit, for gaps, and for stretches with labels."""
        self._watch_stretches(times, stored, piece)
        if len(times) < 2 or self._options.no_time:
            return
        steps = np.diff(times) * 1e-9
        longest = self._options.gap * float(np.median(steps))
        since = (int(times[0]) - self.last_ns) * 1e-9 if self.rows else 0.0
        self.gaps += int(np.count_nonzero(steps > longest)) + (since > longest)
        for column, values in zip(self.columns, stored, strict=True):
            if column.channel.unit == "rad":
                fastest = float(np.median(np.abs(np.diff(values) * column.channel.scale) / steps))
                self._fastest[column.name] = max(fastest, self._fastest.get(column.name, 0.0))

    def _watch_stretches(
        self, times: NDArray[np.int64], stored: list[NDArray[Any]], piece: Piece
    ) -> None:
        if self._options.segments_from is None:
            return
        if self._deciding is not None:
            column = self.columns[self._deciding]
            deciding = column.channel.to_si(stored[self._deciding])
        else:
            assert self._wiring.labels is not None
            deciding = piece.values[:, self._wiring.labels]
        names = [column.name for column in self.columns]
        at = next((names.index(name) for name in ANGLES if name in names), None)
        angle = None if at is None else self.columns[at].channel.to_si(stored[at])
        self._stretches.see(deciding, times, angle)


def reversed_rows(
    tables: Sequence[Table], options: ImportOptions, columns: Sequence[Column]
) -> Reading:
    """The reverse half of a table that has both directions in one row, as rows of the same channels.

    Its own signs and units hold; the numbers are stored as those of the forward half would be.
    """
    names = [column.name for column in columns]
    if sorted(source.name for source in options.reverse) != sorted(names):
        raise ConfigurationError(
            "does not have the channels of the forward half",
            where="reverse",
            value=", ".join(source.name for source in options.reverse),
            limit=", ".join(names),
            remedy="Map each channel for both, with its own column, unit and sign.",
        )
    if not options.no_time:
        raise ConfigurationError(
            "both directions in one row are a table without a time base",
            where="reverse",
            remedy="Add --no-time.",
        )
    if any(column.dtype == "int64" for column in columns):
        raise ConfigurationError("counts have one direction only", where="reverse")
    by_name = {source.name: source for source in options.reverse}
    return _ReversedReading(tables, options, [by_name[name] for name in names], columns)


class _ReversedReading(Reading):
    """A reading whose numbers are stored with the scale of other columns."""

    def __init__(
        self,
        tables: Sequence[Table],
        options: ImportOptions,
        sources: Sequence[ChannelSource],
        columns: Sequence[Column],
    ) -> None:
        super().__init__(tables, options, sources)
        for mine, other in zip(self.columns, columns, strict=True):
            if mine.channel.unit != other.channel.unit:
                raise ConfigurationError(
                    "has another unit in reverse",
                    where=mine.name,
                    value=mine.channel.unit,
                    limit=other.channel.unit,
                )
        self._others = columns

    def _stored(
        self, column: Column, index: int, values: NDArray[np.float64], piece: Piece
    ) -> NDArray[Any]:
        other = self._others[index].channel
        own = column.channel.to_si(super()._stored(column, index, values, piece))
        return (own - other.offset) / other.gain
