"""Set-points over cycles: pure functions from a step's numbers to what the drive gets in each
SYNC cycle.

A `Profile` is asked for the cycles [start, start + count) of its own, so that how a run is cut into
blocks cannot change a set-point, and long holds need no memory. Nothing is rounded here:
quantisation belongs to the drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from model.arrays import FloatArray
from model.units import REVOLUTION


class Profile(Protocol):
    """Set-points of one phase of a step, cycle 0 being its first."""

    def targets(self, start: int, count: int) -> FloatArray:
        """Set-points (count,) of the cycles from `start` on."""
        ...


@dataclass(frozen=True, slots=True)
class Constant:
    """One set-point for as long as it lasts."""

    value: float = 0.0

    def targets(self, start: int, count: int) -> FloatArray:
        """`value`, repeated."""
        return np.full(count, self.value)


@dataclass(frozen=True, slots=True)
class Linear:
    """From `begin` (the set-point before cycle 0) to `end` in `cycles` equal steps; `end` is
    reached in the last and kept.
    """

    begin: float
    end: float
    cycles: int

    def targets(self, start: int, count: int) -> FloatArray:
        """begin + (end - begin) min(1, (k + 1)/cycles)."""
        if self.cycles <= 0:
            return np.full(count, self.end)
        share = np.minimum(np.arange(start + 1, start + count + 1) / self.cycles, 1.0)
        values = self.begin + (self.end - self.begin) * share
        values[share >= 1.0] = self.end
        return values


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """Swings of `cycles` cycles each about zero; each ends at zero."""

    peak: float
    cycles: int

    def targets(self, start: int, count: int) -> FloatArray:
        """peak sin(2 pi (k + 1)/cycles)."""
        # One by one: the sine of an array may differ in its last bit with the array's length, so with that of a block.
        shares = [k % self.cycles / self.cycles for k in range(start + 1, start + count + 1)]
        return self.peak * np.array([math.sin(REVOLUTION * share) for share in shares])


def cycles_of(duration: float, period: float) -> int:
    """Whole cycles that last at least `duration` [s] (a hair of rounding is forgiven); at least one."""
    return max(1, math.ceil(duration / period - 1e-6))


def ramp(begin: float, end: float, acceleration: float, period: float) -> Linear:
    """A linear ramp that does not exceed `acceleration` > 0 (per second), in whole cycles of `period` [s]."""
    if begin == end:
        return Linear(begin, end, 0)
    return Linear(begin, end, cycles_of(abs(end - begin) / acceleration, period))


def ramp_travel(begin: float, end: float, cycles: int, period: float) -> float:
    """Angle [rad] that a drive which follows ideally turns in `cycles` of a linear speed ramp, each
    set-point held a cycle.
    """
    if cycles <= 0:
        return 0.0
    return period * (cycles * begin + (end - begin) * 0.5 * (cycles + 1))


def cruise_speed(speed: float, acceleration: float, distance: float, period: float) -> float:
    """The highest speed magnitude not above |speed| from which a stop within half of `distance` is
    possible: sqrt(a d).
    """
    reachable = math.sqrt(acceleration * abs(distance))
    return min(abs(speed), max(reachable, acceleration * period))


def stopping_distance(speed: float, acceleration: float, period: float) -> float:
    """Angle [rad] >= 0 that a whole-cycle ramp from |speed| to standstill turns."""
    profile = ramp(abs(speed), 0.0, acceleration, period)
    return ramp_travel(abs(speed), 0.0, profile.cycles, period)
