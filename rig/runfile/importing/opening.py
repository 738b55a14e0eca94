"""Which adapter reads a file: by the kind that is named, and for text by what its first lines say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import extensions
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.damage import refuse_missing
from rig.runfile.importing.adapters.arrays import ArrayTable
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.adapters.text_form import TextForm, is_named
from rig.runfile.importing.channel_map import ImportOptions

FORMATS = {
    "csv": "delimited text of any kind, TwinCAT scope exports, LabVIEW .lvm; also packed (.gz)",
    "mat": "MATLAB 4 to 7.3, structs and cell arrays included",
    "npz": "NumPy .npz and .npy",
    "hdf5": "HDF5, columns by their path",
    "json": "logs in JSON: a list of objects",
    "parquet": "Parquet (extra `import`)",
    "tdms": "TDMS of LabVIEW and DIAdem (extra `import`)",
    "mdf": "MDF 3 and 4, ASAM measurement data (extra `import`)",
}
"""Kinds of files, each with what it is."""


@dataclass(frozen=True)
class Importer:
    """A kind of file that another package reads: what it is, and the reading of a whole file.

    `read` gives the columns by their heading, each a vector of numbers, all of one length, with the unit in brackets
    where the file states it ("speed [r/min]"). Times, units, signs and gaps are looked at afterwards, by the code that
    looks at every file.
    """

    summary: str
    read: Callable[[Path], Mapping[str, Any]]

    def table(self, whose: extensions.Extension, path: Path) -> ArrayTable:
        """The columns of one file. Raises `RunFileError` for whatever the package's own code raises of it."""
        try:
            arrays = {name: np.asarray(values) for name, values in self.read(path).items()}
        except OSError as error:
            why = error.strerror or str(error)
            raise RunFileError("cannot be read", where=str(path), value=why) from error
        except Exception as error:
            why = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
            raise RunFileError(
                f"is not a readable {whose.name} file ({why})", where=str(path)
            ) from error
        return ArrayTable(path, arrays, whose.name, whose)


def formats() -> tuple[str, ...]:
    """Every kind of file: ours, then those of other packages."""
    return (*FORMATS, *(one.name for one in extensions.usable(("importers",), FORMATS)))


def brought(kind: str) -> extensions.Extension | None:
    """What another package brings for this kind of file; None for ours, and where there is none."""
    found = extensions.usable(("importers",), FORMATS)
    return next((one for one in found if one.name == kind), None)


def kind_of(path: Path) -> str:
    """The kind of a file by its first bytes, and by its name where these say nothing."""
    try:
        with path.open("rb") as stream:
            head = stream.read(64)
    except OSError:
        head = b""
    for mark, kind in _MARKS:
        if head.startswith(mark):
            return kind
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text[:1] in (b"{", b"["):
        return "json"
    return {".mat": "mat", ".npz": "npz", ".npy": "npz"}.get(path.suffix.lower(), "csv")


_MARKS = (
    (b"MATLAB", "mat"),
    (b"\x89HDF", "hdf5"),
    (b"PAR1", "parquet"),
    (b"TDSm", "tdms"),
    (b"MDF ", "mdf"),
    (b"\x93NUMPY", "npz"),
    (b"PK\x03\x04", "npz"),
)
"""First bytes of a kind of file."""


def open_table(kind: str, path: Path, form: TextForm = TextForm()) -> Table:
    """The columns of one file. Raises `RunFileError` for one that is not there or cannot be read as that kind."""
    refuse_missing(path)
    if kind == "csv":
        return _open_text(path, form)
    if kind == "mat":
        from rig.runfile.importing.adapters.matlab import MatlabTable

        return MatlabTable(path)
    if kind == "npz":
        from rig.runfile.importing.adapters.arrays import numpy_table

        return numpy_table(path)
    if kind == "hdf5":
        from rig.runfile.importing.adapters.hdf5 import Hdf5Table

        return Hdf5Table(path)
    if kind == "json":
        from rig.runfile.importing.adapters.json_log import json_table

        return json_table(path)
    if kind == "parquet":
        from rig.runfile.importing.adapters.parquet import ParquetTable

        return ParquetTable(path)
    if kind == "tdms":
        from rig.runfile.importing.adapters.tdms import TdmsTable

        return TdmsTable(path)
    if kind == "mdf":
        from rig.runfile.importing.adapters.mdf import MdfTable

        return MdfTable(path)
    if one := brought(kind):
        importer: Importer = one.loaded(Importer)
        return importer.table(one, path)
    raise RunFileError("is no kind of file", where=kind, limit=", ".join(formats()))


def open_tables(
    kind: str, paths: Sequence[Path], options: ImportOptions | None = None
) -> tuple[Table, ...]:
    """The columns of the files of one run, each by what is said of its form. Raises `ConfigurationError` for what is
    said of a file that is none of them, `RunFileError` for one that cannot be read.
    """
    options = options or ImportOptions(channels=())
    numbered = list(enumerate(paths, 1))
    for name in options.files:
        if not any(is_named(path, number, name) for number, path in numbered):
            raise ConfigurationError(
                "there is no such file among those that are imported",
                where=f"files.{name}",
                limit=", ".join(f"{number} {path.name}" for number, path in numbered),
            )
    return tuple(open_table(kind, path, options.form_of(path, number)) for number, path in numbered)


def _open_text(path: Path, form: TextForm) -> Table:
    """What is said of the lines by hand goes before what the file looks like."""
    from rig.runfile.importing.adapters.labview import LabviewTable, is_labview
    from rig.runfile.importing.adapters.scope import ScopeTable, is_scope_export
    from rig.runfile.importing.adapters.text import DelimitedTable

    if form == TextForm():
        if is_scope_export(path):
            return ScopeTable(path)
        if is_labview(path):
            return LabviewTable(path)
    return DelimitedTable(path, form)
