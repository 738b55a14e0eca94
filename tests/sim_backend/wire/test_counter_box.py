"""A counter box on TCP beside the bus: the same counts as the counter on the bus, in blocks of any length, and whatever
goes wrong with it is marked, told, and delays nobody.
"""

from __future__ import annotations

import socket
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from drivers.bus.cyclic import CanRig
from drivers.clock import WallClock
from drivers.errors import BusLostError, DriverError
from drivers.port import STALE_DATA, Bound, Command, Guard, Mode
from drivers.readout.counter_box import CounterBox, CounterBoxConfig, SocketLine, connect
from drivers.samples import CycleFlag, SampleBlock
from drivers.source import Reading
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.simulated import box_port, wire_port
from rig.bench.backends.sources import Shafts, sources_of
from rig.bench.config.load import load_configuration
from rig.errors import ConfigurationError
from rig.run.preflight import standing_checks
from rig.testing.source import check_source
from sim_backend.faults import Fault
from sim_backend.wire import box_faults as faults
from sim_backend.wire.bench import WireBench

MOTOR = shipped_motor()
CYCLES = 400
STALE = CycleFlag.INCOMPLETE | CycleFlag.STALE_OUTPUT


def bench(*happening: Fault) -> WireBench:
    return WireBench(shipped_gear(), MOTOR, faults=happening)


def turned(port: CanRig, sizes: Sequence[int], guard: Guard = Guard()) -> list[SampleBlock]:
    port.open()
    return [port.exchange(Command(Mode.SPEED, np.full(n, 20.0)), n, guard) for n in sizes]


def column(port: CanRig, blocks: Sequence[SampleBlock], name: str) -> np.ndarray:
    at = [channel.name for channel in port.channels].index(name)
    return np.concatenate([block.counts[:, at] for block in blocks])


def marks(blocks: Sequence[SampleBlock]) -> np.ndarray:
    return np.concatenate([block.flags for block in blocks])


@pytest.fixture(scope="module")
def on_the_bus() -> np.ndarray:
    port = wire_port(bench(), MOTOR)
    return column(port, turned(port, [CYCLES]), "output_angle")


@pytest.mark.parametrize("length", [1, 7, 100, CYCLES])
def test_its_counts_are_those_of_the_counter_on_the_bus(
    length: int, on_the_bus: np.ndarray
) -> None:
    port = box_port(bench(), MOTOR)
    sizes = [length] * (CYCLES // length) + [CYCLES % length] * (CYCLES % length > 0)
    blocks = turned(port, sizes)
    assert np.array_equal(column(port, blocks, "output_angle"), on_the_bus)
    assert not marks(blocks).any()


def test_it_says_who_it_is_and_makes_a_simulated_rig_one() -> None:
    port = box_port(bench(), MOTOR)
    description = port.open()
    assert description.devices["counter box output_angle"]["serial"] == "BOX-1"
    assert description.origin == "simulated"


def test_a_box_that_counts_another_encoder_is_refused() -> None:
    made = bench()
    config = CounterBoxConfig(
        channel="output_angle", lines=500, multiplication=4, largest_speed=10.0
    )
    with pytest.raises(DriverError, match="counts another encoder"):
        CounterBox(config, made.clock, made.box_line).open(made.cycle_ns)


@pytest.mark.parametrize(
    ("fault", "expected", "code"),
    [
        (faults.BoxSilent(100, cycles=5), STALE, "source-silent"),
        (faults.BoxGarbled(100, cycles=5), STALE, "source-garbage"),
        (faults.BoxUnplugged(100, cycles=5), STALE, "source-lost"),
        (faults.BoxDeaf(100, cycles=5), STALE, "source-trigger"),
        (faults.BoxSlow(100, cycles=5), STALE, "source-silent"),
        (faults.BoxInvalid(100, cycles=5), CycleFlag.SIGNAL_ERROR, ""),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_goes_wrong_with_it_is_marked_and_told_and_delays_nobody(
    fault: Fault, expected: CycleFlag, code: str
) -> None:
    (sound,) = turned(box_port(bench(), MOTOR), [300])
    port = box_port(bench(fault), MOTOR)
    (block,) = turned(port, [300])
    assert not block.flags[:100].any()
    assert (block.flags[100:104] & expected == expected).all()
    assert bool(fault.effects)
    if isinstance(fault, faults.BoxSlow):
        assert block.flags[105] & CycleFlag.LATE, "an answer that comes after its cycle is told"
    codes = [event.code for event in port.events()]
    assert code in codes if code else not any(one.startswith("source") for one in codes)
    assert np.array_equal(block.interval_ns, sound.interval_ns), "no SYNC waited"
    if not isinstance(fault, faults.BoxUnplugged):
        # Edges that did not arrive shift the pairing once: that cycle is marked, the next ones are paired anew.
        assert not block.flags[106:].any()


def test_a_dead_box_breaks_the_guard_as_stale_data() -> None:
    port = box_port(bench(faults.BoxUnplugged(50)), MOTOR)
    (block,) = turned(port, [300], Guard(stale_cycles=20))
    assert block.broken is not None
    assert (block.broken.cause, len(block)) == (STALE_DATA, 70)


def test_the_guard_judges_its_counts() -> None:
    bound = Bound(cause="turned too far", weights={"output_angle": 1.0}, lag=1, high=-1e9)
    port = box_port(bench(), MOTOR)
    (block,) = turned(port, [50], Guard((bound,)))
    assert block.broken is not None
    assert block.broken.cause == "turned too far"
    assert len(block) == 2


def test_asked_without_a_trigger_line_it_is_polled_with_stamps_of_its_own() -> None:
    port = box_port(bench(faults.BoxSilent(100, cycles=3)), MOTOR, latched_by="request")
    (block,) = turned(port, [200])
    assert not marks([block]).any(), "what is polled marks no cycle"
    taken = column(port, [block], "output_angle_taken")
    assert (taken[:100] == 30_000).all(), "halfway between question and answer"
    assert taken[102] == 30_000 - 3_000_000
    angle = next(channel for channel in port.channels if channel.name == "output_angle")
    assert angle.acquired == "polled"
    bound = Bound(cause="over speed", weights={"output_angle": 1.0}, lag=1, high=1e9)
    with pytest.raises(DriverError, match="polled channel stands in a trip"):
        port.exchange(Command(Mode.OFF), 1, Guard((bound,)))
    checks = standing_checks(port.channels, block.counts, block.flags, 1.0)
    assert [check.severity for check in checks if check.what == "pairs"] == ["blocks"]


def test_two_devices_for_one_channel_are_refused() -> None:
    made = bench()
    boxed = box_port(made, MOTOR)
    port = wire_port(made, MOTOR, sources=boxed._sources)
    with pytest.raises(DriverError, match="two devices measure one channel"):
        port.open()


def test_over_a_real_socket_lines_come_in_pieces_and_a_closed_one_is_lost() -> None:
    ours, theirs = socket.socketpair()
    clock = WallClock()
    line = SocketLine(ours, clock)
    assert line.receive(clock.monotonic_ns()) == b"", "nobody waits for what is not there"
    theirs.send(b"T 5 6")
    theirs.send(b" 700 0\nT 6 7")
    config = CounterBoxConfig(
        channel="output_angle", lines=500, multiplication=4, largest_speed=10.0
    )
    box = CounterBox(config, clock, lambda: line)
    theirs.send(b"")
    box._line = line
    box.request(5)
    assert theirs.recv(100) == b"T 5\n"
    assert box.collect(5, clock.monotonic_ns()) == Reading((700,))
    theirs.send(b" -1 0\n")
    assert box.collect(6, clock.monotonic_ns()) == Reading((-1,))
    theirs.close()
    box.request(7)
    assert box.collect(7, clock.monotonic_ns() + 10**9) is None
    assert [event.code for event in box.events()] == ["source-lost"]
    box.request(8)
    box.close()


def test_it_keeps_what_every_source_keeps() -> None:
    made = bench()
    config = CounterBoxConfig(
        channel="output_angle", lines=18000, multiplication=4, largest_speed=10.0
    )
    check_source(lambda clock: CounterBox(config, clock, made.box_line), clock=made.clock)


def test_answers_that_nobody_collected_are_not_late() -> None:
    made = bench()
    box = CounterBox(
        CounterBoxConfig(channel="output_angle", lines=18000, multiplication=4, largest_speed=10.0),
        made.clock,
        made.box_line,
    )
    box.open(made.cycle_ns)
    # SYNCs go on while the drive is enabled between two blocks.
    for cycle in range(4):
        made.counter_box.trigger()
        box.request(cycle)
        made.clock.wait_until_ns(made.clock.monotonic_ns() + made.cycle_ns)
    reading = box.collect(3, made.clock.monotonic_ns())
    assert reading is not None
    assert reading.flags == 0


def test_nobody_at_the_address_is_told_with_what_to_do() -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        with pytest.raises(BusLostError, match="nobody answers"):
            connect("127.0.0.1", nobody.getsockname()[1], WallClock())


def test_a_description_names_it(tmp_path: Path) -> None:
    text = (resources.files("rig.bench.config") / "template.toml").read_text(encoding="utf-8")
    start = text.index("[[counter]]")
    end = text.index("[[analog_module]]")
    box = '[[source]]\nkind = "counter-box"\nhost = "192.0.2.7"\nport = 2200\nlines = 18000\nmultiplication = 10\n\n'
    path = tmp_path / "rig.toml"
    path.write_text(text[:start] + box + text[end:], encoding="utf-8")
    (source,) = sources_of(load_configuration(path), Shafts(600.0, 5.0), WallClock())
    (channel,) = source.channels
    assert (channel.name, channel.lines, channel.acquired) == ("output_angle", 18000, "latched")
    path.write_text(text[:end] + box + text[end:], encoding="utf-8")
    with pytest.raises(ConfigurationError, match="channel output_angle is given twice"):
        load_configuration(path)
