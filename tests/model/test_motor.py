"""The servo motor's parameter set."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from model.errors import ParameterError
from model.motor import load_motor, motor_from_mapping, motor_to_mapping, save_motor, shipped_motor
from model.units import RPM

MOTOR = shipped_motor()


def test_shipped_motor_in_si() -> None:
    assert MOTOR.name == "SGMJV-02"
    assert (MOTOR.rated_torque, MOTOR.peak_torque, MOTOR.rotor_inertia) == (0.637, 2.23, 0.259e-4)
    friction = MOTOR.coulomb_friction + MOTOR.viscous_friction * 1000.0 * RPM
    assert friction == pytest.approx(0.016, rel=1e-12)
    assert all(origin.source for origin in MOTOR.origins.values())


def test_motor_reads_back_exactly(tmp_path: Path) -> None:
    save_motor(MOTOR, tmp_path / "motor.toml")
    assert load_motor(tmp_path / "motor.toml") == MOTOR
    assert motor_from_mapping(json.loads(json.dumps(motor_to_mapping(MOTOR))), "run") == MOTOR


def test_impossible_motors_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"motor\.peak_torque"):
        dataclasses.replace(MOTOR, peak_torque=0.1)
    with pytest.raises(ParameterError, match="no such shipped motor"):
        shipped_motor("sgmjv-99")
    with pytest.raises(ParameterError, match="format"):
        motor_from_mapping({"format": "harmonic-drive-1"}, "x")
    with pytest.raises(ParameterError, match=r"motor\.rated_torque: is missing"):
        motor_from_mapping({"format": "servo-motor-1", "name": "M", "motor": {}}, "x")
