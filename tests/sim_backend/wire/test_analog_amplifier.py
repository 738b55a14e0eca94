"""An amplifier by analog reference behind a coupler: it turns the rig in blocks of any length, sends nothing beyond its
range, switches nothing on by itself, and whatever it cannot do is said before anything moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.analog.amplifier import ReferenceAmplifier
from drivers.bus.analog.config import ReferenceConfig
from drivers.bus.cia301 import I16, U8, U16, ObjectRef
from drivers.bus.cia401 import AnalogModuleConfig, torque_input
from drivers.bus.cyclic import CanRig
from drivers.bus.status_lines import Line, StatusLines, statusword
from drivers.drive_state import DriveState, drive_state
from drivers.errors import BusLostError, DriverError
from drivers.port import Ask, Command, DriveLimits, Guard, Mode, Request
from drivers.samples import SampleBlock
from experiments.finding import Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.bench.backends.order import Order
from rig.bench.backends.simulated import reference_config, reference_device, wire_port
from rig.bench.limits import derive_limits
from rig.errors import LimitError
from rig.run.arming import loss_check
from rig.run.preflight import drive_limits_check
from sim_backend.wire import analog_amplifier as simulated
from sim_backend.wire.bench import DRIVE_NODE, WireBench
from sim_backend.wire.dictionary import I16 as WIRE_I16
from sim_backend.wire.dictionary import array
from sim_backend.wire.slave import PdoPlan

MOTOR = shipped_motor()
GEAR = shipped_gear()
CYCLES = 1000
SPEED = 20.0


def bench() -> WireBench:
    device = reference_device(Order(protocol="", gear=GEAR, motor=MOTOR), MOTOR)
    return WireBench(GEAR, MOTOR, reference=device)


def amplifier(made: WireBench) -> simulated.AnalogAmplifier:
    assert isinstance(made.drive, simulated.AnalogAmplifier)
    return made.drive


def reference(made: WireBench) -> ReferenceConfig:
    drive = reference_config(made, MOTOR).drive
    assert isinstance(drive, ReferenceConfig)
    return drive


def port_of(made: WireBench, **changed: object) -> CanRig:
    """The drivers in front of a bench; what is `changed` of the amplifier's description."""
    config = reference_config(made, MOTOR)
    drive = replace(reference(made), **changed)  # type: ignore[arg-type]
    return wire_port(made, MOTOR, replace(config, drive=drive))


def turned(port: CanRig, sizes: Sequence[int], speed: float = SPEED) -> list[SampleBlock]:
    port.open()
    return [port.exchange(Command(Mode.SPEED, np.full(n, speed)), n, Guard()) for n in sizes]


def column(port: CanRig, blocks: Sequence[SampleBlock], name: str) -> np.ndarray:
    at = [channel.name for channel in port.channels].index(name)
    return np.concatenate([block.counts[:, at] for block in blocks])


@pytest.fixture(scope="module")
def in_one_block() -> np.ndarray:
    (block,) = turned(port_of(bench()), [CYCLES])
    return block.counts


@pytest.mark.parametrize("length", [1, 7, 100, CYCLES])
def test_the_length_of_blocks_changes_no_count(length: int, in_one_block: np.ndarray) -> None:
    sizes = [length] * (CYCLES // length) + ([CYCLES % length] if CYCLES % length else [])
    blocks = turned(port_of(bench()), sizes)
    assert np.array_equal(np.concatenate([block.counts for block in blocks]), in_one_block)


def test_the_motor_turns_as_fast_as_the_voltage_says() -> None:
    made = bench()
    port = port_of(made)
    blocks = turned(port, [CYCLES])
    scale = {channel.name: channel.scale for channel in port.channels}
    angle = column(port, blocks, "input_angle") * scale["input_angle"]
    speed = (angle[-1] - angle[-201]) / 0.2
    device = amplifier(made).device
    assert abs(speed) == pytest.approx(SPEED, rel=0.01)
    # The amplifier has an offset and a gain of its own: the rig's own set-point is not what turns.
    assert abs(speed) != pytest.approx(SPEED, rel=0.2 * device.gain_error)
    words = column(port, blocks, "statusword")
    assert {drive_state(int(word)) for word in words} == {DriveState.ENABLED}
    assert words[-1] & 0x0400, "speed coincidence"


def test_the_set_point_of_standstill_is_the_voltage_at_which_the_motor_stands() -> None:
    made = bench()
    amplifier(made).device = replace(amplifier(made).device, offset_volts=-0.05)
    port = port_of(made, zero_volts=0.05)
    (block,) = turned(port, [CYCLES], 0.0)
    at = [channel.name for channel in port.channels].index("target_speed")
    assert block.counts[-1, at] == round(0.05 / simulated.VOLTS_PER_COUNT)
    channel = port.channels[at]
    stands = channel.direction * channel.scale * block.counts[-1, at] + channel.offset
    assert stands == pytest.approx(0.0, abs=1e-9)
    assert abs(made.input_speed) < 0.02
    off = port.exchange(Command(Mode.OFF), 5, Guard())
    assert off.counts[-1, at] == block.counts[-1, at], "what was sent, not nought"


def test_a_reference_beyond_its_range_is_refused_and_not_sent() -> None:
    made = bench()
    port = port_of(made, largest_volts=1.0)
    port.open()
    fast = 1.01 * reference(made).speed_per_volt
    with pytest.raises(DriverError, match="does not fit") as refused:
        port.exchange(Command(Mode.SPEED, np.full(5, fast)), 5, Guard())
    assert "52.3" in str(refused.value.limit)
    assert not made.is_powered
    assert amplifier(made).dictionary.value(0x6411, 1) == 0


def test_a_state_is_waited_for_as_long_as_was_said_and_no_longer() -> None:
    made = bench()
    port = port_of(made, state_timeout_ms=200)
    port.open()
    drive = port.nodes.drive
    assert isinstance(drive, ReferenceAmplifier)
    began = drive.bus.clock.monotonic_ns()
    with pytest.raises(DriverError, match="waited in vain for a miracle") as refused:
        drive._await(lambda state: False, "a miracle")
    waited = (drive.bus.clock.monotonic_ns() - began) * 1e-6
    assert 200.0 <= waited < 220.0
    assert refused.value.limit == "200 ms"
    port.close()


def test_torque_is_refused() -> None:
    port = port_of(bench())
    port.open()
    with pytest.raises(DriverError, match="no set-points for cyclic torque"):
        port.exchange(Command(Mode.TORQUE, np.zeros(5)), 5, Guard())


def test_a_quick_stop_is_the_voltage_of_standstill_and_switches_nothing_on() -> None:
    made = bench()
    port = port_of(made)
    port.open()
    assert not port.abilities.has_quick_stop
    assert not port.abilities.reads_limits_back
    port.exchange(Command(Mode.QUICK_STOP), 50, Guard())
    assert not made.is_powered
    port.exchange(Command(Mode.SPEED, np.full(200, SPEED)), 200, Guard())
    assert abs(made.input_speed) > 15.0
    port.exchange(Command(Mode.QUICK_STOP), 300, Guard())
    assert made.is_powered
    assert abs(made.input_speed) < 0.1
    port.exchange(Command(Mode.OFF), 5, Guard())
    assert not made.is_powered


def test_an_alarm_that_is_over_does_not_find_servo_on() -> None:
    made = bench()
    port = port_of(made)
    turned(port, [100])
    amplifier(made).fault(0x710, coasts=True)
    block = port.exchange(Command(Mode.SPEED, np.full(50, SPEED)), 50, Guard())
    assert block.broken is not None
    assert block.broken.cause == "drive_state"
    # Whatever is commanded now, servo-on is gone; an alarm that is reset by hand at the panel starts nothing.
    port.exchange(Command(Mode.QUICK_STOP), 5, Guard())
    assert not amplifier(made).dictionary.number(0x6200, 1) & simulated.SERVO_ON
    with pytest.raises(DriverError, match="not ready"):
        port.exchange(Command(Mode.SPEED, np.full(5, SPEED)), 5, Guard())
    port.exchange(Command(Mode.OFF), 5, Guard())
    port.reset_fault()
    assert amplifier(made).drive_state is DriveState.SWITCH_ON_DISABLED
    assert not made.is_powered


def test_an_alarm_without_a_line_for_its_reset_is_for_the_panel() -> None:
    made = bench()
    port = port_of(made, alarm_reset=None)
    port.open()
    amplifier(made).fault(0x710)
    with pytest.raises(DriverError, match="panel"):
        port.reset_fault()


def test_an_amplifier_that_is_not_ready_is_not_switched_on() -> None:
    made = bench()
    port = port_of(made)
    port.open()
    amplifier(made).safe_torque_off(True)
    with pytest.raises(DriverError, match="not ready"):
        port.exchange(Command(Mode.SPEED, np.zeros(5)), 5, Guard())
    amplifier(made).safe_torque_off(False)
    assert not made.is_powered


def test_a_motor_that_was_left_turning_is_brought_to_rest_before_its_power_goes() -> None:
    made = bench()
    turned(port_of(made), [300])
    amplifier(made).ignore_lost_master()
    assert abs(made.input_speed) > 15.0
    # The next computer finds it so: the coupler has let it turn.
    port = port_of(made)
    port.open()
    codes = [event.code for event in port.abilities.events()] if port.abilities.events else []
    assert "found-enabled" in codes
    assert abs(made.input_speed) < 25 * RPM
    assert not made.is_powered


def test_a_coupler_that_loses_the_computer_takes_servo_on_and_reference_away() -> None:
    made = bench()
    port = port_of(made)
    turned(port, [200])
    assert loss_check(port.abilities.unwatched, "").severity is Severity.PASSED
    for _ in range(600):
        made.clock.wait_until_ns(made.clock.monotonic_ns() + 1_000_000)
        made.elapse()
    assert amplifier(made).dictionary.value(0x6411, 1) == 0
    assert not made.is_powered


@pytest.mark.parametrize("missing", [0x6206, 0x6207, 0x6443, 0x6444])
def test_a_coupler_without_error_modes_is_not_armed(missing: int) -> None:
    made = bench()
    amplifier(made).dictionary.take_out(missing)
    port = port_of(made)
    port.open()
    check = loss_check(port.abilities.unwatched, "")
    assert check.severity is Severity.BLOCKS
    assert f"0x{missing:04X}" in check.found


def test_the_watchdogs_frames_stop_it_past_the_loop() -> None:
    made = bench()
    port = port_of(made)
    turned(port, [200])
    frames = port.abilities.quick_stop_frames
    assert frames is not None
    for cob_id, data in frames():
        made.send(cob_id, data)
    for _ in range(300):
        made.send(0x080, b"")
    assert abs(made.input_speed) < 0.1


def test_it_is_asked_by_its_own_objects() -> None:
    made = bench()
    port = port_of(made)
    turned(port, [100])
    assert port.line is not None
    port.line.hand([Request(Ask.SERVO_OFF, "statusword"), Request(Ask.READ, "statusword")])
    answers = []
    for _ in range(20):
        port.exchange(Command(Mode.QUICK_STOP), 1, Guard())
        answers += port.line.answers()
    read = next(answer for answer in answers if answer.request.ask is Ask.READ)
    assert read.count is not None
    assert drive_state(read.count) in (DriveState.SWITCH_ON_DISABLED, DriveState.ENABLED)


def test_a_coupler_holds_the_amplifier_and_other_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    """One node with contacts, reference and torque monitor: brought up once, all of it with every SYNC."""
    inputs = array(
        0x6401, "Read analogue input 16-bit", [("input 1", WIRE_I16, "ro", 77)], mappable="t"
    )
    own, pdos = simulated.coupler_entries, simulated.COUPLER_PDOS
    monkeypatch.setattr(
        simulated, "coupler_entries", lambda node_id, serial: [*own(node_id, serial), *inputs]
    )
    monkeypatch.setattr(
        simulated, "COUPLER_PDOS", (*pdos, PdoPlan(2, transmit=True, mapping=(), exists=False))
    )
    made = bench()
    config = reference_config(made, MOTOR)
    module = AnalogModuleConfig(DRIVE_NODE, (torque_input(MOTOR.rated_torque),))
    port = wire_port(made, MOTOR, replace(config, modules=(module,)))
    (block,) = turned(port, [50])
    assert next(iter(port.nodes.identities)) == "amplifier by analog reference and analog module 1"
    assert [device.node_id for device in port.nodes.devices] == [1, 4, 2]
    at = {channel.name: k for k, channel in enumerate(port.channels)}
    assert set(block.counts[:, at["torque"]]) == {77}
    assert drive_state(int(block.counts[-1, at["statusword"]])) is DriveState.ENABLED
    assert not block.flags.any()


# Limits ---------------------------------------------------------------------------------------------------------------


def test_limits_by_hand_are_said_and_no_wider_than_the_gear_bears() -> None:
    made = bench()
    limits = derive_limits(GEAR, MOTOR)
    port = port_of(made)
    port.open()
    check = drive_limits_check(port, limits)
    assert check.severity is Severity.WARNS
    assert "not read back" in check.found
    held = reference(made).limits_by_hand
    for name in ("torque", "speed"):
        wide = replace(held, **{name: 1.05 * getattr(limits.drive_limits(), name)})
        with pytest.raises(LimitError, match=f"{name} limit, set by hand, is wider"):
            drive_limits_check(port_with(wide), limits)
        with pytest.raises(LimitError, match=f"nobody has said which {name}"):
            drive_limits_check(port_with(replace(held, **{name: math.inf})), limits)


def test_the_protocols_own_speed_is_no_business_of_a_limit_by_hand() -> None:
    limits = derive_limits(GEAR, MOTOR, plan_speed=10.0)
    assert limits.drive_limits().speed < 20.0
    made = bench()
    port = port_of(made)
    port.open()
    assert drive_limits_check(port, limits).severity is Severity.WARNS


def port_with(limits: DriveLimits) -> CanRig:
    port = port_of(bench(), limits_by_hand=limits)
    port.open()
    return port


# Contacts -------------------------------------------------------------------------------------------------------------


def test_the_statusword_of_every_state_of_the_contacts() -> None:
    lines = StatusLines(
        alarm=Line(0x01, active_high=False), power=Line(0x02), ready=Line(0x04), reached=Line(0x08)
    )
    expected = {
        0x00: DriveState.FAULT,
        0x02: DriveState.FAULT_REACTION,
        0x05: DriveState.SWITCH_ON_DISABLED,
        0x01: DriveState.SWITCH_ON_DISABLED,
        0x07: DriveState.ENABLED,
        0x0F: DriveState.ENABLED,
    }
    assert {word: drive_state(lines.of(word)) for word in expected} == expected
    assert lines.of(0x05) & 0x0010, "voltage at the power stage"
    assert not lines.of(0x01) & 0x0010
    words = np.arange(256)
    assert lines.of_all(words).tolist() == [lines.of(int(word)) for word in words]
    # Bits above those that are wired say nothing.
    assert lines.of(0xF7) == lines.of(0x07)
    assert statusword(alarm=False, power=True, ready=True, reached=True) & 0x0400


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"speed_per_volt": 0.0}, "speed_per_volt must be positive"),
        ({"zero_volts": 11.0}, "beyond what may be sent"),
        ({"servo_on": Line(0x100)}, "one bit of its word"),
        ({"alarm_reset": Line(0x01)}, "one bit of its word"),
        ({"turning": Line(0x02)}, "one bit of its word"),
        ({"inputs": ObjectRef(0x6000, 1, U8), "turning": Line(0x300)}, "one bit of its word"),
    ],
)
def test_a_description_that_cannot_be_is_refused(changed: dict[str, object], words: str) -> None:
    with pytest.raises(DriverError, match=words):
        replace(reference(bench()), **changed)  # type: ignore[arg-type]


def test_an_amplifier_whose_motor_nobody_counts_is_refused() -> None:
    made = bench()
    config = reference_config(made, MOTOR)
    port = wire_port(made, MOTOR, replace(config, counters=config.counters[1:]))
    with pytest.raises(DriverError, match="counts nothing"):
        port.open()


def test_a_bus_that_is_lost_is_raised_and_closing_never() -> None:
    made = bench()
    port = port_of(made)
    turned(port, [100])
    made.is_gone = True
    with pytest.raises(BusLostError):
        port.exchange(Command(Mode.SPEED, np.full(20, SPEED)), 20, Guard())
    port.close()


def test_close_leaves_the_motor_without_power() -> None:
    made = bench()
    port = port_of(made)
    turned(port, [300])
    port.close()
    assert not made.is_powered
    assert abs(made.input_speed) < 25 * RPM


def test_words_of_sixteen_contacts_are_read_whole() -> None:
    config = replace(
        reference(bench()),
        inputs=ObjectRef(0x6100, 1, U16),
        turning=Line(0x8000),
        reference=ObjectRef(0x6411, 2, I16),
    )
    assert config.turning is not None
    assert config.turning.is_active(0x8000)
    assert config.largest_count == 32767
    assert config.node_id == DRIVE_NODE
