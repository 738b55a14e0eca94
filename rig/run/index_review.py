"""The index marks' share of the review: between two passes of a mark the counter must count whole revolutions.

Marks are compared with the first one that was passed in the same direction (passed from the other
side a mark lies elsewhere, by its own width), so that counts that are lost one by one add up. More
than a mark's repeatability is an event; more than that by far, at several marks in a row, is a
trip: the counter has lost its angle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.channel import (
    INDEX_SEEN,
    INPUT_ANGLE,
    INPUT_INDEX,
    OUTPUT_ANGLE,
    OUTPUT_INDEX,
    Channel,
)
from drivers.counting import index_intervals, lost_counts
from drivers.samples import CycleFlag, SampleBlock
from rig.run.bounds import Watch
from rig.run.trips import LOST_COUNTS, Trip

_DOUBTFUL = np.uint16(
    CycleFlag.INCOMPLETE
    | CycleFlag.LATE
    | CycleFlag.DOUBLED
    | CycleFlag.SHORT
    | CycleFlag.JUMPED
    | CycleFlag.SIGNAL_ERROR
)
"""Marks of cycles whose latch is not looked at."""
_SIDES = ((INPUT_ANGLE, INPUT_INDEX, 1), (OUTPUT_ANGLE, OUTPUT_INDEX, 2))
"""Angle, latch, and the bit of `INDEX_SEEN` of each encoder."""


@dataclass(frozen=True, kw_only=True)
class _MarkState:
    """One encoder: latest count and latch (None: none yet), first latch by direction, marks
    compared, counts too many (+) or
    lost (-) at the latest and at worst, the excess that was reported last, marks beyond the limit in a row."""

    count: int | None = None
    latched: int | None = None
    first: Mapping[int, int] = field(default_factory=dict[int, int])
    marks: int = 0
    excess: int = 0
    worst: int = 0
    reported: int = 0
    beyond: int = 0


IndexState = tuple[_MarkState, _MarkState]
"""What is carried from block to block: input and output encoder."""
NO_MARKS: IndexState = (_MarkState(), _MarkState())


@dataclass(frozen=True)
class IndexReview:
    """Reviews the index latches of one rig: its channels by name and their columns."""

    watch: Watch
    channels: Mapping[str, Channel]
    column: Mapping[str, int]

    def reviewed(
        self, state: IndexState, block: SampleBlock, start: int
    ) -> tuple[IndexState, list[Trip], tuple[tuple[str, str], ...]]:
        """The state after a block, trips, and what is worth an event (code, text)."""
        trips: list[Trip] = []
        notes: list[tuple[str, str]] = []
        sides = [
            self._side(side, names, block, start, trips, notes)
            for side, names in zip(state, _SIDES, strict=True)
        ]
        return (sides[0], sides[1]), trips, tuple(notes)

    def figures(self, state: IndexState) -> dict[str, dict[str, int]]:
        """Marks that were compared and the counts that were too many or lost, by encoder."""
        return {
            names[0]: {"marks": side.marks, "excess": side.excess, "worst_excess": side.worst}
            for side, names in zip(state, _SIDES, strict=True)
            if side.marks
        }

    def _side(
        self,
        state: _MarkState,
        names: tuple[str, str, int],
        block: SampleBlock,
        start: int,
        trips: list[Trip],
        notes: list[tuple[str, str]],
    ) -> _MarkState:
        angle, index, bit = names
        if not all(name in self.column for name in (angle, index, INDEX_SEEN)):
            return state
        channel = self.channels[angle]
        revolution = channel.lines * channel.multiplication
        if not revolution:
            return state
        counts, latches = block.counts[:, self.column[angle]], block.counts[:, self.column[index]]
        usable = ((block.counts[:, self.column[INDEX_SEEN]] & bit) != 0) & (
            (block.flags & _DOUBTFUL) == 0
        )
        for row in self._passes(state, latches, usable):
            before = int(counts[row - 1]) if row else state.count
            direction = 0 if before is None else int(np.sign(int(counts[row]) - before))
            state = self._passed(replace(state, latched=int(latches[row])), direction, revolution)
            self._tell(state, channel, start + row, trips, notes)
            if state.reported != state.excess:
                state = replace(state, reported=state.excess)
        return replace(state, count=int(counts[-1]))

    def _passes(
        self, state: _MarkState, latches: NDArray[np.int64], usable: NDArray[np.bool_]
    ) -> list[int]:
        """The rows in which another mark is latched than before."""
        rows = np.flatnonzero(usable)
        if not len(rows):
            return []
        seen = latches[rows]
        if state.latched is not None and (seen == state.latched).all():
            return []
        before = seen[0] - 1 if state.latched is None else state.latched
        return rows[np.diff(seen, prepend=before) != 0].tolist()

    def _passed(self, state: _MarkState, direction: int, revolution: int) -> _MarkState:
        """The state after a mark that was passed in a direction (0: not known, so not compared)."""
        latched = state.latched
        assert latched is not None
        if direction == 0:
            return state
        if direction not in state.first:
            return replace(state, first={**state.first, direction: latched})
        intervals = index_intervals(np.array([state.first[direction], latched]), revolution)
        excess = intervals[0].excess if intervals else 0
        far = bool(lost_counts(intervals, self.watch.index_lost_counts))
        return replace(
            state,
            marks=state.marks + 1,
            excess=excess,
            worst=max(state.worst, excess, key=abs),
            beyond=state.beyond + 1 if far else 0,
        )

    def _tell(
        self,
        state: _MarkState,
        channel: Channel,
        row: int,
        trips: list[Trip],
        notes: list[tuple[str, str]],
    ) -> None:
        if abs(state.excess - state.reported) > self.watch.index_repeatability:
            text = "index mark in its place again"
            if state.excess:
                what = "too many" if state.excess > 0 else "lost"
                text = (
                    f"{abs(state.excess)} counts {what} at an index mark since the "
                    "first one passed in this direction"
                )
            notes.append(("index-mark", f"{channel.name}: {text}, row {row}"))
        if state.beyond >= self.watch.index_marks:
            trips.append(
                Trip(
                    LOST_COUNTS,
                    row,
                    float(state.excess),
                    float(self.watch.index_lost_counts),
                    "counts",
                    channel.name,
                )
            )
