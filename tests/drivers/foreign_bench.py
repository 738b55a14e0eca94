"""A rig of one foreign drive in virtual time, whose power must be off when the story is over."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cyclic import CanRig, CanRigConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.clock import VirtualClock
from drivers.event import Event
from drivers.port import Command, DriveLimits, Guard, Mode
from drivers.samples import SampleBlock
from tests.drivers.foreign_drive import ForeignDrive
from tests.drivers.foreign_slave import Traits, Wire

RPM = 2 * np.pi / 60
LIMITS = DriveLimits(0.5, 300.0, 1000.0, 1000.0, 2000.0)
LATEST_S = 60.0
"""Virtual seconds that no story may exceed."""


@dataclass
class Bench:
    clock: VirtualClock
    wire: Wire
    drive: ForeignDrive
    rig: CanRig

    def exchange(self, mode: Mode, value: float = 0.0, cycles: int = 5) -> SampleBlock:
        target = np.full(cycles, value) if mode in (Mode.SPEED, Mode.TORQUE) else np.empty(0)
        return self.rig.exchange(Command(mode, target), cycles, Guard())

    def events(self) -> list[Event]:
        return self.rig.events()

    def open(self) -> None:
        self.rig.open()
        self.rig.write_limits(LIMITS)


@contextlib.contextmanager
def bench(traits: Traits | None = None, config: DriveConfig | None = None) -> Iterator[Bench]:
    clock = VirtualClock()
    wire = Wire(clock)
    drive = ForeignDrive(wire, traits)
    own = CanRigConfig(
        drive=config or DriveConfig(),
        motor_encoder=MotorEncoder(lines=8192, multiplication=4, largest_speed=900.0),
    )
    rig = CanRig(own, clock, lambda: wire, pump=wire.pump, time_base="virtual", origin="simulated")
    made = Bench(clock, wire, drive, rig)
    yield made
    rig.close()
    clock.advance_ns(7_000_000_000)
    for _ in range(3):
        wire.pump(0)
    assert not drive.is_powered
    assert clock.monotonic_ns() < (LATEST_S + 7) * 1e9
