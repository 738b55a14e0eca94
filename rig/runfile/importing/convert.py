"""A recording of another rig made into a run file that is marked IMPORTED.

The columns are kept as the numbers that the file had, with scale and offset to SI. A cell that is
no number, a hole, a time that does not increase: an error that names file, line, column and value;
or, if asked for, rows that are left out, counted and listed in an event of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from drivers.channel import HOUSING_TEMPERATURE as TEMPERATURE_CHANNEL
from experiments.assumed import (
    CURRENT,
    ENCODERS,
    TEMPERATURE,
    THERMOMETER,
    TIME_BASE,
    TORQUE_SCALE,
    TORQUE_ZERO,
    Assumed,
)
from experiments.budget import TORQUES
from experiments.need import EFFORTS
from experiments.recording import Event
from model.channel import Channel
from rig.errors import RunFileError
from rig.runfile.header import RunHeader, iso_time
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.channel_map import ImportOptions, check_said
from rig.runfile.importing.heading import header_of
from rig.runfile.importing.reading import Reading, Rows, reversed_rows
from rig.runfile.write import RunWriter


@dataclass(frozen=True)
class Imported:
    """The run that came of it, its rows, the rows left out, and what is worth knowing, in words."""

    path: Path
    rows: int
    dropped: int
    notes: tuple[str, ...]

    @property
    def brief_notes(self) -> tuple[str, ...]:
        """The notes, each on one line."""
        return tuple(map(_brief, self.notes))


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
            writer.event(
                Event(reading.last_ns + header.epoch_ns, level, "IMPORT", "import", _brief(note))
            )
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


def _brief(note: str) -> str:
    """A note as the event of a run has it, whose text is short: of lines only what stands before their colon."""
    first, *lines = note.split("\n")
    if not lines:
        return first
    return f"{first} {', '.join(line.partition(':')[0] for line in lines)}"


def _missing(header: RunHeader) -> list[str]:
    """What would stand in a rig's own file and nobody said: a note of one line a kind, with what gives it."""
    stated = header.metadata.process["stated"]
    channels = {column.name: column.channel for column in header.columns}
    assumed = [*_assumed(channels)]
    if header.metadata.time_base == "nominal":
        assumed.append(TIME_BASE)
    lines = [f"{row.kind}: {row.note}" for row in assumed]
    if not stated["lag_s"] and header.metadata.time_base != "none":
        lines.append("lag of the channels: taken as none. Give it: --lag")
    if "output_angle" in channels and not stated["ratio"]:
        lines.append("ratio: taken from the gear. Give it: --ratio")
    if not lines:
        return []
    return ["\n".join(["not said:", *lines])]


def _assumed(channels: Mapping[str, Channel]) -> Iterator[Assumed]:
    """What is assumed of the channels: encoders, scales and zeros of efforts, temperature."""
    for name, row in ENCODERS.items():
        if name in channels and channels[name].calibration.accuracy is None:
            yield row
    efforts = [c for c in channels.values() if c.name in EFFORTS or c.unit in TORQUES]
    without_scale = [c for c in efforts if c.calibration.scale_relative_uncertainty is None]
    if any(c.unit in TORQUES for c in without_scale):
        yield TORQUE_SCALE
    if any(c.unit not in TORQUES for c in without_scale):
        yield CURRENT
    if any(c.calibration.offset_uncertainty is None for c in efforts):
        yield TORQUE_ZERO
    thermometer = channels.get(TEMPERATURE_CHANNEL)
    if efforts and thermometer is None:
        yield TEMPERATURE
    elif thermometer is not None and thermometer.calibration.offset_uncertainty is None:
        yield THERMOMETER
