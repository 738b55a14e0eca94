"""Columns of numbers in MATLAB files: version 4 to 7 (SciPy reads them) and 7.3 (they are HDF5)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import RunFileError
from rig.runfile.importing.adapters.arrays import ArrayTable
from rig.runfile.importing.adapters.matlab_older import DAMAGE, cell_names, may_kill, read_arrays
from rig.runfile.structure import refuse_foreign_storage

_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_TEXTS_AND_CELLS = (b"char", b"cell", b"struct", "char", "cell", "struct")
DEEPEST = 12
_READER = "rig.runfile.importing.adapters.matlab_older"


class MatlabTable(ArrayTable):
    """The numeric arrays of a MATLAB file as columns.

    A field of a struct is `s.field`, a cell of a cell array `c{2}`, both together `log{3}.angle`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(path, self._load(), "MATLAB file")

    def _load(self) -> dict[str, NDArray[Any]]:
        try:
            with self.path.open("rb") as stream:
                head = stream.read(520)
            if head.startswith(_HDF5_MARK) or head[512:] == _HDF5_MARK:
                return self._load_hdf5()
            return self._load_older()
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
                _READER,
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
            for name, item in file.items():
                if not name.startswith("#"):
                    _gather(file, name, item, size, arrays)
        return arrays


def _gather(
    file: h5py.File,
    name: str,
    item: object,
    size: int,
    arrays: dict[str, NDArray[Any]],
    depth: int = 0,
) -> None:
    """The numeric arrays of a variable of version 7.3, those in structs and cell arrays included."""
    if depth > DEEPEST:
        raise ValueError(f"{name} is nested deeper than {DEEPEST} levels")
    if isinstance(item, h5py.Group):
        for key, inner in item.items():
            _gather(file, f"{name}.{key}", inner, size, arrays, depth + 1)
        return
    if not isinstance(item, h5py.Dataset):
        return
    kind = item.attrs.get("MATLAB_class", b"double")
    refuse_foreign_storage(item, size)
    if kind in (b"cell", "cell") and item.dtype == h5py.ref_dtype:
        # What MATLAB counts along columns, HDF5 has along rows.
        cells = item[()].ravel()
        for at, reference in zip(cell_names(name, len(cells)), cells, strict=True):
            inner = file[reference] if reference else None
            _gather(file, at, inner, size, arrays, depth + 1)
    elif kind not in _TEXTS_AND_CELLS and item.dtype.kind in "iufb":
        arrays[name] = item[()].T
