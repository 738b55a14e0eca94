"""What a rig is asked for and what it is once it is put together, the same for every backend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.bus.network import RawBus
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.port import RigPort
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from rig.errors import ConfigurationError
from sim_backend.world import OLDEST, VERSION, Population, World

if TYPE_CHECKING:
    from drivers.bus.rig_nodes import RigNodes

AUTO, AMBIENT = "auto", "ambient"
"""How warm a simulated rig starts: as the latest run that fits ended, or as the room. Anything else names a run."""
WORLD_OF_0_2_0: Mapping[str, Any] = {"version": OLDEST, "hours": 0.0, "day_correlation": None}
"""What the worlds in the files of program version 0.2.0 do not say, because there was no other."""


@dataclass(frozen=True)
class StartState:
    """How warm a simulated rig starts: the temperatures [degC] with which a run ended; as the room without any."""

    run: str = ""
    temperatures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class WorldChoice:
    """Which simulated world somebody wants. None: the gear's seed follows from its serial number, the bench's is the
    request's seed, the number is the next in the folder, the start state is looked for by `start_state`.

    `mount_turn` in rad, None where nobody states it; `hours` that the gear has run; `day_correlation` None: that of
    the population; `version` of the draws; `repeats` names the run of which this is a repetition. Raises
    `ConfigurationError` for a value that names no world.
    """

    gear_seed: int | None = None
    bench_seed: int | None = None
    mount: int = 1
    mount_turn: float | None = None
    day: int = 1
    number: int | None = None
    population: Population = "narrow"
    hours: float = 0.0
    day_correlation: float | None = None
    version: int = VERSION
    start_state: str = AUTO
    start: StartState | None = None
    repeats: str = ""

    def __post_init__(self) -> None:
        try:
            self.world(0, 0)
        except DriverError as error:
            raise ConfigurationError(
                error.what,
                where=flag_of(error.where),
                value=error.value,
                limit=error.limit,
                remedy=error.remedy,
            ) from None

    def world(self, gear_seed: int, bench_seed: int) -> World:
        """The world, with these seeds where none are chosen."""
        return World(
            gear_seed=gear_seed if self.gear_seed is None else self.gear_seed,
            bench_seed=bench_seed if self.bench_seed is None else self.bench_seed,
            mount=self.mount,
            mount_turn=self.mount_turn,
            day=self.day,
            number=1 if self.number is None else self.number,
            population=self.population,
            hours=self.hours,
            day_correlation=self.day_correlation,
            version=self.version,
        )


def flag_of(name: str) -> str:
    """How a field of `WorldChoice` is called on the command line."""
    return "--" + name.replace("_", "-")


@dataclass(frozen=True, kw_only=True)
class AssembledRig:
    """A rig that can be run: its port, its clock, and whether its time is that of the wall.

    `nodes` are those of its bus, once it is open, for whoever looks them over; None: it has no bus.

    Of a rig of hardware: `second_bus` opens another handle on its bus for the watchdog, once the rig is open
    (`second_handle`: what is known of its adapter in that), `guard`
    reads the input of the guard's contact (value, whether that means closed) once the rig is open,
    `loss_covered_by` says what stops the motor when the computer is lost and the drive does not see to it,
    `reaction` [s] is how long an exchange may take, `priority` and `lock_memory` are what the loop
    asks of the computer.

    Of a simulated rig: `world` is the world that it is in, as its run file tells it, and
    `thermal_state` tells how warm it is now ("end") and was on average ("mean") [degC].
    """

    name: str
    port: RigPort
    clock: Clock
    real_time: bool = False
    nodes: Callable[[], RigNodes] | None = None
    second_bus: Callable[[], RawBus] | None = None
    second_handle: str = ""
    guard: Callable[[], tuple[int, bool]] | None = None
    loss_covered_by: str = ""
    reaction: float = 0.02
    priority: int = 0
    lock_memory: bool = False
    world: Mapping[str, Any] = field(default_factory=dict)
    thermal_state: Callable[[], Mapping[str, Mapping[str, float]]] | None = None


@dataclass(frozen=True, kw_only=True)
class RigRequest:
    """What a rig is asked for.

    `gear` and `motor` are the nominal ones. On a simulated rig `world` says which individuals are
    meant; what it leaves open follows from `serial` (the gear) and `seed` (the bench). `protocol`
    and its `parameters` are what a replay must have been recorded with. `configuration` is the file
    that describes a rig of hardware. `calendar_ns` is the calendar time at which the clock of a
    simulated rig begins; None: now.
    """

    gear: HarmonicDrive
    motor: ServoMotor
    mounting: Mounting = "circular-spline-fixed"
    gear_mounted: bool = True
    serial: str = ""
    protocol: str = ""
    parameters: Mapping[str, object] = field(default_factory=dict)
    seed: int = 0
    world: WorldChoice = field(default_factory=WorldChoice)
    sample_rate: float = 1000.0
    disc_inertia: float = 0.0
    configuration: Path | None = None
    calendar_ns: int | None = None
