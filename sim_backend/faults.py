"""What can go wrong with a simulated rig, each at a given SYNC cycle: for drills and tests of engine and supervisor.

A `DeviceFault` acts on the devices before a stretch of cycles is simulated, a `SignalFault` changes
counts and flags of a block after it was sensed, a `PortFault` keeps the block from coming at all.
All are pure functions of the cycle index and the row before the block, so that a fault falls on the
same cycle however the run is cut into blocks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names
from drivers.errors import BusLostError, DriverError, StaleDataError
from drivers.port import Mode
from drivers.samples import CycleFlag
from sim_backend.plant import Plant
from sim_backend.servo_drive import ServoDrive

_FOREVER = 2**62
"""A number of cycles that never end."""
_ADC_FULL_SCALE = 32767
"""Counts at the end of the torque port's converter."""


@dataclass
class Devices:
    """What a device fault may touch. `forced` replaces the command's mode and set-point [SI] while it is not None."""

    plant: Plant
    drive: ServoDrive
    forced: tuple[Mode, float] | None = None
    keeps_turning: bool = False
    load: float = 0.0


@dataclass
class Sensed:
    """A block on its way to the caller: `previous` is the row before it, None before the first."""

    first_cycle: int
    counts: NDArray[np.int64]
    flags: NDArray[np.uint16]
    column: Mapping[str, int]
    previous: NDArray[np.int64] | None

    def rows(self, start: int, stop: int) -> slice:
        """The rows of this block that lie in cycles [start, stop)."""
        n = len(self.flags)
        return slice(
            min(max(start - self.first_cycle, 0), n), min(max(stop - self.first_cycle, 0), n)
        )

    def grown(self, start: int, stop: int, per_cycle: float) -> tuple[slice, NDArray[np.int64]]:
        """The rows in cycles [start, stop), and in each the counts that have come to be since `start`."""
        rows = self.rows(start, stop)
        cycles = self.first_cycle + np.arange(rows.start, rows.stop, dtype=np.int64) - start + 1
        return rows, np.rint(per_cycle * cycles).astype(np.int64)

    def held(self, rows: slice, channel: str) -> int:
        """The value of a channel in the row before `rows` (the first row's own if there is none)."""
        column = self.column[channel]
        if rows.start > 0:
            return int(self.counts[rows.start - 1, column])
        return int(self.counts[0, column] if self.previous is None else self.previous[column])


@dataclass
class Effects:
    """What a fault has really done so far, counted by whoever lets it act: a fault may be there and do nothing.

    `since` is the first cycle in which it acted on devices or mechanics; `frames` were dropped,
    altered, added or held back (answers of the readout as well); `rows` of counts and marks and
    `stamps` of SYNCs differ; `refusals` are calls of the computer that found no bus or no data.
    """

    since: int | None = None
    frames: int = 0
    rows: int = 0
    stamps: int = 0
    refusals: int = 0

    def __bool__(self) -> bool:
        return bool(self.sentence())

    def acted(self, cycle: int) -> None:
        """Devices or mechanics were acted upon in this cycle."""
        self.since = cycle if self.since is None else self.since

    def sentence(self) -> str:
        """What happened, in words; empty where nothing has."""
        counted = (
            (self.frames, "frames dropped or altered"),
            (self.rows, "rows of counts or marks altered"),
            (self.stamps, "time stamps shifted"),
            (self.refusals, "calls found no bus or no data"),
        )
        words = [] if self.since is None else [f"acted on the devices from cycle {self.since} on"]
        return ", ".join(words + [f"{what}: {count}" for count, what in counted if count])


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong from `at_cycle` on, for `cycles` cycles. `effects` is no part of its value."""

    at_cycle: int
    cycles: int = field(default=_FOREVER, kw_only=True)
    effects: Effects = field(default_factory=Effects, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.at_cycle < 0 or self.cycles < 1:
            raise DriverError(
                "a fault needs a cycle to begin at and a length",
                where=type(self).__name__,
                value=f"at_cycle {self.at_cycle}, cycles {self.cycles}",
                limit="at_cycle >= 0, cycles >= 1",
            )

    @property
    def end(self) -> int:
        """The first cycle after it."""
        return self.at_cycle + self.cycles

    def active(self, cycle: int) -> bool:
        """Whether it acts in this cycle."""
        return self.at_cycle <= cycle < self.end


class DeviceFault(Fault):
    """A fault of a device or of the mechanics; blocks are cut where it begins and ends."""

    def act(self, devices: Devices, cycle: int) -> None:
        """Called before the stretch that begins with `cycle`, while the fault is active."""

    def fall_on(self, devices: Devices, cycle: int) -> None:
        """Act, and count it."""
        self.act(devices, cycle)
        self.effects.acted(cycle)


class SignalFault(Fault):
    """A fault of what is measured or of how it arrives."""

    def corrupt(self, sensed: Sensed) -> None:
        """Change counts and flags of a block in place."""

    def fall_on(self, sensed: Sensed) -> None:
        """Corrupt a block that the fault's time reaches, and count the rows that differ."""
        rows = sensed.rows(self.at_cycle, self.end)
        counts, flags = sensed.counts[rows].copy(), sensed.flags[rows].copy()
        self.corrupt(sensed)
        differs = np.any(counts != sensed.counts[rows], axis=1) | (flags != sensed.flags[rows])
        self.effects.rows += int(np.count_nonzero(differs))


class PortFault(Fault):
    """A fault of the line between rig and computer: the block does not come."""

    def error(self) -> DriverError:
        """What `exchange` raises."""
        raise TypeError(f"{type(self).__name__} has no error of its own")


@dataclass(frozen=True)
class DriveFault(DeviceFault):
    """The drive trips by itself: power stage off, FAULT REACTION ACTIVE, then FAULT until it is reset."""

    def act(self, devices: Devices, cycle: int) -> None:
        if cycle == self.at_cycle:
            devices.drive.trip()


@dataclass(frozen=True)
class QuickStopIgnored(DeviceFault):
    """The drive does not obey a quick stop (nor servo off): it goes on with its last set-point."""

    def act(self, devices: Devices, cycle: int) -> None:
        devices.keeps_turning = True


@dataclass(frozen=True)
class RunAway(DeviceFault):
    """The drive ignores its set-points and goes to a speed [rad/s] by itself, as long as it is enabled."""

    speed: float = 0.0

    def act(self, devices: Devices, cycle: int) -> None:
        devices.forced = (Mode.SPEED, self.speed)


@dataclass(frozen=True)
class OutputLoad(DeviceFault):
    """Something drags at the output: a torque [N m] against its positive sense."""

    torque: float = 0.0

    def act(self, devices: Devices, cycle: int) -> None:
        devices.load += self.torque


@dataclass(frozen=True)
class CountJump(SignalFault):
    """An encoder's counter jumps by `counts` and stays wrong: one is a slip, thousands a disturbance of the line."""

    channel: str = names.OUTPUT_ANGLE
    counts: int = 1000

    def corrupt(self, sensed: Sensed) -> None:
        sensed.counts[sensed.rows(self.at_cycle, self.end), sensed.column[self.channel]] += (
            self.counts
        )


@dataclass(frozen=True)
class CountsLost(SignalFault):
    """An encoder loses (-) or invents (+) `counts` at once; its index latch follows at the next mark."""

    channel: str = names.OUTPUT_ANGLE
    counts: int = 20

    def corrupt(self, sensed: Sensed) -> None:
        rows = sensed.rows(self.at_cycle, self.end)
        if rows.start >= rows.stop:
            return
        sensed.counts[rows, sensed.column[self.channel]] += self.counts
        latch = names.INPUT_INDEX if self.channel == names.INPUT_ANGLE else names.OUTPUT_INDEX
        latched = sensed.counts[rows, sensed.column[latch]]
        before = sensed.held(rows, latch)
        passed = np.flatnonzero(latched != before)
        # What stood in the latch before it was lost stays there until the next mark.
        follows = (
            latched[0] + self.counts == before and sensed.first_cycle + rows.start > self.at_cycle
        )
        start = int(passed[0]) if len(passed) else len(latched)
        start = 0 if follows else start
        latched[start:] += self.counts


@dataclass(frozen=True)
class ChannelFrozen(SignalFault):
    """A device that sends one value of a channel again and again; nothing says so."""

    channel: str = names.TORQUE

    def corrupt(self, sensed: Sensed) -> None:
        rows = sensed.rows(self.at_cycle, self.end)
        if rows.start < rows.stop:
            sensed.counts[rows, sensed.column[self.channel]] = sensed.held(rows, self.channel)


@dataclass(frozen=True)
class StuckEncoder(ChannelFrozen):
    """An encoder that stands still while the shaft turns; nothing says so."""

    channel: str = names.OUTPUT_ANGLE


@dataclass(frozen=True)
class IncompleteCycles(SignalFault):
    """Frames that do not arrive: the channels keep their previous values, and the cycles say so."""

    channels: tuple[str, ...] = (names.OUTPUT_ANGLE,)

    def corrupt(self, sensed: Sensed) -> None:
        rows = sensed.rows(self.at_cycle, self.end)
        if rows.start < rows.stop:
            for channel in self.channels:
                sensed.counts[rows, sensed.column[channel]] = sensed.held(rows, channel)
            sensed.flags[rows] |= np.uint16(CycleFlag.INCOMPLETE)


@dataclass(frozen=True)
class MarkedCycles(SignalFault):
    """Cycles with good values that are marked: late, doubled, short, or not valid by the device's own word."""

    flag: CycleFlag = CycleFlag.LATE

    def corrupt(self, sensed: Sensed) -> None:
        sensed.flags[sensed.rows(self.at_cycle, self.end)] |= np.uint16(self.flag)


@dataclass(frozen=True)
class TorquePortSaturated(SignalFault):
    """The analogue input stands at the end of its range."""

    sign: int = 1

    def corrupt(self, sensed: Sensed) -> None:
        rows = sensed.rows(self.at_cycle, self.end)
        sensed.counts[rows, sensed.column[names.TORQUE]] = self.sign * _ADC_FULL_SCALE
        sensed.flags[rows] |= np.uint16(CycleFlag.SATURATED)


@dataclass(frozen=True)
class TorquePortOpen(SignalFault):
    """The torque port's line is open: the input picks up mains (`amplitude` counts, `period` cycles)."""

    amplitude: int = 1600
    period: float = 20.3

    def corrupt(self, sensed: Sensed) -> None:
        rows = sensed.rows(self.at_cycle, self.end)
        cycle = sensed.first_cycle + np.arange(rows.start, rows.stop, dtype=np.int64)
        hum = np.rint(self.amplitude * np.sin(2.0 * math.pi * cycle / self.period)).astype(np.int64)
        sensed.counts[rows, sensed.column[names.TORQUE]] = hum
        sensed.flags[rows] |= np.uint16(CycleFlag.SATURATED)


@dataclass(frozen=True)
class TorqueZeroDrifts(SignalFault):
    """The torque port's zero runs away by `counts_per_cycle` of its converter: 0.1 mN m at 0.5."""

    counts_per_cycle: float = 0.5

    def corrupt(self, sensed: Sensed) -> None:
        rows, drift = sensed.grown(self.at_cycle, self.end, self.counts_per_cycle)
        port = sensed.counts[rows, sensed.column[names.TORQUE]]
        port += drift
        np.clip(port, -_ADC_FULL_SCALE, _ADC_FULL_SCALE, out=port)


@dataclass(frozen=True)
class ThermometerOpen(SignalFault):
    """The housing's thermometer has lost its sensor: it reads `counts` of 0.01 degC."""

    counts: int = -4000

    def corrupt(self, sensed: Sensed) -> None:
        rows = sensed.rows(self.at_cycle, self.end)
        sensed.counts[rows, sensed.column[names.HOUSING_TEMPERATURE]] = self.counts


@dataclass(frozen=True)
class Stall(PortFault):
    """No data for a while. The drive hears nothing either, and stops by its own quick stop (0x6007 = 3)."""

    def error(self) -> DriverError:
        return StaleDataError(
            "no complete cycle came back within the time allowed",
            where="simulated rig",
            value=f"nothing since cycle {self.at_cycle}",
            remedy="Check bus, power and cables of every device.",
        )


@dataclass(frozen=True)
class BusLost(PortFault):
    """The bus is gone and does not come back."""

    def error(self) -> DriverError:
        return BusLostError(
            "the bus is gone",
            where="simulated rig",
            value=f"since cycle {self.at_cycle}",
            remedy="Check the adapter and its cable.",
        )
