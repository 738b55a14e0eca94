"""The servo amplifier of `tests.drivers.amplifier` on durand, a CANopen stack of other authors in Python."""

from __future__ import annotations

from typing import cast

from model.motor import ServoMotor
from sim_backend.wire.analog_amplifier import ReferenceDevice
from sim_backend.wire.bench import DRIVE_NODE, WireBench
from sim_backend.wire.drive import Drive
from tests.drivers.amplifier import Amplifier
from tests.drivers.durand_node import DurandNode


class DurandDrive(Amplifier, DurandNode):
    """The amplifier as durand's node."""

    stack_name = b"durand"


class DurandBench(WireBench):
    """The bench with this amplifier as its drive, beside the simulated counter and analog input."""

    amplifier: DurandDrive

    def _make_devices(self, motor: ServoMotor, reference: ReferenceDevice | None) -> None:
        super()._make_devices(motor, reference)
        assert isinstance(self.drive, Drive)
        self.amplifier = DurandDrive(DRIVE_NODE, self.drive.device, self._from_device)
        self.drive = cast("Drive", self.amplifier)
        self.slaves = (self.drive, self.counter, self.analog_input)
