"""Files that are no recordings, damaged ones, and anything at all: brought in right, or refused in words."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.finding import Severity
from rig.errors import RigError, RunFileError
from rig.runfile.read import close_recording, open_run
from rig.runfile.verify import verify_run
from tests.rig.importing import DEGREES, TIME, TORQUES, bring_in, file_of


@pytest.mark.parametrize("fmt", ["csv", "mat"])
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\n\n  \n",
        b"# only a comment\n",
        b"t,M\n",
        b"t,M\n0,1\n",
        bytes(range(256)) * 40,
        b"\x89HDF\r\n\x1a\n",
    ],
)
def test_files_without_rows_and_files_that_are_none(
    tmp_path: Path, fmt: str, content: bytes
) -> None:
    path = file_of(tmp_path, content, "bench.dat")
    with pytest.raises(RigError, match=r"bench\.dat"):
        bring_in(path, "time=1:s", "torque=2:N m", fmt=fmt)
    assert [p.name for p in tmp_path.iterdir()] == ["bench.dat"]
    with pytest.raises(RunFileError, match="nowhere"):
        bring_in(tmp_path / "nowhere", "time=1:s", "torque=2:N m", fmt=fmt)
    with pytest.raises(RunFileError):
        bring_in(tmp_path, "time=1:s", "torque=2:N m", fmt=fmt)


def try_import(folder: Path, content: bytes, fmt: str, drop: bool) -> None:
    """Anything is imported and readable, or refused in words."""
    run = folder / "00001-import-x.h5"
    for path in folder.iterdir():
        path.unlink()
    path = file_of(folder, content, "any")
    try:
        made = bring_in(path, "time=1:s", "torque=2:N m", fmt=fmt, drop_bad_rows=drop)
    except RigError:
        assert not run.exists()
        return
    recording = open_run(made.path, verify=True)
    assert recording.metadata.origin == "imported"
    assert recording.rows == made.rows >= 2
    assert np.isfinite(recording.si("torque")).all()
    assert (np.diff(recording.time()) >= 0).all()
    close_recording(recording)
    assert not any(finding.severity is Severity.BLOCKS for finding in verify_run(made.path))


CELLS = st.one_of(
    st.floats().map(repr),
    st.integers(-5, 400).map(str),
    st.sampled_from(["", "nan", "1,5", "1e400", "-", '"', "#", "١"]),
)
LINES = st.lists(st.lists(CELLS, min_size=1, max_size=3), max_size=6)
FUZZ = settings(
    max_examples=25,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@FUZZ
@given(text=st.text(max_size=120), drop=st.booleans())
def test_any_text(tmp_path: Path, text: str, drop: bool) -> None:
    try_import(tmp_path, text.encode("utf-8", "surrogatepass"), "csv", drop)


@FUZZ
@given(lines=LINES, delimiter=st.sampled_from(",;\t| "), drop=st.booleans())
def test_any_table(tmp_path: Path, lines: list[list[str]], delimiter: str, drop: bool) -> None:
    try_import(tmp_path, "\n".join(delimiter.join(line) for line in lines).encode(), "csv", drop)


@FUZZ
@given(content=st.binary(max_size=300), fmt=st.sampled_from(["csv", "mat"]), drop=st.booleans())
def test_any_bytes(tmp_path: Path, content: bytes, fmt: str, drop: bool) -> None:
    try_import(tmp_path, content, fmt, drop)


@pytest.mark.parametrize(
    ("at", "value"),
    [(144, 5), (145, 8), (176, 64), (177, 6), (260, 127), (280, 0), (136, 3), (20, 0)],
)
def test_a_damaged_matlab_file_does_not_kill_the_program(
    tmp_path: Path, at: int, value: int
) -> None:
    """Wrong type codes and flags end SciPy's compiled reader with a signal."""
    whole = tmp_path / "whole.mat"
    scipy.io.savemat(whole, {"t": TIME, "M": TORQUES, "s": {"q": DEGREES}})
    content = bytearray(whole.read_bytes())
    content[at] = value
    folder = tmp_path / "made"
    folder.mkdir()
    try_import(folder, bytes(content), "mat", True)
