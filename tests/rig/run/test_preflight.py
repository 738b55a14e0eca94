"""What is looked at before anything moves: a folder is tried, not asked for its permissions."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.finding import Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.dry_run import PlannedRun
from rig.run.preflight import static_checks
from rig.run.start import plan_order


def planned(folder: Path) -> PlannedRun:
    """A short run that would be kept in a folder."""
    gear, motor = shipped_gear(), shipped_motor()
    request = Order(protocol="starting-torque", gear=gear, motor=motor, folder=folder)
    return plan_order(request)


def test_a_folder_that_cannot_be_written_fails_and_says_nothing_of_space(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(dir: Path) -> None:
        raise OSError(30, "Read-only file system")

    run = planned(tmp_path)
    before = {check.what: check.severity for check in static_checks(run, tmp_path)}
    assert before["disk space"] == "passed"
    monkeypatch.setattr("rig.run.preflight.tempfile.TemporaryFile", refuse)
    checks = {check.what: check for check in static_checks(run, tmp_path / "new" / "runs")}
    assert checks["folder"].severity is Severity.BLOCKS
    assert f"{tmp_path} cannot be written (Read-only file system)" in checks["folder"].found
    assert "disk space" not in checks
