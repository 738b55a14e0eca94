"""Runs made for tests: a rig's channels, blocks whose every value can be recomputed, and finished files."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from drivers.channel import Calibration, Channel, encoder_channel
from drivers.samples import SampleBlock
from experiments.recording import Event, RunMetadata, Segment
from model.gear_file import shipped_gear
from rig.runfile.header import RunHeader
from rig.runfile.layout import Column
from rig.runfile.seal import file_sha256, hash_path
from rig.runfile.write import RunWriter

EPOCH_NS = 1_763_700_000_000_000_000
CYCLE_NS = 1_000_000
CALIBRATION = Calibration(
    certificate="PTB-17",
    date="2025-02-03",
    due="2027-02-03",
    sensor="reaction torque cell",
    scale_relative_uncertainty=1e-3,
    offset_uncertainty=2e-4,
    accuracy=5e-6,
)
CHANNELS = (
    encoder_channel("input_angle", lines=8192, multiplication=4),
    encoder_channel("output_angle", lines=18_000, multiplication=4, direction=-1, modulus=2**16),
    Channel(
        name="torque",
        unit="N m",
        scale=3.1e-5,
        offset=0.0125,
        direction=-1,
        calibration=CALIBRATION,
        model="EL3104",
        serial_number="7",
    ),
    Channel(name="statusword", unit="1", scale=1.0),
)


def header(run_id: str = "00001-friction-A1", **changes: object) -> RunHeader:
    """A header with something in every field."""
    metadata = RunMetadata(
        run_id=run_id,
        experiment="friction",
        origin="simulated",
        title="no-load running torque",
        start_time="2025-11-21T04:40:00.000+00:00",
        operator="Ada Grün",
        gear=shipped_gear(),
        gear_serial="A1",
        ratio=120.0,
        sample_rate=1000.0,
        time_base="virtual",
        parameters={"speeds_rpm": [1.0, 2.5], "repeats": 2, "note": "τ"},
        conditions={"lubricant": "SK-1A", "hours": 12.5},
        process={"backend": "sim", "seed": 3, "program_version": "0.1.0", "git_commit": "abc"},
    )
    fields: dict[str, object] = {
        "limits": {"torque": 2.0},
        "devices": {"drive": {"vendor": "x"}},
        "truth": {"coulomb": 70.0},
        "epoch_ns": EPOCH_NS,
    }
    return RunHeader(
        metadata, tuple(Column.of(channel) for channel in CHANNELS), **(fields | changes)
    )  # type: ignore[arg-type]


def counts_of(cycles: np.ndarray) -> np.ndarray:
    """The counts that belong to cycle indices: any row can be checked by itself."""
    k = np.asarray(cycles, dtype=np.int64)
    return np.stack(
        [k * 137 - 5, -(k * 17) // 3, (k * 7919) % 4093 - 2000, (k * 31) % 1024], axis=1
    )


def block(first: int, rows: int) -> SampleBlock:
    """The block of cycles [first, first + rows)."""
    cycles = np.arange(first, first + rows, dtype=np.int64)
    flags = np.where(cycles % 97 == 0, 1, 0).astype(np.uint16)
    return SampleBlock(first, cycles * CYCLE_NS, counts_of(cycles), flags)


def write_run(
    folder: Path,
    rows: int = 2500,
    *,
    compress: bool = True,
    outcome: str = "COMPLETED",
    **changes: object,
) -> Path:
    """A sealed run of `rows` cycles with two segments and two events."""
    writer = RunWriter(
        folder / "00001-friction-A1.h5", header(**changes), compress=compress, chunk_rows=1024
    )
    for first in range(0, rows, 100):
        writer.append(block(first, min(100, rows - first)))
    if rows >= 20:
        writer.segment(
            Segment(
                index=0, label="hold", start=0, stop=rows // 2, setpoint=3.25, direction=1, repeat=0
            )
        )
        writer.segment(
            Segment(
                index=1,
                label="hold",
                start=rows // 2,
                stop=rows,
                setpoint=-3.25,
                direction=-1,
                repeat=1,
            )
        )
    writer.event(Event(EPOCH_NS + 5, "info", "NOTE", "operator", "Öl nachgefüllt"))
    writer.event(Event(EPOCH_NS + 9, "warning", "DRIFT", "engine", "x" * 600))
    return writer.seal(outcome, "2025-11-21T04:41:00.000+00:00")


def edit(path: Path) -> Any:
    """A sealed run opened to be changed, by somebody who lets the note beside it be."""
    path.chmod(0o644)
    return h5py.File(path, "r+")


def reseal(path: Path) -> None:
    """Note the hash of what the file is by now, as somebody does who wants the change to be believed."""
    note = hash_path(path)
    note.chmod(0o644)
    note.write_text(f"{file_sha256(path)}  {path.name}\n")
