"""Every kind of step through plan, words, timeline, preview and a run: one that is forgotten somewhere fails here."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import VirtualClock
from experiments import steps
from experiments.errors import PlanError
from experiments.steps.kind import Instant, Motion, Servo
from experiments.steps.vocabulary import (
    FindIndex,
    FollowTable,
    HoldRevolutions,
    HoldTime,
    Mark,
    MoveRevolutions,
    MoveToAngle,
    Prompt,
    Ramp,
    SegmentLabel,
    ServoOff,
    Settle,
    Sine,
    SpeedStep,
    Step,
    TorqueRamp,
)
from model.compensation import table_of_set
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import REVOLUTION
from rig.bench import limits as lim
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.present.preview.figures import figures_of
from rig.present.preview.plan import preview_plan
from rig.run.dry_run import PlannedRun
from rig.run.engine import CUT
from rig.run.make_safe import Action
from rig.run.parts import Progress, RunReport, SessionParts
from rig.run.session import execute
from rig.run.stop import StopRequest
from sim_backend.direct import SimulatedRig
from sim_backend.world import World
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

GEAR, MOTOR = shipped_gear(), shipped_motor()
UP, DOWN = Ramp(20.0, 400.0), Ramp(0.0, 400.0)
LABEL = SegmentLabel("x", 20.0, 1)
MARKS = (FindIndex("input", 20.0, 5.0), FindIndex("output", 20.0, 60.0))
TABLE = table_of_set(GEAR, "circular-spline-fixed")


@dataclass(frozen=True)
class Sample:
    """A step, with what has to stand before and after it."""

    step: Step
    before: tuple[Step, ...] = ()
    after: tuple[Step, ...] = ()

    @property
    def plan(self) -> tuple[Step, ...]:
        return (ServoOff(0.1), *self.before, self.step, *self.after, HoldTime(0.1), ServoOff(0.1))

    @property
    def index(self) -> int:
        return 1 + len(self.before)


SAMPLES = (
    Sample(ServoOff(0.2, LABEL)),
    Sample(Ramp(-20.0, 400.0, LABEL), (UP,), (DOWN,)),
    Sample(SpeedStep(30.0, 0.1, 1.0, LABEL), (), (DOWN,)),
    Sample(HoldRevolutions(1.0, 5.0, LABEL), (UP,), (DOWN,)),
    Sample(FollowTable(1.5, 20.0, TABLE, 5.0, 1.0, LABEL), MARKS, (DOWN,)),
    Sample(HoldTime(0.2, LABEL), (UP,), (DOWN,)),
    Sample(Settle(0.1, 0.05, 2.0, LABEL), (UP,), (DOWN,)),
    Sample(MoveToAngle(1.0, 20.0, 400.0, 5.0, LABEL)),
    Sample(MoveRevolutions(-0.7, 20.0, 400.0, 5.0, LABEL)),
    Sample(FindIndex("input", 15.0, 5.0, LABEL), (), (DOWN,)),
    Sample(TorqueRamp(0.5, 0.4, 0.05, LABEL), (), (DOWN,)),
    Sample(Sine(2.0, 0.8, 2, LABEL)),
    Sample(Prompt("Is the cover closed?", "cover"), (UP,), (DOWN,)),
    Sample(Mark("note", "half-way"), (UP,), (DOWN,)),
)
PER_SAMPLE = pytest.mark.parametrize("sample", SAMPLES, ids=lambda s: type(s.step).__name__)


def simulated(
    planned: PlannedRun,
    block: int = 100,
    stop_at: float | None = None,
    word: str = "STOP",
) -> tuple[ListRun, RunReport]:
    """A run on the simulated rig with all that is wrong with it; STOP or ABORT after `stop_at` [s]."""
    run, stop, clock = ListRun(), StopRequest(), VirtualClock(1_700_000_000_000_000_000)

    def press(progress: Progress) -> None:
        if stop_at is not None and progress.elapsed >= stop_at:
            (stop.stop if word == "STOP" else stop.abort)()

    rig = SimulatedRig(GEAR, MOTOR, world=World.of(5), clock=clock)
    parts = SessionParts(
        order=Order(protocol="", gear=GEAR, motor=MOTOR),
        planned=planned,
        rig=AssembledRig(name="sim", port=rig, clock=clock),
        cycles=block,
    )
    return run, execute(parts, lambda *_: run, stop=stop, on_progress=press)


def kinds_of(root: type) -> set[type]:
    """The kinds of steps below a root, wherever in their package they stand."""
    below = {root for root in root.__subclasses__() if root.__module__.startswith(steps.__name__)}
    deeper = set[type]().union(*map(kinds_of, below))
    return {kind for kind in below | deeper if not inspect.isabstract(kind)}


def test_every_kind_is_in_the_vocabulary_and_is_walked_here() -> None:
    for module in pkgutil.iter_modules(steps.__path__):
        importlib.import_module(f"{steps.__name__}.{module.name}")
    assert set(typing.get_args(Step)) == kinds_of(Motion) | kinds_of(Instant)
    assert [type(sample.step) for sample in SAMPLES] == list(typing.get_args(Step))


@PER_SAMPLE
def test_it_is_planned_described_and_drawn(sample: Sample) -> None:
    planned = planned_of(*sample.plan)
    forecast = planned.steps[sample.index]
    assert forecast.what == sample.step.words()
    assert forecast.what.startswith(("x", type(sample.step).__name__))
    assert 0.0 <= forecast.nominal <= forecast.longest
    assert abs(forecast.net) <= forecast.turned
    assert min(0.0, forecast.net) >= forecast.travel[0] - 1e-9 or forecast.net > 0.0
    assert forecast.speed >= max(abs(forecast.begin), abs(forecast.end))
    preview = preview_plan(planned)
    course = preview.timeline
    own = course.step == sample.index
    if isinstance(sample.step, Motion):
        length = float(np.sum((course.stop - course.start)[own]))
        assert length == pytest.approx(forecast.nominal)
        assert set(course.mode[own]) <= {Servo.OFF, sample.step.servo}
        speeds = np.abs(np.concatenate([course.begin[own], course.end[own]]))
        assert speeds.max() <= forecast.speed + 1e-9
        # A speed step is there at once in the plan, and after the drive's own ramp in the preview.
        mean = 0.5 * (course.begin + course.end) * (course.stop - course.start)
        assert float(np.sum(mean[own])) == pytest.approx(forecast.net, abs=0.1)
    else:
        assert not own.any()
        assert [mark.step for mark in preview.marks] == [sample.index]
    assert course.duration == pytest.approx(planned.nominal)
    assert any(peak.where == forecast.where for peak in preview.peaks) == own.any()
    assert all(len(plot.series[0].x) for plot in figures_of(preview).values())


@PER_SAMPLE
def test_it_runs_on_the_simulated_rig_within_its_plan_and_its_limits(sample: Sample) -> None:
    planned = planned_of(*sample.plan)
    run, report = simulated(planned)
    assert report.outcome == "COMPLETED", report.message
    assert report.safe
    assert all(margin["margin"] > 0.0 for margin in report.margins.values()), report.margins
    low, high = planned.travel
    angle = (run.counts[:, 0] - run.counts[0, 0]) / 32768 * REVOLUTION
    assert low < angle.min()
    assert angle.max() < high
    labels = [segment.label for segment in run.segments]
    assert labels == (["x"] if isinstance(sample.step, Motion) else [])
    for segment in run.segments:
        assert (segment.stop - segment.start) * 1e-3 <= planned.steps[sample.index].longest + 1e-9


SWING = planned_of(ServoOff(0.2), *(s.step for s in SAMPLES if isinstance(s.step, Sine)))


@pytest.fixture(scope="module")
def reference() -> ListRun:
    return simulated(SWING, 1000)[0]


@pytest.mark.parametrize("block", [1, 7, 100])
def test_a_swing_gives_the_same_counts_in_any_blocks(block: int, reference: ListRun) -> None:
    run, report = simulated(SWING, block)
    assert report.outcome == "COMPLETED"
    assert np.array_equal(run.counts, reference.counts)
    assert run.segments == reference.segments


def test_a_swing_follows_its_equation_and_comes_back(reference: ListRun) -> None:
    swing = next(s for s in reference.segments if s.label == "x")
    assert swing.stop - swing.start == 1600
    angle = reference.counts[swing.start : swing.stop, 0] / 32768 * REVOLUTION
    time = np.arange(1600) * 1e-3
    ideal = angle[0] + 2.0 * (1.0 - np.cos(REVOLUTION * time / 0.8))
    # The drive's speed loop lags a little, and its whole motion with it.
    assert np.abs(angle - ideal).max() < 0.3
    assert angle[-1] == pytest.approx(angle[0], abs=0.15)
    rig = FakeRig()
    run = ListRun()
    assert execute(parts_of(SWING, rig, Path(), 100), lambda *_: run).outcome == "COMPLETED"
    targets = run.counts[:, [c.name for c in rig.channels].index("target_speed")]
    moving = np.flatnonzero(targets)
    assert targets.max() == -targets.min() == round(2.0 * REVOLUTION / 0.8 * 1e4)
    assert targets[moving[0] : moving[-1] + 1].sum() == 0
    assert np.abs(np.diff(targets)).max() * 1e-4 / 1e-3 <= SWING.steps[1].acceleration * 1.001


@pytest.mark.parametrize(
    ("amplitude", "period", "cycles"), [(0.5, 10.0, 3), (-6.0, 4.0, 2), (3.0, 0.5, 4)]
)
def test_plan_and_preview_agree_on_a_swing(amplitude: float, period: float, cycles: int) -> None:
    # What switches the servo on is not the swing: its time would stand in one r.m.s. and not in the other.
    planned = planned_of(HoldTime(0.1), Sine(amplitude, period, cycles))
    forecast, preview = planned.steps[1], preview_plan(planned)
    rate = REVOLUTION / period
    assert forecast.speed == pytest.approx(abs(amplitude) * rate)
    assert forecast.acceleration == pytest.approx(abs(amplitude) * rate**2)
    assert (forecast.net, forecast.turned) == (0.0, 4.0 * abs(amplitude) * cycles)
    assert planned.input_revolutions == pytest.approx(4.0 * abs(amplitude) * cycles / REVOLUTION)
    assert np.abs(preview.speed).max() == pytest.approx(forecast.speed)
    assert np.sign(preview.speed[preview.speed != 0.0][0]) == np.sign(amplitude)
    plan = {margin.quantity: margin.value for margin in planned.margins}
    drawn = {margin.quantity: margin.value for margin in preview.margins}
    for quantity in (lim.INPUT_SPEED, lim.MOTOR_TORQUE, lim.RMS_TORQUE, lim.TORSION_TORQUE):
        assert drawn[quantity] == pytest.approx(plan[quantity], rel=0.005), quantity
    # A swing is at its peaks for moments only: the mean is not the peak.
    assert plan[lim.AVERAGE_SPEED] < 0.7 * plan[lim.INPUT_SPEED]


@pytest.mark.parametrize("word", ["STOP", "ABORT"])
@pytest.mark.parametrize("stop_at", [0.7, 0.9, 1.3])
def test_a_swing_that_is_stopped_ends_at_a_standstill(word: str, stop_at: float) -> None:
    run, report = simulated(SWING, 50, stop_at, word)
    assert report.outcome == "ABORTED"
    assert report.safe, report.message
    assert report.make_safe is not None
    action = Action.CONTROLLED_STOP if word == "STOP" else Action.QUICK_STOP
    assert report.make_safe.action is action
    assert [segment.label for segment in run.segments] == ["x" + CUT]
    assert np.ptp(run.counts[-50:, 0]) < 10


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ((UP, Sine(1.0, 1.0, 1)), "standstill"),
        ((Sine(0.0, 1.0, 1),), "amplitude"),
        ((Sine(float("nan"), 1.0, 1),), "amplitude"),
        ((Sine(1.0, 1.0, 0),), "whole"),
        ((Sine(1.0, 1.0, 1.5),), "whole"),  # type: ignore[arg-type]
        ((Sine(1.0, 0.01, 1),), "SYNC cycles"),
        ((Sine(1.0, float("inf"), 1),), "SYNC cycles"),
    ],
)
def test_an_impossible_swing_is_refused(steps: tuple[Step, ...], words: str) -> None:
    with pytest.raises(PlanError, match=words):
        planned_of(*steps)


def test_a_reversal_turns_both_ways_and_hardly_moves_on() -> None:
    planned = planned_of(UP, Ramp(-20.0, 400.0), DOWN)
    reversal = planned.steps[1]
    assert abs(reversal.net) < 0.05
    assert reversal.turned == pytest.approx(2.0 * 0.5 * 20.0 * 20.0 / 400.0, rel=0.01)
