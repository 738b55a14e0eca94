"""What has to be said of a recording of another rig before it can be imported: channels, segments, and the rest."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.recording import TimeBase
from model.gear import HarmonicDrive, Mounting
from rig.errors import ConfigurationError
from rig.runfile.importing.units import ChannelSource

_MAP_KEYS = {"column", "unit", "scale", "offset", "modulus", "long_name"}


@dataclass(frozen=True)
class ForeignSegment:
    """A labelled interval of a foreign recording: [start, stop) in seconds since its first row."""

    label: str
    start: float
    stop: float
    setpoint: float = 0.0
    direction: int = 0
    repeat: int = 0


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """What the file does not say of itself. `rate` [Hz] stands for a time column that is not there."""

    channels: tuple[ChannelSource, ...]
    rate: float | None = None
    no_time: bool = False
    time_base: TimeBase = "device"
    start_time: str = ""
    drop_bad_rows: bool = False
    torque_constant: float | None = None
    segments: tuple[ForeignSegment, ...] = ()
    delimiter: str = ""
    decimal: str = ""
    experiment: str = ""
    title: str = ""
    operator: str = ""
    gear: HarmonicDrive | None = None
    gear_serial: str = ""
    ratio: float = math.nan
    mounting: Mounting = "circular-spline-fixed"
    output_sense: int = 0
    """+1 or -1; 0 takes it from the mounting."""
    conditions: Mapping[str, Any] = field(default_factory=dict)


def read_channel_map(path: Path) -> tuple[tuple[ChannelSource, ...], tuple[ForeignSegment, ...]]:
    """The channels and segments of a map file (TOML): `[channels.<name>]` with column, unit, scale; `[[segments]]`."""
    where = str(path)
    try:
        content = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise ConfigurationError(
            f"cannot be read: {error.strerror or error}", where=where
        ) from error
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(
            f"is not valid TOML: {error}", where=where, remedy="Correct the line."
        ) from error
    unknown = set(content) - {"channels", "segments"}
    if unknown or not isinstance(content.get("channels"), dict):
        raise ConfigurationError(
            "is not a channel map",
            where=where,
            value=", ".join(sorted(unknown)) or "no [channels.<name>]",
            limit="[channels.<name>] with column, unit, scale; [[segments]]",
        )
    channels = []
    for name, entry in content["channels"].items():
        entry = _entry(
            entry,
            _MAP_KEYS,
            f"{where}: channels.{name}",
            texts=("unit", "long_name"),
            either=("column",),
        )
        if "column" not in entry:
            raise ConfigurationError("is missing", where=f"{where}: channels.{name}.column")
        channels.append(ChannelSource(name=name, **{**entry, "column": str(entry["column"])}))
    segments = []
    listed = content.get("segments", [])
    for index, entry in enumerate(listed if isinstance(listed, list) else [listed]):
        keys = set(ForeignSegment.__dataclass_fields__)
        entry = _entry(entry, keys, f"{where}: segments[{index}]", texts=("label",))
        if not {"label", "start", "stop"} <= set(entry):
            raise ConfigurationError(
                "needs label, start and stop", where=f"{where}: segments[{index}]"
            )
        whole = {key: int(entry[key]) for key in ("direction", "repeat") if key in entry}
        segments.append(ForeignSegment(**{**entry, **whole}))
    return tuple(channels), tuple(segments)


def _entry(
    entry: object,
    keys: set[str],
    where: str,
    texts: tuple[str, ...] = (),
    either: tuple[str, ...] = (),
) -> dict[str, Any]:
    """A table of a map file with known keys, numbers and texts."""
    if not isinstance(entry, dict):
        raise ConfigurationError("is not a table", where=where, limit=", ".join(sorted(keys)))
    for key, value in entry.items():
        if key not in keys:
            raise ConfigurationError(
                "no such key", where=f"{where}.{key}", limit=", ".join(sorted(keys))
            )
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (
            isinstance(value, str)
            if key in texts
            else number or (key in either and isinstance(value, str))
        ):
            limit = "text" if key in texts else "a number"
            raise ConfigurationError(
                "is of the wrong kind", where=f"{where}.{key}", value=repr(value), limit=limit
            )
    return entry
