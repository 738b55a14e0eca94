"""A simulated rig that will go wrong: the direct rig or the one on the wire, with things that happen at given rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from drivers.channel import Channel
from drivers.clock import VirtualClock
from drivers.port import Abilities, Command, DirectLine, DriveLimits, Guard, RigDescription
from drivers.samples import SampleBlock
from model.gear import HarmonicDrive
from model.motor import ServoMotor
from rig.bench.backends.order import Order
from rig.bench.backends.simulated import (
    box_port,
    position_config,
    profile_config,
    reference_config,
    reference_device,
    wire_config,
    wire_port,
)
from rig.errors import ConfigurationError, RigError
from rig.run.stop import StopRequest
from sim_backend.direct import SimulatedRig
from sim_backend.faults import Fault
from sim_backend.individuals import individual_gear
from sim_backend.wire.bench import WireBench
from sim_backend.world import World

Carrier = Literal["sim", "wire", "wire-box", "wire-csp", "wire-pv", "wire-analog"]
CARRIERS: tuple[Carrier, ...] = ("sim", "wire", "wire-box", "wire-csp", "wire-pv", "wire-analog")
"""The direct rig, and those on the wire: a drive by target velocity (csv), the same with a counter box, one by target
position (csp), one by profile velocity (pv), and an amplifier by analog reference.
"""
SPEED_ONLY: tuple[Carrier, ...] = ("wire-analog",)
"""Which of them take no set-points of torque."""
IN_PAIRS: tuple[Carrier, ...] = ("sim", "wire")
"""On which of them faults happen two at a time."""

START_NS = 1_800_000_000_000_000_000
"""The calendar of a drill: the same every time, so that its files are the same."""
_PRESSED = ("nothing", "STOP", "ABORT")
"""The operator's words by their level."""
MILLISECOND = 1_000_000
STANDING_SPEED = 1.0
"""rad/s at the input below which the simulated motor is said to stand."""
LARGEST_EXCHANGES = 4000
"""Exchanges after which a run is said to hang."""


class DrillHungError(RigError):
    """A run that did not come to its end within the cycles that a drill may take."""


class Plant(Protocol):
    """The truth of a simulated rig, whatever its devices and its counts say."""

    @property
    def input_speed(self) -> float: ...

    @property
    def is_powered(self) -> bool: ...


@dataclass
class Happening:
    """What happens at a row (a fault of the rig, a press of the operator), and the facts that show that it has.

    `prepare` changes the devices on the wire before they are opened; `at_start`: the fault is there
    before the rig is opened; `limits_factor` is what the drive's limits read back as, over what was
    written.
    """

    row: int
    fault: Callable[[int], Fault] | None = None
    press: Callable[[StopRequest], None] | None = None
    prepare: Callable[[WireBench], None] | None = None
    at_start: bool = False
    limits_factor: float = 1.0
    onset_ns: int | None = field(default=None, init=False)
    """The clock's reading at the SYNC in which it happened."""
    injected: Fault | None = field(default=None, init=False)
    facts: list[str] = field(default_factory=list, init=False)

    def evidence(self) -> str:
        """What shows that it has happened; empty where nothing does."""
        if self.fault is None:
            return "; ".join(self.facts)
        # A press that only gives the fault its occasion proves nothing.
        effects = self.injected.effects.sentence() if self.injected is not None else ""
        return "; ".join([*self.facts, effects]) if effects else ""

    def before_opening(self, bench: WireBench) -> None:
        """Change the devices, and inject a fault that is to be there from the start."""
        if self.prepare is not None:
            before = _objects(bench)
            self.prepare(bench)
            after = _objects(bench)
            changed = [key for key in after if after[key] != before[key]]
            self.facts += [
                f"node {node}: 0x{index:04X} holds {after[node, index, sub]} instead of {before[node, index, sub]}"
                for node, index, sub in changed
            ]
        if self.at_start:
            self._inject(bench, bench.cycle)

    def read_back(self, limits: DriveLimits) -> DriveLimits:
        """The drive's limits as they are said to read back."""
        if self.limits_factor == 1.0:
            return limits
        self.facts.append(
            f"the drive's limits read back as {self.limits_factor:g} of what they are"
        )
        return DriveLimits(*(self.limits_factor * value for value in vars(limits).values()))

    def begin(self, stop: StopRequest, bench: WireBench | None, ahead: int, now_ns: int) -> None:
        """It happens, so many cycles ahead."""
        self.onset_ns = now_ns
        if self.press is not None:
            before = stop.level
            self.press(stop)
            if stop.level > before:
                self.facts.append(f"{_PRESSED[stop.level]} pressed")
        if bench is not None and not self.at_start:
            self._inject(bench, bench.cycle + ahead)

    def _inject(self, bench: WireBench, cycle: int) -> None:
        if self.fault is not None:
            self.injected = self.fault(cycle)
            bench.inject(self.injected)


def _objects(bench: WireBench) -> dict[tuple[int, int, int], float | str | bytes]:
    """What the devices' writable objects hold, by node, index and sub-index."""
    return {
        (slave.node_id, entry.index, entry.sub): slave.dictionary.value(entry.index, entry.sub)
        for slave in bench.slaves
        for entry in slave.dictionary
        if entry.access == "rw"
    }


@dataclass(kw_only=True)
class DrilledRig:
    """A port that lets things happen at their rows; everything else it hands on."""

    port: Any
    plant: Plant
    clock: VirtualClock
    happenings: Sequence[Happening]
    stop: StopRequest
    bench: WireBench | None = None
    rows: int = 0
    exchanges: int = 0
    moving_row: int = 0
    """The last row at whose end the motor turned or had power, in truth."""
    is_prepared: bool = False

    @property
    def stands(self) -> bool:
        """The truth: whether the motor stands without power now."""
        return abs(self.plant.input_speed) < STANDING_SPEED and not self.plant.is_powered

    def let_time_pass(self, seconds: float) -> None:
        """Time passes with nobody commanding: the devices' own watches act."""
        if self.bench is None:
            self.port.elapse(round(seconds * 1e9 / self.cycle_ns))
            return
        for _ in range(round(seconds * 1e3)):
            self.clock.advance_ns(MILLISECOND)
            self.bench.elapse()

    def prepare(self) -> None:
        """What is to be there before the rig is opened; once."""
        if self.bench is not None and not self.is_prepared:
            for happening in self.happenings:
                happening.before_opening(self.bench)
        self.is_prepared = True

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

    @property
    def abilities(self) -> Abilities:
        """What the rig behind it can do."""
        return self.port.abilities

    def open(self) -> RigDescription:
        """Open the rig behind it; what is to be there from the start happens first."""
        self.prepare()
        return self.port.open()

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits; they may read back as others."""
        found = self.port.write_limits(limits)
        for happening in self.happenings:
            found = happening.read_back(found)
        return found

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
        for happening in self.happenings:
            if happening.onset_ns is None and self.rows + cycles > happening.row:
                ahead = max(happening.row - self.rows, 0)
                onset = self.clock.monotonic_ns() + ahead * self.cycle_ns
                happening.begin(self.stop, self.bench, ahead, onset)
        block = self.port.exchange(command, cycles, guard)
        self.rows += len(block)
        if not self.stands:
            self.moving_row = self.rows
        return block


def drilled_rig(
    carrier: str,
    gear: HarmonicDrive,
    motor: ServoMotor,
    happenings: Sequence[Happening],
    stop: StopRequest,
    seed: int,
) -> DrilledRig:
    """A simulated rig to which things happen. Raises `ConfigurationError` for any rig that is not simulated."""
    refuse_hardware(carrier)
    clock = VirtualClock(START_NS)
    individual = individual_gear(gear, seed)
    if carrier != "sim":
        reference = None
        if carrier == "wire-analog":
            reference = reference_device(Order(protocol="", gear=gear, motor=motor), motor)
        bench = WireBench(individual, motor, world=World.of(seed), clock=clock, reference=reference)
        if carrier == "wire-box":
            port = box_port(bench, motor, has_guard=True)
        elif carrier == "wire-csp":
            port = wire_port(bench, motor, position_config(bench, motor, has_guard=True))
        elif carrier == "wire-pv":
            port = wire_port(bench, motor, profile_config(bench, motor, has_guard=True))
        elif reference is not None:
            port = wire_port(bench, motor, reference_config(bench, motor, has_guard=True))
        else:
            port = wire_port(bench, motor, wire_config(bench, motor, has_guard=True))
        return DrilledRig(
            port=port, plant=bench, clock=clock, happenings=happenings, stop=stop, bench=bench
        )
    for happening in happenings:
        # The direct rig is handed its faults when it is made: there a row is a cycle.
        happening.injected = happening.fault and happening.fault(happening.row)
    faults = [happening.injected for happening in happenings if happening.injected is not None]
    direct = SimulatedRig(individual, motor, world=World.of(seed), clock=clock, faults=faults)
    return DrilledRig(port=direct, plant=direct, clock=clock, happenings=happenings, stop=stop)


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
