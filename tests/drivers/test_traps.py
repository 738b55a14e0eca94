"""Drives that differ from the textbook, as their documents and their users' code have it: units, limits, process data.

Each test is one line of the table in docs/reference/device-traps.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.cia301 import I16, U32, ObjectRef
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.dictionary.eds import parse_eds
from drivers.bus.motor_encoder import MotorEncoder
from drivers.channel import DRIVE_TORQUE, INPUT_ANGLE, TARGET_SPEED, Calibration
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Command, Guard, Mode
from tests.drivers.foreign_bench import LIMITS, RPM, bench
from tests.drivers.foreign_drive import ForeignDrive
from tests.drivers.foreign_slave import READ_ONLY, Rows, Traits, Wire

CYCLE = 1e-3


# Units --------------------------------------------------------------------------------------------


class Shaft(ForeignDrive):
    """A drive whose shaft really turns by what its own unit says: `unit` rad/s per count of 0x60FF; its
    torque is read in `torque_place`.
    """

    def __init__(
        self,
        wire: Wire,
        traits: Traits,
        *,
        unit: float,
        counts: int,
        torque_place: tuple[int, int] = (0x6077, 0),
        raw_torque: int = 0,
    ) -> None:
        self.counts_per_raw = unit * CYCLE * counts / (2 * math.pi)
        self.torque_place, self.raw_torque, self.angle = torque_place, raw_torque, 0.0
        super().__init__(wire, traits)

    def _factory(self) -> dict[tuple[int, int], bytes]:
        return {self.torque_place: b"\0\0"} | super()._factory()

    def live(self) -> Rows:
        return super().live() | {self.torque_place: (self.raw_torque, 2)}

    def on_sync(self) -> None:
        before = self.position
        super().on_sync()
        self.angle += (self.position - before) * self.counts_per_raw
        self.position = round(self.angle)


def technosoft(counts: int, sample: float) -> tuple[float, float]:
    """Counts per control sample in 16.16 fixed point, and per sample squared."""
    return 2 * math.pi / counts / (65536 * sample), 2 * math.pi / counts / (65536 * sample**2)


def copley(counts: int) -> tuple[float, float]:
    """0.1 counts/s, and 10 counts/s2."""
    return 0.1 * 2 * math.pi / counts, 10 * 2 * math.pi / counts


def kinco(counts: int) -> tuple[float, float]:
    """raw = rpm * 512 * counts / 1875."""
    return RPM * 1875 / (512 * counts), RPM


UNITS: Mapping[str, tuple[int, tuple[float, float], int, int]] = {
    # counts per revolution, (speed, acceleration) of one count, and what 100 r/min and 1000 rad/s2 are then
    "Technosoft iPOS, 1 ms": (2000, technosoft(2000, 1e-3), 218_453, 20_860),
    "Copley Accelnet": (8192, copley(8192), 136_533, 130_379),
    "Kinco FD5": (10_000, kinco(10_000), 273_067, 9549),
    "Elmo Gold, counts": (8192, (2 * math.pi / 8192, 2 * math.pi / 8192), 13_653, 1_303_797),
    "EPOS4, 0.001 r/min": (8192, (1e-3 * RPM, RPM), 100_000, 9549),
}


@pytest.mark.parametrize("name", UNITS)
def test_a_makers_own_unit_of_speed_goes_round(name: str) -> None:
    """Speed in rad/s -> the drive's counts -> its shaft -> counts of 0x6064 -> rad: the speed that was asked for."""
    counts, (speed_unit, acceleration_unit), raw, ramp = UNITS[name]
    wire = Wire(VirtualClock())
    drive = Shaft(
        wire, Traits(absent=frozenset({0x60A9, 0x60AA, 0x608F})), unit=speed_unit, counts=counts
    )
    config = CanRigConfig(
        drive=DriveConfig(
            velocity_unit=speed_unit, acceleration_unit=acceleration_unit, rated_torque=0.637
        ),
        motor_encoder=MotorEncoder(lines=counts // 4, multiplication=4, largest_speed=900.0),
    )
    rig = CanRig(config, wire.clock, lambda: wire, pump=wire.pump, origin="simulated")
    rig.open()
    rig.write_limits(LIMITS)
    assert drive.value(0x6083) == ramp
    block = rig.exchange(Command(Mode.SPEED, np.full(101, 100 * RPM)), 101, Guard())
    assert drive.speed == raw
    names = [channel.name for channel in rig.channels]
    angle = rig.channels[names.index(INPUT_ANGLE)].to_si(block.counts[:, names.index(INPUT_ANGLE)])
    turned = (angle[-1] - angle[0]) / (100 * CYCLE)
    assert turned == pytest.approx(100 * RPM, abs=2 * math.pi / counts / (100 * CYCLE))
    target = rig.channels[names.index(TARGET_SPEED)].to_si(
        block.counts[:, names.index(TARGET_SPEED)]
    )
    assert target == pytest.approx(np.full(101, 100 * RPM), rel=1e-4)
    rig.close()


@pytest.mark.parametrize(
    ("absent", "place", "unit", "raw", "torque"),
    [
        # Technosoft: I = raw * 2 * peak / 65520, times the torque constant: 20 A, 0.05 N m/A.
        ({0x6076}, (0x6077, 0), 2 * 20 * 0.05 / 65520, 16_380, 0.5),
        # Kinco: 0.1 % of the rated torque in an object of its own.
        ({0x6077}, (0x6078, 0), None, -500, -0.3185),
    ],
)
def test_torque_in_a_makers_own_unit_or_object(
    absent: set[int], place: tuple[int, int], unit: float | None, raw: int, torque: float
) -> None:
    wire = Wire(VirtualClock())
    Shaft(
        wire,
        Traits(absent=frozenset(absent)),
        unit=RPM,
        counts=32768,
        torque_place=place,
        raw_torque=raw,
    )
    config = CanRigConfig(
        drive=DriveConfig(
            rated_torque=0.637,
            torque_unit=unit,
            actual_torque=ObjectRef(*place, I16, "torque"),
            torque_calibration=Calibration(sensor="T-12"),
        ),
        motor_encoder=MotorEncoder(lines=8192, multiplication=4, largest_speed=900.0),
    )
    rig = CanRig(config, wire.clock, lambda: wire, pump=wire.pump, origin="simulated")
    rig.open()
    block = rig.exchange(Command(Mode.OFF), 4, Guard())
    names = [channel.name for channel in rig.channels]
    column = names.index(DRIVE_TORQUE)
    assert rig.channels[column].to_si(block.counts[:, column]) == pytest.approx(
        np.full(4, torque), rel=1e-6
    )
    assert rig.channels[column].calibration.sensor == "T-12"
    rig.close()


def test_without_0x6077_there_is_no_cross_check_and_the_rest_runs() -> None:
    with bench(Traits(absent=frozenset({0x6077}))) as made:
        made.open()
        assert DRIVE_TORQUE not in [channel.name for channel in made.rig.channels]
        assert made.exchange(Mode.SPEED, 100 * RPM).broken is None
        assert 0x6077 in {m.index for m in made.rig.missing()[1]}


@pytest.mark.parametrize(
    ("traits", "modes", "told"),
    [
        (Traits(), (9, 3), "CYCLIC_VELOCITY"),
        (Traits(values={(0x6502, 0): 0x65}), (9, 3), "PROFILE_VELOCITY"),
        (Traits(absent=frozenset({0x6502})), (9, 3), "CYCLIC_VELOCITY or PROFILE_VELOCITY"),
        (Traits(values={(0x6502, 0): 0x43}), (9, 3), "none"),
    ],
)
def test_the_run_file_says_whether_the_drives_ramps_can_shape_a_step(
    traits: Traits, modes: tuple[int, ...], told: str
) -> None:
    """Technosoft IDM has 0x65 (PP PV HM IP), Pilz PRBT 0x43 (PP VL IP): no speed mode at all."""
    with bench(traits, DriveConfig(speed_modes=modes)) as made:
        described = made.rig.open().devices["servo amplifier"]
        assert described["speed_mode"] == told
        if told == "none":
            with pytest.raises(DriverError, match="no set-points for cyclic velocity"):
                made.exchange(Mode.SPEED, 1.0)


# Limits -------------------------------------------------------------------------------------------


def test_torque_is_limited_by_the_object_that_the_description_names() -> None:
    """EPOS4: no 0x6072, but an output current limit in mA; 0.0711 N m/A."""
    limit = DriveConfig(torque_limit=ObjectRef(0x3001, 2, U32), torque_limit_unit=0.0711e-3)
    traits = Traits(values={(0x3001, 2): 20_000}, absent=frozenset({0x6072}))
    with bench(traits, limit) as made:
        made.rig.open()
        held = made.rig.write_limits(LIMITS)
        assert made.drive.value(0x3001, 2) == 7032
        assert held.torque == pytest.approx(7032 * 0.0711e-3)
        assert held.torque <= LIMITS.torque
    with bench(traits) as made:
        made.rig.open()
        assert made.rig.write_limits(LIMITS).torque == math.inf
        assert made.drive.value(0x3001, 2) == 20_000


def test_without_0x6084_one_ramp_holds_both_if_they_are_the_same() -> None:
    with bench(Traits(absent=frozenset({0x6084}))) as made:
        made.rig.open()
        held = made.rig.write_limits(LIMITS)
        assert held.deceleration == held.acceleration == pytest.approx(1000.0, rel=1e-3)
        steeper = replace(LIMITS, deceleration=1500.0)
        assert made.rig.write_limits(steeper).deceleration == math.inf


@pytest.mark.parametrize(
    ("traits", "reasons"),
    [
        (Traits(), []),
        (Traits(absent=frozenset({0x1016})), ["0x1016"]),
        (Traits(absent=frozenset({0x6007})), ["0x6007 = 3"]),
        (Traits(refused={(0x6007, 0): READ_ONLY}), ["0x6007 = 3"]),
        (Traits(absent=frozenset({0x1016, 0x6007})), ["0x1016", "0x6007 = 3"]),
    ],
)
def test_a_drive_that_would_not_stop_without_the_computer_says_why(
    traits: Traits, reasons: list[str]
) -> None:
    with bench(traits) as made:
        made.open()
        told = made.rig.abilities.unwatched
        assert told is not None
        unwatched = told()
        assert len(unwatched) == len(reasons)
        assert all(reason in said for reason, said in zip(reasons, unwatched, strict=True))


# Process data -------------------------------------------------------------------------------------


@pytest.mark.parametrize("most", [2, 3, 4])
def test_a_pdo_that_takes_few_objects_leaves_the_others_to_the_next(most: int) -> None:
    with bench(Traits(most_objects=most)) as made:
        made.open()
        block = made.exchange(Mode.SPEED, 100 * RPM, 10)
        assert (block.broken, block.flags.any(), made.drive.speed) == (None, False, 100)
        assert DRIVE_TORQUE in [channel.name for channel in made.rig.channels]
        assert all(len(pdo.entries) <= most for pdo in made.rig.nodes.layout.pdos)


def test_a_default_inhibit_time_is_taken_away_while_the_pdo_does_not_exist() -> None:
    """iPOS has 30 ms, WAGO and EPOS4 less; the foreign slave refuses the write while the PDO exists."""
    with bench(Traits(values={(0x1800 + n, 3): 300 for n in range(4)})) as made:
        made.open()
        used = [pdo.number for pdo in made.rig.nodes.layout.pdos]
        assert used
        assert [made.drive.value(0x1800 + n - 1, 3) for n in used] == [0] * len(used)
        assert not made.exchange(Mode.OFF, cycles=20).flags.any()


def test_cob_ids_with_bits_30_and_31_are_read_changed_and_written() -> None:
    """EPOS4: TPDO1 0x40000180 + node, the others 0xC0000280.. + node, RPDO 2 to 4 0x80000300.. + node."""
    values = {(0x1400 + n, 1): 0x8000_0201 + 0x100 * n for n in (1, 2, 3)}
    cobs = (0x40000181, 0xC0000281, 0xC0000381, 0xC0000481)
    with bench(Traits(tpdo_cobs=cobs, values=values, most_objects=2)) as made:
        made.open()
        assert made.exchange(Mode.SPEED, 100 * RPM, 10).broken is None
        assert made.drive.value(0x1800, 1) == 0x40000181
        assert made.drive.value(0x1801, 1) == 0x40000281
        assert made.drive.value(0x1802, 1) >> 30 == 3
        assert made.drive.value(0x1401, 1) == 0x301


# Device files -------------------------------------------------------------------------------------


def test_a_limit_of_a_device_file_refuses_no_write() -> None:
    """Elmo: HighLimit 65535 of 0x1016, into which node << 16 belongs; a ramp that the file would not have."""
    entry = "[{}]\nParameterName=x\nObjectType=7\nDataType=0x0007\nAccessType=rw\nLowLimit=0\nHighLimit={}\n"
    text = entry.format("1016sub1", 65535) + entry.format("6083", 10)
    with bench(config=DriveConfig(description=parse_eds(text, 1))) as made:
        made.open()
        assert made.drive.value(0x1016, 1) == 127 << 16 | 250
        assert made.drive.value(0x6083) == 9549
        assert made.rig.nodes.drive.unwatched == ()
