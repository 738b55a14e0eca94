"""The same run over the direct rig and over the wire: the same counts, channel by channel, and the same time stamps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers import channel as names
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Bound, Command, DriveLimits, Guard, Mode, RigPort
from drivers.samples import CycleFlag
from model.units import RPM
from sim_backend.faults import (
    CountJump,
    Fault,
    IncompleteCycles,
    OutputLoad,
    StuckEncoder,
    TorquePortSaturated,
)
from sim_backend.imperfections import Imperfections
from sim_backend.wire.bench import FIRST_STAMP_NS
from tests.sim_backend.rigs import NO_GUARD, rig, with_only
from tests.sim_backend.wire.rigs import turn, wire_rig

# Mode, set-point, cycles.
STORY: tuple[tuple[Mode, float, int], ...] = (
    (Mode.OFF, 0.0, 30),
    (Mode.SPEED, 900.0 * RPM, 400),
    (Mode.SPEED, -0.3 * RPM, 200),
    (Mode.QUICK_STOP, 0.0, 150),
    (Mode.TORQUE, 0.21, 200),
    (Mode.SPEED, 0.0, 150),
    (Mode.OFF, 0.0, 60),
    (Mode.SPEED, 3000.0 * RPM, 200),
)
LIMITS = DriveLimits(
    torque=0.9,
    speed=4000.0 * RPM,
    acceleration=2000.0,
    deceleration=2500.0,
    quick_stop_deceleration=3000.0,
)
ACTIVE = (Mode.SPEED, Mode.TORQUE)


def command(mode: Mode, value: float, cycles: int) -> Command:
    return Command(mode, np.full(cycles, value)) if mode in ACTIVE else Command(mode)


def told(
    port: RigPort, *, block_length: int = 1000, guard: Guard = NO_GUARD
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint16]]:
    """Counts, stamps and flags of the story."""
    port.write_limits(LIMITS)
    blocks = []
    for mode, value, cycles in STORY:
        left = cycles
        while left:
            blocks.append(
                port.exchange(
                    command(mode, value, min(left, block_length)), min(left, block_length), guard
                )
            )
            left -= len(blocks[-1])
            if blocks[-1].broken is not None:
                break
    return (
        np.concatenate([b.counts for b in blocks]),
        np.concatenate([b.time_ns for b in blocks]),
        np.concatenate([b.flags for b in blocks]),
    )


def direct(
    imperfections: Imperfections | None = None,
    faults: tuple[Fault, ...] = (),
    guard: Guard = NO_GUARD,
):
    port = rig(imperfections, faults=faults, clock=VirtualClock(FIRST_STAMP_NS))
    return told(port, guard=guard), [c.name for c in port.channels]


def assert_same(wire, sim, columns: list[str]) -> None:
    counts, stamps, flags = sim
    assert wire[0].shape == counts.shape
    for i, name in enumerate(columns):
        assert np.array_equal(wire[0][:, i], counts[:, i]), name
    assert np.array_equal(wire[1], stamps)
    # Which step is too large to be true each side judges by limits of its own.
    judged = np.uint16(~CycleFlag.JUMPED & 0xFFFF)
    assert np.array_equal(wire[2] & judged, flags & judged)


@pytest.mark.parametrize("block_length", [1000, 7])
def test_the_story_has_the_same_counts_stamps_and_flags(block_length: int) -> None:
    sim, columns = direct()
    with wire_rig() as made:
        assert [c.name for c in made.port.channels] == columns
        wire = told(made.port, block_length=block_length)
    assert_same(wire, sim, columns)
    assert np.ptp(wire[0][:, columns.index(names.OUTPUT_ANGLE)]) > 1000
    assert wire[0][-1, columns.index(names.INDEX_SEEN)] & 1


def test_a_guard_breaks_at_the_same_cycle() -> None:
    guard = Guard(
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
    sim, columns = direct(guard=guard)
    with wire_rig() as made:
        wire = told(made.port, guard=guard)
    assert_same(wire, sim, columns)
    assert len(sim[0]) < sum(cycles for *_, cycles in STORY)


def test_faults_of_plant_and_signals_give_the_same_counts() -> None:
    faults = (
        OutputLoad(100, 3.0, cycles=77),
        StuckEncoder(200, cycles=20),
        CountJump(300, counts=17),
        TorquePortSaturated(350, cycles=10),
    )
    sim, columns = direct(faults=faults)
    with wire_rig(faults=faults) as made:
        wire = told(made.port)
    assert_same(wire, sim, columns)


def test_an_ideal_rig_agrees_too() -> None:
    quiet = with_only("adc_steps", "drive_torque_steps", "quantisation")
    sim, columns = direct(quiet)
    with wire_rig(quiet) as made:
        wire = told(made.port)
    assert_same(wire, sim, columns)


def test_limits_read_back_as_the_direct_rig_holds_them() -> None:
    port = rig()
    with wire_rig() as made:
        assert made.port.write_limits(LIMITS) == port.write_limits(LIMITS)


def test_two_runs_of_one_seed_are_one_and_another_seed_is_another() -> None:
    found = []
    for seed in (7, 7, 8):
        with wire_rig(seed=seed) as made:
            found.append(turn(made.port, 120.0, 60).counts)
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_a_converter_without_steps_is_refused() -> None:
    with (
        pytest.raises(DriverError, match="without steps"),
        wire_rig(with_only("quantisation")),
    ):
        pass


def test_a_fault_that_only_marks_is_refused() -> None:
    with (
        pytest.raises(DriverError, match="only marks cycles"),
        wire_rig(faults=(IncompleteCycles(3),)),
    ):
        pass
