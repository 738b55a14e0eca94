"""Motors from their plates: what is stated stays, what is not is marked, and wrong units are found by name."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from model.catalogue.motors import motor_contradictions, motor_named, open_questions
from model.errors import ParameterError
from model.gear import Origin
from model.motor import load_motor, save_motor, shipped_motor

PLATE = Origin("catalogue", "nameplate")


@pytest.mark.parametrize("torque", [0.05, 0.637, 3.0, 50.0])
def test_the_rated_torque_alone_makes_a_set_that_loads_and_contradicts_nothing(
    torque: float, tmp_path: Path
) -> None:
    made = motor_named("M", {"rated_torque": torque}, PLATE)
    save_motor(made, tmp_path / "m.toml")
    assert load_motor(tmp_path / "m.toml") == made
    assert motor_contradictions(made) == ()
    assert made.origins["rated_torque"] == PLATE
    assert "rated_torque" not in open_questions(made)
    assert "rotor_inertia" in open_questions(made)


def test_the_pattern_is_its_own_relative() -> None:
    pattern = shipped_motor()
    assert motor_contradictions(pattern) == ()
    made = motor_named("M", {"rated_torque": pattern.rated_torque}, PLATE)
    for name in ("peak_torque", "rotor_inertia", "coulomb_friction", "torque_constant"):
        assert getattr(made, name) == getattr(pattern, name)


def test_without_a_rated_torque_nothing_is_made() -> None:
    with pytest.raises(ParameterError, match=r"motor\.rated_torque.*has to be stated"):
        motor_named("M", {"peak_torque": 1.0}, PLATE)


@pytest.mark.parametrize(
    ("field", "factor", "name"),
    [
        ("rated_current", 1.6, "torque constant against rated current"),
        ("peak_current", 2.0, "torque constant against peak current"),
        ("peak_torque", 2.0, "peak against rated torque"),
        ("maximum_speed", 9.55, "maximum against rated speed"),
        ("rotor_inertia", 1e-3, "rotor's inertia against rated torque"),
        ("coulomb_friction", 20.0, "friction against rated torque"),
    ],
)
def test_each_contradiction_is_found_by_name(field: str, factor: float, name: str) -> None:
    motor = shipped_motor()
    wrong = dataclasses.replace(motor, **{field: getattr(motor, field) * factor})
    assert name in {c.name for c in motor_contradictions(wrong)}
