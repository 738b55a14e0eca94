"""Node guarding is not built, and the doctor says so of a node that waits for it."""

from __future__ import annotations

import pytest

from drivers.bus.device import RemoteDevice
from drivers.bus.network import PumpedBus
from drivers.clock import VirtualClock
from rig.trial.doctor.bus import _guarding
from tests.drivers.foreign_drive import ForeignCounter
from tests.drivers.foreign_slave import Traits, Wire


@pytest.mark.parametrize(
    ("period", "factor", "beats", "expected"),
    [
        (100, 3, False, ["blocks"]),
        (100, 3, True, ["warns"]),
        (0, 3, False, []),
        (100, 0, False, []),
    ],
)
def test_a_node_that_waits_to_be_guarded_is_named(
    period: int, factor: int, beats: bool, expected: list[str]
) -> None:
    wire = Wire(VirtualClock())
    ForeignCounter(wire, Traits(values={(0x100C, 0): period, (0x100D, 0): factor}))
    device = RemoteDevice(PumpedBus(wire, wire.clock, pump=wire.pump), 2)
    if beats:
        assert device.produce_heartbeat(100)
    found = list(_guarding("node 2", device))
    assert [one.severity for one in found] == expected
    assert all("0x100C" in one.found for one in found)
