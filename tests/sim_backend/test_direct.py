"""The simulated rig behind the seam: blocks, guards, modes, limits, clock, refusals."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from drivers import channel as names
from drivers.clock import VirtualClock
from drivers.drive_state import DriveState, drive_state
from drivers.errors import DriverError
from drivers.port import Bound, Command, DriveLimits, Guard, Mode
from drivers.samples import SampleBlock
from model.units import RPM
from sim_backend.direct import SimulatedRig
from sim_backend.faults import (
    DriveFault,
    IncompleteCycles,
    OutputLoad,
    QuickStopIgnored,
    RunAway,
    StuckEncoder,
)
from sim_backend.imperfections import Imperfections
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR, NO_GUARD, clean, column, joined, off, rig, si, turn

# One story with every mode, reversals, standstill and a guard that breaks in the middle.
STORY: tuple[tuple[Mode, float, int], ...] = (
    (Mode.OFF, 0.0, 61),
    (Mode.SPEED, 900.0 * RPM, 433),
    (Mode.SPEED, -0.3 * RPM, 300),
    (Mode.QUICK_STOP, 0.0, 150),
    (Mode.TORQUE, 0.21, 270),
    (Mode.SPEED, 0.0, 190),
    (Mode.OFF, 0.0, 100),
    (Mode.SPEED, 3000.0 * RPM, 250),
)
FAULTS = (
    StuckEncoder(200, cycles=20),
    IncompleteCycles(655, (names.TORQUE, names.OUTPUT_ANGLE), cycles=9),
    OutputLoad(333, 3.0, cycles=77),
    RunAway(700, 30.0, cycles=60),
)
TRAVEL = Guard(
    (
        Bound(
            cause="has turned",
            weights={names.INPUT_ANGLE: 1.0},
            high=9000.0,
            low=-9000.0,
            lag=37,
            is_trip=False,
        ),
    )
)


def told(
    port: SimulatedRig, block_length: int, guard: Guard
) -> tuple[list[SampleBlock], list[int]]:
    """Run the story in blocks; a part ends early where the guard breaks. Returns the blocks and where breaks fell."""
    blocks, breaks = [], []
    for mode, value, cycles in STORY:
        left = cycles
        while left:
            count = min(block_length, left)
            target = np.full(count, value) if mode in (Mode.SPEED, Mode.TORQUE) else np.empty(0)
            block = port.exchange(Command(mode, target), count, guard)
            blocks.append(block)
            left -= len(block)
            if block.broken is not None:
                assert block.broken.row == len(block) - 1
                breaks.append(block.first_cycle + block.broken.row)
                break
    return blocks, breaks


@pytest.mark.parametrize("guard", [NO_GUARD, TRAVEL], ids=["free", "guarded"])
def test_block_length_changes_no_count(guard: Guard) -> None:
    reference, where = told(rig(faults=FAULTS), 1000, guard)
    expected = joined(reference)
    assert bool(where) is bool(guard.bounds)
    for block_length in (1, 7, 100):
        blocks, breaks = told(rig(faults=FAULTS), block_length, guard)
        assert breaks == where
        for found, wanted in zip(joined(blocks), expected, strict=True):
            assert np.array_equal(found, wanted)


def test_pieces_of_a_long_block_change_no_count_either() -> None:
    long, short = rig(), rig()
    whole = turn(long, 61.8, 9000)
    cut = [turn(short, 61.8, 1000) for _ in range(9)]
    for found, wanted in zip(joined(cut), joined([whole]), strict=True):
        assert np.array_equal(found, wanted)


def test_first_cycle_counts_on_and_the_clock_follows() -> None:
    clock = VirtualClock(1_700_000_000_000_000_000)
    port = SimulatedRig(GEAR, MOTOR, world=World.of(1), clock=clock)
    clock.advance_ns(5_000_000)
    port.open()
    first, second = off(port, 40), off(port, 60)
    assert (first.first_cycle, second.first_cycle) == (0, 40)
    assert clock.monotonic_ns() == 105_000_000
    nominal = 1_700_000_000_005_000_000 + 1_000_000 * np.arange(40)
    assert np.max(np.abs(first.time_ns - nominal)) < 200_000
    assert np.all(np.diff(np.concatenate([first.time_ns, second.time_ns])) > 0)


def test_same_seed_same_counts_other_seed_other_counts() -> None:
    one, same, other = (turn(rig(seed=s), 600.0, 300).counts for s in (11, 11, 12))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_guard_breaks_at_the_first_row_and_the_next_block_goes_on_from_there() -> None:
    port, free = rig(), rig()
    bound = Bound(cause="overspeed", weights={names.INPUT_ANGLE: 1.0}, high=200.0, lag=1)
    broken = turn(port, 3000.0, 1000, Guard((bound,)))
    whole = turn(free, 3000.0, 1000)
    moved = np.diff(column(free, whole, names.INPUT_ANGLE))
    row = int(np.flatnonzero(moved > 200.0)[0]) + 1
    assert broken.broken is not None
    assert (broken.broken.row, len(broken), broken.broken.is_trip) == (row, row + 1, True)
    assert np.array_equal(broken.counts, whole.counts[: row + 1])
    rest = turn(port, 3000.0, 50)
    assert rest.first_cycle == row + 1
    assert np.array_equal(rest.counts, whole.counts[row + 1 : row + 51])


def states(port: SimulatedRig, block: SampleBlock) -> list[DriveState]:
    return [drive_state(int(word)) for word in column(port, block, names.STATUSWORD)]


def test_statusword_walks_the_states_of_cia_402() -> None:
    port = rig()
    assert set(states(port, off(port, 3))) == {DriveState.SWITCH_ON_DISABLED}
    enabling = states(port, turn(port, 100.0, 6))
    assert enabling == [DriveState.ENABLED] * 6
    stopping = states(port, port.exchange(Command(Mode.QUICK_STOP), 300, NO_GUARD))
    assert stopping[:2] == [DriveState.ENABLED, DriveState.QUICK_STOP]
    assert stopping[-1] is DriveState.QUICK_STOP
    assert states(port, turn(port, 10.0, 2)) == [DriveState.ENABLED] * 2
    assert states(port, off(port, 2)) == [DriveState.ENABLED, DriveState.SWITCH_ON_DISABLED]
    assert (
        states(port, port.exchange(Command(Mode.QUICK_STOP), 2, NO_GUARD))[-1]
        is DriveState.SWITCH_ON_DISABLED
    )


def test_torque_acts_from_the_first_set_point_on() -> None:
    port = clean()
    torque = column(port, turn(port, 600.0, 8), names.DRIVE_TORQUE)
    assert torque[0] == 0
    assert np.all(torque[1:] > 0)


def test_fault_takes_the_torque_away_until_it_is_reset() -> None:
    port = rig(faults=[DriveFault(400)])
    turn(port, 600.0, 390)
    tripping = turn(port, 600.0, 200)
    found = states(port, tripping)
    assert found[9:12] == [DriveState.ENABLED, DriveState.FAULT_REACTION, DriveState.FAULT]
    assert np.all(column(port, tripping, names.DRIVE_TORQUE)[12:] == 0)
    assert states(port, turn(port, 600.0, 5))[-1] is DriveState.FAULT
    port.reset_fault()
    assert states(port, turn(port, 600.0, 10))[-1] is DriveState.ENABLED


def test_limits_are_stored_in_whole_counts_read_back_and_act() -> None:
    port = rig(Imperfections.none())
    asked = DriveLimits(0.7, 104.75, 3000.0, 1500.0, 700.0)
    stored = port.write_limits(asked)
    for name, count in (
        ("torque", 0.000637),
        ("speed", RPM),
        ("acceleration", RPM),
        ("quick_stop_deceleration", RPM),
    ):
        value = getattr(stored, name)
        assert value / count == pytest.approx(round(value / count), abs=1e-9)
        assert getattr(asked, name) - count <= value <= getattr(asked, name) + 1e-12
    assert port.write_limits(stored) == stored
    block = turn(port, 3000.0, 600)
    assert np.max(si(port, block, names.DRIVE_TORQUE)) <= stored.torque + 1e-6
    speed = np.diff(si(port, block, names.INPUT_ANGLE)) / 1e-3
    assert np.mean(speed[-100:]) == pytest.approx(stored.speed, rel=1e-2)


def test_limits_beyond_the_motor_read_back_as_the_motors() -> None:
    stored = rig().write_limits(DriveLimits(50.0, 1e5, 1e4, 1e4, 1e4))
    assert stored.torque <= MOTOR.peak_torque
    assert stored.speed <= MOTOR.maximum_speed * (1.0 + 1e-6)


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_impossible_limits_are_refused(wrong: float) -> None:
    with pytest.raises(DriverError, match="drive limits, speed"):
        rig().write_limits(DriveLimits(1.0, wrong, 1.0, 1.0, 1.0))


def test_set_points_are_what_the_drive_receives() -> None:
    port = clean()
    block = turn(port, 61.80339887, 3)
    assert column(port, block, names.TARGET_SPEED).tolist() == [61803] * 3
    block = port.exchange(Command(Mode.TORQUE, np.array([0.1, -0.1])), 2, NO_GUARD)
    assert column(port, block, names.TARGET_TORQUE).tolist() == [157, -157]
    assert column(port, block, names.TARGET_SPEED).tolist() == [0, 0]


def test_hold_is_still_to_the_count() -> None:
    port = rig(Imperfections().without("sub_divisional_error"))
    turn(port, 300.0, 500)
    turn(port, 0.0, 800)
    held = turn(port, 0.0, 500)
    assert np.ptp(column(port, held, names.INPUT_ANGLE)) == 0


def test_quick_stop_that_is_not_obeyed() -> None:
    port = rig(faults=[QuickStopIgnored(500)])
    turn(port, 600.0, 500)
    block = port.exchange(Command(Mode.QUICK_STOP), 200, NO_GUARD)
    moved = np.diff(si(port, block, names.INPUT_ANGLE))
    assert np.mean(moved[-50:]) == pytest.approx(600.0 * RPM * 1e-3, rel=1e-2)
    assert states(port, block)[-1] is DriveState.ENABLED


@pytest.mark.parametrize("cycle_ns", [125_000, 500_000, 2_000_000, 1_300_000])
def test_other_sync_periods(cycle_ns: int) -> None:
    port = rig(cycle_ns=cycle_ns)
    cycles = 800_000_000 // cycle_ns
    block = turn(port, 600.0, cycles)
    half = slice(cycles // 2, None)
    angle, time = si(port, block, names.INPUT_ANGLE)[half], block.time_ns[half] * 1e-9
    assert np.polyfit(time - time[0], angle, 1)[0] == pytest.approx(600.0 * RPM, rel=1e-3)


def test_description_is_json_and_says_simulated() -> None:
    described = SimulatedRig(GEAR, MOTOR, world=World.of(4)).open()
    assert described.origin == "simulated"
    assert json.loads(json.dumps(described.truth))["world"]["bench_seed"] == 4
    bare = SimulatedRig(GEAR, MOTOR, world=World.of(4), gear_mounted=False).open()
    assert "bare" in bare.title
    assert bare.truth is not None
    assert "friction" not in bare.truth


def test_bare_motor_leaves_the_output_where_it_is() -> None:
    port = rig(gear_mounted=False)
    block = turn(port, 600.0, 500)
    assert np.ptp(column(port, block, names.OUTPUT_ANGLE)) == 0
    assert np.ptp(column(port, block, names.INPUT_ANGLE)) > 10_000


def test_output_turns_against_the_input_unless_the_flexspline_is_fixed() -> None:
    for mounting, sense, ratio in (
        ("circular-spline-fixed", -1, 120.0),
        ("flexspline-fixed", 1, 121.0),
    ):
        port = rig(Imperfections.none(), mounting=mounting)
        block = turn(port, 600.0, 2000)
        moved = np.ptp(si(port, block, names.INPUT_ANGLE)) / ratio
        output = si(port, block, names.OUTPUT_ANGLE)
        assert output[-1] - output[0] == pytest.approx(sense * moved, rel=1e-3)


@pytest.mark.parametrize(
    ("command", "cycles"),
    [
        (Command(Mode.SPEED, np.zeros(3)), 4),
        (Command(Mode.SPEED, np.array([np.nan])), 1),
        (Command(Mode.TORQUE, np.array([100.0])), 1),
        (Command(Mode.OFF, np.zeros(2)), 2),
        (Command(Mode.OFF), 0),
    ],
)
def test_impossible_commands_are_refused_in_words(command: Command, cycles: int) -> None:
    port = rig()
    with pytest.raises(DriverError) as caught:
        port.exchange(command, cycles, NO_GUARD)
    assert len(str(caught.value)) > 20


def test_a_rig_must_be_open_and_opens_once() -> None:
    port = SimulatedRig(GEAR, MOTOR)
    with pytest.raises(DriverError, match="not open"):
        off(port, 1)
    port.open()
    with pytest.raises(DriverError, match="already open"):
        port.open()
    port.close()
    port.close()
    with pytest.raises(DriverError, match="not open"):
        off(port, 1)
    with pytest.raises(DriverError, match="SYNC period"):
        SimulatedRig(GEAR, MOTOR, cycle_ns=1000)
