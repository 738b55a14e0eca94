"""A run for other programs: text, MATLAB or Parquet, in SI with units in the headings, and with where it comes from."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording import Recording
from rig.content.phrase import phrase
from rig.errors import RunFileError
from rig.extras import optional
from rig.runfile.header import ORIGIN_WORDS, gear_name

BLOCK_ROWS = 16384
_TIME_DECIMALS = 9
"""Nanoseconds, as the run file keeps them."""
_LARGEST_MATLAB_BYTES = 2**31 - 1
"""A variable of a MATLAB 5 file cannot be longer."""


def _origin_note(recording: Recording) -> str:
    """SIMULATED, REPLAY or IMPORTED for a run that is not from hardware, else ""."""
    return ORIGIN_WORDS[recording.metadata.origin]


@dataclass(frozen=True)
class TableColumn:
    """A column of a table in text: its heading, and its cells for a block of rows; blocks are asked for in order."""

    heading: str
    cells: Callable[[slice], list[Any]]


def export_csv(recording: Recording, target: Path, *, overwrite: bool = False) -> int:
    """Write the run as text, a block at a time, rounded to a tenth of a count; returns the number of rows."""
    columns = [recorded_column(recording, name) for name in recording.signals]
    whole = slice(0, recording.rows)
    return export_table(recording, columns, whole, target, overwrite=overwrite)


def export_table(
    recording: Recording,
    columns: Sequence[TableColumn],
    rows: slice,
    target: Path,
    *,
    notes: Sequence[str] = (),
    overwrite: bool = False,
) -> int:
    """Write some rows of a run as text, these columns between time and flags; returns the number of rows.

    A block at a time; the file is there whole or not at all. `notes` are lines more for its head.
    Raises `RunFileError`.
    """
    whole = [
        TableColumn("time [s]", lambda part: recording.time(part).round(_TIME_DECIMALS).tolist()),
        *columns,
        TableColumn("flags", lambda part: recording.flags(part).tolist()),
        TableColumn("segment", lambda part: _segment_of_rows(recording, part)),
    ]
    partial = _partial(target, overwrite)
    try:
        with partial.open("w", encoding="utf-8", newline="\n") as stream:
            stream.writelines(f"# {line}\n" for line in (*_description(recording), *notes))
            stream.write(",".join(column.heading for column in whole) + "\n")
            for part in recording.blocks(rows, size=BLOCK_ROWS):
                cells = [column.cells(part) for column in whole]
                stream.writelines(
                    ",".join(map(str, row)) + "\n" for row in zip(*cells, strict=True)
                )
        os.replace(partial, target)
    except OSError as error:
        raise _not_written(target, error) from error
    finally:
        partial.unlink(missing_ok=True)
    return rows.stop - rows.start


def recorded_column(recording: Recording, name: str) -> TableColumn:
    """A channel in SI as it was recorded, its unit in the heading."""
    heading = f"{name} [{recording.signals[name].unit}]"
    return TableColumn(heading, lambda part: _rounded(recording, name, part))


def _rounded(recording: Recording, name: str, block: slice) -> list[float]:
    """A channel in SI to a tenth of one count; as it is where no counts are stored, whose resolution nobody knows."""
    values = recording.si(name, block)
    scale = abs(recording.signals[name].scale)
    if np.issubdtype(recording.stored(name, slice(0, 1)).dtype, np.integer) and scale > 0.0:
        values = values.round(1 - math.floor(math.log10(scale)))
    return values.tolist()


def export_mat(recording: Recording, target: Path, *, overwrite: bool = False) -> int:
    """Write the run as a MATLAB 5 file: one array per channel, structs `units`, `run`, `segments`; returns the rows."""
    import scipy.io

    if recording.rows * 8 > _LARGEST_MATLAB_BYTES:
        raise RunFileError(
            "is too long for a MATLAB 5 file",
            where=recording.metadata.run_id,
            value=f"{recording.rows} rows",
            limit=f"<= {_LARGEST_MATLAB_BYTES // 8} rows",
            remedy="MATLAB opens the run file itself with h5read.",
        )
    content = _matlab_content(recording)
    partial = _partial(target, overwrite)
    try:
        with partial.open("wb") as stream:
            scipy.io.savemat(
                stream, content, do_compression=True, long_field_names=True, oned_as="column"
            )
        os.replace(partial, target)
    except OSError as error:
        raise _not_written(target, error) from error
    finally:
        partial.unlink(missing_ok=True)
    return recording.rows


def _matlab_content(recording: Recording) -> dict[str, Any]:
    """The variables of a MATLAB file of a run."""
    m = recording.metadata
    content: dict[str, Any] = {
        "time": recording.time(),
        "flags": recording.flags().astype(np.float64),
    }
    content |= {name: recording.si(name) for name in recording.signals}
    content["units"] = {
        "time": "s",
        **{name: signal.unit for name, signal in recording.signals.items()},
    }
    content["run"] = {
        "description": "\n".join(_description(recording)),
        "origin": _origin_note(recording) or "HARDWARE",
        "run_id": m.run_id,
        "experiment": m.experiment,
        "outcome": m.outcome,
        "start_time": m.start_time,
        "operator": m.operator,
        "gear": gear_name(m),
        "gear_serial": m.gear_serial,
        "ratio": m.ratio,
        "mounting": m.mounting_said,
        "output_sense": float(m.output_sense) if m.is_said("output_sense") else math.nan,
        "sample_rate": m.sample_rate,
        "sha256": m.sha256,
        "sealed": m.is_sealed,
    }
    # MATLAB counts rows from 1 and its ranges include the end.
    content["segments"] = {
        "label": np.array([s.label for s in recording.segments] or [""], dtype=object),
        "first_row": np.array([s.start + 1.0 for s in recording.segments]),
        "last_row": np.array([float(s.stop) for s in recording.segments]),
        "setpoint": np.array([s.setpoint for s in recording.segments]),
        "direction": np.array([float(s.direction) for s in recording.segments]),
        "repeat": np.array([float(s.repeat) for s in recording.segments]),
    }
    return content


def export_parquet(recording: Recording, target: Path, *, overwrite: bool = False) -> int:
    """Write the run as Parquet, a block at a time; returns the number of rows.

    Column names and units are those of the text; the head of the text is the file's metadata `description`. Needs the
    extra `import`. Raises `RunFileError`.
    """
    arrow = optional("pyarrow", "writing Parquet files", "import")
    parquet = optional("pyarrow.parquet", "writing Parquet files", "import")
    floats = ["time [s]", *(f"{name} [{s.unit}]" for name, s in recording.signals.items())]
    fields = [arrow.field(name, arrow.float64()) for name in floats]
    fields += [arrow.field(name, arrow.int64()) for name in ("flags", "segment")]
    schema = arrow.schema(fields, metadata={"description": "\n".join(_description(recording))})
    partial = _partial(target, overwrite)
    try:
        with parquet.ParquetWriter(partial, schema) as writer:
            for part in recording.blocks(slice(0, recording.rows), size=BLOCK_ROWS):
                columns = [
                    recording.time(part).round(_TIME_DECIMALS),
                    *(_rounded(recording, name, part) for name in recording.signals),
                    recording.flags(part).astype(np.int64),
                    _segment_of_rows(recording, part),
                ]
                writer.write_table(arrow.table(columns, schema=schema))
        os.replace(partial, target)
    except OSError as error:
        raise _not_written(target, error) from error
    finally:
        partial.unlink(missing_ok=True)
    return recording.rows


def _description(recording: Recording) -> Iterator[str]:
    """What the run is, one line at a time, for the head of an export."""
    m = recording.metadata
    mark = _origin_note(recording)
    yield f"harmonic-rig export of run {m.run_id}{phrase(': {}', mark)}"
    if mark:
        yield f"{mark}: these are not measurements of this rig"
    yield f"protocol: {m.experiment or '-'}, outcome: {m.outcome or '-'}, operator: {m.operator or '-'}"
    yield f"started: {m.start_time or '-'}, ended: {m.end_time or '-'}"
    ratio = "" if math.isnan(m.ratio) else f", ratio {m.ratio:g}"
    yield f"gear: {gear_name(m) or '-'}, serial {m.gear_serial or '-'}{ratio}, mounting {m.mounting_said}"
    yield f"sample rate: {m.sample_rate:g} Hz, time base: {m.time_base}, SHA-256 of the run: {m.seal}"
    yield "SI units; angles as each encoder counts them; flags: 0 is a complete cycle on time; segment: -1 is none"


def _segment_of_rows(recording: Recording, block: slice) -> list[int]:
    """The index of the segment that each row belongs to, the latest where they overlap; -1 where there is none."""
    indices = np.full(block.stop - block.start, -1)
    for segment in recording.segments:
        first, last = max(segment.start, block.start), min(segment.stop, block.stop)
        if first < last:
            indices[first - block.start : last - block.start] = segment.index
    return indices.tolist()


def _partial(target: Path, overwrite: bool) -> Path:
    """Where the export is written until it is complete."""
    if target.exists() and not overwrite:
        raise RunFileError(
            "is there already", where=str(target), remedy="Name another file, or give --force."
        )
    return target.with_name(f".{target.name}.{os.getpid()}.tmp")


def _not_written(target: Path, error: OSError) -> RunFileError:
    return RunFileError(
        f"cannot be written: {error.strerror or error}",
        where=str(target),
        remedy="Name a folder that can be written.",
    )
