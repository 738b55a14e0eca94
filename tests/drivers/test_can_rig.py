"""The whole rig against devices of another CANopen stack, in virtual time on one pumped bus."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia406 import CounterConfig
from drivers.bus.cyclic import CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.channel import (
    DRIVE_TORQUE,
    INDEX_SEEN,
    INPUT_ANGLE,
    INPUT_INDEX,
    OUTPUT_ANGLE,
    STATUSWORD,
    TARGET_SPEED,
    TORQUE,
)
from drivers.errors import DriverError, ReadbackError
from drivers.port import Command, Guard, Mode
from drivers.python_can import can
from drivers.samples import CycleFlag
from tests.drivers.can_bench import LIMITS, RPM, Setup, close, servo, setup
from tests.drivers.canopen_peer import Bench, drive_eds


@pytest.mark.parametrize("state", ["SOD", "READY", "ON", "ENABLED", "QUICK", "FAULT"])
@pytest.mark.parametrize("nmt", ["OPERATIONAL", "PRE-OPERATIONAL", "STOPPED"])
def test_a_drive_in_any_state_is_brought_up_with_the_servo_off(state: str, nmt: str) -> None:
    made = setup(state=state)
    for peer in (made.drive, made.counter, made.analog):
        peer.node.nmt.state = nmt
    made.drive.publish()
    made.rig.open()
    assert made.drive.state == "SOD"
    assert made.drive.node.nmt.state == "OPERATIONAL"
    assert made.rig.exchange(Command(Mode.OFF), 3, Guard()).flags.tolist() == [0, 0, 0]
    assert ("found-faulted" in made.codes()) == (state == "FAULT")
    assert ("found-enabled" in made.codes()) == (state == "ENABLED")
    close(made)


def test_mapping_is_written_by_the_standard_and_other_tpdos_are_silenced(bench: Setup) -> None:
    drive = bench.drive
    assert [drive.get(0x1A00, i) for i in range(4)] == [3, 0x60410010, 0x60640020, 0x60770010]
    assert [drive.get(0x1600, i) for i in range(4)] == [3, 0x60400010, 0x60FF0020, 0x60710010]
    assert (drive.get(0x1800, 2), drive.get(0x1400, 2)) == (1, 1)
    assert drive.get(0x1800, 1) == 0x40000181
    assert [drive.get(0x1800 + n, 1) >> 31 for n in range(4)] == [0, 1, 1, 1]


def test_heartbeats_and_options_are_configured_on_both_sides(bench: Setup) -> None:
    drive = bench.drive
    assert drive.get(0x1017) == 100
    assert drive.get(0x1016, 1) == 127 << 16 | 250
    assert (drive.get(0x6007), drive.get(0x605A), drive.get(0x605E)) == (3, 2, 2)
    assert drive.get(0x1006) == 0
    assert bench.analog.get(0x6423) == 1
    missing = {m.index: m.consequence for m in bench.rig.missing()[1]}
    assert "index mark" in missing[0x60B8]
    assert 0x6041 not in missing
    bench.rig.close()
    assert drive.get(0x1016, 1) == 0


def test_what_was_latched_at_sync_k_stands_in_row_k(bench: Setup) -> None:
    off = bench.rig.exchange(Command(Mode.OFF), 4, Guard())
    block = bench.speed(477, 6)
    assert (off.first_cycle, block.first_cycle) == (0, 4)
    assert block.counts[:, bench.column(INPUT_ANGLE)].tolist() == [477 * k for k in range(1, 7)]
    assert block.counts[:, bench.column(TARGET_SPEED)].tolist() == [477] * 6
    assert block.counts[:, bench.column(DRIVE_TORQUE)].tolist() == [238] * 6
    assert block.counts[:, bench.column(TORQUE)].tolist() == [100] * 6
    assert (
        np.diff(np.concatenate([off.counts, block.counts])[:, bench.column(OUTPUT_ANGLE)]).tolist()
        == [7] * 9
    )
    assert set(block.counts[:, bench.column(STATUSWORD)]) == {0x0237}
    assert np.diff(block.time_ns).tolist() == [1_000_000] * 5
    assert not block.flags.any()
    torque = bench.rig.channels[bench.column(TORQUE)]
    assert torque.to_si(np.array([100]))[0] == pytest.approx(100 * 0.3125e-3 * 0.637)


def exchange_in_blocks(length: int) -> tuple[list[list[int]], list[int]]:
    made = setup()
    made.drive.silent_at, made.drive.double_at, made.counter.late_at, made.counter.short_at = (
        {9},
        {12},
        {20, 21},
        {33},
    )
    made.rig.open()
    counts, flags = [], []
    for start in range(0, 60, length):
        part = made.speed(300, min(length, 60 - start))
        counts += part.counts.tolist()
        flags += part.flags.tolist()
    close(made)
    return counts, flags


def test_the_length_of_the_blocks_changes_no_count() -> None:
    counts, flags = exchange_in_blocks(60)
    assert exchange_in_blocks(1) == (counts, flags)
    assert exchange_in_blocks(7) == (counts, flags)
    # One node of two: whose values are old is said.
    assert (
        flags[9]
        == CycleFlag.INCOMPLETE
        | CycleFlag.STALE_STATUSWORD
        | CycleFlag.STALE_INPUT
        | CycleFlag.STALE_OTHER
    )
    assert flags[12] == CycleFlag.DOUBLED
    assert flags[20] & CycleFlag.INCOMPLETE
    assert flags[33] & CycleFlag.SHORT
    assert not any(flags[40:])
    for k in range(60):
        assert flags[k] or counts[k][1] == 719990 + 7 * (k + 1)


def test_quick_stop_acts_in_the_next_cycle(bench: Setup) -> None:
    bench.speed(300, 5)
    block = bench.rig.exchange(Command(Mode.QUICK_STOP), 3, Guard())
    assert bench.drive.get(0x6040) == 0x02
    assert block.counts[0, bench.column(STATUSWORD)] != 0x0237


def test_a_watchdog_of_its_own_sends_process_data_only(bench: Setup) -> None:
    bench.speed(300, 5)
    assert bench.drive.get(0x6040) == 0x0F
    for cob_id, data in bench.rig.quick_stop_frames():
        assert cob_id < 0x580
        bench.raw.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
    servo(bench.rig.nodes).bus.receive(0)
    assert bench.drive.get(0x6040) == 0x02
    assert bench.drive.state != "ENABLED"


def test_limits_are_written_to_the_safe_side_and_read_back(bench: Setup) -> None:
    back = bench.rig.write_limits(LIMITS)
    assert bench.drive.get(0x6072) == 784  # 0.5 N m / 0.637 N m, floor
    assert bench.drive.get(0x6080) == 2864
    assert bench.drive.get(0x6085) == 19098
    one = {
        "torque": 0.637e-3,
        "speed": RPM,
        "acceleration": RPM,
        "deceleration": RPM,
        "quick_stop_deceleration": RPM,
    }
    for name, count in one.items():
        assert getattr(LIMITS, name) - count < getattr(back, name) <= getattr(LIMITS, name)
    with pytest.raises(DriverError, match="cannot be expressed"):
        bench.rig.write_limits(replace(LIMITS, torque=1e-5))


def test_a_limit_that_reads_back_differently_is_an_error(bench: Setup) -> None:
    node = bench.drive.node
    node.add_write_callback(
        lambda index, subindex, od, data: (
            bench.drive.put(0x6080, 6000, 4) if index == 0x6080 else None
        )
    )
    original = node.set_data

    def capped(index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        original(index, subindex, b"\x70\x17\x00\x00" if index == 0x6080 else data, check_writable)

    node.set_data = capped  # type: ignore[method-assign]
    with pytest.raises(ReadbackError, match="reads back differently"):
        bench.rig.write_limits(LIMITS)


def test_torque_mode_needs_a_speed_limit_that_was_read_back(bench: Setup) -> None:
    command = Command(Mode.TORQUE, np.full(3, 0.1))
    with pytest.raises(DriverError, match="speed limit"):
        bench.rig.exchange(command, 3, Guard())
    bench.rig.write_limits(LIMITS)
    bench.rig.exchange(command, 3, Guard())
    assert bench.drive.get(0x6060) == 10
    assert bench.drive.get(0x6071) == 157


def test_a_drive_without_torque_and_limits_says_what_is_missing() -> None:
    told = DriveConfig(rated_torque=0.637, acceleration_unit=RPM)
    made = setup(eds_text=drive_eds(torque=False, limits=False), drive=told)
    made.rig.open()
    names = [c.name for c in made.rig.channels]
    assert DRIVE_TORQUE not in names
    assert INPUT_ANGLE in names
    back = made.rig.write_limits(LIMITS)
    assert all(np.isinf(getattr(back, n)) for n in ("torque", "speed", "acceleration"))
    missing = {m.index for m in made.rig.missing()[1]}
    assert {0x6072, 0x6077, 0x6080, 0x6083} <= missing
    assert len(made.speed(100, 3)) == 3
    with pytest.raises(DriverError):
        made.rig.exchange(Command(Mode.TORQUE, np.zeros(3)), 3, Guard())
    close(made)


def test_set_points_that_do_not_fit_are_refused_not_clipped(bench: Setup) -> None:
    bench.rig.write_limits(LIMITS)
    for command in (
        Command(Mode.SPEED, np.full(3, 1e12)),
        Command(Mode.TORQUE, np.full(3, 1e3)),
        Command(Mode.SPEED, np.array([0.0, np.nan, 0.0])),
        Command(Mode.SPEED, np.zeros(2)),
    ):
        with pytest.raises(DriverError):
            bench.rig.exchange(command, 3, Guard())
    assert bench.drive.syncs == 0


def test_the_computers_heartbeat_is_sent_by_the_turns(bench: Setup) -> None:
    sent: list[int] = []
    original = bench.raw.send
    bench.raw.send = lambda msg: (sent.append(msg.arbitration_id), original(msg))[1]  # type: ignore[method-assign]
    bench.speed(100, 500)
    assert sent.count(0x080) == 500
    assert sent.count(0x201) == 500
    assert 9 <= sent.count(0x77F) <= 11


def test_a_port_that_is_not_open_says_so() -> None:
    made = setup()
    for use in (
        lambda: made.rig.channels,
        lambda: made.rig.exchange(Command(Mode.OFF), 1, Guard()),
        made.rig.acquisition,
    ):
        with pytest.raises(DriverError, match="not open"):
            use()
    made.rig.close()
    made.raw.shutdown()
    Bench(made.drive, made.counter, made.analog).close()


def test_nodes_must_not_share_a_node_id() -> None:
    made = setup(
        config=CanRigConfig(
            motor_encoder=MotorEncoder(largest_speed=900.0), counters=(CounterConfig(node_id=1),)
        )
    )
    with pytest.raises(DriverError, match="node-ID of its own"):
        made.rig.open()
    close(made)


def test_a_device_with_few_mapping_entries_gets_more_pdos() -> None:
    made = setup(eds_text=drive_eds(entries=2))
    made.rig.open()
    assert [made.drive.get(0x1A00, i) for i in range(3)] == [2, 0x60410010, 0x60640020]
    assert [made.drive.get(0x1A01, i) for i in range(2)] == [1, 0x60770010]
    block = made.speed(300, 4)
    assert block.counts[:, made.column(INPUT_ANGLE)].tolist() == [300, 600, 900, 1200]
    assert block.counts[:, made.column(DRIVE_TORQUE)].tolist() == [150] * 4
    close(made)


def test_profile_velocity_is_taken_where_there_is_no_cyclic_one() -> None:
    made = setup(eds_text=drive_eds(modes=0x04))
    made.rig.open()
    made.speed(300, 3)
    assert made.drive.get(0x6060) == 3
    with pytest.raises(DriverError):
        made.rig.exchange(Command(Mode.TORQUE, np.zeros(3)), 3, Guard())
    close(made)


def test_the_index_mark_is_latched_by_the_touch_probe() -> None:
    made = setup(eds_text=drive_eds(probe=True))
    made.rig.open()
    assert made.drive.get(0x60B8) == 0x17
    before = made.speed(300, 3)
    index, seen = made.column(INPUT_INDEX), made.column(INDEX_SEEN)
    assert before.counts[:, index].tolist() == [0, 0, 0]
    assert before.counts[:, seen].tolist() == [0, 0, 0]
    made.drive.put(0x60BA, 1000, 4)
    made.drive.put(0x60B9, 0x0003, 2)
    after = made.speed(300, 3)
    assert after.counts[:, index].tolist() == [1000, 1000, 1000]
    assert after.counts[:, seen].tolist() == [1, 1, 1]
    close(made)


def test_a_drive_that_tells_no_unit_names_the_entry_that_is_needed() -> None:
    text = "\n[".join(
        part for part in drive_eds().split("\n[") if not part.startswith(("60A9]", "6076]"))
    )
    made = setup(eds_text=text)
    made.rig.open()
    assert TARGET_SPEED not in [c.name for c in made.rig.channels]
    with pytest.raises(DriverError, match="configuration"):
        made.speed(0, 3)
    close(made)
    told = setup(eds_text=text, drive=DriveConfig(velocity_unit=RPM, rated_torque=0.637))
    told.rig.open()
    assert len(told.speed(100, 3)) == 3
    assert DRIVE_TORQUE in [c.name for c in told.rig.channels]
    close(told)
