"""Columns of Parquet files: numbers, truth values, and moments of the calendar."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.extras import optional
from rig.runfile.importing.adapters.blocks import (
    BlockTable,
    FileColumn,
    only_one,
    refused_damage,
    seconds_since,
)
from rig.runfile.importing.adapters.hdf5 import UNIT_ATTRIBUTES
from rig.runfile.importing.adapters.table import BATCH_ROWS

KIND = "Parquet file"


class ParquetTable(BlockTable):
    """The columns of a Parquet file. A unit is what the metadata of the column says under `unit` or `units`.

    Timestamps and durations come in seconds; the only column of timestamps is the time of the
    others, unless another one is named. Texts and nested columns are left out.
    """

    def __init__(self, path: Path) -> None:
        self._package = optional("pyarrow.parquet", "reading Parquet files", "import")
        self._arrow = optional("pyarrow", "reading Parquet files", "import")
        with refused_damage(path, KIND), self._package.ParquetFile(path) as file:
            schema, rows = file.schema_arrow, file.metadata.num_rows
            kinds = self._arrow.types
            moments = [f.name for f in schema if kinds.is_timestamp(f.type)]
            start_ns = self._first_moment(file, moments)
            time = only_one(moments)
            columns = [
                FileColumn(
                    heading=field.name,
                    unit="s" if kinds.is_temporal(field.type) else _unit(field.metadata),
                    rows=rows,
                    time="" if field.name == time else time,
                    is_moment=field.name in moments,
                )
                for field in schema
                if self._is_number(field.type)
            ]
        super().__init__(path, columns, KIND, start_ns)

    def _is_number(self, kind: Any) -> bool:
        types = self._arrow.types
        tests = (
            types.is_integer, types.is_floating, types.is_boolean, types.is_decimal,
            types.is_timestamp, types.is_duration,
        )  # fmt: skip
        return any(test(kind) for test in tests)

    def _first_moment(self, file: Any, moments: Sequence[str]) -> int:
        """The earliest first moment [ns since 1970] of these columns; 0 where there is none."""
        if not moments:
            return 0
        batch = next(file.iter_batches(batch_size=BATCH_ROWS, columns=list(moments)), None)
        if batch is None:
            return 0
        stamps = [self._in_ns(column).to_numpy(zero_copy_only=False) for column in batch.columns]
        found = [known[0] for s in stamps if len(known := s[~np.isnat(s)])]
        return min((int(stamp.astype(np.int64)) for stamp in found), default=0)

    def _in_ns(self, column: Any) -> Any:
        return column.cast(self._arrow.timestamp("ns"))

    def blocks(self, columns: Sequence[int]) -> Iterator[NDArray[np.float64]]:
        names = [self.headings[index] for index in columns]
        with self._package.ParquetFile(self.path) as file:
            for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=names):
                yield np.column_stack([self._numbers(batch.column(name)) for name in names])

    def _numbers(self, column: Any) -> NDArray[np.float64]:
        types = self._arrow.types
        if types.is_timestamp(column.type):
            stamps = self._in_ns(column).to_numpy(zero_copy_only=False)
            return seconds_since(stamps, self.start_ns)
        if types.is_duration(column.type):
            spans = column.cast(self._arrow.duration("ns")).to_numpy(zero_copy_only=False)
            return seconds_since(spans.astype(np.int64).view("datetime64[ns]"), 0)
        numbers = column.cast(self._arrow.float64(), safe=False)
        return numbers.to_numpy(zero_copy_only=False)


def _unit(metadata: dict[bytes, bytes] | None) -> str:
    """The unit that the metadata of a column says."""
    said = metadata or {}
    found = next((said[key.encode()] for key in UNIT_ATTRIBUTES if key.encode() in said), b"")
    return found.decode("utf-8", "replace")
