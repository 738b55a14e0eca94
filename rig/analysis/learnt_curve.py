"""The curve of a bench's output encoder that was learnt from gears: where it lies, and for which run it is.

It is a certificate as a laboratory's (`rig.bench.config`), sealed, beside the runs or one folder above. A run of that
bench and encoder that has no curve of its own gets it; a run of a gear that taught it gets what the other gears teach.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.recording import Recording, RunMetadata
from model.channel import Channel
from rig.analysis.causes import simulated_bench
from rig.errors import RunFileError
from rig.runfile.read import close_recording, open_run
from rig.runfile.sealed import read_sealed

if TYPE_CHECKING:
    from rig.bench.config.certificate_file import CertificateFile

CHANNEL, PREFIX = "output_angle", "learnt-output-encoder"


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
    """Where learnt curves lie: beside the runs, or one folder above where the days of a bench have folders of their
    own.
    """
    return [path for one in (folder, folder.parent) for path in _learnt_in(one, _changed(one))]


def _changed(folder: Path) -> int:
    """When something was added to a folder or taken away, ns; 0 of one that is not there."""
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return 0


@functools.lru_cache(maxsize=64)
def _learnt_in(folder: Path, _changed_at: int) -> tuple[Path, ...]:
    """Looked for once in a folder that stays as it is: a list of runs asks for each of them."""
    return tuple(sorted(folder.glob(f"{PREFIX}*.csv")))


def learnt_files(folder: Path) -> list[CertificateFile]:
    """The learnt curves for the runs of a folder, the newest first; one that was altered is refused by name."""
    paths = learnt_paths(folder)
    if not paths:
        return []
    # Few folders have any, and what reads a description takes as long as a list of runs.
    from rig.bench.config.certificate_file import certificate_from

    found: list[CertificateFile] = []
    for path in paths:
        data, _ = read_sealed(path)
        try:
            found.append(certificate_from(path.name, data))
        except ValueError as error:
            raise RunFileError("is no certificate", where=str(path), value=str(error)) from error
    return sorted(found, key=lambda one: one.header.date, reverse=True)


def with_learnt_curve(recording: Recording, folder: Path) -> Recording:
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
        due = header.due is not None and metadata.start_time[:10] > header.due.isoformat()
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
        # Which file it was stands in whatever rests on it.
        named = f"{header.certificate}; {file.path}, SHA-256 {sha256(file.content).hexdigest()}"
        calibration = replace(channel.calibration, curve=curve, certificate=named)
        signal = replace(channel, calibration=calibration)
        return replace(recording, signals={**recording.signals, CHANNEL: signal})
    return recording


def learnt_name(run: Path) -> str:
    """What the learnt curve is called that an analysis of a run would take now; "" where it would take none."""
    if not learnt_paths(run.parent):
        return ""
    recording = open_run(run, rows=False)
    try:
        channel = with_learnt_curve(recording, run.parent).signals.get(CHANNEL)
        own = recording.signals.get(CHANNEL)
    finally:
        close_recording(recording)
    if channel is None or own is None or channel.calibration == own.calibration:
        return ""
    return channel.calibration.certificate
