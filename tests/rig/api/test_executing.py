"""A protocol on the simulated rig from Python, and the report of it."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any

import pytest

import rig
from experiments.errors import PlanError

SHORT: dict[str, Any] = {"lowest_rpm": 300.0, "highest_rpm": 900.0, "points": 4}
TIMES: dict[str, Any] = {"measure_time": 0.2, "settle_time": 0.1}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> rig.Run:
    folder = tmp_path_factory.mktemp("runs")
    return rig.execute("motor-tare", folder=folder, seed=9920, operator="A", **SHORT, **TIMES)


def test_a_protocol_leaves_a_run_file_with_its_parameters(run: rig.Run) -> None:
    assert run.outcome == "COMPLETED"
    assert run.path is not None
    assert run.path.is_file()
    assert run.metadata.parameters["points"] == 4
    assert run.metadata.operator == "A"
    assert run.metadata.process["seed"] == 9920
    assert run.segments.labelled("hold")


def test_the_same_seed_gives_the_same_counts_from_another_thread(
    run: rig.Run, tmp_path: Path
) -> None:
    again: list[rig.Run] = []

    def work() -> None:
        made = rig.execute("motor-tare", folder=tmp_path, seed=9920, **SHORT, **TIMES)
        again.append(made)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert (again[0].recording.stored("torque") == run.recording.stored("torque")).all()


def test_a_gear_is_turned_by_degrees_and_for_one_version_by_radians(tmp_path: Path) -> None:
    def turned(**world: Any) -> float:
        made = rig.execute("motor-tare", folder=tmp_path, world=world, **SHORT, **TIMES)
        return float(made.metadata.process["world"]["mount_turn"])

    assert turned(mount=2, mount_turn_deg=30.0) == pytest.approx(math.pi / 6.0)
    with pytest.warns(DeprecationWarning, match="mount_turn_deg") as warned:
        assert turned(mount_turn=0.5) == 0.5
    assert warned[0].filename == __file__
    with pytest.raises(rig.WordedError, match="stated twice"):
        turned(mount_turn=0.5, mount_turn_deg=30.0)


def test_what_the_protocol_does_not_have_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(rig.WordedError, match="speed_of_light"):
        rig.execute("motor-tare", folder=tmp_path, speed_of_light=3e8)
    with pytest.raises(PlanError, match="no such protocol"):
        rig.execute("motor-tear", folder=tmp_path)
    assert not list(tmp_path.glob("*.h5"))


def test_a_report_of_a_run_and_of_a_result(run: rig.Run, tmp_path: Path) -> None:
    page = rig.report(run, tmp_path / "run.html")
    assert "SIMULATED" in page.read_text(encoding="utf-8")
    result = rig.fit(run)
    page = rig.report([result], tmp_path / "result.html", note="A note of the author.")
    assert "A note of the author." in page.read_text(encoding="utf-8")
    with pytest.raises(rig.WordedError, match="nothing to report"):
        rig.report([], tmp_path / "nothing.html")
