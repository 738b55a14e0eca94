"""Each thing that can be wrong with a run is found and named; a good run has no findings but "ok"."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.channel import Calibration
from drivers.samples import SampleBlock
from experiments.finding import Severity
from experiments.recording import Segment
from rig.runfile.layout import Column
from rig.runfile.seal import allowing_unsealed, hash_path
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, edit, header, reseal, write_run


def levels(path: Path) -> dict[str, str]:
    return {finding.what: finding.severity for finding in verify_run(path)}


def test_a_run_under_another_name_says_which_it_is(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    path = path.rename(path.with_name("00001-mine.h5"))
    found = {f.what: f.found for f in verify_run(path)}
    assert (
        "the note of its SHA-256 is missing, allowed a file 00001-mine.h5.sha256" in found["hash"]
    )
    assert found["name"] == "the run names itself 00001-friction-A1"


def test_a_good_run(tmp_path: Path) -> None:
    found = levels(write_run(tmp_path))
    assert found == {
        "hash": "passed",
        "readable": "passed",
        "rows": "passed",
        "sequence": "passed",
        "time": "passed",
        "flags": "warns",
        "segments": "passed",
        "calibration": "passed",
        "numbers": "passed",
        "origin": "passed",
        "channels": "passed",
    }
    (flags,) = [f.found for f in verify_run(tmp_path / "00001-friction-A1.h5") if f.what == "flags"]
    assert flags == "26 of 2500 cycles flagged (incomplete 26)"


def test_a_changed_file(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    with edit(path) as file:
        file["entry/outcome"][()] = b"ABORTED"
    assert levels(path)["hash"] == "blocks"
    hash_path(path).unlink()
    assert levels(path)["hash"] == "blocks"
    with allowing_unsealed():
        assert levels(path)["hash"] == "warns"


def test_rows_that_the_writer_did_not_count(tmp_path: Path) -> None:
    path = write_run(tmp_path)
    with edit(path) as file:
        for dataset in file["entry/data"].values():
            dataset.resize((2400,))
    reseal(path)
    found = levels(path)
    assert (found["hash"], found["rows"], found["segments"]) == ("passed", "blocks", "blocks")


@pytest.mark.parametrize("row", [1, 777, 2499])
def test_time_that_stands_still(tmp_path: Path, row: int) -> None:
    path = write_run(tmp_path)
    with edit(path) as file:
        times = file["entry/data/time"]
        times[row] = times[row - 1]
    (finding,) = [f for f in verify_run(path) if f.what == "time"]
    assert (finding.severity, finding.found) == (
        "blocks",
        f"time does not increase at 1 rows, first at row {row}",
    )


def test_gaps_between_cycles(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    for first, rows in ((3, 50), (60, 40), (100, 10)):
        writer.append(block(first, rows))
    findings = {f.what: f for f in verify_run(writer.seal("COMPLETED"))}
    assert (findings["sequence"].severity, findings["sequence"].found) == (
        "warns",
        "1 gaps in the cycle index, 7 cycles missing",
    )
    assert findings["rows"].severity is Severity.WARNS


def test_a_gap_at_the_edge_of_a_block_of_the_check(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    for first, rows in ((0, 65536), (65540, 100)):
        cycles = np.arange(first, first + rows)
        writer.append(
            SampleBlock(first, cycles, np.zeros((rows, 4), np.int64), np.zeros(rows, np.uint16))
        )
    findings = {f.what: f for f in verify_run(writer.seal("COMPLETED"))}
    assert findings["sequence"].found == "1 gaps in the cycle index, 4 cycles missing"
    assert findings["time"].severity is Severity.PASSED


@pytest.mark.parametrize(
    ("due", "level"),
    [("2025-11-20", "warns"), ("2025-11-21", "passed"), ("soon", "warns"), ("", "passed")],
)
def test_calibrations_that_were_overdue(tmp_path: Path, due: str, level: str) -> None:
    made = header()
    calibration = Calibration(certificate="c", date="2024-01-01", due=due)
    columns = (
        *made.columns[:2],
        Column.of(replace(made.columns[2].channel, calibration=calibration)),
        made.columns[3],
    )
    writer = RunWriter(tmp_path / "1-x-y.h5", replace(made, columns=columns))
    writer.append(block(0, 10))
    writer.segment(Segment(index=0, label="hold", start=0, stop=10))
    assert levels(writer.seal("COMPLETED"))["calibration"] == level


def test_an_unfinished_run(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    writer.append(block(0, 10))
    writer.flush()
    found = levels(writer.part)
    writer.abandon()
    assert found["hash"] == "warns"
    assert "blocks" not in found.values()


def test_an_unreadable_file(tmp_path: Path) -> None:
    (tmp_path / "x.h5").write_text("no")
    assert levels(tmp_path / "x.h5")["readable"] == "blocks"
