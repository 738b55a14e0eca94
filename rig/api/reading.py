"""Runs from files: those of this program as they are, recordings of other rigs through the importer."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.recording import ArraySource, Recording
from rig.api.gearing import gear
from rig.api.runs import Run
from rig.errors import ConfigurationError
from rig.runfile.importing import convert
from rig.runfile.read import close_recording, open_run

if TYPE_CHECKING:
    from rig.runfile.importing.convert import Imported, ImportOptions

    Importer = Callable[[Path, ImportOptions, Callable[[], Path]], Imported]


def load(path: str | Path) -> Run:
    """A run file (.h5, or a growing or dead .h5.part). Held against its seal and checked as by every command.

    Raises `RunFileError` for a file that is missing, foreign, damaged, changed or cut off.
    """
    return Run(open_run(path), Path(path))


def read_csv(
    path: str | Path,
    channels: Mapping[str, str] | None = None,
    *,
    map: str | Path | None = None,
    **options: Any,
) -> Run:
    """A recording of another rig in delimited text, as a run in memory; no run file is left behind.

    `channels` names what stands in which column, as `--channel` of `rig import` does, COLUMN[:UNIT[:SCALE]]::

        rig.read_csv("bench.csv", {"time": "t:s", "input_angle": "Position:deg", "torque": "M:N m"})

    `map` is a channel map (TOML) instead, or for the rest. `options` are those of `rig import` under their names
    there with underscores: rate, no_time, protocol, ratio, output_sense, drop_bad_rows, delimiter, ...
    Raises `ConfigurationError` for what cannot be accepted, `RunFileError` for what is wrong in the file.
    """
    return _read(convert.import_csv, path, channels, map, options)


def read_mat(
    path: str | Path,
    channels: Mapping[str, str] | None = None,
    *,
    map: str | Path | None = None,
    **options: Any,
) -> Run:
    """A recording of another rig in a MATLAB file (4 to 7.3), as a run in memory; see `read_csv`."""
    return _read(convert.import_mat, path, channels, map, options)


RENAMED = {
    "protocol": "experiment",
    "parameters": "gear",
    "gear": "gear_serial",
    "start": "start_time",
}
"""Options of the command whose names differ from those of `ImportOptions`."""


def _read(
    importer: Importer,
    path: str | Path,
    channels: Mapping[str, str] | None,
    map_file: str | Path | None,
    options: Mapping[str, Any],
) -> Run:
    """The recording as the importer makes it. It goes through a run file that nobody sees, so that there is one way."""
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-") as folder:
        made = importer(
            Path(path),
            _options(channels or {}, map_file, options),
            lambda: Path(folder) / f"{Path(path).stem}.h5",
        )
        recording = open_run(made.path)
        try:
            return Run(_in_memory(recording))
        finally:
            close_recording(recording)


def _options(
    channels: Mapping[str, str], map_file: str | Path | None, options: Mapping[str, Any]
) -> ImportOptions:
    """What the file does not say of itself. Raises `ConfigurationError` for an option that there is not."""
    given = {RENAMED.get(name, name): value for name, value in options.items()}
    allowed = {f.name for f in fields(convert.ImportOptions)} - {"channels", "segments"}
    unknown = sorted(set(given) - allowed)
    if unknown:
        raise ConfigurationError(
            "no such option of an import", where=unknown[0], limit=", ".join(sorted(allowed))
        )
    mapped, segments = convert.read_channel_map(Path(map_file)) if map_file else ((), ())
    if "gear" in given:
        given["gear"] = gear(given["gear"])
    named = tuple(convert.parse_channel(f"{name}={text}") for name, text in channels.items())
    rest = tuple(source for source in mapped if source.name not in channels)
    return convert.ImportOptions(channels=(*rest, *named), segments=segments, **given)


def _in_memory(recording: Recording) -> Recording:
    """The recording with its rows in memory: it is no file any more, and has no hash of one."""
    rows = recording.rows
    arrays = {name: recording.stored(name) for name in recording.signals}
    source = ArraySource(arrays, recording.source.time_ns(0, rows), recording.flags())
    metadata = replace(recording.metadata, sha256="", is_sealed=False)
    return replace(recording, metadata=metadata, source=source)
