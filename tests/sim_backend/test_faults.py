"""Every fault falls on its cycle and does what it says."""

from __future__ import annotations

import numpy as np
import pytest

from drivers import channel as names
from drivers.clock import VirtualClock
from drivers.drive_state import DriveState, drive_state
from drivers.errors import BusLostError, DriverError, StaleDataError
from drivers.port import Bound, Command, Guard, Mode
from drivers.samples import CycleFlag
from model.units import RPM
from sim_backend.faults import (
    BusLost,
    CountJump,
    Fault,
    IncompleteCycles,
    MarkedCycles,
    OutputLoad,
    RunAway,
    Stall,
    StuckEncoder,
    TorquePortOpen,
    TorquePortSaturated,
)
from tests.sim_backend.rigs import column, rig, si, turn


def both(*faults: Fault, cycles: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Counts of a rig with and without the faults, the flags with, and the names of the columns."""
    broken, sound = rig(faults=faults), rig()
    first, second = turn(broken, 600.0, cycles), turn(sound, 600.0, cycles)
    return first.counts, second.counts, first.flags, [c.name for c in broken.channels]


def test_count_jump_stays_and_is_flagged_only_if_it_is_large() -> None:
    found, wanted, flags, order = both(CountJump(250, names.OUTPUT_ANGLE, 4000))
    at = order.index(names.OUTPUT_ANGLE)
    assert np.array_equal(found[:250], wanted[:250])
    assert np.all(found[250:, at] - wanted[250:, at] == 4000)
    assert np.flatnonzero(flags & CycleFlag.JUMPED).tolist() == [250]
    assert not np.any(both(CountJump(250, names.OUTPUT_ANGLE, 1))[2])


def test_stuck_encoder_stands_and_nothing_says_so() -> None:
    found, wanted, flags, order = both(StuckEncoder(200, names.INPUT_ANGLE, cycles=100))
    at = order.index(names.INPUT_ANGLE)
    assert np.all(found[200:300, at] == wanted[199, at])
    assert np.array_equal(found[300:], wanted[300:])
    assert not np.any(flags & CycleFlag.INCOMPLETE)


def test_incomplete_cycles_keep_the_previous_value_and_say_so() -> None:
    found, wanted, flags, order = both(IncompleteCycles(120, (names.TORQUE,), cycles=3))
    at = order.index(names.TORQUE)
    assert np.all(found[120:123, at] == wanted[119, at])
    assert np.flatnonzero(flags & CycleFlag.INCOMPLETE).tolist() == [120, 121, 122]
    others = [k for k in range(len(order)) if k != at]
    assert np.array_equal(found[:, others], wanted[:, others])


@pytest.mark.parametrize(
    "flag", [CycleFlag.LATE, CycleFlag.DOUBLED, CycleFlag.SHORT, CycleFlag.SIGNAL_ERROR]
)
def test_marked_cycles_keep_their_values(flag: CycleFlag) -> None:
    found, wanted, flags, _ = both(MarkedCycles(50, flag, cycles=2))
    assert np.array_equal(found, wanted)
    assert np.flatnonzero(flags & flag).tolist() == [50, 51]


@pytest.mark.parametrize(
    "fault", [TorquePortSaturated(90, -1, cycles=10), TorquePortOpen(90, cycles=10)]
)
def test_torque_port_at_its_end_or_open_is_flagged(fault: Fault) -> None:
    found, wanted, flags, order = both(fault)
    at = order.index(names.TORQUE)
    assert np.flatnonzero(flags & CycleFlag.SATURATED).tolist() == list(range(90, 100))
    assert np.array_equal(found[100:, at], wanted[100:, at])
    if isinstance(fault, TorquePortSaturated):
        assert np.all(found[90:100, at] == -32767)


def test_load_winds_the_gear_up_while_it_lasts() -> None:
    found, wanted, _, order = both(OutputLoad(150, 20.0, cycles=150))
    difference = (found - wanted)[:, order.index(names.OUTPUT_ANGLE)]
    assert np.all(difference[:151] == 0)
    # The output turns in the negative sense of its encoder and lags: counts are higher.
    assert np.mean(difference[200:300]) > 3.0


def test_run_away_goes_to_its_own_speed() -> None:
    port = rig(faults=[RunAway(100, 50.0)])
    turn(port, 60.0, 100)
    block = turn(port, 60.0, 600)
    assert np.mean(np.diff(si(port, block, names.INPUT_ANGLE))[-100:]) == pytest.approx(
        0.05, rel=1e-2
    )
    assert np.all(column(port, block, names.TARGET_SPEED) == 60_000)


def test_stall_gives_what_came_before_then_raises_then_goes_on_with_a_stopped_drive() -> None:
    clock = VirtualClock()
    port = rig(faults=[Stall(350, cycles=400)], clock=clock)
    first = turn(port, 600.0, 500)
    assert (len(first), first.broken) == (350, None)
    before = clock.monotonic_ns()
    with pytest.raises(StaleDataError, match="no complete cycle"):
        turn(port, 600.0, 500)
    assert clock.monotonic_ns() - before == 400_000_000
    after = port.exchange(Command(Mode.QUICK_STOP), 10, Guard())
    assert after.first_cycle == 750
    assert drive_state(int(column(port, after, names.STATUSWORD)[0])) is DriveState.QUICK_STOP
    speed = np.diff(si(port, after, names.INPUT_ANGLE)) / 1e-3
    assert np.max(np.abs(speed)) < 1.0 * RPM


def test_lost_bus_never_comes_back() -> None:
    port = rig(faults=[BusLost(0)])
    for _ in range(3):
        with pytest.raises(BusLostError, match="bus is gone"):
            turn(port, 600.0, 10)


def test_impossible_faults_are_refused() -> None:
    with pytest.raises(DriverError, match="a cycle to begin at"):
        StuckEncoder(-1)
    with pytest.raises(DriverError, match="a cycle to begin at"):
        IncompleteCycles(5, cycles=0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (CountJump(250, names.OUTPUT_ANGLE, 4000), "marks altered: 150"),
        (MarkedCycles(50, cycles=2), "marks altered: 2"),
        (StuckEncoder(200, names.INPUT_ANGLE, cycles=100), "marks altered: 100"),
        (OutputLoad(60, torque=5.0, cycles=20), "from cycle 60"),
        (BusLost(300), "no data: 1"),
    ],
)
def test_what_a_fault_has_done_is_counted(fault: Fault, words: str) -> None:
    broken = rig(faults=(fault,))
    turn(broken, 600.0, 50)
    assert not fault.effects
    turn(broken, 600.0, 350)
    if isinstance(fault, BusLost):
        with pytest.raises(BusLostError):
            turn(broken, 600.0, 1)
    assert words in fault.effects.sentence()


def test_a_block_that_is_cut_by_the_guard_counts_once() -> None:
    fault = CountJump(20, names.OUTPUT_ANGLE, 100_000)
    broken = rig(faults=(fault,))
    guard = Guard((Bound(cause="turned", weights={names.INPUT_ANGLE: 1.0}, high=1.0, lag=1),))
    block = broken.exchange(Command(Mode.SPEED, np.full(300, 600.0 * RPM)), 300, guard)
    assert block.broken is not None
    assert fault.effects.rows == max(len(block) - 20, 0)


def test_the_truth_of_the_plant_is_there_to_be_asked() -> None:
    made = rig(faults=(StuckEncoder(0, names.INPUT_ANGLE),))
    turn(made, 600.0, 400)
    assert made.input_speed == pytest.approx(600.0 * RPM, rel=0.05), "whatever the counts say"
    assert made.is_powered
    made.exchange(Command(Mode.OFF), 3, Guard())
    assert not made.is_powered
    assert made.input_speed > 10.0, "it coasts"
