"""Where a motion comes from: position or speed and effort, block by block, in stretches without a gap.

An inverse dynamics fit needs no more than a block of the recording at a time, so that its length
does not matter. A gap of time ends a stretch: what happened in it is not known, and nothing is
drawn across it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, channels, increasing

EVEN = 0.01
"""Relative deviation of a sampling step above which the channels are brought onto an even time axis."""
GAP = 2.5
"""Sampling periods between two rows from which on it is a gap; one lost row is none."""


@dataclass(frozen=True, kw_only=True)
class MotionBlock:
    """Rows of a recording: time [s], effort, and what it has of position, speed and instrument, all (n,)."""

    time: Array
    effort: Array
    position: Array | None = None
    speed: Array | None = None
    instrument: Array | None = None

    @property
    def place(self) -> Array | None:
        """Its position; its speed where it has none."""
        return self.speed if self.position is None else self.position


@dataclass(frozen=True)
class UnbrokenRows:
    """Rows [start, stop) without a gap of time."""

    start: int
    stop: int

    @property
    def rows(self) -> int:
        return self.stop - self.start


class MotionSource(Protocol):
    """A recorded motion that is read in blocks."""

    @property
    def period(self) -> float:
        """The usual time between two rows [s]."""
        ...

    @property
    def is_even(self) -> bool:
        """Whether every step within a stretch is that period, to a hundredth."""
        ...

    @property
    def stretches(self) -> Sequence[UnbrokenRows]:
        """The stretches without gaps, in the order of time."""
        ...

    def read(self, start: int, stop: int) -> MotionBlock:
        """Of the rows [start, stop) those that can be used."""
        ...

    def stamp(self, row: int) -> float:
        """The time of a row [s], whether it can be used or not."""
        ...


@dataclass(frozen=True)
class TimeAxis:
    """What the time stamps of a recording say: period [s], evenness, gaps, stretches between them."""

    period: float
    worst_step: float
    """The largest relative deviation of a step from the period within a stretch."""
    stretches: tuple[UnbrokenRows, ...]
    longest_gap: float
    """The longest gap [s]; 0 without one."""

    @property
    def is_even(self) -> bool:
        return self.worst_step <= EVEN

    @property
    def gaps(self) -> int:
        """How many gaps lie between the stretches."""
        return len(self.stretches) - 1


def time_axis(blocks: Iterable[tuple[int, Array]], period: float) -> TimeAxis:
    """The axis of time stamps [s] that come in order as (row of the first, stamps); rows between two blocks are lost.

    Raises `IdentificationError` for time that does not increase.
    """
    edges: list[int] = []
    worst = longest = 0.0
    before: tuple[int, float] | None = None
    for row, stamps in blocks:
        rows = row + np.arange(len(stamps))
        if before is None:
            edges.append(row)
        else:
            rows = np.concatenate([[before[0]], rows])
            stamps = np.concatenate([[before[1]], stamps])
        steps = np.diff(stamps)
        if len(steps) and steps.min() <= 0.0:
            at = int(np.argmax(steps <= 0.0))
            raise IdentificationError(
                f"does not increase at row {rows[at + 1]}",
                where="time",
                value=f"{stamps[at]:.9g} s then {stamps[at + 1]:.9g} s",
                limit="strictly increasing",
                remedy="Use the stamp of each sample and drop doubled rows.",
            )
        wide = steps > GAP * period
        for at in np.flatnonzero(wide):
            edges += [int(rows[at]) + 1, int(rows[at + 1])]
        longest = max(longest, float(steps[wide].max(initial=0.0)))
        worst = max(worst, float(np.abs(steps[~wide] / period - 1.0).max(initial=0.0)))
        before = int(rows[-1]), float(stamps[-1])
    if before is None:
        raise IdentificationError("has no row that can be used", where="time")
    edges.append(before[0] + 1)
    stretches = tuple(UnbrokenRows(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True))
    return TimeAxis(period, worst, stretches, longest)


@dataclass(frozen=True)
class ArrayMotion:
    """A motion that lies in memory."""

    block: MotionBlock
    axis: TimeAxis

    @classmethod
    def of(cls, time: ArrayLike, effort: ArrayLike, **others: ArrayLike | None) -> ArrayMotion:
        """A motion from arrays (n,): time [s], effort, and by name position, speed, instrument."""
        clock = increasing("time", time)
        there = {name: values for name, values in others.items() if values is not None}
        clock, force, *rest = channels(2, time=clock, force=effort, **there)
        block = MotionBlock(time=clock, effort=force, **dict(zip(there, rest, strict=True)))
        return cls(block, time_axis([(0, clock)], float(np.median(np.diff(clock)))))

    @property
    def period(self) -> float:
        return self.axis.period

    @property
    def is_even(self) -> bool:
        return self.axis.is_even

    @property
    def stretches(self) -> Sequence[UnbrokenRows]:
        return self.axis.stretches

    def read(self, start: int, stop: int) -> MotionBlock:
        def part(values: Array | None) -> Array | None:
            return None if values is None else values[start:stop]

        return MotionBlock(
            time=self.block.time[start:stop],
            effort=self.block.effort[start:stop],
            position=part(self.block.position),
            speed=part(self.block.speed),
            instrument=part(self.block.instrument),
        )

    def stamp(self, row: int) -> float:
        return float(self.block.time[row])
