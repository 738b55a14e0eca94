"""Rows that a recorder brings in bursts, handed on evenly: so that every frame of the window has something new to show.

A rig in real time writes twenty times a second, a rig in virtual time twice. What came with a burst
is shared out over the frames until the next one is due, a little later than that: a burst that is
late finds rows still waiting. Rows wait for about one burst, never for more than `LONGEST`, and
never more than `MOST` of them; nothing is left out and nothing is drawn ahead of its measurement.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import numpy as np

from rig.window.work.live_file import BLOCK_ROWS, Block

_FIRST_INTERVAL = 0.05
"""s between two bursts before any is known: the recorder's of a rig in real time."""
LONGEST = 0.6
"""s that a row may wait."""
MOST = 32 * BLOCK_ROWS
"""Rows that may wait: a window that opens a long run does not keep all of it."""
LATE = 1.25
"""How much later than usual a burst may come before the rows run out."""
_TRUST = 0.5
"""Weight of the latest interval in the mean of them."""
_EARLY = 0.7
"""Share of the usual interval before which no burst is looked for."""


class Pacer:
    """A queue of blocks between the reading of a file and its drawing."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._waiting: deque[Block] = deque()
        self._rows, self._put, self._goes_on = 0, False, False
        self._interval, self._burst_at, self._handed_at = _FIRST_INTERVAL, clock(), clock()

    @property
    def waiting(self) -> int:
        """Rows that were read and not handed on yet."""
        return self._rows

    @property
    def expects(self) -> bool:
        """Whether the next burst may have come: a look at the file costs as much as a plot."""
        return self._clock() - self._burst_at >= _EARLY * self._interval

    def put(self, block: Block) -> None:
        """Take a block in; several at once are one burst."""
        self._waiting.append(block)
        self._rows += len(block)
        self._put = True

    def due(self, behind: bool = False) -> list[Block]:
        """What is to be drawn now; `behind`: the file has more rows than could be read, the burst goes on."""
        now = self._clock()
        elapsed, self._handed_at = now - self._handed_at, now
        if self._put and not self._goes_on:
            passed, self._burst_at = now - self._burst_at, now
            self._interval += _TRUST * (min(passed, LONGEST / LATE) - self._interval)
        self._put, self._goes_on = False, behind
        left = self._burst_at + LATE * self._interval - now
        rows = self._rows
        if left > 0.0:
            rows = min(rows, int(elapsed / (elapsed + left) * rows) + 1)
        return self._next_blocks(max(rows, self._rows - MOST))

    def rest(self) -> list[Block]:
        """All that waits: the run is over."""
        return self._next_blocks(self._rows)

    def _next_blocks(self, rows: int) -> list[Block]:
        """So many rows, few of them as one block: each block costs every view a turn."""
        taken: list[Block] = []
        while rows > 0 and self._waiting:
            block = self._waiting.popleft()
            if len(block) > rows:
                self._waiting.appendleft(_part(block, rows, len(block)))
                block = _part(block, 0, rows)
            taken.append(block)
            rows -= len(block)
            self._rows -= len(block)
        return [_joined(taken)] if len(taken) > 1 and sum(map(len, taken)) <= BLOCK_ROWS else taken


def _part(block: Block, first: int, last: int) -> Block:
    rows = slice(first, last)
    channels = {name: values[rows] for name, values in block.si.items()}
    return Block(block.start + first, block.time[rows], channels, block.good[rows])


def _joined(blocks: list[Block]) -> Block:
    channels = {name: np.concatenate([block.si[name] for block in blocks]) for name in blocks[0].si}
    time_s, good = (
        np.concatenate([b.time for b in blocks]),
        np.concatenate([b.good for b in blocks]),
    )
    return Block(blocks[0].start, time_s, channels, good)
