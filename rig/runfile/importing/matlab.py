"""Columns of numbers in MATLAB files: version 4 to 7 (SciPy reads them) and 7.3 (they are HDF5)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import RunFileError
from rig.runfile.importing.matlab_older import DAMAGE, may_kill, read_arrays
from rig.runfile.importing.tables import BATCH_ROWS, BadCell, Batch
from rig.runfile.structure import refuse_foreign_storage

_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
READER = "rig.runfile.importing.matlab_older"


class MatlabTable:
    """The numeric arrays of a MATLAB file as columns.

    A vector is the column of its name; a matrix `M` gives `M#1`, `M#2`, ...; a field of a struct is
    `s.field`. Columns may differ in length: those that are used together must agree.
    """

    line_word = "row"

    def __init__(self, path: Path) -> None:
        self.path = path
        arrays = self._load()
        self._columns: dict[str, NDArray[np.float64]] = {}
        for name, array in arrays.items():
            self._add(name, array)
        self.headings = tuple(self._columns)
        if not self.headings:
            raise RunFileError(
                "has no numeric arrays", where=str(path), remedy="Is this the right file?"
            )

    @property
    def description(self) -> str:
        """How the file was read, in words."""
        return f"MATLAB file with {len(self.headings)} columns"

    def batches(self, columns: Sequence[int]) -> Iterator[Batch]:
        chosen = [self._columns[self.headings[index]] for index in columns]
        lengths = {
            self.headings[index]: len(array) for index, array in zip(columns, chosen, strict=True)
        }
        if len(set(lengths.values())) > 1:
            raise RunFileError(
                "the arrays differ in length",
                where=str(self.path),
                value=", ".join(f"{name} {length}" for name, length in lengths.items()),
                remedy="Map only arrays that were sampled together.",
            )
        rows = len(chosen[0])
        for first in range(0, rows, BATCH_ROWS):
            values = np.column_stack([array[first : first + BATCH_ROWS] for array in chosen])
            lines = np.arange(first + 1, first + 1 + len(values))
            yield Batch(lines, values, self._bad_cells(values, lines, columns))

    def _bad_cells(
        self, values: NDArray[np.float64], lines: NDArray[np.int64], columns: Sequence[int]
    ) -> dict[int, BadCell]:
        bad: dict[int, BadCell] = {}
        for row, index in np.argwhere(~np.isfinite(values)):
            heading = self.headings[columns[index]]
            bad.setdefault(
                int(row), BadCell(int(lines[row]), heading, str(values[row, index]), "not finite")
            )
        return bad

    def _add(self, name: str, array: NDArray[Any]) -> None:
        if array.dtype.kind not in "iufb" or array.size < 1 or array.ndim > 2:
            return
        if array.ndim < 2 or 1 in array.shape:
            self._columns[name] = array.ravel().astype(np.float64)
        else:
            tall = array if array.shape[0] >= array.shape[1] else array.T
            for index in range(tall.shape[1]):
                self._columns[f"{name}#{index + 1}"] = tall[:, index].astype(np.float64)

    def _load(self) -> dict[str, NDArray[Any]]:
        try:
            with self.path.open("rb") as stream:
                head = stream.read(520)
            if head.startswith(_HDF5_MARK) or head[512:] == _HDF5_MARK:
                return self._load_hdf5()
            return self._load_older()
        except FileNotFoundError as error:
            raise RunFileError(
                "there is no such file", where=str(self.path), remedy="Check the path."
            ) from error
        except DAMAGE as error:
            text = " ".join(str(error).split())[:120] or type(error).__name__
            raise RunFileError(
                f"is not a readable MATLAB file ({text})",
                where=str(self.path),
                remedy="Save it again with `save -v7`, or export it as text.",
            ) from error

    def _load_older(self) -> dict[str, NDArray[Any]]:
        """By a process of its own where the reader may die of the file (`matlab_older`)."""
        if not may_kill(str(self.path)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return read_arrays(str(self.path))
        with tempfile.TemporaryDirectory(prefix="harmonic-rig-") as folder:
            copy = Path(folder) / "arrays.npz"
            command = [
                sys.executable,
                "-P",
                "-W",
                "ignore",
                "-m",
                READER,
                str(self.path),
                str(copy),
            ]
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise ValueError(done.stdout or "its contents are damaged")
            with np.load(copy) as arrays:
                names = arrays["names"].tolist()
                return {name: arrays[f"arr_{i}"] for i, name in enumerate(names)}

    def _load_hdf5(self) -> dict[str, NDArray[Any]]:
        arrays: dict[str, NDArray[Any]] = {}
        size = self.path.stat().st_size
        with h5py.File(self.path, "r") as file:

            def visit(name: str, item: object) -> None:
                kind = (
                    item.attrs.get("MATLAB_class", b"double")
                    if isinstance(item, h5py.Dataset)
                    else b"struct"
                )
                numeric = kind not in (b"char", b"cell", b"struct", "char", "cell", "struct")
                if (
                    isinstance(item, h5py.Dataset)
                    and numeric
                    and not name.startswith("#")
                    and item.dtype.kind in "iufb"
                ):
                    refuse_foreign_storage(item, size)
                    arrays[name.replace("/", ".")] = item[()].T

            file.visititems(visit)
        return arrays
