"""A counter box on TCP beside the bus: the same counts as the counter on the bus, in blocks of any length, and whatever
goes wrong with it is marked, told, and delays nobody.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from drivers.bus.cyclic import CanRig
from drivers.errors import DriverError
from drivers.port import STALE_DATA, Bound, Command, Guard, Mode
from drivers.readout.counter_box import CounterBox, CounterBoxConfig
from drivers.samples import CycleFlag, SampleBlock
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.simulated import box_port, wire_port
from rig.run.preflight import standing_checks
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
    codes = [event.code for event in port.events()]
    assert code in codes if code else not any(one.startswith("source") for one in codes)
    assert np.array_equal(block.interval_ns, sound.interval_ns), "no SYNC waited"
    if not isinstance(fault, faults.BoxUnplugged):
        # Edges that did not arrive shift the pairing once: that cycle is marked, the next ones are paired anew.
        assert not block.flags[107:].any()


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
    assert [check.result for check in checks if check.name == "pairs"] == ["failed"]


def test_two_devices_for_one_channel_are_refused() -> None:
    made = bench()
    boxed = box_port(made, MOTOR)
    port = wire_port(made, MOTOR, sources=boxed._sources)
    with pytest.raises(DriverError, match="two devices measure one channel"):
        port.open()
