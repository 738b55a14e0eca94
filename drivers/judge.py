"""The guard held against one cycle at a time, while the block is still being exchanged.

The same rule as `drivers.port.GuardWatch`, written for a single row: only the channels that the
bounds name are decoded. Where a SYNC came late the shaft had more time: a quantity that is a change
over `lag` cycles is then taken per nominal time,

    quantity * lag * period / elapsed      for elapsed > 1.5 lag * period,

or else a busy computer would look like an over-speed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.channel import Channel
from drivers.errors import DriverError
from drivers.port import STALE_DATA, Bound, Guard
from drivers.samples import Break, CycleFlag

_MEMORY = 4096
_LATE = 1.5
"""Times the nominal time after which a change is taken per time that has really passed."""


class CycleJudge:
    """Remembers the last cycles (counts and completeness) and says when a cycle breaks a guard."""

    def __init__(self, channels: Sequence[Channel], cycle_ns: int = 0) -> None:
        self._column = {channel.name: i for i, channel in enumerate(channels)}
        self._rows: deque[Sequence[int]] = deque(maxlen=_MEMORY)
        self._good: deque[bool] = deque(maxlen=_MEMORY)
        self._times: deque[int] = deque(maxlen=_MEMORY)
        self._cycle_ns = cycle_ns
        self._guard: Guard | None = None
        self._compiled: list[tuple[Bound, list[tuple[int, float]]]] = []
        self._stale = 0

    def adopt(self, guard: Guard) -> None:
        """Prepare a guard. Raises `DriverError` when it names a channel that this rig has not, or
        looks too far back.
        """
        if guard is self._guard:
            return
        if guard.history >= _MEMORY:
            raise DriverError(
                "the guard looks too far back",
                where="guard",
                value=guard.history,
                limit=f"< {_MEMORY} cycles",
            )
        try:
            self._compiled = [
                (b, [(self._column[name], w) for name, w in b.weights.items()])
                for b in guard.bounds
            ]
        except KeyError as error:
            raise DriverError(
                "the guard names a channel that this rig has not",
                where="guard",
                value=error.args[0],
                limit=", ".join(self._column),
            ) from error
        self._guard = guard

    def remember(
        self, counts: NDArray[np.int64], flags: NDArray[np.uint16], time_ns: NDArray[np.int64]
    ) -> None:
        """Remember the cycles (n, channels) of a block that was exchanged without a guard, and their stamps."""
        self._rows.extend(counts[-_MEMORY:].tolist())
        self._times.extend(time_ns[-_MEMORY:].tolist())
        complete = (flags & CycleFlag.INCOMPLETE) == 0
        self._good.extend(complete[-_MEMORY:].tolist())
        good_rows = np.flatnonzero(complete)
        self._stale = (
            len(flags) - 1 - int(good_rows[-1]) if len(good_rows) else self._stale + len(flags)
        )

    def judge(self, counts: Sequence[int], flags: int, row: int, time_ns: int = 0) -> Break | None:
        """Remember a cycle with its stamp and return the break that it makes of the adopted guard, if any."""
        good = not flags & CycleFlag.INCOMPLETE
        self._rows.append(counts)
        self._times.append(time_ns)
        self._good.append(good)
        self._stale = 0 if good else self._stale + 1
        guard = self._guard
        if guard is None:
            return None
        if guard.stale_cycles > 0 and self._stale >= guard.stale_cycles:
            return Break(row, STALE_DATA, float(self._stale), float(guard.stale_cycles), True)
        for bound, weights in self._compiled:
            value = self._total(bound, weights, 0)
            if value is None or bound.low <= value <= bound.high:
                continue
            if all(self._is_outside(bound, weights, back) for back in range(1, bound.consecutive)):
                return Break(
                    row,
                    bound.cause,
                    value,
                    bound.high if value > bound.high else bound.low,
                    bound.is_trip,
                )
        return None

    def _is_outside(self, bound: Bound, weights: list[tuple[int, float]], back: int) -> bool:
        value = self._total(bound, weights, back)
        return value is not None and not bound.low <= value <= bound.high

    def _total(self, bound: Bound, weights: list[tuple[int, float]], back: int) -> float | None:
        """The bound's quantity `back` cycles ago; None where it is not to be judged."""
        here, there = -1 - back, -1 - back - bound.lag
        if len(self._rows) < -there or not self._good[here] or not self._good[there]:
            return None
        counts, total, mask = self._rows[here], bound.offset, bound.mask
        if bound.lag:
            before = self._rows[there]
            for column, weight in weights:
                now, then = (
                    (counts[column] & mask, before[column] & mask)
                    if mask
                    else (counts[column], before[column])
                )
                total += weight * (now - then)
            total *= self._per_nominal_time(here, there, bound.lag)
        else:
            for column, weight in weights:
                total += weight * (counts[column] & mask if mask else counts[column])
        return total

    def _per_nominal_time(self, here: int, there: int, lag: int) -> float:
        """One, or nominal over elapsed time where SYNCs in between came late."""
        nominal, elapsed = lag * self._cycle_ns, self._times[here] - self._times[there]
        return nominal / elapsed if elapsed > _LATE * nominal > 0 else 1.0
