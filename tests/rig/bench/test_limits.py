"""Limits in tiers, against arithmetic done by hand."""

import math

import pytest

from model.gear import Origin
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.limits import Load, derive_limits, kinematic_error_margin, load_of, torsion_stiffness
from rig.errors import ConfigurationError

GEAR, MOTOR = shipped_gear(), shipped_motor()


def test_full_motor_torque_would_exceed_the_repeated_peak() -> None:
    assert MOTOR.peak_torque * GEAR.ratio == pytest.approx(267.6)
    assert GEAR.ratings.repeated_peak_torque < MOTOR.peak_torque * GEAR.ratio
    limits = derive_limits(GEAR, MOTOR)
    held = limits.tightest(lim.MOTOR_TORQUE)
    assert held is not None
    assert held.tier == "rig"
    assert held.value == pytest.approx(0.8 * 167.0 / 120.0)
    assert held.value * GEAR.ratio < GEAR.ratings.repeated_peak_torque
    assert held.provenance == "computed"


def test_a_full_torque_step_with_a_heavy_load_reaches_180_newton_metres() -> None:
    heavy = GEAR.with_values({"inertia.output": 0.5}, Origin("assumed"))
    load = load_of(heavy, MOTOR, "circular-spline-fixed")
    peak = lim.STEP_FACTOR * load.ratio * MOTOR.peak_torque * load.output_share
    assert peak == pytest.approx(183.0, abs=2.0)
    steps = [
        e for e in derive_limits(heavy, MOTOR).of(lim.MOTOR_TORQUE) if "torque step" in e.origin
    ]
    assert steps[0].value == pytest.approx(MOTOR.peak_torque * 0.8 * 167.0 / peak, rel=1e-3)


def test_acceleration_leaves_the_motor_its_friction_and_the_gear_its_torque() -> None:
    limits = derive_limits(GEAR, MOTOR)
    load = load_of(GEAR, MOTOR, "circular-spline-fixed")
    inertia = 2.59e-5 + 4.13e-5 + 0.1 / 120.0**2
    assert load.total_inertia == pytest.approx(inertia)
    friction = 0.012 + 0.004 * 3.0 + 0.1
    expected = (0.8 * 0.8 * 167.0 / 120.0 - friction) / inertia
    assert limits.value(lim.ACCELERATION) == pytest.approx(expected)
    assert load.gear_torque(limits.value(lim.ACCELERATION)) < 0.8 * 167.0
    gear_bound = [e.value for e in limits.of(lim.ACCELERATION) if e.tier == "rig"]
    assert gear_bound == [pytest.approx(0.8 * 167.0 * 120.0 / (2.0 * 0.1))]


@pytest.mark.parametrize("inertia", [0.02, 0.1, 0.5, 20.0])
def test_no_allowed_ramp_brings_the_gear_near_its_peak(inertia: float) -> None:
    loaded = GEAR.with_values({"inertia.output": inertia}, Origin("assumed"))
    limits, load = derive_limits(loaded, MOTOR), load_of(loaded, MOTOR, "circular-spline-fixed")
    for quantity in (lim.ACCELERATION, lim.DECELERATION, lim.QUICK_STOP_DECELERATION):
        assert load.gear_torque(limits.value(quantity)) <= 0.8 * 167.0
        assert load.total_inertia * limits.value(quantity) <= limits.value(lim.MOTOR_TORQUE)


def test_flexspline_fixed_has_one_more_turn() -> None:
    limits = derive_limits(GEAR, MOTOR, "flexspline-fixed")
    assert limits.value(lim.MOTOR_TORQUE) == pytest.approx(0.8 * 167.0 / 121.0)


def test_the_bare_motor_knows_no_gear() -> None:
    limits = derive_limits(GEAR, MOTOR, gear_mounted=False)
    assert limits.value(lim.MOTOR_TORQUE) == MOTOR.peak_torque
    assert limits.tightest(lim.TORSION_TORQUE) is None
    assert math.isinf(limits.value(lim.TORSION_TORQUE))
    assert load_of(GEAR, MOTOR, "circular-spline-fixed", gear_mounted=False) == Load(
        MOTOR.rotor_inertia, 0.0, 1.0
    )


def test_the_tightest_of_three_tiers_holds_and_names_itself() -> None:
    limits = derive_limits(
        GEAR, MOTOR, plan_speed=100.0 * RPM, configured={lim.INPUT_SPEED: 2000.0 * RPM}
    )
    speeds = limits.of(lim.INPUT_SPEED)
    assert [entry.tier for entry in speeds] == ["protocol", "rig", "rig", "drive"]
    assert speeds[0].value == pytest.approx(1.25 * 100.0 * RPM + 5.0)
    assert speeds[1].value == pytest.approx(2000.0 * RPM)
    assert speeds[2].value == pytest.approx(5600.0 * RPM)
    assert speeds[3].value == pytest.approx(6000.0 * RPM)
    assert limits.drive_limits().speed == speeds[0].value
    shown = limits.as_json()[lim.INPUT_SPEED]
    assert shown["tier"] == "protocol"
    assert len(shown["tiers"]) == 4


@pytest.mark.parametrize(
    ("name", "value"), [("no_such", 1.0), (lim.INPUT_SPEED, 0.0), (lim.INPUT_SPEED, math.nan)]
)
def test_a_wrong_configured_limit_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ConfigurationError, match=rf"limits\.{name}"):
        derive_limits(GEAR, MOTOR, configured={name: value})


def test_torsion_is_judged_cautiously() -> None:
    assert torsion_stiffness(GEAR) >= GEAR.ratings.stiffness_3
    amplitude = sum(h.amplitude for h in GEAR.kinematic_error)
    assert kinematic_error_margin(GEAR) == pytest.approx(2.0 * amplitude)
    assert kinematic_error_margin(GEAR) >= GEAR.ratings.transmission_accuracy
    assert derive_limits(GEAR, MOTOR).value(lim.TORSION_TORQUE) == pytest.approx(0.95 * 167.0)


def test_a_disc_on_the_bare_motor_slows_the_ramps_that_are_allowed() -> None:
    disc = 3.0 * MOTOR.rotor_inertia
    bare, loaded = (
        derive_limits(GEAR, MOTOR, gear_mounted=False, disc_inertia=inertia)
        for inertia in (0.0, disc)
    )
    for quantity in (lim.ACCELERATION, lim.QUICK_STOP_DECELERATION):
        assert loaded.value(quantity) == pytest.approx(bare.value(quantity) / 4.0)
    assert loaded.value(lim.MOTOR_TORQUE) == bare.value(lim.MOTOR_TORQUE)
