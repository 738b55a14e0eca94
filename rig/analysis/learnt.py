"""What a bench learnt of its own instruments: where it lies, and for which run it is.

The curve of its output encoder is a certificate as a laboratory's (`rig.bench.config`), the scale of its torque
channels a file beside it, both sealed, beside the runs or one folder above. A run of that bench that has no curve of
its own gets the curve; a run of a gear that taught it gets what the other gears teach. The scale takes the place of
what the description states or nobody stated.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from experiments.budget import PAIR
from experiments.recording import Recording, RunMetadata
from model.channel import Channel
from rig.analysis.causes import simulated_bench
from rig.errors import RunFileError
from rig.runfile.read import close_recording, open_run
from rig.runfile.sealed import read_sealed

if TYPE_CHECKING:
    from rig.bench.config.certificate_file import CertificateFile
    from rig.bench.config.torque_scale_file import ChannelScale, TorqueScale, TorqueScaleFile

NONE = "none: "
"""How what vouches for a channel begins where no laboratory does."""
CHANNEL, PREFIX = "output_angle", "learnt-output-encoder"
SCALE_PREFIX = "learnt-torque-scale"
SCALE_KIND = "torque-scale"
"""The protocol from which a scale is learnt: it takes none."""
_PATTERNS = (f"{PREFIX}*.csv", f"{SCALE_PREFIX}*.toml")
_NAMED = re.compile(rf"((?:{PREFIX}|{SCALE_PREFIX})[^;,/]*), SHA-256 ([0-9a-f]{{64}})")
"""How an analysis names a file that it took."""
_OF_DAY = re.compile(r"\d{4}-\d\d-\d\d-(\d+)\.\w+$")
_File = TypeVar("_File")


def bench_of(metadata: RunMetadata) -> str:
    """The bench on which a run was made."""
    return simulated_bench(metadata) or str(metadata.process.get("bench", ""))


def is_known(metadata: RunMetadata, encoder: Channel) -> bool:
    """Whether bench and encoder are known by name: one without a serial number may be exchanged, and nobody sees it. A
    simulated bench has one encoder.
    """
    return bool(bench_of(metadata)) and (
        metadata.origin == "simulated" or bool(encoder.serial_number)
    )


def learnt_paths(folder: Path) -> list[Path]:
    """Where that which was learnt lies: beside the runs, or one folder above where the days of a bench have folders of
    their own.
    """
    return [
        path
        for one in (folder, folder.absolute().parent)
        for path in _learnt_in(one, _changed(one))
    ]


def _changed(folder: Path) -> int:
    """When something was added to a folder or taken away, ns; 0 of one that is not there."""
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return 0


@functools.lru_cache(maxsize=64)
def _learnt_in(folder: Path, _changed_at: int) -> tuple[Path, ...]:
    """Looked for once in a folder that stays as it is: a list of runs asks for each of them."""
    return tuple(path for pattern in _PATTERNS for path in sorted(folder.glob(pattern)))


def learnt_files(folder: Path) -> list[CertificateFile]:
    """The learnt curves for the runs of a folder, the newest first; one that was altered is refused by name."""
    paths = _named(folder, PREFIX)
    if not paths:
        return []
    # Few folders have any, and what reads a description takes as long as a list of runs.
    from rig.bench.config.certificate_file import certificate_from

    return sorted(
        _read(paths, certificate_from),
        key=lambda one: (one.header.date, _place_of_day(one.path)),
        reverse=True,
    )


def learnt_scales(folder: Path) -> list[TorqueScaleFile]:
    """The learnt torque scales for the runs of a folder, the newest first; one that was altered is refused by name."""
    paths = _named(folder, SCALE_PREFIX)
    if not paths:
        return []
    from rig.bench.config.torque_scale_file import torque_scale_from

    return sorted(
        _read(paths, torque_scale_from),
        key=lambda one: (one.scale.date, _place_of_day(one.path)),
        reverse=True,
    )


def free_name(folder: Path, name: str, suffix: str) -> Path:
    """A name for what is learnt that nothing has there: NAME, then NAME-2, NAME-3 of the same day."""
    numbers = itertools.chain([""], (f"-{number}" for number in itertools.count(2)))
    return next(
        path for number in numbers if not (path := folder / f"{name}{number}{suffix}").exists()
    )


def _place_of_day(name: str) -> int:
    """Which of the files of one day it is, by its name."""
    found = _OF_DAY.search(name)
    return int(found[1]) if found else 1


def _named(folder: Path, prefix: str) -> list[Path]:
    return [path for path in learnt_paths(folder) if path.name.startswith(prefix)]


def _read(paths: Sequence[Path], read: Callable[[str, bytes], _File]) -> list[_File]:
    found: list[_File] = []
    for path in paths:
        data, _ = read_sealed(path)
        try:
            found.append(read(path.name, data))
        except ValueError as error:
            raise RunFileError("is none", where=str(path), value=str(error)) from error
    return found


def with_learnt(recording: Recording, folder: Path, named: str | None = None) -> Recording:
    """The recording with what its bench learnt of the output encoder and of the torque; `named`: only by the files that
    an analysis names.
    """
    return with_learnt_scale(with_learnt_curve(recording, folder, named), folder, named)


def as_analysed(recording: Recording, folder: Path, options: Mapping[str, Any]) -> Recording:
    """The recording as an analysis with these options took it. Raises `RunFileError` where what it took of its bench is
    gone.
    """
    named = " ".join(str(options.get(option, "")) for option in ("certificates", "torque_scale"))
    taken = with_learnt(recording, folder, named)
    for prefix, channels in ((PREFIX, (CHANNEL,)), (SCALE_PREFIX, PAIR)):
        pairs = [(taken.signals.get(name), recording.signals.get(name)) for name in channels]
        if prefix in named and all(now is before for now, before in pairs):
            raise RunFileError(
                "rests on what its bench learnt, and that file is gone or another one",
                where=recording.metadata.run_id,
                value=next(word for word in named.split() if word.startswith(prefix)).rstrip(","),
            )
    return taken


def scale_of(recording: Recording) -> str:
    """What the torque scale of a recording is called that its bench learnt; "" where it is the stated one."""
    found = (recording.signals[name].calibration for name in PAIR if recording.has(name))
    return next((one.certificate for one in found if SCALE_PREFIX in one.certificate), "")


def learnt_by(folder: Path, options: Mapping[str, Any]) -> Iterator[tuple[Path, str]]:
    """The files that an analysis with these options took of what its bench learnt, each with the SHA-256 that it had;
    beside the runs of `folder`, where it is not there one folder above.
    """
    for option in ("certificates", "torque_scale"):
        for name, sha256_then in _NAMED.findall(str(options.get(option, ""))):
            here, there = folder / name, folder.absolute().parent / name
            yield here if here.is_file() or not there.is_file() else there, sha256_then


def vouchers(options: Mapping[str, Any]) -> dict[str, str]:
    """What vouches for the channels of an analysis with these options that its bench learnt, by channel: "none: ...",
    without the file, which the manifest names. Another encoder's certificate may stand before it.
    """
    found: dict[str, str] = {}
    for option, prefix, channels in (
        ("certificates", PREFIX, (CHANNEL,)),
        ("torque_scale", SCALE_PREFIX, PAIR),
    ):
        before, is_learnt, _ = str(options.get(option, "")).partition(f"; {prefix}")
        if is_learnt:
            found |= dict.fromkeys(channels, before[max(before.rfind(NONE), 0) :])
    return found


def with_learnt_scale(recording: Recording, folder: Path, named: str | None = None) -> Recording:
    """The recording with the torque scale that was learnt on its bench, where that is known better than the stated."""
    metadata = recording.metadata
    if metadata.experiment == SCALE_KIND or not bench_of(metadata):
        return recording
    for file in learnt_scales(folder):
        scale = file.scale
        is_its = (
            (scale.bench, scale.origin) == (bench_of(metadata), metadata.origin)
            and scale.motor == motor_of(metadata)
            and not _is_due(scale.due, metadata)
            and (named is None or _name_of(file) in named)
        )
        fitting = {
            one.name: scaled(recording.signals[one.name], one, scale, _name_of(file))
            for one in scale.channel
            if recording.has(one.name) and _is_better(recording.signals[one.name], one)
        }
        if is_its and fitting:
            return replace(recording, signals={**recording.signals, **fitting})
    return recording


def is_same(channel: Channel, scale: ChannelScale) -> bool:
    """Whether a channel is the one whose scale was learnt, as far as it has a name."""
    mine = (channel.model, channel.serial_number, channel.calibration.sensor)
    return mine == (scale.model, scale.serial_number, scale.sensor)


def _is_better(channel: Channel, scale: ChannelScale) -> bool:
    """Whether a channel's learnt scale is known better than the one that its description states."""
    stated = channel.calibration.scale_relative_uncertainty
    return is_same(channel, scale) and (stated is None or scale.relative_uncertainty < stated)


def motor_of(metadata: RunMetadata) -> str:
    """The motor of a run, by the name of its parameter set."""
    return str(metadata.process.get("motor", ""))


def scaled(channel: Channel, of_channel: ChannelScale, scale: TorqueScale, named: str) -> Channel:
    """A torque channel with its learnt scale."""
    calibration = replace(
        channel.calibration,
        certificate=named,
        date=scale.date.isoformat(),
        due="" if scale.due is None else scale.due.isoformat(),
        laboratory="",
        scale_relative_uncertainty=of_channel.relative_uncertainty,
        temperature=scale.housing_temperature,
        lag=of_channel.lag,
        lag_uncertainty=of_channel.lag_uncertainty,
    )
    return replace(
        channel,
        scale=channel.scale / of_channel.gain,
        offset=channel.offset / of_channel.gain,
        calibration=calibration,
    )


def _name_of(file: TorqueScaleFile) -> str:
    digest = sha256(file.content).hexdigest()
    return f"{file.scale.certificate}; {file.path}, SHA-256 {digest}"


def _is_due(due: date | None, metadata: RunMetadata) -> bool:
    return due is not None and metadata.start_time[:10] > due.isoformat()


def with_learnt_curve(recording: Recording, folder: Path, named: str | None = None) -> Recording:
    """The recording with the curve of its output encoder that was learnt on its bench, where it has none of its own.

    A run of a gear that taught the curve gets what the others teach, or nothing.
    """
    channel = recording.signals.get(CHANNEL)
    if channel is None or channel.calibration.curve is not None:
        return recording
    metadata = recording.metadata
    if not is_known(metadata, channel):
        return recording
    for file in learnt_files(folder):
        header = file.header
        # Which file it was stands in whatever rests on it.
        name = f"{header.certificate}; {file.path}, SHA-256 {sha256(file.content).hexdigest()}"
        if named is not None and name not in named:
            continue
        due = _is_due(header.due, metadata)
        if (
            header.bench != bench_of(metadata)
            or header.serial_number != channel.serial_number
            or due
        ):
            continue
        if metadata.gear_serial in header.without:
            curve = header.curve_without(metadata.gear_serial)
        else:
            curve = file.curve
        if curve is None:
            return recording
        calibration = replace(channel.calibration, curve=curve, certificate=name)
        signal = replace(channel, calibration=calibration)
        return replace(recording, signals={**recording.signals, CHANNEL: signal})
    return recording


def learnt_name(run: Path, channel: str = CHANNEL) -> str:
    """What that is called that an analysis of a run would take of what its bench learnt of a channel; "" where it would
    take nothing.
    """
    if not learnt_paths(run.parent):
        return ""
    recording = open_run(run, rows=False)
    try:
        now = with_learnt(recording, run.parent).signals.get(channel)
        own = recording.signals.get(channel)
    finally:
        close_recording(recording)
    if now is None or own is None or now.calibration == own.calibration:
        return ""
    return now.calibration.certificate
