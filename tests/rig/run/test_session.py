"""The session: every ending leaves a verified standstill, a file that can be read, and the right outcome."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.drive_state import DriveState
from drivers.port import DriveLimits, Mode
from experiments.finding import Severity
from experiments.recording import Event
from experiments.steps.vocabulary import (
    FindIndex,
    HoldTime,
    Ramp,
    SegmentLabel,
    Step,
    TorqueRamp,
)
from rig.errors import RigError
from rig.run.engine import CUT
from rig.run.make_safe import Action
from rig.run.opening import begin_inline_run
from rig.run.parts import Progress, RunReport
from rig.run.preflight import channel_checks, set_point_checks, static_checks
from rig.run.session import execute, output_sense
from rig.run.stop import StopRequest
from rig.runfile.read import close_recording, open_run
from tests.rig.fake_rig import INCOMPLETE, FakeRig, ListRun, parts_of, planned_of
from tests.rig.run.test_engine import EVERYTHING

SHORT: tuple[Step, ...] = (
    Ramp(20.0, 500.0),
    HoldTime(0.5, SegmentLabel("hold", 20.0, 1)),
    Ramp(0.0, 500.0),
)


def run_short(rig: FakeRig | None = None, **more: object) -> tuple[ListRun, RunReport]:
    run, rig = ListRun(), rig or FakeRig()
    order = parts_of(planned_of(*SHORT), rig, Path(), more.pop("block", 50))  # type: ignore[arg-type]
    return run, execute(order, lambda *_: run, **more)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def segments() -> dict[str, int]:
    """Row in the middle of every segment of the plan with every kind of step."""
    run = ListRun()
    execute(parts_of(planned_of(*EVERYTHING), FakeRig(), Path()), lambda *_: run)
    return {s.label: (s.start + s.stop) // 2 for s in run.segments}


LABELS = [s.segment.label for s in EVERYTHING if getattr(s, "segment", None) is not None]  # type: ignore[union-attr]


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("word", ["STOP", "ABORT"])
def test_stop_and_abort_at_every_kind_of_step(
    word: str, label: str, segments: dict[str, int], tmp_path: Path
) -> None:
    stop = StopRequest()
    row = segments[label]
    rig = FakeRig(script={row: lambda _: stop.stop() if word == "STOP" else stop.abort()})
    report = execute(
        parts_of(planned_of(*EVERYTHING), rig, tmp_path, 20), begin_inline_run, stop=stop
    )
    assert report.outcome == "ABORTED"
    assert report.safe, report.message
    assert report.make_safe is not None
    assert report.make_safe.action is (
        Action.CONTROLLED_STOP if word == "STOP" else Action.QUICK_STOP
    )
    assert report.make_safe.verified_by == ("statusword", "input_angle", "output_angle")
    assert rig.physics.speed == 0.0
    assert rig.physics.state is DriveState.READY
    assert rig.closed
    assert word in report.message
    recording = open_run(report.path, verify=True)
    assert recording.metadata.outcome == "ABORTED"
    assert recording.rows == report.rows
    assert recording.segments[-1].label == label + CUT
    assert recording.segments[-1].stop <= row + 21
    assert not recording.labelled(label) or label in LABELS[: LABELS.index(label)]
    assert word in [event.code for event in recording.events]
    close_recording(recording)


def test_a_second_press_turns_the_ramp_into_a_quick_stop() -> None:
    stop = StopRequest()
    rig = FakeRig(script={400: lambda _: stop.press(), 405: lambda _: stop.press()})
    _, report = run_short(rig, stop=stop, block=2)
    assert report.outcome == "ABORTED"
    assert report.make_safe is not None
    assert report.make_safe.action is Action.QUICK_STOP
    assert Mode.QUICK_STOP in {mode for mode, _ in rig.exchanged}
    assert report.safe


@pytest.mark.parametrize("outcome", ["ABORTED", "ERROR"])
@pytest.mark.parametrize("block", [1, 20])
def test_a_ramp_that_the_drive_does_not_hear_becomes_a_quick_stop(outcome: str, block: int) -> None:
    """Whatever the ramp was begun for: a word of the operator, or a step that failed."""
    stop, run, rig = StopRequest(), ListRun(), FakeRig()
    steps = SHORT if outcome == "ABORTED" else (*SHORT[:1], FindIndex("output", 20.0, 0.3))

    def ramps(step: str, text: str) -> None:
        if step in ("STOP", "step-failed"):
            at = rig.physics.cycle + 3
            rig.script[at] = lambda _: setattr(rig.physics, "flags", INCOMPLETE)
            rig.script[at + 60] = lambda _: setattr(rig.physics, "flags", 0)

    if outcome == "ABORTED":
        rig.script[450] = lambda _: stop.stop()
    report = execute(
        parts_of(planned_of(*steps), rig, Path(), block),
        lambda *_: run,
        stop=stop,
        on_event=lambda event: ramps(event.code, event.text),
    )
    assert report.make_safe is not None
    assert report.make_safe.action is Action.QUICK_STOP
    assert report.outcome == ("TRIPPED" if outcome == "ABORTED" else "ERROR")
    assert report.trip is not None
    assert report.trip.cause == "stale_data"
    assert "stale_data" in report.message
    assert report.safe


def test_a_press_before_anything_moves_and_one_after_the_end() -> None:
    stop = StopRequest()
    stop.press()
    rig = FakeRig()
    _, report = run_short(rig, stop=stop)
    assert report.outcome == "ABORTED"
    assert {mode for mode, _ in rig.exchanged} == {Mode.OFF}
    late = StopRequest()
    _run, report = run_short()
    end = report.rows - 50
    _, report = run_short(FakeRig(script={end: lambda _: late.press()}), stop=late)
    assert report.outcome == "COMPLETED"


def test_the_drive_must_hold_what_was_written() -> None:
    def forget(limits: DriveLimits) -> DriveLimits:
        return replace(limits, torque=2.23)

    rig = FakeRig(limits_read=forget)
    run, report = run_short(rig)
    assert (report.outcome, run.outcome) == ("ERROR", "ERROR")
    assert "torque limit reads back differently" in report.message
    assert "value 2.23" in report.message
    assert {mode for mode, _ in rig.exchanged} == {Mode.OFF}
    assert report.safe
    assert rig.closed


def test_a_rig_that_turns_or_shows_a_fault_is_not_started() -> None:
    for change in (_turning, _faulty, _offset):
        rig = FakeRig()
        change(rig)
        run, report = run_short(rig)
        assert report.outcome == "ERROR"
        assert "not ready, nothing has moved" in report.message
        assert {mode for mode, _ in rig.exchanged} == {Mode.OFF} or change is _turning
        assert run.outcome == "ERROR"


def _turning(rig: FakeRig) -> None:
    rig.physics.speed = 50.0
    rig.physics.ignore_off = True


def _faulty(rig: FakeRig) -> None:
    rig.physics.fault = True


def _offset(rig: FakeRig) -> None:
    rig.physics.torque_extra = 0.1


def test_a_missing_channel_is_refused_by_name() -> None:
    checks = channel_checks(FakeRig().channels[:1], ("input_angle", "torque"), _today())
    failed = [check for check in checks if check.severity is Severity.BLOCKS]
    assert "torque" in failed[0].found
    checks = channel_checks(FakeRig().channels[:1], ("input_angle",), _today())
    assert "not watched" in str(checks[1])


def test_a_plan_whose_set_points_the_rig_does_not_take_is_refused_before_anything_moves() -> None:
    channels = FakeRig().channels
    plan = (Ramp(10.0, 100.0), TorqueRamp(0.2, 0.02, 0.05))
    assert set_point_checks(channels, plan) == ()
    (check,) = set_point_checks([c for c in channels if c.name != "target_torque"], plan)
    assert check.severity is Severity.BLOCKS
    assert "target_torque" in check.found
    assert set_point_checks([c for c in channels if c.name != "target_torque"], plan[:1]) == ()


def test_a_calibration_that_is_overdue_is_a_warning() -> None:
    channel = FakeRig().channels[0]
    for due, result in (("2020-01-01", "warns"), ("2030-01-01", "passed"), ("soon", "warns")):
        aged = replace(channel, calibration=replace(channel.calibration, due=due))
        checks = {check.what: check for check in channel_checks([aged], ("input_angle",), _today())}
        assert checks["calibration"].severity == result


def test_a_folder_that_is_none_is_refused_before_the_rig_is_opened(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("x")
    rig = FakeRig()
    with pytest.raises(RigError, match="not ready, nothing has moved"):
        execute(parts_of(planned_of(*SHORT), rig, file / "runs"), begin_inline_run)
    assert rig.exchanged == []
    checks = static_checks(planned_of(*SHORT), tmp_path)
    assert [check.severity for check in checks] == ["passed", "warns"]
    assert "computed" in checks[1].found


def test_a_recorder_that_fails_ends_the_run_but_not_the_making_safe() -> None:
    rig, run = FakeRig(), ListRun(fail_after=500)
    report = execute(parts_of(planned_of(*SHORT), rig, Path(), 50), lambda *_: run)
    assert report.outcome == "ERROR"
    assert "the disk is full" in report.message
    assert report.safe
    assert not report.readable
    assert run.abandoned
    assert run.outcome is None
    assert rig.physics.speed == 0.0


@pytest.mark.parametrize("error", [ZeroDivisionError("a defect"), KeyboardInterrupt()])
def test_an_exception_nobody_expected_is_made_safe_and_sealed(error: BaseException) -> None:
    def fail(_: FakeRig) -> None:
        rig.script.clear()
        raise error

    rig, run = FakeRig(script={400: fail}), ListRun()
    with pytest.raises(type(error)):
        execute(parts_of(planned_of(*SHORT), rig, Path(), 50), lambda *_: run)
    assert run.outcome == ("ABORTED" if isinstance(error, KeyboardInterrupt) else "ERROR")
    assert "made-safe" in run.codes()
    assert "exception" in run.codes()
    assert rig.physics.speed == 0.0
    assert rig.closed


def test_a_failed_make_safe_is_the_loudest_thing() -> None:
    def keep_power(rig: FakeRig) -> None:
        rig.physics.ignore_off = True

    run, report = run_short(FakeRig(script={800: keep_power}))
    assert report.outcome == "TRIPPED"
    assert not report.safe
    assert "make_safe_failed" in report.message
    assert "emergency stop" in report.message
    assert run.outcome == "TRIPPED"
    assert report.trip is not None
    assert report.as_json()["make_safe"]["safe"] is False


def test_a_run_brought_to_its_end_is_completed_whatever_the_gear_is_worth() -> None:
    run, report = run_short()
    assert (report.outcome, run.outcome) == ("COMPLETED", "COMPLETED")
    assert set(report.metrics) >= {"missed_share"}


def test_what_is_kept_is_everything_in_order(tmp_path: Path) -> None:
    order = parts_of(
        planned_of(*SHORT), FakeRig(), tmp_path, said={"operator": "Ada", "serial": "G7", "seed": 3}
    )
    report = execute(order, begin_inline_run)
    recording = open_run(report.path, verify=True)
    metadata = recording.metadata
    assert metadata.run_id == report.run_id
    assert (metadata.operator, metadata.gear_serial, metadata.outcome) == ("Ada", "G7", "COMPLETED")
    assert metadata.ratio == 120.0
    assert metadata.output_sense == -1
    assert metadata.start_time.startswith("2023-11-14T22:13:20")
    assert recording.rows == report.rows
    time = recording.time()
    assert np.allclose(np.diff(time), 1e-3)
    assert [s.label for s in recording.segments] == ["hold"]
    hold = recording.segments[0]
    assert np.mean(np.diff(recording.si("input_angle", hold))) == pytest.approx(20.0e-3, rel=0.01)
    codes = [event.code for event in recording.events]
    assert codes.count("preflight") >= 6
    assert "made-safe" in codes
    assert "margin" in codes
    close_recording(recording)


def test_progress_and_events_are_told() -> None:
    seen: list[Progress] = []
    events: list[Event] = []
    _, report = run_short(on_progress=seen.append, on_event=events.append)
    assert report.outcome == "COMPLETED"
    left = [progress.left for progress in seen]
    assert all(later <= earlier + 1e-9 for earlier, later in itertools.pairwise(left))
    assert seen[-1].what == "making safe"
    # Within the time that a step was to take, what is left goes down as the clock goes on: from its own begin on.
    holds = [progress for progress in seen if progress.what.startswith("hold")]
    assert len(holds) > 3
    assert holds[0].left - holds[-1].left == pytest.approx(holds[-1].elapsed - holds[0].elapsed)
    assert any(
        progress.what.startswith("hold") and progress.speed == pytest.approx(20.0, rel=0.1)
        for progress in seen
    )
    assert any(event.code == "made-safe" for event in events)


def test_one_stop_is_stop_and_two_are_abort() -> None:
    request = StopRequest()
    levels: list[int] = [request.level]
    for press in (request.press, request.press, request.stop):
        _press(press)
        levels.append(request.level)
    assert levels == [0, 1, 2, 2]
    assert output_sense("circular-spline-fixed") == -1
    assert output_sense("flexspline-fixed") == 1


def _press(press: Callable[[], None]) -> None:
    press()


def _today():
    from datetime import date

    return date(2026, 1, 1)


def test_progress_tells_when_each_step_began() -> None:
    """Three steps that follow each other; the segment of the hold begins with its step."""
    told: list[Progress] = []
    run, report = run_short(on_progress=told.append)
    assert report.outcome == "COMPLETED"
    begun = list(told[-1].begun)
    assert len(begun) == 3
    assert begun == sorted(begun)
    (hold,) = run.segments
    period = 1e-3
    assert begun[1] == pytest.approx(hold.start * period)
    assert begun[2] == pytest.approx(hold.stop * period)
    # Nothing is told of a step before it begins.
    assert len(told[0].begun) == 1
