"""A simulated rig that will go wrong: the direct rig or the one on the wire, with a fault that
begins at a given row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from drivers.channel import Channel
from drivers.clock import Clock, VirtualClock
from drivers.port import Command, DirectLine, DriveLimits, Guard, RigDescription
from drivers.samples import SampleBlock
from model.gear import HarmonicDrive
from model.motor import ServoMotor
from rig.bench.backends.simulated import wire_config, wire_port
from rig.errors import ConfigurationError, RigError
from rig.run.stop import StopRequest
from sim_backend.direct import SimulatedRig
from sim_backend.faults import Fault
from sim_backend.imperfections import individual_gear
from sim_backend.wire.bench import WireBench

Carrier = Literal["sim", "wire"]
CARRIERS: tuple[Carrier, ...] = ("sim", "wire")

START_NS = 1_800_000_000_000_000_000
"""The calendar of a drill: the same every time, so that its files are the same."""
STANDING_SPEED = 1.0
"""rad/s at the input below which the simulated motor is said to stand."""
LARGEST_EXCHANGES = 4000
"""Exchanges after which a run is said to hang."""


class DrillHungError(RigError):
    """A run that did not come to its end within the cycles that a drill may take."""


@dataclass(frozen=True)
class Happening:
    """What happens in a drill, and at which row: a fault of the rig, a press of the operator, or neither."""

    row: int
    fault: Callable[[int], Fault] | None = None
    press: Callable[[StopRequest], None] | None = None
    prepare: Callable[[WireBench], None] | None = None
    """Changes the devices on the wire before they are opened."""
    at_start: bool = False
    """The fault is there before the rig is opened."""
    limits_factor: float = 1.0
    """What the drive's limits read back as, over what was written."""


@dataclass(kw_only=True)
class DrilledRig:
    """A port that lets something happen at a row; everything else it hands on."""

    port: Any
    clock: Clock
    happening: Happening
    stop: StopRequest
    bench: WireBench | None = None
    rows: int = 0
    exchanges: int = 0
    happened: bool = False
    happened_ns: int | None = None
    """The clock's reading at the SYNC in which it happened."""

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels of the rig behind it."""
        return self.port.channels

    @property
    def cycle_ns(self) -> int:
        """The SYNC period of the rig behind it [ns]."""
        return self.port.cycle_ns

    @property
    def time_base(self) -> Literal["hardware", "device", "host", "virtual"]:
        """The time base of the rig behind it."""
        return self.port.time_base

    @property
    def line(self) -> DirectLine | None:
        """The line to the devices of the rig behind it."""
        return self.port.line

    def open(self) -> RigDescription:
        """Open the rig behind it; a fault that is to be there from the start happens first."""
        if self.bench is not None and self.happening.prepare is not None:
            self.happening.prepare(self.bench)
        if self.bench is not None and self.happening.at_start and self.happening.fault is not None:
            self.bench.inject(self.happening.fault(self.bench.cycle))
            self.happened = True
        return self.port.open()

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits; they may read back as others."""
        found = self.port.write_limits(limits)
        return DriveLimits(
            *(self.happening.limits_factor * value for value in vars(found).values())
        )

    def reset_fault(self) -> None:
        """Acknowledge a fault."""
        self.port.reset_fault()

    def close(self) -> None:
        """Close the rig behind it."""
        self.port.close()

    def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
        """One exchange; in the one that holds the row, it happens."""
        self.exchanges += 1
        if self.exchanges > LARGEST_EXCHANGES:
            allowed = f"{LARGEST_EXCHANGES} exchanges"
            raise DrillHungError(
                "the run does not end", where="drill", value=self.exchanges, limit=allowed
            )
        happening = self.happening
        if not self.happened and self.rows + cycles > happening.row:
            self.happened = True
            self.happened_ns = (
                self.clock.monotonic_ns() + max(happening.row - self.rows, 0) * self.cycle_ns
            )
            if happening.press is not None:
                happening.press(self.stop)
            if happening.fault is not None and self.bench is not None:
                self.bench.inject(
                    happening.fault(self.bench.cycle + max(happening.row - self.rows, 0))
                )
        block = self.port.exchange(command, cycles, guard)
        self.rows += len(block)
        return block


class DrilledWireRig(DrilledRig):
    """A drilled rig whose devices tell events and whose acquisition keeps figures."""

    def events(self) -> list[Any]:
        """Events of the devices."""
        return self.port.events()

    def acquisition(self) -> Any:
        """Figures of the acquisition."""
        return self.port.acquisition()


def drilled_rig(
    carrier: str,
    gear: HarmonicDrive,
    motor: ServoMotor,
    happening: Happening,
    stop: StopRequest,
    seed: int,
) -> DrilledRig:
    """A simulated rig with a happening. Raises `ConfigurationError` for any rig that is not simulated."""
    refuse_hardware(carrier)
    clock = VirtualClock(START_NS)
    individual = individual_gear(gear, seed)
    if carrier == "sim":
        faults = () if happening.fault is None else (happening.fault(happening.row),)
        return DrilledRig(
            port=SimulatedRig(individual, motor, seed=seed, clock=clock, faults=faults),
            clock=clock,
            happening=happening,
            stop=stop,
        )
    bench = WireBench(individual, motor, seed=seed, clock=clock)
    port = wire_port(bench, motor, wire_config(bench, motor, has_guard=True))
    return DrilledWireRig(port=port, clock=clock, happening=happening, stop=stop, bench=bench)


def refuse_hardware(carrier: str) -> None:
    """Faults are never injected into a real rig."""
    if carrier not in CARRIERS:
        raise ConfigurationError(
            "faults are only drilled on simulated rigs",
            where="--backend",
            value=repr(carrier),
            limit=", ".join(CARRIERS),
            remedy="Leave --backend away, or name one of these.",
        )
