"""Where an angle turns one way: its noise, the dead zone that follows from it, and the stretches beyond that.

Travel is looked at over 2 w rows, w so wide that the motion stands out of noise and counts. What
moves less than the dead zone stands still: no direction, and no sliding friction there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.units import DEGREE

_MOST_WIDENING = 12
"""Doublings of the half width at most."""
_MOVING_PERCENTILE = 95.0
"""Of the travel: even of a robot that stands still most of the time these rows move."""
STANDS_OUT = 10.0
"""Travel over noise from which a direction is believed."""
_NOISE_FACTOR = 5.0
"""Standard deviations of the noise that no noise exceeds."""
_STILL_SHARE = 0.02
"""Of the travel when it moves, below which it creeps or settles."""
_OFF_COUNT = 0.02
"""Counts by which a step may be off a whole number of them."""
_STILL_ROWS = 0.02
"""Share of rows without any step from which on an angle counts."""
LEAST_ROWS = 8
"""Rows of a stretch, at least."""


@dataclass(frozen=True)
class DeadZone:
    """Half width w [rows] over which travel is looked at, and the travel over 2 w [rad] below which it stands still."""

    half_width: int
    travel: float
    rounding: float = 0.0
    """Size of a count of the angle [rad], where it shows; 0 where it does not."""

    @classmethod
    def of(cls, parts: Sequence[Array]) -> DeadZone:
        """The dead zone from contiguous parts of an angle [rad]; refused where none of them moves."""
        noise = max(_noise(parts), 1e-15)
        shortest = min(len(part) for part in parts)
        half = 1
        moved = _travel_when_moving(parts, half)
        for _ in range(_MOST_WIDENING):
            if moved >= STANDS_OUT * noise or 8 * half > shortest:
                break
            half *= 2
            moved = _travel_when_moving(parts, half)
        if moved < STANDS_OUT * noise:
            raise IdentificationError(
                "does not move",
                where="angle",
                value=f"{moved / DEGREE:.3g} degrees in {2 * half} rows",
                limit=f"> {STANDS_OUT * noise / DEGREE:.3g} degrees, {STANDS_OUT:g} times its noise",
            )
        return cls(half, max(_NOISE_FACTOR * noise, _STILL_SHARE * moved), _rounding(parts))

    def ways(self, angle: Array) -> np.ndarray:
        """+1, -1, or 0 at standstill, for each sample of a contiguous angle (n,)."""
        travel = _travel(angle, self.half_width)
        return np.where(np.abs(travel) > self.travel, np.sign(travel), 0.0).astype(np.int8)

    @property
    def blink(self) -> int:
        """Rows without a direction that noise brings: no standstill."""
        return 4 * self.half_width


def runs_of(ways: Iterable[np.ndarray], blink: int = 0) -> list[tuple[int, int, int]]:
    """(first row, end, direction) of each stretch that turns one way, from the ways of successive blocks.

    Stretches of one direction that up to `blink` rows without any part are one.
    """
    runs: list[tuple[int, int, int]] = []

    def add(begin: int, end: int, way: int) -> None:
        if runs and runs[-1][2] == way and begin - runs[-1][1] <= blink:
            runs[-1] = (runs[-1][0], end, way)
        elif way != 0 and end > begin:
            runs.append((begin, end, way))

    row, begin, current = 0, 0, 0
    for block in ways:
        starts = np.flatnonzero(np.diff(block, prepend=np.int8(current)))
        for at in starts.tolist():
            if current != 0:
                add(begin, row + at, current)
            begin, current = row + at, int(block[at])
        row += len(block)
    if current != 0:
        add(begin, row, current)
    return [run for run in runs if run[1] - run[0] >= LEAST_ROWS]


def _noise(parts: Sequence[Array]) -> float:
    """Standard deviation of an angle's noise [rad] from its second differences, at least that of its rounding."""
    bent: Array = np.concatenate([np.zeros(1), *(np.diff(part, 2) for part in parts)])
    # The ninth decile: of an angle that counts, half of the differences may be zero.
    random = float(np.percentile(np.abs(bent), 90.0)) / (1.645 * np.sqrt(6.0))
    return max(random, _rounding(parts))


def _rounding(parts: Sequence[Array]) -> float:
    """Size of a count of an angle [rad]: the step of which all others are multiples; 0 where there is none."""
    steps: Array = np.concatenate([np.abs(np.diff(part)) for part in parts])
    moved: Array = steps[steps > 0.0]
    if not len(moved):
        return 0.0
    # What is left of the sums that made the angle is no count.
    moved = moved[moved > 1e-6 * float(np.median(moved))]
    smallest = float(moved.min())
    multiples: Array = moved / smallest
    off: Array = np.abs(multiples - np.rint(multiples))
    is_counted = (
        np.count_nonzero(off < _OFF_COUNT) > 0.99 * len(off) and float(multiples.max()) > 1.5
    )
    has_still = np.count_nonzero(steps == 0.0) > _STILL_ROWS * len(steps)
    return smallest if is_counted or has_still else 0.0


def _travel(angle: Array, half: int) -> Array:
    """Travel over 2 `half` rows about each row, one-sided ends scaled up."""
    n = len(angle)
    rows = np.arange(n)
    low, high = np.maximum(rows - half, 0), np.minimum(rows + half, n - 1)
    share = 2.0 * half / np.maximum(high - low, 1)
    travel: Array = (angle[high] - angle[low]) * share
    return travel


def _travel_when_moving(parts: Sequence[Array], half: int) -> float:
    travel = np.concatenate([np.abs(_travel(part, half)) for part in parts])
    return float(np.percentile(travel, _MOVING_PERCENTILE))
