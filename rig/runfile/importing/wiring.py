"""Which column of which file becomes which channel, and what is its time: the map laid on the files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from model.unit_text import understood
from model.units import COUNT
from rig.content.phrase import phrase
from rig.errors import ConfigurationError
from rig.runfile.importing.adapters.table import Table, column_named, find_column, split_heading
from rig.runfile.importing.adapters.text_form import is_named
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import ChannelSource, column_of, source_unit
from rig.runfile.importing.clocks import NumberClock, TextClock
from rig.runfile.importing.segments import Words
from rig.runfile.importing.streams import FIRST_STAYS, LeftOut, Stream
from rig.runfile.importing.units import (
    FILETIME,
    TEXT_TIMES,
    TIME_CHANNEL,
    dimensions_of,
    unit_of,
)
from rig.runfile.layout import Column

_LABEL_COLUMN = "label"


@dataclass(frozen=True, kw_only=True)
class Wire:
    """One channel: its source, its file and column there, its column of time (None: none), the unit of the heading."""

    source: ChannelSource
    table: Table
    column: int
    time: int | None
    heading_unit: str


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """The channels of a run in order, how each is stored, the streams that carry them, and the rows per second.

    `places[k]` is the column of channel k among the values of the joined streams; `labels` that of
    the column that labels the rows. `rate` is None where columns of time are there, or no time is.
    `start_ns` is the calendar time [ns since 1970] from which the times count, 0 where nobody says it.
    `remarks` are what a reader should know of how units were read.
    """

    columns: tuple[Column, ...]
    sources: tuple[ChannelSource, ...]
    streams: tuple[Stream, ...]
    places: tuple[int, ...]
    labels: int | None
    words: Words
    rate: float | None
    start_ns: int
    remarks: tuple[str, ...]
    written: tuple[str, ...]
    """The unit of each channel as its heading or its file has it, "" where neither does."""


def wire(
    tables: Sequence[Table],
    sources: Sequence[ChannelSource],
    options: ImportOptions,
    left_out: LeftOut,
) -> Wiring:
    """Find every channel of the map in the files. Raises `ConfigurationError` for what is missing, or said twice."""
    by_name = {source.name: source for source in sources}
    if len(by_name) != len(sources):
        raise ConfigurationError("a channel is given twice", where="--channel")
    time = by_name.pop(TIME_CHANNEL, None)
    if not by_name:
        raise ConfigurationError(
            "no channels are mapped",
            where=str(tables[0].path),
            limit=", ".join(tables[0].headings[:20]),
            remedy="Give --channel name=column:unit for each, or --map FILE.",
        )
    _check_time(tables, time, options)
    wires = [_wire(tables, source, time, options) for source in by_name.values()]
    columns = tuple(
        column_of(w.source, w.heading_unit, options.torque_constant, options.ratio) for w in wires
    )
    remarks = tuple(remark for w in wires if (remark := _remark(w)))
    rate = options.rate or _stated_rate(wires, options)
    if options.segments_from is not None and options.segments_from.column:
        wanted = options.segments_from
        label = ChannelSource(name=_LABEL_COLUMN, column=wanted.column, file=wanted.file)
        wires.append(_wire(tables, label, time, options))
    words = Words()
    streams, places = _streams(tables, wires, columns, time, words, left_out, options=options)
    if options.interpolate:
        _check_lines(streams[1:], sources, has_label=len(wires) > len(columns))
    has_label = len(wires) > len(columns)
    return Wiring(
        columns=columns,
        sources=tuple(by_name.values()),
        streams=streams,
        places=places[: len(columns)],
        labels=places[-1] if has_label else None,
        words=words,
        rate=rate,
        start_ns=_begin(wires[0].table, wires[0].time),
        remarks=remarks,
        written=tuple(w.heading_unit for w in wires[: len(columns)]),
    )


def _remark(wire: Wire) -> str:
    """How the unit of a channel was read, where a reader should know it; "" where it is plain."""
    source = wire.source
    remark = source_unit(source, wire.heading_unit, dimensions_of(source.name)).remark
    return phrase("{1}, column {2}: {0}", remark, source.name, source.column)


def _check_time(
    tables: Sequence[Table], time: ChannelSource | None, options: ImportOptions
) -> None:
    """Raise `ConfigurationError` unless the time comes from one place, the files themselves included."""
    given = sum([time is not None, options.rate is not None, options.no_time])
    own = any(source.time for source in options.channels)
    of_files = all(table.period or any(t is not None for t in table.times) for table in tables)
    if given > 1 or not (given or own or of_files):
        raise ConfigurationError(
            "the time must come from one place" if given else "there is no time",
            where=str(tables[0].path),
            limit="one of --channel time=COLUMN:s, --rate HZ, --no-time",
            remedy="Without a time base only analyses over angle are possible.",
        )
    rate = options.rate
    if rate is not None and not (math.isfinite(rate) and 0.0 < rate <= 1e9):
        raise ConfigurationError(
            "is no sample rate", where="--rate", value=rate, limit="> 0 and <= 1e9 Hz"
        )


def _stated_rate(wires: Sequence[Wire], options: ImportOptions) -> float | None:
    """Rows per second where the file states its step and nothing else was given."""
    if options.no_time or any(w.time is not None for w in wires):
        return None
    periods = {w.table.period for w in wires}
    if len(periods) != 1 or None in periods:
        return None
    (period,) = periods
    assert period is not None
    return 1.0 / period


def _wire(
    tables: Sequence[Table],
    source: ChannelSource,
    time: ChannelSource | None,
    options: ImportOptions,
) -> Wire:
    table, column = _place(tables, source)
    heading = _said_by_heading(table, column, options, source.name)
    return Wire(
        source=source,
        table=table,
        column=column,
        time=_time_of(table, column, source, time, options),
        heading_unit=_agreed(source, heading),
    )


def _place(tables: Sequence[Table], source: ChannelSource) -> tuple[Table, int]:
    """The file and the column of a channel."""
    if source.file:
        chosen = [t for n, t in enumerate(tables, 1) if is_named(t.path, n, source.file)]
        if len(chosen) == 1:
            return chosen[0], find_column(chosen[0], source.column)
        if len(tables) > 1 or column_named(tables[0], f"{source.column}@{source.file}") is None:
            what = "more than one of the files has this name"
            if not chosen:
                what = "there is no such file among those that are imported"
            raise ConfigurationError(
                what,
                where=source.name,
                value=source.file,
                limit=", ".join(f"{n} {table.path.name}" for n, table in enumerate(tables, 1)),
            )
        return tables[0], find_column(tables[0], f"{source.column}@{source.file}")
    if len(tables) == 1:
        return tables[0], find_column(tables[0], source.column)
    found = [
        (table, column)
        for table in tables
        if (column := column_named(table, source.column)) is not None
    ]
    if len(found) != 1:
        names = ", ".join(table.path.name for table, _ in found or [(t, 0) for t in tables])
        raise ConfigurationError(
            "more than one of the files has this column" if found else "no file has this column",
            where=source.name,
            value=source.column,
            limit=names,
            remedy=f"Write {source.name}={source.column}@FILE, with the file's name or number.",
        )
    return found[0]


def _time_of(
    table: Table,
    column: int,
    source: ChannelSource,
    time: ChannelSource | None,
    options: ImportOptions,
) -> int | None:
    """The column of time of a channel; None where the rows are counted."""
    if options.rate is not None or options.no_time:
        return None
    own = table.times[column]
    wanted = source.time or (time.column if time else "")
    if not wanted:
        if own is None and not table.period:
            raise ConfigurationError(
                "there is no time",
                where=f"{table.path}, {source.name}",
                limit="one of --channel time=COLUMN:s, --rate HZ, --no-time",
            )
        return own
    found = find_column(table, wanted)
    if own is not None and own != found and not table.may_be_retimed:
        raise ConfigurationError(
            "has a column of time of its own",
            where=f"{table.path}, {source.name}",
            value=f"column {found + 1}",
            limit=f"column {own + 1}",
            remedy="Leave the time away: the file says which belongs to which channel.",
        )
    return found


def _streams(
    tables: Sequence[Table],
    wires: Sequence[Wire],
    columns: Sequence[Column],
    time: ChannelSource | None,
    words: Words,
    left_out: LeftOut,
    *,
    options: ImportOptions,
) -> tuple[tuple[Stream, ...], tuple[int, ...]]:
    """The streams of the wires, and where among their values each wire's column stands."""
    groups: dict[tuple[int, int | None], list[int]] = {}
    for index, w in enumerate(wires):
        groups.setdefault((id(w.table), w.time), []).append(index)
    streams: list[Stream] = []
    order: list[int] = []
    # Files of one run may begin at different moments: their times count from the start of the first.
    begin = _begin(wires[0].table, wires[0].time)
    for indices in groups.values():
        members = [wires[index] for index in indices]
        clock = _clock(members[0], time, options, _time_unit(tables, members[0].table, options))
        own = _begin(members[0].table, members[0].time)
        if isinstance(clock, NumberClock) and own and begin:
            clock.origin_ns = own - begin
        readers = {
            members[k].column: words.read
            for k, index in enumerate(indices)
            if index >= len(columns) and _holds_words(members[k], members[:k])
        }
        if isinstance(clock, TextClock):
            assert members[0].time is not None
            readers[members[0].time] = clock.read
        stream = Stream(
            table=members[0].table,
            columns=[w.column for w in members],
            names=[w.source.name for w in members],
            counted=[index < len(columns) and columns[index].dtype == "int64" for index in indices],
            angles=[_radians(columns, index) for index in indices],
            time=members[0].time,
            clock=clock,
            readers=readers,
            left_out=left_out,
        )
        streams.append(stream)
        order += indices
    places = [order.index(index) for index in range(len(wires))]
    return tuple(streams), tuple(places)


def _begin(table: Table, time: int | None) -> int:
    """Calendar time [ns since 1970] from which a column of time counts; 0 where nobody says it."""
    return table.start_ns if time is None or time in table.stamped else 0


def _radians(columns: Sequence[Column], index: int) -> float:
    """How many rad one of a column's own units is; 0 for what is no angle, as the column of labels."""
    if index >= len(columns) or columns[index].channel.unit != "rad":
        return 0.0
    return columns[index].channel.scale


def _check_lines(
    streams: Sequence[Stream], sources: Sequence[ChannelSource], *, has_label: bool
) -> None:
    """Raise `ConfigurationError` for a channel of these streams that has no values between its samples."""
    moduli = {source.name: source.modulus for source in sources}
    for stream in streams:
        for name, counted in zip(stream.names, stream.counted, strict=True):
            why = ""
            if counted:
                why = "is counted: there are no values between its counts"
            elif moduli.get(name):
                why = "is wrapped: a line across its range is no angle"
            elif has_label and name == _LABEL_COLUMN:
                why = "holds labels: there is nothing between two of them"
            if why:
                raise ConfigurationError(why, where=f"--interpolate, {name}", remedy=FIRST_STAYS)


def _holds_words(label: Wire, channels: Sequence[Wire]) -> bool:
    """Whether a column of labels may hold words: in a text, and where it is no channel too."""
    return label.table.line_word == "line" and label.column not in {w.column for w in channels}


def _time_unit(tables: Sequence[Table], table: Table, options: ImportOptions) -> str:
    """The unit that is said of the time of one file alone."""
    number = next(n for n, one in enumerate(tables, 1) if one is table)
    return str(options.said_of(table.path, number).get("time_unit", ""))


def _clock(
    wire: Wire, time: ChannelSource | None, options: ImportOptions, own_unit: str
) -> NumberClock | TextClock | None:
    """What reads the column of time. Raises `ConfigurationError` where nobody says its unit."""
    if wire.time is None:
        return None
    table = wire.table
    said = time or ChannelSource(name=TIME_CHANNEL, column=table.headings[wire.time])
    if own_unit:
        said = replace(said, unit=own_unit)
    heading = _agreed(said, _said_by_heading(table, wire.time, options, TIME_CHANNEL))
    unit = source_unit(said, heading, ("s",))
    if unit.symbol in TEXT_TIMES:
        return TextClock(unit.symbol == FILETIME)
    if unit.symbol == COUNT:
        if said.scale is None:
            raise ConfigurationError(
                "ticks need their length in seconds",
                where=TIME_CHANNEL,
                remedy=f"Write {said.option}:count:<seconds per tick>.",
            )
        return NumberClock(said.scale, said.modulus)
    if unit.si != "s":
        raise ConfigurationError(
            "has a unit of another dimension",
            where=TIME_CHANNEL,
            value=unit.symbol,
            limit=", ".join(understood(("s",))),
        )
    return NumberClock(unit.scale * said.factor, said.modulus)


def _said_by_heading(table: Table, column: int, options: ImportOptions, name: str) -> str:
    """The unit that the file says the column of a channel to have; "" where it says none."""
    if options.ignore_headings:
        return ""
    return _known_unit(table.units[column] or split_heading(table.headings[column])[1], name)


def _agreed(source: ChannelSource, heading_unit: str) -> str:
    """The unit of the heading. Raises `ConfigurationError` where the map says another one: one of them is wrong."""
    if not source.unit or not heading_unit:
        return heading_unit
    allowed = dimensions_of(source.name) or ()
    said, read = (unit_of(text, source.name, allowed) for text in (source.unit, heading_unit))
    # A factor beside a unit of another dimension makes it of what the heading says: volts of a sensor, its N m.
    is_made = source.scale is not None and abs(source.scale) != 1.0 and said.si != read.si
    if not is_made and (said.si, said.scale, said.zero) != (read.si, read.scale, read.zero):
        raise ConfigurationError(
            "is said to be in another unit than its heading says",
            where=f"{source.name}, column {source.column}",
            value=source.unit,
            limit=heading_unit,
            remedy="Leave the unit away, or say with --ignore-headings that the headings are wrong.",
        )
    return heading_unit


def _known_unit(text: str, name: str) -> str:
    """The unit that a heading names for this channel, or "" for words in brackets that are no unit."""
    allowed = dimensions_of(name) or ()
    # Speed (in), Speed (out): the sides of a gear, no inch, on what is no length.
    if not text or (text.lower() == "in" and "m" not in allowed):
        return ""
    try:
        unit_of(text, name, allowed)
    except ConfigurationError:
        return ""
    return text
