"""The least rig that a run loop needs: an ideal drive behind the seam, with faults that a test scripts by cycle."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, Literal

import numpy as np

from drivers.channel import Channel, encoder_channel
from drivers.clock import VirtualClock
from drivers.drive_state import STATUSWORD_OF, DriveState
from drivers.errors import BusLostError
from drivers.port import (
    Abilities,
    Command,
    DirectLine,
    DriveLimits,
    Guard,
    GuardWatch,
    Mode,
    RigDescription,
)
from drivers.samples import CycleFlag, SampleBlock
from experiments.contract import Evidence, Experiment
from experiments.recording import Event, Recording, Segment
from experiments.result import Result
from experiments.steps.vocabulary import Step
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import REVOLUTION
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order
from rig.run.dry_run import PlannedRun, plan_run
from rig.run.parts import SessionParts

RATIO = 120.0
FRICTION = 0.08


@dataclass(kw_only=True)
class Physics:
    """State that a guard break rolls back."""

    cycle: int = 0
    angle: float = 0.3
    speed: float = 0.0
    state: DriveState = DriveState.READY
    wait: int = 0
    output_extra: float = 0.0
    output_stuck: float | None = None
    torque_extra: float = 0.0
    blocked: bool = False
    runaway: float = 0.0
    short_of: float = 0.0
    """rad/s by which the drive keeps below its set-point."""
    port_offset: float = 0.0
    """N m that the port shows and the drive does not."""
    ignore_quick_stop: bool = False
    ignore_off: bool = False
    ignore_ramp: bool = False
    slowing: float = 5000.0
    """rad/s2 of a quick stop, and of coasting."""
    fault: bool = False
    flags: int = 0
    temperature: float = 25.0
    drive_torque_gain: float = 1.0
    port_tremble: int = 0
    index_input: int = 0
    index_output: int = 0
    index_seen: int = 0


@dataclass(kw_only=True)
class FakeRig:
    """An ideal `RigPort`. `script` maps a cycle to what happens at it; `limits_read` changes what
    the limits read back as.
    """

    script: dict[int, Callable[[FakeRig], None]] = field(default_factory=dict)
    limits_read: Callable[[DriveLimits], DriveLimits] = lambda limits: limits
    period_ns: int = 1_000_000
    physics: Physics = field(default_factory=Physics)
    dead: bool = False
    empty: bool = False
    skip: int = 0
    time_offset: int = 0
    closed: bool = False
    exchanged: list[tuple[Mode, int]] = field(default_factory=list)
    limits: DriveLimits | None = None
    clock: VirtualClock = field(default_factory=lambda: VirtualClock(1_700_000_000_000_000_000))
    time_base: Literal["hardware", "device", "host", "virtual"] = "virtual"
    line: DirectLine | None = None
    abilities: Abilities = field(default_factory=Abilities)

    def __post_init__(self) -> None:
        self._watch = GuardWatch(self.channels)

    @property
    def cycle_ns(self) -> int:
        return self.period_ns

    @property
    def channels(self) -> Sequence[Channel]:
        return (
            encoder_channel("input_angle", lines=8192, multiplication=4),
            encoder_channel("output_angle", lines=18000, multiplication=4),
            Channel(name="torque", unit="N m", scale=1e-4),
            Channel(name="drive_torque", unit="N m", scale=6.37e-4),
            Channel(name="target_speed", unit="rad/s", scale=1e-4),
            Channel(name="statusword", unit="1", scale=1.0),
            Channel(name="housing_temperature", unit="degC", scale=0.1),
            encoder_channel("input_index", lines=8192, multiplication=4),
            encoder_channel("output_index", lines=18000, multiplication=4),
            Channel(name="index_seen", unit="1", scale=1.0),
            Channel(name="target_torque", unit="N m", scale=1e-4),
        )

    def open(self) -> RigDescription:
        return RigDescription(
            "simulated", "an ideal rig", {"drive": {"model": "ideal"}}, {"friction": FRICTION}
        )

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        self.limits = limits
        return self.limits_read(limits)

    def reset_fault(self) -> None:
        self.physics.fault = False

    def close(self) -> None:
        self.closed = True

    def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
        if self.dead:
            raise BusLostError("the bus is gone", where="fake")
        self.exchanged.append((command.mode, cycles))
        if self.empty:
            return self._block([], [], None)
        rows, flags, states = [], [], []
        first = self.physics.cycle + self.skip
        self.physics.cycle, self.skip = first, 0
        for k in range(cycles):
            happening = self.script.get(self.physics.cycle)
            if happening is not None:
                happening(self)
                if self.dead:
                    raise BusLostError("the bus is gone", where="fake")
            target = float(command.target[k]) if len(command.target) else 0.0
            self._step(command.mode, target)
            rows.append(self._row(command.mode, target))
            flags.append(self.physics.flags)
            self.physics.cycle += 1
            states.append(copy.copy(self.physics))
        counts = np.array(rows, dtype=np.int64).reshape(-1, len(self.channels))
        marks = np.array(flags, dtype=np.uint16)
        broken = self._watch.first_break(guard, counts, marks)
        if broken is not None:
            counts, marks = counts[: broken.row + 1], marks[: broken.row + 1]
            self.physics = states[broken.row]
        self._watch.accept(counts, marks)
        times = (first + np.arange(len(counts))) * self.cycle_ns + self.time_offset
        self.clock.wait_until_ns(int(times[-1]))
        return SampleBlock(first, times, counts, marks, broken)

    def _block(self, rows: list[Any], flags: list[int], broken: None) -> SampleBlock:
        shape = (0, len(self.channels))
        return SampleBlock(
            self.physics.cycle,
            np.empty(0, np.int64),
            np.empty(shape, np.int64),
            np.empty(0, np.uint16),
        )

    def _step(self, mode: Mode, target: float) -> None:
        p, dt = self.physics, self.cycle_ns * 1e-9
        self._state_machine(mode)
        enabled = p.state is DriveState.ENABLED
        if p.runaway:
            p.speed += p.runaway * dt
        elif enabled and mode is Mode.SPEED and not (p.ignore_ramp and target == 0.0):
            limit = self.limits.acceleration * dt if self.limits else math.inf
            wanted = target - p.short_of if target else 0.0
            p.speed += max(-limit, min(limit, 0.5 * (wanted - p.speed)))
            if target == 0.0 and abs(p.speed) < 1e-3:
                p.speed = 0.0
        elif enabled and mode is Mode.TORQUE:
            drive = target - math.copysign(FRICTION, target)
            if abs(target) > FRICTION:
                p.speed += drive / 7.4e-5 * dt
            else:
                p.speed = 0.0
        elif not (p.ignore_off or p.ignore_quick_stop or p.ignore_ramp):
            slow = p.slowing * dt
            p.speed -= math.copysign(min(slow, abs(p.speed)), p.speed)
        if p.blocked:
            p.speed = 0.0
        before = p.angle
        p.angle += p.speed * dt
        if math.floor(p.angle / REVOLUTION) != math.floor(before / REVOLUTION):
            turn = max(math.floor(p.angle / REVOLUTION), math.floor(before / REVOLUTION))
            p.index_input = round(turn * 32768)
            p.index_seen |= 1

    def _state_machine(self, mode: Mode) -> None:
        p = self.physics
        if p.fault:
            p.state = DriveState.FAULT
        elif mode is Mode.OFF:
            if not p.ignore_off:
                p.state = DriveState.READY
            p.wait = 0
        elif mode is Mode.QUICK_STOP:
            if not p.ignore_quick_stop and p.state in (DriveState.ENABLED, DriveState.QUICK_STOP):
                p.state = DriveState.QUICK_STOP if p.speed else DriveState.SWITCH_ON_DISABLED
        elif p.state is not DriveState.ENABLED:
            p.wait += 1
            if p.wait > 3:
                p.state = DriveState.ENABLED

    def _row(self, mode: Mode, target: float) -> list[int]:
        p = self.physics
        output = -p.angle / RATIO + p.output_extra
        if p.output_stuck is not None:
            output = p.output_stuck
        torque = math.copysign(FRICTION, p.speed) if p.speed else 0.0
        if mode is Mode.TORQUE and p.state is DriveState.ENABLED:
            torque = target
        torque += p.torque_extra
        return [
            math.floor(p.angle / REVOLUTION * 32768),
            math.floor(output / REVOLUTION * 72000),
            round((torque + p.port_offset) / 1e-4) + p.port_tremble * (p.cycle % 2),
            round(p.drive_torque_gain * torque / 6.37e-4),
            round(target * 1e4) if mode is Mode.SPEED else 0,
            STATUSWORD_OF[p.state],
            round(p.temperature / 0.1),
            p.index_input,
            p.index_output,
            p.index_seen,
            round(target * 1e4) if mode is Mode.TORQUE else 0,
        ]


@dataclass(kw_only=True)
class ListRun:
    """An `OpenRun` and its recorder in memory; `fail_after` rows it fails as a full disk would."""

    run_id: str = "00001-fake-G1"
    part: Path = Path("nowhere.h5.part")
    header: Any = field(default_factory=lambda: SimpleNamespace(columns=("not read",)))
    blocks: list[SampleBlock] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outcome: str | None = None
    abandoned: bool = False
    acquisition: dict[str, Any] = field(default_factory=dict)
    fail_after: float = math.inf

    @property
    def recorder(self) -> ListRun:
        return self

    @property
    def rows(self) -> int:
        return sum(len(block) for block in self.blocks)

    @property
    def counts(self) -> np.ndarray:
        return np.concatenate([block.counts for block in self.blocks])

    def put(self, block: SampleBlock) -> None:
        from rig.errors import RunFileError

        if self.rows > self.fail_after:
            raise RunFileError("the disk is full", where="fake")
        self.blocks.append(block)

    def segment(self, segment: Segment) -> None:
        self.segments.append(segment)

    def event(self, event: Event) -> None:
        self.events.append(event)

    def flush(self) -> None:
        pass

    def close(
        self, outcome: str, end_time: str = "", acquisition: Mapping[str, Any] | None = None
    ) -> Path:
        self.outcome = outcome
        self.acquisition = dict(acquisition or {})
        return self.part

    def abandon(self) -> None:
        self.abandoned = True

    def codes(self) -> list[str]:
        return [event.code for event in self.events]


@dataclass(frozen=True)
class NoChoice:
    """The parameters of a protocol made of literal steps."""


def experiment_of(steps: Iterable[Step], gear_mounted: bool = True) -> Experiment:
    kept = tuple(steps)

    def plan(parameters: Any, gear: HarmonicDrive) -> Iterator[Step]:
        return iter(kept)

    def analyse(recording: Recording, evidence: Evidence) -> Result:
        return Result(run=recording.metadata.run_id, kind="literal", estimates={})

    return Experiment(
        name="literal",
        title="literal steps",
        summary="",
        parameters=NoChoice,
        plan=plan,
        analyse=analyse,
        gear_mounted=gear_mounted,
    )


def planned_of(*steps: Step, gear_mounted: bool = True) -> PlannedRun:
    return plan_run(experiment_of(steps, gear_mounted), NoChoice(), shipped_gear(), shipped_motor())


def parts_of(
    planned: PlannedRun,
    rig: Any,
    folder: Path,
    cycles: int = 100,
    *,
    name: str = "fake",
    said: Mapping[str, Any] = MappingProxyType({}),
    **more: Any,
) -> SessionParts:
    """What a session of a planned run needs on a rig that is made for a test; `said` are fields of its order."""
    order = Order(
        protocol=planned.experiment.name,
        gear=planned.gear,
        motor=planned.motor,
        folder=folder,
        **said,
    )
    return SessionParts(
        order=order,
        planned=planned,
        rig=AssembledRig(name=name, port=rig, clock=rig.clock),
        cycles=cycles,
        **more,
    )


INCOMPLETE = int(CycleFlag.INCOMPLETE)
