"""A source: channels that reach the rig beside the bus of its drive, asked at every SYNC, waited for by nobody.

The cycled rig calls `request(k)` right after SYNC k went out and `collect(k, until)` before the cycle is judged.
Neither may raise, and `collect` returns by `until` [ns of the clock]: no source can delay the next SYNC, the guard or
the way to standstill. One that raises all the same is out of use from then on (`Contained`). A channel says how its
values are taken:

- `latched`: at the SYNC itself, by a trigger line or the like. What is not there by `until` makes its cycle INCOMPLETE.
- `polled`: when the source came to it. Its latest value stands in every cycle, and a channel of its own, named by
  `taken_channel`, says how long after the SYNC (before it: negative) it was taken. It marks no cycle, stands in no
  trip, and is no half of a pair.
"""

from __future__ import annotations

import contextlib
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from drivers.channel import Channel
from drivers.event import Event
from drivers.samples import STALE_OF, CycleFlag

NANOSECOND: Final = 1e-9
_AGE_ENDING: Final = "_taken"


def taken_channel(channel: Channel) -> Channel:
    """The channel that says when a polled channel's value was taken: seconds after the SYNC of its cycle."""
    return Channel(
        name=channel.name + _AGE_ENDING,
        unit="s",
        scale=NANOSECOND,
        long_name=f"when {channel.name} was taken, after the SYNC",
        acquired="polled",
    )


@dataclass(frozen=True)
class Reading:
    """What a source holds for a cycle: counts in the order of its channels, marks of the cycle (`CycleFlag`)."""

    counts: tuple[int, ...]
    flags: int = 0


class Source(Protocol):
    """Channels beside the bus. Whatever goes wrong on its line it tells as an event, and gives None."""

    @property
    def name(self) -> str:
        """What it is called in events and in the run file."""
        ...

    @property
    def channels(self) -> Sequence[Channel]:
        """Its channels; for a polled one its `taken_channel` as well."""
        ...

    @property
    def largest_steps(self) -> Sequence[int]:
        """For each channel: counts that it can move within one cycle; 0: it is not looked at."""
        ...

    def open(self, cycle_ns: int) -> Mapping[str, str]:
        """Connect, and say who is there, in words. Raises `DriverError`."""
        ...

    def request(self, cycle: int) -> None:
        """The SYNC of this number is out: ask, and do not wait."""
        ...

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        """What belongs to this SYNC, None where it is not there by `until_ns`."""
        ...

    def events(self) -> list[Event]:
        """What happened since the last call, oldest first."""
        ...

    def close(self) -> None:
        """Let go of the line. Never raises."""
        ...


class Contained:
    """A source whose errors stay its own. What none may raise, one of another package may: the first error is told, and
    from then on nothing of it is asked, so that what is latched there becomes stale and the guard judges that.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._is_out = False
        self._told: list[Event] = []
        self._width = 0

    @property
    def name(self) -> str:
        """That of the source."""
        return self._source.name

    @property
    def channels(self) -> Sequence[Channel]:
        """Those of the source."""
        return self._source.channels

    @property
    def largest_steps(self) -> Sequence[int]:
        """Those of the source."""
        return self._source.largest_steps

    def open(self, cycle_ns: int) -> Mapping[str, str]:
        """Nothing moves yet: what is wrong here is raised."""
        self._is_out, self._told = False, []
        said = self._source.open(cycle_ns)
        self._width = len(self._source.channels)
        return said

    def request(self, cycle: int) -> None:
        """Ask, unless it is out."""
        if not self._is_out:
            try:
                self._source.request(cycle)
            except Exception as error:  # noqa: BLE001  whoever wrote it
                self._put_out("request", error)

    def collect(self, cycle: int, until_ns: int) -> Reading | None:
        """What it has; None once it is out, and for counts that are not one whole number a channel."""
        if self._is_out:
            return None
        try:
            reading = self._source.collect(cycle, until_ns)
            if reading is None:
                return None
            counts = tuple(map(operator.index, reading.counts))
            if len(counts) != self._width:
                raise ValueError(f"{len(counts)} counts for {self._width} channels")
            return Reading(counts, operator.index(reading.flags))
        except Exception as error:  # noqa: BLE001  whoever wrote it
            self._put_out("collect", error)
            return None

    def events(self) -> list[Event]:
        """What it told, and that it is out."""
        told, self._told = self._told, []
        if not self._is_out:
            try:
                told += self._source.events()
            except Exception as error:  # noqa: BLE001  whoever wrote it
                self._put_out("events", error)
        return told

    def close(self) -> None:
        """Let go of the line, whatever that raises."""
        with contextlib.suppress(Exception):
            self._source.close()

    def _put_out(self, where: str, error: Exception) -> None:
        self._is_out = True
        text = f"out of use: {where} raised {type(error).__name__}: {error}"
        self._told.append(Event(0, "error", "source-raised", self._source.name, text[:200]))


class Follower:
    """The rows of one source: what is missing holds its last value and is marked, what jumps is marked.

    A row is `counts` in the order of the source's channels and the marks of its cycle.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._last = [0] * len(source.channels)
        self._steps = tuple(source.largest_steps)
        self._is_known = False
        self._gap = 0
        latched = [one.name for one in source.channels if one.acquired == "latched"]
        self._missing = int(CycleFlag.INCOMPLETE) if latched else 0
        for name in latched:
            self._missing |= int(STALE_OF.get(name, CycleFlag.STALE_OTHER))

    def row(self, cycle: int, until_ns: int) -> tuple[list[int], int]:
        """What the source has for this SYNC."""
        reading = self._source.collect(cycle, until_ns)
        self._gap += 1
        if reading is None:
            return self._last, self._missing
        flags = reading.flags
        if self._is_known and self._has_jumped(reading.counts):
            flags |= CycleFlag.JUMPED
        self._last, self._gap, self._is_known = list(reading.counts), 0, True
        return self._last, flags

    def pause(self) -> None:
        """The SYNC has stood while the shaft did not have to: the next value is compared with nothing."""
        self._is_known = False

    def _has_jumped(self, counts: Sequence[int]) -> bool:
        moved = (abs(now - before) for now, before in zip(counts, self._last, strict=True))
        return any(
            step and far > step * self._gap for step, far in zip(self._steps, moved, strict=True)
        )
