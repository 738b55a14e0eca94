"""Runs from files: those of this program as they are, recordings of other rigs through the importer."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.recording import ArraySource, Recording
from rig.api.gearing import gear
from rig.api.runs import Run
from rig.errors import ConfigurationError
from rig.runfile.importing.channel_map import ImportOptions, RunMap, read_channel_map
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.opening import open_tables
from rig.runfile.importing.stated import with_stated
from rig.runfile.importing.suitability import is_of_tables
from rig.runfile.read import close_recording, open_run

if TYPE_CHECKING:
    from pandas import DataFrame


def load(path: str | Path) -> Run:
    """A run file (.h5, or a growing or dead .h5.part). Held against its seal and checked as by every command.

    Raises `RunFileError` for a file that is missing, foreign, damaged, changed or cut off.
    """
    return Run(open_run(path), Path(path))


def read_csv(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in delimited text, as a run in memory; no run file is left behind.

    Several files are those of one run, joined on time. `channels` names what stands in which column, as `--channel`
    of `rig import` does, COLUMN[:UNIT[:SCALE]]::

        rig.read_csv("bench.csv", channels={"time": "t:s", "input_angle": "Position:deg", "torque": "M:N m"})

    `map` is a channel map (TOML) instead, or for the rest, `run` which of its runs where it has several. `options`
    are those of `rig import` under their names there with underscores: rate, no_time, protocol, ratio, output_sense,
    drop_bad_rows, delimiter, skip, ... Those that are repeated there are mappings by channel here:
    modulus={"input_angle": 360.0}, lag={"torque": "2ms"}, accuracy={"output_angle": "5arcsec"} (numbers are in SI).
    Raises `ConfigurationError` for what cannot be accepted, `RunFileError` for what is wrong in the file.
    """
    return _read("csv", paths, channels, map, run, options)


def read_mat(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in MATLAB files (4 to 7.3), as a run in memory; see `read_csv`."""
    return _read("mat", paths, channels, map, run, options)


def read_npz(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in NumPy files (.npz, .npy), as a run in memory; see `read_csv`."""
    return _read("npz", paths, channels, map, run, options)


def read_hdf5(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in HDF5, columns by their path, as a run in memory; see `read_csv`."""
    return _read("hdf5", paths, channels, map, run, options)


def read_json(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in JSON (a list of objects, one per row), as a run in memory; see `read_csv`."""
    return _read("json", paths, channels, map, run, options)


def read_parquet(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in Parquet files, as a run in memory; see `read_csv`.

    Needs the extra `import`.
    """
    return _read("parquet", paths, channels, map, run, options)


def from_pandas(
    frame: DataFrame,
    channels: Mapping[str, str],
    *,
    units: Mapping[str, str] | None = None,
    **options: Any,
) -> Run:
    """A recording of another rig in a pandas frame, as a run in memory; a named index is a column too.

    `channels` names what stands in which column, as for `read_csv`; `units` are those of columns whose headings name
    none::

        rig.from_pandas(frame, {"time": "t", "torque": "M"}, units={"t": "ms", "M": "N m"})

    Raises `ConfigurationError` for a unit of a column that there is not, and what `read_csv` raises.
    """
    whole = frame.reset_index() if any(name is not None for name in frame.index.names) else frame
    columns = {str(name): whole[name] for name in whole.columns}
    unknown = sorted(set(units or {}) - set(columns))
    if unknown:
        raise ConfigurationError(
            "no such column", where="units", value=unknown[0], limit=", ".join(columns)
        )
    headed = {
        f"{name} [{units[name]}]" if units and name in units else name: c
        for name, c in columns.items()
    }
    arrays = {heading: _numbers(column) for heading, column in headed.items()}
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-") as folder:
        file = Path(folder) / "frame.csv"
        numbers = [heading for heading, values in arrays.items() if values is not None]
        quoted = ",".join('"' + heading.replace('"', '""') + '"' for heading in numbers)
        rows = zip(*(arrays[heading] for heading in numbers), strict=True)
        lines = [",".join(map(repr, row)) for row in rows]
        file.write_text("\n".join([quoted, *lines]) + "\n", encoding="utf-8")
        return _read("csv", (file,), channels, None, "", options)


def _numbers(column: Any) -> list[float] | None:
    """A column as numbers; times of a calendar in seconds since 1970, NaN where one is missing; None for words."""
    if column.dtype.kind == "M":
        # A frame keeps times in s, ms, us or ns, by its pandas and by where they are from: never count without asking.
        seconds = column.dt.as_unit("ns").astype("int64") / 1e9
        return seconds.where(column.notna(), float("nan")).tolist()
    return column.astype(float).tolist() if column.dtype.kind in "biuf" else None


def read_tdms(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in TDMS files of LabVIEW or DIAdem, as a run in memory; see `read_csv`.

    Needs the extra `import`.
    """
    return _read("tdms", paths, channels, map, run, options)


def read_mdf(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    map: str | Path | None = None,
    run: str = "",
    **options: Any,
) -> Run:
    """A recording of another rig in MDF files (ASAM, versions 3 and 4), as a run in memory; see `read_csv`.

    Needs the extra `import`.
    """
    return _read("mdf", paths, channels, map, run, options)


_RENAMED = {
    "protocol": "experiment",
    "parameters": "gear",
    "gear": "gear_serial",
    "start": "start_time",
    "ragged": "is_ragged",
}
"""Options of the command whose names differ from those of `ImportOptions`."""


STATED = ("modulus", "lag", "accuracy")
"""Options by channel, each a mapping of its own."""


def _read(
    kind: str,
    paths: tuple[str | Path, ...],
    channels: Mapping[str, str] | None,
    map_file: str | Path | None,
    run: str,
    options: Mapping[str, Any],
) -> Run:
    """The recording as the importer makes it. It goes through a run file that nobody sees, so that there is one way."""
    if not paths:
        raise ConfigurationError("needs a file", where=f"rig.read_{kind}")
    files = [Path(path) for path in paths]
    wanted = _options(channels or {}, map_file, run, options)
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-") as folder:
        made = import_tables(
            open_tables(kind, files, wanted),
            wanted,
            lambda: Path(folder) / f"{files[0].stem}.h5",
        )
        recording = open_run(made.path)
        try:
            return Run(_in_memory(recording))
        finally:
            close_recording(recording)


def _options(
    channels: Mapping[str, str], map_file: str | Path | None, run: str, options: Mapping[str, Any]
) -> ImportOptions:
    """What the file does not say of itself. Raises `ConfigurationError` for an option that there is not."""
    stated = {name: options.get(name, {}) for name in STATED}
    given = {_RENAMED.get(n, n): value for n, value in options.items() if n not in STATED}
    allowed = {f.name for f in fields(ImportOptions)} - {"channels", "segments", "reverse"}
    unknown = sorted(set(given) - allowed)
    if unknown:
        raise ConfigurationError(
            "no such option of an import",
            where=unknown[0],
            limit=", ".join(sorted({*allowed, *STATED})),
        )
    if "gear" in given:
        given["gear"] = gear(given["gear"])
    if is_of_tables(str(given.get("experiment", ""))):
        given.setdefault("no_time", True)
    given["channels"] = tuple(parse_channel(f"{name}={text}") for name, text in channels.items())
    return with_stated(_mapped(map_file, run).options(given), **stated)


def _mapped(map_file: str | Path | None, run: str) -> RunMap:
    """What a map says of one run. Raises `ConfigurationError` where it holds several and none of them is named."""
    if map_file is None:
        return RunMap("", {})
    maps = read_channel_map(Path(map_file))
    chosen = [one for one in maps if one.name == run]
    if len(chosen) != 1:
        raise ConfigurationError(
            "the map has no such run" if run else "the map has several runs",
            where=str(map_file),
            value=run or None,
            limit=", ".join(one.name for one in maps),
            remedy='Name one: run="NAME".',
        )
    return chosen[0]


def _in_memory(recording: Recording) -> Recording:
    """The recording with its rows in memory: it is no file any more, and has no hash of one."""
    rows = recording.rows
    arrays = {name: recording.stored(name) for name in recording.signals}
    source = ArraySource(arrays, recording.source.time_ns(0, rows), recording.flags())
    metadata = replace(recording.metadata, sha256="", is_sealed=False)
    return replace(recording, metadata=metadata, source=source)
