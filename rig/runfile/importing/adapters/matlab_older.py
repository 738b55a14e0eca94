"""The reader of MATLAB files of version 4 to 7, a program of its own: `python -m ... SOURCE TARGET` copies the arrays.

SciPy's compiled reader trusts the type codes in a file, and dies of damaged ones now and then, which no
`except` sees. What dies here is not the program that imports.
"""

from __future__ import annotations

import struct
import sys
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

DAMAGE = (
    OSError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    EOFError,
    OverflowError,
    MemoryError,
    AttributeError,
    RuntimeError,
    AssertionError,
    RecursionError,
    zlib.error,
    struct.error,
)
"""What readers of damaged files raise."""


def read_arrays(source: str) -> dict[str, NDArray[Any]]:
    """The numeric arrays of a file by name. Raises one of `DAMAGE`."""
    import scipy.io

    arrays: dict[str, NDArray[Any]] = {}
    try:
        content = scipy.io.loadmat(source, struct_as_record=False, appendmat=False)
    except scipy.io.matlab.MatReadError as error:
        # A child of Exception alone, which no other kind of damage is.
        raise ValueError(str(error)) from error
    for name, value in content.items():
        if not name.startswith("__"):
            _flatten(name, value, arrays)
    return arrays


def may_kill(source: str) -> bool:
    """Whether SciPy reads this file by compiled code: version 5 to 7. Raises one of `DAMAGE`."""
    import scipy.io

    try:
        return scipy.io.matlab.matfile_version(source, appendmat=False)[0] == 1
    except scipy.io.matlab.MatReadError as error:
        raise ValueError(str(error)) from error


def _copy_arrays(source: str, target: str) -> int:
    """Copy the arrays into an NPZ file, and their names as `names`; 0, or 1 with the reason printed."""
    try:
        arrays = read_arrays(source)
    except DAMAGE as error:
        print(error)
        return 1
    np.savez(target, *arrays.values(), names=np.array(list(arrays), dtype=str))
    return 0


def cell_names(name: str, count: int) -> list[str]:
    """What the cells of a variable are called: `name{1}`, `name{2}`; one alone as the variable."""
    if count == 1:
        return [name]
    return [f"{name}{{{number}}}" for number in range(1, count + 1)]


def _flatten(name: str, value: Any, arrays: dict[str, NDArray[Any]]) -> None:
    """Numeric arrays of a variable: those inside structs under `name.field`, of cell arrays under `name{2}`."""
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        for key in fields:
            _flatten(f"{name}.{key}", getattr(value, key), arrays)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        cells = value.ravel(order="F")
        for at, cell in zip(cell_names(name, len(cells)), cells, strict=True):
            _flatten(at, cell, arrays)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb":
        arrays[name] = value


if __name__ == "__main__":
    sys.exit(_copy_arrays(*sys.argv[1:]))
