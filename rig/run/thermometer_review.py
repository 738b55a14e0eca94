"""The thermometer's share of the review: a housing temperature that trembled and then stands on one count.

A reading may stand still honestly, for as long as a coarse sensor needs to see a change. So it is
held against itself: one that went up and down between its counts, and then does not move for
`STILL` times the longest that it ever stood, may be dead. That is said, and the run goes on: what
cannot be a temperature at all is the guard's (`rig.run.bounds`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.counting import changes
from rig.run.bounds import Watch

STILL = 20
TURNS = 20
"""Times that a reading must have gone up after down, or down after up, to be known to tremble."""


@dataclass(frozen=True, kw_only=True)
class ThermometerState:
    """What is carried from block to block: the latest count and sense of change, cycles for which it has stood, the
    longest that it ever stood, turns so far, and whether it was told of.
    """

    count: int | None = None
    sense: int = 0
    still: int = 0
    longest: int = 0
    turns: int = 0
    is_told: bool = False


def stood(
    state: ThermometerState, counts: NDArray[np.int64], watch: Watch, period: float
) -> tuple[ThermometerState, tuple[tuple[str, str], ...]]:
    """The state after complete cycles with these counts (n,), and what is worth an event (code, text)."""
    if not len(counts):
        return state, ()
    steps = changes(counts, int(counts[0]) if state.count is None else state.count)
    moved = np.flatnonzero(steps)
    if len(moved):
        stretches = np.diff(moved, prepend=-state.still)
        senses = np.concatenate([[state.sense], np.sign(steps[moved])])
        state = ThermometerState(
            count=int(counts[-1]),
            sense=int(senses[-1]),
            still=len(counts) - int(moved[-1]),
            longest=max(state.longest, int(stretches.max())),
            turns=state.turns + int(np.count_nonzero(senses[1:] * senses[:-1] < 0)),
        )
    else:
        state = replace(state, count=int(counts[-1]), still=state.still + len(counts))
    least = max(STILL * state.longest, round(watch.still_time / period))
    if state.is_told or state.turns < TURNS or state.still < least:
        return state, ()
    text = (
        f"the housing temperature has stood on one count for {state.still * period:.3g} s, before never longer than "
        f"{state.longest * period:.3g} s: the sensor may be dead. Compare it with another; the run is watched no more "
        "for heat"
    )
    return replace(state, is_told=True), (("thermometer", text),)
