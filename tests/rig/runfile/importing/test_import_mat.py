"""MATLAB files of other rigs, of every version that is still met; real recordings; and damage."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from experiments.recording import Recording
from rig.errors import RigError, RunFileError
from rig.library.folder import claim_run
from rig.runfile.importing.adapters.matlab import MatlabTable
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.read import open_run
from tests.rig.importing import import_mat

DATA = Path(
    os.environ.get("HARMONIC_RIG_DATA", Path(__file__).parents[4].parent / "shared" / "data")
)
TIME = np.arange(50) * 0.01
ANGLE = np.linspace(0.0, 720.0, 50)


def imported(path: Path, *channels: str, **changes: object) -> Recording:
    chosen = ImportOptions(channels=tuple(map(parse_channel, channels)), **changes)  # type: ignore[arg-type]
    done = import_mat(path, chosen, lambda: claim_run(path.parent / "runs", "import", "x").path)
    return open_run(done.path, verify=True)


@pytest.mark.parametrize(("version", "compress"), [("4", False), ("5", False), ("5", True)])
@pytest.mark.parametrize("shape", ["row", "column"])
def test_old_and_common_versions(tmp_path: Path, version: str, compress: bool, shape: str) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(
        path, {"t": TIME, "a": ANGLE}, format=version, oned_as=shape, do_compression=compress
    )
    recording = imported(path, "time=t:s", "input_angle=a:deg")
    np.testing.assert_allclose(recording.si("input_angle"), np.radians(ANGLE), rtol=1e-15)
    np.testing.assert_allclose(recording.time(), TIME, atol=1e-9)
    assert recording.metadata.origin == "imported"


def test_structs_matrices_integers_and_texts(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    counts = (ANGLE * 100).astype(np.int32)
    content = {
        "log": {"t": TIME, "inner": {"M": 2 * TIME}},
        "both": np.column_stack([ANGLE, counts]),
        "note": "a text",
    }
    scipy.io.savemat(path, content)
    recording = imported(
        path, "time=log.t:s", "torque=log.inner.M:N m", "output_angle=both#2:count:36000"
    )
    np.testing.assert_array_equal(recording.stored("output_angle"), counts)
    np.testing.assert_array_equal(recording.si("torque"), 2 * TIME)
    with pytest.raises(RigError, match="no such column"):
        imported(path, "time=log.t:s", "torque=note:N m")


def test_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["log/a"] = TIME[None, :], ANGLE[None, :]
        file["text"] = np.array([104, 105], dtype=np.uint16)
        file["text"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    recording = imported(path, "time=t:s", "input_angle=log.a:deg")
    np.testing.assert_allclose(recording.si("input_angle"), np.radians(ANGLE))
    with pytest.raises(RigError, match=r"no such column.*t, log.a|no such column.*log.a, t"):
        imported(path, "time=t:s", "input_angle=text:deg")


@pytest.mark.parametrize("how", ["virtual", "external", "absurd"])
def test_version_7_3_that_is_built_as_no_recording_is(tmp_path: Path, how: str) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        file["t"] = TIME[None, :]
        if how == "virtual":
            made = h5py.VirtualLayout((1, 50), np.float64)
            made[:] = h5py.VirtualSource(tmp_path / "other.h5", "a", (1, 50))
            file.create_virtual_dataset("a", made)
        elif how == "external":
            place = [(str(tmp_path / "other.bin"), 0, 400)]
            file.create_dataset("a", (1, 50), np.float64, external=place)
        else:
            file.create_dataset("a", (1, 1 << 40), np.float64, chunks=(1, 64))
    with pytest.raises(RunFileError, match=r"lies in other files|larger than anything in its file"):
        imported(path, "time=t:s", "input_angle=a:deg")


def test_holes_are_named_by_row(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    holes = ANGLE.copy()
    holes[[7, 9]] = np.nan
    scipy.io.savemat(path, {"t": TIME, "a": holes})
    with pytest.raises(RunFileError, match="row 8, column a: not finite; value nan"):
        imported(path, "time=t:s", "input_angle=a:deg")
    recording = imported(path, "time=t:s", "input_angle=a:deg", drop_bad_rows=True)
    assert recording.rows == 48


def test_arrays_that_do_not_belong_together(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"t": TIME, "a": ANGLE[:-1]})
    with pytest.raises(RunFileError, match="differ in length; value t 50, a 49"):
        imported(path, "time=t:s", "input_angle=a:deg")


def test_files_without_numbers(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"note": "text"})
    with pytest.raises(RunFileError, match="no numeric arrays"):
        imported(tmp_path / "x.mat", "time=t:s", "input_angle=a:rad")
    with pytest.raises(RunFileError, match="no such file"):
        imported(tmp_path / "none.mat", "time=t:s", "input_angle=a:rad")
    (tmp_path / "text.mat").write_text("t,a\n0,1\n")
    with pytest.raises(RunFileError, match="not a readable MATLAB file"):
        imported(tmp_path / "text.mat", "time=t:s", "input_angle=a:rad")


@pytest.mark.parametrize("keep", [0, 3, 127, 128, 140, 300, 600])
def test_files_cut_short(tmp_path: Path, keep: int) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"t": TIME, "s": {"a": ANGLE}})
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(RigError) as caught:
        imported(path, "time=t:s", "input_angle=s.a:deg")
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not (DATA / "emps").is_dir(), reason="recordings of other rigs are not here")
@pytest.mark.parametrize("name", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_a_real_positioning_system(tmp_path: Path, name: str) -> None:
    path = DATA / "emps" / name
    raw = scipy.io.loadmat(path)
    chosen = ImportOptions(
        channels=tuple(map(parse_channel, ("time=t:s", "position=qm:m", "force=vir:V:35.15065188")))
    )
    recording = open_run(
        import_mat(path, chosen, lambda: claim_run(tmp_path, "motion", "EMPS").path).path,
        verify=True,
    )
    assert recording.rows == 24841
    assert {n: s.unit for n, s in recording.signals.items()} == {"position": "m", "force": "N"}
    np.testing.assert_array_equal(recording.si("position"), raw["qm"].ravel())
    np.testing.assert_allclose(recording.si("force"), raw["vir"].ravel() * 35.15065188, rtol=1e-15)
    assert recording.metadata.sample_rate == pytest.approx(1000.0, rel=1e-4)


def test_variables_may_have_any_name(tmp_path: Path) -> None:
    path = tmp_path / "names.mat"
    scipy.io.savemat(path, {"file": TIME, "names": TIME, "arr_0": TIME, "allow_pickle": TIME})
    assert sorted(MatlabTable(path).headings) == ["allow_pickle", "arr_0", "file", "names"]
