"""Counters that wrap, and index marks: counts without jumps, and a count of counts between marks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

Number = TypeVar("Number", np.int64, np.float64)


def changes(values: NDArray[Number], before: float) -> NDArray[Number]:
    """What each value (n,) differs by from the one before it; `before` stands before the first.

    As `numpy.diff` with `prepend`, in half its time: of a block that is the larger part.
    """
    moved = np.empty_like(values)
    if len(values):
        moved[0] = values[0] - before
        np.subtract(values[1:], values[:-1], out=moved[1:])
    return moved


def wrapped_difference(
    later: NDArray[np.int64], earlier: NDArray[np.int64], modulus: int
) -> NDArray[np.int64]:
    """The shortest way from `earlier` to `later` on a counter of range `modulus` (0: it does not wrap); any shape.

    The result lies in [-modulus/2, modulus/2): a step of half the range or more cannot be told from one the other way.
    """
    difference = later - earlier
    if not modulus:
        return difference
    half = modulus // 2
    return (difference + half) % modulus - half


class Unwrapper:
    """One counter's history: raw values of any range in, counts that never jump out. The first
    trusted value is kept as it is.

    A value that is not trusted is placed beside the latest trusted one and then forgotten: a stray
    value half a range away must not cost a whole turn for good.
    """

    def __init__(self, modulus: int) -> None:
        if modulus < 0 or modulus == 1:
            raise DriverError(
                "a counter's range is 0 (no wrap) or at least 2", where="counter", value=modulus
            )
        self.modulus = modulus
        self._raw: int | None = None
        self._count = 0

    @property
    def reference(self) -> tuple[int | None, int]:
        """The latest trusted raw value (None before the first) and its count."""
        return self._raw, self._count

    def unwrap(
        self, raw: NDArray[np.int64], trusted: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """Counts (n,) of raw values (n,) that follow those of the last call; `trusted` (n,) all of
        them if not given.
        """
        good = np.flatnonzero(trusted) if trusted is not None else np.arange(len(raw))
        if not self.modulus or not len(raw) or (self._raw is None and not len(good)):
            return raw.astype(np.int64)
        before_first = int(good[0]) if self._raw is None else 0
        if self._raw is None:
            self._raw = self._count = int(raw[good[0]])
        anchors = np.concatenate([[self._raw], raw[good]]).astype(np.int64)
        at_anchor = self._count + np.concatenate(
            [[0], np.cumsum(wrapped_difference(anchors[1:], anchors[:-1], self.modulus))]
        )
        # For every row, the latest anchor at or before it; 0 is the one of the last call.
        latest = np.searchsorted(good, np.arange(len(raw)), side="right")
        counts = at_anchor[latest] + wrapped_difference(raw, anchors[latest], self.modulus)
        counts[:before_first] = raw[:before_first]
        self._raw, self._count = int(anchors[-1]), int(at_anchor[-1])
        return counts


@dataclass(frozen=True)
class IndexInterval:
    """Counts between two passes of index marks, and the whole number of revolutions that they should be."""

    counts: int
    revolutions: int
    excess: int
    """Counts too many (+) or lost (-) against revolutions * counts per revolution."""


def index_intervals(
    latched: NDArray[np.int64], counts_per_revolution: int, marks_per_revolution: int = 1
) -> list[IndexInterval]:
    """Counts between successive different latched positions (n,) of an index mark, held against whole revolutions.

    `latched` are unwrapped counts, one per cycle or one per mark; equal neighbours are the same
    mark. With several marks per revolution their spacing is counts_per_revolution /
    marks_per_revolution.
    """
    if (
        counts_per_revolution <= 0
        or marks_per_revolution <= 0
        or counts_per_revolution % marks_per_revolution
    ):
        raise DriverError(
            "counts per revolution must be a positive multiple of the marks",
            where="index mark",
            value=f"{counts_per_revolution} counts, {marks_per_revolution} marks",
        )
    spacing = counts_per_revolution // marks_per_revolution
    steps = np.diff(np.asarray(latched, dtype=np.int64))
    intervals: list[IndexInterval] = []
    for step in steps[steps != 0]:
        turns = (2 * int(step) + spacing) // (2 * spacing)
        intervals.append(IndexInterval(int(step), turns, int(step) - turns * spacing))
    return intervals


def lost_counts(intervals: list[IndexInterval], tolerance: int) -> list[IndexInterval]:
    """The intervals whose excess is larger than the mark's own repeatability of `tolerance` counts:
    lost or extra counts.

    The excess of a mark passed from the other side is the mark's width, so pass only marks approached from one side.
    """
    return [interval for interval in intervals if abs(interval.excess) > tolerance]


def largest_step(resolution: int, speed: float, cycle_ns: int) -> int:
    """Counts that a shaft with `resolution` counts per revolution turns at `speed` [rad/s] within one
    cycle, with one to spare.
    """
    return 1 + math.ceil(speed * cycle_ns * 1e-9 * resolution / (2.0 * math.pi))


def require_range(most: int, modulus: int, cycle_ns: int, where: str) -> None:
    """Raise `DriverError` where a shaft can turn half a counter's range between two SYNCs, `most` counts: the
    count could be unwrapped either way. `modulus` 0: it does not wrap.
    """
    if modulus and 2 * most >= modulus:
        raise DriverError(
            "the shaft can turn half the counter's range within a cycle: which way it turned would be a guess",
            where=where,
            value=f"{most} counts in {cycle_ns * 1e-6:g} ms",
            limit=f"< {modulus // 2} of {modulus}",
            remedy="A higher SYNC rate, a counter of more bits, or `largest_speed_rpm` of this shaft where it turns "
            "more slowly.",
        )
