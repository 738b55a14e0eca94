"""What has to be said of a recording of another rig before it can be imported: channels, segments, and the rest."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from experiments.recording import TimeBase
from model.gear import HarmonicDrive, Mounting
from rig.errors import ConfigurationError
from rig.runfile.importing.adapters.text_form import TextForm, is_named
from rig.runfile.importing.channel_source import ChannelSource
from rig.runfile.importing.map_keys import (
    CHANNEL_KEYS,
    CONDITIONS,
    FILE_KEYS,
    GEAR_KEYS,
    PYTHON_KINDS,
    RECORDING_KEYS,
    RUNS,
    SEGMENT_KEYS,
    SEGMENTS_FROM_KEYS,
    TABLES,
    Key,
)


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
class SegmentsFrom:
    """Where segments come from: a column that labels the rows, or a channel of set-points."""

    column: str = ""
    file: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    setpoint: str = ""
    label: str = "traverse"
    least_s: float = 0.5


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """What the file does not say of itself. `rate` [Hz] stands for a time column that is not there.

    NaN, 0 and "" stand for what nobody said; what is said of the device is stated in the run.
    """

    channels: tuple[ChannelSource, ...]
    reverse: tuple[ChannelSource, ...] = ()
    """The same channels for the reverse half of a table with both directions in one row."""
    rate: float | None = None
    speed: str | float = ""
    """Constant speed of the input, where a log at constant speed has no angle: a text with its unit, or in rad/s."""
    no_time: bool = False
    time_base: TimeBase | None = None
    """What stamped the rows; None: a device where there are times, the nominal rate where there is only that."""
    start_time: str = ""
    drop_bad_rows: bool = False
    torque_constant: float | None = None
    segments: tuple[ForeignSegment, ...] = ()
    segments_from: SegmentsFrom | None = None
    delimiter: str = ""
    decimal: str = ""
    skip: int = 0
    header: int = 0
    is_ragged: bool = False
    interpolate: bool = False
    gap: float = 1.5
    """A step of the time that is longer than so many usual ones is a gap: nothing is interpolated across it."""
    allow_jumps: bool = False
    ignore_headings: bool = False
    files: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Of single files of the run, by name, stem or number: what of the form and of `time_unit` is theirs alone."""
    experiment: str = ""
    title: str = ""
    operator: str = ""
    gear: HarmonicDrive | None = None
    gear_file: Path | None = None
    """Where `gear` was read from."""
    gear_serial: str = ""
    gear_mounted: bool = True
    ratio: float = math.nan
    mounting: Mounting | None = None
    output_sense: int = 0
    """+1 or -1: whether the output angle counts with or against the input; 0: nobody said it."""
    resonance_hz: float | None = None
    load_inertia_kg_m2: float | None = None
    conditions: Mapping[str, Any] = field(default_factory=dict)
    proposed: tuple[str, ...] = ()
    """What the program proposed of the columns, with its evidence; `accepted_by` is who took it over."""
    accepted_by: str = ""

    @property
    def known_mounting(self) -> Mounting:
        """How the gear is mounted; the usual way where nobody said it."""
        return self.mounting or "circular-spline-fixed"

    @property
    def known_ratio(self) -> float:
        """The ratio that was said, else that of the gear as it is mounted; NaN where there is neither."""
        if math.isfinite(self.ratio) or self.gear is None:
            return self.ratio
        return self.gear.mounted_ratio(self.known_mounting)

    def said_of(self, path: Path, number: int) -> Mapping[str, Any]:
        """What is said of one file of the run alone, the `number`th."""
        return next((said for name, said in self.files.items() if is_named(path, number, name)), {})

    def form_of(self, path: Path, number: int) -> TextForm:
        """What is said of the form of a text file, the `number`th of the run."""
        common = {name: getattr(self, name) for name in _FORM}
        own = {k: v for k, v in self.said_of(path, number).items() if k in _FORM}
        return TextForm(**{**common, **own})


_FORM = tuple(one.name for one in fields(TextForm))


@dataclass(frozen=True)
class RunMap:
    """What a map says of one run: its name ("" where the file is one run), and the options that it fills in."""

    name: str
    values: Mapping[str, Any]

    @property
    def channels(self) -> tuple[ChannelSource, ...]:
        """The channels of the run."""
        return self.values.get("channels", ())

    def options(self, given: Mapping[str, Any]) -> ImportOptions:
        """The options of the run; what was given beside the map goes before it, channel by channel."""
        values = {**self.values, **given}
        mine = {source.name for source in given.get("channels", ())}
        others = (source for source in self.channels if source.name not in mine)
        values["channels"] = (*others, *given.get("channels", ()))
        conditions = {**self.values.get(CONDITIONS, {}), **given.get(CONDITIONS, {})}
        return ImportOptions(**{**values, CONDITIONS: conditions})


def read_channel_map(path: Path) -> tuple[RunMap, ...]:
    """The runs of a map file (TOML): one, or one for each `[runs.NAME]`. Raises `ConfigurationError`."""
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
    runs = content.pop(RUNS, {})
    if not isinstance(runs, dict) or not all(isinstance(run, dict) for run in runs.values()):
        raise ConfigurationError("is no table of maps", where=f"{where}: {RUNS}")
    if not runs:
        return (RunMap("", _values(content, where, needs_channels=True)),)
    common = _values(content, where, needs_channels=False)
    maps = []
    for name, run in runs.items():
        own = _values(run, f"{where}: {RUNS}.{name}", needs_channels="channels" not in common)
        mine = {source.name for source in own.get("channels", ())}
        others = tuple(s for s in common.get("channels", ()) if s.name not in mine)
        channels = (*others, *own.get("channels", ()))
        maps.append(RunMap(name, {**common, **own, "channels": channels}))
    return tuple(maps)


def _values(content: dict[str, Any], where: str, *, needs_channels: bool) -> dict[str, Any]:
    """The options that the tables of a map fill in."""
    unknown = set(content) - set(TABLES) - {CONDITIONS}
    if unknown or (needs_channels and not isinstance(content.get("channels"), dict)):
        raise ConfigurationError(
            "is not a channel map",
            where=where,
            value=", ".join(sorted(unknown)) or "no [channels.<name>]",
            limit=f"[channels.<name>] with column, unit, scale; {', '.join(TABLES)}, {CONDITIONS}, {RUNS}",
        )
    values: dict[str, Any] = {}
    for table in ("channels", "reverse"):
        if table in content:
            values[table] = _sources(content[table], f"{where}: {table}")
    if "segments" in content:
        values["segments"] = _segments(content["segments"], where)
    if "segments_from" in content:
        values["segments_from"] = _segments_from(content["segments_from"], where)
    for table, keys in (("recording", RECORDING_KEYS), ("gear", GEAR_KEYS)):
        entry = _entry(content.get(table, {}), keys, f"{where}: {table}")
        fields = {key.name: key.field for key in keys}
        values |= {fields[name]: value for name, value in entry.items()}
    if "files" in content:
        values["files"] = _files(content["files"], f"{where}: files")
    if CONDITIONS in content:
        values[CONDITIONS] = _conditions(content[CONDITIONS], f"{where}: {CONDITIONS}")
    return values


def _sources(content: object, where: str) -> tuple[ChannelSource, ...]:
    if not isinstance(content, dict):
        raise ConfigurationError("is not a table of channels", where=where)
    sources = []
    for name, entry in content.items():
        checked = _entry(entry, CHANNEL_KEYS, f"{where}.{name}")
        texts = {key: str(checked[key]) for key in ("column", "time") if key in checked}
        sources.append(ChannelSource(name=name, **{**checked, **texts}))
    return tuple(sources)


def _files(content: object, where: str) -> dict[str, dict[str, Any]]:
    if not isinstance(content, dict):
        raise ConfigurationError("is not a table of files", where=where)
    by_key = {key.name: key.field for key in FILE_KEYS}
    entries = {name: _entry(one, FILE_KEYS, f"{where}.{name}") for name, one in content.items()}
    return {
        name: {by_key[key]: value for key, value in entry.items()}
        for name, entry in entries.items()
    }


def _segments(listed: object, where: str) -> tuple[ForeignSegment, ...]:
    entries = listed if isinstance(listed, list) else [listed]
    return tuple(
        ForeignSegment(**_entry(entry, SEGMENT_KEYS, f"{where}: segments[{index}]"))
        for index, entry in enumerate(entries)
    )


def _segments_from(entry: object, where: str) -> SegmentsFrom:
    where = f"{where}: segments_from"
    labels: object = {}
    if isinstance(entry, dict):
        entry = dict(entry)
        labels = entry.pop("labels", labels)
    if not isinstance(labels, dict) or not all(isinstance(x, str) for x in labels.values()):
        raise ConfigurationError("is no table of labels", where=f"{where}.labels")
    checked = _entry(entry, SEGMENTS_FROM_KEYS, where)
    if ("column" in checked) == ("setpoint" in checked):
        raise ConfigurationError("needs one of column and setpoint", where=where)
    if "column" in checked:
        checked["column"] = str(checked["column"])
    return SegmentsFrom(**checked, labels=labels)


def _conditions(content: object, where: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ConfigurationError("is not a table", where=where)
    for key, value in content.items():
        if not isinstance(value, (str, int, float)):
            raise ConfigurationError(
                "is of the wrong kind",
                where=f"{where}.{key}",
                value=repr(value),
                limit="a text, a number",
            )
    return dict(content)


def _entry(entry: object, keys: tuple[Key, ...], where: str) -> dict[str, Any]:
    """A table of a map file with known keys of the right kinds, the needed ones among them."""
    known = {key.name: key for key in keys}
    if not isinstance(entry, dict):
        raise ConfigurationError("is not a table", where=where, limit=", ".join(known))
    for name, value in entry.items():
        if name not in known:
            raise ConfigurationError("no such key", where=f"{where}.{name}", limit=", ".join(known))
        kind = known[name].kind
        if not isinstance(value, PYTHON_KINDS[kind]) or (
            isinstance(value, bool) and kind != "yes or no"
        ):
            raise ConfigurationError(
                "is of the wrong kind", where=f"{where}.{name}", value=repr(value), limit=kind
            )
    missing = [key.name for key in keys if key.is_needed and key.name not in entry]
    if missing:
        raise ConfigurationError("is missing", where=f"{where}.{missing[0]}")
    return dict(entry)


def check_said(options: ImportOptions) -> None:
    """Raise `ConfigurationError` for options that no recording can have."""
    for name, value in (
        ("--ratio", None if math.isnan(options.ratio) else options.ratio),
        ("--torque-constant", options.torque_constant),
        ("--resonance-hz", options.resonance_hz),
        ("--load-inertia", options.load_inertia_kg_m2),
    ):
        if value is not None and not (math.isfinite(value) and value != 0.0):
            raise ConfigurationError(
                "is not usable", where=name, value=value, limit="a finite number that is not 0"
            )
    for name, value in (
        ("--resonance-hz", options.resonance_hz),
        ("--load-inertia", options.load_inertia_kg_m2),
    ):
        if value is not None and value < 0.0:
            raise ConfigurationError("is negative", where=name, value=value, limit="> 0")
    if options.output_sense not in (-1, 0, 1):
        raise ConfigurationError(
            "is no sense of rotation",
            where="--output-sense",
            value=options.output_sense,
            limit="+1, -1",
        )
    if options.time_base not in (None, "hardware", "device", "host", "nominal"):
        raise ConfigurationError(
            "is no time base",
            where="--time-base",
            value=options.time_base,
            limit="hardware, device, host, nominal",
        )
    if options.mounting not in (None, "circular-spline-fixed", "flexspline-fixed"):
        raise ConfigurationError(
            "is no mounting",
            where="--mounting",
            value=options.mounting,
            limit="circular-spline-fixed, flexspline-fixed",
        )
    if not options.gap > 1.0:
        raise ConfigurationError(
            "is no length of a gap",
            where="--gap",
            value=options.gap,
            limit="> 1 usual step of the time",
        )
    if options.skip < 0 or options.header < 0:
        raise ConfigurationError("is negative", where="--skip, --header", limit=">= 0")
