"""Faults on the wire: each falls on its cycle, the real drivers see it, and nothing hangs."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from drivers import channel as names
from drivers.clock import VirtualClock
from drivers.drive_state import DriveState, drive_state
from drivers.errors import BusLostError, DriverError, ReadbackError
from drivers.port import Command, DriveLimits, Guard, Mode
from drivers.samples import CycleFlag, SampleBlock
from model.units import RPM
from rig.bench.backends.simulated import wire_config as shipped_config
from rig.bench.backends.simulated import wire_port
from sim_backend.faults import Fault, Stall
from sim_backend.individuals import individual_gear
from sim_backend.wire.bench import ANALOG_INPUT_NODE, COUNTER_NODE, DRIVE_NODE, WireBench
from sim_backend.wire.faults import (
    DRILLS,
    ClockJump,
    EmergencyMessage,
    EncoderReversed,
    EncoderWrapped,
    HeartbeatLost,
    ModeFromOutside,
    NodeReset,
    OutputSlips,
    QuickStopNotObeyed,
    ReadsBackDifferently,
    SafeTorqueOff,
    SdoAborted,
    SdoSilent,
    SupervisedSyncLost,
    SyncLost,
    TpdoDoubled,
    TpdoLate,
    TpdoLost,
    TpdoShort,
)
from sim_backend.wire.slave import NmtState
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR
from tests.sim_backend.wire.rigs import WireRig, turn, wire_rig

AT = 30
LIMITS = DriveLimits(0.5, 400.0, 2000.0, 2000.0, 2000.0)


def column(made: WireRig, block: SampleBlock, name: str) -> np.ndarray:
    return block.counts[:, [c.name for c in made.port.channels].index(name)]


def ridden(made: WireRig, cycles: int = 60) -> SampleBlock:
    """A run at 300 r/min over the fault; blocks go on after a break."""
    blocks = []
    while sum(len(b) for b in blocks) < cycles:
        blocks.append(turn(made.port, 300.0, cycles - sum(len(b) for b in blocks)))
    return SampleBlock(
        0,
        np.concatenate([b.time_ns for b in blocks]),
        np.concatenate([b.counts for b in blocks]),
        np.concatenate([b.flags for b in blocks]),
        next((b.broken for b in blocks if b.broken), None),
    )


@pytest.mark.parametrize(
    ("fault", "rows", "flag"),
    [
        (TpdoLost(AT, cycles=3), {30, 31, 32}, CycleFlag.INCOMPLETE),
        (TpdoLost(AT, cycles=1, node_id=ANALOG_INPUT_NODE, number=1), {30}, CycleFlag.INCOMPLETE),
        (TpdoLate(AT, cycles=1), {30}, CycleFlag.INCOMPLETE),
        (TpdoShort(AT, cycles=2, node_id=DRIVE_NODE, number=1), {30, 31}, CycleFlag.SHORT),
        (SyncLost(AT, cycles=2), {30, 31}, CycleFlag.INCOMPLETE),
    ],
)
def test_frames_are_marked_in_their_cycle_and_the_counts_go_on(
    fault: Fault, rows: set[int], flag: CycleFlag
) -> None:
    with wire_rig() as good:
        expected = ridden(good)
    with wire_rig(faults=(fault,)) as made:
        block = ridden(made)
    assert set(np.flatnonzero(block.flags & flag)) == rows
    clean = np.flatnonzero(block.flags == 0)
    assert len(clean) > 40
    assert np.array_equal(block.counts[clean], expected.counts[clean]), (
        "the same cycles carry the same counts"
    )


def test_doubled_frames_are_noticed() -> None:
    with wire_rig(faults=(TpdoDoubled(AT, cycles=1),)) as made:
        block = ridden(made)
    assert np.flatnonzero(block.flags & CycleFlag.DOUBLED).tolist()[0] in (AT, AT + 1)


def test_an_emergency_breaks_the_block_at_its_cycle() -> None:
    with wire_rig(faults=(EmergencyMessage(AT, code=0x4310),)) as made:
        block = turn(made.port, 300.0, 100)
        assert block.broken is not None
        assert block.broken.cause == "emcy"
        assert len(block) in (AT + 1, AT + 2)
        assert any("0x4310" in event.text for event in made.port.events())


def test_a_node_that_resets_in_motion() -> None:
    with wire_rig(faults=(NodeReset(AT, COUNTER_NODE),)) as made:
        block = turn(made.port, 300.0, 100)
        assert block.broken is not None
        assert block.broken.is_trip
        assert len(block) <= AT + 2
        assert "boot-up" in [event.code for event in made.port.events()]


def test_a_drive_that_resets_in_motion_is_off() -> None:
    with wire_rig(faults=(NodeReset(AT, DRIVE_NODE),)) as made:
        block = turn(made.port, 300.0, 100)
        assert block.broken is not None
        assert made.bench.drive.drive_state is DriveState.SWITCH_ON_DISABLED


def test_a_lost_heartbeat_is_seen_after_three_periods() -> None:
    with wire_rig(faults=(HeartbeatLost(AT, DRIVE_NODE),)) as made:
        block = turn(made.port, 300.0, 600)
        assert block.broken is not None
        assert block.broken.cause == "heartbeat_lost"
        assert len(block) - AT <= 310


def test_the_drive_stops_by_itself_when_the_computer_is_silent() -> None:
    with wire_rig() as made:
        turn(made.port, 300.0, 200)
        assert abs(made.bench.plant.input_speed) > 250.0 * RPM
        deadline = made.clock.monotonic_ns() + 1_000_000_000
        while made.clock.monotonic_ns() < deadline:
            made.bench.pump(deadline)
            while made.bus.recv(0.0) is not None:
                continue
        assert made.bench.cycle > 900, "the plant goes on without SYNC"
        assert abs(made.bench.plant.input_speed) < 0.1 * RPM
        assert made.bench.drive.drive_state in (
            DriveState.QUICK_STOP,
            DriveState.SWITCH_ON_DISABLED,
        )


def test_safe_torque_off_is_seen_and_the_motor_coasts() -> None:
    with wire_rig(faults=(SafeTorqueOff(AT),)) as made:
        block = turn(made.port, 300.0, 100)
        assert block.broken is not None
        assert block.broken.cause == "drive_state"
        last = int(column(made, block, names.STATUSWORD)[-1])
        assert drive_state(last) is DriveState.SWITCH_ON_DISABLED
        assert not last & 0x10


@pytest.mark.parametrize("faults", [(), (QuickStopNotObeyed(AT),)])
def test_a_quick_stop_that_is_not_obeyed_keeps_turning(faults: tuple[Fault, ...]) -> None:
    with wire_rig(faults=faults) as made:
        turn(made.port, 300.0, 100)
        block = made.port.exchange(Command(Mode.QUICK_STOP), 200, Guard())
        moved = abs(int(np.diff(column(made, block, names.INPUT_ANGLE)[-50:]).sum()))
        assert drive_state(int(column(made, block, names.STATUSWORD)[-1])) is DriveState.QUICK_STOP
        assert (moved > 5000) is bool(faults)
        made.port.exchange(Command(Mode.OFF), 400, Guard())
        assert abs(made.bench.plant.input_speed) < 60.0 * RPM


def test_counts_that_lie() -> None:
    with wire_rig() as good:
        expected = ridden(good)
    found = {}
    for fault in (
        EncoderReversed(AT),
        OutputSlips(AT, counts_per_cycle=2.0),
        EncoderWrapped(AT, modulus=1000),
    ):
        with wire_rig(faults=(fault,)) as made:
            block = ridden(made)
            found[type(fault)] = column(made, block, names.OUTPUT_ANGLE)
    true = expected.counts[:, 1]
    for counts in found.values():
        assert np.array_equal(counts[:AT], true[:AT])
    assert found[EncoderReversed][-1] - true[AT - 1] == pytest.approx(
        -(true[-1] - true[AT - 1]), abs=2
    )
    assert np.array_equal(found[OutputSlips][AT:] - true[AT:], 2 * np.arange(1, 31))
    assert np.array_equal((found[EncoderWrapped][AT:] - true[AT:]) % 1000, np.zeros(30))


def test_a_fault_that_is_let_in_at_its_cycle_falls_once() -> None:
    """At the edge of a block it acts at once, and not again in the cycle that follows: turned twice is not turned."""
    with wire_rig() as good:
        true = ridden(good).counts[:, 1]
    with wire_rig() as made:
        before = turn(made.port, 300.0, AT)
        made.bench.inject(EncoderReversed(made.bench.cycle))
        after = turn(made.port, 300.0, 60 - AT)
    counts = np.concatenate([before.counts, after.counts])[:, 1]
    assert counts[-1] - counts[AT - 1] == pytest.approx(-(true[-1] - true[AT - 1]), abs=2)


def test_a_limit_that_reads_back_differently_is_refused() -> None:
    with wire_rig() as made:
        made.bench.inject(ReadsBackDifferently(0, index=0x6072))
        with pytest.raises(ReadbackError, match="0x6072"):
            made.port.write_limits(LIMITS)


def test_sdo_aborts_and_time_outs_are_errors_of_the_driver() -> None:
    for fault in (SdoAborted(0, DRIVE_NODE, 0x6060), SdoSilent(0, DRIVE_NODE)):
        with wire_rig() as made:
            made.bench.inject(fault)
            with pytest.raises(DriverError):
                turn(made.port, 300.0, 10)


def test_a_clock_that_jumps() -> None:
    with wire_rig(faults=(ClockJump(AT, stamp_offset_ns=5_000_000_000, cycles=5),)) as made:
        steps = np.diff(ridden(made).time_ns)
    assert abs(int(steps[AT - 1]) - 5_001_000_000) < 1_000_000
    assert (steps > 0).all()


@pytest.mark.parametrize("name", DRILLS)
def test_every_drill_ends(name: str) -> None:
    """Whatever goes wrong: blocks and errors of the driver, never another exception, never a hang."""
    with wire_rig() as made:
        ridden(made, 20)
        made.bench.inject(DRILLS[name](AT))
        with contextlib.suppress(DriverError):
            made.port.write_limits(LIMITS)
            for mode, cycles in ((Mode.SPEED, 25), (Mode.QUICK_STOP, 15), (Mode.OFF, 15)):
                target = np.full(cycles, 300.0 * RPM) if mode is Mode.SPEED else np.empty(0)
                made.port.exchange(Command(mode, target), cycles, Guard(stale_cycles=5))
        assert made.bench.cycle >= 20


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (TpdoLost(AT, cycles=3, number=1), "frames dropped or altered: 3"),
        (TpdoLate(AT, cycles=2, number=1), "frames dropped or altered: 2"),
        (TpdoDoubled(AT, cycles=4, number=1), "frames dropped or altered: 4"),
        (SyncLost(AT, cycles=2), "frames dropped or altered: 2"),
        (NodeReset(AT), f"from cycle {AT}"),
        (ClockJump(AT, cycles=5), "time stamps shifted: 5"),
        (OutputSlips(AT, cycles=6), "marks altered: 6"),
        (Stall(AT, cycles=5), "frames"),
    ],
)
def test_what_a_fault_has_done_is_counted(fault: Fault, words: str) -> None:
    with wire_rig(faults=(fault,)) as made:
        turn(made.port, 300.0, AT - 5)
        assert not fault.effects, "nothing before its cycle"
        with contextlib.suppress(DriverError):
            ridden(made, 60)
    assert words in fault.effects.sentence()


def test_a_fault_that_finds_nothing_to_alter_has_done_nothing() -> None:
    fault = TpdoLost(AT, number=4)
    with wire_rig(faults=(fault,)) as made:
        ridden(made)
    assert not fault.effects
    assert fault == TpdoLost(AT, number=4), "what it has done is no part of its value"


def test_bus_lost_and_hub_gone_are_told() -> None:
    for name in ("bus off", "bus lost", "hub gone"):
        with wire_rig(faults=(DRILLS[name](AT),)) as made:
            assert len(turn(made.port, 300.0, 100)) in (AT - 1, AT, AT + 1)
            with pytest.raises(BusLostError):
                turn(made.port, 300.0, 100)
            assert made.bench.cycle <= AT + 1


def test_the_drive_turns_on_what_was_written_by_sdo_and_needs_no_sync() -> None:
    clock = VirtualClock()
    bench = WireBench(individual_gear(GEAR, 3), MOTOR, None, World.of(7), clock=clock)

    def write(index: int, value: int, size: int) -> None:
        head = bytes([0x23 | (4 - size) << 2]) + index.to_bytes(2, "little") + b"\0"
        bench.send(0x601, head + value.to_bytes(4, "little"))

    def pass_time(seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            clock.advance_ns(10_000_000)
            bench.elapse()

    for index, value, size in (
        (0x6060, 9, 1),
        (0x60FF, 300_000, 4),
        (0x6040, 6, 2),
        (0x6040, 7, 2),
        (0x6040, 15, 2),
    ):
        write(index, value, size)
    began = bench.drive.dictionary.number(0x6064)
    pass_time(0.5)
    assert bench.plant.input_speed == pytest.approx(300.0 * RPM, rel=0.02)
    # It has turned all the time but for the cycles before it was seen that there is no SYNC.
    turned = bench.drive.dictionary.number(0x6064) - began
    assert turned == pytest.approx(0.48 * 5 * 32768, rel=0.1)
    write(0x60FF, 2**32 - 300_000, 4)
    pass_time(0.5)
    assert bench.plant.input_speed == pytest.approx(-300.0 * RPM, rel=0.02)
    write(0x6040, 2, 2)
    pass_time(0.2)
    assert bench.drive.drive_state is DriveState.SWITCH_ON_DISABLED
    assert abs(bench.plant.input_speed) < 0.01


def test_a_supervised_sync_that_is_lost_stops_the_drive_by_its_own_reaction() -> None:
    with wire_rig() as made:
        made.port.write_limits(LIMITS)
        turn(made.port, 300.0, AT)
        made.bench.inject(SupervisedSyncLost(made.bench.cycle + 2))
        block = turn(made.port, 300.0, 100)
        assert block.broken is not None
        assert block.broken.cause == "emcy"
        assert len(block) <= 5
        assert made.bench.drive.drive_state is DriveState.QUICK_STOP
        assert made.bench.drive.state is NmtState.PRE_OPERATIONAL


def test_the_mode_that_another_master_writes_is_seen() -> None:
    clock = VirtualClock()
    bench = WireBench(individual_gear(GEAR, 3), MOTOR, None, World.of(7), clock=clock)
    port = wire_port(bench, MOTOR, shipped_config(bench, MOTOR, has_guard=True))
    port.open()
    port.write_limits(LIMITS)
    turn(port, 300.0, AT)
    bench.inject(ModeFromOutside(bench.cycle + 4))
    block = turn(port, 300.0, 100)
    assert block.broken is not None
    assert (block.broken.cause, block.broken.row) == ("drive_mode", 6)
    (event,) = [event for event in port.events() if event.code == "drive-mode"]
    assert "mode of operation 4 (0x6061)" in event.text
    with pytest.raises(DriverError, match="no longer enabled"):
        turn(port, 300.0, 10)
    port.close()


def test_no_frame_more_goes_for_the_mode_where_there_is_no_room() -> None:
    bench = WireBench(individual_gear(GEAR, 3), MOTOR, None, World.of(7), clock=VirtualClock())
    config = shipped_config(bench, MOTOR)
    port = wire_port(bench, MOTOR, replace(config, drive=replace(config.drive, latch_index=False)))
    port.open()
    assert [p.length for p in port.nodes.layout.pdos if p.node_id == DRIVE_NODE] == [8]
    port.close()
