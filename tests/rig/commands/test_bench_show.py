"""What a described bench knows of itself: its stated calibrations, and what was commissioned of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.bench.backends.registry import HARDWARE
from rig.bench.commissioning import StageDone, keep
from rig.bench.config.examples import example_text
from rig.bench.identity import bench_of, new_bench_id
from tests.rig.commands.calling import Rig


def test_calibrations_and_stages_of_a_described_bench_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, runs, config = Rig(capsys), tmp_path / "runs", tmp_path / "rig.toml"
    runs.mkdir()
    text = example_text("paper-sgdv")
    config.write_text(text.replace('id = ""         ', f'id = "{new_bench_id()}"', 1))
    bench = bench_of(HARDWARE, runs, config)
    for at, passed in (("2026-03-01T08:00:00+00:00", False), ("2026-03-01T09:00:00+00:00", True)):
        keep(
            bench.state,
            StageDone(stage="read", at=at, operator="A", passed=passed, description="0" * 64),
        )
    told = rig.json("bench", "show", "--runs", runs, "--config", config)
    assert {
        "channel": "motor_encoder",
        "certificate": "none: accuracy from the data sheet",
        "due": "",
    } in told["stated"]
    (stage,) = told["commissioned"]
    assert (stage["stage"], stage["passed"], stage["operator"]) == ("read", True, "A")
    assert rig("bench", "show", "--runs", runs, "--config", config) == 0
    assert "Commissioned" in rig.out
    # A description of alarms alone is no bench.
    config.write_text('[alarms]\ngolden_gear = ""\n')
    assert rig("bench", "show", "--runs", runs, "--config", config) == 2
