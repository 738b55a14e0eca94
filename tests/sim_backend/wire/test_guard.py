"""The contact of the rig's guard: recorded with every cycle, and its opening seen in the very cycle."""

from dataclasses import replace

import numpy as np
import pytest

from drivers import channel as names
from drivers.bus.cia301 import U8, U32, ObjectRef
from drivers.bus.cyclic import CanRig
from drivers.bus.rig_nodes import GuardContact
from drivers.port import Bound, Command, Guard, Mode
from rig.bench import limits as lim
from rig.bench.backends.simulated import wire_config
from rig.run.phases import Turn
from rig.run.supervisor import Supervisor
from rig.run.trips import GUARD_OPEN
from sim_backend.wire.bench import WireBench
from sim_backend.wire.faults import GuardOpened
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR
from tests.sim_backend.wire.rigs import off

OPENED, CLOSED_AGAIN = 12, 20
INPUTS = ObjectRef(0x60FD, 0, U32, "digital inputs")


def guarded(contact: GuardContact | None = None) -> tuple[CanRig, WireBench]:
    """An opened rig on the wire whose guard is watched, by the given contact where it is not the usual one."""
    bench = WireBench(GEAR, MOTOR, None, World.of(3))
    config = wire_config(bench, MOTOR, has_guard=True)
    config = config if contact is None else replace(config, guard=contact)
    port = CanRig(
        config, bench.clock, bench.bus, pump=bench.pump, time_base="hardware", origin="simulated"
    )
    port.open()
    return port, bench


def guard_of(port: CanRig, counts: np.ndarray) -> list[int]:
    return counts[:, [channel.name for channel in port.channels].index(names.GUARD_CLOSED)].tolist()


def test_the_guard_stands_in_every_cycle() -> None:
    port, bench = guarded()
    bench.inject(GuardOpened(bench.cycle + OPENED, cycles=CLOSED_AGAIN - OPENED))
    block = off(port, 30)
    assert guard_of(port, block.counts) == [int(not OPENED <= k < CLOSED_AGAIN) for k in range(30)]
    port.close()


@pytest.mark.parametrize("cut", [1, 7, 30])
def test_its_opening_ends_the_exchange_in_that_cycle(cut: int) -> None:
    port, bench = guarded()
    bench.inject(GuardOpened(bench.cycle + OPENED))
    watch = Guard((Bound(cause=GUARD_OPEN, weights={names.GUARD_CLOSED: 1.0}, low=0.5),))
    rows, broken = 0, None
    while broken is None:
        block = port.exchange(Command(Mode.OFF), cut, watch)
        rows, broken = rows + len(block), block.broken
    assert (rows - 1, broken.cause) == (OPENED, GUARD_OPEN)
    port.close()


def test_it_may_be_opened_with_the_servo_off_and_not_with_the_servo_on() -> None:
    port, _ = guarded()
    limits = lim.derive_limits(GEAR, MOTOR)
    supervisor = Supervisor(port.channels, port.cycle_ns, limits, None)
    supervisor.begin(np.zeros(len(port.channels), dtype=np.int64))
    causes = [
        {
            bound.cause
            for bound in supervisor.guard(Turn(Command(Mode.OFF), 1, enabled=enabled)).bounds
        }
        for enabled in (False, True)
    ]
    assert [GUARD_OPEN in found for found in causes] == [False, True]
    port.close()


def test_an_input_that_cannot_be_mapped_is_said() -> None:
    port, _ = guarded(GuardContact(1, ObjectRef(0x1018, 1, U32, "vendor"), 1, 1))
    assert names.GUARD_CLOSED not in [channel.name for channel in port.channels]
    (event,) = [event for event in port.events() if event.code == "guard-not-mapped"]
    assert "when it is opened in motion" in event.text
    port.close()


def test_an_input_that_is_mapped_anyway_is_read_from_where_it_is() -> None:
    port, bench = guarded(GuardContact(2, ObjectRef(0x2000, 2, U8, "index marks seen"), 0x80, 0))
    assert guard_of(port, off(port, 3).counts) == [1, 1, 1]
    assert bench.cycle >= 3
    port.close()
