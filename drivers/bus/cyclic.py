"""The rig on a CAN bus: the segment of its drive under the cycled rig, with whatever sources stand beside the bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from drivers.acquisition_statistics import AcquisitionReport
from drivers.bus.cia301 import ObjectRef
from drivers.bus.device import Missing
from drivers.bus.network import Pump, RawBus, TimeBase
from drivers.bus.rig_config import CanRigConfig
from drivers.bus.rig_nodes import RigNodes
from drivers.bus.segment import CanSegment
from drivers.clock import Clock
from drivers.cycled import CycledRig
from drivers.port import Origin
from drivers.source import Source

__all__ = ["CanRig", "CanRigConfig"]


class CanRig(CycledRig):
    """A rig on a CAN bus. `connect` opens the raw bus; `pump` lets devices of the same process run;
    see `drivers.bus.network`.
    """

    def __init__(
        self,
        config: CanRigConfig,
        clock: Clock,
        connect: Callable[[], RawBus],
        *,
        sources: Sequence[Source] = (),
        pump: Pump | None = None,
        time_base: TimeBase = "host",
        origin: Origin = "hardware",
        truth: Mapping[str, object] | None = None,
    ) -> None:
        self.segment = CanSegment(
            config, clock, connect, pump=pump, time_base=time_base, origin=origin, truth=truth
        )
        super().__init__(self.segment, sources, clock)

    @property
    def config(self) -> CanRigConfig:
        """What it was told of the devices."""
        return self.segment.config

    @property
    def nodes(self) -> RigNodes:
        """The devices, for checks that go beyond running: doctor, drills."""
        return self.segment.nodes

    def acquisition(self) -> AcquisitionReport:
        """Achieved rate, jitter, missed cycles and latency since the rig was opened."""
        return self.segment.acquisition()

    def quick_stop_frames(self) -> list[tuple[int, bytes]]:
        """(COB-ID, data) of the frames that quick-stop the drive without this loop."""
        return self.segment.quick_stop_frames()

    def missing(self) -> dict[int, list[Missing]]:
        """What each node does not offer, by node-ID."""
        return self.segment.nodes.missing()

    def read_integer(self, node_id: int, entry: ObjectRef) -> int:
        """An object of a node by SDO, between two cycles. Raises `DriverError`."""
        return self.segment.read_integer(node_id, entry)
