"""What was found beside its two truths: what this bench sees, and the measurand."""

from __future__ import annotations

import math
from typing import Any

import pytest

from experiments.quantity import Quantity
from experiments.result import Result
from experiments.truth import TruthRow, truth_of, truth_rows
from model.identify.estimate import BudgetLine, Estimate
from model.units import RPM

RATIO = 100.0
LEVER = 31e-3 / (RATIO * 0.5)
FRICTION: dict[str, Any] = {
    "coulomb": 60.0,
    "static": 90.0,
    "stribeck_velocity": 4.0,
    "shape": 1.5,
    "viscous": 0.2,
    "torque_balance": "energy",
    "mesh_lever": LEVER,
    "bearing_lever": 1.01,
    "bearing_torque": {
        "friction_factor": 2.0,
        "viscosity": 40e-6,
        "pitch_diameter": 53e-3,
        "low_speed_branch": True,
    },
    "output_bearing_per_kelvin": 0.01,
    "output_bearing_at_mesh": {"coulomb": 8.0, "viscous": 0.03},
}
TRUTH: dict[str, Any] = {
    "friction": FRICTION,
    "thermal": {
        "reference": 20.0,
        "coulomb_per_kelvin": 0.004,
        "viscous_per_kelvin": 0.03,
        "motor_friction_per_kelvin": 0.005,
        "torque_constant_per_kelvin": 0.001,
    },
    "thermometer": {"housing_offset": 0.5},
    "torque_port": {"scale_error": 0.02},
    "motor": {"coulomb": 0.012, "viscous": 4e-5},
    "mean_temperatures": {"housing": 31.0, "motor": 40.0},
    "end_temperatures": {"housing": 33.0, "motor": 45.0},
}
SCALE = 1.02 / (1.0 - 0.001 * 20.0)
GEAR_OPTIONS = {"torque_is_of": "gear", "torque_balance": "energy"}


def estimate(name: str, value: float = 1.0, half: float = 0.1) -> Estimate:
    bare = Estimate(name=name, value=value, unit="1", low=value - half, high=value + half)
    return bare.with_budget([BudgetLine("scatter", "A", 0.5 * half)])


def result(kind: str, *names: str, **more: Any) -> Result:
    estimates = {name: estimate(name) for name in names}
    declared = (*names, *more.get("metrics", ()))
    quantities = tuple(Quantity(name=name, title=name, unit="1") for name in declared)
    return Result(run="R-1", kind=kind, estimates=estimates, quantities=quantities, **more)


def pairs(found: Result, truth: dict[str, Any] = TRUTH) -> dict[str, tuple[float, float]]:
    return {row.estimate.name: (row.seen, row.measurand) for row in truth_rows(found, truth)}


def test_friction_is_the_drawn_parameter_at_the_temperature_of_the_run() -> None:
    found = pairs(
        result(
            "friction",
            *("coulomb", "static", "viscous", "shape", "stribeck_velocity"),
            *("coulomb_at_20_degrees", "viscous_at_20_degrees"),
            options=GEAR_OPTIONS,
            metrics={"housing_temperature": 30.5},
        )
    )
    dry, thin, bearing = 1.0 - 0.004 * 10.0, math.exp(-0.3), 0.9
    assert found["coulomb"] == pytest.approx((SCALE * (60 * dry + 8 * bearing), 60 * dry))
    assert found["static"] == pytest.approx((SCALE * (90 * dry + 8 * bearing), 90 * dry))
    assert found["viscous"] == pytest.approx((SCALE * (0.2 * thin + 0.03 * bearing), 0.2 * thin))
    assert found["shape"] == (1.5, 1.5)
    assert found["coulomb_at_20_degrees"] == pytest.approx((SCALE * 68.0, 60.0))
    assert found["viscous_at_20_degrees"] == pytest.approx((SCALE * 0.23, 0.2))


def test_what_was_taken_off_is_no_longer_seen() -> None:
    taken = {"output_bearing_subtracted": 7.0, "output_bearing_viscous_subtracted": 0.02}
    metrics = {"housing_temperature": 20.5}
    names = ("coulomb", "viscous", "running_torque_500_rpm")
    with_it, without = (
        pairs(result("friction", *names, options=GEAR_OPTIONS, metrics=metrics | more))
        for more in (taken, {})
    )
    assert without["coulomb"][0] - with_it["coulomb"][0] == pytest.approx(7.0)
    assert without["viscous"][0] - with_it["viscous"][0] == pytest.approx(0.02)
    off = without["running_torque_500_rpm"][0] - with_it["running_torque_500_rpm"][0]
    assert off == pytest.approx(LEVER * (7.0 + 0.02 * 500.0 * RPM))
    assert [without[name][1] for name in names] == [with_it[name][1] for name in names]


def test_a_running_torque_is_equation_19_and_18_of_the_gear_alone() -> None:
    name = "running_torque_600_rpm"
    found = pairs(
        result("friction", name, options=GEAR_OPTIONS, metrics={"housing_temperature": 30.5})
    )
    speed = 600.0 * 2.0 * math.pi / 60.0
    dry, thin = 0.96, math.exp(-0.3)
    mesh = dry * (60.0 + 30.0 * math.exp(-((speed / 4.0) ** 1.5))) + thin * 0.2 * speed
    still = 0.1 * 2.0 * 2000.0 ** (2.0 / 3.0) * 53e-3**3
    moving = 0.1 * 2.0 * (40.0 * 600.0) ** (2.0 / 3.0) * 53e-3**3
    gear = mesh * LEVER + 1.01 * (dry * still + thin ** (2.0 / 3.0) * (moving - still))
    bearing = LEVER * 0.9 * (8.0 + 0.03 * speed)
    assert found[name] == pytest.approx((SCALE * (gear + bearing), gear))


def test_friction_of_motor_and_gear_or_in_another_balance_is_not_held_against_the_gear() -> None:
    for options in (
        {"torque_is_of": "motor + gear"},
        {**GEAR_OPTIONS, "torque_balance": "published"},
    ):
        assert not pairs(result("friction", "coulomb", options={**GEAR_OPTIONS, **options}))


def test_a_tare_is_the_motor_as_warm_as_it_was() -> None:
    at_20 = "motor_coulomb_at_20_degrees"
    found = pairs(result("motor-tare", "motor_coulomb", "motor_viscous", at_20))
    assert found["motor_coulomb"] == pytest.approx((SCALE * 0.012 * 0.9, 0.012 * 0.9))
    assert found[at_20] == pytest.approx((SCALE * 0.012, 0.012))
    assert found["motor_viscous"] == pytest.approx((SCALE * 4e-5 * 0.9, 4e-5 * 0.9))


def test_a_starting_torque_is_motor_and_gear_without_the_benchs_bearing() -> None:
    found = pairs(
        result(
            "starting-torque",
            "starting_torque",
            options={"torque_is_of": "motor + gear"},
            metrics={"housing_temperature": 20.5},
        )
    )
    still = 0.1 * 2.0 * 2000.0 ** (2.0 / 3.0) * 53e-3**3
    both = 90.0 * LEVER + 1.01 * still + 0.012 * 0.9
    assert found["starting_torque"] == pytest.approx((SCALE * (both + LEVER * 8.0), both))


def test_a_warm_up_is_all_that_the_motor_turns_as_warm_as_at_its_end() -> None:
    speed = 600.0 * RPM
    metrics = {"housing_temperature": 30.5, "speed": speed}
    options = {"torque_is_of": "motor + gear"}
    found = pairs(result("warm-up", "running_torque", options=options, metrics=metrics))
    gear = pairs(
        result("friction", "running_torque_600_rpm", options=GEAR_OPTIONS, metrics=metrics)
    )["running_torque_600_rpm"]
    motor = (0.012 + 4e-5 * speed) * (1.0 - 0.005 * 25.0)
    whole = gear[0] / SCALE + motor
    assert found["running_torque"] == pytest.approx((1.02 / 0.975 * whole, whole))
    metrics["torque_constant_factor"] = 0.98
    taken = pairs(result("warm-up", "running_torque", options=options, metrics=metrics))
    assert taken["running_torque"] == pytest.approx((0.98 * 1.02 / 0.975 * whole, whole))


@pytest.mark.parametrize(("sense", "edge"), [(1, 2.0), (-1, 2.0 + 1e-4)])
def test_a_mark_lies_where_the_forward_turn_meets_it(sense: int, edge: float) -> None:
    """The counter shows beside it the error of its encoder; the far edge of a mark is a count away."""
    encoder = {"index_angle": 2.0, "index_error": 3e-5, "quantum": 1e-4}
    encoders = {"input": encoder, "output": encoder, "output_sense": sense}
    found = pairs(result("home", "input_index", "output_index"), {"encoders": encoders})
    assert found["input_index"] == pytest.approx((2.0 + 3e-5, 2.0))
    assert found["output_index"] == pytest.approx((edge + 3e-5, edge))


def orders(*waves: tuple[float, float, float]) -> list[dict[str, float]]:
    """Order, amplitude and phase of each, as the record has them."""
    return [
        {"order": n, "amplitude": a, "cosine": a * math.cos(p), "sine": a * math.sin(p)}
        for n, a, p in waves
    ]


def test_the_gears_own_error_is_turned_to_the_marks_of_the_result() -> None:
    """The record counts from its marks, which stand 0.7 rad into the recorded angle; the result from 0.4 rad."""
    record = {
        "kinematic_error": {
            "orders": orders((2.0, 5e-5, 0.3), (2.01, 1e-5, 0.1)),
            "measurable_recorded": orders((2.0, 6e-5, 2.0), (0.01, 2e-5, 1.0)),
            "reference_angle": 0.7,
            "peak_to_peak": 1.2e-4,
            "measurable_peak_to_peak": 1.6e-4,
        }
    }
    names = ("amplitude_2", "phase_2", "amplitude_1/N", "amplitude_2+1/N", "amplitude_5-1/N")
    found = pairs(
        result(
            "kinematic-error",
            *(*names, "transmission_accuracy", "lost_motion"),
            options={"ratio": RATIO, "phase_reference_angle": 0.4},
        ),
        record,
    )
    assert found["amplitude_2"] == pytest.approx((6e-5, 5e-5))
    # cos(2 x_mark - 0.3) with x_mark = x' + 0.4 - 0.7, and cos(2 x_recorded - 2.0) with x_recorded = x' + 0.4.
    assert found["phase_2"] == pytest.approx((2.0 - 0.8, 0.3 + 0.6))
    assert found["amplitude_1/N"] == pytest.approx((2e-5, 0.0))
    assert found["amplitude_2+1/N"] == pytest.approx((0.0, 1e-5))
    assert found["amplitude_5-1/N"] == (0.0, 0.0)
    assert found["transmission_accuracy"] == (1.6e-4, 1.2e-4)
    assert "lost_motion" not in found


def test_stiffness_is_the_records_and_torque_alone_is_scaled() -> None:
    dynamics = {
        "stiffness_over_inertia": 4.0e5,
        "resonance": 100.0,
        "damping_ratio": 0.02,
        "damping_ratio_with_output_bearing": 0.025,
        "output_inertia": 0.1,
        "input_inertia": 6e-5,
        "ratio": RATIO,
    }
    names = ("stiffness_over_inertia", "frequency_forward", "damping_ratio", "output_inertia")
    found = pairs(
        result("velocity-steps", *names, "output_stiffness"), {**TRUTH, "dynamics": dynamics}
    )
    assert found["stiffness_over_inertia"] == (4.0e5, 4.0e5)
    assert found["frequency_forward"] == (100.0, 100.0)
    assert found["damping_ratio"] == (0.025, 0.02)
    less = result(
        "velocity-steps", "damping_ratio", metrics={"output_bearing_damping_subtracted": 0.004}
    )
    own = pairs(less, {**TRUTH, "dynamics": dynamics})
    assert own["damping_ratio"] == pytest.approx((0.021, 0.02))
    carried = SCALE * 0.1
    assert found["output_inertia"] == pytest.approx((carried, 0.1))
    assert found["output_stiffness"] == pytest.approx((4.0e5 * carried, 4.0e4))


def test_the_interval_is_held_against_what_is_seen_and_u_against_the_measurand() -> None:
    found = estimate("coulomb", 10.0, 0.5)
    seen, measurand, both, neither = (
        TruthRow(found, *truths)
        for truths in ((10.4, 11.0), (11.0, 10.4), (9.6, 9.6), (20.0, 20.0))
    )
    assert [seen.covered, seen.within] == [True, False]
    assert [measurand.covered, measurand.within] == [False, True]
    assert [both.covered, both.within] == [True, True]
    assert [neither.covered, neither.within] == [False, False]
    phase = TruthRow(estimate("phase_2", 3.1), -3.1, 3.0)
    assert phase.difference == pytest.approx(6.2 - 2.0 * math.pi)
    assert phase.covered


def test_what_version_0_1_0_wrote_is_read() -> None:
    """It had the bearing in a sum, no levers, and no temperatures of the run."""
    old = {
        "friction": {
            **{
                n: FRICTION[n]
                for n in ("coulomb", "static", "stribeck_velocity", "shape", "viscous")
            },
            "torque_balance": "energy",
            "measurable": {"coulomb": 68.0, "static": 98.0, "viscous": 0.23},
        },
        "torque_port": {"scale_error": 0.02},
    }
    found = pairs(
        result("friction", "coulomb", "running_torque_500_rpm", options=GEAR_OPTIONS), old
    )
    assert found == {"coulomb": pytest.approx((1.02 * 68.0, 60.0))}


def test_the_mean_temperatures_of_the_run_stand_with_its_truth() -> None:
    process = {
        "truth": {"thermal": {"reference": 20.0}},
        "acquisition": {"thermal_state": {"mean": {"motor": 33.0}, "end": {"motor": 34.0}}},
    }
    assert truth_of(process)["mean_temperatures"]["motor"] == 33.0
    assert truth_of(process)["end_temperatures"]["motor"] == 34.0
    nothing = {"mean_temperatures": {}, "end_temperatures": {}}
    assert truth_of({"truth": {"a": 1}}) == {"a": 1, **nothing}
