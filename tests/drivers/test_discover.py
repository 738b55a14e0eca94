"""Who is on an unknown bus is found out by uploads alone, and a bus that is somebody's is left to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pytest

from drivers.bus.discover import BIT_RATES, PASSIVE, discover, find_bit_rate
from drivers.bus.load import CycleLoad, frame_bits, load_of
from drivers.bus.network import RawBus
from drivers.clock import VirtualClock
from drivers.errors import DriverError, OtherMasterError
from drivers.python_can import can
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from sim_backend.wire.bench import WireBench
from tests.drivers.can_bench import close, setup
from tests.drivers.canopen_peer import Bench
from tests.drivers.foreign_drive import ENABLED, ForeignCounter, ForeignDrive
from tests.drivers.foreign_slave import Traits, Wire

UPLOAD, SEGMENT, ABORT = 0x40, 0x60, 0x80


class Tapped:
    """A raw bus that notes what is sent over it."""

    def __init__(self, raw: Any) -> None:
        self.raw, self.sent = raw, []

    def send(self, msg: can.Message, /) -> None:
        self.sent.append((msg.arbitration_id, bytes(msg.data)))
        self.raw.send(msg)

    def recv(self, timeout: float | None = None, /) -> can.Message | None:
        return self.raw.recv(timeout)

    def shutdown(self) -> None:
        self.raw.shutdown()


def require_uploads(sent: list[tuple[int, bytes]]) -> None:
    assert sent
    for cob_id, data in sent:
        assert 0x600 < cob_id < 0x680, f"0x{cob_id:03X} is no SDO request"
        assert data[0] & 0xE0 in (UPLOAD, SEGMENT, ABORT), data.hex()


def test_everybody_is_found_and_nothing_but_uploads_is_sent() -> None:
    bench = WireBench(shipped_gear(), shipped_motor())
    tapped = Tapped(bench.bus())
    before = {
        (slave.node_id, entry.index, entry.sub): slave.dictionary.value(entry.index, entry.sub)
        for slave in bench.slaves
        for entry in slave.dictionary
        if entry.access == "rw"
    }
    stages: list[str] = []
    drive, counter, coupler = discover(
        tapped, bench.clock, bench.pump, on_stage=lambda what, done, of: stages.append(what)
    )
    require_uploads(tapped.sent)
    assert [drive.profile, counter.profile, coupler.profile] == [402, 406, 401]
    assert (drive.identity.is_simulated, drive.modes, drive.statement.rated_torque) == (
        True,
        0x38C,
        637,
    )
    assert drive.has_consumer
    assert drive.has_digital_inputs
    assert counter.counts_per_revolution == 72_000
    assert coupler.analog_inputs == 4
    assert drive.pdos[0].entries
    assert list(dict.fromkeys(stages)) == ["listening", "node-IDs asked", "nodes read"]
    after = {key: _value(bench, key) for key in before}
    assert after == before, "nothing was written"


def _value(bench: WireBench, key: tuple[int, int, int]) -> Any:
    slave = next(one for one in bench.slaves if one.node_id == key[0])
    return slave.dictionary.value(key[1], key[2])


def test_another_stacks_nodes_are_read() -> None:
    made = setup()
    tapped = Tapped(made.raw)
    found = discover(tapped, made.clock, Bench(made.drive, made.counter, made.analog))
    made.raw.shutdown()
    close(made)
    require_uploads(tapped.sent)
    assert sorted(node.profile for node in found) == [401, 402, 406]


@pytest.mark.parametrize(
    ("cob_id", "data", "words"),
    [
        (0x080, b"", "SYNC"),
        (0x000, b"\1\0", "NMT commands"),
        (0x605, b"\x40\0\x10\0\0\0\0\0", "SDO requests to node 5"),
        (0x201, b"\x0f\0", "set-points for node 1"),
    ],
)
def test_a_bus_with_a_master_is_left_alone(cob_id: int, data: bytes, words: str) -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire)
    tapped = Tapped(wire)
    wire.feed(cob_id, data)
    with pytest.raises(OtherMasterError, match=words):
        discover(tapped, wire.clock, wire.pump)
    assert tapped.sent == []


def test_a_drive_with_power_ends_it() -> None:
    wire = Wire(VirtualClock())
    ForeignDrive(wire, Traits(state=ENABLED))
    tapped = Tapped(wire)
    with pytest.raises(OtherMasterError, match="this drive has power"):
        discover(tapped, wire.clock, wire.pump)
    require_uploads(tapped.sent)


def test_what_is_not_built_is_refused_by_name() -> None:
    wire = Wire(VirtualClock())
    values = {(0x1019, 0): 10, (0x100C, 0): 100, (0x100D, 0): 3, (0x1017, 0): 0}
    ForeignCounter(wire, Traits(values=values))
    (node,) = discover(wire, wire.clock, wire.pump)
    assert node.refused == (
        "a SYNC with a counter (0x1019 = 10)",
        "node guarding (0x100C = 100 ms) as its only watch",
    )


class Adapter:
    """An adapter at a bit rate: at the bus's own it hears heartbeats, at another nothing but errors."""

    def __init__(self, rate: int, right: int, clock: VirtualClock) -> None:
        self.is_right, self.clock, self.is_closed = rate == right, clock, False
        self.is_quiet = False

    def send(self, msg: can.Message, /) -> None:
        raise AssertionError("whoever listens sends nothing")

    def recv(self, timeout: float | None = None, /) -> can.Message | None:
        self.clock.advance_ns(50_000_000)
        self.is_quiet = not self.is_quiet
        if self.is_quiet:
            return None
        if self.is_right:
            return can.Message(arbitration_id=0x701, data=[0x7F], is_extended_id=False)
        return can.Message(is_error_frame=True)

    def shutdown(self) -> None:
        self.is_closed = True


def _opening(
    right: int, clock: VirtualClock
) -> tuple[Callable[[int, Mapping[str, Any]], RawBus], list[Adapter]]:
    opened: list[Adapter] = []

    def open_at(rate: int, passive: Mapping[str, Any]) -> RawBus:
        assert passive == PASSIVE["slcan"]
        opened.append(Adapter(rate, right, clock))
        return opened[-1]

    return open_at, opened


def test_the_bit_rate_is_found_by_listening_alone() -> None:
    clock = VirtualClock()
    open_at, opened = _opening(250_000, clock)
    assert find_bit_rate(open_at, "slcan", clock) == 250_000
    assert len(opened) == BIT_RATES.index(250_000) + 1
    assert all(one.is_closed for one in opened)
    open_at, _ = _opening(0, clock)
    with pytest.raises(DriverError, match="nothing is heard at any bit rate"):
        find_bit_rate(open_at, "slcan", clock)
    with pytest.raises(DriverError, match="it would disturb the bus"):
        find_bit_rate(open_at, "gs_usb", clock)


def test_the_rate_that_a_bus_carries() -> None:
    # The longest standard frame of eight bytes: 135 bits, of none: 55.
    assert (frame_bits(8), frame_bits(0)) == (135, 55)
    load = CycleLoad([0, 8, 8])
    assert load.bits == 55 + 2 * 135
    assert load.share(1000.0, 1_000_000) == pytest.approx(0.325)
    assert load.largest_rate(1_000_000) == 2000.0
    assert load.largest_rate(500_000) == 1000.0
    assert load_of(3).largest_rate(10_000) == 0.0
