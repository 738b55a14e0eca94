"""Columns that lie in memory: what MATLAB, NumPy and JSON files come to."""

from __future__ import annotations

import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.extensions import Extension
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.adapters.table import (
    BATCH_ROWS,
    Batch,
    CellReader,
    heading_units,
    not_finite,
)

NUMERIC = "iufb"


class ArrayTable:
    """Arrays by name as columns. Columns may differ in length: those that are used together must agree."""

    line_word = "row"
    period: float | None = None
    start_ns = 0
    stamped: Collection[int] = ()
    may_be_retimed = True

    def __init__(
        self,
        path: Path,
        arrays: Mapping[str, NDArray[Any]],
        kind: str,
        brought_by: Extension | None = None,
    ) -> None:
        """`brought_by` is the package whose importer read the file, where it was not one of ours."""
        self.path = path
        self.brought_by = brought_by
        self._columns: dict[str, NDArray[Any]] = {}
        for name, array in arrays.items():
            self._columns |= _named_columns(name, array)
        self.headings = tuple(self._columns)
        if not self.headings:
            raise RunFileError(
                "has no numeric arrays", where=str(path), remedy="Is this the right file?"
            )
        self.units = heading_units(self.headings)
        self.times: tuple[int | None, ...] = (None,) * len(self.headings)
        self.notes: tuple[str, ...] = (f"{kind} with {len(self.headings)} columns",)

    def batches(
        self, columns: Sequence[int], readers: Mapping[int, CellReader] | None = None
    ) -> Iterator[Batch]:
        refuse_texts(self.path, readers)
        names = [self.headings[index] for index in columns]
        chosen = [self._columns[name] for name in names]
        refuse_lengths(self.path, {n: len(a) for n, a in zip(names, chosen, strict=True)})
        for first in range(0, len(chosen[0]), BATCH_ROWS):
            values = np.column_stack(
                [array[first : first + BATCH_ROWS].astype(np.float64) for array in chosen]
            )
            lines = np.arange(first + 1, first + 1 + len(values))
            yield Batch(lines, values, not_finite(values, lines, names))


def _named_columns(name: str, array: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """The columns of an array: a vector is the column of its name; a matrix `M` gives `M#1`, `M#2`, ...;
    fields of a structured array are `M.field`.
    """
    if array.dtype.names:
        fields: dict[str, NDArray[Any]] = {}
        for field in array.dtype.names:
            fields |= _named_columns(f"{name}.{field}", array[field])
        return fields
    if array.dtype.kind not in NUMERIC or array.size < 1 or array.ndim > 2:
        return {}
    if array.ndim < 2 or 1 in array.shape:
        return {name: array.ravel()}
    tall = array if array.shape[0] >= array.shape[1] else array.T
    return {f"{name}#{index + 1}": tall[:, index] for index in range(tall.shape[1])}


def refuse_lengths(path: Path, lengths: Mapping[str, int]) -> None:
    """Raise `RunFileError` for columns of different lengths."""
    if len(set(lengths.values())) > 1:
        raise RunFileError(
            "the arrays differ in length",
            where=str(path),
            value=", ".join(f"{name} {length}" for name, length in lengths.items()),
            remedy="Map only arrays that were sampled together.",
        )


def refuse_texts(path: Path, readers: Mapping[int, CellReader] | None) -> None:
    """Raise `ConfigurationError` where a column of numbers should be read as dates or labels."""
    if readers:
        raise ConfigurationError(
            "the columns of this file are numbers, no dates and no labels",
            where=str(path),
            remedy="Give the unit of the time as a number: s, ms, us, ns, or count with seconds per count.",
        )


def numpy_table(path: Path) -> ArrayTable:
    """The arrays of an .npz or .npy file. Raises `RunFileError` for one that is damaged or holds objects."""
    try:
        # The stream is our own: NumPy leaves it open where the archive is damaged.
        with path.open("rb") as stream:
            loaded = np.load(stream, allow_pickle=False)
            is_archive = hasattr(loaded, "files")
            arrays = {n: loaded[n] for n in loaded.files} if is_archive else {path.stem: loaded}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, MemoryError) as error:
        raise RunFileError(
            f"is not a readable NumPy file ({' '.join(str(error).split())[:120]})",
            where=str(path),
            remedy="Save plain arrays of numbers with numpy.savez.",
        ) from error
    return ArrayTable(path, arrays, "NumPy file")
