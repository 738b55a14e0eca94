"""Invariants of every plan, whatever its parameters: finite, pure, between torque zeros, within the rated speed."""

from __future__ import annotations

import math
from typing import Any

import pytest
from annotated_types import Ge, Gt, Le, Lt
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments import catalogue
from experiments.errors import PlanError
from experiments.parameters import ParameterField, parameter_fields
from experiments.planning.speeds import alias_leak, first_resonances, incommensurate, lattice_lock
from experiments.protocols.friction import declaration as friction_declaration
from experiments.protocols.friction import plan as friction_plan
from experiments.protocols.kinematic_error import declaration as kinematic_error_declaration
from experiments.protocols.kinematic_error import plan as kinematic_error_plan
from experiments.protocols.velocity_steps import declaration as velocity_steps_declaration
from experiments.protocols.velocity_steps import plan as velocity_steps_plan
from experiments.steps.vocabulary import (
    HoldRevolutions,
    MoveRevolutions,
    MoveToAngle,
    Ramp,
    SpeedStep,
)
from model.gear_file import shipped_gear
from model.units import RPM
from rig.testing.protocol import check_plan

GEAR = shipped_gear()


def _number(f: ParameterField) -> st.SearchStrategy[Any]:
    low, high = 0.0, 1e4
    for check in f.checks:
        low = (
            check.ge if isinstance(check, Ge) else check.gt + 1e-3 if isinstance(check, Gt) else low
        )
        high = (
            check.le
            if isinstance(check, Le)
            else check.lt - 1e-3
            if isinstance(check, Lt)
            else high
        )
    default = f.default if isinstance(f.default, int | float) else 1.0
    low = max(low, 0.2 * default) if default > 0 else low
    high = max(min(high, 5.0 * default if default > 0 else 1.0), low)
    if f.kind is int:
        return st.integers(math.ceil(low), max(math.ceil(low), min(int(high), 12)))
    return st.floats(low, high)


def parameters_of(name: str) -> st.SearchStrategy[Any]:
    """Any parameters of a protocol about its defaults, within the declared ranges."""
    model = catalogue.load(name).parameters
    strategies: dict[str, st.SearchStrategy[Any]] = {}
    for f in parameter_fields(model):
        if f.kind is bool:
            strategies[f.name] = st.booleans()
        elif f.kind in (int, float):
            strategies[f.name] = _number(f)
        elif f.kind is tuple and f.default:
            strategies[f.name] = st.lists(st.floats(1.0, 3000.0), min_size=1, max_size=4).map(tuple)
    return st.builds(model, **strategies)


@pytest.mark.parametrize("name", catalogue.names())
@settings(max_examples=25)
@given(data=st.data())
def test_every_plan_is_pure_finite_and_between_torque_zeros(name: str, data: st.DataObject) -> None:
    check_plan(catalogue.load(name), data.draw(parameters_of(name)), GEAR)


def test_kinematic_error_covers_whole_output_revolutions_after_an_approach() -> None:
    for mounting, turns in (("circular-spline-fixed", 120.0), ("flexspline-fixed", 121.0)):
        steps = list(
            kinematic_error_plan.plan(
                kinematic_error_declaration.Parameters(
                    output_revolutions=2, repeats=2, mounting=mounting
                ),
                GEAR,
            )
        )
        holds = [s for s in steps if isinstance(s, HoldRevolutions)]
        assert [
            (h.segment.label, h.segment.direction, h.segment.repeat) for h in holds if h.segment
        ] == [
            (label, direction, repeat)
            for repeat in (0, 1)
            for direction in (1, -1)
            for label in ("approach", "traverse")
        ]
        assert all(h.revolutions >= 1.0 for h in holds)
        assert all(
            h.revolutions == 2 * turns for h in holds if h.segment and h.segment.label == "traverse"
        )


def test_friction_defaults_are_what_a_laboratory_expects() -> None:
    speeds = [w / RPM for w in friction_plan.sweep_speeds(friction_declaration.Parameters(), GEAR)]
    assert len(speeds) >= 30
    assert speeds == sorted(speeds)
    assert speeds[0] <= GEAR.mesh_friction.stribeck_velocity / 10.0 / RPM
    assert 2900.0 < speeds[-1] <= 3000.0 * 1.015
    assert sum(s < 100.0 for s in speeds) >= 15
    steps = list(friction_plan.plan(friction_declaration.Parameters(), GEAR))
    holds = [s.segment for s in steps if isinstance(s, HoldRevolutions) and s.segment]
    assert sum(h.label == "hold" for h in holds) == 120
    assert sum(h.label == "bracket" for h in holds) == 28
    assert {(h.direction, h.repeat) for h in holds if h.label == "hold"} == {
        (1, 0),
        (-1, 0),
        (1, 1),
        (-1, 1),
    }
    assert all(s.revolutions == int(s.revolutions) for s in steps if isinstance(s, HoldRevolutions))


def test_friction_points_start_all_over_the_output_revolution() -> None:
    steps = list(friction_plan.plan(friction_declaration.Parameters(), GEAR))
    place, places = 0.0, []
    for step in steps:
        if isinstance(step, MoveRevolutions):
            place += step.revolutions / GEAR.ratio
            places.append(place % 1.0)
    assert len(places) == 60
    gaps = [
        b - a for a, b in zip(sorted(places), [*sorted(places)[1:], 1.0 + min(places)], strict=True)
    ]
    assert max(gaps) < 0.05


def test_fast_speeds_are_moved_off_the_sampling_lattice() -> None:
    wanted = 3000.0 * RPM
    found = incommensurate(wanted, 1000.0, 1.0)
    assert alias_leak(wanted, 1000.0, 1.0) > 0.9
    assert alias_leak(found, 1000.0, 1.0) < 0.1
    assert abs(found / wanted - 1.0) <= 0.015


def _marks(**values: Any) -> list[str]:
    steps = kinematic_error_plan.plan(kinematic_error_declaration.Parameters(**values), GEAR)
    return [getattr(s, "code", "") for s in steps]


def _speeds(**values: Any) -> set[float]:
    steps = kinematic_error_plan.plan(kinematic_error_declaration.Parameters(**values), GEAR)
    return {abs(s.speed) / RPM for s in steps if isinstance(s, Ramp)} - {0.0}


def test_a_speed_on_the_lattice_of_the_output_counts_is_moved() -> None:
    """18 000 lines x 4 over 120 are 600 counts per input revolution: 100 r/min at 1 kHz takes 600 samples of it."""
    for rpm in (60.0, 100.0, 50.0):
        assert lattice_lock(rpm * RPM, 1000.0, 600.0, 120.0) > 0.15
        (moved,) = _speeds(speed_rpm=rpm)
        assert lattice_lock(moved * RPM, 1000.0, 600.0, 120.0) <= 0.12
        assert 0.0 < abs(moved / rpm - 1.0) <= 0.015
        assert "speed-moved" in _marks(speed_rpm=rpm)
    for rpm in (30.3, 61.8):
        (stated,) = _speeds(speed_rpm=rpm)
        assert stated == pytest.approx(rpm, rel=1e-12)
        assert "speed-moved" not in _marks(speed_rpm=rpm)


def test_a_counter_that_no_speed_averages_out_is_refused() -> None:
    """One count per output revolution: the saw-tooth is an output order at every speed."""
    with pytest.raises(PlanError, match="rounding") as refused:
        kinematic_error_plan.plan(kinematic_error_declaration.Parameters(output_counts=1), GEAR)
    assert refused.value.where == "kinematic-error.speed_rpm"


def test_orders_near_the_first_mode_are_refused_by_the_plan() -> None:
    first = first_resonances(GEAR)[0]
    highest = math.sqrt(0.1) * first / 6.0 / RPM
    assert "not-quasi-static" in _marks(speed_rpm=0.98 * highest)
    assert "quasi-static" in _marks(speed_rpm=30.3)
    with pytest.raises(PlanError, match="torsional mode") as refused:
        kinematic_error_plan.plan(
            kinematic_error_declaration.Parameters(speed_rpm=1.05 * highest), GEAR
        )
    assert refused.value.where == "kinematic-error.speed_rpm"


def test_steps_start_from_stated_angles_approached_from_one_side() -> None:
    parameters = velocity_steps_declaration.Parameters()
    steps = list(velocity_steps_plan.plan(parameters, GEAR))
    moves = [s for s in steps if isinstance(s, MoveToAngle)]
    jumps = [s for s in steps if isinstance(s, SpeedStep)]
    assert len(moves) == len(jumps) == 2 * 8 * parameters.repeats
    assert all(m.speed > 0.0 for m in moves)
    assert {m.phase for m in moves} == {
        velocity_steps_plan.start_phase(k, parameters.repeats) for k in range(parameters.repeats)
    }
    assert all(j.least_revolutions >= 3.0 for j in jumps)
    wanted = (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 2400.0, 3000.0)
    assert sorted({round(abs(j.speed) / RPM, 6) for j in jumps}) == list(wanted)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("kinematic-error", {"speed_rpm": -1.0}),
        ("kinematic-error", {"speed_rpm": math.nan}),
        ("kinematic-error", {"output_revolutions": 0}),
        ("kinematic-error", {"approach_revolutions": 0.5}),
        ("kinematic-error", {"mounting": "upside-down"}),
        ("friction", {"highest_rpm": 9000.0}),
        ("friction", {"lowest_rpm": 100.0, "highest_rpm": 10.0}),
        ("friction", {"points": 0}),
        ("friction", {"speeds_rpm": (10.0, -5.0)}),
        ("friction", {"acceleration": math.inf}),
        ("velocity-steps", {"speeds_rpm": ()}),
        ("velocity-steps", {"speeds_rpm": (6000.0,)}),
        ("velocity-steps", {"revolutions": 1.0}),
        ("motor-tare", {"lowest_rpm": 0.0}),
        ("warm-up", {"speed_rpm": 7000.0}),
        ("starting-torque", {"torque_limit": 5.0}),
        ("starting-torque", {"positions": 0}),
        ("home", {"input_passes": 0}),
    ],
)
def test_impossible_parameters_are_refused_with_value_and_limit(
    name: str, values: dict[str, Any]
) -> None:
    experiment = catalogue.load(name)
    with pytest.raises(PlanError) as refused:
        experiment.plan(experiment.parameters(**values), GEAR)
    assert name in refused.value.where


def test_parameters_of_another_protocol_are_refused() -> None:
    with pytest.raises(PlanError, match="another protocol"):
        friction_plan.plan(kinematic_error_declaration.Parameters(), GEAR)  # type: ignore[arg-type]
