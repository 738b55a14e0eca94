"""One pass through a foreign table: numbers checked, time made, wrapped columns unwrapped, bad rows
refused or left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.recording import Segment
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.tables import BadCell, Batch, Table, find_column, split_heading
from rig.runfile.importing.units import TIME_CHANNEL, UNITS, column_of, unit_of
from rig.runfile.layout import Column

LISTED_ROWS = 5
LARGEST_EXACT = 2.0**53
FASTEST_RAD_S = 4000.0
"""An angle that turns faster than this (38 000 r/min) has the wrong unit."""


@dataclass(frozen=True)
class Rows:
    """Rows that are kept: times [ns], row numbers of the table, and the stored numbers by channel."""

    time_ns: NDArray[np.int64]
    cycles: NDArray[np.int64]
    stored: list[NDArray[Any]]


class Reading:
    """The state of the pass: what was seen, left out, and is worth a note."""

    def __init__(self, table: Table, options: ImportOptions) -> None:
        self._table, self._options = table, options
        sources = {source.name: source for source in options.channels}
        if len(sources) != len(options.channels):
            raise ConfigurationError("a channel is given twice", where="--channel")
        self._time = sources.pop(TIME_CHANNEL, None)
        if not sources:
            raise ConfigurationError(
                "no channels are mapped",
                where=str(table.path),
                limit=", ".join(table.headings[:20]),
                remedy="Give --channel name=column:unit for each, or --map FILE.",
            )
        self._check_time()
        self._sources = tuple(sources.values())
        wanted = [*([self._time] if self._time else []), *self._sources]
        self._indices = [find_column(table, source.column) for source in wanted]
        units = [split_heading(table.headings[index])[1] for index in self._indices]
        units = [_unit_or_nothing(unit) for unit in units]
        self._time_factor = self._time_unit(units[0]) if self._time else 0.0
        self.columns = tuple(
            column_of(source, unit, options.torque_constant)
            for source, unit in zip(self._sources, units[1:] if self._time else units, strict=True)
        )
        self._turns = np.zeros(len(self.columns))
        self._last = np.full(len(self.columns), np.nan)
        self._gaps = 0
        self._edges: list[list[int]] = [[0, 0] for _ in options.segments]
        self._first_ns: int | None = None
        self.last_ns = -(2**63)
        self.rows = self.dropped = self._cycle = 0
        self._fastest: dict[str, float] = {}
        self._bad: list[str] = []
        self.notes: list[str] = []
        for source, unit in zip(wanted, units, strict=True):
            if source.unit and unit and unit_of(source.unit, source.name) != unit:
                self.note(
                    f"WARNING: {source.name} was read in {source.unit}, but its heading says {unit}"
                )

    def batches(self) -> Iterator[Rows]:
        """The rows that are kept, a batch at a time."""
        for batch in self._table.batches(self._indices):
            good = self._good_rows(batch)
            cycles = self._cycle + np.flatnonzero(good)
            self._cycle += len(batch.lines)
            if not good.any():
                continue
            values = batch.values[good]
            times = self._times(values, cycles)
            stored = [
                self._stored(
                    column, index, values[:, index + (self._time is not None)], batch.lines[good]
                )
                for index, column in enumerate(self.columns)
            ]
            self._watch(times, stored)
            self.rows += len(times)
            self.last_ns = int(times[-1])
            yield Rows(times, cycles, stored)

    def note(self, text: str) -> None:
        """Something worth knowing about the import."""
        self.notes.append(text)

    def close_notes(self, rate: float) -> None:
        """What can be said only after the last row."""
        if self.dropped:
            more = (
                f", and {self.dropped - len(self._bad)} more"
                if self.dropped > len(self._bad)
                else ""
            )
            self.note(f"{self.dropped} rows left out: {'; '.join(self._bad)}{more}")
        for name, speed in self._fastest.items():
            if speed > FASTEST_RAD_S:
                self.note(f"WARNING: {name} turns at up to {speed:.3g} rad/s: is its unit right?")
        if self._time and not 0.01 <= rate <= 10e6:
            self.note(
                f"WARNING: the sample rate is {rate:.3g} Hz: is the unit of the time column right?"
            )
        if self._time and self._gaps:
            self.note(
                f"WARNING: {self._gaps} steps of the time are longer than 1.5 times the usual one"
            )

    def segments(self, rows: int) -> Iterator[Segment]:
        """The segments of the map as rows."""
        for index, (wanted, (start, stop)) in enumerate(
            zip(self._options.segments, self._edges, strict=True)
        ):
            if not start < stop <= rows:
                raise ConfigurationError(
                    "the segment has no rows",
                    where=f"segments[{index}] {wanted.label}",
                    value=f"{wanted.start:g} to {wanted.stop:g} s",
                    limit="seconds within the recording",
                )
            yield Segment(
                index=index,
                label=wanted.label,
                start=start,
                stop=stop,
                setpoint=wanted.setpoint,
                direction=wanted.direction,
                repeat=wanted.repeat,
            )

    def _check_time(self) -> None:
        given = [self._time is not None, self._options.rate is not None, self._options.no_time]
        if sum(given) != 1:
            raise ConfigurationError(
                "the time must come from one place" if sum(given) else "there is no time",
                where=str(self._table.path),
                limit="one of --channel time=COLUMN:s, --rate HZ, --no-time",
                remedy="Without a time base only analyses over angle are possible.",
            )
        rate = self._options.rate
        if rate is not None and not (math.isfinite(rate) and 0.0 < rate <= 1e9):
            raise ConfigurationError(
                "is no sample rate", where="--rate", value=rate, limit="> 0 and <= 1e9 Hz"
            )

    def _time_unit(self, heading_unit: str) -> float:
        assert self._time is not None
        unit = unit_of(self._time.unit or heading_unit or "s", TIME_CHANNEL)
        si_unit, factor = UNITS.get(unit, (unit, 1.0))
        if si_unit != "s":
            allowed = ", ".join(name for name, (si, _) in UNITS.items() if si == "s")
            raise ConfigurationError(
                "has a unit of another dimension", where=TIME_CHANNEL, value=unit, limit=allowed
            )
        return factor * (1.0 if self._time.scale is None else self._time.scale)

    def _good_rows(self, batch: Batch) -> NDArray[np.bool_]:
        """Which rows are kept; raises at the first bad one unless they are to be left out."""
        good = np.ones(len(batch.lines), dtype=bool)
        for row in sorted(batch.bad):
            good[row] = False
            self._refuse(batch.bad[row])
        if self._time is not None:
            self._check_increase(batch, good)
        for index, column in enumerate(self.columns):
            if column.dtype == "int64":
                self._check_counts(batch, good, index + (self._time is not None), column.name)
        return good

    def _check_increase(self, batch: Batch, good: NDArray[np.bool_]) -> None:
        rows = np.flatnonzero(good)
        with np.errstate(over="ignore"):
            seconds = batch.values[rows, 0] * self._time_factor
        heading = self._table.headings[self._indices[0]]
        for row in rows[np.abs(seconds) > 9.2e9]:
            good[row] = False
            self._refuse(
                BadCell(
                    int(batch.lines[row]),
                    heading,
                    repr(float(batch.values[row, 0])),
                    "beyond any calendar",
                )
            )
        rows, seconds = np.flatnonzero(good), batch.values[good, 0] * self._time_factor
        stamps = _nanoseconds(seconds)
        reached = np.maximum.accumulate(np.concatenate([[self.last_ns], stamps]))[:-1]
        for row in rows[stamps <= reached]:
            good[row] = False
            why = "the time does not increase"
            self._refuse(
                BadCell(int(batch.lines[row]), heading, repr(float(batch.values[row, 0])), why)
            )

    def _check_counts(self, batch: Batch, good: NDArray[np.bool_], index: int, name: str) -> None:
        values = batch.values[:, index]
        with np.errstate(invalid="ignore"):
            wrong = good & ((values != np.rint(values)) | (np.abs(values) >= LARGEST_EXACT))
        for row in np.flatnonzero(wrong):
            good[row] = False
            heading = self._table.headings[self._indices[index]]
            self._refuse(
                BadCell(
                    int(batch.lines[row]),
                    heading,
                    repr(float(values[row])),
                    f"{name} is no whole count",
                )
            )

    def _refuse(self, bad: BadCell) -> None:
        word = self._table.line_word
        column = f", column {bad.column}" if bad.column else ""
        if not self._options.drop_bad_rows:
            raise RunFileError(
                bad.why,
                where=f"{self._table.path}, {word} {bad.line}{column}",
                value=bad.text,
                limit="a later time than the row before"
                if "increase" in bad.why
                else "a finite number",
                remedy=f"Correct the {word}, or leave such rows out with --drop-bad-rows.",
            )
        self.dropped += 1
        if len(self._bad) < LISTED_ROWS:
            self._bad.append(f"{word} {bad.line}{column}: {bad.why} ({bad.text})")

    def _times(self, values: NDArray[np.float64], cycles: NDArray[np.int64]) -> NDArray[np.int64]:
        if self._time is not None:
            times = _nanoseconds(values[:, 0] * self._time_factor)
        elif self._options.rate is not None:
            times = np.rint(cycles * (1e9 / self._options.rate)).astype(np.int64)
        else:
            times = cycles.astype(np.int64)
        if self._first_ns is None:
            self._first_ns = int(times[0])
        for edges, segment in zip(self._edges, self._options.segments, strict=True):
            for side, seconds in enumerate((segment.start, segment.stop)):
                edges[side] += int(np.searchsorted(times, self._first_ns + round(seconds * 1e9)))
        return times

    def _stored(
        self, column: Column, index: int, values: NDArray[np.float64], lines: NDArray[np.int64]
    ) -> NDArray[Any]:
        modulus = self._sources[index].modulus
        if modulus:
            outside = np.flatnonzero(np.abs(values) > modulus)
            if len(outside):
                raise RunFileError(
                    "the column goes beyond the range after which it should wrap",
                    where=f"{self._table.path}, "
                    f"{self._table.line_word} {int(lines[outside[0]])}, channel {column.name}",
                    value=float(values[outside[0]]),
                    limit=f"{modulus:g}",
                    remedy="Correct the modulus of the channel.",
                )
            before = values[0] if np.isnan(self._last[index]) else self._last[index]
            turns = self._turns[index] - np.cumsum(
                np.rint(np.diff(values, prepend=before) / modulus)
            )
            self._turns[index] = turns[-1]
            self._last[index] = values[-1]
            values = values + turns * modulus
        return np.rint(values).astype(np.int64) if column.dtype == "int64" else values

    def _watch(self, times: NDArray[np.int64], stored: list[NDArray[Any]]) -> None:
        """Look for numbers that point to a wrong unit."""
        if len(times) < 2 or self._options.no_time:
            return
        steps = np.diff(times) * 1e-9
        self._gaps += int(np.count_nonzero(steps > 1.5 * np.median(steps)))
        for column, values in zip(self.columns, stored, strict=True):
            if column.channel.unit == "rad":
                fastest = float(np.median(np.abs(np.diff(values) * column.channel.scale) / steps))
                self._fastest[column.name] = max(fastest, self._fastest.get(column.name, 0.0))


def _nanoseconds(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Whole seconds and the rest apart: their product with 1e9 has no room for both in calendar times."""
    whole = np.floor(seconds)
    return whole.astype(np.int64) * 1_000_000_000 + np.rint((seconds - whole) * 1e9).astype(
        np.int64
    )


def _unit_or_nothing(text: str) -> str:
    """The unit that a heading names, or "" for words in brackets that are no unit."""
    try:
        return unit_of(text, "") if text else ""
    except ConfigurationError:
        return ""
