"""The cycled rig: one actuator, which carries the SYNC, and sources beside it, behind `RigPort`.

Every cycle: the actuator sends set-points and SYNC; each source is asked; the actuator's own data come in; each source
is collected; the guard is held against the whole row. Pairing is by the number of the SYNC, not by arrival: what a
source does not have in time leaves its last value and a mark (`drivers.source`). On a rig with a bus the guard is
judged here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.channel import Channel
from drivers.clock import Clock
from drivers.errors import BusLostError, DriverError
from drivers.judge import CycleJudge
from drivers.port import (
    Abilities,
    Command,
    DeviceEvent,
    DirectLine,
    DriveLimits,
    Guard,
    Machine,
    RigDescription,
)
from drivers.samples import Break, SampleBlock
from drivers.source import Contained, Follower, Source

_COLLECTED_WITHIN: Final = 0.5
"""Share of the period, from the SYNC on, in which sources may answer; the rest belongs to guard and set-points."""


class Cycle(NamedTuple):
    """One SYNC cycle of the actuator: stamp [ns], latency [ns], marks, when its SYNC was on the line and how much later
    it may have been heard [ns, monotonic clock].
    """

    stamp_ns: int
    latency_ns: int
    flags: int
    sync_ns: int
    doubt_ns: int


class Actuator(Machine, Protocol):
    """What turns the motor and carries the SYNC: a drive, with what is latched on its own bus.

    A block is exchanged as `begin`, then `cycle`, `row` and `trouble` for each of its cycles, then `finish`.
    """

    on_sync: Callable[[], None] | None
    """Called right after every SYNC, those included that go out while the drive is enabled between two blocks."""

    @property
    def title(self) -> str:
        """What it is called."""
        ...

    def begin(self, command: Command, cycles: int) -> None:
        """Enter the mode and prepare the set-points of so many cycles. Raises `DriverError`."""
        ...

    def cycle(self, row: int) -> Cycle:
        """One SYNC cycle with the set-points of a row. Raises `BusLostError`."""
        ...

    def row(self, row: int, flags: int) -> list[int]:
        """The counts of the cycle that has just been, for the guard."""
        ...

    def trouble(self, row: int, flags: int) -> Break | None:
        """The onset of something in the cycle that has just been that the guard cannot see."""
        ...

    def finish(
        self, cycles: Sequence[Cycle], marks: NDArray[np.uint16] | None
    ) -> tuple[int, NDArray[np.int64], NDArray[np.uint16]]:
        """First cycle, counts (n, channels) and flags (n,) of the block; `marks` (n,) are added to the flags."""
        ...

    def lose(self, error: BusLostError) -> None:
        """The line was lost in the middle of a block: what was measured until then is kept."""
        ...


class CycledRig:
    """A rig of one actuator and sources beside it. `clock` is that of the actuator."""

    def __init__(self, actuator: Actuator, sources: Sequence[Source], clock: Clock) -> None:
        self._actuator, self._clock = actuator, clock
        self._sources = tuple(map(Contained, sources))
        self._followers: tuple[Follower, ...] = ()
        self._judge: CycleJudge | None = None
        self._sync, self._stamp_ns = -1, 0
        self._polled: frozenset[str] = frozenset()

    # --- RigPort

    @property
    def channels(self) -> Sequence[Channel]:
        """The actuator's channels, then those of each source; known once the rig is open."""
        beside = [channel for source in self._sources for channel in source.channels]
        return [*self._actuator.channels, *beside]

    @property
    def cycle_ns(self) -> int:
        """The nominal SYNC period [ns]."""
        return self._actuator.cycle_ns

    @property
    def time_base(self) -> Literal["hardware", "device", "host", "virtual"]:
        """What the time stamps are: the actuator's."""
        return self._actuator.time_base

    @property
    def line(self) -> DirectLine | None:
        """The line to each device of the actuator's bus, once the rig is open."""
        return self._actuator.line

    @property
    def abilities(self) -> Abilities:
        """Those of the actuator; the sources' events are among the events."""
        return replace(self._actuator.abilities, events=self.events)

    def open(self) -> RigDescription:
        """Bring the actuator to operation with the servo off, and connect every source. Raises `DriverError`."""
        description = self._actuator.open()
        opened: list[Source] = []
        devices: dict[str, Mapping[str, str]] = dict(description.devices)
        try:
            for source in self._sources:
                opened.append(source)
                devices[source.name] = source.open(self.cycle_ns)
            self._take_over()
        except DriverError:
            for source in opened:
                source.close()
            self._actuator.close()
            raise
        simulated = any(SIMULATED in devices[source.name] for source in self._sources)
        origin = "simulated" if simulated else description.origin
        return RigDescription(origin, description.title, devices, description.truth)

    def _take_over(self) -> None:
        """Everything that one opening of the rig needs anew."""
        channels = self.channels
        names = [channel.name for channel in channels]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise DriverError(
                "two devices measure one channel",
                where="rig",
                value=", ".join(twice),
                limit="one device for each channel",
                remedy="Take the channel away from one of them, or give it another name.",
            )
        self._judge = CycleJudge(channels, self.cycle_ns)
        self._followers = tuple(Follower(source) for source in self._sources)
        self._polled = frozenset(one.name for one in channels if one.acquired == "polled")
        self._sync = -1
        self._actuator.on_sync = self._ask_sources if self._sources else None

    def write_limits(self, limits: DriveLimits) -> DriveLimits:
        """Write the limits into the drive and return what reads back; infinite where the drive holds none."""
        return self._actuator.write_limits(limits)

    def exchange(self, command: Command, cycles: int, guard: Guard) -> SampleBlock:
        """Run up to `cycles` SYNC cycles with the set-points and return what was latched. Raises `DriverError`."""
        actuator = self._actuator
        judge = self._adopt(guard)
        actuator.begin(command, cycles)
        is_judged = bool(guard.bounds) or guard.stale_cycles > 0
        done: list[Cycle] = []
        beside: list[list[int]] = []
        marks: list[int] = []
        broken: Break | None = None
        try:
            for row in range(cycles):
                cycle = actuator.cycle(row)
                done.append(cycle)
                self._stamp_ns = cycle.stamp_ns
                flags = cycle.flags
                if self._followers:
                    counts, mark = self._collect(cycle)
                    beside.append(counts)
                    marks.append(mark)
                    flags |= mark
                if is_judged:
                    whole = actuator.row(row, cycle.flags)
                    if self._followers:
                        whole += beside[-1]
                    broken = judge.judge(whole, flags, row, cycle.sync_ns, cycle.doubt_ns)
                broken = broken or actuator.trouble(row, cycle.flags)
                if broken is not None:
                    break
        except BusLostError as error:
            actuator.lose(error)
            if not done:
                raise
            broken = Break(len(done) - 1, "bus_lost", 0.0, 0.0, True)
        return self._block(done, beside, marks, broken, None if is_judged else judge)

    def _block(
        self,
        done: list[Cycle],
        beside: list[list[int]],
        marks: list[int],
        broken: Break | None,
        not_judged: CycleJudge | None,
    ) -> SampleBlock:
        """The block out of its cycles: the actuator's counts, then those of the sources. A judge that was not asked
        remembers it all the same.
        """
        added = np.array(marks, dtype=np.uint16) if self._followers else None
        first, counts, flags = self._actuator.finish(done, added)
        if self._followers:
            others = np.array(beside, dtype=np.int64).reshape(len(done), -1)
            counts = np.concatenate([counts, others], axis=1)
        sync_ns = np.array([cycle.sync_ns for cycle in done], dtype=np.int64)
        if not_judged is not None:
            not_judged.remember(counts, flags, sync_ns)
        time_ns = np.array([cycle.stamp_ns for cycle in done], dtype=np.int64)
        return SampleBlock(first, time_ns, counts, flags, broken, sync_ns)

    def _adopt(self, guard: Guard) -> CycleJudge:
        """Take a guard over; a trip that needs to know when a value was taken is no trip of a polled channel."""
        judge = self._judge
        if judge is None:
            raise DriverError(
                "the rig is not open", where=self._actuator.title, remedy="Open it first."
            )
        for bound in guard.bounds if self._polled else ():
            named = self._polled.intersection([*bound.weights, *bound.allowance])
            if bound.is_trip and named:
                raise DriverError(
                    "a polled channel stands in a trip",
                    where=f"guard, {bound.cause}",
                    value=", ".join(sorted(named)),
                    limit="channels that are latched at the SYNC",
                    remedy="Wire the SYNC's trigger line to its device, or leave the bound away.",
                )
        judge.adopt(guard)
        return judge

    def _ask_sources(self) -> None:
        """A SYNC is out."""
        self._sync += 1
        for source in self._sources:
            source.request(self._sync)

    def _collect(self, cycle: Cycle) -> tuple[list[int], int]:
        """Counts and marks of every source for the cycle that has just been."""
        until = cycle.sync_ns + round(_COLLECTED_WITHIN * self.cycle_ns)
        counts: list[int] = []
        marks = 0
        for follower in self._followers:
            own, mark = follower.row(self._sync, until)
            counts += own
            marks |= mark
        return counts, marks

    def reset_fault(self) -> None:
        """Acknowledge a drive fault; the servo stays off."""
        self._actuator.reset_fault()

    def events(self) -> list[DeviceEvent]:
        """What happened since the last call: on the actuator's bus, then on each source's line."""
        told = self._actuator.abilities.events
        happened: list[DeviceEvent] = list(told()) if told is not None else []
        # A source knows the computer's clock alone: what it told belongs to the latest SYNC.
        beside = (event for source in self._sources for event in source.events())
        return [*happened, *(replace(event, time_ns=self._stamp_ns) for event in beside)]

    def close(self) -> None:
        """Servo off and bus released, then the sources. Never raises."""
        self._actuator.close()
        for source in self._sources:
            source.close()


SIMULATED: Final = "simulated"
"""The key under which a device that is none says so; it makes the whole rig a simulated one."""
