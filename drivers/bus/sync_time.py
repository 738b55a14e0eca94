"""The time of every SYNC: its own stamp where the bus hands it back, else its first frame's, else
the host's, and said so. Beside it the time that speeds are taken over: the SYNC as stamped by
hardware, else as sent, never the stamp of something received.
"""

from __future__ import annotations

from typing import Final

from drivers.bus.network import TimeBase

_STRAY_NS: Final = 100_000_000
"""A hardware stamp further than this from when the SYNC was sent is the clock's jump, not the SYNC's delay."""


class SyncTime:
    """Stamps of one adapter made to run on: its clock may wrap, a stamp may be absent; time never runs backwards.

    A cycle whose time is only the host's stays in the adapter's time (last stamp plus what passed on the computer).
    """

    def __init__(self, base: TimeBase, wrap_ns: int = 0) -> None:
        self._base, self._wrap_ns = base, wrap_ns
        self._wraps = 0
        self._last_ns: int | None = None
        self._last_sent_ns = 0
        self._ahead_ns: int | None = None
        self.cycles = 0
        self.sync_ns = 0
        """When the latest SYNC was on the bus, on the computer's monotonic clock [ns]."""
        self.is_stamped = False
        """Whether hardware says so; else it is when the SYNC was sent."""

    def of_cycle(
        self, echo_ns: int, frames_ns: list[int], sent_ns: int, calendar_ns: int
    ) -> tuple[int, bool]:
        """The time [ns] of a cycle and whether it is only the host's.

        `echo_ns` stamp of the SYNC itself (0: none), `frames_ns` those of its frames, `sent_ns` when it was sent on the
        monotonic clock, `calendar_ns` the same on the calendar.
        """
        time_ns, is_host = self._choose(echo_ns, frames_ns, sent_ns, calendar_ns)
        if self._last_ns is not None and time_ns <= self._last_ns and self._base != "virtual":
            time_ns, is_host = self._last_ns + max(1, sent_ns - self._last_sent_ns), True
        self._place(time_ns if echo_ns and not is_host else 0, sent_ns)
        self._last_ns, self._last_sent_ns = time_ns, sent_ns
        self.cycles += 1
        return time_ns, is_host

    def now(self, monotonic_ns: int, calendar_ns: int) -> int:
        """This instant in the base of the samples; the calendar's before the first."""
        if self._last_ns is None:
            return calendar_ns
        return self._last_ns + monotonic_ns - self._last_sent_ns

    def doubt(self, latency_ns: int) -> int:
        """How much later than `sync_ns` the devices may have heard the latest SYNC [ns]: their answer was there after
        `latency_ns`.
        """
        return 0 if self.is_stamped else latency_ns

    def _place(self, stamp_ns: int, sent_ns: int) -> None:
        """Put the latest SYNC on the computer's clock; `stamp_ns` is its own stamp by hardware, 0 without one."""
        as_sent = sent_ns if self._last_ns is None else self.sync_ns + sent_ns - self._last_sent_ns
        ahead, self.sync_ns, self.is_stamped = self._ahead_ns, as_sent, False
        if not stamp_ns:
            return
        if ahead is not None and abs(stamp_ns - ahead - as_sent) <= _STRAY_NS:
            self.sync_ns, self.is_stamped = stamp_ns - ahead, True
        else:
            self._ahead_ns = stamp_ns - as_sent

    def _choose(
        self, echo_ns: int, frames_ns: list[int], sent_ns: int, calendar_ns: int
    ) -> tuple[int, bool]:
        if self._base == "virtual":
            return echo_ns or calendar_ns, False
        if self._base == "host":
            return echo_ns or calendar_ns, True
        stamp = echo_ns or min((s for s in frames_ns if s), default=0)
        if not stamp:
            return self.now(sent_ns, calendar_ns), True
        stamp += self._wraps * self._wrap_ns
        if (
            self._wrap_ns
            and self._last_ns is not None
            and stamp < self._last_ns - self._wrap_ns // 2
        ):
            self._wraps += 1
            stamp += self._wrap_ns
        return stamp, False
