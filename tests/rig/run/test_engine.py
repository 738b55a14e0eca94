"""The engine: steps become commands, segments and events, whatever the length of a block."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from drivers.port import Mode
from experiments.steps.profile import (
    Constant,
    Linear,
    Sinusoid,
    cruise_speed,
    cycles_of,
    ramp,
    ramp_travel,
    stopping_distance,
)
from experiments.steps.vocabulary import (
    FindIndex,
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
    SpeedStep,
    Step,
    TorqueRamp,
)
from model.units import REVOLUTION
from rig.run.engine import Engine
from rig.run.parts import RunReport
from rig.run.phases import Machine
from rig.run.session import execute
from tests.rig.fake_rig import FakeRig, ListRun, parts_of, planned_of

COUNTS = 32768
LABEL = SegmentLabel("x", 1.0, 1, 0)
EVERYTHING: tuple[Step, ...] = (
    ServoOff(0.1, SegmentLabel("torque-zero-before")),
    Ramp(20.0, 500.0, SegmentLabel("ramp")),
    HoldRevolutions(0.25, 5.0, SegmentLabel("hold", 20.0, 1)),
    Settle(0.1, 0.01, 2.0, SegmentLabel("settle")),
    Ramp(0.0, 500.0),
    MoveToAngle(1.0, 20.0, 400.0, 5.0, SegmentLabel("position", 1.0)),
    SpeedStep(30.0, 0.05, 1.0, SegmentLabel("step")),
    Ramp(0.0, 500.0),
    MoveRevolutions(-0.2, 20.0, 400.0, 5.0, SegmentLabel("move")),
    FindIndex("input", 40.0, 5.0, SegmentLabel("home-input")),
    Ramp(0.0, 500.0),
    TorqueRamp(1.0, 0.4, 0.05, SegmentLabel("torque-ramp")),
    Ramp(0.0, 500.0),
    HoldTime(0.05),
    ServoOff(0.1, SegmentLabel("torque-zero-after")),
)


def run_steps(
    *steps: Step, rig: FakeRig | None = None, block: int = 100
) -> tuple[ListRun, RunReport]:
    run = ListRun()
    rig = rig or FakeRig()
    report = execute(parts_of(planned_of(*steps), rig, Path(), block), lambda *_: run)
    return run, report


def turned(run: ListRun, index: int = 0) -> float:
    """Input revolutions of a segment."""
    segment = run.segments[index]
    angle = run.counts[:, 0]
    return (angle[segment.stop - 1] - angle[segment.start - 1]) / COUNTS


@pytest.fixture(scope="module")
def reference() -> ListRun:
    run, report = run_steps(*EVERYTHING, block=1000)
    assert report.outcome == "COMPLETED", report.message
    return run


@pytest.mark.parametrize("block", [1, 7, 100])
def test_block_length_changes_no_count_and_no_segment(block: int, reference: ListRun) -> None:
    run, report = run_steps(*EVERYTHING, block=block)
    assert report.outcome == "COMPLETED"
    assert np.array_equal(run.counts, reference.counts)
    assert run.segments == reference.segments
    # The free space of the disk is the machine's, not the run's.
    told, expected = (
        [(e.code, e.text) for e in r.events if "disk space" not in e.text] for r in (run, reference)
    )
    assert told == expected


def test_segments_follow_the_plan_without_overlap(reference: ListRun) -> None:
    wanted = [s.segment.label for s in EVERYTHING if getattr(s, "segment", None) is not None]  # type: ignore[union-attr]
    assert [s.label for s in reference.segments] == wanted
    stops = [s.stop for s in reference.segments]
    assert all(s.start < s.stop for s in reference.segments)
    assert all(s.start >= stop for s, stop in zip(reference.segments[1:], stops, strict=False))
    assert [s.index for s in reference.segments] == list(range(len(wanted)))
    hold = reference.segments[2]
    assert (hold.setpoint, hold.direction) == (20.0, 1)


def test_revolutions_are_counted_by_the_encoder() -> None:
    run, _ = run_steps(Ramp(-25.0, 1000.0), HoldRevolutions(3.0, 5.0, LABEL), Ramp(0.0, 1000.0))
    assert turned(run) == pytest.approx(-3.0, abs=25.0 * 1e-3 / REVOLUTION + 1.0 / COUNTS)
    assert abs(turned(run)) >= 3.0 - 1.0 / COUNTS


def test_a_speed_step_lasts_until_its_revolutions_are_done() -> None:
    run, _ = run_steps(SpeedStep(60.0, 0.05, 3.0, LABEL), Ramp(0.0, 1000.0))
    assert turned(run) >= 3.0 - 1.0 / COUNTS
    run, _ = run_steps(SpeedStep(60.0, 0.5, 3.0, LABEL), Ramp(0.0, 1000.0))
    assert run.segments[0].stop - run.segments[0].start == 500


@pytest.mark.parametrize(("phase", "speed"), [(1.0, 10.0), (5.5, -10.0), (0.3, 10.0), (0.3, -10.0)])
def test_an_angle_is_reached_from_the_stated_side(phase: float, speed: float) -> None:
    run, report = run_steps(MoveToAngle(phase, speed, 200.0, 5.0, LABEL))
    assert report.outcome == "COMPLETED"
    angle = run.counts[:, 0] / COUNTS * REVOLUTION
    # No index mark was seen before the move: the phase counts from where the run started.
    error = math.remainder(angle[-1] - angle[0] - phase, REVOLUTION)
    assert abs(error) < 0.03
    moves = np.diff(angle)
    assert np.all(moves * math.copysign(1.0, speed) >= 0.0)


def test_after_an_index_mark_the_phase_counts_from_it() -> None:
    run, _ = run_steps(
        FindIndex("input", 12.0, 5.0), Ramp(0.0, 500.0), MoveToAngle(2.0, 10.0, 200.0, 5.0)
    )
    angle = run.counts[-1, 0] / COUNTS * REVOLUTION
    assert math.remainder(angle - 2.0, REVOLUTION) == pytest.approx(0.0, abs=0.03)


def test_a_move_of_part_of_a_revolution_ends_where_it_should() -> None:
    run, _ = run_steps(MoveRevolutions(-1.75, 15.0, 300.0, 5.0, LABEL))
    assert turned(run) == pytest.approx(-1.75, abs=0.005)


def test_a_second_index_search_waits_for_the_next_mark() -> None:
    steps = [
        FindIndex("input", 12.0, 5.0, LABEL),
        FindIndex("input", 12.0, 5.0, LABEL),
        Ramp(0.0, 500.0),
    ]
    run, _ = run_steps(*steps)
    assert turned(run, 1) == pytest.approx(1.0, abs=0.01)


def test_a_torque_ramp_ends_at_first_motion() -> None:
    run, report = run_steps(TorqueRamp(-0.5, 0.4, 0.05, LABEL), Ramp(0.0, 500.0))
    assert "first-motion" in run.codes()
    torque = run.counts[run.segments[0].start : run.segments[0].stop, 2] * 1e-4
    assert torque.min() == pytest.approx(-0.1, abs=0.02)
    assert report.outcome == "COMPLETED"


def test_a_torque_ramp_that_moves_nothing_ends_at_its_limit() -> None:
    def block(rig: FakeRig) -> None:
        rig.physics.blocked = True

    run, report = run_steps(TorqueRamp(0.5, 0.2, 0.05, LABEL), rig=FakeRig(script={0: block}))
    assert "no-motion" in run.codes()
    torque = run.counts[run.segments[0].start : run.segments[0].stop, 2] * 1e-4
    assert torque.max() == pytest.approx(0.2, abs=1e-3)
    assert report.outcome == "COMPLETED"


def test_settling_needs_two_windows_that_agree() -> None:
    def torque(value: float):
        def change(rig: FakeRig) -> None:
            rig.physics.torque_extra = value

        return change

    # Enabling takes 50 cycles after 201 of preflight, the ramp 20: settling begins at row 271 and windows are 100 rows.
    script = {271: torque(0.10), 371: torque(0.06), 471: torque(0.03), 571: torque(0.029)}
    run, _ = run_steps(
        Ramp(20.0, 1000.0),
        Settle(0.1, 0.005, 5.0, LABEL),
        Ramp(0.0, 500.0),
        rig=FakeRig(script=script),
    )
    assert run.segments[0].stop - run.segments[0].start == 400
    assert "not-settled" not in run.codes()


def test_what_never_settles_goes_on_with_a_warning() -> None:
    def drift(rig: FakeRig) -> None:
        rig.physics.torque_extra += 0.02
        rig.script[rig.physics.cycle + 100] = drift

    rig = FakeRig(script={250: drift})
    run, report = run_steps(
        Ramp(20.0, 1000.0), Settle(0.1, 0.005, 1.0, LABEL), Ramp(0.0, 500.0), rig=rig
    )
    assert "not-settled" in run.codes()
    assert run.segments[0].stop - run.segments[0].start == 1000
    assert report.outcome == "COMPLETED"
    assert any("still changed" in warning for warning in report.warnings)


def test_an_overdue_step_is_an_error_of_the_rig_and_ends_at_a_standstill() -> None:
    run, report = run_steps(
        Ramp(1.0, 100.0), HoldRevolutions(0.5, 4.0, LABEL), rig=FakeRig(script={400: _block_input})
    )
    assert report.outcome == "ERROR"
    assert "did not reach 0.5 revolutions" in report.message
    assert report.safe
    assert run.segments[0].label == "x (cut)"


def _block_input(rig: FakeRig) -> None:
    rig.physics.blocked = True


def test_a_drive_that_does_not_switch_on_is_an_error() -> None:
    class Reluctant(FakeRig):
        def _state_machine(self, mode: Mode) -> None:
            self.physics.wait = -10
            super()._state_machine(mode)

    _, report = run_steps(Ramp(10.0, 100.0), rig=Reluctant())
    assert report.outcome == "ERROR"
    assert "does not switch on" in report.message
    assert report.safe


def test_marks_and_prompts_become_events() -> None:
    answers = iter([None, None, "22.5"])
    run = ListRun()
    planned = planned_of(
        Mark("note", "begin"), Prompt("Ambient temperature?", "ambient"), HoldTime(0.05)
    )
    report = execute(
        parts_of(planned, FakeRig(), Path()), lambda *_: run, ask=lambda prompt: next(answers)
    )
    assert report.outcome == "COMPLETED"
    by_code = {event.code: event for event in run.events}
    assert by_code["note"].text == "begin"
    assert by_code["ambient"].text == "Ambient temperature? 22.5"
    # The rig is watched while the operator thinks: two windows of 50 cycles.
    assert report.rows == 201 + 2 * 50 + 50 + 50 + 100


def test_profiles_do_not_depend_on_where_they_are_cut() -> None:
    for profile in (
        Constant(3.0),
        Linear(-2.0, 7.0, 13),
        ramp(5.0, -5.0, 90.0, 1e-3),
        Sinusoid(7.0, 11),
    ):
        whole = profile.targets(0, 40)
        parts = np.concatenate([profile.targets(k, min(7, 40 - k)) for k in range(0, 40, 7)])
        assert np.array_equal(whole, parts)


def test_a_ramp_reaches_its_end_exactly_and_keeps_to_its_acceleration() -> None:
    profile = ramp(0.1, 33.3, 123.0, 1e-3)
    targets = profile.targets(0, profile.cycles + 5)
    assert targets[profile.cycles - 1] == 33.3
    assert np.all(targets[profile.cycles :] == 33.3)
    assert np.max(np.diff(np.concatenate([[0.1], targets]))) <= 123.0e-3 * (1 + 1e-12)
    assert ramp_travel(0.1, 33.3, profile.cycles, 1e-3) == pytest.approx(
        1e-3 * targets[: profile.cycles].sum()
    )
    assert cycles_of(0.1, 1e-3) == 100
    assert cruise_speed(10.0, 50.0, 0.5, 1e-3) == pytest.approx(5.0)
    assert stopping_distance(10.0, 50.0, 1e-3) == pytest.approx(1.0, rel=0.01)


class Quiet:
    def segment(self, label: SegmentLabel, start: int, stop: int) -> None: ...

    def event(self, level: str, code: str, source: str, text: str) -> None: ...


def test_steps_are_described_in_words() -> None:
    machine = Machine(FakeRig().channels, 1_000_000)
    assert Engine((), machine, Quiet(), lambda prompt: "").words == "finished"
    assert Engine((HoldTime(1.0),), machine, Quiet(), lambda prompt: "").words == "HoldTime"
    assert Ramp(math.pi, 1.0, SegmentLabel("ramp")).words() == "ramp 30 r/min"
    assert HoldTime(1.0).words() == "HoldTime"
    assert HoldTime(1.0, SegmentLabel("hold", math.pi, 1)).words() == "hold 30 r/min"
    assert TorqueRamp(0.1, 0.1, 0.1, SegmentLabel("torque-ramp", 1.0, 1)).words() == "torque-ramp"
