"""The channels of a run between two times: what changed, mean, scatter, extremes and slope, from every row in between.

Blocks are joined by their means and sums of squares about them (Chan, Golub and LeVeque, *Updating
formulae and a pairwise algorithm for computing sample variances*, 1979): a million counts around a
large angle lose no digits, and the memory stays that of one block.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.samples import CycleFlag
from experiments.recording import Recording
from rig.window.review.signals.data import (
    LABORATORY,
    SPEEDS,
    Speed,
    channels_of,
    row_at,
    unit_factor,
)

FloatArray = NDArray[np.float64]
_CLOCK_STEP = 1e-9
"""s in which the run file counts: a time read off a row is that row's, however it was rounded."""


@dataclass(frozen=True, kw_only=True)
class IntervalStatistics:
    """One channel between two times, in `unit`; nothing (NaN) where no complete row lies between them.

    `first` and `last` are of the first and the last complete row. `std` is the standard deviation of a
    sample (over n - 1), `slope` that of the line of least squares over time, in `unit` per second.
    `incomplete` rows, in which a frame did not arrive, are left out of everything.
    """

    name: str
    unit: str
    rows: int = 0
    incomplete: int
    first: float = math.nan
    last: float = math.nan
    mean: float = math.nan
    std: float = math.nan
    smallest: float = math.nan
    largest: float = math.nan
    slope: float = math.nan

    @property
    def change(self) -> float:
        """From the first row to the last."""
        return self.last - self.first


def stretches_of(
    recording: Recording,
    names: Sequence[str],
    begin: float,
    end: float,
    units: str = LABORATORY,
) -> list[IntervalStatistics]:
    """These channels between two times since the first row [s], both included."""
    channels = channels_of(recording, units)
    start, stop = rows_between(recording, begin, end)
    sums = {name: _Sums() for name in names if name in channels}
    speeds = {name: Speed(recording, name, start) for name in sums if name in SPEEDS}
    incomplete = 0
    for part in recording.blocks(slice(start, stop)):
        stamps, good = recording.time(part), (recording.flags(part) & CycleFlag.INCOMPLETE) == 0
        incomplete += int(np.count_nonzero(~good))
        for name, sum_ in sums.items():
            values = speeds[name].of(part) if name in speeds else recording.si(name, part)
            use = good & np.isfinite(values)
            sum_.add(stamps[use], values[use] / unit_factor(recording, name, units))
    return [sums[name].stretch(name, channels[name][1], incomplete) for name in sums]


def rows_between(recording: Recording, begin: float, end: float) -> tuple[int, int]:
    """The rows between two times since the first row [s], both included: the first, and the one after the last."""
    start = row_at(recording, begin - _CLOCK_STEP / 2)
    stop = row_at(recording, end + _CLOCK_STEP / 2)
    return start, max(start, stop)


@dataclass
class _Sums:
    """Means of time and value, and sums of squares and of products about them."""

    rows: int = 0
    time: float = 0.0
    value: float = 0.0
    time_squares: float = 0.0
    value_squares: float = 0.0
    products: float = 0.0
    ends: list[float] = field(default_factory=list)
    smallest: float = math.inf
    largest: float = -math.inf

    def add(self, stamps: FloatArray, values: FloatArray) -> None:
        """Take in rows."""
        fresh = len(values)
        if not fresh:
            return
        time, value = float(stamps.mean()), float(values.mean())
        along, across = stamps - time, values - value
        rows = self.rows + fresh
        apart, off = time - self.time, value - self.value
        weight = self.rows * fresh / rows
        self.time_squares += float(along @ along) + apart * apart * weight
        self.value_squares += float(across @ across) + off * off * weight
        self.products += float(along @ across) + apart * off * weight
        self.time += apart * fresh / rows
        self.value += off * fresh / rows
        self.rows = rows
        self.ends = [*(self.ends[:1] or [float(values[0])]), float(values[-1])]
        self.smallest = min(self.smallest, float(values.min()))
        self.largest = max(self.largest, float(values.max()))

    def stretch(self, name: str, unit: str, incomplete: int) -> IntervalStatistics:
        """What they come to; a single row has neither scatter nor slope."""
        if not self.rows:
            return IntervalStatistics(name=name, unit=unit, incomplete=incomplete)
        spread = math.nan if self.rows == 1 else self.value_squares / (self.rows - 1)
        return IntervalStatistics(
            name=name,
            unit=unit,
            rows=self.rows,
            incomplete=incomplete,
            first=self.ends[0],
            last=self.ends[-1],
            mean=self.value,
            std=math.sqrt(spread),
            smallest=self.smallest,
            largest=self.largest,
            slope=self.products / self.time_squares if self.time_squares > 0.0 else math.nan,
        )
