"""`rig next` on the terminal and for a program."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rig.commands.calling import Rig
from tests.rig.library.stored import RUNNING, analyse, estimate, start, write


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Rig:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "220")
    return Rig(capsys)


def test_a_sentence_and_a_command_with_its_minutes(rig: Rig, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    analyse(write(folder, 1, start_time=start(1)), estimate(RUNNING, 0.08, own=1e-3))
    assert rig("next", "A1", "--runs", folder, "--target", "running_torque_1000=1.2%") == 0
    assert "running torque 1000 r/min: U 2.0 mN m, wanted 0.96 mN m" in rig.out
    assert "rig run friction --gear A1 --repeats 10" in rig.out
    assert " min)" in rig.out
    told = rig.json("next", "A1", "--runs", folder, "--target", "running_torque_1000=1.2%")
    (one,) = told["advice"]
    assert (one["helps"], one["times"], one["command"]) == (
        "visits",
        5,
        "rig run friction --gear A1 --repeats 10",
    )
    assert one["minutes"] > 10.0
    assert rig("next", "A1", "--runs", folder) == 0
    assert "Nothing is open" in rig.out
    assert rig("next", "A1", "--runs", folder, "--target", "speed=1%") == 2
    assert "names no number that was found" in rig.err
    assert rig("next", "Z9", "--runs", folder) == 6
