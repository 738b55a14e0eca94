"""A process that slept while the motor turned: the first frame that it sends is the quick stop."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.bus.frames import CycleStore
from drivers.bus.network import PumpedBus
from drivers.bus.waking import Waking, longest_pause_ns
from drivers.clock import VirtualClock
from drivers.errors import DriverError
from drivers.port import Command, DriveLimits, Guard, Mode
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.run.stop import StopRequest
from rig.trial.drill.rigs import DrilledRig, drilled_rig

CARRIERS = ("wire", "wire-csp", "wire-analog")
SPEED = 20.0
HEARTBEAT = 0x700 + 127


def turning(carrier: str) -> DrilledRig:
    """A rig at speed."""
    rig = drilled_rig(carrier, shipped_gear(), shipped_motor(), (), StopRequest(), 0)
    rig.port.open()
    rig.port.write_limits(DriveLimits(0.6, 300.0, 3000.0, 3000.0, 3000.0))
    rig.port.exchange(Command(Mode.OFF), 20, Guard())
    ramp = np.minimum(np.arange(300) * 0.1, SPEED)
    block = rig.port.exchange(Command(Mode.SPEED, ramp), len(ramp), Guard())
    assert block.broken is None
    assert rig.bench is not None
    assert rig.bench.plant.input_speed == pytest.approx(SPEED, rel=0.2)
    return rig


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("carrier", CARRIERS)
def test_after_a_sleep_nothing_goes_out_before_the_quick_stop(
    carrier: str, inside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = turning(carrier)
    bench, port, frames = rig.bench, rig.port, rig.port.abilities.quick_stop_frames
    assert bench is not None
    assert frames is not None
    quick_stop = list(frames())
    heard: list[tuple[int, bytes]] = []
    send = PumpedBus.send

    def send_and_tell(bus: PumpedBus, cob_id: int, data: bytes) -> None:
        heard.append((cob_id, data))
        send(bus, cob_id, data)

    monkeypatch.setattr(PumpedBus, "send", send_and_tell)
    end, left = CycleStore.end_cycle, [3 if inside else 0]

    def sleep() -> None:
        heard.clear()
        rig.clock.advance_ns(1_000_000_000)

    def end_and_sleep(store: CycleStore) -> int:
        flags = end(store)
        left[0] -= 1
        if left[0] == 0:
            sleep()
        return flags

    monkeypatch.setattr(CycleStore, "end_cycle", end_and_sleep)
    if not inside:
        sleep()
    block = port.exchange(Command(Mode.SPEED, np.full(20, SPEED)), 20, Guard())
    # The heartbeat is no set-point, and its turn comes in the same instant.
    assert [frame for frame in heard if frame[0] != HEARTBEAT] == quick_stop
    assert block.broken is not None
    assert block.broken.cause == "late_turn"
    assert block.broken.value > 990.0
    assert len(block) == (4 if inside else 1)
    with pytest.raises(DriverError, match="no longer enabled"):
        port.exchange(Command(Mode.SPEED, np.full(1, SPEED)), 1, Guard())
    port.exchange(Command(Mode.QUICK_STOP), 300, Guard())
    assert abs(bench.plant.input_speed) < 0.5
    port.close()


def test_what_the_drive_would_bear_is_no_sleep() -> None:
    rig = turning("wire")
    rig.clock.advance_ns(200_000_000)
    block = rig.port.exchange(Command(Mode.SPEED, np.full(5, SPEED)), 5, Guard())
    assert block.broken is None
    rig.port.close()


def test_how_long_a_pause_may_be() -> None:
    assert longest_pause_ns(250, 1_000_000, 20.0) == 250_000_000
    # A slow rig whose cycle waits for a silent node longer than the drive for the computer.
    assert longest_pause_ns(250, 20_000_000, 20.0) == 840_000_000
    clock = VirtualClock()
    waking = Waking(clock, 250_000_000)
    clock.advance_ns(250_000_000)
    assert not waking.has_slept()
    clock.advance_ns(1)
    assert waking.has_slept()
    waking.cycled()
    assert not waking.has_slept()
