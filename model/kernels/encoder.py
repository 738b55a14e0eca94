"""The compiled incremental encoder: an angle latched late, its errors, whole counts, and the index latch."""

from __future__ import annotations

import math

from numba import njit

from model.arrays import BoolArray, FloatArray, IntArray

_compiled = njit(cache=True, nogil=True, error_model="numpy")

TURN, LATCHED, SEEN = 0, 1, 2
"""What an index latch carries: whole turns past the mark, the latched count, whether a mark was seen."""


@_compiled
def count_at(angle: float, waves: FloatArray, fine: FloatArray, quantum: float, offset: int) -> int:
    """The count at a true angle; `waves` (n, 3) are order, amplitude [rad] and phase of the errors over the angle.

    `fine` (points + 1, 4), where it is not empty, holds cubic pieces of what many more orders add over one revolution.
    """
    within = angle - math.floor(angle / (2.0 * math.pi)) * (2.0 * math.pi)
    read = angle
    for k in range(waves.shape[0]):
        read += waves[k, 1] * math.cos(waves[k, 0] * within - waves[k, 2])
    points = fine.shape[0] - 1
    if points > 0:
        place = within * (points / (2.0 * math.pi))
        k = min(int(place), points)
        x = place - k
        read += fine[k, 0] + x * (fine[k, 1] + x * (fine[k, 2] + x * fine[k, 3]))
    return math.floor(read / quantum) + offset


@_compiled
def read_encoder(
    rows: FloatArray,
    column: int,
    sense: float,
    late: FloatArray,
    delay: float,
    waves: FloatArray,
    fine: FloatArray,
    quantum: float,
    offset: int,
    mark: float,
    latch: FloatArray,
    counts: IntArray,
    indices: IntArray,
    seen: BoolArray,
) -> None:
    """Counts, latched index counts and whether a mark was seen, per row.

    Angle, speed and acceleration stand in the columns from `column` on; `late` (n,) [s] is how late
    SYNC is, `delay` [s] the encoder's own. The mark is one count wide: passed backwards it latches
    its far edge. `latch` (3,) is carried.
    """
    turn = latch[TURN]
    latched = int(latch[LATCHED])
    passed = latch[SEEN] > 0.0
    for k in range(rows.shape[0]):
        wait = late[k] + delay
        angle = sense * (
            rows[k, column] + wait * (rows[k, column + 1] + 0.5 * wait * rows[k, column + 2])
        )
        counts[k] = count_at(angle, waves, fine, quantum, offset)
        now = math.floor((angle - mark) / (2.0 * math.pi))
        if now != turn:
            passed_at = mark + 2.0 * math.pi * max(now, turn)
            latched = count_at(passed_at, waves, fine, quantum, offset)
            if now < turn:
                latched += 1
            passed = True
            turn = now
        indices[k] = latched
        seen[k] = passed
    latch[TURN], latch[LATCHED], latch[SEEN] = turn, latched, 1.0 if passed else 0.0
