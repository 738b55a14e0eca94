"""A whole rig of foreign slaves: counters and analogue inputs in the shapes that CiA 406 and CiA 401 allow."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator

import numpy as np
import pytest

from drivers.bus.cia301 import I16, I32, REAL32, U16, U32, ObjectRef
from drivers.bus.cia401 import AnalogModuleConfig, torque_input
from drivers.bus.cia406 import CounterConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.channel import INPUT_ANGLE, OUTPUT_ANGLE, STATUSWORD, TORQUE
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Ask, Command, Guard, Mode, Reach, Request
from drivers.samples import CycleFlag, SampleBlock
from tests.drivers.foreign_drive import ForeignCounter, ForeignDrive, ForeignInputs
from tests.drivers.foreign_slave import READ_ONLY, Traits, Wire

FIXED = Traits(mapping="read-only", tpdo_maps=((0x60040020,), (), (), ()), tpdo_type=254)
COUNT = ObjectRef(0x6004, 0, U32)


@contextlib.contextmanager
def rig_of(
    wire: Wire, counter: CounterConfig | None = None, module: AnalogModuleConfig | None = None
) -> Iterator[CanRig]:
    config = CanRigConfig(
        motor_encoder=MotorEncoder(lines=8192, multiplication=4, largest_speed=900.0),
        counters=(counter,) if counter else (),
        modules=(module,) if module else (),
    )
    rig = CanRig(
        config, wire.clock, lambda: wire, pump=wire.pump, time_base="virtual", origin="simulated"
    )
    yield rig
    rig.close()


def counts(rig: CanRig, block: SampleBlock, name: str) -> list[int]:
    return block.counts[:, [c.name for c in rig.channels].index(name)].tolist()


def off(rig: CanRig, cycles: int = 6) -> SampleBlock:
    return rig.exchange(Command(Mode.OFF), cycles, Guard())


@pytest.mark.parametrize(
    ("traits", "position", "place", "size", "modulus", "start", "step"),
    [
        (Traits(), COUNT, (0x6004, 0), 4, 720_000, 719_990, 7),
        (Traits(), COUNT, (0x6004, 0), 4, 720_000, 3, -7),
        (FIXED, COUNT, (0x6004, 0), 4, 720_000, 0, 100),
        (Traits(unsized=True), COUNT, (0x6004, 0), 4, 720_000, 0, 5),
        (
            Traits(absent=frozenset({0x6503, 0x6002, 0x6000, 0x6001, 0x6501})),
            COUNT,
            (0x6004, 0),
            4,
            1 << 32,
            2**32 - 9,
            7,
        ),
        (Traits(), ObjectRef(0x6004, 0, I32), (0x6004, 0), 4, 1 << 32, 5, -7),
        (Traits(), ObjectRef(0x6401, 1, U16), (0x6401, 1), 2, 1 << 16, 65_530, 7),
        (Traits(), ObjectRef(0x6401, 1, I16), (0x6401, 1), 2, 1 << 16, 32_760, 7),
        (Traits(nmt=4, tpdo_cobs=(0x80000000,) * 4), COUNT, (0x6004, 0), 4, 720_000, 0, 1),
    ],
)
def test_counters_of_every_kind_count_on(
    traits: Traits,
    position: ObjectRef,
    place: tuple[int, int],
    size: int,
    modulus: int,
    start: int,
    step: int,
) -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignCounter(wire, traits, step=step, start=start, place=place, size=size, modulus=modulus)
    with rig_of(
        wire,
        CounterConfig(node_id=2, position=position, modulus=0 if position is COUNT else modulus),
    ) as rig:
        rig.open()
        block = off(rig, 8)
        assert not block.flags.any()
        assert np.diff(counts(rig, block, OUTPUT_ANGLE)).tolist() == [step] * 7


def test_a_count_that_lies_within_other_fixed_data_is_found() -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    traits = Traits(
        mapping="read-only", tpdo_maps=((), (0x65030010, 0x60040020), (), ()), tpdo_type=1
    )
    ForeignCounter(wire, traits, step=3)
    with rig_of(wire, CounterConfig(node_id=2)) as rig:
        rig.open()
        assert np.diff(counts(rig, off(rig), OUTPUT_ANGLE)).tolist() == [3] * 5


@pytest.mark.parametrize(
    ("operating", "turns", "warned"), [(0, 10, False), (0, 7, True), (4, 7, False)]
)
def test_a_range_that_may_not_be_in_force_is_told(operating: int, turns: int, warned: bool) -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignCounter(wire, Traits(values={(0x6000, 0): operating, (0x6502, 0): turns}))
    with rig_of(wire, CounterConfig(node_id=2)) as rig:
        rig.open()
        assert any(event.code == "range" for event in rig.events()) == warned


@pytest.mark.parametrize(
    ("traits", "words"),
    [
        (
            Traits(absent=frozenset({0x6004})),
            r"0x6004:0 position value: the counter's position object does not exist",
        ),
        (
            Traits(mapping="read-only", tpdo_maps=((0x65030010,), (), (), ())),
            "transferred by PDO; value 0x6004:0",
        ),
        (
            Traits(tpdo_type=254, refused={(0x1800 + n, 2): READ_ONLY for n in range(4)}),
            "0x1800:2: a TPDO cannot be tied to every",
        ),
        (
            Traits(tpdo_cobs=(0x40000181, 0x40000282, 0x40000382, 0x40000482)),
            r"share a COB-ID.*node 1 TPDO1.*node 2 TPDO1",
        ),
    ],
)
def test_a_counter_that_cannot_be_used_is_named(traits: Traits, words: str) -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignCounter(wire, traits)
    with rig_of(wire, CounterConfig(node_id=2)) as rig, pytest.raises(DriverError, match=words):
        rig.open()


@pytest.mark.parametrize(
    ("place", "kind", "raw", "scale", "traits", "volts"),
    [
        ((0x6401, 1), I16, -3200, 0.3125e-3, Traits(), -1.0),
        ((0x6401, 2), I16, 3200, 0.3125e-3, Traits(unsized=True), 1.0),
        ((0x6402, 1), I32, -100_000, 1e-5, Traits(segmented=True), -1.0),
        ((0x6403, 1), REAL32, struct.unpack("<I", struct.pack("<f", 2.5))[0], 1e-4, Traits(), 2.5),
        ((0x6404, 3), I16, 3200, 0.3125e-3, Traits(absent=frozenset({0x6423, 0x1017})), 1.0),
        (
            (0x6401, 1),
            I16,
            3200,
            0.3125e-3,
            Traits(mapping="read-only", tpdo_maps=((), (0x64010110,), (), ())),
            1.0,
        ),
    ],
)
def test_analogue_inputs_of_every_kind_are_volts(
    place: tuple[int, int], kind: object, raw: int, scale: float, traits: Traits, volts: float
) -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignInputs(wire, traits, place=place, size=kind.size, raw=raw & (1 << 8 * kind.size) - 1)  # type: ignore[attr-defined]
    port = torque_input(
        0.637, index=place[0], subindex=place[1], data_type=kind, volts_per_count=scale
    )  # type: ignore[arg-type]
    with rig_of(wire, module=AnalogModuleConfig(3, (port,))) as rig:
        rig.open()
        block = off(rig)
        assert not (block.flags & ~np.uint16(CycleFlag.HOST_TIME)).any()
        channel = next(c for c in rig.channels if c.name == TORQUE)
        assert channel.to_si(np.array(counts(rig, block, TORQUE))) == pytest.approx(
            volts * 0.637, rel=1e-3
        )


@pytest.mark.parametrize(
    ("traits", "words"),
    [
        (
            Traits(absent=frozenset({0x6401})),
            "0x6401:1 torque monitor: the analog input does not exist",
        ),
        (Traits(mapping="read-only"), "cannot be transferred by PDO; value 0x6401:1"),
    ],
)
def test_an_input_that_cannot_be_used_is_named(traits: Traits, words: str) -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    ForeignInputs(wire, traits)
    with (
        rig_of(wire, module=AnalogModuleConfig(3, (torque_input(0.637),))) as rig,
        pytest.raises(DriverError, match=words),
    ):
        rig.open()


@pytest.mark.parametrize("traits", [Traits(segmented=True), Traits(unsized=True, answer_ms=7.0)])
def test_whoever_answers_in_his_own_way_is_asked_between_two_cycles(traits: Traits) -> None:
    wire = Wire(VirtualClock())
    drive = ForeignDrive(wire, traits)
    ForeignCounter(wire, traits, step=3)
    with rig_of(wire, CounterConfig(node_id=2)) as rig:
        rig.open()
        off(rig, 5)
        drive.nmt = 0x7F
        block = off(rig, 5)
        assert rig.line is not None
        assert rig.line.reach(STATUSWORD) is Reach.SDO
        asked = [Request(Ask.READ, name) for name in (STATUSWORD, INPUT_ANGLE, OUTPUT_ANGLE)]
        rig.line.hand([Request(Ask.SERVO_OFF, STATUSWORD), *asked])
        off(rig, 60)
        found = {answer.request: answer.count for answer in rig.line.answers()}
        assert found[asked[0]] == 0x0250
        assert found[asked[1]] == drive.position
        assert found[asked[2]] is not None
        assert not (block.flags & CycleFlag.STALE_OUTPUT).any()
