"""Which adapter reads a file: by the kind that is named, and for text by what its first lines say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rig.errors import RunFileError
from rig.runfile.importing.adapters.table import Table
from rig.runfile.importing.adapters.text_form import TextForm

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


def open_table(kind: str, path: Path, form: TextForm = TextForm()) -> Table:
    """The columns of one file. Raises `RunFileError` for one that cannot be read as that kind."""
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
    raise RunFileError("is no kind of file", where=kind, limit=", ".join(FORMATS))


def open_tables(kind: str, paths: Sequence[Path], form: TextForm = TextForm()) -> tuple[Table, ...]:
    """The columns of the files of one run."""
    return tuple(open_table(kind, path, form) for path in paths)


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
