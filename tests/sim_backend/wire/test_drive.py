"""The simulated servo amplifier against CiA 402-2: transitions, quick stop, faults, limits, set-points, index latch."""

from __future__ import annotations

import struct

import pytest

from drivers.drive_state import DriveState, drive_state
from drivers.port import DriveLimits, Mode
from model.units import RPM
from sim_backend.wire.drive import Drive
from tests.sim_backend.rigs import MOTOR
from tests.sim_backend.wire.slaves import MS, Sent, drive, read, start, sync, write

S = DriveState
PATH = {
    S.SWITCH_ON_DISABLED: (),
    S.READY: (6,),
    S.SWITCHED_ON: (6, 7),
    S.ENABLED: (6, 7, 15),
    S.QUICK_STOP: (6, 7, 15, 2),
}
# State, controlword, next state: the standard's table of transitions (quick stop option code 6).
TABLE = (
    (S.SWITCH_ON_DISABLED, 0x06, S.READY), (S.SWITCH_ON_DISABLED, 0x07, S.SWITCH_ON_DISABLED),
    (S.SWITCH_ON_DISABLED, 0x0F, S.SWITCH_ON_DISABLED), (S.SWITCH_ON_DISABLED, 0x02, S.SWITCH_ON_DISABLED),
    (S.SWITCH_ON_DISABLED, 0x00, S.SWITCH_ON_DISABLED),
    (S.READY, 0x06, S.READY), (S.READY, 0x07, S.SWITCHED_ON), (S.READY, 0x0F, S.ENABLED),
    (S.READY, 0x02, S.SWITCH_ON_DISABLED), (S.READY, 0x00, S.SWITCH_ON_DISABLED),
    (S.SWITCHED_ON, 0x06, S.READY), (S.SWITCHED_ON, 0x07, S.SWITCHED_ON), (S.SWITCHED_ON, 0x0F, S.ENABLED),
    (S.SWITCHED_ON, 0x02, S.SWITCH_ON_DISABLED), (S.SWITCHED_ON, 0x00, S.SWITCH_ON_DISABLED),
    (S.ENABLED, 0x06, S.READY), (S.ENABLED, 0x07, S.SWITCHED_ON), (S.ENABLED, 0x0F, S.ENABLED),
    (S.ENABLED, 0x02, S.QUICK_STOP), (S.ENABLED, 0x00, S.SWITCH_ON_DISABLED), (S.ENABLED, 0x01, S.SWITCH_ON_DISABLED),
    (S.QUICK_STOP, 0x0F, S.ENABLED), (S.QUICK_STOP, 0x06, S.QUICK_STOP), (S.QUICK_STOP, 0x07, S.QUICK_STOP),
    (S.QUICK_STOP, 0x00, S.SWITCH_ON_DISABLED), (S.QUICK_STOP, 0x02, S.QUICK_STOP),
    (S.ENABLED, 0x80, S.ENABLED), (S.READY, 0x8F, S.READY),
)  # fmt: skip


def state(made: Drive) -> DriveState:
    return drive_state(read(made, 0x6041))


def brought(to: DriveState, option: int = 6) -> tuple[Drive, Sent]:
    made, sent = drive()
    write(made, sent, 0x605A, 0, option, 2)
    write(made, sent, 0x6060, 0, 9, 1)
    for word in PATH[to]:
        write(made, sent, 0x6040, 0, word, 2)
    assert state(made) is to
    return made, sent


@pytest.mark.parametrize(("before", "word", "after"), TABLE)
def test_transitions(before: DriveState, word: int, after: DriveState) -> None:
    made, sent = brought(before)
    assert write(made, sent, 0x6040, 0, word, 2) == 0
    assert state(made) is after


def test_a_controlword_acts_at_its_sync_and_shows_at_the_next() -> None:
    made, sent = brought(S.SWITCHED_ON)
    write(made, sent, 0x1400, 2, 1, 1)
    start(made)
    seen = []
    for _ in range(3):
        made.receive(0x201, struct.pack("<Hib", 0x0F, 500, 9), 0)
        sent.clear()
        sync(made)
        seen.append((drive_state(struct.unpack_from("<H", dict(sent)[0x181])[0]), made.demand()))
    assert seen[0] == (S.SWITCHED_ON, (Mode.SPEED, pytest.approx(0.5 * RPM)))
    assert seen[1][0] is S.ENABLED


@pytest.mark.parametrize(
    ("option", "demand", "ends"),
    [
        (0, Mode.OFF, S.SWITCH_ON_DISABLED),
        (1, Mode.SPEED, S.SWITCH_ON_DISABLED),
        (2, Mode.QUICK_STOP, S.SWITCH_ON_DISABLED),
        (5, Mode.SPEED, S.QUICK_STOP),
        (6, Mode.QUICK_STOP, S.QUICK_STOP),
    ],
)
def test_quick_stop_option_codes(option: int, demand: Mode, ends: DriveState) -> None:
    made, sent = brought(S.ENABLED, option)
    write(made, sent, 0x6040, 0, 2, 2)
    assert made.demand() == (demand, 0.0)
    made.take(0, 0, 0, 0, 10.0)
    assert state(made) is (S.QUICK_STOP if option else S.SWITCH_ON_DISABLED)
    made.take(0, 0, 0, 0, 0.0)
    assert state(made) is ends


def test_an_option_that_ends_in_power_off_does_not_let_it_go_on() -> None:
    made, sent = brought(S.QUICK_STOP, 2)
    write(made, sent, 0x6040, 0, 0x0F, 2)
    assert state(made) is S.QUICK_STOP


def test_other_option_codes_are_refused() -> None:
    made, sent = drive()
    assert write(made, sent, 0x605A, 0, 3, 2) == 0x06090030
    assert write(made, sent, 0x605E, 0, 3, 2) == 0x06090031


def test_a_fault_brakes_then_stays_until_a_rising_edge() -> None:
    made, sent = brought(S.ENABLED)
    sent.clear()
    made.fault(0x8611)
    assert sent[-1] == (0x081, bytes.fromhex("11 86 21 00 00 00 00 00"))
    assert (state(made), made.demand()) == (S.FAULT_REACTION, (Mode.QUICK_STOP, 0.0))
    made.take(0, 0, 0, 0, 0.0)
    assert (state(made), read(made, 0x603F)) == (S.FAULT, 0x8611)
    for word in (0x06, 0x0F, 0x00):
        write(made, sent, 0x6040, 0, word, 2)
    assert state(made) is S.FAULT
    write(made, sent, 0x6040, 0, 0x80, 2)
    assert (state(made), read(made, 0x603F), read(made, 0x1001)) == (S.SWITCH_ON_DISABLED, 0, 0)
    made.fault(0x2310)
    write(made, sent, 0x6040, 0, 0x80, 2)
    assert state(made) is S.FAULT, "the bit must rise"


def test_a_fault_of_the_power_stage_coasts() -> None:
    made, _ = brought(S.ENABLED)
    made.fault(0x2310, coasts=True)
    assert (state(made), made.demand()) == (S.FAULT, (Mode.OFF, 0.0))


@pytest.mark.parametrize(
    ("option", "after"),
    [
        (0, S.ENABLED),
        (1, S.FAULT_REACTION),
        (2, S.SWITCH_ON_DISABLED),
        (3, S.QUICK_STOP),
    ],
)
def test_abort_connection_option_when_the_heartbeat_stays_away(
    option: int, after: DriveState
) -> None:
    made, sent = brought(S.ENABLED)
    write(made, sent, 0x6007, 0, option, 2)
    write(made, sent, 0x1016, 1, 0x7F << 16 | 100, 4)
    start(made)
    made.receive(0x77F, b"\x05", 0)
    made.tick(101 * MS)
    assert state(made) is after


def test_stopping_the_node_is_a_lost_connection_and_pre_operational_is_not() -> None:
    for command, after in (
        (0x80, S.ENABLED),
        (0x02, S.QUICK_STOP),
        (0x82, S.QUICK_STOP),
        (0x81, S.SWITCH_ON_DISABLED),
    ):
        made, sent = brought(S.ENABLED)
        write(made, sent, 0x6007, 0, 3, 2)
        start(made)
        if command == 0x82:
            made.dictionary.store(0x6007, 0, 3)
        made.receive(0x000, bytes([command, 1]), 0)
        assert made.drive_state is after, hex(command)


def test_safe_torque_off_takes_torque_and_voltage_until_it_is_released() -> None:
    made, sent = brought(S.ENABLED)
    made.safe_torque_off(True)
    assert read(made, 0x6041) == 0x0240
    write(made, sent, 0x6040, 0, 0x06, 2)
    assert state(made) is S.SWITCH_ON_DISABLED
    made.safe_torque_off(False)
    write(made, sent, 0x6040, 0, 0x06, 2)
    assert state(made) is S.READY


def test_limits_in_their_units() -> None:
    made, sent = drive()
    assert read(made, 0x6072) == 350 * 10
    assert read(made, 0x6080) == round(MOTOR.maximum_speed / RPM)
    for index, value, size in (
        (0x6072, 500, 2),
        (0x6080, 1500, 4),
        (0x6083, 10, 4),
        (0x6084, 20, 4),
        (0x6085, 30, 4),
    ):
        write(made, sent, index, 0, value, size)
    expected = DriveLimits(0.5 * MOTOR.rated_torque, 1500 * RPM, 10 * RPM, 20 * RPM, 30 * RPM)
    assert made.limits().torque == pytest.approx(expected.torque)
    assert made.limits().speed == pytest.approx(expected.speed)
    assert made.limits().quick_stop_deceleration == pytest.approx(expected.quick_stop_deceleration)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (9, (Mode.SPEED, -2.5 * RPM)),
        (3, (Mode.SPEED, -2.5 * RPM)),
        (10, (Mode.TORQUE, 0.1 * MOTOR.rated_torque)),
        (4, (Mode.TORQUE, 0.1 * MOTOR.rated_torque)),
        (0, (Mode.SPEED, 0.0)),
    ],
)
def test_modes_and_set_points(mode: int, expected: tuple[Mode, float]) -> None:
    made, sent = brought(S.ENABLED)
    write(made, sent, 0x6060, 0, mode, 1)
    write(made, sent, 0x60FF, 0, -2500, 4)
    write(made, sent, 0x6071, 0, 100, 2)
    assert made.demand() == (expected[0], pytest.approx(expected[1]))
    assert read(made, 0x6061) == mode
    write(made, sent, 0x6040, 0, 0x10F, 2)
    assert made.demand()[1] == 0.0, "halt"


def test_positions_wrap_at_32_bits() -> None:
    made, _ = drive()
    made.take(2**31 + 5, 0, 0, 0, 0.0)
    assert read(made, 0x6064) == -(2**31) + 5


def test_the_touch_probe_stores_marks_that_pass_after_it_was_armed() -> None:
    made, sent = drive()
    made.take(100, 0, 90, 1, 1.0)
    write(made, sent, 0x60B8, 0, 0x17, 2)
    made.take(110, 0, 90, 1, 1.0)
    assert (read(made, 0x60B9), read(made, 0x60BA)) == (0x0001, 0)
    made.take(300, 0, 290, 1, 1.0)
    assert (read(made, 0x60B9), read(made, 0x60BA)) == (0x0003, 290)
    made.take(600, 0, 590, 1, 1.0)
    assert read(made, 0x60BA) == 590
    write(made, sent, 0x60B8, 0, 0x15, 2)
    for index in (790, 990):
        made.take(index + 10, 0, index, 1, 1.0)
    assert read(made, 0x60BA) == 790, "once, when it is not continuous"
    write(made, sent, 0x60B8, 0, 0, 2)
    assert (read(made, 0x60B9), read(made, 0x60BA)) == (0, 0)


def test_a_reversed_encoder_goes_on_from_where_it_is() -> None:
    made, _ = drive()
    positions = []
    for k in range(6):
        if k in (2, 4):
            made.reverse()
        made.take(100 + 10 * k, 0, 0, 0, 0.0)
        positions.append(read(made, 0x6064))
    assert positions == [100, 110, 100, 90, 100, 110]
