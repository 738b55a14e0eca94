"""Damaged, cut, foreign and impossible files: a one-line error, never a traceback, never a wrong number."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.finding import Severity
from experiments.recording import Recording
from rig.errors import RigError, RunFileError
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, header, write_run

FUZZ = settings(
    max_examples=120,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def everything(recording: Recording) -> str:
    """All that a reader can see of a run, for comparing."""
    parts = [
        recording.metadata,
        recording.signals,
        recording.segments,
        recording.events,
        recording.flags().tolist(),
    ]
    parts += [recording.source.time_ns(0, recording.rows).tolist()]
    parts += [recording.stored(name).tolist() for name in recording.signals]
    return repr(parts)


@cache
def sealed_bytes() -> tuple[bytes, str]:
    with TemporaryDirectory() as folder:
        path = write_run(Path(folder), 300)
        recording = open_run(path, digest=False)
        seen = everything(recording)
        close_recording(recording)
        return path.read_bytes(), seen


@cache
def part_bytes() -> bytes:
    with TemporaryDirectory() as folder:
        writer = RunWriter(Path(folder) / "1-x-y.h5", header(), compress=True, chunk_rows=64)
        writer.append(block(0, 150))
        writer.flush()
        writer.abandon()
        return writer.part.read_bytes()


def refused_or_the_same(path: Path, seen: str) -> None:
    refusal, found = "", seen
    try:
        recording = open_run(path, digest=False)
        found = everything(recording)
        close_recording(recording)
    except RigError as error:
        refusal = str(error)
    assert found == seen
    assert "\n" not in refusal
    assert len(refusal) < 500


@FUZZ
@given(data=st.data())
def test_flipped_bytes_never_give_another_number(tmp_path: Path, data: st.DataObject) -> None:
    raw, seen = sealed_bytes()
    changed = bytearray(raw)
    for _ in range(data.draw(st.integers(1, 3))):
        changed[data.draw(st.integers(0, len(raw) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "00001-friction-A1.h5"
    path.write_bytes(changed)
    refused_or_the_same(path, seen)


@FUZZ
@given(share=st.floats(0, 1, exclude_max=True))
def test_cut_files_are_refused(tmp_path: Path, share: float) -> None:
    raw, seen = sealed_bytes()
    path = tmp_path / "00001-friction-A1.h5"
    path.write_bytes(raw[: int(len(raw) * share)])
    refused_or_the_same(path, seen)
    assert any(finding.severity is Severity.BLOCKS for finding in verify_run(path))


@settings(FUZZ, max_examples=60)
@given(garbage=st.binary(max_size=2000), signature=st.booleans())
def test_garbage_is_refused(tmp_path: Path, garbage: bytes, signature: bool) -> None:
    path = tmp_path / "x.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" * signature + garbage)
    with pytest.raises(RunFileError):
        open_run(path)


@settings(FUZZ, max_examples=60)
@given(data=st.data())
def test_recovery_of_damaged_parts_never_crashes(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    raw = part_bytes()
    changed = bytearray(raw[: data.draw(st.integers(0, len(raw)))])
    if changed:
        changed[data.draw(st.integers(0, len(changed) - 1))] ^= data.draw(st.integers(0, 255))
    part = tmp_path_factory.mktemp("part") / "1-x-y.h5.part"
    part.write_bytes(changed)
    refusal, recovered = "", None
    try:
        recovered = recover_run(part)
    except RigError as error:
        refusal = str(error)
    if recovered is not None and recovered.is_removed:
        assert b"EAHD" not in changed, "it held rows"
        assert not list(part.parent.iterdir())
        return
    if recovered is not None:
        assert open_run(recovered.path, verify=True).rows <= 150
        return
    assert part.read_bytes() == bytes(changed)
    assert [path.name for path in part.parent.iterdir()] == [part.name]
    assert "\n" not in refusal


def test_missing_empty_foreign_and_folders(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="no such file"):
        open_run(tmp_path / "none.h5")
    with pytest.raises(
        RunFileError, match=r"is a folder.*Name a run in it: rig runs .* lists them"
    ):
        open_run(tmp_path)
    (tmp_path / "empty.h5").touch()
    with pytest.raises(RunFileError, match="is empty"):
        open_run(tmp_path / "empty.h5")
    (tmp_path / "text.h5").write_text("time;angle\n0;0\n")
    with pytest.raises(RunFileError, match=r"not an HDF5 file.*rig import"):
        open_run(tmp_path / "text.h5")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = np.arange(3)
    with pytest.raises(RunFileError, match="not a run"):
        open_run(tmp_path / "foreign.h5")


def test_another_major_version_is_refused(tmp_path: Path) -> None:
    path = write_run(tmp_path, 30)
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        file.attrs["file_format_version"] = "2.0"
    with pytest.raises(RunFileError, match=r"format version.*2\.0, allowed 1\.2"):
        open_run(path, digest=False)
    with h5py.File(path, "r+") as file:
        file.attrs["file_format_version"] = "1.7"
    assert open_run(path, digest=False).rows == 30


@pytest.mark.parametrize(
    ("item", "reason"),
    [
        ("entry/data/torque", "torque"),
        ("entry/data/time", "time"),
        ("entry/segments", "table"),
        ("entry/events", "table"),
        ("entry/instrument/torque", "instrument/torque"),
        ("entry/process", "process"),
        ("entry/sample", "sample"),
    ],
)
def test_a_file_with_parts_missing_is_refused(tmp_path: Path, item: str, reason: str) -> None:
    path = write_run(tmp_path, 30)
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        del file[item]
    with pytest.raises(RunFileError, match=reason):
        open_run(path, digest=False)


def test_a_text_where_a_column_belongs_is_refused(tmp_path: Path) -> None:
    path = write_run(tmp_path, 30)
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        del file["entry/data/torque"]
        file["entry/data/torque"] = "none"
    with pytest.raises(RunFileError):
        open_run(path, digest=False)
