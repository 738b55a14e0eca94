"""The one seam: everything that turns is behind `RigPort.exchange(Command, cycles, Guard) -> SampleBlock`.

target[k] acts from SYNC k on, counts[k] are latched at SYNC k, and the call returns at the first
cycle that breaks the guard. Every rig implements it: simulated, on the wire, replayed, hardware.
How a run is cut into blocks (1, 7, 100, 1000 cycles) must not change a single count. A rig of devices that can be
spoken to one by one has a `line` beside the cyclic data. What else only some rigs can do they declare as `Abilities`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Final, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.acquisition_statistics import AcquisitionReport
from drivers.channel import Channel
from drivers.samples import Break, SampleBlock

Origin = Literal["simulated", "replay", "hardware"]
Rows = TypeVar("Rows", bound=np.generic)


class Mode(Enum):
    """What the drive is told to do. QUICK_STOP switches nothing on: a rig without a quick stop (`Abilities`) takes it
    as a set-point of zero with the power stage as it is.
    """

    OFF = "servo off"
    SPEED = "cyclic velocity"
    TORQUE = "cyclic torque"
    QUICK_STOP = "quick stop"


@dataclass(frozen=True)
class Command:
    """Set-points for the coming cycles: `target` (cycles,) in rad/s (SPEED) or N m (TORQUE); empty
    in OFF and QUICK_STOP.
    """

    mode: Mode
    target: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A linear quantity of the counts that must stay within [low, high] in every complete cycle.

    quantity[k] = offset + sum over channels of weight * (counts[k] - counts[k - lag])     for lag > 0,
    quantity[k] = offset + sum over channels of weight * counts[k]                         for lag = 0.
    A change is taken over the time between the two SYNCs, by hardware's stamps or as they were sent: where they lie
    further apart than lag periods it is per lag periods. What a SYNC's lateness leaves in doubt is said by who judges
    (`drivers.judge`, `GuardWatch`). With a `mask` the counts are bit fields (a statusword) and are masked before they
    are weighted.
    With an `allowance` the quantity is taken nearer to zero, and not past it, by what a motion leaves open (encoders
    that are latched at different times read a twist that is none, in proportion to the speed):
    |sum over channels of allowance * (counts[k] - counts[k - allowance_lag])|.
    `is_trip` tells a safety limit (the supervisor trips) from an engine's "until" (the step is over). The first `lag`
    or `allowance_lag` cycles after opening, and cycles that are flagged incomplete or look back at one that is, are
    not judged. `consecutive` cycles must break it.
    """

    cause: str
    weights: Mapping[str, float]
    low: float = -math.inf
    high: float = math.inf
    lag: int = 0
    offset: float = 0.0
    is_trip: bool = True
    consecutive: int = 1
    mask: int = 0
    allowance: Mapping[str, float] = field(default_factory=dict[str, float])
    allowance_lag: int = 1

    @property
    def looks_back(self) -> set[int]:
        """How many cycles before the one that is judged lie those that it is compared with."""
        return {self.lag, self.allowance_lag if self.allowance else 0} - {0}


STALE_DATA = "stale_data"
"""The cause of a break by too many incomplete cycles in a row."""
LATE_ANSWERS = "late-answers"
"""The code of the event that the answers of several incomplete cycles were late, not lost: too slow, not unplugged."""
MISSED_CYCLES = "missed_cycles"
"""The cause of a break by too many cycles in a row whose time nobody knows well enough to judge a speed."""
UNTIMED_CYCLES: Final = 25
"""So many of them in a row are too many."""


@dataclass(frozen=True)
class Guard:
    """The bounds that every cycle is held against while a block is exchanged.

    `stale_cycles` incomplete cycles in a row break the guard as well (cause `STALE_DATA`); 0 watches no such thing.
    """

    bounds: tuple[Bound, ...] = ()
    stale_cycles: int = 0

    @property
    def history(self) -> int:
        """Cycles before a block that are needed to judge it."""
        needed = max(
            (max(b.looks_back, default=0) + b.consecutive - 1 for b in self.bounds), default=0
        )
        return max(needed, self.stale_cycles - 1, 0)


@dataclass(frozen=True)
class DriveLimits:
    """The last software line of defence, held by the drive itself: motor side, SI.

    torque (0x6072), speed (0x6080), acceleration and deceleration (0x6083, 0x6084), quick-stop deceleration (0x6085).
    """

    torque: float
    speed: float
    acceleration: float
    deceleration: float
    quick_stop_deceleration: float


@dataclass(frozen=True)
class RigDescription:
    """What stands on the other side of the port: origin, one line in words, devices, and the truth
    if it is simulated.
    """

    origin: Origin
    title: str
    devices: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    truth: Mapping[str, object] | None = None


class Reach(Enum):
    """How the device of a channel can be reached now."""

    PROCESS_DATA = "process data"
    """It is OPERATIONAL, and its process data came with the latest SYNC."""
    SDO = "SDO only"
    """It is not OPERATIONAL, or no SYNC makes it answer: process data do not act there."""
    NMT_FIRST = "NMT first"
    """It is STOPPED, did not answer the latest SDO, or refused the controlword."""


class Ask(Enum):
    """What a device can be asked beside the cyclic data. Nothing here can enable a drive."""

    WAKE = "NMT enter pre-operational"
    """Never START: a node that is started would follow whatever process data are on the bus."""
    QUICK_STOP = "quick stop"
    SERVO_OFF = "servo off"
    READ = "read"


@dataclass(frozen=True)
class Request:
    """One thing asked of the device that carries `channel`."""

    ask: Ask
    channel: str


@dataclass(frozen=True)
class Answer:
    """What came of a request, and in which cycle since the port was opened; `count` None: refused, or not answered."""

    request: Request
    cycle: int
    count: int | None


class DirectLine(Protocol):
    """A line to each device beside the cyclic data. It never blocks: `exchange` sends at most one request per device
    and cycle, and takes answers as frames arrive. Nothing here raises.
    """

    def reach(self, channel: str) -> Reach:
        """How the device that carries a channel can be reached now."""
        ...

    def is_idle(self, channel: str) -> bool:
        """Whether the device that carries a channel has been asked everything that was handed over."""
        ...

    def hand(self, requests: Sequence[Request]) -> None:
        """What is asked next, in this order for each device; what these devices were being asked is withdrawn."""
        ...

    def withdraw(self, channel: str) -> None:
        """Ask the device that carries a channel nothing any more."""
        ...

    def answers(self) -> list[Answer]:
        """What has come of the requests since the last call, oldest first."""
        ...


class DeviceEvent(Protocol):
    """Something that a device told: time in the base of the samples [ns], level, code, source, text."""

    @property
    def time_ns(self) -> int: ...

    @property
    def level(self) -> str: ...

    @property
    def code(self) -> str: ...

    @property
    def source(self) -> str: ...

    @property
    def text(self) -> str: ...


@dataclass(frozen=True, kw_only=True)
class Abilities:
    """What a rig can do beyond exchanging cycles. It declares this itself: what is not here is asked of no rig.

    - `events`: what its devices told since the last call, oldest first;
    - `acquisition`: how well it kept time since it was opened (`DriverError` where nobody can say);
    - `quick_stop_frames`: (COB-ID, data) of the frames that stop the drive past this loop, from another handle on the
      bus: what a watchdog sends when the loop is dead;
    - `unwatched`: why the motor would go on when the computer is lost, in words, empty where the drive stops by
      itself; known once the rig is open. Without it nobody knows, which is as bad;
    - `has_quick_stop`: QUICK_STOP brings the motor to rest by the drive's own ramp; without it that mode is a set-point
      of zero;
    - `keep_frames`: writes the bus frames of the last so many seconds to a file, once the rig is closed, and says how
      many (`OSError` where it cannot be written);
    - `reads_limits_back`: the limits are in the drive, and `write_limits` returns what it holds; without it somebody
      has set them by the maker's tool and says so when the rig is armed.
    """

    events: Callable[[], Sequence[DeviceEvent]] | None = None
    acquisition: Callable[[], AcquisitionReport] | None = None
    quick_stop_frames: Callable[[], Sequence[tuple[int, bytes]]] | None = None
    unwatched: Callable[[], Sequence[str]] | None = None
    has_quick_stop: bool = True
    reads_limits_back: bool = True
    keep_frames: Callable[[Path, float], int] | None = None


class Machine(Protocol):
    """What a rig and the actuator under a cycled rig have in common: channels, clock, limits, and a way off."""

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels in the order of the columns of every block."""
        ...

    @property
    def cycle_ns(self) -> int:
        """The nominal SYNC period [ns]."""
        ...

    @property
    def time_base(self) -> Literal["hardware", "device", "host", "virtual"]:
        """What the time stamps are."""
        ...

    @property
    def line(self) -> DirectLine | None:
        """The line to each device beside the cyclic data; None: this rig has none. Known once the rig is open."""
        ...

    @property
    def abilities(self) -> Abilities:
        """What this rig can do beyond exchanging cycles. Known before it is open."""
        ...

    def open(self) -> RigDescription:
        """Connect, bring every device to operation with the servo off, and say what is there."""
        ...

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits into the drive and return what reads back."""
        ...

    def reset_fault(self) -> None:
        """Acknowledge a drive fault after an operator has acknowledged it by name."""
        ...

    def close(self) -> None:
        """Servo off, release the bus. Never raises because something is already gone."""
        ...


class RigPort(Machine, Protocol):
    """A rig: servo amplifier, torque port, both encoders and their acquisition by SYNC."""

    def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
        """Run `cycles` SYNC cycles (fewer if the guard breaks) and return what was latched. Raises `DriverError`."""
        ...


class GuardWatch:
    """Judges blocks against a guard for a port: keeps the tail of counts that lagged bounds need.

    With times of the SYNCs (and their period) a change is taken over the time between two of them, as
    `drivers.judge` does it. It needs neither the doubt nor the count of that rule: what is simulated or
    recorded has its times already, and nothing turns behind it that could hide.
    """

    def __init__(self, channels: Sequence[Channel], cycle_ns: int = 0, memory: int = 1024) -> None:
        self._column = {channel.name: i for i, channel in enumerate(channels)}
        self._cycle_ns, self._memory = cycle_ns, memory
        self._tail_time: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._tail: NDArray[np.int64] = np.empty((0, len(channels)), dtype=np.int64)
        self._tail_good: NDArray[np.bool_] = np.empty(0, dtype=bool)

    def first_break(
        self,
        guard: Guard,
        counts: NDArray[np.int64],
        flags: NDArray[np.uint16],
        time_ns: NDArray[np.int64] | None = None,
    ) -> Break | None:
        """The first row of `counts` (n, channels) that breaks a bound, seen with the rows accepted
        before; `time_ns` (n,) are the times of the SYNCs.
        """
        if not (guard.bounds or guard.stale_cycles) or not len(counts):
            return None
        keep = min(guard.history, len(self._tail))
        joined = _followed(self._tail[len(self._tail) - keep :], counts)
        good = _followed(self._tail_good[len(self._tail) - keep :], (flags & 1) == 0)
        times = None
        if self._cycle_ns and time_ns is not None:
            times = np.concatenate([self._tail_time[len(self._tail_time) - keep :], time_ns])
        breaks = [self._stale(guard.stale_cycles, good, keep)]
        breaks += [self._judge(bound, joined, good, keep, times) for bound in guard.bounds]
        return min((b for b in breaks if b is not None), key=lambda b: b.row, default=None)

    def accept(
        self,
        counts: NDArray[np.int64],
        flags: NDArray[np.uint16],
        time_ns: NDArray[np.int64] | None = None,
    ) -> None:
        """Remember the rows that were really returned, with their times if they are judged with them."""
        if time_ns is not None:
            self._tail_time = last_rows(self._tail_time, time_ns, self._memory)
        self._tail = last_rows(self._tail, counts, self._memory)
        self._tail_good = last_rows(self._tail_good, (flags & 1) == 0, self._memory)

    def _stale(self, cycles: int, good: NDArray[np.bool_], keep: int) -> Break | None:
        if cycles <= 0 or good[keep:].all():
            return None
        run = 0
        for index, complete in enumerate(good):
            run = 0 if complete else run + 1
            if run >= cycles and index >= keep:
                return Break(index - keep, STALE_DATA, float(run), float(cycles), True)
        return None

    def _sum(
        self, weights: Mapping[str, float], joined: NDArray[np.int64], lag: int, mask: int = 0
    ) -> NDArray[np.float64]:
        """The weighted sum (n,) of counts, for a `lag` of their change over it (0 in the first of them)."""
        total = np.zeros(len(joined))
        for name, weight in weights.items():
            column = joined[:, self._column[name]]
            if mask:
                column = column & mask
            total[lag:] += weight * (column[lag:] - column[:-lag] if lag else column)
        return total

    def _holds(self, bound: Bound, joined: NDArray[np.int64]) -> bool:
        """Whether a bound on the counts of one channel, as they are, holds from the least to the largest of them.

        What is between them is between their sums as well: rounding keeps the order.
        """
        if len(bound.weights) != 1 or bound.lag or bound.mask or bound.allowance:
            return False
        ((name, weight),) = bound.weights.items()
        column = joined[:, self._column[name]]
        ends = (weight * float(end) + bound.offset for end in (column.min(), column.max()))
        return all(bound.low <= end <= bound.high for end in ends)

    def _judge(
        self,
        bound: Bound,
        joined: NDArray[np.int64],
        good: NDArray[np.bool_],
        keep: int,
        times: NDArray[np.int64] | None,
    ) -> Break | None:
        if self._holds(bound, joined):
            return None
        total = self._sum(bound.weights, joined, bound.lag, bound.mask)
        if bound.lag and times is not None:
            nominal = bound.lag * self._cycle_ns
            total[bound.lag :] *= nominal / np.maximum(
                times[bound.lag :] - times[: -bound.lag], nominal
            )
        total += bound.offset
        if not bound.allowance and total.min() >= bound.low and total.max() <= bound.high:
            return None
        if bound.allowance:
            allowed = np.abs(self._sum(bound.allowance, joined, bound.allowance_lag))
            total = np.copysign(np.maximum(np.abs(total) - allowed, 0.0), total)
        outside = ((total < bound.low) | (total > bound.high)) & good
        if not outside.any():
            return None
        for lag in bound.looks_back:
            outside[:lag] = False
            outside[lag:] &= good[:-lag]
        run = outside.copy()
        for shift in range(1, bound.consecutive):
            run[shift:] &= outside[:-shift]
            run[:shift] = False
        rows = np.flatnonzero(run[keep:])
        if not len(rows):
            return None
        row = int(rows[0])
        value = float(total[keep + row])
        return Break(
            row, bound.cause, value, bound.high if value > bound.high else bound.low, bound.is_trip
        )


def last_rows(before: NDArray[Rows], new: NDArray[Rows], most: int) -> NDArray[Rows]:
    """The last rows, `most` of them at most, of what was kept before and new rows (n, ...)."""
    return new[-most:] if len(new) >= most else _followed(before, new)[-most:]


def _followed(before: NDArray[Rows], new: NDArray[Rows]) -> NDArray[Rows]:
    return np.concatenate([before, new]) if len(before) else new
