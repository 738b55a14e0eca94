"""A recorded run behind the seam: its counts come back at any block length, guards act, and its end is said."""

from __future__ import annotations

import numpy as np
import pytest

from drivers import channel as names
from drivers.clock import VirtualClock
from drivers.errors import DriverError, StaleDataError
from drivers.port import STALE_DATA, Bound, Command, DriveLimits, Guard, Mode
from drivers.samples import CycleFlag, SampleBlock
from model.units import RPM
from sim_backend.faults import IncompleteCycles
from sim_backend.replay import ReplayRig
from tests.sim_backend.rigs import NO_GUARD, joined, off, rig, turn

SPEED = 300.0


@pytest.fixture(scope="module")
def recorded() -> tuple[tuple, tuple]:
    port = rig(faults=(IncompleteCycles(150, cycles=8),))
    blocks = [off(port, 40), turn(port, SPEED, 260)]
    return tuple(port.channels), joined(blocks)


def replay(recorded: tuple[tuple, tuple], **options: object) -> ReplayRig:
    channels, arrays = recorded
    return ReplayRig(channels, *arrays, cycle_ns=1_000_000, **options)  # type: ignore[arg-type]


def play(port: ReplayRig, block_length: int, guard: Guard = NO_GUARD) -> list[SampleBlock]:
    blocks = []
    while port.remaining:
        count = min(block_length, port.remaining)
        blocks.append(port.exchange(Command(Mode.SPEED, np.full(count, SPEED * RPM)), count, guard))
        if blocks[-1].broken is not None:
            break
    return blocks


def cause(blocks: list[SampleBlock]) -> str:
    broken = blocks[-1].broken
    return broken.cause if broken is not None else ""


@pytest.mark.parametrize("block_length", [1, 7, 100, 1000])
def test_the_recorded_counts_come_back(recorded: tuple[tuple, tuple], block_length: int) -> None:
    clock = VirtualClock()
    port = replay(recorded, clock=clock, truth={"known": 1.0}, title="run 12")
    description = port.open()
    assert (description.origin, description.title, description.truth) == (
        "replay",
        "run 12",
        {"known": 1.0},
    )
    for found, wanted in zip(joined(play(port, block_length)), recorded[1], strict=True):
        assert np.array_equal(found, wanted)
    assert clock.monotonic_ns() == 300 * 1_000_000


def test_a_block_over_the_end_is_shorter_and_the_next_one_is_stale(
    recorded: tuple[tuple, tuple],
) -> None:
    port = replay(recorded)
    port.open()
    assert len(port.exchange(Command(Mode.OFF), 1000, NO_GUARD)) == 300
    with pytest.raises(StaleDataError, match="recording is over"):
        port.exchange(Command(Mode.OFF), 1, NO_GUARD)
    port.close()
    port.open()
    assert port.exchange(Command(Mode.OFF), 10, NO_GUARD).first_cycle == 0


@pytest.mark.parametrize("block_length", [1, 7, 1000])
def test_guards_break_at_the_same_cycle(recorded: tuple[tuple, tuple], block_length: int) -> None:
    bound = Bound(
        cause="has turned", weights={names.INPUT_ANGLE: 1.0}, high=5000.0, lag=50, is_trip=False
    )
    port = replay(recorded)
    port.open()
    blocks = play(port, block_length, Guard((bound,)))
    travelled = recorded[1][1][:, 0]
    expected = next(k for k in range(50, 300) if travelled[k] - travelled[k - 50] > 5000)
    assert sum(len(b) for b in blocks) == expected + 1
    assert cause(blocks) == "has turned"
    port = replay(recorded)
    port.open()
    blocks = play(port, block_length, Guard(stale_cycles=5))
    assert sum(len(b) for b in blocks) == 155
    assert cause(blocks) == STALE_DATA
    assert blocks[-1].flags[-1] & CycleFlag.INCOMPLETE


def test_what_is_commanded_does_not_replace_the_recorded_set_points(
    recorded: tuple[tuple, tuple],
) -> None:
    port = replay(recorded)
    port.open()
    port.exchange(Command(Mode.OFF), 40, NO_GUARD)
    port.exchange(Command(Mode.SPEED, np.full(100, SPEED * RPM)), 100, NO_GUARD)
    block = port.exchange(Command(Mode.TORQUE, np.full(100, 0.1)), 100, NO_GUARD)
    target = [c.name for c in port.channels].index(names.TARGET_SPEED)
    assert (block.counts[:, target] == round(SPEED * 1000)).all(), (
        "the recorded set-points stand there"
    )


def test_limits_are_returned_and_nothing_can_be_changed_from_outside(
    recorded: tuple[tuple, tuple],
) -> None:
    port = replay(recorded)
    port.open()
    limits = DriveLimits(1.0, 2.0, 3.0, 4.0, 5.0)
    assert port.write_limits(limits) is limits
    port.reset_fault()
    block = port.exchange(Command(Mode.OFF), 10, NO_GUARD)
    block.counts[:] = 0
    assert recorded[1][1][:10].any()


def test_refusals(recorded: tuple[tuple, tuple]) -> None:
    channels, (time_ns, counts, flags) = recorded
    with pytest.raises(DriverError, match="do not belong together"):
        ReplayRig(channels, time_ns[1:], counts, flags, cycle_ns=1)
    with pytest.raises(DriverError, match="empty"):
        ReplayRig(channels, time_ns[:0], counts[:0], flags[:0], cycle_ns=1)
    with pytest.raises(DriverError, match="SYNC period"):
        ReplayRig(channels, time_ns, counts, flags, cycle_ns=0)
    port = replay(recorded)
    with pytest.raises(DriverError, match="not open"):
        port.exchange(Command(Mode.OFF), 1, NO_GUARD)
    port.open()
    with pytest.raises(DriverError, match="already open"):
        port.open()
    with pytest.raises(DriverError, match="needs cycles"):
        port.exchange(Command(Mode.OFF), 0, NO_GUARD)
    with pytest.raises(DriverError, match="set-point per cycle"):
        port.exchange(Command(Mode.SPEED, np.zeros(3)), 4, NO_GUARD)
