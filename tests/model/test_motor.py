"""The servo motor's parameter set."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from model.errors import ParameterError
from model.motor import load_motor, motor_from_mapping, shipped_motor
from model.quantities import quote, section_lines
from model.units import RPM

MOTOR = shipped_motor()


def test_shipped_motor_in_si() -> None:
    assert MOTOR.name == "SGMJV-02"
    assert (MOTOR.rated_torque, MOTOR.peak_torque, MOTOR.rotor_inertia) == (0.637, 2.23, 0.259e-4)
    friction = MOTOR.coulomb_friction + MOTOR.viscous_friction * 1000.0 * RPM
    assert friction == pytest.approx(0.016, rel=1e-12)
    assert all(origin.source for origin in MOTOR.origins.values())


def test_motor_reads_back_exactly(tmp_path: Path) -> None:
    lines = ['format = "servo-motor-1"', f"name = {quote(MOTOR.name)}", "[motor]"]
    lines += section_lines(MOTOR, MOTOR.origins)
    path = tmp_path / "motor.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert load_motor(path) == MOTOR


def test_impossible_motors_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"motor\.peak_torque"):
        dataclasses.replace(MOTOR, peak_torque=0.1)
    with pytest.raises(ParameterError, match="no such shipped motor"):
        shipped_motor("sgmjv-99")
    with pytest.raises(ParameterError, match="format"):
        motor_from_mapping({"format": "harmonic-drive-1"}, "x")
    with pytest.raises(ParameterError, match=r"motor\.rated_torque: is missing"):
        motor_from_mapping({"format": "servo-motor-1", "name": "M", "motor": {}}, "x")
