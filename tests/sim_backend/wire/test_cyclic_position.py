"""Cyclic synchronous position: the same counts directly and on the wire, in blocks of any length; a first target that
is the position, targets that are whole over hours, and what is refused before it is sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.cia402.positions import FRACTION, PositionTargets, speed_scale, wrapped
from drivers.bus.cia402.tables import POSITION, OperationMode
from drivers.bus.cyclic import CanRig
from drivers.drive_state import DriveState
from drivers.errors import DriverError
from drivers.port import Command, DriveLimits, Guard, Mode
from drivers.samples import SampleBlock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.bench.backends.simulated import position_config, wire_config, wire_port
from sim_backend.direct import SimulatedRig
from sim_backend.wire.bench import WireBench
from sim_backend.wire.drive import CYCLIC_POSITION, CYCLIC_VELOCITY, Drive
from tests.drivers.can_bench import servo

GEAR, MOTOR = shipped_gear(), shipped_motor()
CYCLES = 1000
SPEED = 30.0
RAMP = np.minimum(np.arange(CYCLES) * 0.5, SPEED)


def drive_of(bench: WireBench) -> Drive:
    assert isinstance(bench.drive, Drive)
    return bench.drive


def rig() -> tuple[CanRig, WireBench]:
    bench = WireBench(GEAR, MOTOR)
    return wire_port(bench, MOTOR, position_config(bench, MOTOR)), bench


def run(port: CanRig | SimulatedRig, sizes: Sequence[int]) -> list[SampleBlock]:
    """Servo off, then the ramp in blocks, then to rest, off, on again, off."""
    port.open()
    blocks = [port.exchange(Command(Mode.OFF), 20, Guard())]
    done = 0
    for size in sizes:
        blocks.append(port.exchange(Command(Mode.SPEED, RAMP[done : done + size]), size, Guard()))
        done += size
    blocks.append(port.exchange(Command(Mode.SPEED, RAMP[::-1]), CYCLES, Guard()))
    blocks.append(port.exchange(Command(Mode.OFF), 50, Guard()))
    blocks.append(port.exchange(Command(Mode.SPEED, np.full(50, 1.0)), 50, Guard()))
    return blocks


def counts(blocks: Sequence[SampleBlock]) -> np.ndarray:
    return np.concatenate([block.counts for block in blocks])


@pytest.fixture(scope="module")
def directly() -> np.ndarray:
    port = SimulatedRig(GEAR, MOTOR, by_position=True)
    return counts(run(port, [CYCLES]))


@pytest.mark.parametrize("length", [1, 7, 100, CYCLES])
def test_counts_on_the_wire_are_those_of_the_direct_rig(length: int, directly: np.ndarray) -> None:
    sizes = [length] * (CYCLES // length) + ([CYCLES % length] if CYCLES % length else [])
    port, _ = rig()
    blocks = run(port, sizes)
    names = [channel.name for channel in SimulatedRig(GEAR, MOTOR, by_position=True).channels]
    assert [channel.name for channel in port.channels] == names
    found = counts(blocks)
    for k, name in enumerate(names):
        assert np.array_equal(found[:, k], directly[:, k]), name


def test_it_turns_as_fast_as_it_is_told_and_stays_where_it_was_left() -> None:
    port, bench = rig()
    blocks = run(port, [CYCLES])
    at = [channel.name for channel in port.channels].index("input_angle")
    angle = counts(blocks)[:, at] * port.channels[at].scale
    speed = (angle[1019] - angle[819]) / 0.2
    assert speed == pytest.approx(SPEED, rel=0.01)
    held = drive_of(bench)
    assert held.dictionary.number(0x6061) == CYCLIC_POSITION
    port.close()
    assert not bench.is_powered


def test_the_first_target_is_where_a_standing_shaft_is() -> None:
    port, bench = rig()
    port.open()
    drive = drive_of(bench)
    seen: list[int] = []
    drive.dictionary.on_change(
        lambda index, sub: seen.append(drive.dictionary.number(0x607A)) if index == 0x607A else None
    )
    # Somebody has turned the shaft since the last run.
    drive.dictionary.store(0x607A, 0, 123_456)
    position = drive.dictionary.number(0x6064)
    port.exchange(Command(Mode.SPEED, np.zeros(5)), 5, Guard())
    assert seen[0] == position
    assert set(seen) == {position}
    assert abs(bench.input_speed) < 0.1


def test_its_position_is_sent_where_a_counter_has_the_input_angle_too() -> None:
    port, bench = rig()
    port.open()
    encoder = wire_config(bench, MOTOR).motor_encoder
    plan = servo(port.nodes).plan(encoder, 1_000_000, is_counted=True)
    assert POSITION in plan.objects
    assert POSITION.key not in plan.optional
    assert "input_angle" not in [planned.channel.name for planned in plan.channels]


def test_coming_from_torque_no_old_target_acts() -> None:
    port, bench = rig()
    port.open()
    port.write_limits(DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0))
    port.exchange(Command(Mode.SPEED, np.zeros(5)), 5, Guard())
    port.exchange(Command(Mode.TORQUE, np.full(400, 0.25)), 400, Guard())
    speed = bench.input_speed
    assert speed > 5.0, "it has turned away from the target of before"
    # As a run is brought to rest out of torque: from the speed that is measured.
    ramp = np.linspace(speed, 0.0, 400)
    block = port.exchange(Command(Mode.SPEED, ramp), 400, Guard())
    assert block.broken is None
    assert abs(bench.input_speed) < 2.0
    at = [channel.name for channel in port.channels].index("input_angle")
    angle = block.counts[:, at] * port.channels[at].scale
    assert np.diff(angle).min() > -0.02, "it goes on to its rest, and not back"


def test_a_target_beyond_one_cycles_greatest_travel_is_refused_and_not_sent() -> None:
    port, bench = rig()
    port.open()
    port.write_limits(DriveLimits(0.5, 100.0, 1000.0, 1000.0, 2000.0))
    port.exchange(Command(Mode.SPEED, np.zeros(5)), 5, Guard())
    before = drive_of(bench).dictionary.number(0x607A)
    fast = np.array([0.0, 0.0, 102.0])
    with pytest.raises(DriverError, match="greatest travel of one cycle") as refused:
        port.exchange(Command(Mode.SPEED, fast), 3, Guard())
    assert "52" in str(refused.value.limit)
    assert drive_of(bench).dictionary.number(0x607A) == before
    port.exchange(Command(Mode.SPEED, np.full(3, 99.0)), 3, Guard())


def test_following_too_far_behind_is_named() -> None:
    port, bench = rig()
    port.open()
    drive_of(bench).dictionary.store(0x6065, 0, 20)
    speeds = np.full(400, 60.0)
    block = port.exchange(Command(Mode.SPEED, speeds), 400, Guard())
    assert block.broken is not None
    assert block.broken.cause == "drive_following"
    with pytest.raises(DriverError, match="no longer enabled"):
        port.exchange(Command(Mode.SPEED, np.zeros(5)), 5, Guard())


def test_a_target_that_is_not_followed_any_more_is_named() -> None:
    port, bench = rig()
    port.open()
    at = [channel.name for channel in port.channels].index("statusword")
    block = port.exchange(Command(Mode.SPEED, RAMP[:200]), 200, Guard())
    assert (block.counts[:, at] & 0x1000).all()
    drive_of(bench).ignores_targets = True
    block = port.exchange(Command(Mode.SPEED, RAMP[200:400]), 200, Guard())
    assert block.broken is not None
    assert (block.broken.cause, block.broken.row) == ("drive_not_following", 2)


def test_a_drive_that_never_says_that_it_follows_is_not_judged_by_it() -> None:
    port, bench = rig()
    port.open()
    drive_of(bench).ignores_targets = True
    assert port.exchange(Command(Mode.SPEED, np.zeros(50)), 50, Guard()).broken is None


def test_a_halt_holds_still_and_is_noticed() -> None:
    port, bench = rig()
    port.open()
    port.exchange(Command(Mode.SPEED, RAMP), CYCLES, Guard())
    drive = drive_of(bench)
    drive.dictionary.on_change(
        lambda index, sub: drive.dictionary.store(0x6040, 0, 0x010F) if index == 0x607A else None
    )
    drive.dictionary.on_write(0x6040, 0, lambda value: drive._control(0x010F))
    block = port.exchange(Command(Mode.SPEED, np.full(200, SPEED)), 200, Guard())
    assert block.broken is not None
    assert block.broken.cause == "drive_not_following"
    assert bench.input_speed < SPEED


@pytest.mark.parametrize(("window", "is_told"), [(0xFFFF_FFFF, True), (8192, False), (None, False)])
def test_a_watch_over_the_following_error_that_is_off_is_told(
    window: int | None, is_told: bool
) -> None:
    port, bench = rig()
    if window is None:
        drive_of(bench).dictionary.take_out(0x6065)
    else:
        drive_of(bench).dictionary.store(0x6065, 0, window)
    port.open()
    codes = {event.code for event in port.segment.events()}
    assert ("following-window" in codes) == is_told
    missing = [gap.index for gap in servo(port.nodes).device.missing]
    assert (0x6065 in missing) == (window is None)


def test_a_quick_stop_ends_it_and_servo_on_begins_where_it_stands() -> None:
    port, bench = rig()
    port.open()
    port.exchange(Command(Mode.SPEED, RAMP), CYCLES, Guard())
    port.exchange(Command(Mode.QUICK_STOP), 300, Guard())
    assert abs(bench.input_speed) < 0.2
    port.exchange(Command(Mode.OFF), 20, Guard())
    assert drive_of(bench).drive_state is DriveState.SWITCH_ON_DISABLED
    port.exchange(Command(Mode.SPEED, np.zeros(50)), 50, Guard())
    assert abs(bench.input_speed) < 0.2


# What the drive has -----------------------------------------------------------------------------------------------


def test_the_mode_follows_from_what_the_drive_has() -> None:
    bench = WireBench(GEAR, MOTOR)
    supported = drive_of(bench).dictionary.number(0x6502)
    for without, mode in (
        ((), OperationMode.CYCLIC_VELOCITY),
        ((CYCLIC_VELOCITY,), OperationMode.CYCLIC_POSITION),
        ((CYCLIC_VELOCITY, CYCLIC_POSITION), OperationMode.PROFILE_VELOCITY),
    ):
        bench = WireBench(GEAR, MOTOR)
        has = supported & ~sum(1 << (number - 1) for number in without)
        drive_of(bench).dictionary.store(0x6502, 0, has)
        port = wire_port(bench, MOTOR, wire_config(bench, MOTOR))
        port.open()
        assert servo(port.nodes).readings.speed_mode is mode
        described = port.nodes.describe()["servo amplifier"]["speed_mode"]
        assert described == mode.name


def test_offsets_are_zero_at_the_start_and_at_the_end() -> None:
    port, bench = rig()
    store, number = drive_of(bench).dictionary.store, drive_of(bench).dictionary.number
    offsets = (0x60B0, 0x60B1, 0x60B2)
    for index in offsets:
        store(index, 0, 77)
    port.open()
    assert [number(index) for index in offsets] == [0, 0, 0]
    store(0x60B1, 0, 5)
    port.close()
    assert [number(index) for index in offsets] == [0, 0, 0]


def test_a_drive_without_offsets_is_led_all_the_same() -> None:
    port, bench = rig()
    for index in (0x60B0, 0x60B1, 0x60B2):
        drive_of(bench).dictionary.take_out(index)
    drive_of(bench).dictionary.on_read(0x60B0, 0, lambda: 0)
    port.open()


def test_a_sync_period_that_the_drive_does_not_interpolate_is_refused() -> None:
    bench = WireBench(GEAR, MOTOR)
    drive_of(bench).dictionary.take_out(0x60C2)
    port = wire_port(bench, MOTOR, position_config(bench, MOTOR))
    with pytest.raises(DriverError, match="interpolation time"):
        port.open()


def test_software_limits_in_the_way_of_a_turning_shaft_are_refused() -> None:
    port, bench = rig()
    drive_of(bench).dictionary.store(0x607D, 1, -100_000)
    drive_of(bench).dictionary.store(0x607D, 2, 100_000)
    with pytest.raises(DriverError, match="software position limits"):
        port.open()


# Targets ----------------------------------------------------------------------------------------------------------


def test_targets_are_the_exact_sum_of_the_set_speeds_over_an_hour_in_blocks_of_any_length() -> None:
    speed = round(1.0 * RPM / speed_scale(32768, 1_000_000))
    hour = 3_600_000
    targets = PositionTargets()
    targets.begin(17)
    last = 0
    for size in (1, 7, 100, 1000, hour - 1108):
        last = int(targets.plan(np.full(size, speed), 1000, "test")[-1])
        targets.sent(size)
    exact = 17 * FRACTION + hour * speed
    assert last == (exact + FRACTION // 2) // FRACTION
    # The set speed itself is a whole number of 1/65536 count per cycle: up to 28 counts in an hour.
    assert last == pytest.approx(17 + 60 * 32768, abs=1.0 + hour * 0.5 / FRACTION)


def test_a_block_that_was_cut_goes_on_from_what_was_sent() -> None:
    targets = PositionTargets()
    targets.begin(0)
    targets.plan(np.full(100, 10 * FRACTION), 1000, "test")
    targets.sent(30)
    assert targets.hold(2).tolist() == [300, 300]
    assert targets.plan(np.full(2, FRACTION), 1000, "test").tolist() == [301, 302]


def test_the_number_begins_anew_where_32_bits_end() -> None:
    targets = PositionTargets()
    targets.begin(2**31 - 2)
    assert targets.plan(np.full(3, FRACTION), 10, "test").tolist() == [
        2**31 - 1,
        -(2**31),
        1 - 2**31,
    ]
    assert wrapped(np.array([2**31])).tolist() == [-(2**31)]


def test_frames_that_are_made_for_a_watchdog_move_no_target() -> None:
    port, bench = rig()
    port.open()
    port.exchange(Command(Mode.SPEED, RAMP), CYCLES, Guard())
    before = drive_of(bench).dictionary.number(0x607A)
    frames = port.abilities.quick_stop_frames
    assert frames is not None
    frames()
    port.exchange(Command(Mode.SPEED, np.full(1, SPEED)), 1, Guard())
    step = drive_of(bench).dictionary.number(0x607A) - before
    assert step == pytest.approx(SPEED * 1e-3 / (2 * np.pi) * 32768, abs=1.0)


def test_a_rig_that_is_not_led_by_positions_sends_none() -> None:
    bench = WireBench(GEAR, MOTOR)
    port = wire_port(bench, MOTOR, replace(wire_config(bench, MOTOR)))
    port.open()
    port.exchange(Command(Mode.SPEED, np.full(20, 5.0)), 20, Guard())
    assert drive_of(bench).dictionary.number(0x607A) == 0
