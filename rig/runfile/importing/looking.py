"""A look at a recording before it is imported: what each channel is, and what it shows. Nothing is written.

The recording passes by once; what is kept of it are ranges, and changes over blocks of 50 ms.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from model.units import COUNT
from rig.content.grid import Grid, columns
from rig.content.phrase import phrase
from rig.errors import ConfigurationError, RigError
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.channel_map import ForeignSegment, ImportOptions
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.heading import sample_rate
from rig.runfile.importing.lag import lag_of_speed
from rig.runfile.importing.proposing import BLOCK_S, propose
from rig.runfile.importing.reading import Reading
from rig.runfile.importing.streams import LeftOut
from rig.runfile.importing.units import TIME_CHANNEL
from rig.runfile.importing.wiring import wire
from rig.runfile.importing.wraps import wraps

STILL = 0.01
"""Share of the largest change per block below which a block stands still."""
_LAG_ROWS = 1 << 16
"""Rows at the beginning that the lags are looked for in."""
NEIGHBOURS = {
    "input_speed": "input_angle",
    "output_speed": "output_angle",
    "speed": "position",
    "velocity": "position",
}
"""Each measured speed, and the angle whose derivative it should be."""


@dataclass(kw_only=True)
class _ChannelLook:
    """One channel: its column, unit and factor to SI, range and least step in SI, wraps, share of standstill, lag."""

    name: str
    column: str
    unit: str
    factor: float
    offset: float
    low: float = math.inf
    high: float = -math.inf
    step: float = math.inf
    wraps: int = 0
    standstill: float = math.nan
    lag_s: float = math.nan
    lag_against: str = ""


@dataclass(kw_only=True)
class Look:
    """What a recording shows: rows, duration, rate, gaps, channels; what hinders the import; what may be labelled."""

    rows: int = 0
    duration_s: float = math.nan
    rate_hz: float = math.nan
    gaps: int = 0
    channels: list[_ChannelLook] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    output_per_input: float = math.nan
    """Slope of output angle against input angle, with its sign; NaN where not both are there."""
    proposals: list[ForeignSegment] = field(default_factory=list)

    def channel(self, name: str) -> _ChannelLook | None:
        """One of the channels by name."""
        return next((c for c in self.channels if c.name == name), None)


class _Watch:
    """What is kept of one channel while it passes by."""

    def __init__(self, look: _ChannelLook) -> None:
        self.look = look
        self.blocks: list[NDArray[np.float64]] = []
        self.head: NDArray[np.float64] = np.zeros(0)
        self._size = 1
        self._rest: NDArray[np.float64] = np.zeros(0)

    def see(self, values: NDArray[np.float64], size: int) -> None:
        look, self._size = self.look, size
        look.low = min(look.low, float(values.min()))
        look.high = max(look.high, float(values.max()))
        steps = np.abs(np.diff(values))
        moved = steps[steps > 1e-12 * max(abs(look.low), abs(look.high), 1e-300)]
        if len(moved):
            look.step = min(look.step, float(moved.min()))
        if look.unit == "rad":
            look.wraps += len(wraps(values, 1.0))
        if len(self.head) < _LAG_ROWS:
            self.head = np.concatenate([self.head, values[: _LAG_ROWS - len(self.head)]])
        values = np.concatenate([self._rest, values])
        whole = len(values) // size * size
        self._rest = values[whole:]
        if whole:
            self.blocks.append(values[:whole].reshape(-1, size)[:, [0, -1]])

    @property
    def _ends(self) -> NDArray[np.float64]:
        """The first and the last value of each block (n, 2)."""
        return np.concatenate([np.zeros((0, 2)), *self.blocks])

    def changes(self) -> NDArray[np.float64]:
        """Change over each block: from its first row to the first of the next."""
        within = np.diff(self._ends, axis=1)[:, 0]
        return within * (self._size / max(self._size - 1, 1))

    def begins(self) -> NDArray[np.float64]:
        """First value of each block."""
        return self._ends[:, 0]

    def levels(self) -> NDArray[np.float64]:
        """Mean of each block's ends."""
        return self._ends.mean(axis=1)


def look_at(tables: Sequence[Table], options: ImportOptions) -> Look:
    """Look at a recording as these options would import it; what hinders the import is told, not raised.

    Raises `RunFileError` for a file that cannot be read.
    """
    found = Look()
    usable = _usable_channels(tables, options, found)
    if not any(source.name != TIME_CHANNEL for source in usable):
        return found
    # The look goes through where an import would stop: jumps and bad rows are counted.
    lenient = dataclasses.replace(
        options,
        channels=usable,
        reverse=(),
        allow_jumps=True,
        drop_bad_rows=True,
        segments=(),
        segments_from=None,
    )
    try:
        reading = Reading(tables, lenient)
    except ConfigurationError as error:
        found.problems.append(str(error))
        return found
    _pass(reading, found, options, {source.name: source.column for source in usable})
    if reading.dropped and not options.drop_bad_rows:
        found.problems.append(f"{reading.dropped} rows cannot be used; see the notes")
    return found


def _usable_channels(
    tables: Sequence[Table], options: ImportOptions, found: Look
) -> tuple[ChannelSource, ...]:
    """The channels that can be read at all; why the others cannot goes to the problems."""
    time = tuple(source for source in options.channels if source.name == TIME_CHANNEL)
    usable: list[ChannelSource] = []
    for source in options.channels:
        if source.name == TIME_CHANNEL:
            continue
        alone = dataclasses.replace(
            options, channels=(*time, source), reverse=(), segments_from=None
        )
        try:
            wire(tables, alone.channels, alone, LeftOut(is_allowed=True))
        except RigError as error:
            if str(error) not in found.problems:
                found.problems.append(str(error))
            continue
        usable.append(source)
    return (*time, *usable)


def _pass(reading: Reading, found: Look, options: ImportOptions, columns: dict[str, str]) -> None:
    """The one pass: ranges, blocks, gaps; then what follows from them."""
    watches = [
        _Watch(
            _ChannelLook(
                name=c.name,
                column=columns.get(c.name, "made"),
                unit=c.channel.unit,
                factor=c.channel.gain,
                offset=c.channel.offset,
            )
        )
        for c in reading.columns
    ]
    size, first_ns, last_ns = 1, 0, 0
    clock = _Watch(_ChannelLook(name=TIME_CHANNEL, column="", unit="s", factor=1.0, offset=0.0))
    for rows in reading.batches():
        if not found.rows:
            first_ns = int(rows.time_ns[0])
            found.rate_hz = math.nan if options.no_time else sample_rate(rows.time_ns)
            if math.isfinite(found.rate_hz):
                size = max(2, round(BLOCK_S * found.rate_hz))
        found.rows += len(rows.time_ns)
        last_ns = int(rows.time_ns[-1])
        seconds = np.asarray((rows.time_ns - first_ns) * 1e-9, dtype=np.float64)
        clock.see(seconds, size)
        for watch, column, stored in zip(watches, reading.columns, rows.stored, strict=True):
            watch.see(column.channel.to_si(stored), size)
    found.gaps = reading.gaps
    reading.close_notes(found.rate_hz)
    found.notes = list(reading.notes)
    found.channels = [watch.look for watch in watches]
    if not options.no_time and found.rows > 1:
        found.duration_s = (last_ns - first_ns) * 1e-9
        _motion(found, watches, clock)
    for watch in watches:
        if not math.isfinite(watch.look.step):
            watch.look.step = math.nan


def _motion(found: Look, watches: list[_Watch], clock: _Watch) -> None:
    """Standstill, lags, the sense of the output, and stretches that may be labelled."""
    by_name = {watch.look.name: watch for watch in watches}
    for watch in watches:
        moved = None
        if watch.look.unit in ("rad", "m") and not watch.look.wraps:
            moved = np.abs(watch.changes())
        elif watch.look.unit in ("rad/s", "m/s"):
            moved = np.abs(watch.levels())
        if moved is not None and len(moved) and moved.max() > 0.0:
            watch.look.standstill = float(np.mean(moved < STILL * moved.max()))
    for speed, angle in NEIGHBOURS.items():
        if speed in by_name and angle in by_name:
            look = by_name[speed].look
            head = by_name[angle].head, by_name[speed].head
            look.lag_s, look.lag_against = lag_of_speed(*head, found.rate_hz), angle
    if {"input_angle", "output_angle"} <= set(by_name):
        turned = by_name["input_angle"].changes()
        square = float(turned @ turned)
        if square > 0.0:
            found.output_per_input = float(turned @ by_name["output_angle"].changes()) / square
    for name in ("input_angle", "position", "output_angle"):
        if name in by_name and not by_name[name].look.wraps:
            unit = by_name[name].look.unit
            found.proposals = propose(by_name[name].changes(), clock.begins(), unit)
            break


def columns_of(tables: Sequence[Table]) -> list[dict[str, object]]:
    """The columns of the files: heading, unit where the file says it, range of the first rows. For a first look."""
    listed: list[dict[str, object]] = []
    for table in tables:
        for index, (heading, unit) in enumerate(zip(table.headings, table.units, strict=True)):
            batch = next(iter(table.batches([index])), None)
            values = np.zeros(0) if batch is None else batch.values[:, 0]
            values = values[np.isfinite(values)]
            time = table.times[index]
            listed.append(
                {
                    "file": table.path.name,
                    "number": index + 1,
                    "heading": heading,
                    "unit": unit,
                    "low": float(values.min()) if len(values) else math.nan,
                    "high": float(values.max()) if len(values) else math.nan,
                    "time": None if time is None else time + 1,
                    "counts": unit == COUNT,
                }
            )
    return listed


def column_grid(listed: Sequence[Mapping[str, object]]) -> Grid:
    """The columns of files of which nothing is mapped yet; see `columns_of`."""
    rows = [
        (
            str(column["number"]),
            str(column["heading"]),
            str(column["unit"] or "?"),
            known(column["low"]),
            known(column["high"]),
            phrase("column {}", column["time"]) or "-",
        )
        for column in listed
    ]
    heads = columns(
        "column",
        "heading",
        ("unit", "unit"),
        ("first rows from", "number"),
        ("to", "number"),
        "its time",
    )
    return Grid("", heads, rows)


def look_grid(look: Look) -> Grid:
    """The channels of a look, with the range of their values in the first rows."""
    rows = [
        (
            c.name,
            c.column,
            c.unit,
            known(c.factor, 4),
            known(c.low, 4),
            known(c.high, 4),
            known(c.step, 3),
            str(c.wraps or "-"),
            "-" if math.isnan(c.standstill) else f"{100.0 * c.standstill:.0f} %",
        )
        for c in look.channels
    ]
    heads = columns(
        "channel",
        "column",
        ("unit", "unit"),
        ("factor", "number"),
        ("from", "number"),
        ("to", "number"),
        ("step", "number"),
        ("wraps", "number"),
        ("still", "number"),
    )
    return Grid("", heads, rows)


def known(value: object, digits: int = 6) -> str:
    """A number in these digits; a dash for one that is not known."""
    return (
        f"{value:.{digits}g}" if isinstance(value, (int, float)) and math.isfinite(value) else "-"
    )
