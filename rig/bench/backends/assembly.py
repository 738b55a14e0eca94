"""What a rig is asked for and what it is once it is put together, the same for every backend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from drivers.bus import RawBus
from drivers.clock import Clock
from drivers.port import RigPort
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor


@dataclass(frozen=True, kw_only=True)
class AssembledRig:
    """A rig that can be run: its port, its clock, and whether its time is that of the wall.

    Of a rig of hardware: `second_bus` opens another handle on its bus for the watchdog, `guard`
    reads the input of the guard's contact (value, whether that means closed) once the rig is open,
    `reaction` [s] is how long an exchange may take, `priority` and `lock_memory` are what the loop
    asks of the computer.
    """

    name: str
    port: RigPort
    clock: Clock
    real_time: bool = False
    second_bus: Callable[[], RawBus] | None = None
    guard: Callable[[], tuple[int, bool]] | None = None
    reaction: float = 0.02
    priority: int = 0
    lock_memory: bool = False


@dataclass(frozen=True, kw_only=True)
class RigRequest:
    """What a rig is asked for.

    `gear` and `motor` are the nominal ones. On a simulated rig `seed` is the laboratory (its motor
    and instruments), seed and `serial` together are the individual gear, seed and `protocol`
    together are the run (start angle, drift, noise). `parameters` of the protocol are what a replay
    must have been recorded with. `configuration` is the file that describes a rig of hardware.
    """

    gear: HarmonicDrive
    motor: ServoMotor
    mounting: Mounting = "circular-spline-fixed"
    gear_mounted: bool = True
    serial: str = ""
    protocol: str = ""
    parameters: Mapping[str, object] = field(default_factory=dict)
    seed: int = 0
    sample_rate: float = 1000.0
    disc_inertia: float = 0.0
    configuration: Path | None = None
