"""What has to be known of a servo amplifier before it is brought up, and what it said of itself then."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from drivers.bus.cia301 import ObjectRef
from drivers.bus.cia402 import tables as obj
from drivers.bus.cia402.plausible import Question
from drivers.bus.cia402.tables import OperationMode
from drivers.bus.cia402.units import Configured
from drivers.bus.device import Identity, Missing
from drivers.bus.dictionary.eds import DeviceDescription
from drivers.channel import Calibration


@dataclass(frozen=True, kw_only=True)
class DriveConfig:
    """What has to be known of a servo amplifier beforehand. Zero or None: ask the drive.

    `counts_per_revolution` of 0x6064 per motor revolution; `velocity_unit` [rad/s per count of
    0x60FF]; `acceleration_unit` [rad/s2 per count of 0x6083]; `rated_torque` [N m]; modes in order
    of preference; heartbeats and time-outs [ms]; option codes of CiA 402: 0x6007 = 3 quick stop
    when the computer's heartbeat is lost, 0x605A = 2 quick stop ramp then power off, 0x605E = 2
    quick stop ramp in a fault; `gains` further objects to read back.
    """

    has_quick_stop: ClassVar[bool] = True
    reads_limits_back: ClassVar[bool] = True

    node_id: int = 1
    description: DeviceDescription | None = None
    counts_per_revolution: float = 0.0
    velocity_unit: float | None = None
    acceleration_unit: float | None = None
    rated_torque: float | None = None
    motor_torque: float | None = None
    """Rated torque [N m] of the motor that the rig's description names: the drive's own is held against it."""
    speed_modes: tuple[int, ...] = (
        OperationMode.CYCLIC_VELOCITY,
        OperationMode.CYCLIC_POSITION,
        OperationMode.PROFILE_VELOCITY,
    )
    torque_modes: tuple[int, ...] = (OperationMode.CYCLIC_TORQUE, OperationMode.PROFILE_TORQUE)
    heartbeat_ms: int = 100
    computer_heartbeat_ms: int = 50
    computer_lost_ms: int = 250
    abort_connection_option: int = 3
    quick_stop_option: int = 2
    fault_reaction_option: int = 2
    state_timeout_ms: int = 5000
    sdo_timeout_ms: int = 300
    gains: tuple[ObjectRef, ...] = ()
    latch_index: bool = True
    """Use touch probe 1 to latch the position at the motor encoder's index mark, where the drive has it."""
    torque_limit: ObjectRef = obj.MAX_TORQUE
    torque_limit_unit: float | None = None
    """The object that limits torque, and the torque of one count of it [N m]; None: a thousandth of the rated."""
    actual_torque: ObjectRef = obj.TORQUE
    torque_unit: float | None = None
    """Torque of one count of `actual_torque` [N m]; None: a thousandth of the rated torque, as 0x6077 has it."""
    torque_calibration: Calibration = field(default_factory=Calibration)
    """Of the torque that the drive tells: what it rests on, and which sensor it is of."""

    @property
    def units(self) -> Configured:
        """What is said here of the drive's units."""
        return Configured(
            rated_torque=self.rated_torque,
            counts_per_revolution=self.counts_per_revolution,
            velocity_unit=self.velocity_unit,
            acceleration_unit=self.acceleration_unit,
            motor_torque=self.motor_torque,
        )


@dataclass(frozen=True, kw_only=True)
class DriveReadings:
    """What the drive said of itself when it was brought up: identity, units, gains, options, and what it lacks."""

    identity: Identity
    rated_torque: float
    torque_limit_unit: float
    counts_per_revolution: float
    velocity_unit: float
    acceleration_unit: float
    speed_mode: OperationMode | None
    torque_mode: OperationMode | None
    settings: dict[str, float] = field(default_factory=dict[str, float])
    missing: list[Missing] = field(default_factory=list[Missing])
    is_interpolating: bool = False
    """It reads back the SYNC period as its interpolation time (0x60C2)."""
    questions: tuple[Question, ...] = ()
    """What a person must say of the drive's units, because its own word is missing or cannot be right."""
