"""Friction laws: units, branches, symmetry, and the two torque balances."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.friction import (
    bearing_friction_torque,
    bearing_magnitude,
    conversion_factor,
    friction_torque,
    mesh_friction_force,
    mesh_lever,
    speed_sign,
    stribeck_magnitude,
)
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from model.sections import MeshFriction
from model.units import RPM

GEAR = shipped_gear()


def with_options(gear: HarmonicDrive, **options: object) -> HarmonicDrive:
    return dataclasses.replace(gear, options=dataclasses.replace(gear.options, **options))


def test_bearing_torque_uses_revolutions_per_minute() -> None:
    assert bearing_friction_torque(GEAR, 3000.0 * RPM) == pytest.approx(0.0724, abs=5e-5)
    in_newton_millimetre = 1e-7 * 2.0 * (40.0 * 3000.0) ** (2.0 / 3.0) * 53.0**3
    assert bearing_friction_torque(GEAR, 3000.0 * RPM) == pytest.approx(
        1e-3 * in_newton_millimetre, rel=1e-12
    )


def test_low_speed_branch_is_flat_and_continuous() -> None:
    meeting = 2000.0 / 40.0 * RPM
    below, above = bearing_magnitude(GEAR.bearing, [meeting * (1.0 - 1e-9), meeting * (1.0 + 1e-9)])
    assert below == pytest.approx(above, rel=1e-8)
    assert below == pytest.approx(16.0 * 2.0 * 0.053**3, rel=0.01)
    assert bearing_magnitude(GEAR.bearing, 0.0) == below
    assert bearing_magnitude(GEAR.bearing, 0.0, low_speed_branch=False) == 0.0
    published = with_options(GEAR, low_speed_branch=False)
    assert bearing_friction_torque(published, 1.0 * RPM) < bearing_friction_torque(GEAR, 1.0 * RPM)


def test_stribeck_curve_falls_and_rises() -> None:
    mesh = GEAR.mesh_friction
    assert stribeck_magnitude(mesh, 0.0) == mesh.static
    assert stribeck_magnitude(mesh, 6.0) == pytest.approx(
        70.0 + 25.0 / math.e + 0.15 * 6.0, rel=1e-12
    )
    speeds = np.array([1, 3, 10, 30, 60, 120, 300, 1000, 3000]) * RPM
    torque = friction_torque(GEAR, speeds)
    lowest = int(np.argmin(torque))
    assert speeds[lowest] in (60.0 * RPM, 120.0 * RPM, 30.0 * RPM)
    assert torque[0] > torque[lowest] < torque[-1]
    assert 0.045 < torque.min() < torque.max() < 0.135


@given(
    speed=st.floats(0.0, 700.0),
    balance=st.sampled_from(["energy", "published"]),
    branch=st.booleans(),
)
def test_friction_is_odd_in_speed(speed: float, balance: str, branch: bool) -> None:
    gear = with_options(GEAR, torque_balance=balance, low_speed_branch=branch)
    assert friction_torque(gear, -speed) == -friction_torque(gear, speed)
    assert mesh_friction_force(gear, -speed) == -mesh_friction_force(gear, speed)
    assert friction_torque(gear, speed) * speed >= 0.0


def test_no_friction_at_rest_and_smooth_sign() -> None:
    assert friction_torque(GEAR, 0.0) == 0.0
    assert speed_sign(0.1, 0.1) == pytest.approx(math.tanh(1.0))
    assert speed_sign(-3.0, 0.1) == pytest.approx(-1.0)


def test_torque_of_equation_2_at_1000_rpm() -> None:
    speed = 1000.0 * RPM
    mesh = mesh_lever(GEAR, "energy") * mesh_friction_force(GEAR, speed)
    wedge = bearing_friction_torque(GEAR, speed) / GEAR.ratio + mesh
    assert wedge == pytest.approx(0.044573, abs=5e-7)


def test_energy_balance_is_the_power_lost() -> None:
    speed = 500.0 * RPM
    drag, force = bearing_friction_torque(GEAR, speed), mesh_friction_force(GEAR, speed)
    lost = drag * speed + drag * speed / GEAR.ratio + force * speed * mesh_lever(GEAR, "energy")
    assert friction_torque(GEAR, speed) * speed == pytest.approx(lost, rel=1e-12)


def test_published_balance_is_equation_20_verbatim() -> None:
    published = with_options(GEAR, torque_balance="published")
    speed = 500.0 * RPM
    expected = bearing_friction_torque(GEAR, speed)
    expected += mesh_friction_force(GEAR, speed) * 0.0635 * math.sin(math.radians(30.0)) / 240.0
    assert friction_torque(published, speed) == pytest.approx(expected, rel=1e-12)
    assert friction_torque(GEAR, speed, "published") == pytest.approx(expected, rel=1e-12)


def test_the_factor_between_the_balances_keeps_the_mesh_torque() -> None:
    assert conversion_factor(GEAR) == pytest.approx(3.906, abs=5e-4)
    published = with_options(GEAR, torque_balance="published")
    factors = [mesh_lever(gear) for gear in (GEAR, published)]
    assert factors[0] == pytest.approx(conversion_factor(GEAR) * factors[1], rel=1e-12)


def test_friction_may_rise_from_rest() -> None:
    """F_s < F_c: no Stribeck dip, and the curve never falls."""
    mesh = MeshFriction(coulomb=1.0, static=0.6, stribeck_velocity=4.0, shape=1.0, viscous=0.01)
    force = stribeck_magnitude(mesh, np.linspace(0.0, 40.0, 400))
    assert force[0] == 0.6
    assert np.all(np.diff(force) > 0.0)
