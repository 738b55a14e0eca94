"""The simulated rig that implements the seam directly: no bus, no devices, the plant and its
instruments in virtual time.

`SimulatedRig.exchange` carries the whole state from block to block, draws noise as a function of
the cycle index and quantises set-points as the drive would, so that cutting a run into blocks of 1,
7, 100 or 1000 cycles does not change a single count. When the guard breaks at a row, the plant goes
back to the snapshot before it and runs exactly to that row.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.channel import Channel
from drivers.clock import Clock, VirtualClock
from drivers.counting import changes
from drivers.drive_state import POWERED_STATES, DriveState
from drivers.errors import DriverError
from drivers.port import Abilities, Command, DriveLimits, Guard, GuardWatch, Mode, RigDescription
from drivers.samples import CycleFlag, SampleBlock
from model import closed_loop
from model.gear import HarmonicDrive, Mounting
from model.kernels import loop_layout as at
from model.motor import ServoMotor
from model.units import REVOLUTION
from sim_backend.assembly import assemble
from sim_backend.faults import DeviceFault, Devices, Fault, PortFault, Sensed, SignalFault
from sim_backend.imperfections import Imperfections
from sim_backend.position_loop import PositionLead
from sim_backend.sensors import Latches
from sim_backend.servo_drive import SPEED_COUNT, ServoDrive
from sim_backend.world import FIRST_WORLD, ThermalState, World

Counts = NDArray[np.int64]

PIECE = 4096
"""Cycles simulated at a time; a guard is judged after each piece, so that a break costs at most one piece twice."""
_HEARTBEAT_CYCLES = 100
"""Cycles after which a drive that hears nothing makes its own quick stop."""
_JUMP_MARGIN = 1.5
"""An encoder that moves faster than this times the motor's highest speed has jumped."""
_JUMP_SLACK = 64
"""Counts that are never called a jump."""


@dataclass(frozen=True)
class _Snapshot:
    """Everything that a block changes."""

    plant: NDArray[np.float64]
    drive: DriveState
    latches: Latches
    previous: Counts | None
    last: tuple[Mode, float]
    altered: tuple[int, ...]
    """Rows that each fault has altered."""


class SimulatedRig:
    """A rig that is computed: motor, one gear (or none), torque port and both encoders, in virtual time.

    `gear` and `motor` are the individuals that are mounted, `world` draws everything else, `start` is
    how warm they are, if not as the room. `faults` are what will go wrong. With a `WallClock` it turns
    in real time. `by_position`: its drive is led by target positions (cyclic synchronous position).
    Raises `DriverError` for commands that a drive cannot take.
    """

    def __init__(
        self,
        gear: HarmonicDrive,
        motor: ServoMotor,
        imperfections: Imperfections | None = None,
        world: World = FIRST_WORLD,
        *,
        cycle_ns: int = 1_000_000,
        mounting: Mounting = "circular-spline-fixed",
        gear_mounted: bool = True,
        disc_inertia: float = 0.0,
        clock: Clock | None = None,
        faults: Sequence[Fault] = (),
        start: ThermalState | None = None,
        by_position: bool = False,
    ) -> None:
        if cycle_ns < 100_000:
            raise DriverError(
                "the SYNC period is too short",
                where="cycle_ns",
                value=cycle_ns,
                limit=">= 100000 ns",
            )
        self._gear, self._motor, self._mounted = gear, motor, gear_mounted
        self._assembly = assemble(
            gear,
            motor,
            imperfections or Imperfections(),
            world,
            cycle_ns=cycle_ns,
            mounting=mounting,
            gear_mounted=gear_mounted,
            disc_inertia=disc_inertia,
            start=start,
        )
        self._plant, self._instruments = self._assembly.plant, self._assembly.instruments
        self._sync = self._assembly.sync
        self._drive = ServoDrive(motor)
        self._plant.write_limits(self._drive.limits)
        self._lead = PositionLead(self._input_resolution, cycle_ns) if by_position else None
        self._clock: Clock = clock or VirtualClock()
        self._faults = tuple(faults)
        self._devices = Devices(self._plant, self._drive)
        self._watch = GuardWatch(self._instruments.channels, cycle_ns)
        self._cycle = 0
        self._opened_ns = 0
        self._open = False
        self._previous: Counts | None = None
        self._last: tuple[Mode, float] = (Mode.OFF, 0.0)
        self._jump_limit = self._jump_limits(gear.mounted_ratio(mounting), cycle_ns)

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels in the order of the columns of every block."""
        lead = self._lead
        if lead is None:
            return self._instruments.channels
        return [
            replace(channel, scale=lead.scale) if channel.name == names.TARGET_SPEED else channel
            for channel in self._instruments.channels
        ]

    @property
    def _input_resolution(self) -> int:
        """Counts per revolution of the motor's encoder."""
        by_name = {channel.name: channel for channel in self._instruments.channels}
        return round(REVOLUTION / by_name[names.INPUT_ANGLE].scale)

    @property
    def cycle_ns(self) -> int:
        """The nominal SYNC period [ns]."""
        return self._sync.cycle_ns

    @property
    def abilities(self) -> Abilities:
        """There is no bus that could be lost and no device that could tell; the drive is the simulated one."""
        return Abilities()

    @property
    def time_base(self) -> Literal["hardware", "device", "host", "virtual"]:
        """Each stamp names the true instant of its SYNC, as an adapter with hardware stamps would."""
        return "hardware"

    @property
    def line(self) -> None:
        """There are no devices behind this port that could be asked one by one."""

    def open(self) -> RigDescription:
        """Servo off, every device in operation; returns what is simulated and the truth."""
        if self._open:
            raise DriverError("is already open", where="simulated rig", remedy="Close it first.")
        self._open = True
        self._opened_ns = self._clock.monotonic_ns() - self._cycle * self.cycle_ns
        self._sync.start_ns = self._clock.calendar_ns() - self._cycle * self.cycle_ns
        motor = self._motor.name
        what = f"{self._gear.name} on {motor}" if self._mounted else f"bare {motor}"
        devices = {c.name: {"model": c.model, "long_name": c.long_name} for c in self.channels}
        return RigDescription("simulated", f"simulated rig: {what}", devices, self.truth)

    @property
    def input_speed(self) -> float:
        """The true speed of the input now [rad/s], whatever the counts say."""
        return self._plant.input_speed

    @property
    def thermal_state(self) -> ThermalState:
        """How warm the rig is now."""
        return self._plant.thermal_state

    @property
    def mean_temperatures(self) -> ThermalState:
        """How warm the rig was on average since it started."""
        return self._plant.mean_temperatures

    @property
    def is_powered(self) -> bool:
        """Whether the power stage may produce torque now."""
        return self._drive.state in POWERED_STATES

    @functools.cached_property
    def truth(self) -> dict[str, Any]:
        """Every effective parameter of this rig on this day (see `sim_backend.truth`)."""
        return self._assembly.truth()

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits into the drive's registers and return what they hold."""
        self._drive.limits = self._drive.stored(limits)
        self._plant.write_limits(self._drive.limits)
        return self._drive.limits

    def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
        """Run `cycles` SYNC cycles and return what was latched; fewer where the guard breaks or a stall begins."""
        targets = self._checked(command, cycles)
        available = self._before_stall(cycles)
        blocks: list[SampleBlock] = []
        done = 0
        while done < available:
            # Led by positions, each cycle rests on what was latched in the one before.
            most = 1 if self._lead is not None and command.mode is Mode.SPEED else PIECE
            count = min(most, available - done)
            block = self._guarded(command.mode, targets[done : done + count], guard)
            blocks.append(block)
            done += len(block)
            if block.broken is not None:
                break
        self._clock.wait_until_ns(self._opened_ns + self._cycle * self.cycle_ns)
        return _joined(blocks)

    def elapse(self, cycles: int) -> None:
        """Time passes with nobody commanding: the drive stops by its own watch."""
        self._sleep(cycles)

    def reset_fault(self) -> None:
        """Acknowledge a fault of the drive."""
        self._drive.reset_fault()

    def close(self) -> None:
        """Servo off and released; calling it again does nothing."""
        self._open = False

    def _checked(self, command: Command, cycles: int) -> Counts:
        """The set-points of a command as the drive receives them, in counts (cycles,); zeros without set-points."""
        where = "simulated rig"
        if not self._open:
            raise DriverError("is not open", where=where, remedy="Open it first.")
        if cycles < 1:
            raise DriverError("a block needs cycles", where=where, value=cycles, limit=">= 1")
        if command.mode in (Mode.OFF, Mode.QUICK_STOP):
            if len(command.target):
                raise DriverError(
                    f"{command.mode.value} takes no set-points",
                    where=where,
                    value=len(command.target),
                )
            return np.zeros(cycles, dtype=np.int64)
        if len(command.target) != cycles:
            raise DriverError(
                "a command needs one set-point per cycle",
                where=where,
                value=len(command.target),
                limit=str(cycles),
            )
        target = np.asarray(command.target, dtype=np.float64)
        counts = self._drive.quantised(command.mode, target)
        if self._lead is not None and command.mode is Mode.SPEED:
            return np.rint(target / self._lead.scale).astype(np.int64)
        return counts

    def _before_stall(self, cycles: int) -> int:
        """How many of the next cycles come back; raises if none does."""
        for fault in self._faults:
            if (
                isinstance(fault, PortFault)
                and fault.at_cycle < self._cycle + cycles
                and fault.end > self._cycle
            ):
                if fault.at_cycle > self._cycle:
                    cycles = fault.at_cycle - self._cycle
                else:
                    self._sleep(min(fault.end - self._cycle, _HEARTBEAT_CYCLES * 10))
                    fault.effects.refusals += 1
                    raise fault.error()
        return cycles

    def _sleep(self, cycles: int) -> None:
        """Time passes without data: the drive keeps its last set-point, then misses the heartbeat
        and stops by itself.
        """
        mode, target = self._last
        alone = min(cycles, _HEARTBEAT_CYCLES)
        for what, count in (
            (mode, alone),
            (Mode.QUICK_STOP if mode is not Mode.OFF else mode, cycles - alone),
        ):
            if count:
                values = np.full(count, target if what in (Mode.SPEED, Mode.TORQUE) else 0.0)
                rows, _ = self._simulate(what, values)
                self._instruments.pass_by(rows)
                self._cycle += count
        self._clock.wait_until_ns(self._opened_ns + self._cycle * self.cycle_ns)

    def _guarded(self, mode: Mode, targets: Counts, guard: Guard) -> SampleBlock:
        """One piece, cut at the first row that breaks the guard."""
        before = self._snapshot()
        counts, flags, stamps = self._piece(mode, targets)
        broken = self._watch.first_break(guard, counts, flags, stamps)
        if broken is not None and broken.row + 1 < len(targets):
            self._restore(before)
            counts, flags, stamps = self._piece(mode, targets[: broken.row + 1])
        self._watch.accept(counts, flags, stamps)
        block = SampleBlock(self._cycle, stamps, counts, flags, broken)
        self._cycle += len(counts)
        return block

    def _piece(self, mode: Mode, targets: Counts) -> tuple[Counts, NDArray[np.uint16], Counts]:
        """Simulate, sense, and let the signal faults fall: counts, flags, stamps."""
        rows, statuswords = self._simulate(mode, self._set_points(mode, targets))
        if self._lead is not None:
            self._lead.show(statuswords, mode)
        late = self._sync.lateness_ns(self._cycle, len(targets))
        none = np.zeros(len(targets), dtype=np.int64)
        shown = (targets if mode is Mode.SPEED else none, targets if mode is Mode.TORQUE else none)
        counts, flags = self._instruments.read(rows, self._cycle, late, statuswords, shown)
        sensed = Sensed(self._cycle, counts, flags, self._instruments.column, self._previous)
        for fault in self._faults:
            if isinstance(fault, SignalFault):
                fault.fall_on(sensed)
        self._flag_jumps(sensed)
        self._previous = counts[-1].copy()
        return counts, flags, self._sync.stamps_ns(self._cycle, late)

    def _set_points(self, mode: Mode, targets: Counts) -> NDArray[np.float64]:
        """Set-points (n,) in counts as the loop of the drive takes them [SI]."""
        lead = self._lead
        if lead is None or mode is not Mode.SPEED:
            if lead is not None:
                lead.leads = False
            count = self._drive.torque_count if mode is Mode.TORQUE else SPEED_COUNT
            return targets.astype(np.float64) * count
        position = self._position_now()
        if not lead.leads:
            lead.begin(position)
        return np.array([lead.demand(int(targets[0]), position)])

    def _position_now(self) -> int:
        """The input's count at the latest SYNC; before the first one, as it stands."""
        column = self._instruments.column[names.INPUT_ANGLE]
        if self._previous is not None:
            return int(self._previous[column])
        before, latches = self._plant.snapshot(), self._instruments.latches()
        none = np.zeros(1, dtype=np.int64)
        rows = self._plant.advance(closed_loop.OFF, np.zeros(1))
        counts, _ = self._instruments.read(rows, 0, none, none, (none, none))
        self._plant.restore(before)
        self._instruments.restore(latches)
        return int(counts[0, column])

    def _simulate(
        self, mode: Mode, targets: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], Counts]:
        """Advance the plant over the targets [SI], cut where device faults begin and end: truth
        rows and statuswords.
        """
        rows = np.empty((len(targets), at.ROW_SIZE))
        statuswords = np.empty(len(targets), dtype=np.int64)
        edges = self._edges(len(targets))
        for start, stop in itertools.pairwise(edges):
            acting, values = self._act(mode, targets[start:stop], self._cycle + start)
            for stretch in self._drive.stretches(acting, stop - start):
                part = slice(start + stretch.start, start + stretch.stop)
                rows[part] = self._plant.advance(
                    stretch.loop_mode, values[stretch.start : stretch.stop]
                )
                statuswords[part] = stretch.statusword
            self._last = (acting, float(values[-1]))
        return rows, statuswords

    def _edges(self, cycles: int) -> list[int]:
        """Rows at which a device fault begins or ends, with both ends of the block."""
        inside = {0, cycles}
        for fault in self._faults:
            if isinstance(fault, DeviceFault):
                inside.update(
                    e - self._cycle
                    for e in (fault.at_cycle, fault.end)
                    if 0 < e - self._cycle < cycles
                )
        return sorted(inside)

    def _act(
        self, mode: Mode, targets: NDArray[np.float64], cycle: int
    ) -> tuple[Mode, NDArray[np.float64]]:
        """Let the device faults of this cycle act; returns the mode and set-points that the drive really follows."""
        devices = self._devices
        devices.forced, devices.keeps_turning, devices.load = None, False, 0.0
        for fault in self._faults:
            if isinstance(fault, DeviceFault) and fault.active(cycle):
                fault.fall_on(devices, cycle)
        self._plant.load = devices.load
        if devices.keeps_turning and mode in (Mode.OFF, Mode.QUICK_STOP):
            devices.forced = self._last
        if devices.forced is not None and self._drive.state is DriveState.ENABLED:
            mode, target = devices.forced
            return mode, np.full(len(targets), target)
        return mode, targets

    def _flag_jumps(self, sensed: Sensed) -> None:
        """Mark cycles in which an encoder moved further than the gear can turn."""
        before = sensed.counts[0] if sensed.previous is None else sensed.previous
        for name, limit in self._jump_limit.items():
            column = sensed.column[name]
            moved = changes(sensed.counts[:, column], int(before[column]))
            sensed.flags[np.abs(moved) > limit] |= np.uint16(CycleFlag.JUMPED)

    def _jump_limits(self, ratio: float, cycle_ns: int) -> dict[str, float]:
        """Counts per cycle beyond which an encoder has jumped."""
        turned = _JUMP_MARGIN * self._motor.maximum_speed * cycle_ns * 1e-9
        scale = {c.name: c.scale for c in self.channels}
        return {
            names.INPUT_ANGLE: turned / scale[names.INPUT_ANGLE] + _JUMP_SLACK,
            names.OUTPUT_ANGLE: turned / ratio / scale[names.OUTPUT_ANGLE] + _JUMP_SLACK,
        }

    def _snapshot(self) -> _Snapshot:
        return _Snapshot(
            self._plant.snapshot(),
            self._drive.state,
            self._instruments.latches(),
            self._previous,
            self._last,
            tuple(fault.effects.rows for fault in self._faults),
        )

    def _restore(self, snapshot: _Snapshot) -> None:
        self._plant.restore(snapshot.plant)
        self._drive.state = snapshot.drive
        self._instruments.restore(snapshot.latches)
        self._previous, self._last = snapshot.previous, snapshot.last
        for fault, rows in zip(self._faults, snapshot.altered, strict=True):
            fault.effects.rows = rows


def _joined(blocks: list[SampleBlock]) -> SampleBlock:
    """Consecutive pieces as one block."""
    if len(blocks) == 1:
        return blocks[0]
    broken = blocks[-1].broken
    if broken is not None:
        broken = replace(broken, row=broken.row + sum(len(b) for b in blocks[:-1]))
    return SampleBlock(
        blocks[0].first_cycle,
        np.concatenate([b.time_ns for b in blocks]),
        np.concatenate([b.counts for b in blocks]),
        np.concatenate([b.flags for b in blocks]),
        broken,
    )
