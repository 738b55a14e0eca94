"""The clock that is handed in: wall time for a rig that turns, virtual time for one that is computed."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Nanoseconds that never run backwards, and the calendar time that belongs to them."""

    def monotonic_ns(self) -> int:
        """Nanoseconds since an arbitrary start."""
        ...

    def calendar_ns(self) -> int:
        """Nanoseconds since 1970-01-01 UTC."""
        ...

    def wait_until_ns(self, instant_ns: int) -> None:
        """Return once `monotonic_ns()` has reached the instant."""
        ...


class WallClock:
    """The clock of the rig computer."""

    def monotonic_ns(self) -> int:
        return time.monotonic_ns()

    def calendar_ns(self) -> int:
        return time.time_ns()

    def wait_until_ns(self, instant_ns: int) -> None:
        remaining = instant_ns - time.monotonic_ns()
        if remaining > 0:
            time.sleep(remaining * 1e-9)


class VirtualClock:
    """A clock that moves only when it is told to; waiting is advancing."""

    def __init__(self, calendar_start_ns: int = 0) -> None:
        self._now_ns = 0
        self._calendar_start_ns = calendar_start_ns

    def monotonic_ns(self) -> int:
        return self._now_ns

    def calendar_ns(self) -> int:
        return self._calendar_start_ns + self._now_ns

    def wait_until_ns(self, instant_ns: int) -> None:
        self._now_ns = max(self._now_ns, instant_ns)

    def advance_ns(self, duration_ns: int) -> None:
        """Move on by `duration_ns` >= 0."""
        if duration_ns < 0:
            raise ValueError(f"a clock cannot run backwards; value {duration_ns} ns, allowed >= 0")
        self._now_ns += duration_ns
