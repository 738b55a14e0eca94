"""A recorded run behind the same seam as a rig: its counts come back cycle by cycle, whatever is commanded.

For looking at an old run again with engine, supervisor and analysis as they are today. Nothing
turns: set-points have no effect, and the recorded ones stand in the target channels. Guards are
judged as on any rig, at any block length. When the recording is over, `exchange` returns what is
left, and raises `StaleDataError` from then on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.channel import Channel
from drivers.clock import Clock, VirtualClock
from drivers.errors import DriverError, StaleDataError
from drivers.port import Abilities, Command, DriveLimits, Guard, GuardWatch, Mode, RigDescription
from drivers.samples import SampleBlock

TimeBase = Literal["hardware", "device", "host", "virtual"]


class ReplayRig:
    """A run that was recorded: `channels`, `time_ns` (n,), `counts` (n, channels) and `flags` (n,),
    SYNC period `cycle_ns`.

    `description` tells the recorded rig's devices and truth; `clock` is moved on by one period per cycle. Raises
    `DriverError` when the arrays do not belong together.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        time_ns: ArrayLike,
        counts: ArrayLike,
        flags: ArrayLike,
        *,
        cycle_ns: int,
        title: str = "recorded run",
        devices: Mapping[str, Mapping[str, str]] | None = None,
        truth: Mapping[str, object] | None = None,
        time_base: TimeBase = "hardware",
        clock: Clock | None = None,
    ) -> None:
        self._channels = tuple(channels)
        self._time_ns = np.asarray(time_ns, dtype=np.int64)
        self._counts = np.asarray(counts, dtype=np.int64)
        self._flags = np.asarray(flags, dtype=np.uint16)
        self._cycle_ns = cycle_ns
        self._time_base: TimeBase = time_base
        self._description = RigDescription("replay", title, dict(devices or {}), truth)
        self._clock: Clock = clock or VirtualClock()
        self._title = title
        self._check()
        self._next = 0
        self._open = False
        self._opened_ns = 0

    @property
    def channels(self) -> Sequence[Channel]:
        """The recorded channels in the order of the columns of every block."""
        return self._channels

    @property
    def cycle_ns(self) -> int:
        """The nominal SYNC period of the recording [ns]."""
        return self._cycle_ns

    @property
    def time_base(self) -> TimeBase:
        """What the recorded time stamps are."""
        return self._time_base

    @property
    def remaining(self) -> int:
        """Cycles that have not been played yet."""
        return len(self._time_ns) - self._next

    @property
    def abilities(self) -> Abilities:
        """What was recorded happens; there is nobody to ask."""
        return Abilities()

    @property
    def line(self) -> None:
        """A recording cannot be asked for more than it holds."""

    def open(self) -> RigDescription:
        """Begin at the first recorded cycle."""
        if self._open:
            raise DriverError("is already open", where=self._title, remedy="Close it first.")
        self._open, self._next = True, 0
        self._opened_ns = self._clock.monotonic_ns()
        self._watch = GuardWatch(self._channels, self._cycle_ns)
        return self._description

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """There is no drive to hold limits: what is written is returned."""
        return limits

    def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
        """The next recorded cycles, fewer where the guard breaks or the recording ends;
        `StaleDataError` after its end.
        """
        self._check_command(command, cycles)
        if not self.remaining:
            raise StaleDataError(
                "the recording is over",
                where=self._title,
                value=f"after {len(self._time_ns)} cycles",
                remedy="A longer protocol than the recorded one cannot be replayed: stop here.",
            )
        rows = slice(self._next, min(self._next + cycles, len(self._time_ns)))
        counts, flags = self._counts[rows], self._flags[rows]
        broken = self._watch.first_break(guard, counts, flags, self._time_ns[rows])
        if broken is not None:
            counts, flags = counts[: broken.row + 1], flags[: broken.row + 1]
        self._watch.accept(counts, flags, self._time_ns[rows][: len(counts)])
        first, self._next = self._next, self._next + len(counts)
        self._clock.wait_until_ns(self._opened_ns + self._next * self._cycle_ns)
        return SampleBlock(
            first, self._time_ns[first : self._next].copy(), counts.copy(), flags.copy(), broken
        )

    def reset_fault(self) -> None:
        """A recorded fault stays where it was recorded."""

    def close(self) -> None:
        """End of the replay; calling it again does nothing."""
        self._open = False

    def _check(self) -> None:
        n = len(self._time_ns)
        shapes = (self._time_ns.shape, self._counts.shape, self._flags.shape)
        if shapes != ((n,), (n, len(self._channels)), (n,)):
            raise DriverError(
                "the recorded arrays do not belong together",
                where=self._title,
                value=shapes,
                limit=f"(n,), (n, {len(self._channels)}), (n,)",
                remedy="The file is damaged, or of another version.",
            )
        if not n:
            raise DriverError(
                "the recording is empty", where=self._title, value=0, limit=">= 1 cycle"
            )
        if self._cycle_ns <= 0:
            raise DriverError(
                "the SYNC period must be positive",
                where=self._title,
                value=self._cycle_ns,
                limit="> 0 ns",
            )

    def _check_command(self, command: Command, cycles: int) -> None:
        if not self._open:
            raise DriverError("is not open", where=self._title, remedy="Open it first.")
        if cycles < 1:
            raise DriverError("a block needs cycles", where=self._title, value=cycles, limit=">= 1")
        expected = cycles if command.mode in (Mode.SPEED, Mode.TORQUE) else 0
        if len(command.target) != expected:
            raise DriverError(
                f"{command.mode.value} takes one set-point per cycle, or none",
                where=self._title,
                value=len(command.target),
                limit=str(expected),
            )
