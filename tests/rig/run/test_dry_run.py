"""Plans walked without a rig: times, travel, margins, and the refusal of what would break a limit."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from experiments import catalogue
from experiments.errors import PlanError
from experiments.parameters import make_parameters
from experiments.steps.vocabulary import (
    FindIndex,
    HoldRevolutions,
    HoldTime,
    MoveRevolutions,
    MoveToAngle,
    Ramp,
    SegmentLabel,
    ServoOff,
    SpeedStep,
    Step,
    TorqueRamp,
)
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import REVOLUTION, RPM
from rig.bench import limits as lim
from rig.errors import LimitError
from rig.run.dry_run import plan_run
from rig.run.session import execute
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

GEAR, MOTOR = shipped_gear(), shipped_motor()


def test_times_and_turns_add_up() -> None:
    planned = planned_of(
        ServoOff(1.0),
        Ramp(20.0, 100.0),
        HoldRevolutions(10.0, 60.0),
        Ramp(0.0, 100.0),
        HoldTime(0.5),
        ServoOff(1.0),
    )
    hold = 10.0 * REVOLUTION / 20.0
    assert planned.nominal == pytest.approx(1.0 + 0.2 + hold + 0.2 + 0.5 + 1.0 + 2 * 0.05)
    assert planned.longest == pytest.approx(planned.nominal - hold + 60.0)
    assert planned.input_revolutions == pytest.approx(10.0 + 20.0 * 0.2 / REVOLUTION, rel=1e-3)
    low, high = planned.travel
    assert high - planned.input_revolutions * REVOLUTION == pytest.approx(5.0 * REVOLUTION, abs=0.1)
    assert low == pytest.approx(-5.0 * REVOLUTION)
    assert planned.as_json()["duration"]["nominal"] == planned.nominal


def test_the_forecast_is_what_an_ideal_rig_then_does() -> None:
    steps: tuple[Step, ...] = (
        ServoOff(0.3), Ramp(30.0, 300.0), HoldRevolutions(4.0, 9.0), Ramp(-30.0, 300.0), HoldRevolutions(4.0, 9.0),
        Ramp(0.0, 300.0), MoveRevolutions(2.0, 20.0, 200.0, 9.0), SpeedStep(50.0, 0.1, 3.0), Ramp(0.0, 500.0), HoldTime(0.2),  # noqa: E501
        ServoOff(0.3),
    )  # fmt: skip
    planned = planned_of(*steps)
    run = ListRun()
    report = execute(parts_of(planned, FakeRig(), Path(), 1000), lambda *_: run)
    assert report.outcome == "COMPLETED"
    # Before the plan 201 cycles are spent standing, after it 100 to verify standstill, once more 50 to switch off.
    assert report.rows * 1e-3 - 0.301 == pytest.approx(planned.nominal, abs=0.15)
    angle = run.counts[:, 0] / 32768 * REVOLUTION
    low, high = planned.travel
    assert low <= (angle - angle[0]).min()
    assert (angle - angle[0]).max() <= high


def test_margins_name_the_step_and_are_the_hand_calculation() -> None:
    planned = planned_of(
        Ramp(100.0, 2000.0, SegmentLabel("ramp", 100.0)), HoldTime(0.1), Ramp(0.0, 1000.0)
    )
    by_name = {margin.quantity: margin for margin in planned.margins}
    speed = by_name[lim.INPUT_SPEED]
    assert speed.value == 100.0
    assert speed.margin == pytest.approx(1.0 - 100.0 / 130.0)
    acceleration = by_name[lim.ACCELERATION]
    assert acceleration.value == 2000.0
    assert acceleration.where.startswith("step 1 ")
    torsion = by_name[lim.TORSION_TORQUE]
    assert torsion.value == pytest.approx(2.0 * 0.1 * 2000.0 / 120.0)
    inertia = (2.59e-5 + 4.13e-5 + 0.1 / 120.0**2) * 2000.0
    assert inertia < by_name[lim.MOTOR_TORQUE].value < inertia + 0.2


@pytest.mark.parametrize(
    ("steps", "quantity", "words"),
    [
        ((Ramp(6100.0 * RPM, 1000.0),), "input speed", "6100 r/min"),
        ((Ramp(100.0, 15000.0, SegmentLabel("ramp")),), "acceleration", "15000|1.5e\\+04"),
        ((Ramp(1.0, 10.0), TorqueRamp(0.1, 1.2, 0.01)), "motor torque", "1.2 N m"),
        (
            (Ramp(5000.0 * RPM, 5000.0), HoldRevolutions(5000.0, 100.0)),
            "average speed",
            "the whole plan",
        ),
    ],
)
def test_a_plan_that_would_break_a_limit_is_refused(
    steps: tuple[Step, ...], quantity: str, words: str
) -> None:
    with pytest.raises(LimitError, match=words) as refused:
        planned_of(*steps)
    text = str(refused.value)
    assert quantity in text
    assert "margin -" in text
    assert "tier" in text
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ((HoldRevolutions(1.0, 5.0),), "at standstill"),
        ((Ramp(1.0, 10.0), HoldRevolutions(10.0, 5.0)), "longer than its own limit"),
        ((Ramp(1.0, 0.0),), "positive acceleration"),
        ((MoveToAngle(0.0, 0.0, 10.0, 5.0),), "needs a speed"),
        ((MoveRevolutions(100.0, 1.0, 10.0, 5.0),), "longer than its own limit"),
        ((TorqueRamp(0.0, 0.1, 0.1),), "needs a rate"),
        ((FindIndex("motor", 1.0, 5.0),), "index marks"),
    ],
)
def test_an_impossible_plan_is_refused_with_its_step(steps: tuple[Step, ...], words: str) -> None:
    with pytest.raises(PlanError, match=words) as refused:
        planned_of(*steps)
    assert refused.value.where.startswith("step ")


def test_searches_and_ramps_have_a_nominal_and_a_longest_time() -> None:
    planned = planned_of(
        FindIndex("output", 6.0, 500.0), Ramp(0.0, 50.0), TorqueRamp(0.02, 0.4, 0.05)
    )
    search, _, torque = planned.steps
    assert search.nominal == pytest.approx(0.5 * REVOLUTION * 120.0 / 6.0 + 0.05)
    assert search.longest == pytest.approx(500.05)
    assert torque.longest == pytest.approx(20.0)
    assert 2.0 < torque.nominal < 10.0
    assert torque.torque == 0.4
    assert torque.speed > 0.0


@pytest.mark.parametrize("name", catalogue.names())
def test_every_protocol_can_be_planned_with_its_defaults(name: str) -> None:
    experiment = catalogue.load(name)
    planned = plan_run(experiment, make_parameters(experiment.parameters, {}), GEAR, MOTOR)
    assert 10.0 < planned.nominal <= planned.longest
    assert planned.samples == pytest.approx(planned.nominal * 1000.0, abs=1.0)
    assert all(0.0 <= margin.margin <= 1.0 for margin in planned.margins)
    assert math.isfinite(planned.travel[0])
    assert planned.file_size() < planned.space_needed()
