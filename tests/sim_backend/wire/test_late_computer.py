"""A computer and a hub that are late now and then, at 1 kHz and 2000 r/min: whatever ends, it is no over-speed, and
late answers are no lost ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.bus.cyclic import CanRig
from drivers.clock import VirtualClock
from drivers.port import LATE_ANSWERS, Command, DriveLimits, Guard, Mode
from drivers.samples import CycleFlag
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.bench.backends.simulated import wire_config
from rig.bench.limits import derive_limits
from rig.run.phases import Turn
from rig.run.supervisor import Supervisor
from sim_backend.wire.bench import WireBench
from sim_backend.wire.faults import AnswersHeld
from sim_backend.wire.line import Frame
from sim_backend.world import World
from tests.sim_backend.wire.rigs import wire_rig

SPEED = 2000.0 * RPM
LIMITS = DriveLimits(1.0, 600.0, 3000.0, 3000.0, 3000.0)


def late_rig(seed: int, how_often: float) -> CanRig:
    """The bare motor behind a bus without stamps or echo, whose plant turns on while nobody comes."""
    clock, motor, random = VirtualClock(10**18), shipped_motor(), np.random.default_rng(seed)
    bench = WireBench(
        shipped_gear(),
        motor,
        world=World.of(seed),
        gear_mounted=False,
        clock=clock,
        silence_cycles=1,
    )

    def pump(deadline_ns: int) -> None:
        bench.pump(deadline_ns)
        if random.random() < how_often:
            clock.advance_ns(round(min(random.exponential(1.5), 4.0) * 1e6))
            bench.elapse()

    return CanRig(
        wire_config(bench, motor),
        clock,
        lambda: bench.bus(receive_own_messages=False),
        pump=pump,
        time_base="host",
        origin="simulated",
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_late_computer_makes_no_over_speed(seed: int) -> None:
    rig = late_rig(seed, 0.05)
    rig.open()
    try:
        rig.write_limits(LIMITS)
        limits = derive_limits(
            shipped_gear(), shipped_motor(), gear_mounted=False, plan_speed=SPEED
        )
        watcher = Supervisor(rig.channels, rig.cycle_ns, limits, None)
        watcher.begin(rig.exchange(Command(Mode.OFF), 20, Guard()).counts[-1])
        ramp = np.minimum(np.arange(1500) * 0.2, SPEED)
        causes = []
        for start in range(0, len(ramp), 20):
            turn = Turn(Command(Mode.SPEED, ramp[start : start + 20]), 20, enabled=True)
            block = rig.exchange(turn.command, 20, watcher.guard(turn))
            causes += [block.broken.cause] if block.broken is not None else []
            trip = watcher.review(block, turn)
            causes += [trip.cause] if trip is not None else []
            if trip is not None:
                break
        assert set(causes) <= {"missed_cycles", "late_turn", "stale_data"}, causes
        assert rig.acquisition().overruns > 20
    finally:
        rig.close()


@dataclass(frozen=True)
class CableBack(AnswersHeld):
    """A cable that was off for a while: every controller repeats the one frame of each COB-ID that it holds."""

    def from_devices(self, frame: Frame, bench: WireBench) -> Sequence[Frame]:
        last = bench.cycle >= self.end - 1
        return super().from_devices(frame, bench) if last else ()


@pytest.mark.parametrize(("fault", "is_late"), [(AnswersHeld, True), (CableBack, False)])
def test_answers_that_come_after_all_are_told_from_answers_that_are_lost(
    fault: type[AnswersHeld], is_late: bool
) -> None:
    with wire_rig() as made:
        made.bench.inject(fault(made.bench.cycle + 50, cycles=5))
        block = made.port.exchange(Command(Mode.OFF), 200, Guard())
        codes = [event.code for event in made.port.events()]
    assert np.count_nonzero(block.flags & CycleFlag.INCOMPLETE) >= 4
    assert np.count_nonzero(block.flags & (CycleFlag.LATE | CycleFlag.DOUBLED)) >= 1
    assert (LATE_ANSWERS in codes) is is_late
