"""Runs in folders of folders, what may go wrong with them and with the place of their index, and several readers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from rig.errors import RunFileError
from rig.library import index, reading
from rig.library.folder import run_named
from rig.library.index import LibraryIndex
from rig.library.place import VARIABLE, index_path, indexes_folder
from rig.library.reading import read_many
from rig.runfile.listing import read_listing
from rig.runfile.read import glance
from tests.rig.library.stored import start, write

ROOT = Path(__file__).parents[3]
INSIDE = ("00003-home-A1.h5", "2026/03/A1/00001-friction-A1.h5", "2026/04/B2/00001-friction-B2.h5")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs: in the folder itself and in YEAR/MONTH/GEAR; and files that are no runs of this folder."""
    folder = tmp_path_factory.mktemp("made")
    for name in INSIDE:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        number, protocol, serial = path.name.removesuffix(".h5").split("-")
        write(path.parent, int(number), protocol, serial=serial, start_time=start(int(number)))
    for other in ("00003-home-A1.analysis", ".hidden"):
        (folder / other).mkdir()
        (folder / other / "00009-friction-A1.h5").write_bytes(b"no run of this folder")
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """They in a folder of this test, with a link that leads back to it."""
    shutil.copytree(made, tmp_path / "runs")
    (tmp_path / "runs" / "2026" / "again").symlink_to(tmp_path / "runs")
    return tmp_path / "runs"


def names(library: LibraryIndex) -> list[str]:
    return [run.path.relative_to(library.folder).as_posix() for run in library.search()]


def test_folders_of_folders_are_listed_folder_by_folder(folder: Path) -> None:
    library = LibraryIndex(folder, nested=True)
    assert library.outdated() == 3
    assert names(library) == list(INSIDE)
    assert library.outdated() == 0
    assert library.folders == tuple(
        folder / name for name in ("", "2026", "2026/03", "2026/03/A1", "2026/04", "2026/04/B2")
    )
    assert [run.gear_serial for run in library.search(gear="b2")] == ["B2"]
    assert LibraryIndex(folder, nested=True).refresh() == 0


def test_the_folder_alone_neither_lists_nor_forgets_what_is_within(folder: Path) -> None:
    LibraryIndex(folder, nested=True).refresh()
    alone = LibraryIndex(folder)
    assert (alone.refresh(), names(alone)) == (0, [INSIDE[0]])
    (folder / INSIDE[0]).unlink()
    assert names(alone) == []
    whole = LibraryIndex(folder, nested=True)
    assert (whole.refresh(), names(whole)) == (0, list(INSIDE[1:]))


def test_a_run_is_named_by_its_number_where_that_is_one_runs_alone(folder: Path) -> None:
    assert run_named(folder, "3") == folder / INSIDE[0]
    assert run_named(folder, "00001-friction-B2") == folder / INSIDE[2]
    with pytest.raises(RunFileError, match="names several runs"):
        run_named(folder, "1")


def test_a_folder_that_cannot_be_looked_into_is_told(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scandir = os.scandir

    def refusing(path: Path) -> object:
        if path.name == "B2":
            raise PermissionError(13, "Permission denied")
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    library = LibraryIndex(folder, nested=True)
    assert names(library) == list(INSIDE[:2])
    assert library.refused == (f"{folder / '2026/04/B2'}: Permission denied",)


def test_a_file_that_changes_is_read_again_and_one_that_vanishes_is_gone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = LibraryIndex(folder, nested=True)
    library.refresh()
    changed = folder / INSIDE[1]
    changed.chmod(0o644)
    with h5py.File(changed, "r+") as file:
        file["entry/user/name"][()] = b"x"  # type: ignore[index]
    os.utime(changed, ns=(0, 1))
    assert library.refresh() == 1
    (run,) = library.search(gear="A1", protocol="friction")
    assert (run.operator, run.problem) == ("x", "")
    # One that vanishes between being seen and being read is no unreadable run.
    os.utime(changed, ns=(0, 2))
    read_one = reading.read_one

    def vanishing(path: Path) -> object:
        path.unlink()
        return read_one(path)

    monkeypatch.setattr(reading, "read_one", vanishing)
    assert names(library) == [INSIDE[0], INSIDE[2]]
    assert LibraryIndex(folder, nested=True).refresh() == 0


def test_the_quick_reading_says_what_the_careful_one_says(folder: Path) -> None:
    for name in INSIDE:
        quick, careful = read_listing(folder / name), glance(folder / name)
        m = careful.metadata
        assert (quick.run_id, quick.start, quick.operator) == (m.run_id, m.start_time, m.operator)
        assert (quick.rows, quick.duration) == (careful.rows, careful.duration)
    # What the quick one does not expect is left to the careful one, which names it.
    path = folder / INSIDE[0]
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        file["entry/outcome"][()] = b"ABORTED"  # type: ignore[index]
    with pytest.raises(RunFileError, match="outcome and end time are not what was written"):
        read_listing(path)


def test_several_processes_read_the_same_and_one_that_dies_is_replaced(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [folder / name for name in INSIDE]
    alone = sorted(read_many(paths, 1))
    with monkeypatch.context() as here:
        here.setattr(reading, "read_one", None)
        assert sorted(read_many(paths, 2)) == alone
    monkeypatch.setattr(sys, "executable", "/bin/false")
    assert sorted(read_many(paths, 2)) == alone
    monkeypatch.setattr(sys, "executable", "/no/such/program")
    assert sorted(read_many(paths, 2)) == alone


def test_what_was_read_before_a_stop_is_kept(folder: Path) -> None:
    def stop(done: int, of: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        LibraryIndex(folder, stop, nested=True).refresh()
    assert LibraryIndex(folder, nested=True).refresh() == 1


def test_two_processes_write_one_index_at_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom rig.library import index\n"
        "index.WRITTEN_AT_ONCE = 1\n"
        f"library = index.LibraryIndex({str(folder)!r}, nested=True)\nsys.stdin.read(1)\n"
        "for _ in range(20):\n"
        "    library.search()\n    index.index_path(library.folder).touch()\n"
        "    for name in library._rows: library._write([name], library._rows)\n"
        "print(len(library.search()), library.rebuilt)"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        for _ in range(2)
    ]
    answers = [process.communicate("x")[0] for process in processes]
    assert [answer.split() for answer in answers] == [["3"], ["3"]]
    whole = LibraryIndex(folder, nested=True)
    assert (whole.refresh(), names(whole), whole.rebuilt) == (0, list(INSIDE), "")


def test_the_index_is_nowhere_in_the_folder_of_runs(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(folder.rglob("*"))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "elsewhere"))
    LibraryIndex(folder, nested=True).refresh()
    assert sorted(folder.rglob("*")) == before
    assert [path.parent.parent for path in (tmp_path / "elsewhere").rglob("*.sqlite")] == [
        tmp_path / "elsewhere"
    ]
    # The same folder by another path has the same index; another computer has another one.
    (tmp_path / "way").symlink_to(folder)
    assert index_path(tmp_path / "way") == index_path(folder)
    assert LibraryIndex(tmp_path / "way", nested=True).refresh() == 0
    here = indexes_folder()
    monkeypatch.setattr("platform.node", lambda: "another-computer")
    assert indexes_folder().name == "another-computer" != here.name


def test_where_no_index_can_be_kept_it_lives_in_memory(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A file where a folder should be stands for a place that may not be written.
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))
    library = LibraryIndex(folder, nested=True)
    assert names(library) == list(INSIDE)
    assert "kept in memory" in library.rebuilt
    assert library.refresh() == 0
    assert index.LibraryIndex(folder, nested=True).refresh() == 3
