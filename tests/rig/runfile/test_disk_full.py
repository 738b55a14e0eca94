"""The file cannot grow any more: the next row is an error, the process ends cleanly, what was flushed is recovered."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rig.errors import RunFileError
from rig.runfile.read import open_run
from rig.runfile.recover import recover_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, header

pytestmark = pytest.mark.skipif(os.name != "posix", reason="RLIMIT_FSIZE")
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("kind", ["inline", "threaded"])
@pytest.mark.parametrize("limit", [180_000, 400_000])
def test_a_disk_that_fills_up(tmp_path: Path, kind: str, limit: int) -> None:
    from tests.rig.runfile.filling_writer import incompressible

    command = [
        sys.executable,
        "-m",
        "tests.rig.runfile.filling_writer",
        str(tmp_path),
        kind,
        str(limit),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, check=False, cwd=ROOT
    )
    assert (done.returncode, done.stderr) == (0, "")
    said = json.loads(done.stdout)
    assert len(said["errors"]) == 3
    assert all("too large" in error and "rig recover" in error for error in said["errors"])
    recovered = recover_run(tmp_path / "1-x-y.h5.part")
    assert recovered.rows >= said["stored"] > 0
    recording = open_run(recovered.path, verify=True)
    expected = incompressible(0, recovered.rows).counts
    for index, name in enumerate(recording.signals):
        np.testing.assert_array_equal(recording.stored(name), expected[:, index])


def test_a_file_that_was_taken_away_is_noticed(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    writer.append(block(0, 10))
    writer.synchronise()
    writer.part.unlink()
    writer.append(block(10, 10))
    with pytest.raises(RunFileError, match="cannot be written"):
        writer.synchronise()
    with pytest.raises(RunFileError, match="cannot be written"):
        writer.append(block(20, 10))
    writer.abandon()


def test_a_file_that_was_replaced_is_noticed(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    writer.append(block(0, 10))
    writer.part.rename(tmp_path / "elsewhere")
    writer.part.write_text("another")
    with pytest.raises(RunFileError, match="replaced by another file"):
        writer.synchronise()
    writer.abandon()


def test_a_file_that_was_taken_away_cannot_be_sealed(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "1-x-y.h5", header())
    writer.append(block(0, 10))
    writer.part.unlink()
    with pytest.raises(RunFileError, match="cannot be completed"):
        writer.seal("COMPLETED")
    writer.abandon()
