"""Rows as Parquet and back: the only place that knows the file format."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rig.fleet.results import Row, arrow_schema

if TYPE_CHECKING:
    import pyarrow

COMPRESSION = "zstd"
ORDER = ("run_file", "kind", "is_metric", "quantity")
"""By what rows are sorted: within each file, and in every table that is handed out."""


def table_bytes(rows: Sequence[Row]) -> bytes:
    """Rows as the bytes of a Parquet file, sorted."""
    import pyarrow as pa

    return parquet_bytes(pa.Table.from_pylist(list(rows), schema=arrow_schema()))


def parquet_bytes(table: pyarrow.Table) -> bytes:
    """A table as the bytes of a Parquet file, sorted."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(sorted_table(table), buffer, compression=COMPRESSION)
    return buffer.getvalue()


def sorted_table(table: pyarrow.Table) -> pyarrow.Table:
    """The same rows in their order."""
    return table.sort_by([(name, "ascending") for name in ORDER])
