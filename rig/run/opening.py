"""Begins the file of a run: its number, its header, its writer, and the recorder that belongs to the clock."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from drivers.port import RigDescription
from experiments.catalogue import extension_of
from experiments.recording import Origin, RunMetadata
from rig.library.folder import RunPlace, claim_run
from rig.program import extension_records, this_program
from rig.run.dry_run import vars_of
from rig.run.keeping import keep_files
from rig.run.parts import SessionParts
from rig.run.recorder import InlineRecorder, Recorder, ThreadedRecorder
from rig.run.session import output_sense
from rig.run.world import OUTPUT_BEARINGS
from rig.runfile.header import RunHeader
from rig.runfile.layout import Column
from rig.runfile.seal import part_path
from rig.runfile.write import RunWriter


@dataclass(frozen=True)
class BegunRun:
    """A run file that has been begun, and the recorder that fills it."""

    run_id: str
    writer: RunWriter
    recorder: Recorder

    @property
    def part(self) -> Path:
        """The file while it is written."""
        return self.writer.part

    @property
    def header(self) -> RunHeader:
        """What the file was begun with."""
        return self.writer.header

    def flush(self) -> None:
        """Bring everything so far into the file."""
        self.recorder.flush()


def begin_inline_run(
    parts: SessionParts, description: RigDescription, epoch_ns: int, start_time: str
) -> BegunRun:
    """Claim the next number in the order's folder and begin the file, written in the loop's own thread.

    Raises `RunFileError`.
    """
    with claimed(parts, start_time) as place:
        header = header_of(parts, description, place.run_id, epoch_ns, start_time)
        writer = RunWriter(place.path, header)
        return BegunRun(place.run_id, writer, InlineRecorder(writer))


def begin_threaded_run(
    parts: SessionParts, description: RigDescription, epoch_ns: int, start_time: str
) -> BegunRun:
    """As `begin_inline_run`, for a rig in real time: the disk never makes the loop late. Raises `RunFileError`."""
    with claimed(parts, start_time) as place:
        header = header_of(parts, description, place.run_id, epoch_ns, start_time)
        # Rows come a few at a time and each flush is short: chunks are compressed when the run is sealed.
        writer = RunWriter(place.path, header, compress=False)
        return BegunRun(
            place.run_id, writer, ThreadedRecorder(writer, 1e9 / parts.rig.port.cycle_ns)
        )


@contextlib.contextmanager
def claimed(parts: SessionParts, start_time: str) -> Generator[RunPlace, None, None]:
    """The next number in the order's folder, marked as running before there is a file.

    Raises `RigError`; nothing has moved, and no marker is left.
    """
    protocol = parts.planned.experiment.name
    place = parts.place or claim_run(parts.order.folder, protocol, parts.order.serial)
    if parts.marker is None:
        yield place
        return
    parts.marker.leave(place.run_id, protocol, start_time, part_path(place.path))
    try:
        yield place
    except BaseException:
        parts.marker.remove()
        raise


def _process_of(parts: SessionParts, description: RigDescription) -> dict[str, Any]:
    """What made the run: program, rig, bench and the files that describe them."""
    order, planned, world = parts.order, parts.planned, parts.rig.world
    process: dict[str, Any] = {
        "backend": parts.rig.name,
        "seed": order.seed,
        **this_program().as_json(),
        **extension_records((extension_of(planned.experiment.name), *parts.rig.extensions)),
        "rig": description.title,
        "motor": planned.motor.name,
        "motor_friction": planned.motor.stated_friction(),
        "planned_duration": planned.nominal,
    }
    if mode := description.devices.get("servo amplifier", {}).get("speed_mode", ""):
        process["speed_mode"] = mode.lower().replace("_", " ")
    if parts.bench:
        process["bench"] = parts.bench
    if order.output_bearing:
        process["output_bearing"] = dict(order.output_bearing)
    if parts.files:
        process["files"] = keep_files(parts.files, order.folder)
    if world:
        process["world"] = world
        process["output_bearing"] = OUTPUT_BEARINGS[world["population"]]
    return process


def header_of(
    parts: SessionParts, description: RigDescription, run_id: str, epoch_ns: int, start_time: str
) -> RunHeader:
    """Everything of a run that is known before its first row."""
    order, planned = parts.order, parts.planned
    run = RunMetadata(
        run_id=run_id,
        experiment=planned.experiment.name,
        origin=cast(Origin, description.origin),
        title=planned.experiment.title,
        start_time=start_time,
        operator=order.operator,
        gear=planned.gear,
        gear_serial=order.serial,
        ratio=planned.gear.mounted_ratio(planned.mounting),
        mounting=planned.mounting,
        output_sense=output_sense(planned.mounting),
        gear_mounted=planned.experiment.gear_mounted,
        sample_rate=1e9 / parts.rig.port.cycle_ns,
        time_base=parts.rig.port.time_base,
        parameters=vars_of(planned.parameters),
        conditions=dict(order.conditions),
        process=_process_of(parts, description),
    )
    columns = tuple(Column.of(channel) for channel in parts.rig.port.channels)
    return RunHeader(
        metadata=run,
        columns=columns,
        limits=planned.limits.as_json(),
        devices=description.devices,
        truth=description.truth,
        epoch_ns=epoch_ns,
    )
