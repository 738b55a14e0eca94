"""What simulated rigs were made of, as a table beside their runs: a row per run and number. No analysis reads it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.recording import mapping_of
from model.errors import path_of
from rig.fleet.questions import TRUTH_NAME
from rig.fleet.table import COMPRESSION
from rig.library.folder import sealed_runs
from rig.runfile.read import glance

if TYPE_CHECKING:
    import pyarrow

_DAY_NAME = ".truth.parquet"


def _truth_schema() -> pyarrow.Schema:
    """The columns: which run of which gear on which bench; its name in the run's truth; its value (SI)."""
    import pyarrow as pa

    words = ("run_file", "run", "gear", "bench", "protocol", "name")
    return pa.schema([*((word, pa.string()) for word in words), ("value", pa.float64())])


def keep_truth(folder: Path, name: str) -> None:
    """Keep the truth of the runs of a folder in it; `name` is how the table calls the folder."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [row for run in sealed_runs(folder) for row in _rows(run, name)]
    table = pa.Table.from_pylist(rows, schema=_truth_schema())
    pq.write_table(table, folder / _DAY_NAME, compression=COMPRESSION)


def gather_truth(folder: Path, days: Sequence[Path]) -> None:
    """One table of the truth of all days, written whole."""
    import pyarrow.parquet as pq

    scratch = folder / f".{TRUTH_NAME}.{os.getpid()}.tmp"
    with pq.ParquetWriter(scratch, _truth_schema(), compression=COMPRESSION) as writer:
        for day in days:
            part = day / _DAY_NAME
            if part.is_file():
                writer.write_table(pq.read_table(part, schema=_truth_schema()))
    scratch.replace(folder / TRUTH_NAME)


def _rows(run: Path, name: str) -> Iterator[dict[str, Any]]:
    metadata = glance(run).metadata
    told = {
        "run_file": f"{name}/{run.name}",
        "run": metadata.run_id,
        "gear": metadata.gear_serial,
        "bench": str(metadata.process.get("bench", "")),
        "protocol": metadata.experiment,
    }
    for path, value in _numbers(mapping_of(metadata.process.get("truth"))):
        yield {**told, "name": path, "value": value}


def _numbers(content: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """The numbers of a nested record with their names, parts parted by a dot."""
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from _numbers(value, path_of(path, str(key)))
    elif isinstance(content, list):
        for place, value in enumerate(content):
            yield from _numbers(value, f"{path}.{place}")
    elif isinstance(content, (int, float)) and not isinstance(content, bool):
        yield path, float(content)
