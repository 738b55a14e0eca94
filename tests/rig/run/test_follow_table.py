"""A table is followed from the index marks, in any blocks, on the wire as directly; without a mark it is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from experiments.errors import PlanError
from experiments.steps.follow import Corrected, FollowTable, index_zero
from experiments.steps.vocabulary import (
    HoldRevolutions,
    Ramp,
    SegmentLabel,
    ServoOff,
)
from model.compensation import table_of_set
from model.gear import Harmonic
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import ARCSEC, REVOLUTION
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.bench.backends.simulated import position_config, wire_config, wire_port
from rig.run.parts import RunReport, SessionParts
from rig.run.session import execute
from sim_backend.direct import SimulatedRig
from sim_backend.servo_drive import SPEED_COUNT
from sim_backend.wire.bench import WireBench
from sim_backend.world import World
from tests.rig.fake_rig import ListRun, planned_of

GEAR, MOTOR = shipped_gear(), shipped_motor()
SERIES = (Harmonic(2.0, 20.0 * ARCSEC, -8.0 * ARCSEC), Harmonic(4.0, 0.0, 5.0 * ARCSEC))
TABLE = table_of_set(replace(GEAR, kinematic_error=SERIES), "circular-spline-fixed")
SPEED = 40.0
PLAN = (
    ServoOff(0.1),
    Ramp(150.0, 2000.0),
    HoldRevolutions(121.0, 10.0),
    Ramp(SPEED, 2000.0),
    HoldRevolutions(1.0, 5.0),
    FollowTable(1.5, SPEED, TABLE, 5.0, 1.0, SegmentLabel("approach", SPEED, 1)),
    FollowTable(2.0, SPEED, TABLE, 5.0, 0.0, SegmentLabel("compensated", SPEED, 1)),
    Ramp(0.0, 400.0),
    ServoOff(0.1),
)


def executed(
    kind: str, block: int = 100, plan: tuple = PLAN
) -> tuple[ListRun, RunReport, list[str]]:
    """The plan on a rig: directly, led by positions, or either on the wire."""
    run, clock = ListRun(), VirtualClock(1_700_000_000_000_000_000)
    by_position = kind.endswith("csp")
    if kind.startswith("wire"):
        bench = WireBench(GEAR, MOTOR, world=World.of(5), clock=clock)
        config = position_config(bench, MOTOR) if by_position else wire_config(bench, MOTOR)
        port = wire_port(bench, MOTOR, config)
    else:
        port = SimulatedRig(GEAR, MOTOR, world=World.of(5), clock=clock, by_position=by_position)
    parts = SessionParts(
        order=Order(protocol="", gear=GEAR, motor=MOTOR),
        planned=planned_of(*plan),
        rig=AssembledRig(name=kind, port=port, clock=clock),
        cycles=block,
    )
    report = execute(parts, lambda *_: run)
    return run, report, [channel.name for channel in port.channels]


@pytest.fixture(scope="module")
def direct() -> tuple[ListRun, RunReport, list[str]]:
    return executed("sim")


def test_the_set_speeds_are_those_of_the_table(
    direct: tuple[ListRun, RunReport, list[str]],
) -> None:
    run, report, names = direct
    assert report.outcome == "COMPLETED", report.message
    segment = next(s for s in run.segments if s.label == "compensated")
    sent = run.counts[segment.start : segment.stop, names.index("target_speed")] * SPEED_COUNT
    motor = run.counts[:, names.index("input_angle")] / 32768 * REVOLUTION
    mark = run.counts[-1, names.index("input_index")] / 32768 * REVOLUTION
    correction = TABLE.of(1.0)
    # Order 2 and 4 repeat every input turn: any mark of the input is as good.
    phi = correction.nominal(np.array([motor[segment.start] - mark]))[0]
    phi += SPEED * 1e-3 * np.arange(len(sent) + 1)
    expected = SPEED + np.diff(correction.added(phi)) * 1e3
    first = slice(0, int(0.9 * REVOLUTION / SPEED * 1e3))
    assert np.ptp(expected) > 1.0
    # Where it is nominally is said as it begins, so that every row's nominal angle can be told.
    told = [e for e in run.events if e.code == "nominal-angle"]
    assert len(told) == 2
    away = float(told[1].text.split()[2]) - float(phi[0])
    assert abs(math.remainder(away, REVOLUTION)) < 0.05
    assert np.abs(sent[first] - expected[first]).max() < 0.02
    # Between two turns the phase is found anew: what the drive lagged does not add up.
    assert np.abs(sent - expected[: len(sent)]).max() < 0.06


def test_it_is_faded_in_without_a_step(direct: tuple[ListRun, RunReport, list[str]]) -> None:
    run, _, names = direct
    segment = next(s for s in run.segments if s.label == "approach")
    sent = run.counts[segment.start : segment.stop, names.index("target_speed")] * SPEED_COUNT
    assert np.abs(sent[:5] - SPEED).max() < 0.005
    planned = planned_of(*PLAN)
    limit = planned.steps[5].acceleration
    assert np.abs(np.diff(sent)).max() * 1e3 < limit


def test_plan_and_limits_see_its_peaks(direct: tuple[ListRun, RunReport, list[str]]) -> None:
    run, _, names = direct
    planned = planned_of(*PLAN)
    segment = next(s for s in run.segments if s.label == "compensated")
    sent = run.counts[segment.start : segment.stop, names.index("target_speed")] * SPEED_COUNT
    forecast = planned.steps[6]
    assert sent.max() - SPEED_COUNT <= forecast.speed <= 1.001 * sent.max()
    steepest = np.abs(np.diff(sent)).max() * 1e3
    assert steepest <= forecast.acceleration * 1.01
    assert forecast.acceleration <= 1.1 * steepest
    speeds = [point.speed for point in forecast.points]
    assert min(speeds) == pytest.approx(sent.min(), rel=0.01)


@pytest.mark.parametrize("block", [7, 1000])
def test_blocks_change_no_count(block: int, direct: tuple[ListRun, RunReport, list[str]]) -> None:
    run, report, _ = executed("sim", block)
    assert report.outcome == "COMPLETED"
    assert np.array_equal(run.counts, direct[0].counts)
    assert run.segments == direct[0].segments


@pytest.mark.parametrize("kind", ["", "-csp"], ids=["speeds", "positions"])
def test_on_the_wire_are_the_same_counts(kind: str) -> None:
    one, other = executed(f"sim{kind}"), executed(f"wire{kind}")
    assert other[1].outcome == "COMPLETED", other[1].message
    assert one[2] == other[2]
    for k, name in enumerate(one[2]):
        assert np.array_equal(one[0].counts[:, k], other[0].counts[:, k]), name
    assert one[0].segments == other[0].segments


def test_without_a_mark_nobody_knows_where_it_lies() -> None:
    plan = (ServoOff(0.1), Ramp(SPEED, 2000.0), PLAN[5], Ramp(0.0, 400.0))
    run, report, _ = executed("sim", plan=plan)
    assert report.outcome == "ERROR"
    assert "index mark before it" in report.message
    assert report.safe
    assert [segment.label for segment in run.segments] == ["approach (cut)"]


class View:
    """A rig that has seen its marks: the input's at 1.0 rad, the output's 0.3 rad into some turn of its own."""

    period, setpoint = 1e-3, SPEED

    def __init__(self, turns: float, behind: float) -> None:
        self._input = 1.0 + REVOLUTION * turns
        self._latched = 0.3
        self._output = 0.3 - (self._input - 1.0 - REVOLUTION * behind) / 120.0

    def input_angle(self) -> float:
        return self._input

    def output_angle(self) -> float:
        return self._output

    def index_angle(self, which: str) -> float:
        return 1.0 if which == "input" else self._latched


@pytest.mark.parametrize("behind", [0.02, 0.41, 0.98])
@pytest.mark.parametrize("off", [-0.03, 0.0, 0.03])
def test_the_turn_is_that_of_the_table(behind: float, off: float) -> None:
    """However the marks are read a little off, the turn is the same: a mark beside the other would jump a whole one."""
    table = replace(TABLE, index_gap=behind)
    zero, gap = index_zero(View(50.0, behind + off), table)  # type: ignore[arg-type]
    assert zero == pytest.approx(1.0)
    assert gap == pytest.approx(behind + off)
    if math.floor(behind + off) < 0:
        loose, _ = index_zero(View(50.0, behind + off), replace(table, index_gap=None))  # type: ignore[arg-type]
        assert loose == pytest.approx(1.0 - REVOLUTION)


def test_any_stretch_of_a_profile_is_the_same() -> None:
    profile = Corrected(SPEED, 0.7, 1e-3, TABLE.of(1.0), 2.0)
    whole = profile.targets(0, 3000)
    for start, count in ((0, 1), (255, 2), (256, 700), (1999, 1001)):
        again = Corrected(SPEED, 0.7, 1e-3, TABLE.of(1.0), 2.0).targets(start, count)
        assert np.array_equal(again, whole[start : start + count])
    assert np.array_equal(profile.targets(2999, 1), whole[2999:])


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (FollowTable(1.0, 0.0, TABLE, 5.0), "standstill"),
        (FollowTable(10.0, SPEED, TABLE, 1.0), "longer than its own limit"),
    ],
)
def test_an_impossible_one_is_refused(step: FollowTable, words: str) -> None:
    with pytest.raises(PlanError, match=words):
        planned_of(step)
