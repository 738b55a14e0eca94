"""Columns of HDF5 files by their path, read in constant memory."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import RigError, RunFileError
from rig.runfile.importing.adapters.arrays import NUMERIC, refuse_lengths, refuse_texts
from rig.runfile.importing.adapters.table import BATCH_ROWS, Batch, CellReader, not_finite
from rig.runfile.structure import refuse_foreign_storage

UNIT_ATTRIBUTES = ("units", "unit", "Unit", "Units")
_MOST_COLUMNS = 64
"""Columns of a matrix that are listed: an image is no recording."""


class Hdf5Table:
    """Datasets by path (`run/torque`), columns of matrices (`log#2`), fields of tables (`log.angle`)."""

    line_word = "row"
    period: float | None = None
    start_ns = 0
    stamped: Collection[int] = ()
    may_be_retimed = True

    def __init__(self, path: Path) -> None:
        self.path = path
        self._places: dict[str, tuple[str, str | int | None, int]] = {}
        units: dict[str, str] = {}
        size = path.stat().st_size if path.is_file() else 0
        try:
            with h5py.File(path, "r") as file:

                def visit(name: str, item: object) -> None:
                    if isinstance(item, h5py.Dataset) and item.shape and item.size:
                        for heading, place in _columns(name, item).items():
                            refuse_foreign_storage(item, size)
                            self._places[heading] = (name, place, max(item.shape))
                            units[heading] = _unit(item)

                file.visititems(visit)
        except RigError:
            raise
        except (OSError, RuntimeError, ValueError, KeyError) as error:
            raise RunFileError(
                f"is not a readable HDF5 file ({' '.join(str(error).split())[:120]})",
                where=str(path),
            ) from error
        self.headings = tuple(self._places)
        if not self.headings:
            raise RunFileError(
                "has no numeric columns", where=str(path), remedy="Is this the right file?"
            )
        self.units = tuple(units[heading] for heading in self.headings)
        self.times: tuple[int | None, ...] = (None,) * len(self.headings)
        self.notes = (f"HDF5 file with {len(self.headings)} columns",)

    def batches(
        self, columns: Sequence[int], readers: Mapping[int, CellReader] | None = None
    ) -> Iterator[Batch]:
        refuse_texts(self.path, readers)
        names = [self.headings[index] for index in columns]
        refuse_lengths(self.path, {name: self._places[name][2] for name in names})
        rows = self._places[names[0]][2]
        with h5py.File(self.path, "r") as file:
            for first in range(0, rows, BATCH_ROWS):
                part = slice(first, min(first + BATCH_ROWS, rows))
                try:
                    values = np.column_stack([self._read(file, name, part) for name in names])
                except OSError as error:
                    raise RunFileError(
                        f"is damaged ({' '.join(str(error).split())[:120]})",
                        where=f"{self.path}, from row {first + 1} on",
                    ) from error
                lines = np.arange(part.start + 1, part.stop + 1)
                yield Batch(lines, values, not_finite(values, lines, names))

    def _read(self, file: h5py.File, name: str, part: slice) -> Any:
        path, place, rows = self._places[name]
        dataset: Any = file[path]
        if place is None:
            block = dataset[part] if dataset.ndim == 1 else dataset[()].ravel()[part]
        elif isinstance(place, str):
            block = dataset.fields(place)[part]
        else:
            block = dataset[part, place] if dataset.shape[0] == rows else dataset[place, part]
        return np.asarray(block, dtype=np.float64)


def _columns(name: str, item: h5py.Dataset) -> dict[str, str | int | None]:
    """The columns of a dataset: heading, and where in it: a field, a column of a matrix, or all of it."""
    if item.dtype.names:
        kinds = {field: item.dtype[field].kind for field in item.dtype.names}
        return {f"{name}.{f}": f for f, kind in kinds.items() if kind in NUMERIC and item.ndim == 1}
    if item.dtype.kind not in NUMERIC or item.ndim > 2:
        return {}
    if item.ndim == 1 or 1 in item.shape:
        return {name: None}
    width = min(item.shape)
    if width > _MOST_COLUMNS:
        return {}
    return {f"{name}#{k + 1}": k for k in range(width)}


def _unit(item: h5py.Dataset) -> str:
    """The unit that an attribute of the dataset states."""
    for name in UNIT_ATTRIBUTES:
        value = item.attrs.get(name)
        if isinstance(value, bytes):
            return value.decode("utf-8", "replace")
        if isinstance(value, str):
            return value
    return ""
