"""Make-safe: what is commanded, what is verified, how it escalates, and how loudly it fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from drivers.drive_state import DriveState
from drivers.port import Answer, Ask, Guard, Mode, Reach, Request
from drivers.samples import CycleFlag, is_stale
from experiments.steps.profile import Constant
from experiments.steps.vocabulary import SegmentLabel
from rig.run.direct_line import STOP, requests_for
from rig.run.make_safe import STAGES, Action, MakeSafe, MakeSafeReport, Stage
from rig.run.phases import Machine, Phase, PhaseRunner, Phases
from tests.rig.fake_rig import INCOMPLETE, FakeRig


class Notes:
    def __init__(self) -> None:
        self.events: list[tuple[str, str, str]] = []

    def segment(self, label: SegmentLabel, start: int, stop: int) -> None:
        raise AssertionError("making safe has no segments")

    def event(self, level: str, code: str, source: str, text: str) -> None:
        self.events.append((level, code, text))


def made_safe(
    action: Action,
    change: Callable[[FakeRig], None],
    speed: float = 30.0,
    block: int = 20,
    line: Answers | None = None,
    deceleration: float = 500.0,
) -> tuple[FakeRig, MakeSafeReport, Notes]:
    """Bring an ideal rig to `speed`, change something about it, make it safe."""
    rig, notes = FakeRig(), Notes()
    rig.open()
    machine = Machine(rig.channels, rig.cycle_ns)

    def approach() -> Phases:
        yield Phase(Mode.SPEED, 200, Constant(speed))

    _exchange(rig, machine, PhaseRunner(approach(), machine, 100))
    rig.exchanged.clear()
    change(rig)
    direct = None if line is None else line.of(rig)
    make_safe = MakeSafe(action, machine, notes, deceleration, 120.0, block, line=direct)
    _exchange(rig, machine, make_safe)
    return rig, make_safe.report, notes


def _exchange(rig: FakeRig, machine: Machine, source: PhaseRunner | MakeSafe) -> None:
    turn = source.next(None)
    while turn is not None:
        block = rig.exchange(turn.command, turn.cycles, Guard(turn.until))
        machine.accept(block, turn)
        turn = source.next(block)


def nothing(rig: FakeRig) -> None:
    pass


@pytest.mark.parametrize("action", list(Action))
@pytest.mark.parametrize("speed", [0.0, 30.0, -30.0])
def test_a_drive_that_obeys_stands_verified_by_three_observers(
    action: Action, speed: float
) -> None:
    rig, report, notes = made_safe(action, nothing, speed)
    assert report.safe
    assert report.problem == ""
    assert report.verified_by == ("statusword", "input_angle", "output_angle")
    assert report.stages[-1] == Stage.SERVO_OFF.value
    assert rig.physics.speed == 0.0
    assert rig.physics.state is DriveState.READY
    assert rig.exchanged[-1][0] is Mode.OFF
    assert [code for _, code, _ in notes.events] == ["made-safe"]


def test_a_controlled_stop_is_a_ramp_and_a_quick_stop_is_not() -> None:
    rig, _, _ = made_safe(Action.CONTROLLED_STOP, nothing)
    assert {mode for mode, _ in rig.exchanged} == {Mode.SPEED, Mode.OFF}
    rig, _, _ = made_safe(Action.QUICK_STOP, nothing)
    assert {mode for mode, _ in rig.exchanged} == {Mode.QUICK_STOP, Mode.OFF}
    rig, _, _ = made_safe(Action.ZERO_TORQUE, nothing)
    assert {mode for mode, _ in rig.exchanged} == {Mode.OFF}


def test_a_ramp_that_is_not_obeyed_becomes_a_quick_stop() -> None:
    def ignore_ramp(rig: FakeRig) -> None:
        rig.physics.ignore_ramp = True

    rig, report, notes = made_safe(Action.CONTROLLED_STOP, ignore_ramp)
    assert report.stages[:2] == ["ramp down", "quick stop"]
    assert notes.events[0][:2] == ("error", "make-safe-escalated")
    # This rig ignores every ramp, quick stop or not, and its power stage alone cannot stop it.
    assert not report.safe
    assert rig.exchanged[-1][0] is Mode.OFF


def test_a_quick_stop_that_is_not_obeyed_becomes_servo_off() -> None:
    def ignore(rig: FakeRig) -> None:
        rig.physics.ignore_quick_stop = True

    rig, report, notes = made_safe(Action.QUICK_STOP, ignore)
    assert report.stages == ["quick stop", "servo off"]
    assert ("error", "make-safe-escalated") in [(level, code) for level, code, _ in notes.events]
    assert rig.physics.state is DriveState.READY
    assert not report.safe
    assert "the input turns" in report.problem


@pytest.mark.parametrize(("deceleration", "escalated"), [(20.0, []), (500.0, ["quick stop"])])
def test_a_quick_stop_has_the_time_that_its_ramp_takes(
    deceleration: float, escalated: list[str]
) -> None:
    def slow(rig: FakeRig) -> None:
        rig.physics.slowing = 20.0

    # 1.5 s from 30 rad/s: longer than the patience alone.
    _, report, _ = made_safe(Action.QUICK_STOP, slow, deceleration=deceleration)
    assert report.escalated == escalated
    assert report.safe


def test_a_power_stage_that_only_a_quick_stop_switches_off() -> None:
    def keep_power(rig: FakeRig) -> None:
        rig.physics.ignore_off = True

    rig, report, _ = made_safe(Action.ZERO_TORQUE, keep_power, speed=0.0)
    assert report.safe
    assert report.stages == ["servo off", "quick stop", "servo off"]
    assert rig.physics.state is DriveState.SWITCH_ON_DISABLED


def test_a_drive_that_keeps_its_power_is_reported_loudest() -> None:
    def keep_power(rig: FakeRig) -> None:
        rig.physics.ignore_off = rig.physics.ignore_quick_stop = rig.physics.blocked = True

    _, report, notes = made_safe(Action.ZERO_TORQUE, keep_power)
    assert not report.safe
    assert report.stages == ["servo off", "quick stop", "servo off"]
    level, code, text = notes.events[-1]
    assert (level, code) == ("error", "make-safe-failed")
    assert text.startswith("STANDSTILL NOT VERIFIED")
    assert "emergency stop" in text
    assert "the drive is in operation enabled" in text


def test_an_output_that_turns_on_is_no_standstill() -> None:
    def drift(rig: FakeRig) -> None:
        def push(r: FakeRig) -> None:
            r.physics.output_extra += 1.0e-3
            r.script[r.physics.cycle + 10] = push

        rig.script[rig.physics.cycle + 1] = push

    _, report, _ = made_safe(Action.QUICK_STOP, drift)
    assert not report.safe
    assert "the output turns" in report.problem


def test_incomplete_cycles_prove_nothing() -> None:
    def blind(rig: FakeRig) -> None:
        rig.physics.flags = INCOMPLETE

    _, report, _ = made_safe(Action.QUICK_STOP, blind)
    assert not report.safe
    assert report.problem == "cycles are incomplete"


OUTPUT_SILENT = INCOMPLETE | CycleFlag.STALE_OUTPUT
DRIVE_SILENT = (
    INCOMPLETE | CycleFlag.STALE_STATUSWORD | CycleFlag.STALE_INPUT | CycleFlag.STALE_OTHER
)


class Answers:
    """Devices that answer when they are asked, `answering` of them; the input moves by `step`
    counts per cycle. A drive that `obeys` does what it is told, unless its NMT state is STOPPED.
    """

    def __init__(
        self,
        *answering: str,
        step: int = 0,
        obeys: bool = True,
        reach: dict[str, Reach] | None = None,
        rounds: float = math.inf,
    ) -> None:
        self.answering, self.step, self.obeys = answering, step, obeys
        self.rounds = rounds
        self.reached = dict.fromkeys(answering, Reach.SDO) | (reach or {})
        self.asked: list[Request] = []
        self.told: list[Ask] = []
        self.waiting: list[Answer] = []

    def of(self, rig: FakeRig) -> Answers:
        self.rig = rig
        return self

    def reach(self, channel: str) -> Reach:
        if not self.rig.physics.flags:
            return Reach.PROCESS_DATA
        return self.reached.get(channel, Reach.PROCESS_DATA)

    def is_idle(self, channel: str) -> bool:
        return True

    def withdraw(self, channel: str) -> None:
        self.waiting = []

    def hand(self, requests: Sequence[Request]) -> None:
        self.asked += requests
        self.rounds -= 1
        for request in requests:
            if request.ask is Ask.WAKE:
                self.reached[request.channel] = Reach.SDO
            elif self.reached.get(request.channel) is Reach.SDO:
                self.told += [request.ask] if request.ask in STOP.values() else []
            answers = request.channel in self.answering and request.ask is Ask.READ
            answers = answers and self.rounds >= 0
            self.waiting.append(
                Answer(request, self.rig.physics.cycle, self.count(request) if answers else None)
            )

    def count(self, request: Request) -> int:
        is_off = self.obeys and Ask.SERVO_OFF in self.told
        moved = self.step * self.rig.physics.cycle
        return {
            "statusword": 0x0250 if is_off else 0x0237,
            "input_angle": (2**32 - 5 + moved) % 2**32,
            "output_angle": 7,
        }[request.channel]

    def answers(self) -> list[Answer]:
        taken, self.waiting = self.waiting, []
        return taken


def flagged(flags: int) -> Callable[[FakeRig], None]:
    def change(rig: FakeRig) -> None:
        rig.physics.flags = int(flags)

    return change


def test_a_node_that_is_no_observer_may_be_silent() -> None:
    _, report, _ = made_safe(Action.QUICK_STOP, flagged(INCOMPLETE | CycleFlag.STALE_TORQUE))
    assert report.safe
    assert report.verified_by == ("statusword", "input_angle", "output_angle")
    assert report.escalated == []


def test_a_silent_output_encoder_is_named_and_asked() -> None:
    _, report, notes = made_safe(Action.QUICK_STOP, flagged(OUTPUT_SILENT))
    assert report.safe
    assert (report.verified_by, report.silent) == (("statusword", "input_angle"), ("output_angle",))
    level, code, text = notes.events[-1]
    assert (level, code) == ("warning", "made-safe")
    assert text.endswith("the output encoder is silent")
    line = Answers("output_angle")
    _, report, notes = made_safe(Action.QUICK_STOP, flagged(OUTPUT_SILENT), line=line)
    assert report.verified_by == ("statusword", "input_angle", "output_angle (asked by SDO)")
    assert {request.ask for request in line.asked} == {Ask.READ}
    assert notes.events[-1][0] == "info"


def test_the_output_encoder_alone_verifies_nothing() -> None:
    _, report, notes = made_safe(Action.QUICK_STOP, flagged(DRIVE_SILENT))
    assert not report.safe
    assert report.problem == "the input encoder is silent"
    assert report.silent == ("statusword", "input_angle")
    assert notes.events[-1][2].startswith("STANDSTILL NOT VERIFIED")


def test_a_drive_that_answers_is_switched_off_and_verified_by_sdo() -> None:
    line = Answers("statusword", "input_angle")
    _, report, _ = made_safe(Action.QUICK_STOP, flagged(DRIVE_SILENT), line=line)
    assert report.safe
    assert line.asked[0] == Request(Ask.QUICK_STOP, "statusword")
    assert line.told[-1] is Ask.SERVO_OFF
    assert report.stages == ["quick stop by SDO", "servo off by SDO"]
    assert report.verified_by == (
        "statusword (asked by SDO)",
        "input_angle (asked by SDO)",
        "output_angle",
    )
    assert {request.channel for request in line.asked} == {"statusword", "input_angle"}


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        (Answers("statusword", "input_angle", step=6), "the input turns at 1.15 rad/s"),
        (Answers("statusword", "input_angle", obeys=False), "the drive is in operation enabled"),
        (Answers("statusword"), "the input encoder is silent"),
        (Answers("input_angle"), "the statusword is silent"),
        (Answers(), "the input encoder is silent"),
    ],
)
def test_what_a_silent_drive_answers_is_not_believed_beyond_what_it_says(
    line: Answers, problem: str
) -> None:
    _, report, _ = made_safe(Action.QUICK_STOP, flagged(DRIVE_SILENT), line=line)
    assert not report.safe
    assert report.problem == problem


@pytest.mark.parametrize("rounds", [1, 5, 11])
def test_a_drive_that_falls_silent_half_way_proves_nothing(rounds: int) -> None:
    """What it said before it fell silent is not what it does now."""
    line = Answers("statusword", "input_angle", rounds=rounds)
    _, report, _ = made_safe(Action.QUICK_STOP, flagged(DRIVE_SILENT), line=line)
    assert not report.safe
    assert report.silent == ("statusword", "input_angle")


def test_a_stopped_drive_is_woken_before_it_is_told() -> None:
    stopped = {"statusword": Reach.NMT_FIRST}
    line = Answers("statusword", "input_angle", reach=stopped)
    _, report, _ = made_safe(Action.QUICK_STOP, flagged(DRIVE_SILENT), line=line)
    assert report.safe
    assert [r.ask for r in line.asked[:2]] == [Ask.WAKE, Ask.QUICK_STOP]


def test_what_is_asked_by_how_a_device_can_be_reached() -> None:
    line = Answers("statusword", "input_angle").of(FakeRig())
    line.rig.physics.flags = INCOMPLETE
    table = {
        Reach.PROCESS_DATA: [],
        Reach.SDO: [Ask.QUICK_STOP, Ask.READ],
        Reach.NMT_FIRST: [Ask.WAKE, Ask.QUICK_STOP, Ask.READ],
    }
    for reach, asks in table.items():
        line.reached = dict.fromkeys(line.reached, reach)
        found = [r.ask for r in requests_for(line, "statusword", Mode.QUICK_STOP)]
        assert found == asks
        # Only the drive is told anything, and nobody is ever told to turn.
        others = [r.ask for r in requests_for(line, "input_angle", Mode.QUICK_STOP)]
        assert others == [ask for ask in asks if ask is not Ask.QUICK_STOP]
        for mode in (Mode.SPEED, Mode.TORQUE):
            turning = requests_for(line, "statusword", mode, insists=True)
            assert {r.ask for r in turning} <= {Ask.WAKE, Ask.READ}
    assert Ask.SERVO_OFF in [r.ask for r in requests_for(line, "statusword", Mode.OFF)]


def test_which_channels_of_a_cycle_are_old() -> None:
    flags = np.array(
        [0, INCOMPLETE, OUTPUT_SILENT, DRIVE_SILENT, CycleFlag.LATE, INCOMPLETE | 4096],
        dtype=np.uint16,
    )
    assert is_stale(flags, "output_angle").tolist() == [False, True, True, False, False, False]
    assert is_stale(flags, "statusword").tolist() == [False, True, False, True, False, False]
    assert is_stale(flags, "housing_temperature").tolist() == [
        False,
        True,
        False,
        True,
        False,
        True,
    ]


@pytest.mark.parametrize("block", [1, 7, 100])
def test_block_length_does_not_change_what_is_done(block: int) -> None:
    _, report, _ = made_safe(Action.CONTROLLED_STOP, nothing, block=block)
    _, other, _ = made_safe(Action.CONTROLLED_STOP, nothing, block=1000)
    assert report == other


def test_every_list_of_stages_ends_without_power() -> None:
    assert set(STAGES) == set(Action)
    assert all(stages[-1] is Stage.SERVO_OFF for stages in STAGES.values())


def test_without_a_gear_the_output_is_no_observer() -> None:
    rig, notes = FakeRig(), Notes()
    rig.open()
    machine = Machine(rig.channels, rig.cycle_ns)
    make_safe = MakeSafe(Action.ZERO_TORQUE, machine, notes, 100.0, math.nan)
    _exchange(rig, machine, make_safe)
    assert make_safe.report.safe
    assert make_safe.report.verified_by == ("statusword", "input_angle")
