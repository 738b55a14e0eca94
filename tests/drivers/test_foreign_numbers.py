"""Foreign drives' numbers, an EDS that contradicts them, and strangers on their bus."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.cia402.config import DriveConfig
from drivers.bus.dictionary.eds import parse_eds
from drivers.channel import INPUT_ANGLE
from drivers.clock import VirtualClock
from drivers.errors import DriverError, ReadbackError
from drivers.port import Mode
from tests.drivers.can_bench import servo
from tests.drivers.foreign_bench import LIMITS, RPM, bench
from tests.drivers.foreign_drive import ForeignDrive
from tests.drivers.foreign_slave import (
    BAD_VALUE,
    READ_ONLY,
    Stranger,
    Traits,
    Wire,
)

# Numbers ------------------------------------------------------------------------------------------


def test_ramps_in_increments_are_increments() -> None:
    with bench(Traits(values={(0x60AA, 0): 0x00B55700})) as made:
        made.open()
        assert made.drive.value(0x6083) == 5_215_189  # 1000 rad/s2 in 32768 increments per turn
        assert not any(event.code == "acceleration-unit" for event in made.events())


@pytest.mark.parametrize(
    ("values", "counts"),
    [
        ({}, 32768),
        ({(0x6092, 1): 1, (0x6092, 2): 1}, 32768),
        ({(0x6092, 1): 36000, (0x6092, 2): 1}, 36000),
        ({(0x6092, 1): 36000, (0x6092, 2): 1, (0x6091, 1): 10, (0x6091, 2): 1}, 3600),
        ({(0x608F, 2): 2}, 16384),
    ],
)
def test_counts_per_motor_revolution(values: dict[tuple[int, int], int], counts: float) -> None:
    with bench(Traits(values=values)) as made:
        made.rig.open()
        assert servo(made.rig.nodes).readings.counts_per_revolution == counts


@pytest.mark.parametrize(
    ("values", "slope", "warned"),
    [
        ({(0x6502, 0): 0xC, (0x6087, 0): 500}, 500.0, False),
        ({(0x6502, 0): 0xC, (0x6087, 0): 0}, 0.0, True),
        ({(0x6087, 0): 0}, None, False),
    ],
)
def test_the_slope_of_profile_torque_is_read(
    values: dict[tuple[int, int], int], slope: float | None, warned: bool
) -> None:
    with bench(Traits(values=values)) as made:
        made.rig.open()
        assert servo(made.rig.nodes).readings.settings.get("0x6087:0 torque slope") == slope
        assert any(event.code == "torque-slope" for event in made.events()) == warned


@pytest.mark.parametrize(
    ("values", "refused_writes", "cycle_ns", "found"),
    [
        ({}, {}, 1_000_000, (1, 0xFD)),
        ({}, {}, 500_000, (5, 0xFC)),
        ({}, {(0x60C2, 2): READ_ONLY}, 2_000_000, (2, 0xFD)),
        ({(0x60C2, 2): 0xFC}, {(0x60C2, 2): READ_ONLY}, 1_000_000, (10, 0xFC)),
        ({}, {(0x60C2, 1): BAD_VALUE}, 500_000, (1, 0xFD)),
        ({(0x60C2, 2): 0x7F}, {}, 1_000_000, (1, 0xFD)),
    ],
)
def test_the_interpolation_period_is_the_syncs_or_stays_whole(
    values: dict[tuple[int, int], int],
    refused_writes: dict[tuple[int, int], int],
    cycle_ns: int,
    found: tuple[int, int],
) -> None:
    from drivers.bus.cia402.settings import write_interpolation_time
    from drivers.bus.device import RemoteDevice
    from drivers.bus.network import PumpedBus

    wire = Wire(VirtualClock())
    drive = ForeignDrive(wire, Traits(values=values, refused=refused_writes))
    device = RemoteDevice(PumpedBus(wire, wire.clock, pump=wire.pump), 1)
    write_interpolation_time(device, cycle_ns)
    assert (drive.value(0x60C2, 1), drive.value(0x60C2, 2)) == found


@pytest.mark.parametrize(("configured", "per_mille"), [(0.637, 784), (0.3185, 784), (1.274, 392)])
def test_a_torque_limit_holds_by_the_configuration_and_by_the_drive(
    configured: float, per_mille: int
) -> None:
    """0x6076 says 637 mN m. Whichever rated torque is the right one, the drive never gives more than the limit."""
    with bench(
        Traits(values={(0x6076, 0): 637}), config=DriveConfig(rated_torque=configured)
    ) as made:
        made.rig.open()
        held = made.rig.write_limits(replace(LIMITS, torque=0.5)).torque
        assert made.drive.value(0x6072) == per_mille
        assert per_mille * 1e-3 * max(configured, 0.637) == pytest.approx(held)
        assert held <= 0.5
        assert any(event.code == "rated-torque" for event in made.events()) == (configured != 0.637)


def test_a_limit_that_the_drive_trims_is_not_taken_for_held() -> None:
    with bench(Traits(refused={(0x6080, 0): BAD_VALUE})) as made:
        made.rig.open()
        assert made.rig.write_limits(LIMITS).speed == np.inf
        assert 0x6080 in {m.index for m in made.rig.missing()[1]}


def test_an_eds_with_wrong_types_yields_to_the_device() -> None:
    rows = {0x6041: 7, 0x6064: 3, 0x6077: 9, 0x60FF: 6, 0x6060: 4, 0x6072: 7}
    entry = "[{:04X}]\nParameterName=x\nObjectType=7\nDataType={}\nAccessType=rw\n"
    text = "".join(entry.format(index, kind) for index, kind in rows.items())
    with bench(config=DriveConfig(description=parse_eds(text, 1))) as made:
        made.open()
        block = made.exchange(Mode.SPEED, -100 * RPM, 10)
        assert (block.broken, block.flags.any(), made.drive.speed) == (None, False, -100)
        names = [channel.name for channel in made.rig.channels]
        assert block.counts[-1, names.index(INPUT_ANGLE)] == -1000
        assert sum(event.code == "eds-type" for event in made.events()) == 3


def test_an_answer_without_bytes_names_its_object() -> None:
    with bench() as made:
        made.drive.od[0x6076, 0] = b""
        with pytest.raises(DriverError, match="node 1, 0x6076:0 motor rated torque: too few bytes"):
            made.rig.open()


# Strangers on the bus -----------------------------------------------------------------------------


class Neighbours(Stranger):
    """Frames that are not for this rig: 29-bit identifiers, remote and error frames, other nodes, old SDO answers."""

    turn = 0

    def receive(self, cob_id: int, data: bytes) -> None:
        feed = self.wire.feed
        if cob_id in (0x080, 0x601):
            self.turn += 1
            kind = self.turn % 9
            if kind == 0:
                feed(0x181, b"\1\2\3\4\5\6\7\x08", is_extended_id=True)
            elif kind == 1:
                feed(0x181, b"", is_remote_frame=True)
            elif kind == 2:
                feed(0x20000004, bytes(8), is_error_frame=True, is_extended_id=True)
            elif kind == 3:
                feed(0x0A5, bytes([0x10, 0x43, 8, 0, 0, 0, 0, 0]))
            elif kind == 4:
                feed(0x6E5, b"\1\2")
                feed(0x7E4, bytes(8))
            elif kind == 5:
                feed(0x70A, b"\0")
            elif kind == 6:
                feed(0x581, b"\x4b\x11\x20\0\0\0\0\0")
            elif kind == 7:
                feed(0x701, b"", is_remote_frame=True)
                feed(0x77F, b"\5")
            else:
                feed(0x000, b"\1\x0a")
                feed(0x581, b"\x80\x11\x20\0\0\0\2\6")


def test_strangers_on_the_bus_change_nothing() -> None:
    with bench() as made:
        Neighbours(made.wire)
        made.open()
        block = made.exchange(Mode.SPEED, 100 * RPM, 100)
        assert (block.broken, block.flags.any(), made.drive.speed) == (None, False, 100)
        assert {e.level for e in made.events() if e.source == "node 37"} == {"warning"}
        made.drive.emergency(0x4310)
        broken = made.exchange(Mode.SPEED, 100 * RPM, 100).broken
        assert broken is not None
        assert broken.cause == "emcy"


def test_a_readback_that_differs_is_refused() -> None:
    with bench() as made:
        made.rig.open()
        write = made.drive.write
        made.drive.write = lambda key, data: write(key, b"\1\0" if key == (0x6072, 0) else data)  # type: ignore[method-assign]
        with pytest.raises(ReadbackError, match="0x6072:0"):
            made.rig.write_limits(LIMITS)
