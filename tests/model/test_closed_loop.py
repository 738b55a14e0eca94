"""The closed loop: exact stick, energy, friction law, agreement with equation 2, limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model import friction
from model.closed_loop import (
    OFF,
    QUICK_STOP,
    SPEED,
    TORQUE,
    ClosedLoop,
    Deviations,
    LoopSettings,
    ServoLimits,
    Thermal,
)
from model.dynamics import simulate_prescribed
from model.errors import ModelError
from model.gear import Harmonic, HarmonicDrive
from model.gear_file import shipped_gear
from model.kernels import loop_layout as at
from model.kinematic_error import series_value
from model.loop_tables import common_period
from model.motor import shipped_motor
from model.units import ARCSEC, RPM

GEAR, MOTOR = shipped_gear(), shipped_motor()
SMOOTH = dict.fromkeys(
    (
        "mesh_friction.coulomb",
        "mesh_friction.static",
        "mesh_friction.viscous",
        "bearing.friction_factor",
    ),
    0.0,
)
FRICTIONLESS = GEAR.with_values(SMOOTH)


def without_error(gear: HarmonicDrive) -> HarmonicDrive:
    import dataclasses

    return dataclasses.replace(gear, kinematic_error=())


def turning(
    loop: ClosedLoop, speed: float, cycles: int = 2000, angle: float = 0.3
) -> tuple[np.ndarray, np.ndarray]:
    """State and rows after a set-point was held for some cycles from rest, and then for as many again."""
    state = loop.rest(angle)
    loop.advance(state, SPEED, np.full(cycles, speed))
    return state, loop.advance(state, SPEED, np.full(cycles, speed))


@pytest.mark.parametrize("output_inertia", [0.02, 0.1, 1.0])
def test_hold_is_exactly_zero_speed(output_inertia: float) -> None:
    loop = ClosedLoop(GEAR.with_values({"inertia.output": output_inertia}), MOTOR)
    state, _ = turning(loop, 300.0 * RPM, 500)
    loop.advance(state, SPEED, np.zeros(500))
    held = loop.advance(state, SPEED, np.zeros(500))
    assert np.all(held[:, at.ROW_INPUT_SPEED] == 0.0)
    assert np.ptp(held[:, at.ROW_INPUT_ANGLE]) == 0.0
    assert np.ptp(held[:, at.ROW_TORQUE_REFERENCE]) < 1e-12


@pytest.mark.parametrize("speed_rpm", [0.3, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_chatter_at_creeping_speed(speed_rpm: float, sign: float) -> None:
    loop = ClosedLoop(GEAR, MOTOR)
    state = loop.rest(0.3)
    target = sign * speed_rpm * RPM
    loop.advance(state, SPEED, np.full(4000, target))
    fine = ClosedLoop(GEAR, MOTOR, settings=LoopSettings(cycle=125e-6))
    speed = fine.advance(state, SPEED, np.full(16000, target))[:, at.ROW_INPUT_SPEED]
    assert np.all(speed * sign > 0.0)
    assert np.max(np.abs(np.diff(speed))) < 1e-4 * abs(target)
    # Friction changes by 1.6 mN m over the revolution; a PI loop follows such a slope with a small speed error.
    assert np.mean(speed) == pytest.approx(target, rel=2e-2)


def energy(loop: ClosedLoop, state: np.ndarray) -> float:
    """Kinetic and elastic energy of the four masses [J]."""
    p = loop.parameters
    s, c, radius = math.sin(p.tooth_angle), math.cos(p.tooth_angle), p.neutral_radius
    w, r2, v2, r1, u1, ro, uo = state[:7]
    flexspline, output = p.flexspline_inertia / radius**2, p.output_inertia / radius**2
    moving = loop.rotor_inertia * w**2 + flexspline * (v2**2 + u1**2) + output * uo**2
    wound = (
        p.bearing_stiffness * (state[at.ERROR] - r2) ** 2
        + p.mesh_stiffness * (r2 * s - r1 * c) ** 2
    )
    return 0.5 * float(moving + wound + p.cup_stiffness / radius**2 * (r1 - ro) ** 2)


def spinning(loop: ClosedLoop, speed: float) -> np.ndarray:
    """A state that turns freely, every mass at the speed that the wedge asks of it."""
    state = loop.rest(0.2)
    p = loop.parameters
    wedge = (p.radial_lever / p.ratio + state[at.SLOPE]) * speed
    state[at.W], state[at.V2] = speed, wedge
    state[at.U1] = state[at.UO] = wedge * math.tan(p.tooth_angle)
    return state


@pytest.mark.parametrize(("speed_rpm", "drift"), [(100.0, 5e-6), (1000.0, 5e-6), (3000.0, 5e-5)])
def test_energy_is_kept_without_friction(speed_rpm: float, drift: float) -> None:
    """The reaction of the error on the rotor is what keeps it: without de/dtheta it drifts by 1e-3."""
    loop = ClosedLoop(
        FRICTIONLESS.with_values({"bearing.damping": 0.0}), MOTOR, Deviations(motor_friction=False)
    )
    state = spinning(loop, speed_rpm * RPM)
    start = energy(loop, state)
    found = []
    for _ in range(300):
        loop.advance(state, OFF, np.zeros(10))
        found.append(energy(loop, state) / start - 1.0)
    assert np.max(np.abs(found)) < drift


def test_friction_takes_exactly_what_the_motion_gives() -> None:
    """Work of the motor = change of energy + friction torque over angle, with no other loss in the system."""
    loop = ClosedLoop(
        without_error(GEAR).with_values({"bearing.damping": 0.0}),
        MOTOR,
        settings=LoopSettings(cycle=125e-6),
    )
    state = loop.rest()
    rows = loop.advance(state, SPEED, np.full(8000, 500.0 * RPM))
    moved = np.diff(rows[:, at.ROW_INPUT_ANGLE])
    # Reference and friction of a step stand in the next row, because a row is written before its step.
    motor = np.sum(rows[1:, at.ROW_TORQUE_REFERENCE] * moved)
    lost = np.sum(rows[1:, at.ROW_FRICTION] * moved)
    kinetic = 0.5 * (
        loop.rotor_inertia * rows[-1, 1] ** 2 + loop.gear.inertia.output * rows[-1, 4] ** 2
    )
    assert motor - lost == pytest.approx(kinetic, rel=2e-3)


@pytest.mark.parametrize("speed_rpm", [1.0, 60.0, 1000.0, 3000.0])
@pytest.mark.parametrize("balance", ["energy", "published"])
def test_mean_torque_is_the_friction_law(speed_rpm: float, balance: str) -> None:
    import dataclasses

    gear = without_error(GEAR)
    gear = dataclasses.replace(
        gear, options=dataclasses.replace(gear.options, torque_balance=balance)
    )
    _, rows = turning(ClosedLoop(gear, MOTOR), -speed_rpm * RPM, 3000)
    speed = speed_rpm * RPM
    law = (
        float(friction.friction_torque(gear, speed))
        + MOTOR.coulomb_friction
        + MOTOR.viscous_friction * speed
    )
    assert -np.mean(rows[:, at.ROW_TORQUE_REFERENCE]) == pytest.approx(law, rel=2e-5)


@pytest.mark.parametrize("speed_rpm", [60.0, 1000.0, 3000.0])
def test_output_agrees_with_equation_2_under_the_same_input(speed_rpm: float) -> None:
    loop = ClosedLoop(FRICTIONLESS, MOTOR, settings=LoopSettings(cycle=125e-6, step=62.5e-6))
    rows = loop.advance(loop.rest(0.3), SPEED, np.full(6000, speed_rpm * RPM))
    answer = simulate_prescribed(
        FRICTIONLESS,
        rows[:, at.ROW_INPUT_ANGLE],
        125e-6,
        input_speed=rows[:, at.ROW_INPUT_SPEED],
    )
    difference = rows[:, at.ROW_OUTPUT_ANGLE] - answer.output_angle
    assert np.max(np.abs(difference)) < 0.1 * ARCSEC
    assert (
        np.max(np.abs(rows[:, at.ROW_OUTPUT_SPEED] - answer.output_speed))
        < 1e-3 * speed_rpm * RPM / 120.0
    )


def test_windup_by_friction_is_that_of_equation_2() -> None:
    """Friction on the rotor with a static lag of the output, against friction inside the chain."""
    loop = ClosedLoop(GEAR, MOTOR, Deviations(friction_windup=True), LoopSettings(cycle=125e-6))
    rows = loop.advance(loop.rest(0.3), SPEED, np.full(16000, 60.0 * RPM))
    answer = simulate_prescribed(
        GEAR, rows[:, at.ROW_INPUT_ANGLE], 125e-6, input_speed=rows[:, at.ROW_INPUT_SPEED]
    )
    late = slice(12000, None)
    difference = rows[late, at.ROW_OUTPUT_ANGLE] - answer.output_angle[late]
    lag = np.mean(rows[late, at.ROW_OUTPUT_ANGLE] - rows[late, at.ROW_INPUT_ANGLE] / 120.0)
    ideal = np.mean(series_value(GEAR.kinematic_error, rows[late, at.ROW_INPUT_ANGLE]))
    assert lag - ideal < -2.0 * ARCSEC
    assert abs(np.mean(difference)) < 0.02 * ARCSEC


def test_cutting_into_blocks_changes_nothing() -> None:
    extra = Deviations(
        kinematic_error=(Harmonic(1 / 120, 2e-5, 0.0),),
        friction_windup=True,
        mesh_depth=0.1,
        hardening=True,
        hysteresis_torque=0.3,
        hysteresis_stiffness=0.01,
        output_coulomb=0.5,
        output_viscous=0.4,
        motor_friction=True,
        cogging=(Harmonic(24.0, 2e-3, 0.0),),
        torque_constant_error=0.01,
        port_lag=4e-4,
        thermal=Thermal(),
    )
    loop = ClosedLoop(GEAR, MOTOR, extra)
    target = 200.0 * np.sin(np.linspace(0.0, 9.0, 700))
    whole_state, cut_state = loop.rest(0.1), loop.rest(0.1)
    whole = loop.advance(whole_state, SPEED, target)
    cut = np.concatenate(
        [loop.advance(cut_state, SPEED, target[k : k + 7]) for k in range(0, 700, 7)]
    )
    assert np.array_equal(whole, cut)
    assert np.array_equal(whole_state, cut_state)


def test_torque_limit_and_acceleration_limit() -> None:
    loop = ClosedLoop(GEAR, MOTOR)
    loop.set_limits(ServoLimits(0.9, 500.0, acceleration=2000.0, deceleration=1000.0))
    state = loop.rest()
    up = loop.advance(state, SPEED, np.full(300, 3000.0 * RPM))
    assert np.max(np.abs(up[:, at.ROW_TORQUE_REFERENCE])) <= 0.9
    assert np.max(np.diff(up[:, at.ROW_SPEED_REFERENCE])) == pytest.approx(2.0)
    down = loop.advance(state, SPEED, np.zeros(300))
    assert np.min(np.diff(down[:, at.ROW_SPEED_REFERENCE])) == pytest.approx(-1.0)


def test_full_step_saturates_and_does_not_wind_up() -> None:
    rows = ClosedLoop(GEAR, MOTOR).advance(
        ClosedLoop(GEAR, MOTOR).rest(), SPEED, np.full(500, 3000.0 * RPM)
    )
    speed = rows[:, at.ROW_INPUT_SPEED] / RPM
    assert np.max(rows[:, at.ROW_TORQUE_REFERENCE]) == pytest.approx(MOTOR.peak_torque, rel=1e-2)
    assert np.max(speed) < 1.08 * 3000.0
    assert abs(np.mean(speed[-100:]) - 3000.0) < 10.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_speed_limit_in_torque_mode(sign: float) -> None:
    loop = ClosedLoop(GEAR, MOTOR)
    loop.set_limits(ServoLimits(MOTOR.peak_torque, 100.0))
    rows = loop.advance(loop.rest(), TORQUE, np.full(2000, sign * 0.6))
    speed = sign * rows[:, at.ROW_INPUT_SPEED]
    assert 90.0 < np.mean(speed[-500:]) < 100.0
    assert np.max(speed) < 110.0


def test_torque_below_stiction_does_not_move_and_above_does() -> None:
    loop = ClosedLoop(GEAR, MOTOR)
    static = float(friction.mesh_lever(GEAR)) * GEAR.mesh_friction.static
    static += float(friction.bearing_lever(GEAR)) * float(
        friction.bearing_magnitude(GEAR.bearing, 0.0)
    )
    static += MOTOR.coulomb_friction
    still = loop.advance(loop.rest(), TORQUE, np.full(500, 0.99 * static))
    assert np.all(still[:, at.ROW_INPUT_SPEED] == 0.0)
    assert np.all(still[:, at.ROW_INPUT_ANGLE] == 0.0)
    moved = loop.advance(loop.rest(), TORQUE, np.full(500, 1.02 * static))
    assert moved[-1, at.ROW_INPUT_SPEED] > 0.0


def test_quick_stop_follows_its_own_ramp_and_holds() -> None:
    loop = ClosedLoop(GEAR, MOTOR)
    loop.set_limits(ServoLimits(MOTOR.peak_torque, 600.0, quick_stop_deceleration=500.0))
    state, _ = turning(loop, 1000.0 * RPM, 500)
    rows = loop.advance(state, QUICK_STOP, np.zeros(600))
    slope = np.polyfit(np.arange(100) * 1e-3, rows[50:150, at.ROW_INPUT_SPEED], 1)[0]
    assert slope == pytest.approx(-500.0, rel=0.02)
    assert np.all(rows[-100:, at.ROW_INPUT_SPEED] == 0.0)


def test_servo_off_makes_no_torque_and_coasts() -> None:
    loop = ClosedLoop(GEAR, MOTOR)
    state, _ = turning(loop, 600.0 * RPM, 500)
    rows = loop.advance(state, OFF, np.zeros(400))
    assert np.all(rows[1:, at.ROW_TORQUE_REFERENCE] == 0.0)
    assert rows[-1, at.ROW_INPUT_SPEED] == 0.0


@pytest.mark.parametrize("output_inertia", [0.02, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("speed_rpm", [0.3, 300.0, 3000.0])
def test_stable_for_other_loads(output_inertia: float, speed_rpm: float) -> None:
    loop = ClosedLoop(GEAR.with_values({"inertia.output": output_inertia}), MOTOR)
    _, rows = turning(loop, speed_rpm * RPM, 3000)
    speed = rows[:, at.ROW_INPUT_SPEED]
    # Whole revolutions do not fit into the record, and friction varies with the angle.
    assert np.mean(speed[-1000:]) == pytest.approx(speed_rpm * RPM, rel=1e-2)
    assert np.max(np.abs(rows[:, at.ROW_WINDUP_TORQUE])) < GEAR.ratings.repeated_peak_torque


def test_lightly_damped_gear_stays_bounded() -> None:
    gear = GEAR.with_values({"bearing.damping": 1100.0})
    _, rows = turning(ClosedLoop(gear, MOTOR), 3000.0 * RPM, 5000)
    assert np.max(np.abs(rows[:, at.ROW_INPUT_SPEED])) < 3300.0 * RPM


def test_hardening_raises_the_stiffness_beyond_the_knees() -> None:
    gear = without_error(GEAR)
    loop = ClosedLoop(gear, MOTOR, Deviations(hardening=True))
    stiffness, ratings = loop.parameters.combined_stiffness, gear.ratings
    angles = []
    for load in (10.0, 30.0, 40.0, 60.0, 70.0):
        state = loop.rest()
        state[at.LOAD] = load
        # The rotor is held by friction and the servo; the last rows are at rest.
        rows = loop.advance(state, SPEED, np.zeros(6000))[-1]
        angles.append(rows[at.ROW_INPUT_ANGLE] / 120.0 - rows[at.ROW_OUTPUT_ANGLE])
        assert rows[at.ROW_WINDUP_TORQUE] == pytest.approx(load, rel=1e-3)
    assert 10.0 / angles[0] == pytest.approx(stiffness, rel=1e-3)
    second, third = 10.0 / (angles[2] - angles[1]), 10.0 / (angles[4] - angles[3])
    assert second == pytest.approx(stiffness * ratings.stiffness_2 / ratings.stiffness_1, rel=5e-3)
    assert third == pytest.approx(stiffness * ratings.stiffness_3 / ratings.stiffness_1, rel=5e-3)


def test_hysteresis_opens_a_loop_and_only_it_does() -> None:
    def width(extra: Deviations) -> float:
        loop = ClosedLoop(without_error(GEAR), MOTOR, extra)
        state = loop.rest()
        down, up = np.linspace(20.0, -20.0, 1000), np.linspace(-20.0, 20.0, 1000)
        wound = []
        for load in np.concatenate([np.linspace(0.0, 20.0, 500), down, up]):
            state[at.LOAD] = load
            rows = loop.advance(state, SPEED, np.zeros(1))
            wound.append(rows[0, at.ROW_INPUT_ANGLE] / 120.0 - rows[0, at.ROW_OUTPUT_ANGLE])
        return float(np.interp(0.0, -down, wound[500:1500]) - np.interp(0.0, up, wound[1500:]))

    opened = width(Deviations(hysteresis_torque=0.3, hysteresis_stiffness=0.05))
    assert opened > 1.0 * ARCSEC
    assert abs(width(Deviations())) < 0.1 * opened


def test_output_bearing_adds_its_torque_over_the_ratio_and_sticks() -> None:
    gear = without_error(GEAR)
    plain = turning(ClosedLoop(gear, MOTOR), 60.0 * RPM)[1]
    state, rows = turning(ClosedLoop(gear, MOTOR, Deviations(output_coulomb=1.2)), 60.0 * RPM)
    added = np.mean(rows[:, at.ROW_TORQUE_REFERENCE]) - np.mean(plain[:, at.ROW_TORQUE_REFERENCE])
    assert added == pytest.approx(1.2 / 120.0, rel=1e-3)
    loop = ClosedLoop(gear, MOTOR, Deviations(output_coulomb=1.2))
    loop.advance(state, SPEED, np.zeros(800))
    assert np.all(loop.advance(state, SPEED, np.zeros(100))[:, at.ROW_OUTPUT_SPEED] == 0.0)


def order_two(rows: np.ndarray, ratio_curve: np.ndarray) -> tuple[complex, complex]:
    """Complex amplitude of order 2 of the torque and of the kinematic error over whole revolutions."""
    angle = rows[:, at.ROW_INPUT_ANGLE]
    turns = math.floor((angle[-1] - angle[0]) / (2.0 * math.pi))
    kept = angle < angle[0] + 2.0 * math.pi * turns
    wave = np.exp(-2j * angle[kept]) * np.diff(angle, append=angle[-1])[kept]
    torque = rows[kept, at.ROW_TORQUE_REFERENCE]
    return complex(np.sum(torque * wave)), complex(np.sum(ratio_curve[kept] * wave))


@pytest.mark.parametrize(("depth", "expected"), [(0.0, 90.0), (0.15, 0.0)])
def test_torque_is_in_phase_with_the_error_only_if_friction_varies_with_depth(
    depth: float, expected: float
) -> None:
    """Figure 16: the wedge's own reaction is 90 degrees from the error, friction that follows the depth is in phase."""
    loop = ClosedLoop(GEAR, MOTOR, Deviations(mesh_depth=depth))
    _, rows = turning(loop, 60.0 * RPM, 6000)
    torque, error = order_two(rows, series_value(GEAR.kinematic_error, rows[:, at.ROW_INPUT_ANGLE]))
    phase = abs(math.degrees(math.atan2((torque / error).imag, (torque / error).real)))
    assert phase == pytest.approx(expected, abs=25.0)


def test_warming_lowers_friction_and_the_torque_of_a_given_reference() -> None:
    gear = without_error(GEAR)
    cold = Thermal(housing_capacity=1e12, motor_capacity=1e12)
    warm = Thermal(
        housing_start=32.0,
        motor_start=32.0,
        ambient=32.0,
        housing_capacity=1e12,
        motor_capacity=1e12,
    )
    speed = 1500.0 * RPM
    found = [
        np.mean(
            turning(ClosedLoop(gear, MOTOR, Deviations(thermal=t)), speed)[1][
                :, at.ROW_TORQUE_REFERENCE
            ]
        )
        for t in (cold, warm)
    ]
    lever = friction.mesh_lever(gear)
    viscous = lever * gear.mesh_friction.viscous * speed
    still = float(friction.bearing_magnitude(gear.bearing, 0.0))
    bearing = friction.bearing_lever(gear) * (
        float(friction.bearing_magnitude(gear.bearing, speed)) - still
    )
    dry = lever * gear.mesh_friction.coulomb + friction.bearing_lever(gear) * still
    motor = MOTOR.coulomb_friction + MOTOR.viscous_friction * speed
    expected = dry * 0.98 + viscous * math.exp(-0.3) + bearing * math.exp(-0.2) + motor * 0.96
    assert found[1] == pytest.approx(expected / 0.99, rel=1e-3)
    assert found[0] == pytest.approx(dry + viscous + bearing + motor, rel=1e-3)


def test_heat_of_the_housing_is_the_work_of_friction() -> None:
    heat = Thermal(
        housing_capacity=10.0, motor_capacity=1e12, housing_conductance=0.0, coupling=0.0
    )
    loop = ClosedLoop(without_error(GEAR), MOTOR, Deviations(motor_friction=False, thermal=heat))
    state, _ = turning(loop, 1000.0 * RPM)
    before = state[at.HOUSING]
    rows = loop.advance(state, SPEED, np.full(500, 1000.0 * RPM))
    work = np.mean(rows[:, at.ROW_FRICTION]) * 1000.0 * RPM * 0.5
    assert (state[at.HOUSING] - before) * 10.0 == pytest.approx(work, rel=1e-3)


def test_bare_motor_shows_its_own_friction_and_cogging_only() -> None:
    extra = Deviations(cogging=(Harmonic(24.0, 0.003, 0.0),))
    settings = LoopSettings(gear_mounted=False, disc_inertia=1e-4)
    loop = ClosedLoop(GEAR, MOTOR, extra, settings)
    assert loop.inertia == MOTOR.rotor_inertia + 1e-4
    _, rows = turning(loop, 30.3 * RPM, 4000)
    law = MOTOR.coulomb_friction + MOTOR.viscous_friction * 30.3 * RPM
    assert np.mean(rows[:, at.ROW_TORQUE_REFERENCE]) == pytest.approx(law, rel=2e-2)
    assert np.ptp(rows[:, at.ROW_TORQUE_REFERENCE]) > 0.004
    assert np.ptp(rows[:, at.ROW_OUTPUT_ANGLE]) == 0.0


def test_flexspline_fixed_turns_by_one_more() -> None:
    loop = ClosedLoop(GEAR, MOTOR, settings=LoopSettings(mounting="flexspline-fixed"))
    _, rows = turning(loop, 600.0 * RPM)
    slope = np.polyfit(rows[:, at.ROW_INPUT_ANGLE], rows[:, at.ROW_OUTPUT_ANGLE], 1)[0]
    assert 1.0 / slope == pytest.approx(121.0, rel=1e-4)


def test_common_period_of_orders() -> None:
    assert common_period((1.0, 2.0, 4.0), 120.0) == 1
    assert common_period((2.0, 2.0 * (1.0 + 1.0 / 120.0)), 120.0) == 60
    assert common_period((1.0 / 120.0,), 120.0) == 120
    with pytest.raises(ModelError, match="does not repeat"):
        common_period((math.pi,), 120.0)
    with pytest.raises(ModelError, match="no common period"):
        common_period((1.0 / 1999.0, 1.0 / 1997.0), 120.0)


# F_c, F_s, v_s, shape, c_v: the shipped gear's; steep; rising from rest; none of a dip; round.
FRICTION_SETS = {
    "shipped": (70.0, 95.0, 6.0, 1.0, 0.15),
    "steep": (150.0, 270.0, 0.3, 0.5, 0.05),
    "rising": (70.0, 63.0, 1.0, 1.0, 0.3),
    "flat": (70.0, 70.0, 3.0, 1.0, 0.1),
    "round": (20.0, 36.0, 10.0, 2.0, 0.6),
}
EVERYTHING = Deviations(
    friction_windup=True,
    mesh_depth=0.1,
    hardening=True,
    hysteresis_torque=1.0,
    hysteresis_stiffness=0.05,
    output_coulomb=0.5,
    thermal=Thermal(),
)


def switches(friction_set: str, step: float, case: str) -> np.ndarray:
    """When the rotor begins and ceases to stick [s], seen every 125 us."""
    paths = ("coulomb", "static", "stribeck_velocity", "shape", "viscous")
    values = {
        f"mesh_friction.{name}": value
        for name, value in zip(paths, FRICTION_SETS[friction_set], strict=True)
    }
    cycle = 125e-6
    loop = ClosedLoop(
        GEAR.with_values(values), MOTOR, EVERYTHING, LoopSettings(cycle=cycle, step=step)
    )
    state, found = loop.rest(0.3), []
    time = cycle * np.arange(1000)
    mode, targets = {
        "torque": (TORQUE, 0.25 * np.sin(2.0 * np.pi * 8.0 * time)),
        "speed": (SPEED, 20.0 * np.sin(2.0 * np.pi * 10.0 * time)),
        "load": (OFF, np.zeros(1000)),
    }[case]
    state[at.LOAD] = 25.0 if case == "load" else 0.0
    for k, target in enumerate(targets):
        before = state[at.SWITCHED]
        loop.advance(state, mode, np.array([target]))
        if state[at.SWITCHED] < before + 0.5 * cycle:
            found.append((k + 1) * cycle - state[at.SWITCHED])
    return np.array(found)


@pytest.mark.parametrize("case", ["torque", "speed", "load"])
@pytest.mark.parametrize("friction_set", FRICTION_SETS)
def test_stick_and_slip_switch_where_a_hundred_times_finer_step_has_it(
    friction_set: str, case: str
) -> None:
    ours, fine = (switches(friction_set, step, case) for step in (125e-6, 1.25e-6))
    assert len(ours) == len(fine) > 0
    assert np.max(np.abs(ours - fine)) < 1e-5


def test_friction_that_rises_from_rest_holds_with_less_than_it_brakes() -> None:
    """F_s < F_c: a torque between the two starts the motion, and friction is larger once it turns."""
    values = {"mesh_friction.static": 40.0, "mesh_friction.stribeck_velocity": 1.0}
    loop = ClosedLoop(without_error(GEAR).with_values(values), MOTOR)
    held = friction.friction_torque(loop.gear, 1e-9) + MOTOR.coulomb_friction
    state = loop.rest()
    still = loop.advance(state, TORQUE, np.full(300, 0.98 * float(held)))
    assert np.all(still[:, at.ROW_INPUT_SPEED] == 0.0)
    turning_rows = loop.advance(state, TORQUE, np.full(300, 1.05 * float(held)))
    assert turning_rows[-1, at.ROW_INPUT_SPEED] > 0.0
    assert turning_rows[-1, at.ROW_FRICTION] > 1.03 * float(held)


def test_output_bearing_follows_its_own_temperature_law_and_leaves_the_gear_alone() -> None:
    gear, torques = without_error(GEAR), []
    for warmer, law in ((0.0, 0.01), (10.0, 0.01), (10.0, 0.0)):
        heat = Thermal(
            housing_start=22.0 + warmer,
            coulomb_per_kelvin=0.0,
            viscous_per_kelvin=0.0,
            housing_capacity=1e9,
        )
        extra = Deviations(output_coulomb=1.2, output_per_kelvin=law, thermal=heat)
        rows = turning(ClosedLoop(gear, MOTOR, extra), 60.0 * RPM)[1]
        torques.append(float(np.mean(rows[:, at.ROW_TORQUE_REFERENCE])))
    assert torques[0] - torques[1] == pytest.approx(0.1 * 1.2 / 120.0, rel=0.02)
    assert torques[2] == pytest.approx(torques[0], rel=1e-4)
