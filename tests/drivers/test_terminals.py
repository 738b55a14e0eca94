"""Terminals behind couplers: a counter in two bytes of a six-byte object, an analogue word with status in its lowest
bits.
"""

from __future__ import annotations

import numpy as np
import pytest

from drivers.bus.cia301 import I16, U8, U16, ObjectRef, Part
from drivers.bus.cia401 import AnalogInput, AnalogModuleConfig, torque_input
from drivers.bus.cia406 import CounterConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.rig_nodes import GuardContact
from drivers.channel import (
    GUARD_CLOSED,
    INDEX_SEEN,
    INPUT_ANGLE,
    OUTPUT_ANGLE,
    OUTPUT_INDEX,
    TORQUE,
)
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.samples import CycleFlag
from rig.bench.config.objects import read_object
from tests.drivers.foreign_drive import ForeignCounter, ForeignDrive, ForeignInputs
from tests.drivers.foreign_slave import Rows, Wire
from tests.drivers.test_foreign_rig import counts, off, rig_of

KL5111 = (0x2C00, 1)
"""Byte 0 status, 1-2 counter, 3 period, 4-5 latch, Intel order (Beckhoff KL5111 p.13)."""
LATCHED = 0x01
COUNT = read_object("0x2C00:1 U16 at byte 1 of 6", "position value")
LATCH = read_object("0x2C00:1 U16 at byte 4 of 6", "index position")
STATUS = read_object("0x2C00:1 U8 at byte 0 of 6", "index marks seen")


class Terminal(ForeignCounter):
    """An encoder terminal: six bytes in one object; a mark is latched when the count passes a multiple of 1000."""

    latch = 0
    period = 0xA5

    def live(self) -> Rows:
        word = (
            (LATCHED if self.latch else 0)
            | (self.count % (1 << 16)) << 8
            | self.period << 24
            | (self.latch % (1 << 16)) << 32
        )
        return {self.place: (word, 6)}

    def on_sync(self) -> None:
        before = self.count
        super().on_sync()
        if before // 1000 != self.count // 1000:
            self.latch = max(before, self.count) // 1000 * 1000


def terminal(step: int, start: int) -> Wire:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    Terminal(wire, step=step, start=start, place=KL5111, size=6, modulus=1 << 48)
    return wire


@pytest.mark.parametrize(("step", "start"), [(7, 65_520), (-7, 10), (300, 64_900)])
def test_two_bytes_of_six_are_a_counter_that_wraps_at_16_bits(step: int, start: int) -> None:
    with rig_of(
        terminal(step, start), CounterConfig(node_id=2, position=COUNT, alarms=None)
    ) as rig:
        rig.open()
        block = off(rig, 8)
        assert not block.flags.any()
        assert np.diff(counts(rig, block, OUTPUT_ANGLE)).tolist() == [step] * 7
        (channel,) = [c for c in rig.channels if c.name == OUTPUT_ANGLE]
        assert channel.modulus == 1 << 16


def test_its_latch_and_status_lie_in_the_same_object() -> None:
    config = CounterConfig(
        node_id=2,
        position=COUNT,
        alarms=None,
        index_position=LATCH,
        index_status=STATUS,
        index_mask=LATCHED,
    )
    with rig_of(terminal(7, 65_980), config) as rig:
        rig.open()
        block = off(rig, 8)
        angle, mark = counts(rig, block, OUTPUT_ANGLE), counts(rig, block, OUTPUT_INDEX)
        seen = counts(rig, block, INDEX_SEEN)
        first = seen.index(2)
        assert mark[:first] == [0] * first
        # The mark at 66 000 lies where the shaft has passed it, whatever the wrap of the count.
        assert {mark[k] - angle[k] for k in range(first, 8)} == {
            66_000 - (65_980 + 7 * (k + 1)) for k in range(first, 8)
        }
        assert len([p for p in rig.nodes.layout.pdos if p.node_id == 2]) == 1


def test_a_shaft_that_can_pass_half_the_range_within_a_cycle_is_refused() -> None:
    config = CounterConfig(
        node_id=2, position=COUNT, alarms=None, lines=18_000, multiplication=4000
    )
    with (
        rig_of(terminal(1, 0), config) as rig,
        pytest.raises(
            DriverError,
            match=r"0x2C00:1 UNSIGNED16 at byte 1 position value: the shaft can turn half .*allowed < 32768 of 65536",
        ),
    ):
        rig.open()


@pytest.mark.parametrize(
    ("raw", "volts", "saturated"),
    [
        (0x4000, 5.0, False),
        (0xC000, -5.0, False),
        (0x0008, 8 * 10 / 32768, False),
        (0x7FF8, 9.99756, True),
        (0x7FF9, 9.99756, True),
        (0x8001, -10.0, True),
        (0x4001, 5.0, True),
    ],
)
def test_status_in_the_lowest_bits_is_a_flag_and_no_part_of_the_value(
    raw: int, volts: float, saturated: bool
) -> None:
    """WAGO 750-456: 0x8000 to 0x7FF8 is -10 to +10 V, 0x7FF9 over range, 0x8001 under range."""
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignInputs(wire, raw=raw)
    port = torque_input(1.0, volts_per_count=10 / 32768, full_scale=10.0, status_bits=3)
    with rig_of(wire, module=AnalogModuleConfig(3, (port,))) as rig:
        rig.open()
        block = off(rig)
        (channel,) = [c for c in rig.channels if c.name == TORQUE]
        assert channel.to_si(np.array(counts(rig, block, TORQUE))) == pytest.approx(volts, abs=1e-4)
        assert bool((block.flags & CycleFlag.SATURATED).all()) == saturated
        assert bool((block.flags & CycleFlag.SATURATED).any()) == saturated


def test_an_input_may_lie_in_bytes_of_an_object_too() -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignInputs(wire, place=(0x2400, 1), size=4, raw=0x4000_0055)
    source = ObjectRef(0x2400, 1, read_object("0x2400:1 U32").data_type, "", Part(2, I16))
    port = AnalogInput(
        channel=TORQUE, unit="N m", source=source, volts_per_count=1e-4, unit_per_volt=1.0
    )
    with rig_of(wire, module=AnalogModuleConfig(3, (port,))) as rig:
        rig.open()
        assert set(counts(rig, off(rig), TORQUE)) == {0x4000}


class Coupler(Terminal):
    """Two encoder terminals and an analogue one behind one coupler; its digital inputs carry the guard."""

    def _factory(self) -> dict[tuple[int, int], bytes]:
        more = {(0x2C00, 2): bytes(6), (0x6401, 1): (1000).to_bytes(2, "little")}
        return super()._factory() | more | {(0x6000, 1): b"\4", (0x1000, 0): b"\x91\1\5\0"}

    def live(self) -> Rows:
        return super().live() | {(0x2C00, 2): ((3 * self.count % (1 << 16)) << 8, 6)}


def test_one_coupler_holds_counters_and_inputs() -> None:
    wire = Wire(VirtualClock())
    drive = ForeignDrive(wire)
    Coupler(wire, step=7, start=65_520, place=KL5111, size=6, modulus=1 << 48)
    second = read_object("0x2C00:2 U16 at byte 1 of 6")
    config = CanRigConfig(
        motor_encoder=MotorEncoder(lines=8192, multiplication=4, largest_speed=900.0),
        counters=(
            CounterConfig(node_id=2, position=COUNT, alarms=None),
            CounterConfig(node_id=2, position=second, alarms=None, channel=INPUT_ANGLE),
        ),
        modules=(AnalogModuleConfig(2, (torque_input(1.0, volts_per_count=1e-3),)),),
        guard=GuardContact(2, ObjectRef(0x6000, 1, U8), 4, 4),
    )
    rig = CanRig(
        config, wire.clock, lambda: wire, pump=wire.pump, time_base="virtual", origin="simulated"
    )
    rig.open()
    assert list(rig.nodes.identities) == [
        "servo amplifier",
        "counter output_angle and counter input_angle and analog module 2",
    ]
    assert [device.node_id for device in rig.nodes.devices] == [1, 2]
    block = off(rig, 8)
    assert not block.flags.any()
    assert np.diff(counts(rig, block, OUTPUT_ANGLE)).tolist() == [7] * 7
    assert np.diff(counts(rig, block, INPUT_ANGLE)).tolist() == [21] * 7
    assert set(counts(rig, block, TORQUE)) == {1000}
    assert set(counts(rig, block, GUARD_CLOSED)) == {1}
    rig.close()
    assert not drive.is_powered


@pytest.mark.parametrize("nodes", [(1, 3), (2, 2)])
def test_encoders_and_the_drive_share_no_node(nodes: tuple[int, int]) -> None:
    wire = Wire(VirtualClock())
    config = CanRigConfig(
        motor_encoder=MotorEncoder(largest_speed=900.0),
        counters=(CounterConfig(node_id=nodes[0]),),
        modules=(AnalogModuleConfig(nodes[1], (torque_input(1.0),)),),
    )
    rig = CanRig(config, wire.clock, lambda: wire, pump=wire.pump)
    with pytest.raises(DriverError, match="a node-ID of its own"):
        rig.open()


@pytest.mark.parametrize("bits", [-1, 16])
def test_no_more_bits_are_status_than_the_word_has(bits: int) -> None:
    with pytest.raises(DriverError, match="so many bits"):
        torque_input(1.0, status_bits=bits)


def test_bytes_of_an_object_are_written_as_people_say_it() -> None:
    assert (COUNT.key, COUNT.part) == ((0x2C00, 1), Part(1, U16))
    assert (COUNT.data_type.size, COUNT.mapping) == (6, 0x2C000130)
    assert STATUS.value_type is U8
    with pytest.raises(ValueError, match="ends behind its 6 bytes"):
        read_object("0x2C00:1 U32 at byte 3 of 6")
    with pytest.raises(ValueError, match="U16 at byte 1 of 6"):
        read_object("0x2C00:1 U16 at 1")
