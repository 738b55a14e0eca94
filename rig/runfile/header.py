"""What is known of a run when it begins: written once, before the first row; read back as `RunMetadata`."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, cast, get_args

import h5py
import numpy as np

from drivers.channel import Calibration, Channel
from experiments.recording import Origin, RunMetadata, TimeBase
from model.angle_certificate import AngleCertificate
from model.errors import ModelError
from model.gear import HarmonicDrive, Mounting
from model.gear_file import gear_from_mapping, gear_to_mapping, gear_to_toml
from rig.errors import RunFileError
from rig.program import PROGRAM_KEYS
from rig.runfile import layout
from rig.runfile.closing import ACQUISITION, Closing, create_closing, read_closing
from rig.runfile.layout import Column
from rig.runfile.seal import Seal

ORIGIN_WORDS = {
    "simulated": "SIMULATED",
    "replay": "REPLAY",
    "imported": "IMPORTED",
    "hardware": "",
}
"""The word that every plot, report and export of a run carries that is not from hardware."""

_TEXTS = ("certificate", "date", "due", "sensor", "laboratory")
_NUMBERS = ("scale_relative_uncertainty", "offset_uncertainty", "accuracy")


@dataclass(frozen=True)
class RunHeader:
    """Everything of a run that is known before its first row.

    `metadata` without outcome, end time and hash; `columns` the channels in the order of the
    blocks; `limits` of the rig and the protocol; `devices` by name; `truth` what a simulated rig
    knows of itself; `epoch_ns` the calendar time [ns since 1970 UTC] of a time stamp of zero (0:
    the stamps are calendar times already).
    """

    metadata: RunMetadata
    columns: tuple[Column, ...]
    limits: Mapping[str, Any] = field(default_factory=dict)
    devices: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    truth: Mapping[str, Any] | None = None
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        names = [column.name for column in self.columns]
        if not names or len(set(names)) != len(names):
            raise RunFileError(
                "a run needs channels, each once",
                where=self.metadata.run_id,
                value=", ".join(names) or "none",
            )


def iso_time(calendar_ns: int) -> str:
    """Calendar nanoseconds as ISO 8601 with the zone."""
    seconds, rest = divmod(calendar_ns, 1_000_000_000)
    moment = datetime.fromtimestamp(seconds, UTC) + timedelta(microseconds=rest // 1000)
    return moment.isoformat(timespec="milliseconds")


def write_header(file: h5py.File, header: RunHeader) -> None:
    """Create the groups that describe the run, and the fields that are rewritten at its end."""
    metadata = header.metadata
    layout.create_root(file)
    entry = layout.create_group(file, layout.ENTRY, "NXentry")
    entry.attrs["default"] = layout.text_attribute("data")
    for name, text in (
        ("run_id", metadata.run_id),
        ("title", metadata.title),
        ("start_time", metadata.start_time),
    ):
        layout.create_field(entry, name, text)
    user = layout.create_group(file, layout.USER, "NXuser")
    layout.create_field(user, "name", metadata.operator)
    _write_sample(file, metadata)
    _write_instrument(file, header)
    process = layout.create_group(file, layout.PROCESS, "NXprocess")
    origin = {
        "origin": metadata.origin,
        "origin_mark": ORIGIN_WORDS[metadata.origin],
        "time_base": metadata.time_base,
    }
    for name, text in {
        "program": "harmonic-rig",
        "experiment": metadata.experiment,
        **origin,
    }.items():
        layout.create_field(process, name, text)
    layout.create_field(process, "sample_rate", float(metadata.sample_rate), "Hz")
    for name in ("backend", "seed", *PROGRAM_KEYS):
        if name in metadata.process:
            layout.create_field(process, name, str(metadata.process[name]))
    layout.create_field(process, "parameters", layout.to_json(metadata.parameters))
    layout.create_field(process, "limits", layout.to_json(header.limits))
    layout.create_field(process, "details", layout.to_json(metadata.process))
    if header.truth is not None:
        layout.create_field(process, "truth", layout.to_json(header.truth))
    layout.create_field(process, "epoch", int(header.epoch_ns), "ns")
    create_closing(file, Closing(metadata.end_time, metadata.outcome))
    layout.create_changing_field(process, "rows_written", 0)
    layout.create_changing_field(process, "rows_dropped", 0)


def _write_sample(file: h5py.File, metadata: RunMetadata) -> None:
    sample = layout.create_group(file, layout.SAMPLE, "NXsample")
    gear = metadata.gear
    texts = {
        "name": gear_name(metadata),
        "part_number": gear_name(metadata),
        "serial_number": metadata.gear_serial,
        "mounting": metadata.mounting,
    }
    for name in ("lubricant", "hours"):
        if name in metadata.conditions:
            texts[name] = str(metadata.conditions[name])
    for name, text in texts.items():
        layout.create_field(sample, name, text)
    layout.create_field(sample, "ratio", float(metadata.ratio))
    layout.create_field(sample, "output_sense", int(metadata.output_sense))
    layout.create_field(sample, "gear_mounted", bool(metadata.gear_mounted))
    layout.create_field(sample, "conditions", layout.to_json(metadata.conditions))
    if gear is not None:
        layout.create_field(sample, "gear_parameters", layout.to_json(gear_to_mapping(gear)))
        layout.create_field(sample, "gear_parameters_toml", gear_to_toml(gear))


def gear_name(metadata: RunMetadata) -> str:
    """What the gear of a run is called; "" where nobody said which one it is."""
    return metadata.gear.name if metadata.gear else ""


def _write_instrument(file: h5py.File, header: RunHeader) -> None:
    instrument = layout.create_group(file, layout.INSTRUMENT, "NXinstrument")
    layout.create_field(instrument, "devices", layout.to_json(header.devices))
    for channel in (column.channel for column in header.columns):
        group = layout.create_group(file, f"{layout.INSTRUMENT}/{channel.name}", "NXdetector")
        for name in ("model", "serial_number"):
            layout.create_field(group, name, getattr(channel, name))
        for name in ("lines", "multiplication", "modulus"):
            layout.create_field(group, name, int(getattr(channel, name)))
        layout.create_field(group, "counts_per_revolution", channel.lines * channel.multiplication)
        if channel.acquired != "latched":
            layout.create_field(group, "acquired", channel.acquired)
        layout.create_field(group, "quantum", float(channel.quantum), channel.unit)
        calibration = layout.create_group(file, f"{group.name}/calibration", "NXcollection")
        layout.create_field(calibration, "scale", float(channel.gain), f"{channel.unit}/count")
        layout.create_field(calibration, "offset", float(channel.offset), channel.unit)
        for name in _TEXTS:
            layout.create_field(calibration, name, getattr(channel.calibration, name))
        for name in _NUMBERS:
            stated = getattr(channel.calibration, name)
            if stated is not None:
                layout.create_field(calibration, name, float(stated))
        if channel.calibration.curve is not None:
            curve = layout.to_json(dataclasses.asdict(channel.calibration.curve))
            layout.create_field(calibration, "curve", curve)


def read_columns(file: h5py.File) -> tuple[Column, ...]:
    """The channels of a run in the order they were recorded."""
    data = _group(file, layout.DATA)
    names = [_attribute(data, "signal"), *_names(data.attrs.get("auxiliary_signals", ()))]
    return tuple(_read_column(file, data, name) for name in names)


def read_metadata(file: h5py.File, seal: Seal = Seal()) -> RunMetadata:
    """Who, what, when and on what; the truth of a simulated rig, if there is one, stands in
    `process["truth"]`, the figures of
    the acquisition, known at the end of a run, in `process["acquisition"]`."""
    entry, user = _group(file, layout.ENTRY), _group(file, layout.USER)
    sample, process = _group(file, layout.SAMPLE), _group(file, layout.PROCESS)
    origin, time_base = layout.read_text(process, "origin"), layout.read_text(process, "time_base")
    mounting = layout.read_text(sample, "mounting")
    _one_of(origin, get_args(Origin), f"{process.name}/origin")
    _one_of(time_base, get_args(TimeBase), f"{process.name}/time_base")
    _one_of(mounting, get_args(Mounting), f"{sample.name}/mounting")
    output_sense = int(layout.read_number(sample, "output_sense", 0))
    if output_sense not in (-1, 1):
        raise RunFileError(
            "is no sense of rotation", where=f"{sample.name}/output_sense", value=output_sense
        )
    closing = read_closing(file)
    details = _mapping(process, "details")
    if "truth" in process:
        details["truth"] = _mapping(process, "truth")
    if closing.acquisition:
        details[ACQUISITION] = _mapping(process, ACQUISITION)
    return RunMetadata(
        run_id=layout.read_text(entry, "run_id"),
        experiment=layout.read_text(process, "experiment"),
        origin=cast(Origin, origin),
        title=layout.read_text(entry, "title"),
        outcome=closing.outcome,
        start_time=layout.read_text(entry, "start_time"),
        end_time=closing.end_time,
        operator=layout.read_text(user, "name"),
        gear=_read_gear(sample),
        gear_serial=layout.read_text(sample, "serial_number"),
        ratio=layout.read_number(sample, "ratio", math.nan),
        mounting=cast(Mounting, mounting),
        output_sense=output_sense,
        gear_mounted=bool(layout.read_number(sample, "gear_mounted", 1)),
        sample_rate=layout.read_number(process, "sample_rate", math.nan),
        time_base=cast(TimeBase, time_base),
        parameters=_mapping(process, "parameters"),
        conditions=_mapping(sample, "conditions"),
        process=details,
        limits=_mapping(process, "limits"),
        sha256=seal.sha256,
        is_sealed=seal.is_whole,
    )


def read_header(file: h5py.File) -> RunHeader:
    """The header that a run was begun with: for a copy, and for replaying it."""
    process = _group(file, layout.PROCESS)
    metadata = read_metadata(file)
    details = {
        name: value
        for name, value in metadata.process.items()
        if name not in ("truth", ACQUISITION)
    }
    return RunHeader(
        metadata=dataclasses.replace(metadata, process=details),
        columns=read_columns(file),
        limits=_mapping(process, "limits"),
        devices=_mapping(_group(file, layout.INSTRUMENT), "devices"),
        truth=_mapping(process, "truth") if "truth" in process else None,
        epoch_ns=int(layout.read_number(process, "epoch", 0)),
    )


def rows_flushed(file: h5py.File) -> int:
    """Rows that the latest complete flush brought into a file that is not sealed; without limit for a sealed one."""
    if not file.swmr_mode:
        return sys.maxsize
    process = _group(file, layout.PROCESS)
    counter = process["rows_written"]
    assert isinstance(counter, h5py.Dataset)
    counter.refresh()
    return int(layout.read_number(process, "rows_written", 0))


def check_format(file: h5py.File) -> None:
    """Raise `RunFileError` unless the file says that it is a run of a version that can be read."""
    file_format = file.attrs.get("file_format")
    if file_format is None or _decoded(file_format) != layout.FILE_FORMAT:
        raise RunFileError(
            "is an HDF5 file but not a run",
            limit=f'file_format "{layout.FILE_FORMAT}"',
            remedy="Import a recording of another rig with `rig import`.",
        )
    version = _decoded(file.attrs.get("file_format_version", b""))
    if version.partition(".")[0] != layout.FILE_FORMAT_VERSION.partition(".")[0]:
        raise RunFileError(
            "has a format version that this program does not read",
            value=version,
            limit=layout.FILE_FORMAT_VERSION,
            remedy="Use the program version that wrote it.",
        )


def _read_gear(sample: h5py.Group) -> HarmonicDrive | None:
    text = layout.read_text(sample, "gear_parameters")
    if not text:
        return None
    where = f"{sample.name}/gear_parameters"
    try:
        return gear_from_mapping(layout.from_json(text, where), where)
    except ModelError as error:
        raise RunFileError(f"the gear of the run cannot be used: {error}") from error


def _read_column(file: h5py.File, data: h5py.Group, name: str) -> Column:
    dataset = data[name]
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1:
        raise RunFileError("is not a channel", where=f"{data.name}/{name}")
    dtype = {"i8": "int64", "i4": "int32", "f8": "float64"}.get(dataset.dtype.str[1:])
    if dtype is None:
        raise RunFileError(
            "has a type that is no channel's", where=f"{data.name}/{name}", value=str(dataset.dtype)
        )
    device = _group(file, f"{layout.INSTRUMENT}/{name}")
    stored = _group(file, f"{layout.INSTRUMENT}/{name}/calibration")
    calibration: dict[str, Any] = {key: layout.read_text(stored, key) for key in _TEXTS}
    calibration |= _calibration_numbers(
        stored, zero_is_said=_says_zero(file, calibration["certificate"])
    )
    calibration["curve"] = _read_curve(stored)
    gain = layout.number_attribute(dataset, "scale_factor")
    offset = layout.number_attribute(dataset, "add_offset")
    if not (math.isfinite(gain) and math.isfinite(offset) and gain != 0.0):
        raise RunFileError(
            "has no usable calibration", where=f"{data.name}/{name}", value=f"{gain}, {offset}"
        )
    channel = Channel(
        name=name,
        unit=_attribute(dataset, "units"),
        scale=abs(gain),
        direction=int(math.copysign(1.0, gain)),
        offset=offset,
        is_counted=layout.read_number(device, "quantum", 0.0) > 0.0,
        modulus=int(layout.read_number(device, "modulus", 0)),
        long_name=_attribute(dataset, "long_name"),
        model=layout.read_text(device, "model"),
        serial_number=layout.read_text(device, "serial_number"),
        lines=int(layout.read_number(device, "lines", 0)),
        multiplication=int(layout.read_number(device, "multiplication", 0)),
        acquired="polled" if layout.read_text(device, "acquired") == "polled" else "latched",
        calibration=Calibration(**calibration),
    )
    return Column(channel, cast(Any, dtype))


def _says_zero(file: h5py.File, certificate: str) -> bool:
    """Whether a stored 0 of a calibration was stated: files before format 1.2 wrote 0 for what nobody said.

    There only a simulated instrument is known to say it.
    """
    version = _decoded(file.attrs.get("file_format_version", b"1.0")).split(".")
    return [int(part) for part in version] >= [1, 2] or certificate.startswith("simulated")


def _calibration_numbers(stored: h5py.Group, *, zero_is_said: bool) -> dict[str, float]:
    """The numbers of a calibration that somebody stated."""
    numbers = {key: layout.read_number(stored, key, math.nan) for key in _NUMBERS}
    return {
        key: number
        for key, number in numbers.items()
        if not math.isnan(number) and (number != 0.0 or zero_is_said)
    }


def _read_curve(calibration: h5py.Group) -> AngleCertificate | None:
    """The curve of an encoder's certificate, in rad; None where there is none."""
    text = layout.read_text(calibration, "curve")
    if not text:
        return None
    where = f"{calibration.name}/curve"
    try:
        content = layout.from_json(text, where)
        factor = float(content.pop("coverage_factor"))
        columns = {name: tuple(float(x) for x in column) for name, column in content.items()}
        return AngleCertificate(**columns, coverage_factor=factor)
    except (AttributeError, KeyError, TypeError, ValueError, ModelError) as error:
        raise RunFileError(
            f"the curve of the certificate cannot be used: {error}", where=where
        ) from error


def _group(file: h5py.File, path: str) -> h5py.Group:
    group = file.get(path)
    if not isinstance(group, h5py.Group):
        raise RunFileError("a group of the run is missing", where=path)
    return group


def _mapping(group: h5py.Group, name: str) -> dict[str, Any]:
    where = f"{group.name}/{name}"
    content = layout.from_json(layout.read_text(group, name) or "{}", where)
    if not isinstance(content, dict):
        raise RunFileError("is not a JSON object", where=where)
    return content


def _one_of(word: str, allowed: tuple[str, ...], where: str) -> None:
    if word not in allowed:
        raise RunFileError(
            "is not one of the words that a run knows",
            where=where,
            value=word,
            limit=", ".join(allowed),
        )


def _attribute(item: h5py.Group | h5py.Dataset, name: str) -> str:
    return _decoded(item.attrs[name])


def _names(stored: Any) -> list[str]:
    return [_decoded(name) for name in np.atleast_1d(np.asarray(stored))]


def _decoded(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
