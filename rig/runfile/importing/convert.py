"""A recording of another rig made into a run file that is marked IMPORTED.

The columns are kept as the numbers that the file had, with scale and offset to SI. A cell that is
no number, a hole, a time that does not increase: an error that names file, line, column and value;
or, if asked for, rows that are left out, counted and listed in an event of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from experiments.recording import Event
from rig.errors import RunFileError
from rig.runfile.header import RunHeader, iso_time
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.channel_map import ImportOptions, check_said
from rig.runfile.importing.heading import header_of
from rig.runfile.importing.opening import open_table
from rig.runfile.importing.reading import Reading, Rows, reversed_rows
from rig.runfile.write import RunWriter


@dataclass(frozen=True)
class Imported:
    """The run that came of it, its rows, the rows left out, and what is worth knowing, in words."""

    path: Path
    rows: int
    dropped: int
    notes: tuple[str, ...]


def import_csv(path: Path, options: ImportOptions, place: Callable[[], Path]) -> Imported:
    """Make a run of a delimited text file; `place()` names the run file once the first rows have been understood."""
    return import_tables((open_table("csv", path, options.form),), options, place)


def import_mat(path: Path, options: ImportOptions, place: Callable[[], Path]) -> Imported:
    """Make a run of a MATLAB file; `place()` names the run file once the first rows have been understood."""
    return import_tables((open_table("mat", path),), options, place)


def import_tables(
    tables: Sequence[Table], options: ImportOptions, place: Callable[[], Path]
) -> Imported:
    """Make a run of the files of one recording, whatever kind they are."""
    check_said(options)
    reading = Reading(tables, options)
    backward = reversed_rows(tables, options, reading.columns) if options.reverse else None
    batches = reading.batches()
    first = next(batches, None)
    if first is None:
        raise RunFileError(
            "has no usable rows",
            where=str(tables[0].path),
            value=f"{reading.dropped} left out",
            limit="at least 2 rows",
            remedy="Check the columns, units and decimal mark.",
        )
    header = header_of(tables, options, reading, first)
    run = place()
    header = replace(header, metadata=replace(header.metadata, run_id=run.name.removesuffix(".h5")))
    writer = RunWriter(run, header)
    try:
        _write_rows(writer, chain((first,), batches, _behind(reading, backward)), header)
        dropped = reading.dropped + (backward.dropped if backward else 0)
        if writer.rows < 2:
            raise RunFileError(
                "is too short",
                where=str(tables[0].path),
                value=f"{writer.rows} row",
                limit="at least 2 rows",
            )
        reading.close_notes(header.metadata.sample_rate)
        for segment in reading.segments(writer.rows):
            writer.segment(segment)
        notes = (*reading.notes, *_missing(header))
        for note in notes:
            level = "warning" if note.startswith("WARNING") else "info"
            writer.event(Event(reading.last_ns + header.epoch_ns, level, "IMPORT", "import", note))
        writer.count_dropped(dropped)
        end_time = iso_time(reading.last_ns + header.epoch_ns) if header.metadata.start_time else ""
        rows = writer.rows
        writer.seal("", end_time)
    except BaseException:
        writer.abandon()
        writer.part.unlink(missing_ok=True)
        raise
    return Imported(run, rows, dropped, notes)


def _write_rows(writer: RunWriter, batches: Iterator[Rows], header: RunHeader) -> None:
    for rows in batches:
        flags = np.zeros(len(rows.time_ns), dtype=np.uint16)
        writer.append_rows(rows.time_ns + header.epoch_ns, rows.cycles, flags, rows.stored)


def _behind(reading: Reading, backward: Reading | None) -> Iterator[Rows]:
    """The reverse half behind the forward one, which is through by then."""
    if backward is None:
        return
    last = reading.last_ns + 1
    for rows in backward.batches():
        yield Rows(rows.time_ns + last, rows.cycles + last, rows.stored)


def _missing(header: RunHeader) -> list[str]:
    """What would stand in a rig's own file and nobody said of this one."""
    stated = header.metadata.process["stated"]
    names = [column.name for column in header.columns]
    missing = []
    if not any(c.channel.calibration.accuracy for c in header.columns if c.channel.unit == "rad"):
        missing += (
            ["accuracy of the angles"] if {"input_angle", "output_angle"} & set(names) else []
        )
    efforts = [c.channel.calibration for c in header.columns if c.channel.unit in ("N m", "N")]
    if efforts and not any(c.scale_relative_uncertainty for c in efforts):
        missing.append("uncertainty of the torque's scale")
    if efforts and not any(c.offset_uncertainty for c in efforts):
        missing.append("uncertainty of the torque's zero")
    if not stated["lag_s"] and header.metadata.time_base != "none":
        missing.append("lag of the channels")
    if "output_angle" in names and not stated["ratio"]:
        missing.append("ratio")
    if not missing:
        return []
    return [f"not said, and so in no budget: {', '.join(missing)}"]
