"""What comes back from the rig: a block of consecutive SYNC cycles, in counts."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers import channel as names


class CycleFlag(IntFlag):
    """What was wrong with one SYNC cycle; 0 is a complete cycle on time. A flagged value is kept,
    never interpolated.
    """

    COMPLETE = 0
    INCOMPLETE = 1
    """At least one channel did not arrive; its previous value stands there."""
    LATE = 2
    """A frame of this cycle arrived after the next SYNC."""
    DOUBLED = 4
    """A frame of this cycle arrived twice."""
    SHORT = 8
    """A frame had fewer bytes than its mapping says."""
    JUMPED = 16
    """An encoder count moved further than the gear can turn within one cycle."""
    SIGNAL_ERROR = 32
    """A device says itself that its value is not valid."""
    SATURATED = 64
    """The analogue input is at the end of its range, or its line is open."""
    HOST_TIME = 128
    """The time of this cycle is a host arrival time, not a hardware or device stamp."""
    STALE_STATUSWORD = 256
    """With INCOMPLETE: the frame of the statusword did not arrive."""
    STALE_INPUT = 512
    """With INCOMPLETE: the frame of the input angle did not arrive."""
    STALE_OUTPUT = 1024
    """With INCOMPLETE: the frame of the output angle did not arrive."""
    STALE_TORQUE = 2048
    """With INCOMPLETE: the frame of the torque port did not arrive."""
    STALE_OTHER = 4096
    """With INCOMPLETE: the frame of some other channel did not arrive."""


NOT_JUDGED: Final = int(CycleFlag.INCOMPLETE | CycleFlag.DOUBLED)
"""A cycle of a bus with one of these breaks no bound: of two frames nobody knows which one is true."""
STALE_OF: Final[Mapping[str, CycleFlag]] = {
    names.STATUSWORD: CycleFlag.STALE_STATUSWORD,
    names.INPUT_ANGLE: CycleFlag.STALE_INPUT,
    names.OUTPUT_ANGLE: CycleFlag.STALE_OUTPUT,
    names.TORQUE: CycleFlag.STALE_TORQUE,
}
"""The mark of each channel that has one of its own; every other channel has STALE_OTHER."""
_STALE: Final = np.uint16(CycleFlag.STALE_OTHER | CycleFlag(sum(STALE_OF.values())))


def is_stale(flags: NDArray[np.uint16], channel: str) -> NDArray[np.bool_]:
    """In which cycles (n,) a channel holds an earlier cycle's value.

    An incomplete cycle that does not say which channels are meant (of a rig or a file that cannot
    tell) means all of them.
    """
    own = np.uint16(STALE_OF.get(channel, CycleFlag.STALE_OTHER))
    incomplete = (flags & np.uint16(CycleFlag.INCOMPLETE)) != 0
    names_channels = (flags & _STALE) != 0
    return incomplete & (~names_channels | ((flags & own) != 0))


@dataclass(frozen=True)
class Break:
    """The first cycle that broke the guard: row in the block, the bound's cause, the value found and its limit."""

    row: int
    cause: str
    value: float
    limit: float
    is_trip: bool


@dataclass(frozen=True)
class SampleBlock:
    """Consecutive SYNC cycles.

    `first_cycle` is the index of row 0 since the port was opened; `time_ns` (n,) int64 the stamp of each SYNC;
    `counts` (n, channels) int64, unwrapped, in the order of the port's `channels`, latched at SYNC k and paired by its
    index; `flags` (n,) uint16 of `CycleFlag`; `broken` why the block ended early, if it did: its row is the last one.
    `sync_ns` (n,) int64 is when the SYNCs were on the bus by hardware, else when they were sent, on the monotonic
    clock: speeds are taken over it. None: the stamps say it themselves.
    """

    first_cycle: int
    time_ns: NDArray[np.int64]
    counts: NDArray[np.int64]
    flags: NDArray[np.uint16]
    broken: Break | None = None
    sync_ns: NDArray[np.int64] | None = None

    @property
    def interval_ns(self) -> NDArray[np.int64]:
        """The times (n,) whose differences are the time between two SYNCs; no stamp of reception is among them."""
        return self.time_ns if self.sync_ns is None else self.sync_ns

    @functools.cached_property
    def complete(self) -> NDArray[np.bool_]:
        """In which cycles (n,) every channel arrived."""
        return (self.flags & np.uint16(CycleFlag.INCOMPLETE)) == 0

    @functools.cached_property
    def complete_counts(self) -> NDArray[np.int64]:
        """The counts of the complete cycles; those of the block itself, not copied, where every cycle is one."""
        return self.counts if self.complete.all() else self.counts[self.complete]

    def __len__(self) -> int:
        return len(self.time_ns)
