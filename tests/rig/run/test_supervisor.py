"""The supervisor: every trip in its table is provoked, names its numbers, and says how the rig is made safe."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.drive_state import DriveState
from drivers.errors import DriverError
from drivers.port import STALE_DATA, Bound, Command, Guard, GuardWatch, Mode
from drivers.samples import CycleFlag, SampleBlock
from experiments.assumed import half_width_of
from experiments.steps.vocabulary import HoldRevolutions, HoldTime, Ramp, SegmentLabel, Step
from rig.bench import limits as lim
from rig.bench.limits import Limit
from rig.run import trips
from rig.run.bounds import Geometry, Watch
from rig.run.make_safe import STAGES, Action
from rig.run.parts import RunReport
from rig.run.phases import Turn
from rig.run.session import execute
from rig.run.supervisor import Supervisor
from tests.rig.fake_rig import INCOMPLETE, FakeRig, ListRun, parts_of, planned_of

AT = 1000
"""Cycle at which things go wrong: the input turns at 40 rad/s then."""
PLAN: tuple[Step, ...] = (
    Ramp(40.0, 500.0),
    HoldTime(3.0, SegmentLabel("hold", 40.0, 1)),
    Ramp(0.0, 500.0),
    HoldTime(0.1),
)


def run_with(
    rig: FakeRig, *steps: Step, block: int = 50, gear_mounted: bool = True, **more: object
) -> tuple[ListRun, RunReport]:
    run = ListRun()
    planned = planned_of(*(steps or PLAN), gear_mounted=gear_mounted)
    return run, execute(parts_of(planned, rig, Path(), block, **more), lambda *_: run)


def at(cycle: int, change: Callable[[FakeRig], object]) -> FakeRig:
    return FakeRig(script={cycle: lambda rig: (change(rig), None)[1]})


def physics(**values: object) -> Callable[[FakeRig], None]:
    def change(rig: FakeRig) -> None:
        for name, value in values.items():
            setattr(rig.physics, name, value)

    return change


def freeze_output(rig: FakeRig) -> None:
    rig.physics.output_stuck = -rig.physics.angle / 120.0


def run_away_unseen(rig: FakeRig) -> None:
    rig.physics.runaway = 40000.0


def strain(rig: FakeRig) -> None:
    """The output is held and the motor pushes: torsion with the torque that makes it."""
    rig.physics.output_stuck = -rig.physics.angle / 120.0
    rig.physics.torque_extra = 0.9


def lose_cycles(rig: FakeRig) -> None:
    rig.skip = 40


def jump_clock(rig: FakeRig) -> None:
    rig.time_offset += 3_600_000_000_000


def mask_torque(rig: FakeRig) -> None:
    # A port that stood on one count meanwhile would be frozen, not wrong.
    rig.physics.drive_torque_gain, rig.physics.port_tremble = 4.0, 1


CASES: list[tuple[str, FakeRig, int]] = [
    (trips.OVER_SPEED, at(AT, run_away_unseen), 20),
    (trips.OVER_TORQUE, at(AT, physics(torque_extra=1.5)), 5),
    (trips.OVERLOAD, at(AT, physics(torque_extra=1.0)), 20_000),
    (trips.TORSION_TORQUE, at(AT, strain), 20),
    (trips.DISAGREEMENT, at(AT, freeze_output), 20),
    (trips.OVER_TEMPERATURE, at(AT, physics(temperature=90.0)), 12),
    (trips.DRIVE_FAULT, at(AT, physics(fault=True)), 2),
    (
        trips.UNEXPECTED_STATE,
        at(AT, physics(state=DriveState.SWITCH_ON_DISABLED, wait=-(10**6))),
        2,
    ),
    (trips.FOLLOWING_ERROR, at(AT, physics(blocked=True)), 500),
    (STALE_DATA, at(AT, physics(flags=INCOMPLETE)), 8),
    (trips.MISSED_CYCLES, at(AT, lose_cycles), 60),
    (trips.SIGNAL_ERROR, at(AT, physics(flags=int(CycleFlag.SIGNAL_ERROR))), 60),
    (trips.COUNT_JUMP, at(AT, physics(flags=int(CycleFlag.JUMPED))), 60),
    (trips.TORQUE_PORT, at(AT, physics(flags=int(CycleFlag.SATURATED))), 100),
    (trips.TORQUE_DISAGREEMENT, at(AT, mask_torque), 1100),
    (trips.TIME_BASE, at(AT, jump_clock), 60),
]


@pytest.mark.parametrize(("cause", "rig", "within"), CASES, ids=[case[0] for case in CASES])
def test_every_trip_is_found_named_and_made_safe(cause: str, rig: FakeRig, within: int) -> None:
    steps = (
        (Ramp(40.0, 500.0), HoldTime(40.0), Ramp(0.0, 500.0)) if cause == trips.OVERLOAD else PLAN
    )
    watch = Watch(thermal_time=2.0) if cause == trips.OVERLOAD else None
    rig.script[AT + within] = lambda r: None
    run, report = run_with(rig, *steps, watch=watch)
    assert report.outcome == "TRIPPED", report.message
    assert report.trip is not None
    assert report.trip.cause == cause
    # The clock's jump and lost cycles are found in the block that begins there.
    assert AT - 50 <= report.trip.row <= AT + within
    rule = trips.TRIPS[cause]
    assert rule.what in report.message
    assert rule.remedy in report.message
    assert report.make_safe is not None
    assert report.make_safe.action is rule.action
    assert cause in run.codes()
    assert run.outcome == "TRIPPED"


@pytest.mark.parametrize(
    ("change", "most", "cause"),
    [
        # 1.5 rad/s and a quarter of the set-point of 40 rad/s; 0.02 N m and 15 % of the drive's 0.08 N m.
        ("short_of", 11.5, trips.FOLLOWING_ERROR),
        ("port_offset", 0.032, trips.TORQUE_ZERO),
    ],
)
def test_what_the_run_allows_unless_it_is_told_otherwise(
    change: str, most: float, cause: str
) -> None:
    _, within = run_with(at(AT, physics(**{change: 0.99 * most, "port_tremble": 1})))
    assert within.outcome == "COMPLETED", within.message
    _, beyond = run_with(at(AT, physics(**{change: 1.01 * most, "port_tremble": 1})))
    assert beyond.trip is not None
    assert (beyond.outcome, beyond.trip.cause) == ("TRIPPED", cause)


def test_a_block_without_rows_changes_nothing() -> None:
    rig = FakeRig()
    supervisor = _supervisor(rig)
    rig.empty = True
    nothing = rig.exchange(Command(Mode.OFF), 5, Guard())
    state = replace(supervisor.state, notes=(("torque-disagreement", "kept"),))
    assert supervisor.reviewed(state, nothing, _turn()) is state


def test_what_recovers_by_itself_is_safe_in_the_end() -> None:
    lasting = {STALE_DATA}
    for cause, _, _ in CASES:
        if cause in lasting or cause in (trips.OVERLOAD, trips.OVER_SPEED):
            continue
        rig = next(c[1] for c in CASES if c[0] == cause)
        fresh = FakeRig(script=dict(rig.script))
        _, report = run_with(fresh)
        assert report.safe, (cause, report.message)


def test_a_trip_that_blinds_the_rig_is_not_called_safe() -> None:
    _, report = run_with(at(AT, physics(flags=INCOMPLETE)))
    assert not report.safe
    assert "cycles are incomplete" in report.message
    assert "emergency stop" in report.message
    assert report.outcome == "TRIPPED"


def test_an_output_that_runs_away_behind_a_stuck_motor_encoder_is_seen() -> None:
    rig = FakeRig()
    run, report = run_with(rig)
    assert report.outcome == "COMPLETED"
    supervisor = _supervisor(rig)
    reference = run.counts[0]
    supervisor.begin(reference)
    causes = {bound.cause for bound in supervisor.guard(_turn()).bounds}
    assert trips.OVER_SPEED_OUTPUT in causes
    bound = next(b for b in supervisor.guard(_turn()).bounds if b.cause == trips.OVER_SPEED_OUTPUT)
    speed = bound.weights["output_angle"] * 120.0 / bound.lag  # counts per lag that are 120 counts
    assert 0.0 < speed < bound.high


def test_leaving_the_planned_travel_trips() -> None:
    def turn_back(rig: FakeRig) -> None:
        rig.physics.runaway = -2000.0

    plan = (Ramp(40.0, 500.0), HoldRevolutions(3.0, 9.0), Ramp(0.0, 500.0))
    planned = planned_of(*plan)
    rig = FakeRig(script={AT - 500: turn_back})
    run = ListRun()
    order = parts_of(planned, rig, Path(), 50)
    # A generous speed limit, so that the travel is what is broken.
    wide = [
        e if e.quantity != lim.INPUT_SPEED else Limit(e.quantity, 500.0, e.tier, e.origin)
        for e in planned.limits.entries
    ]
    order = replace(
        order, planned=replace(planned, limits=replace(planned.limits, entries=tuple(wide)))
    )
    report = execute(order, lambda *_: run)
    assert report.trip is not None
    assert report.trip.cause == trips.TRAVEL
    supervisor = _supervisor(rig, travel=(-10.0, 20.0))
    supervisor.begin(run.counts[0])
    bound = next(b for b in supervisor.guard(_turn()).bounds if b.cause == trips.TRAVEL)
    counts = np.tile(run.counts[0], (2, 1))
    counts[1, 0] += round(21.0 / bound.weights["input_angle"])
    broken = rig._watch.first_break(Guard((bound,)), counts, np.zeros(2, np.uint16))
    assert broken is not None
    assert broken.row == 1


def test_a_bus_that_is_gone_trips_and_is_honest_about_the_standstill() -> None:
    def cut(rig: FakeRig) -> None:
        rig.dead = True

    rig = FakeRig(script={AT: cut})
    run, report = run_with(rig)
    assert report.outcome == "TRIPPED"
    assert report.trip is not None
    assert report.trip.cause == trips.BUS_LOST
    assert not report.safe
    assert "the bus is gone" in report.message or "does not answer" in report.message
    assert run.outcome == "TRIPPED"
    assert rig.closed


def test_a_bus_that_comes_back_is_used_to_stop() -> None:
    class Hiccup(FakeRig):
        missing = 2

        def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
            if self.physics.cycle >= AT and self.missing:
                self.missing -= 1
                raise DriverError("one node did not answer", where="node 2")
            return super().exchange(command, cycles, guard)

    _, report = run_with(Hiccup())
    assert report.outcome == "TRIPPED"
    assert report.trip is not None
    assert report.trip.cause == trips.DEVICE_ERROR
    assert report.safe


def test_a_rig_that_returns_nothing_is_given_up() -> None:
    def fall_silent(rig: FakeRig) -> None:
        rig.empty = True

    _, report = run_with(FakeRig(script={AT: fall_silent}))
    assert report.trip is not None
    assert report.trip.cause == STALE_DATA
    assert not report.safe


def test_a_disk_that_fills_up_trips_before_it_is_full() -> None:
    _, report = run_with(
        FakeRig(),
        Ramp(5.0, 100.0),
        HoldTime(25.0),
        Ramp(0.0, 100.0),
        block=500,
        free_space=lambda: 5_000_000,
    )
    assert report.trip is not None
    assert report.trip.cause == trips.DISK_SPACE
    assert "5 MB free" in report.message
    assert report.safe


def test_the_first_cause_is_latched() -> None:
    supervisor = _supervisor(FakeRig())
    supervisor.latch(trips.Trip(trips.OVER_SPEED, 3, 1.0, 0.5))
    supervisor.latch(trips.Trip(trips.OVER_TORQUE, 4, 1.0, 0.5))
    assert supervisor.state.trip is not None
    assert supervisor.state.trip.cause == trips.OVER_SPEED
    assert supervisor.guard(_turn()).bounds == ()


def test_a_state_that_a_stranger_commanded_bears_the_strangers_name() -> None:
    told = "COB-ID 0x201: a command that is not ours: 06 00"
    for cause, named in (("foreign_command", trips.FOREIGN_COMMAND), ("emcy", "")):
        supervisor = _supervisor(FakeRig())
        left = trips.Trip(trips.UNEXPECTED_STATE, 3, math.nan, math.nan, detail="0x0231")
        supervisor.latch(left)
        supervisor.explain(told, cause)
        assert supervisor.state.trip == (replace(left, cause=named, detail=told) if named else left)


def test_every_trip_has_an_action_and_words() -> None:
    for cause, rule in trips.TRIPS.items():
        assert rule.action in STAGES
        assert rule.action is not Action.CONTROLLED_STOP
        assert rule.what
        assert rule.remedy.endswith(".")
        text = str(trips.Trip(cause, 7, 2.0, 1.0, "N m"))
        assert cause in text
        assert "limit 1 N m" in text


def test_torsion_leaves_room_for_what_is_not_torque() -> None:
    rig = FakeRig()
    supervisor = _supervisor(rig)
    supervisor.begin(np.zeros(len(rig.channels), dtype=np.int64))
    bound = next(b for b in supervisor.guard(_turn()).bounds if b.cause == trips.TORSION_TORQUE)
    outer, inner = (half_width_of(c) for c in (rig.channels[1], rig.channels[0]))
    assert inner > 0.0  # Nobody said how good these encoders are, and that is not "without error".
    assert outer > 0.0
    free = 57000.0 * (3.0e-4 + 2.0 * math.pi / 72000 + 2.0 * math.pi / 32768 / 120.0)
    free += 57000.0 * (2.0 * outer + 2.0 * inner / 120.0)
    assert bound.high == pytest.approx(0.95 * 167.0 - free, rel=1e-6)
    assert bound.low == -bound.high
    counts = np.zeros((1, len(rig.channels)), dtype=np.int64)
    # A rigid gear turning one output revolution backwards is no torque at all.
    counts[0, 0], counts[0, 1] = 120 * 32768, -72000
    assert rig._watch.first_break(Guard((bound,)), counts, np.zeros(1, np.uint16)) is None


@pytest.mark.parametrize("late", [1e-3, -1e-3])
@pytest.mark.parametrize("speed", [300.0, -300.0])
def test_encoders_latched_a_millisecond_apart_are_no_torsion(late: float, speed: float) -> None:
    rig = FakeRig()
    supervisor = _supervisor(rig)
    supervisor.begin(np.zeros(len(rig.channels), dtype=np.int64))
    bound = next(b for b in supervisor.guard(_turn()).bounds if b.cause == trips.TORSION_TORQUE)
    assert 0.9 * bound.high < 57000.0 * 1e-3 * 300.0 / 120.0
    cycles = np.arange(200)
    # Starts, runs, stops within 20 ms: the encoders stand apart only while it turns.
    angle = np.cumsum(np.interp(cycles, (20, 40, 130, 150), (0.0, 1.0, 1.0, 0.0))) * speed * 1e-3
    later = np.interp(cycles * 1e-3 + late, cycles * 1e-3, angle)
    twisted = 0.3 * bound.high / 57000.0
    counts = np.zeros((200, len(rig.channels)), dtype=np.int64)
    counts[:, 0] = np.rint(angle * 32768 / (2.0 * math.pi))
    flags = np.zeros(200, np.uint16)
    for twist, wanted in ((twisted, False), (-twisted, False), (3.9 * twisted, True)):
        counts[:, 1] = -np.rint((later / 120.0 - twist) * 72000 / (2.0 * math.pi))
        broken = GuardWatch(rig.channels).first_break(Guard((bound,)), counts, flags)
        assert (broken is not None) == wanted
    assert broken is not None
    assert broken.row == 4


def test_the_review_is_pure() -> None:
    rig = FakeRig()
    supervisor = _supervisor(rig)
    rig.open()
    turn = Turn(Command(Mode.SPEED, np.full(30, 5.0)), 30, enabled=False)
    block = rig.exchange(turn.command, 30, Guard())
    supervisor.begin(block.counts[0])
    before = supervisor.state
    first = supervisor.reviewed(before, block, turn)
    again = supervisor.reviewed(before, block, turn)
    assert before.rows == 0
    assert (first.rows, first.peaks.values) == (again.rows, again.peaks.values)
    assert supervisor.state is before


def test_margins_tell_how_near_it_came() -> None:
    _, report = run_with(FakeRig())
    speed = report.margins[lim.INPUT_SPEED]
    assert speed["peak"] == pytest.approx(40.0, rel=0.05)
    assert speed["limit"] == pytest.approx(55.0)
    assert speed["margin"] == pytest.approx(1.0 - speed["peak"] / speed["limit"])


def _supervisor(rig: FakeRig, travel: tuple[float, float] = (-math.inf, math.inf)) -> Supervisor:
    limits = planned_of(*PLAN).limits
    return Supervisor(
        rig.channels, rig.cycle_ns, limits, Geometry(120.0, -1, 57000.0, 3.0e-4), travel
    )


def _turn() -> Turn:
    return Turn(Command(Mode.SPEED, np.zeros(1)), 1, enabled=True)


@pytest.mark.parametrize("size", [1, 2, 7, 100])
def test_stale_data_and_masked_states_are_found_whatever_the_cut(size: int) -> None:
    channels = FakeRig().channels
    column = [channel.name for channel in channels].index("statusword")
    flags = np.zeros(40, np.uint16)
    flags[[3, 4, 8, 9, 10, 11, 12]] = INCOMPLETE
    counts = np.zeros((40, len(channels)), dtype=np.int64)
    counts[:, column] = 0x1237
    counts[30, column] = 0x0637
    counts[35:, column] = 0x0233
    state = Bound(
        cause=trips.UNEXPECTED_STATE,
        weights={"statusword": 1.0},
        low=0x27 - 0.5,
        high=0x27 + 0.5,
        mask=0x6F,
    )
    for guard, row in (
        (Guard((), stale_cycles=5), 12),
        (Guard((state,)), 35),
        (Guard((state,), stale_cycles=6), 35),
    ):
        watch, found = GuardWatch(channels), None
        for start in range(0, 40, size):
            rows = slice(start, start + size)
            broken = watch.first_break(guard, counts[rows], flags[rows])
            if broken is not None:
                found = start + broken.row
                break
            watch.accept(counts[rows], flags[rows])
        assert found == row
