"""Run numbers are never given out twice, not even to processes that ask at the same moment or after
files were deleted.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from rig.errors import RunFileError
from rig.library.folder import claim_run, run_files
from rig.library.reading import read_one
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, header, write_run

ROOT = Path(__file__).parents[3]


def test_numbers_go_up_and_are_never_used_again(tmp_path: Path) -> None:
    first = claim_run(tmp_path / "new" / "folder", "friction", "A1")
    assert (first.number, first.path.name, first.run_id) == (
        1,
        "00001-friction-A1.h5",
        "00001-friction-A1",
    )
    first.path.touch()
    assert claim_run(first.path.parent, "friction", "A1").number == 2
    first.path.unlink()
    assert claim_run(first.path.parent, "home", "A1").number == 3


def test_full_width_letters_are_letters_in_the_name_of_a_file(tmp_path: Path) -> None:
    assert claim_run(tmp_path, "home", "ＳＮ－0815").path.name == "00001-home-SN_0815.h5"


@pytest.mark.parametrize(
    "name",
    ["00041-friction-A1.h5.part", "00041-friction-A1.analysis", "00041-x.h5", "00041-y.h5.sha256"],
)
def test_whatever_bears_a_number_keeps_it(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    assert claim_run(tmp_path, "friction", "A1").number == 42


@pytest.mark.parametrize(
    ("protocol", "serial", "name"),
    [
        ("friction", "SN 12/34", "00001-friction-SN_12_34.h5"),
        ("", "", "00001-run-unknown.h5"),
        ("a", "../../etc/passwd", "00001-a-etc_passwd.h5"),
        ("a", "\n\0ü", "00001-a-unknown.h5"),
        ("a", "x" * 300, None),
    ],
)
def test_names_stay_in_the_folder(
    tmp_path: Path, protocol: str, serial: str, name: str | None
) -> None:
    path = claim_run(tmp_path, protocol, serial).path
    assert path.parent == tmp_path
    assert name is None or path.name == name
    assert len(path.name) < 100
    path.touch()


def test_two_processes_never_get_the_same_number(tmp_path: Path) -> None:
    code = (
        "from rig.library.folder import claim_run\nfor _ in range(60): "
        f"print(claim_run({str(tmp_path)!r}, 'p', 's').number)"
    )
    processes = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=ROOT)
        for _ in range(3)
    ]
    numbers = [int(line) for process in processes for line in process.communicate()[0].split()]
    assert sorted(numbers) == list(range(1, 181))


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunFileError, match="no run can be recorded here"):
        claim_run(tmp_path / "file", "friction", "A1")
    with pytest.raises(RunFileError, match="no folder of runs"):
        run_files(tmp_path / "none")
    with pytest.raises(RunFileError, match=r"cannot be created.*folder that exists"):
        RunWriter(tmp_path / "none" / "1-x-y.h5", header())


def test_the_list_shows_good_bad_and_unfinished_runs(tmp_path: Path) -> None:
    write_run(tmp_path, 200)
    (tmp_path / "00002-x-y.h5").write_text("garbage")
    writer = RunWriter(tmp_path / "00003-x-y.h5", header("00003-x-y"))
    writer.append(block(0, 11))
    writer.flush()
    (good, none), (nothing, problem), (growing, _) = map(read_one, run_files(tmp_path))
    writer.abandon()
    assert (good["outcome"], good["rows"], good["duration"], none) == (
        "COMPLETED",
        200,
        pytest.approx(0.199),
        "",
    )
    assert (nothing, "not an HDF5 file" in problem) == ({}, True)
    assert growing["rows"] == 11
