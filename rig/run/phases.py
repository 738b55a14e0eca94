"""Phases: the smallest thing that a run does. A source of phases is walked block by block, whatever the block length.

A phase is one drive mode with one set-point profile, for a number of cycles or until a bound is broken. Engine and
make-safe are both generators of phases; `PhaseRunner` turns them into commands and hands back how each phase ended. All
decisions fall at ends of phases, so at cycles that do not depend on how the run is cut into blocks.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.channel import (
    INDEX_SEEN,
    INPUT_ANGLE,
    INPUT_INDEX,
    OUTPUT_ANGLE,
    OUTPUT_INDEX,
    STATUSWORD,
    Channel,
)
from drivers.drive_state import DriveState, drive_state
from drivers.port import Bound, Command, Mode, last_rows
from drivers.samples import Break, SampleBlock, is_stale
from experiments.steps.kind import SegmentLabel
from experiments.steps.profile import Constant, Profile

STANDSTILL: Profile = Constant(0.0)
"""The set-point of a phase that does not move."""
INDEX_LATCHES = {"input": (INPUT_INDEX, 1), "output": (OUTPUT_INDEX, 2)}
"""The channel that latches the index mark of each encoder, and its bit of `INDEX_SEEN`."""
HISTORY = 256
"""Cycles that the machine remembers, for speeds measured over a few of them."""


@dataclass(frozen=True, slots=True)
class Phase:
    """`cycles` at most in `mode` following `profile`, shorter when a bound of `until` is broken.

    `tally` names a channel whose counts are summed over the complete cycles. `enabled` says that the drive must be in
    "operation enabled" all the time; while it is being switched on or off it need not be.
    """

    mode: Mode
    cycles: int
    profile: Profile = STANDSTILL
    until: tuple[Bound, ...] = ()
    tally: str = ""
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class _PhaseEnd:
    """How a phase ended: cycles done, the bound that ended it (None: its cycles were up), and the
    tally (exact integers).
    """

    cycles: int
    broken: Break | None
    total: int = 0
    samples: int = 0
    incomplete: int = 0


@dataclass(frozen=True, slots=True)
class Turn:
    """What to exchange next: a command, for how many cycles, ended by which bounds, with the drive enabled or not."""

    command: Command
    cycles: int
    until: tuple[Bound, ...] = ()
    enabled: bool = False


Phases = Generator[Phase, _PhaseEnd, None]


class Journal(Protocol):
    """Where a source of phases writes segments (rows [start, stop)) and events."""

    def segment(self, label: SegmentLabel, start: int, stop: int) -> None:
        """Keep a finished segment."""

    def event(self, level: str, code: str, source: str, text: str) -> None:
        """Keep an event."""


class Machine:
    """What is known of the rig while it turns: its channels, the rows so far, the last ones, mode
    and speed set-point.
    """

    def __init__(self, channels: Sequence[Channel], cycle_ns: int) -> None:
        self.channels = {channel.name: channel for channel in channels}
        self.column = {channel.name: i for i, channel in enumerate(channels)}
        self.period = cycle_ns * 1e-9
        self.rows = 0
        self.mode = Mode.OFF
        self.setpoint = 0.0
        self.first: NDArray[np.int64] = np.zeros(len(channels), dtype=np.int64)
        self._tail: NDArray[np.int64] = np.empty((0, len(channels)), dtype=np.int64)
        self._tail_flags: NDArray[np.uint16] = np.empty(0, dtype=np.uint16)

    def accept(self, block: SampleBlock, turn: Turn) -> None:
        """Remember a block that was exchanged and the command that it ran under."""
        if not len(block):
            return
        if not self.rows:
            self.first = block.counts[0].copy()
        self.rows += len(block)
        self._tail = last_rows(self._tail, block.counts, HISTORY)
        self._tail_flags = last_rows(self._tail_flags, block.flags, HISTORY)
        self.mode = turn.command.mode
        self.setpoint = (
            float(turn.command.target[len(block) - 1]) if self.mode is Mode.SPEED else 0.0
        )

    def has(self, name: str) -> bool:
        """Whether the rig has this channel."""
        return name in self.column

    def counts(self, name: str) -> int:
        """The latest count of a channel."""
        return int(self._tail[-1, self.column[name]])

    def si(self, name: str) -> float:
        """The latest value of a channel in SI."""
        channel = self.channels[name]
        return self.counts(name) * channel.direction * channel.scale + channel.offset

    def moved(self, name: str, cycles: int) -> float:
        """How far a channel has moved in the last `cycles` [its unit]; over what there is if the run is younger."""
        back = min(cycles, len(self._tail) - 1)
        column = self.column[name]
        channel = self.channels[name]
        return (
            float(self._tail[-1, column] - self._tail[-1 - back, column])
            * channel.direction
            * channel.scale
        )

    def speed(self, name: str = INPUT_ANGLE, cycles: int = 5) -> float:
        """Mean speed of an angle channel over the last `cycles` [rad/s]."""
        back = max(1, min(cycles, len(self._tail) - 1))
        return self.moved(name, back) / (back * self.period) if len(self._tail) > 1 else 0.0

    def present_speed(self) -> float:
        """The speed set-point; under torque control, where there is none, the speed as measured [rad/s]."""
        return self.speed() if self.mode is Mode.TORQUE else self.setpoint

    def input_angle(self) -> float:
        """The latest input angle [rad]."""
        return self.si(INPUT_ANGLE)

    def output_angle(self) -> float:
        """The latest output angle [rad]."""
        return self.si(OUTPUT_ANGLE)

    def phase_origin(self) -> float:
        """The latest input index mark, where none was seen the input angle at the start of the run [rad]."""
        if self.has_index("input"):
            return self.index_angle("input")
        channel = self.channels[INPUT_ANGLE]
        first = int(self.first[self.column[INPUT_ANGLE]])
        return first * channel.direction * channel.scale + channel.offset

    def has_index(self, which: str) -> bool:
        """Whether an index mark, "input" or "output", has passed since the rig was opened."""
        latch, bit = INDEX_LATCHES[which]
        return self.has(latch) and self.has(INDEX_SEEN) and bool(self.counts(INDEX_SEEN) & bit)

    def index_angle(self, which: str) -> float:
        """The angle at the latest index mark of an encoder, "input" or "output" [rad]."""
        return self.si(INDEX_LATCHES[which][0])

    def is_heard(self, name: str, cycles: int) -> bool:
        """Whether a channel arrived in each of the last `cycles`, whatever else stayed away."""
        return not bool(np.any(is_stale(self._tail_flags[-cycles:], name)))

    @property
    def state(self) -> DriveState | None:
        """The drive's state in the latest cycle; None for a rig that does not report it."""
        return drive_state(self.counts(STATUSWORD)) if self.has(STATUSWORD) and self.rows else None


class PhaseRunner:
    """Walks a generator of phases: blocks in, turns out, at most `block_cycles` at a time."""

    def __init__(self, phases: Phases, machine: Machine, block_cycles: int) -> None:
        self._phases = phases
        self._machine = machine
        self._block_cycles = block_cycles
        self._phase: Phase | None = None
        self._started = False
        self._done_cycles = 0
        self._total = self._samples = self._incomplete = 0

    def next(self, block: SampleBlock | None) -> Turn | None:
        """The next turn after `block` (None: at the start), or None when the phases are over."""
        if not self._started:
            self._started = True
            self._enter(next(self._phases, None))
        elif self._phase is not None and block is not None:
            self._consume(self._phase, block)
        return self._turn()

    def _enter(self, phase: Phase | None) -> None:
        self._phase = phase
        self._done_cycles = self._total = self._samples = self._incomplete = 0

    def _consume(self, phase: Phase, block: SampleBlock) -> None:
        self._done_cycles += len(block)
        complete = block.complete_counts
        self._incomplete += len(block) - len(complete)
        if phase.tally:
            self._total += int(complete[:, self._machine.column[phase.tally]].sum())
            self._samples += len(complete)
        # A trip ends the run, not the phase: make-safe leads from the next turn on.
        broken = block.broken if block.broken is not None and not block.broken.is_trip else None
        if broken is None and self._done_cycles < phase.cycles:
            return
        end = _PhaseEnd(self._done_cycles, broken, self._total, self._samples, self._incomplete)
        try:
            self._enter(self._phases.send(end))
        except StopIteration:
            self._enter(None)

    def _turn(self) -> Turn | None:
        phase = self._phase
        if phase is None:
            return None
        cycles = min(self._block_cycles, phase.cycles - self._done_cycles)
        if phase.mode in (Mode.OFF, Mode.QUICK_STOP):
            command = Command(phase.mode)
        else:
            command = Command(phase.mode, phase.profile.targets(self._done_cycles, cycles))
        return Turn(
            command, cycles, phase.until, phase.enabled and phase.mode in (Mode.SPEED, Mode.TORQUE)
        )
