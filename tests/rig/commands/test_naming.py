"""A run as it is typed: its file, or its number or name in the folder of runs."""

from __future__ import annotations

from pathlib import Path

import pytest

import rig
from rig.commands.naming import RUNS, is_name, run_meant
from rig.errors import RunFileError
from tests.rig.commands.calling import Rig

QUICK = {"points": 6, "measure_time": 0.2, "settle_time": 0.15, "lowest_rpm": 8.0, "seed": 9931}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs of a gear."""
    folder = tmp_path_factory.mktemp("place") / "runs"
    for _ in range(2):
        rig.execute("friction", serial="A1", folder=folder, **QUICK)
    return folder


@pytest.mark.parametrize(
    ("word", "is_one"),
    [
        ("1", True),
        ("00012-friction-A1", True),
        ("00012-friction-A1.h5", False),
        ("12.h5.part", False),
        ("friction", False),
        ("a/1", False),
    ],
)
def test_what_may_be_a_name(word: str, is_one: bool) -> None:
    assert is_name(word) == is_one


def test_a_number_or_a_name_means_the_run_of_the_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = folder / "00002-friction-A1.h5"
    assert run_meant(folder, Path("2")) == file
    assert run_meant(folder, Path("00002-friction-A1")) == file
    assert run_meant(folder, Path("gone.h5")) == Path("gone.h5")
    monkeypatch.chdir(folder.parent)
    assert run_meant(RUNS, Path("2")) == RUNS / file.name
    monkeypatch.chdir(folder)
    assert run_meant(RUNS, Path("2")) == Path(file.name)
    # What is there by that name is meant before a number.
    monkeypatch.chdir(folder.parent)
    Path("2").touch()
    assert run_meant(RUNS, Path("2")) == Path("2")
    with pytest.raises(RunFileError, match="names no run; value 7"):
        run_meant(RUNS, Path("7"))


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("show 1", "00001-friction-A1"),
        ("fit 1 2 --no-store", "00002-friction-A1"),
        ("fit friction 2 --no-store", "00002-friction-A1"),
        ("diff 1 2", "00001-friction-A1 against 00002-friction-A1"),
        ("verify 2", "00002-friction-A1.h5"),
        ("validate 1 --on 2", "friction"),
        ("export 1 --output {out}", "rows written"),
        ("report 1 2 --output {page}", "00001-friction-A1"),
    ],
)
def test_every_command_that_takes_runs_takes_their_numbers(
    command: str,
    said: str,
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rig = Rig(capsys)
    words = command.format(out=tmp_path / "run.csv", page=tmp_path / "page.html").split()
    assert rig(*words, "--runs", folder) == 0, rig.out
    assert said in " ".join(rig.out.split()) or (tmp_path / "page.html").exists()


def test_a_folder_in_which_runs_are_looked_up_was_never_called_output(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Rig(capsys)("show", "1", "--output", folder) == 2
