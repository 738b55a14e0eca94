"""Foreign recordings made for tests, and the shortest way to bring one in."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import Imported, import_tables
from rig.runfile.importing.opening import open_table
from rig.runfile.read import close_recording, open_run

TIME = np.arange(6) * 0.002
DEGREES = np.array([0.0, 1.5, 3.0, -4.25, 6.0, 7.5])
TORQUES = np.array([0.5, -0.25, 0.125, 1.0, 2.5, -1e-3])


def import_csv(path: Path, options: ImportOptions, place: Callable[[], Path]) -> Imported:
    """Make a run of a delimited text file; `place()` names the run file once the first rows have been understood."""
    return import_tables((open_table("csv", path, options.form_of(path, 1)),), options, place)


def import_mat(path: Path, options: ImportOptions, place: Callable[[], Path]) -> Imported:
    """Make a run of a MATLAB file; `place()` names the run file once the first rows have been understood."""
    return import_tables((open_table("mat", path),), options, place)


def bring_in(path: Path, *channels: str, fmt: str = "csv", **options: Any) -> Imported:
    read = import_csv if fmt == "csv" else import_mat
    made = ImportOptions(channels=tuple(map(parse_channel, channels)), **options)
    return read(path, made, lambda: path.with_name("00001-import-x.h5"))


def columns(made: Imported, *names: str) -> list[np.ndarray]:
    recording = open_run(made.path, verify=True)
    try:
        return [recording.time() if name == "time" else recording.si(name) for name in names]
    finally:
        close_recording(recording)


def file_of(folder: Path, text: str | bytes, name: str = "bench.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def table(delimiter: str = ",", mark: str = ".", head: str = "t [s]|Position [deg]|M [N m]") -> str:
    rows = [
        delimiter.join(repr(float(x)).replace(".", mark) for x in row)
        for row in zip(TIME, DEGREES, TORQUES, strict=True)
    ]
    return "\n".join([head.replace("|", delimiter), *rows]) + "\n"
