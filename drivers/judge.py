"""The guard held against one cycle at a time, while the block is still being exchanged.

The same rule as `drivers.port.GuardWatch`, written for a single row: only the channels that the
bounds name are decoded. A speed is counts over the time between two SYNCs, as hardware stamped them,
else as they were sent (`drivers.bus.sync_time`); nothing received gives a time:

    quantity * (lag * period) / max(elapsed, lag * period).

A busy computer must never look like an over-speed, and must not hide one:

- A cycle in which frames came twice is not judged: of two values nobody knows which one is true. The third such
  cycle ends the run (`drivers.bus.strangers`).
- An interval that is shorter than its periods by more than `_JITTER` of one is not judged.
- Without a stamp of hardware the devices may have heard a SYNC later than it was sent, at the latest
  when their answer was there. A break that this doubt could explain is not one yet; while the doubt
  lasts the window grows back to where it began, so that its share of the window shrinks.
- Either is counted: `UNTIMED_CYCLES` in a row end the block as `MISSED_CYCLES`.

So whatever is above its limit is found within `UNTIMED_CYCLES` + lag + `consecutive` cycles that have
come back, at 1 kHz and a window of 4 ms within 31: as what it is, or as missed cycles where less than
the doubt lies between it and its limit.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.channel import Channel
from drivers.errors import DriverError
from drivers.port import MISSED_CYCLES, STALE_DATA, UNTIMED_CYCLES, Bound, Guard
from drivers.samples import NOT_JUDGED, Break, CycleFlag

_JITTER: Final = 0.5
"""Periods by which an interval may be shorter than it should: a SYNC that was late by less is made up for."""
_MEMORY: Final = 4096
_Weights = list[tuple[int, float]]
_Compiled = tuple[Bound, _Weights, _Weights]
"""A bound with the columns of its weights and of its allowance."""


class CycleJudge:
    """Remembers the last cycles (counts, completeness, times) and says when a cycle breaks a guard.

    `cycle_ns` 0: times are not looked at.
    """

    def __init__(self, channels: Sequence[Channel], cycle_ns: int = 0) -> None:
        self._column = {channel.name: i for i, channel in enumerate(channels)}
        self._rows: deque[Sequence[int]] = deque(maxlen=_MEMORY)
        self._good: deque[bool] = deque(maxlen=_MEMORY)
        self._times: deque[int] = deque(maxlen=_MEMORY)
        self._doubt_ns = 0
        self._cycle_ns, self._jitter_ns = cycle_ns, round(_JITTER * cycle_ns)
        self._guard: Guard | None = None
        self._compiled: list[_Compiled] = []
        self._stale = self._untimed = 0
        self._is_untimed = False

    def adopt(self, guard: Guard) -> None:
        """Prepare a guard. Raises `DriverError` when it names a channel that this rig has not, or
        looks too far back.
        """
        if guard is self._guard:
            return
        if guard.history + UNTIMED_CYCLES >= _MEMORY:
            raise DriverError(
                "the guard looks too far back",
                where="guard",
                value=guard.history,
                limit=f"< {_MEMORY - UNTIMED_CYCLES} cycles",
            )
        try:
            self._compiled = [
                (bound, self._columns(bound.weights), self._columns(bound.allowance))
                for bound in guard.bounds
            ]
        except KeyError as error:
            raise DriverError(
                "the guard names a channel that this rig has not",
                where="guard",
                value=error.args[0],
                limit=", ".join(self._column),
            ) from error
        self._guard = guard

    def _columns(self, weights: Mapping[str, float]) -> _Weights:
        return [(self._column[name], weight) for name, weight in weights.items()]

    def remember(
        self, counts: NDArray[np.int64], flags: NDArray[np.uint16], time_ns: NDArray[np.int64]
    ) -> None:
        """Remember the cycles (n, channels) of a block that was exchanged without a guard, and
        their times as of `judge`.
        """
        self._rows.extend(counts[-_MEMORY:].tolist())
        self._times.extend(time_ns[-_MEMORY:].tolist())
        complete = (flags & CycleFlag.INCOMPLETE) == 0
        self._good.extend(((flags & NOT_JUDGED) == 0)[-_MEMORY:].tolist())
        good_rows = np.flatnonzero(complete)
        self._stale = (
            len(flags) - 1 - int(good_rows[-1]) if len(good_rows) else self._stale + len(flags)
        )

    def judge(
        self, counts: Sequence[int], flags: int, row: int, time_ns: int = 0, doubt_ns: int = 0
    ) -> Break | None:
        """Remember a cycle and return the break that it makes of the adopted guard, if any.

        `time_ns` is when its SYNC was on the bus, `doubt_ns` how much later the devices may have heard it.
        """
        self._rows.append(counts)
        self._times.append(time_ns)
        self._good.append(not flags & NOT_JUDGED)
        self._doubt_ns = doubt_ns
        self._stale = self._stale + 1 if flags & CycleFlag.INCOMPLETE else 0
        guard = self._guard
        if guard is None:
            return None
        if guard.stale_cycles > 0 and self._stale >= guard.stale_cycles:
            return Break(row, STALE_DATA, float(self._stale), float(guard.stale_cycles), True)
        self._is_untimed = False
        for compiled in self._compiled:
            bound, value = compiled[0], self._value(compiled, -1)
            if value is None or bound.low <= value <= bound.high:
                continue
            if bound.consecutive > 1 and not self._lasts(compiled):
                continue
            if bound.lag and doubt_ns and self._is_doubtful(compiled):
                self._is_untimed = True
                continue
            limit = bound.high if value > bound.high else bound.low
            return Break(row, bound.cause, value, limit, bound.is_trip)
        self._untimed = self._untimed + 1 if self._is_untimed else 0
        if self._untimed >= UNTIMED_CYCLES:
            return Break(row, MISSED_CYCLES, float(self._untimed), float(UNTIMED_CYCLES), True)
        return None

    def _lasts(self, compiled: _Compiled) -> bool:
        """Whether the bound was broken in the cycles before as well."""
        bound = compiled[0]
        if len(self._rows) < bound.consecutive:
            return False
        for here in range(-2, -1 - bound.consecutive, -1):
            value = self._value(compiled, here)
            if value is None or bound.low <= value <= bound.high:
                return False
        return True

    def _is_doubtful(self, compiled: _Compiled) -> bool:
        """Whether the present break may come from a SYNC that was heard later than it was sent."""
        bound, value = compiled[0], self._value(compiled, -1, self._untimed, self._doubt_ns)
        return value is None or bound.low <= value <= bound.high

    def _value(
        self, compiled: _Compiled, here: int, longer: int = 0, doubt_ns: int = 0
    ) -> float | None:
        """The bound's quantity in the cycle `here` (-1 is the present one); None where it is not to be judged.

        `longer` widens the window of a change, `doubt_ns` is time that the shaft may have had besides.
        """
        bound, weights, allowance = compiled
        if not self._good[here]:
            return None
        if bound.lag:
            value = self._change(bound, weights, here, longer, doubt_ns)
        else:
            counts, mask = self._rows[here], bound.mask
            value = bound.offset
            for column, weight in weights:
                value += weight * (counts[column] & mask if mask else counts[column])
        if not allowance or value is None:
            return value
        moved = self._moved(allowance, here, here - bound.allowance_lag)
        if moved is None:
            return None
        return math.copysign(max(abs(value) - abs(moved), 0.0), value)

    def _change(
        self, bound: Bound, weights: _Weights, here: int, longer: int, doubt_ns: int
    ) -> float | None:
        """The bound's change up to `here`, over the time that the shaft had for it."""
        there = here - bound.lag - longer
        moved = self._moved(weights, here, there, bound.mask)
        if moved is None or not self._cycle_ns:
            return None if moved is None else bound.offset + moved
        nominal, elapsed = (here - there) * self._cycle_ns, self._times[here] - self._times[there]
        if elapsed < nominal - self._jitter_ns:
            self._is_untimed = True
            return None
        longest = elapsed if elapsed > nominal else nominal
        return bound.offset + moved * (bound.lag * self._cycle_ns / (longest + doubt_ns))

    def _moved(self, weights: _Weights, here: int, there: int, mask: int = 0) -> float | None:
        """The weighted change of the counts between two cycles; None where the earlier one is not known."""
        if len(self._rows) < -there or not self._good[there]:
            return None
        counts, before, moved = self._rows[here], self._rows[there], 0.0
        for column, weight in weights:
            now, then = counts[column], before[column]
            moved += weight * ((now & mask) - (then & mask) if mask else now - then)
        return moved
