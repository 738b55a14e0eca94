"""The servo amplifier of `tests.drivers.amplifier` on CANopenNode, as the drive of the simulated bench."""

from __future__ import annotations

from typing import cast

from model.motor import ServoMotor
from sim_backend.wire.analog_amplifier import ReferenceDevice
from sim_backend.wire.bench import DRIVE_NODE, WireBench
from sim_backend.wire.drive import Drive
from tests.benchmarks.canopennode.node import CanopennodeNode
from tests.drivers.amplifier import Amplifier


class CanopennodeDrive(Amplifier, CanopennodeNode):
    """The amplifier as CANopenNode's node."""

    stack_name = b"CANopenNode"


class CanopennodeBench(WireBench):
    """The bench with this amplifier as its drive, beside the simulated counter and analogue input; it keeps the log of
    the plant: clock [ns] and true speed of the input [rad/s] after each cycle.
    """

    amplifier: CanopennodeDrive

    def _make_devices(self, motor: ServoMotor, reference: ReferenceDevice | None) -> None:
        super()._make_devices(motor, reference)
        assert isinstance(self.drive, Drive)
        self.log: list[tuple[int, float]] = []
        self.amplifier = CanopennodeDrive(DRIVE_NODE, self.drive.device, self._from_device)
        self.drive = cast("Drive", self.amplifier)
        self.slaves = (self.drive, self.counter, self.analog_input)

    def _advance_plant(self) -> None:
        super()._advance_plant()
        self.log.append((self.clock.monotonic_ns(), self.input_speed))
