"""How much of a bus its cycles take, and the SYNC rate that a bus can carry.

A frame of n data bytes with an 11-bit identifier takes at most

    C(n) = 34 + 8 n + 13 + floor((34 + 8 n - 1) / 4)     bits,

stuff bits and the three bits between frames included (Davis, Burns, Bril, Lukkien, Real-Time Systems 35, 2007,
239-272, eq. 1, g = 34).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

LARGEST_SHARE: Final = 0.7
"""Of the bus, by cyclic data: the rest is for SDO, heartbeats, emergencies and repeated frames."""
_STUFFED, _FIXED = 34, 13
RATES: Final = (50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0, 2000.0)
"""SYNC rates [Hz] with a period of whole ms or a whole part of one, which drives can be told (0x60C2)."""


def frame_bits(data_bytes: int) -> int:
    """The longest that a frame of so many data bytes can be [bit]."""
    stuffed = _STUFFED + 8 * data_bytes
    return stuffed + _FIXED + (stuffed - 1) // 4


@dataclass(frozen=True)
class CycleLoad:
    """What one SYNC cycle puts on the bus: data bytes of every frame, the SYNC's own (0) among them."""

    frames: Sequence[int]

    @property
    def bits(self) -> int:
        """Of one cycle [bit]."""
        return sum(frame_bits(size) for size in self.frames)

    def share(self, rate: float, bit_rate: int) -> float:
        """Of the bus at a SYNC rate [Hz] and a bit rate [bit/s]."""
        return self.bits * rate / bit_rate

    def largest_rate(self, bit_rate: int) -> float:
        """The greatest of the usual SYNC rates [Hz] that leaves room; 0 where none does."""
        return max(
            (rate for rate in RATES if self.share(rate, bit_rate) <= LARGEST_SHARE), default=0.0
        )


def load_of(nodes: int, *, commands: int = 2, frames_per_node: int = 2) -> CycleLoad:
    """The cycle of a rig of so many nodes: SYNC, set-points in `commands` frames, data in `frames_per_node` each,
    all of 8 bytes: more than most rigs need.
    """
    return CycleLoad([0, *[8] * commands, *[8] * (nodes * frames_per_node)])
