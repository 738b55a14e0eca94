"""What cannot be believed of a run is said by `rig verify` and by whoever opens it, by the same checks."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.channel import Calibration
from experiments.finding import Severity
from rig.errors import RunFileError
from rig.runfile.header import RunHeader
from rig.runfile.layout import Column
from rig.runfile.read import close_recording, open_run
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, edit, header, reseal, write_run

ROWS = 300


def set_field(path: str, value: object) -> Callable[[Any], None]:
    def change(file: Any) -> None:
        file[path][()] = value

    return change


def replace_field(path: str, text: bytes) -> Callable[[Any], None]:
    def change(file: Any) -> None:
        group = file[path].parent
        del file[path]
        group.create_dataset(path.rpartition("/")[2], data=np.bytes_(text))

    return change


def time_runs_backwards(file: Any) -> None:
    times = file["entry/data/time"]
    times[100] = times[98]


def segment_outside(file: Any) -> None:
    table = file["entry/segments"]
    rows = table[:]
    rows["stop"][1] = ROWS + 1
    table[:] = rows


def segment_before_the_rows(file: Any) -> None:
    table = file["entry/segments"]
    rows = table[:]
    rows["start"][0] = -7
    table[:] = rows


def cut_chunk(file: Any) -> None:
    torque = file["entry/data/statusword"]
    _, whole = torque.id.read_direct_chunk((0,))
    torque.id.write_direct_chunk((0,), whole[: len(whole) // 2], 0)


WRONG: dict[str, tuple[Callable[[Any], None], str]] = {
    "ratio NaN": (set_field("entry/sample/ratio", np.nan), "the ratio of the gear is nan"),
    "ratio 0": (set_field("entry/sample/ratio", 0.0), "the ratio of the gear is 0"),
    "ratio infinite": (set_field("entry/sample/ratio", np.inf), "the ratio of the gear is inf"),
    "ratio negative": (set_field("entry/sample/ratio", -120.0), "the ratio of the gear is -120"),
    "rate 0": (set_field("entry/process/sample_rate", 0.0), "the sample rate is 0 Hz"),
    "rate NaN": (set_field("entry/process/sample_rate", np.nan), "the sample rate is nan Hz"),
    "rate negative": (set_field("entry/process/sample_rate", -1.0), "the sample rate is -1 Hz"),
    "rate tiny": (set_field("entry/process/sample_rate", 1e-300), "the sample rate is 1e-300 Hz"),
    "time": (time_runs_backwards, "time does not increase at 1 rows, first at row 100"),
    "segment": (segment_outside, "ends at row 301 of 300"),
    "segment before": (segment_before_the_rows, "a segment ends before it begins"),
    "chunk": (cut_chunk, "the rows of statusword cannot be read"),
    "rows": (set_field("entry/process/rows_written", 299), "but the writer counted 299"),
    "origin": (
        replace_field("entry/process/origin", b"imported"),
        "it says imported, but was made by the backend sim",
    ),
    "mark": (replace_field("entry/process/origin_mark", b"REPLAY"), "but is marked REPLAY"),
}


@pytest.mark.parametrize("name", WRONG)
def test_verify_and_every_reader_say_so(tmp_path: Path, name: str) -> None:
    damage, words = WRONG[name]
    path = write_run(tmp_path, ROWS)
    with edit(path) as file:
        damage(file)
    reseal(path)
    findings = verify_run(path)
    assert findings[0].severity is Severity.PASSED, findings[0].found
    assert any(words in f.found and f.severity is Severity.BLOCKS for f in findings)
    with pytest.raises(RunFileError, match=words):
        open_run(path)


def hardware(**changes: object) -> RunHeader:
    """What a run from hardware says of itself."""
    made = header()
    process = {**made.metadata.process, "backend": "hardware"}
    metadata = dataclasses.replace(made.metadata, origin="hardware", process=process)
    return dataclasses.replace(made, **({"metadata": metadata, "truth": None} | changes))


def written(folder: Path, made: RunHeader) -> Path:
    writer = RunWriter(folder / "00001-friction-A1.h5", made)
    writer.append(block(0, ROWS))
    return writer.seal("COMPLETED")


def simulated_calibration() -> tuple[Column, ...]:
    columns = header().columns
    calibration = Calibration(certificate="simulated instrument")
    return (
        *columns[:2],
        Column.of(dataclasses.replace(columns[2].channel, calibration=calibration)),
        columns[3],
    )


def simulated_model() -> tuple[Column, ...]:
    columns = header().columns
    return (Column.of(dataclasses.replace(columns[0].channel, model="simulated")), *columns[1:])


def test_a_run_from_hardware_may_say_so(tmp_path: Path) -> None:
    recording = open_run(written(tmp_path, hardware()))
    assert recording.metadata.origin == "hardware"
    close_recording(recording)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"truth": {"coulomb": 70.0}}, "holds the truth of a simulated gear"),
        ({"columns": simulated_calibration()}, "simulated: torque"),
        ({"columns": simulated_model()}, "simulated: input_angle"),
        ({"metadata": dataclasses.replace(header().metadata, origin="hardware")}, "backend sim"),
    ],
)
def test_a_simulation_relabelled_as_hardware_is_refused(
    tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    path = written(tmp_path, hardware(**changes))
    (finding,) = [f for f in verify_run(path) if f.what == "origin"]
    assert finding.severity is Severity.BLOCKS
    assert words in finding.found
    with pytest.raises(RunFileError, match=words):
        open_run(path)


@pytest.mark.parametrize(
    ("origin", "backend"),
    [
        ("simulated", "hardware"),
        ("replay", "replay:runs/00001-home-A1.h5"),
        ("imported", "import"),
        ("simulated", "a rig of a later version"),
    ],
)
def test_what_the_rigs_make_agrees_with_itself(tmp_path: Path, origin: str, backend: str) -> None:
    made = header()
    process = {**made.metadata.process, "backend": backend}
    metadata = dataclasses.replace(made.metadata, origin=origin, process=process)  # type: ignore[arg-type]
    close_recording(open_run(written(tmp_path, dataclasses.replace(made, metadata=metadata))))


def test_a_recording_that_does_not_know_its_ratio_and_time_base(tmp_path: Path) -> None:
    made = header()
    process = {"backend": "import"}
    metadata = dataclasses.replace(
        made.metadata,
        origin="imported",
        process=process,
        ratio=float("nan"),
        sample_rate=float("nan"),
        time_base="none",
    )
    close_recording(open_run(written(tmp_path, dataclasses.replace(made, metadata=metadata))))


def test_a_value_that_is_no_number(tmp_path: Path) -> None:
    made = header()
    columns = (Column(made.columns[0].channel, "float64"), *made.columns[1:])
    path = written(tmp_path, dataclasses.replace(made, columns=columns))
    with edit(path) as file:
        file["entry/data/input_angle"][7] = np.nan
    reseal(path)
    with pytest.raises(RunFileError, match="input_angle has 1 values that are no numbers"):
        open_run(path)


def test_without_rows_no_row_is_read(tmp_path: Path) -> None:
    path = write_run(tmp_path, ROWS)
    with edit(path) as file:
        time_runs_backwards(file)
    reseal(path)
    close_recording(open_run(path, rows=False))
    with pytest.raises(RunFileError, match="time does not increase"):
        open_run(path)
