"""Enabling and changing the mode take their time by SDO, and the SYNC does not stand still for it."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.bus.cia402.tables import MODE
from drivers.bus.cyclic import CanRig
from drivers.errors import DriverError
from drivers.port import Command, Guard, Mode
from tests.drivers.foreign_bench import bench
from tests.drivers.foreign_slave import Stranger, Traits, Wire

PERIOD_NS = 1_000_000
SLOW = Traits(answer_ms=2.0, transition_ms=5, mode_ms=8)


class SyncTimes(Stranger):
    """When every SYNC was on the bus [ns]."""

    def __init__(self, wire: Wire) -> None:
        super().__init__(wire)
        self.times: list[int] = []

    def receive(self, cob_id: int, data: bytes) -> None:
        if cob_id == 0x080:
            self.times.append(self.wire.clock.monotonic_ns())


def exchange(rig: CanRig, mode: Mode, cycles: int = 20) -> None:
    target = np.zeros(cycles) if mode in (Mode.SPEED, Mode.TORQUE) else np.empty(0)
    block = rig.exchange(Command(mode, target), cycles, Guard())
    assert len(block) == cycles
    assert not block.flags.any()


@pytest.mark.parametrize("traits", [SLOW, Traits(transition_ms=30)])
def test_the_sync_goes_on_while_the_drive_is_enabled_and_changes_its_mode(traits: Traits) -> None:
    with bench(traits) as made:
        made.open()
        heard = SyncTimes(made.wire)
        for mode in (Mode.OFF, Mode.SPEED, Mode.TORQUE, Mode.SPEED):
            exchange(made.rig, mode)
        intervals = np.diff(heard.times)
        # Enabling took long: there were many more SYNCs than cycles that were kept.
        assert len(heard.times) > 80 + 25
        assert intervals.min() >= PERIOD_NS
        assert intervals.max() <= 1.5 * PERIOD_NS
        assert made.rig.acquisition().jitter_max < 1e-6


def test_a_drive_that_cannot_be_enabled_leaves_no_sync_behind() -> None:
    with bench(Traits(answer_ms=2.0, mode_ms=10_000)) as made:
        made.open()
        exchange(made.rig, Mode.OFF)
        with pytest.raises(DriverError, match="mode"):
            exchange(made.rig, Mode.SPEED)
        heard = SyncTimes(made.wire)
        made.rig.read_integer(1, MODE)
        assert not heard.times
