"""What a rig on one CAN bus is made of, and how long a frame of it is waited for."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.bus.amplifiers import AmplifierConfig
from drivers.bus.cia401 import AnalogModuleConfig
from drivers.bus.cia402.config import DriveConfig
from drivers.bus.cia406 import CounterConfig
from drivers.bus.motor_encoder import MotorEncoder
from drivers.bus.rig_nodes import GuardContact
from drivers.errors import DriverError


@dataclass(frozen=True, kw_only=True)
class CanRigConfig:
    """A rig on one bus: SYNC period [ns], the drive and its encoder, counters and analog modules, the guard's contact.

    `patience_cycles`: how long a frame is waited for before its cycle counts as incomplete;
    `first_patience_ns`: the same for the very first cycle; `settle_factor`: how much longer is
    waited, once, after a lost frame for its late arrival; `stale_cycles`: incomplete cycles in a
    row after which an active drive raises; `stamp_wrap_ns`: range of an adapter's clock that wraps
    (a 32-bit microsecond counter: 4294967296000), 0 if it does not.
    """

    cycle_ns: int = 1_000_000
    drive: AmplifierConfig = field(default_factory=DriveConfig)
    motor_encoder: MotorEncoder
    counters: tuple[CounterConfig, ...] = ()
    modules: tuple[AnalogModuleConfig, ...] = ()
    guard: GuardContact | None = None
    patience_cycles: float = 5.0
    settle_factor: float = 4.0
    first_patience_ns: int = 500_000_000
    stale_cycles: int = 50
    stamp_wrap_ns: int = 0
    own_node_id: int = 127
    title: str = "CANopen rig"

    def __post_init__(self) -> None:
        if not 100_000 <= self.cycle_ns <= 1_000_000_000:
            raise DriverError(
                "the SYNC period is out of range",
                where="rig",
                value=self.cycle_ns,
                limit="0.1 ms to 1 s",
            )
        if not self.patience_cycles >= 1.0 or not self.settle_factor >= 1.0:
            raise DriverError(
                "patience and settle factor must be at least one",
                where="rig",
                value=f"{self.patience_cycles}, {self.settle_factor}",
            )

    @property
    def node_ids(self) -> tuple[int, ...]:
        """The nodes that are this rig's, the drive first."""
        devices = (self.drive, *self.counters, *self.modules)
        return tuple(device.node_id for device in devices)
