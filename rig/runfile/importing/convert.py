"""A recording of another rig made into a run file that is marked IMPORTED.

The columns are kept as the numbers that the file had, with scale and offset to SI. A cell that is
no number, a hole, a time that does not increase: an error that names file, line, column and value;
or, if asked for, rows that are left out, counted and listed in an event of the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.recording import Event, RunMetadata, TimeBase
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.header import RunHeader, iso_time
from rig.runfile.importing.channel_map import ForeignSegment, ImportOptions, read_channel_map
from rig.runfile.importing.matlab import MatlabTable
from rig.runfile.importing.reading import Reading, Rows
from rig.runfile.importing.tables import DelimitedTable, Table
from rig.runfile.importing.units import ChannelSource, parse_channel
from rig.runfile.seal import file_sha256
from rig.runfile.write import RunWriter

EARLIEST_CALENDAR_S = 978_307_200.0
"""2001-01-01 in seconds since 1970: a time column beyond this is calendar time."""

__all__ = [
    "ChannelSource",
    "ForeignSegment",
    "ImportOptions",
    "Imported",
    "import_csv",
    "import_mat",
    "import_table",
    "parse_channel",
    "read_channel_map",
]


@dataclass(frozen=True)
class Imported:
    """The run that came of it, its rows, the rows left out, and what is worth knowing, in words."""

    path: Path
    rows: int
    dropped: int
    notes: tuple[str, ...]


def import_csv(path: Path, options: ImportOptions, place: Callable[[], Path]) -> Imported:
    """Make a run of a delimited text file; `place()` names the run file once the first rows have been understood."""
    table = DelimitedTable(path, options.delimiter, options.decimal)
    return import_table(table, options, place, table.description)


def import_mat(path: Path, options: ImportOptions, place: Callable[[], Path]) -> Imported:
    """Make a run of a MATLAB file; `place()` names the run file once the first rows have been understood."""
    table = MatlabTable(path)
    return import_table(table, options, place, table.description)


def import_table(
    table: Table, options: ImportOptions, place: Callable[[], Path], description: str = ""
) -> Imported:
    """Make a run of any table of numbers."""
    reading = Reading(table, options)
    batches = reading.batches()
    first = next(batches, None)
    if first is None:
        raise RunFileError(
            "has no usable rows",
            where=str(table.path),
            value=f"{reading.dropped} left out",
            limit="at least 2 rows",
            remedy="Check the columns, units and decimal mark.",
        )
    header = _header(table, options, reading, first)
    run = place()
    header = replace(header, metadata=replace(header.metadata, run_id=run.name.removesuffix(".h5")))
    writer = RunWriter(run, header)
    try:
        if description:
            reading.note(description)
        for rows in _chain(first, batches):
            flags = np.zeros(len(rows.time_ns), dtype=np.uint16)
            writer.append_rows(rows.time_ns + header.epoch_ns, rows.cycles, flags, rows.stored)
        if writer.rows < 2:
            raise RunFileError(
                "is too short",
                where=str(table.path),
                value=f"{writer.rows} row",
                limit="at least 2 rows",
            )
        reading.close_notes(header.metadata.sample_rate)
        for segment in reading.segments(writer.rows):
            writer.segment(segment)
        for note in reading.notes:
            level = "warning" if note.startswith("WARNING") else "info"
            writer.event(Event(reading.last_ns + header.epoch_ns, level, "IMPORT", "import", note))
        writer.count_dropped(reading.dropped)
        end_time = iso_time(reading.last_ns + header.epoch_ns) if header.metadata.start_time else ""
        writer.seal("", end_time)
    except BaseException:
        writer.abandon()
        writer.part.unlink(missing_ok=True)
        raise
    return Imported(run, reading.rows, reading.dropped, tuple(reading.notes))


def _header(table: Table, options: ImportOptions, reading: Reading, first: Rows) -> RunHeader:
    start_ns = 0
    start_time = options.start_time
    if start_time:
        try:
            moment = datetime.fromisoformat(start_time)
        except ValueError:
            raise ConfigurationError(
                "is no date and time",
                where="--start",
                value=start_time,
                limit="ISO 8601, as 2025-11-21T09:30:00+01:00",
            ) from None
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        start_ns = int(moment.timestamp() * 1e6) * 1000 - int(first.time_ns[0])
    elif first.time_ns[0] >= EARLIEST_CALENDAR_S * 1e9:
        start_time = iso_time(int(first.time_ns[0]))
    rate = options.rate or (math.nan if options.no_time else _sample_rate(first.time_ns))
    time_base: TimeBase = (
        "none" if options.no_time else "nominal" if options.rate else options.time_base
    )
    gear = options.gear
    ratio = (
        gear.mounted_ratio(options.mounting)
        if gear and math.isnan(options.ratio)
        else options.ratio
    )
    sense = options.output_sense or (-1 if options.mounting == "circular-spline-fixed" else 1)
    process = {
        "backend": "import",
        "source_file": table.path.name,
        "source_sha256": file_sha256(table.path),
        "channel_map": [
            {
                "channel": s.name,
                "column": s.column,
                "unit": s.unit,
                "scale": s.scale,
                "offset": s.offset,
                "modulus": s.modulus,
            }
            for s in options.channels
        ],
    }
    metadata = RunMetadata(
        run_id="",
        experiment=options.experiment,
        origin="imported",
        title=options.title or f"import of {table.path.name}",
        start_time=start_time,
        operator=options.operator,
        gear=gear,
        gear_serial=options.gear_serial,
        ratio=ratio,
        mounting=options.mounting,
        output_sense=sense,
        sample_rate=rate,
        time_base=time_base,
        conditions=options.conditions,
        process=process,
    )
    return RunHeader(metadata, reading.columns, epoch_ns=start_ns)


def _sample_rate(time_ns: NDArray[np.int64]) -> float:
    """Rows per second: the mean of the usual steps, which neither gaps nor the rounding of the time column move."""
    steps = np.diff(time_ns)
    if not len(steps):
        return math.nan
    usual = float(np.median(steps))
    near = steps[(steps > 0.5 * usual) & (steps < 1.5 * usual)]
    # Two steps of which one is many times the other have none near their median.
    return 1e9 / float(near.mean() if len(near) else usual)


def _chain(first: Rows, rest: Iterator[Rows]) -> Iterator[Rows]:
    yield first
    yield from rest
