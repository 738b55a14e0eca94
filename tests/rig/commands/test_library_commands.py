"""`rig runs` with a search, `rig diff` and `rig report --passport` as people and programs call them; one
real run, really fitted.
"""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.library.index import LibraryIndex
from rig.library.place import index_path
from rig.run.start import run_order
from tests.rig.commands.calling import Rig
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Rig:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "220")
    monkeypatch.delenv("HARMONIC_RIG_DEBUG", raising=False)
    return Rig(capsys)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two friction runs of gear A1 and a homing of B2 that was aborted."""
    folder = tmp_path_factory.mktemp("written")
    for number in (1, 2):
        run = write(folder, number, start_time=start(number))
        analyse(run, estimate(RUNNING, 0.08 + 0.001 * number))
    write(folder, 3, "home", serial="B2", outcome="ABORTED", start_time=start(3))
    LibraryIndex(folder).refresh()
    return folder


@pytest.fixture
def three(written: Path, tmp_path: Path) -> Path:
    """They under second names, so that the index that was made of them holds."""
    shutil.copytree(written, tmp_path / "runs", copy_function=os.link)
    shutil.copy2(index_path(written), index_path(tmp_path / "runs"))
    return tmp_path / "runs"


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one short starting-torque run of the simulated rig."""
    folder = tmp_path_factory.mktemp("real")
    values = {"positions": 2, "zero_time": 0.5, "rate": 0.05}
    request = Order(
        protocol="starting-torque",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values=values,
        serial="G7",
        seed=1,
    )
    assert run_order(request).outcome == "COMPLETED"
    return folder


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        ((), [1, 2, 3]),
        (("--gear", "A1"), [1, 2]),
        (("--protocol", "home"), [3]),
        (("--outcome", "aborted"), [3]),
        (("--since", "2026-01-02"), [2, 3]),
        (("--until", "2026-01-01"), [1]),
        (("--text", "b2 home"), [3]),
        (("--origin", "hardware"), []),
    ],
)
def test_runs_are_searched(
    rig: Rig, three: Path, words: tuple[str, ...], numbers: list[int]
) -> None:
    found = rig.json("runs", three, *words)
    assert [run["number"] for run in found["runs"]] == numbers
    assert all(run["state"] == "sealed" for run in found["runs"])


def test_a_list_shows_the_newest_of_what_was_found_and_says_of_how_many(
    rig: Rig, three: Path
) -> None:
    assert [run["number"] for run in rig.json("runs", three, "--last", 2)["runs"]] == [2, 3]
    assert rig.json("runs", three, "--last", 2)["found"] == 3
    assert rig("runs", three, "--last", 1) == 0
    assert "The newest 1 of 3 runs: --last 0 lists all" in rig.out
    assert "00001-friction" not in rig.out
    assert rig("runs", three, "--last", 0) == 0
    assert "newest" not in rig.out
    (three / "00003-home-B2.h5").rename(three / "2026.h5")
    (three / "2026").mkdir()
    (three / "2026.h5").rename(three / "2026" / "00003-home-B2.h5")
    assert rig("runs", three, "--gear", "B2") == 0
    assert "2026/00003-home-B2" in rig.out


def test_a_day_that_is_none_is_a_wrong_use(rig: Rig, three: Path) -> None:
    assert rig("runs", three, "--since", "yesterday") == 2
    assert "YYYY-MM-DD" in rig.err


def test_diff_says_what_differs_and_ends_with_zero(rig: Rig, three: Path) -> None:
    first, second = sorted(three.glob("*friction*.h5"))
    found = rig.json("diff", first, second)
    assert found["differs"] is True
    changes = {(change["group"], change["name"]) for change in found["changes"]}
    assert ("results", f"friction: {RUNNING}") in changes
    assert "parameters" not in {group for group, _ in changes}
    same = rig.json("diff", first, first, "--all")
    assert (same["differs"], same["changes"]) == (False, [])
    assert len(same["same"]) == sum(same["compared"].values())
    assert rig("diff", first, second) == 0
    for word in (
        "00001-friction-A1  against  00002-friction-A1",
        "parameters: 0 of",
        "running torque 1000 r/min",
        "81.00 ± 0.20 mN m",
        "significant",
    ):
        assert word in rig.out
    assert "\n speeds " not in rig.out
    assert rig("diff", first, first, "--all") == 0
    assert "\n speeds " in rig.out
    assert "_rpm" not in rig.out
    assert "Nothing differs but number and time." in rig.out


def test_diff_of_a_run_that_is_none(rig: Rig, three: Path) -> None:
    assert rig("diff", three / "00001-friction-A1.h5", three / "none.h5", "--json") == 6
    assert "none.h5" in rig.err
    (told,) = (json.loads(line) for line in rig.out.splitlines())
    assert told["error"]["kind"] == "RunFileError"
    assert told["error"]["where"] == str(three / "none.h5")
    assert told["error"]["remedy"] == "Check the path, or list the runs."
    assert told["error"]["message"] in rig.err


def test_passport(rig: Rig, three: Path) -> None:
    found = rig.json("report", "--gear", "A1", "--passport", "--runs", three)
    assert [one["quantity"] for one in found["series"]] == [RUNNING]
    assert [point["run"] for point in found["series"][0]["points"]] == [
        "00001-friction-A1",
        "00002-friction-A1",
    ]
    assert (found["mark"], found["analysed"]) == ("SIMULATED", [])
    assert rig("report", "--gear", "A1", "--passport") == 0
    for word in (
        "Gear A1",
        "SIMULATED",
        "No-load running torque at 1000 r/min",
        "learning",
        "5 % are told to have changed within 20 runs",
        "Missing",
    ):
        assert word in rig.out


def test_a_change_is_told_with_its_size_and_the_run_that_decides(rig: Rig, three: Path) -> None:
    for number in range(4, 16):
        run = write(three, number, start_time=start(number))
        analyse(
            run, estimate(RUNNING, 0.08 + 0.0005 * (number % 3) + (0.02 if number > 12 else 0.0))
        )
    assert rig("report", "--gear", "A1", "--passport", "--runs", three) == 0
    for word in (
        "CHANGED  No-load running torque at 1000 r/min is larger by",
        "since run 00013-friction-A1",
        "decides: if it has changed as well, the bench has.",
        "rig run friction --gear SERIAL",
    ):
        assert word in rig.out
    (told,) = rig.json("report", "--gear", "A1", "--passport", "--runs", three)["alarms"]
    assert told["since"] == "00013-friction-A1"
    (three.parent / "rig.toml").write_text("[alarms]\nbaseline = 12\n", encoding="utf-8")
    found = rig.json("report", "--gear", "A1", "--passport", "--runs", three, "--baseline", 20)
    assert found["series"][0]["state"] == "learning"


def test_a_passport_fits_what_was_never_fitted_once(rig: Rig, real: Path, tmp_path: Path) -> None:
    folder = tmp_path / "real"
    shutil.copytree(real, folder)
    write(folder, 8, serial="G7")
    before = rig.json("report", "--gear", "G7", "--passport", "--runs", folder)
    assert before["series"] == []
    assert "--analyse" in {one["remedy"] for one in before["missing"]}
    found = rig.json("report", "--gear", "G7", "--passport", "--runs", folder, "--analyse")
    told = {one["run"]: one for one in found["analysed"]}
    assert (
        told["00001-starting_torque-G7"]["stored"] == "00001-starting_torque-G7.analysis/0001.json"
    )
    assert told["00008-friction-G7"]["stored"] == ""
    assert told["00008-friction-G7"]["problem"]
    (one,) = found["series"]
    assert one["quantity"] == "starting_torque"
    assert one["conditions"]["torque of"] == "motor + gear"
    assert 0.02 < one["points"][0]["value"] < 0.2
    assert one["points"][0]["expanded_uncertainty"] > 0.0
    again = rig.json("report", "--gear", "G7", "--passport", "--runs", folder, "--analyse")
    assert [one["run"] for one in again["analysed"]] == ["00008-friction-G7"]
    assert len(list((folder / "00001-starting_torque-G7.analysis").glob("*.json"))) == 1


def test_a_gear_that_is_not_there(rig: Rig, three: Path) -> None:
    assert rig("report", "--gear", "nobody", "--passport", "--runs", three) == 6
    assert "letter for letter" in rig.err
    assert rig("report", "--gear", "A1", "--passport", "--runs", three / "none") == 6
    assert rig("report", "--gear", "A1", "--passport", "--runs", three, "--baseline", "1") == 2
