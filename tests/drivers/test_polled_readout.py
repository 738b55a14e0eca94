"""The ND 287 as a source: its latest value in every cycle with a stamp of its own, and nothing of it delays a cycle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.bus.cyclic import CanRig
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Command, Guard, Mode
from drivers.readout.nd287 import ReadoutConfig
from drivers.readout.polled import PolledReadout
from drivers.samples import CycleFlag
from drivers.source import Reading
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.simulated import wire_port
from rig.testing.source import check_source
from sim_backend.wire.bench import WireBench

CYCLE_NS = 1_000_000
LINE = b"+   1.50000 G=A\r\n"
CONFIG = ReadoutConfig(url="scripted", answer_ms=50.0)


class Port:
    """A serial port that answers what it is told to; `bytes_a_read` come at once."""

    def __init__(self, *answers: bytes) -> None:
        self.answers = list(answers)
        self.waiting = b""
        self.asked = 0
        self.is_gone = False
        self.bytes_a_read = 100

    def write(self, b: bytes, /) -> int:
        if self.is_gone:
            raise OSError("gone")
        self.asked += b == b"\x02"
        if b.startswith(b"\x1b"):
            self.waiting += b"\x02ND-287\r\n"
        elif self.answers:
            self.waiting += self.answers.pop(0)
        return len(b)

    def read(self, size: int = 1, /) -> bytes:
        size = min(size, self.bytes_a_read)
        taken, self.waiting = self.waiting[:size], self.waiting[size:]
        return taken

    def reset_input_buffer(self) -> None:
        self.waiting = b""

    def close(self) -> None:
        self.is_gone = True


def source(port: Port) -> tuple[PolledReadout, VirtualClock]:
    clock = VirtualClock()
    made = PolledReadout(CONFIG, clock, lambda: port)
    made.open(CYCLE_NS)
    return made, clock


def test_a_value_comes_in_pieces_and_stands_until_the_next() -> None:
    port = Port(LINE, LINE, b"-   0.25000 G=A\r\n", b"")
    made, clock = source(port)
    angle, taken = made.channels
    assert (angle.acquired, taken.name) == ("polled", "readout_angle_taken")
    port.bytes_a_read = 9
    begun = clock.monotonic_ns()
    rows = []
    for cycle in range(6):
        made.request(cycle)
        rows.append(made.collect(cycle, 0))
        clock.advance_ns(CYCLE_NS)
    assert rows[0] is None
    degrees = [math.degrees(row.counts[0] * angle.scale) for row in rows[1:] if row is not None]
    assert degrees == pytest.approx([1.5, 1.5, -0.25, -0.25, -0.25])
    assert rows[1] is not None
    assert rows[1].counts[1] == 500_000 - CYCLE_NS, (
        "half the storage delay after the question, a cycle ago"
    )
    assert clock.monotonic_ns() - begun == 6 * CYCLE_NS, "nobody waited"


def test_it_keeps_what_every_source_keeps() -> None:
    check_source(lambda clock: PolledReadout(CONFIG, clock, lambda: Port(LINE, LINE, b"x" * 17)))


def test_silence_garbage_a_fault_and_a_lost_line_are_told() -> None:
    port = Port(LINE, b"", b"x" * 17, b"            ??A\r\n", LINE)
    made, clock = source(port)
    codes, flags = [], []
    for cycle in range(200):
        if cycle == 110:
            port.is_gone = True
        made.request(cycle)
        reading = made.collect(cycle, 0)
        flags.append(0 if reading is None else reading.flags)
        codes += [event.code for event in made.events()]
        clock.advance_ns(CYCLE_NS)
    assert codes == ["source-silent", "source-garbage", "source-silent", "source-lost"]
    assert CycleFlag.SIGNAL_ERROR in flags, "the readout says itself that its value is none"


def test_what_shows_no_angle_is_refused() -> None:
    with pytest.raises(DriverError, match="shows no angle"):
        source(Port(b"+   1.50000  =A\r\n"))


def test_beside_the_rig_it_follows_the_output_and_marks_nothing() -> None:
    bench = WireBench(shipped_gear(), shipped_motor())
    made = PolledReadout(ReadoutConfig(url="simulated"), bench.clock, bench.serial)
    port: CanRig = wire_port(bench, shipped_motor(), sources=[made])
    description = port.open()
    assert "ND-287" in description.devices["readout ND 287"]["model"]
    block = port.exchange(Command(Mode.SPEED, np.full(300, 30.0)), 300, Guard())
    names = [channel.name for channel in port.channels]
    output, shown = (
        port.channels[names.index("output_angle")],
        port.channels[names.index("readout_angle")],
    )
    true = output.scale * block.counts[:, names.index("output_angle")]
    read = shown.to_si(block.counts[:, names.index("readout_angle")])
    assert np.abs(np.diff(read - np.remainder(true, 2 * math.pi) * np.sign(1))).max() < 1e-3
    assert not block.flags.any()
    port.close()


class Faulty(PolledReadout):
    """A readout whose driver has a fault of its own in the hundredth cycle."""

    fault: BaseException | Reading = ValueError("a fault of its own")

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        if cycle < 100:
            return super().collect(cycle, until_ns)
        if isinstance(self.fault, BaseException):
            raise self.fault
        return self.fault

    def close(self) -> None:
        super().close()
        raise OSError("nor can it be closed")


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (ValueError("a fault of its own"), "collect raised ValueError: a fault of its own"),
        (Reading((1,)), "collect raised ValueError: 1 counts for 2 channels"),
        (Reading((0.5, 0)), "collect raised TypeError"),  # type: ignore[arg-type]
    ],
)
def test_a_source_that_raises_is_out_of_use_and_stops_nobody(
    fault: BaseException | Reading, told: str
) -> None:
    bench = WireBench(shipped_gear(), shipped_motor())
    made = Faulty(ReadoutConfig(url="simulated"), bench.clock, bench.serial)
    made.fault = fault
    port: CanRig = wire_port(bench, shipped_motor(), sources=[made])
    port.open()
    block = port.exchange(Command(Mode.SPEED, np.full(300, 30.0)), 300, Guard())
    assert len(block.counts) == 300
    assert block.broken is None
    (event,) = (one for one in port.events() if one.code == "source-raised")
    assert told in event.text
    # The motor is led on: down to standstill, and nothing is told twice.
    block = port.exchange(Command(Mode.SPEED, np.zeros(300)), 300, Guard())
    assert not [one for one in port.events() if one.code == "source-raised"]
    turned = np.diff(block.counts[-50:, 0])
    assert np.abs(turned).max() <= 1
    port.close()
