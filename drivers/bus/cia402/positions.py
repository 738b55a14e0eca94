"""Target positions out of set speeds, for a drive that turns in cyclic synchronous position.

    target[k] = target[k-1] + v[k] T,   in counts of 0x607A

The target of cycle k goes out before SYNC k, and the drive is there at SYNC k+1: v[k] acts from SYNC k on. Speeds and
targets are whole numbers of 1/65536 count: targets are the exact sum of the speeds that are recorded as set, whatever
the blocks. Such a speed is within 1/131072 count per cycle of what was asked for: 28 counts in an hour at 1 kHz.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

FRACTION: Final = 1 << 16
"""Parts of a count in which speeds and targets are kept."""
_HALF: Final = FRACTION // 2


def speed_scale(counts_per_revolution: float, cycle_ns: int) -> float:
    """rad/s of one 1/65536 count per cycle."""
    return 2.0 * math.pi / counts_per_revolution / FRACTION / (cycle_ns * 1e-9)


class PositionTargets:
    """The target that the drive was given last, and those that follow from set speeds."""

    def __init__(self) -> None:
        self._now = 0
        self._planned: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def begin(self, position: int) -> None:
        """The target is this position [counts] from here on."""
        self._now, self._planned = position * FRACTION, np.empty(0, dtype=np.int64)

    def plan(self, speeds: NDArray[np.int64], travel: int, where: str) -> NDArray[np.int64]:
        """The targets (n,) of set speeds (n,) [1/65536 count per cycle], as the 32 bits of 0x607A hold them.

        Raises `DriverError` where one lies further from the one before than `travel` counts: nothing is sent.
        """
        if len(speeds) and int(np.abs(speeds).max()) > travel * FRACTION:
            worst = float(speeds[np.argmax(np.abs(speeds))]) / FRACTION
            raise DriverError(
                "a target lies further than the greatest travel of one cycle",
                where=where,
                value=f"{worst:.1f} counts",
                limit=f"+-{travel} counts",
                remedy="Raise the drive's speed limit, or choose a slower plan.",
            )
        self._planned = self._now + np.cumsum(speeds)
        return wrapped((self._planned + _HALF) // FRACTION)

    def hold(self, cycles: int) -> NDArray[np.int64]:
        """The target of now (cycles,), again and again."""
        return wrapped(np.full(cycles, (self._now + _HALF) // FRACTION, dtype=np.int64))

    def sent(self, cycles: int) -> None:
        """So many of the planned targets went out; nothing where none were planned."""
        if 0 < cycles <= len(self._planned):
            self._now = int(self._planned[cycles - 1])
        self._planned = np.empty(0, dtype=np.int64)


def wrapped(positions: NDArray[np.int64]) -> NDArray[np.int64]:
    """Positions (n,) as a signed number of 32 bits holds them: the shaft turns on where the number begins anew."""
    return (positions + 2**31) % 2**32 - 2**31
