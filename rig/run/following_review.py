"""The speed's share of the review: its mean over a window against that of the set-point, and creep at a set-point of
zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.channel import INPUT_ANGLE, TARGET_SPEED, Channel
from drivers.port import Mode
from drivers.samples import SampleBlock
from model.units import RPM
from rig.bench import limits as lim
from rig.bench.limits import Limits
from rig.run.bounds import Watch
from rig.run.phases import Turn
from rig.run.trips import CREEP, FOLLOWING_ERROR, Trip

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class FollowingState:
    """What is carried from block to block: the last cycles (SYNCs [ns], counts of the input, set-points [rad/s]), and
    for how many cycles in a row the speed has been beyond tolerance, at most too, and has crept.
    """

    times: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    angle: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    target: FloatArray = field(default_factory=lambda: np.empty(0))
    run: int = 0
    longest: int = 0
    creep_run: int = 0


@dataclass(frozen=True, kw_only=True)
class FollowingReview:
    """Reviews the speed of one rig."""

    watch: Watch
    period: float
    channels: Mapping[str, Channel]
    column: Mapping[str, int]
    limits: Limits

    @property
    def patience(self) -> float:
        """s that a step to the highest allowed speed needs with the drive's own ramp, and room."""
        ramp = self.limits.value(lim.INPUT_SPEED) / self.limits.value(lim.ACCELERATION)
        return self.watch.following_time + (2.0 * ramp if math.isfinite(ramp) else 0.0)

    def reviewed(
        self, state: FollowingState, block: SampleBlock, turn: Turn, start: int
    ) -> tuple[FollowingState, list[Trip]]:
        """Mean speed over a window against the mean set-point, beyond tolerance for longer than
        steps and ramps need.
        """
        lag = max(1, round(self.watch.following_window / self.period))
        if not turn.enabled or turn.command.mode is not Mode.SPEED:
            return FollowingState(longest=state.longest), []
        angle = np.concatenate([state.angle, block.counts[:, self.column[INPUT_ANGLE]]])
        times = np.concatenate([state.times, block.interval_ns])
        target = np.concatenate([state.target, self._set_points(block, turn)])
        tail = slice(-lag - 1, None)
        state = replace(state, angle=angle[tail], times=times[tail], target=target[tail])
        if len(angle) <= lag:
            return state, []
        # A SYNC that came late has left the shaft more time: that between the SYNCs, the nominal one at least.
        elapsed = np.maximum((times[lag:] - times[:-lag]) * 1e-9, lag * self.period)
        channel = self.channels[INPUT_ANGLE]
        measured = (angle[lag:] - angle[:-lag]) * (channel.direction * channel.scale) / elapsed
        total = np.concatenate([[0.0], np.cumsum(target)])
        wanted = (total[lag + 1 :] - total[1:-lag]) / lag
        new = min(len(block), len(wanted))
        first = start + len(block) - new
        speeds = measured[-new:], wanted[-new:]
        state, trips = self._followed(state, *speeds, first)
        creep_run, creeping = self._creep(state.creep_run, *speeds, first)
        return replace(state, creep_run=creep_run), creeping + trips

    def _set_points(self, block: SampleBlock, turn: Turn) -> FloatArray:
        """Set-points (n,) [rad/s] of the cycles: as sent or as the drive has them, whichever is the faster."""
        sent = turn.command.target[: len(block)]
        if TARGET_SPEED not in self.column:
            return sent
        counts = block.counts[:, self.column[TARGET_SPEED]]
        received = self.channels[TARGET_SPEED].to_si(counts)
        return np.where(np.abs(sent) > np.abs(received), sent, received)

    def _followed(
        self, state: FollowingState, measured: FloatArray, wanted: FloatArray, start: int
    ) -> tuple[FollowingState, list[Trip]]:
        """Mean speeds and set-points (n,) [rad/s] that are too far apart for too long."""
        allowed = self.watch.following_absolute + self.watch.following_share * np.abs(wanted)
        error = np.abs(measured - wanted)
        patience = max(1, round(self.patience / self.period))
        at, run, longest = first_run(error > allowed, state.run, patience)
        trips: list[Trip] = []
        if at is not None:
            value, limit = error[at] / RPM, allowed[at] / RPM
            detail = f"set-point {wanted[at] / RPM:.4g} r/min, speed {measured[at] / RPM:.4g} r/min"
            trips.append(Trip(FOLLOWING_ERROR, start + at, value, limit, "r/min", detail))
        return replace(state, run=run, longest=max(longest, state.longest)), trips

    def _creep(
        self, before: int, measured: FloatArray, wanted: FloatArray, start: int
    ) -> tuple[int, list[Trip]]:
        """Speed (n,) [rad/s] where the set-point is zero, for longer than a drive that brakes is so slow: cycles in a
        row that it is so by now, of which there were some `before`.
        """
        speed = np.where(wanted == 0.0, np.abs(measured), 0.0)
        low, high = self.watch.creep_speed
        patience = max(1, round(self.watch.creep_time / self.period))
        at, run, _ = first_run((speed > low) & (speed < high), before, patience)
        if at is None:
            return run, []
        return run, [Trip(CREEP, start + at, float(speed[at]) / RPM, low / RPM, "r/min")]


def first_run(raised: NDArray[np.bool_], before: int, allowed: int) -> tuple[int | None, int, int]:
    """Where a run of `allowed` raised cycles is complete (None: nowhere), how long the run at the
    end is, and the longest.
    """
    if not raised.any():
        return None, 0, 0
    index = np.arange(len(raised))
    last_clear = np.maximum.accumulate(np.where(raised, -1 - before, index))
    lengths = np.where(raised, index - last_clear, 0)
    reached = np.flatnonzero(lengths >= allowed)
    at = int(reached[0]) if len(reached) else None
    return at, int(lengths[-1]), int(lengths.max())
