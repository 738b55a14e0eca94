"""What the stretches of a recording that count show at a glance: travel, speed, torque, unusable rows.

Means over whole segments, nothing fitted: enough to see that a channel is not what it says it is.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from experiments.contract import Evidence, Experiment
from experiments.evidence import BAD_CYCLE, SATURATED
from experiments.recording import Recording, Segment
from model.arrays import FloatArray, IntArray, joined, quotient
from model.units import REVOLUTION

TURNING = ("traverse", "hold", "bracket", "step", "warm-up", "home-input", "home-output")
"""Labels of segments that turn at the constant speed that they are set to."""
PUSHING = ("torque-ramp",)
"""Labels of segments in which a torque grows until something moves."""
RAMP = "ramp"
"""Label of segments in which the speed changes evenly."""
_TRANSIENT = ("step", "home-input", "home-output")
"""Labels of segments that begin before the set-point is reached: their second half counts here."""
ZERO_BEFORE, ZERO_AFTER = "torque-zero-before", "torque-zero-after"
SETTLED_SHARE = 0.25
"""Share at the start of a servo-off segment that is left out."""
STILL = 0.1
"""rad of the input within which a segment without a set-point has not turned."""
LEAST_TURNS = 1.25
"""Input revolutions of a hold from which on the means over its first and its last one lie apart."""
_USABLE_SHARE = 0.9
"""Share of the rows of a revolution without which its mean is none."""
LARGEST = 1_000_000
"""Rows of one segment that are looked at; of a longer one the last."""


@dataclass(frozen=True, kw_only=True)
class Hold:
    """One segment that counts: what it was set to, and what its channels show. Torques have the zero taken off."""

    segment: Segment
    duration: float
    """s from the first to the last row."""
    input_travel: float
    output_travel: float
    torque: float
    drive_torque: float
    rows: int
    unusable: int
    saturated: int

    @property
    def turns(self) -> bool:
        """Whether it turned at a constant speed, or was to: a hold at standstill was not."""
        wanted = self.segment.setpoint != 0.0 or abs(self.input_travel) > STILL
        return wanted and self.segment.label in TURNING

    @property
    def works(self) -> bool:
        """Whether friction stood against a motion, or against one that was about to begin."""
        return self.turns or self.segment.label in PUSHING

    @property
    def speed(self) -> float:
        """Mean speed of the input [rad/s]."""
        return quotient(self.input_travel, self.duration)

    @property
    def direction(self) -> int:
        """+1 or -1: the way that it was commanded to go; by its own motion where nobody wrote it down."""
        way = self.segment.direction or self.segment.setpoint or self.input_travel
        return -1 if way < 0.0 else 1


@dataclass(frozen=True)
class Recorded:
    """A recording that is to be analysed as a kind, and what its checks have in common."""

    recording: Recording
    experiment: Experiment
    evidence: Evidence

    @functools.cached_property
    def quantities(self) -> frozenset[str]:
        """The names of what its analysis may return."""
        return frozenset(quantity.name for quantity in self.experiment.quantities)

    @functools.cached_property
    def torque(self) -> str:
        """The channel that the analysis takes its torque from; "" where there is none in N m."""
        wanted = str(self.evidence.settings.get("channel", "torque"))
        for name in (wanted, "torque"):
            if self.recording.has(name) and self.recording.signals[name].unit == "N m":
                return name
        return ""

    @functools.cached_property
    def zeros(self) -> tuple[float, float]:
        """Mean reading of the torque channel with the servo off, before and after [N m]; NaN where there is none."""
        if not self.torque:
            return math.nan, math.nan
        return self._zero(ZERO_BEFORE), self._zero(ZERO_AFTER)

    @property
    def zero(self) -> float:
        """The reading that stands for no torque [N m]; 0 where none was taken."""
        known = [value for value in self.zeros if math.isfinite(value)]
        return quotient(sum(known), len(known), 0.0)

    def _zero(self, label: str) -> float:
        values = [
            self.recording.si(self.torque, slice(_settled(segment), segment.stop))
            for segment in self.recording.labelled(label)
        ]
        read = joined(values)
        return float(read.mean()) if len(read) else math.nan

    @functools.cached_property
    def holds(self) -> tuple[Hold, ...]:
        """Every segment that counts, in the order it was recorded."""
        return tuple(
            hold
            for segment in self.recording.labelled(*TURNING, *PUSHING)
            if (hold := self._hold(segment)) is not None
        )

    @property
    def turning(self) -> tuple[Hold, ...]:
        """The holds at constant speed."""
        return tuple(hold for hold in self.holds if hold.turns)

    @property
    def farthest(self) -> list[tuple[float, float]]:
        """Travel of input and output [rad] between the lowest and the highest angle of the whole recording."""
        recording = self.recording
        if not recording.has("input_angle", "output_angle"):
            return []
        good = np.flatnonzero((recording.flags() & BAD_CYCLE) == 0)
        angle = recording.si("input_angle")[good]
        if len(angle) < 2:
            return []
        ends = good[[int(angle.argmin()), int(angle.argmax())]]
        inner = recording.si("input_angle")[ends]
        outer = recording.output_angle()[ends]
        return [(float(inner[1] - inner[0]), float(outer[1] - outer[0]))]

    def travel_of_means(self, hold: Hold) -> tuple[float, float] | None:
        """Travel of input and output [rad] from the mean over the first input revolution to that over the last.

        What comes again each revolution, kinematic error and the ringing that it drives, is in no mean: it changes a
        travel from row to row by far more than its share of a tooth pair. None for a hold that is not longer than
        `LEAST_TURNS`, and where too much of a revolution was not recorded.
        """
        turns = abs(hold.input_travel) / REVOLUTION
        if not (turns >= LEAST_TURNS and self.recording.has("output_angle")):
            return None
        rows = part_of(hold.segment, self.recording.rows)
        one = round((rows.stop - rows.start) / turns)
        ends = [slice(rows.start, rows.start + one), slice(rows.stop - one, rows.stop)]
        first, last = (self._mean_angles(end) for end in ends)
        if first is None or last is None:
            return None
        return last[0] - first[0], last[1] - first[1]

    def _mean_angles(self, rows: slice) -> tuple[float, float] | None:
        """Mean angles of input and output [rad] over the usable rows, where nearly all of them are."""
        good = (self.recording.flags(rows) & BAD_CYCLE) == 0
        if np.count_nonzero(good) < _USABLE_SHARE * len(good):
            return None
        inner, outer = self.recording.si("input_angle", rows), self.recording.output_angle(rows)
        return float(inner[good].mean()), float(outer[good].mean())

    def _hold(self, segment: Segment) -> Hold | None:
        recording = self.recording
        rows = part_of(segment, recording.rows)
        flags = recording.flags(rows)
        good = np.flatnonzero((flags & BAD_CYCLE) == 0)
        if len(good) < 3 or not recording.has("input_angle"):
            return None
        first, last = (slice(row, row + 1) for row in (rows.start + good[[0, -1]]).tolist())
        output_travel = math.nan
        if recording.has("output_angle") and recording.metadata.gear_mounted:
            sense = recording.metadata.output_sense
            output_travel = sense * _change(recording.si, "output_angle", first, last)
        return Hold(
            segment=segment,
            duration=float(recording.time(last)[0] - recording.time(first)[0]),
            input_travel=_change(recording.si, "input_angle", first, last),
            output_travel=output_travel,
            torque=self._mean(self.torque, rows, good) - self.zero,
            drive_torque=self._mean("drive_torque", rows, good),
            rows=len(flags),
            unusable=len(flags) - len(good),
            saturated=int(np.count_nonzero(flags & SATURATED)),
        )

    def _mean(self, name: str, rows: slice, good: IntArray) -> float:
        if not self.recording.has(name) or self.recording.signals[name].unit != "N m":
            return math.nan
        return float(self.recording.si(name, rows)[good].mean())


def part_of(segment: Segment, rows: int) -> slice:
    """The rows of a segment that are looked at: without its transient, and not more than `LARGEST`."""
    stop = min(segment.stop, rows)
    start = max(segment.start, stop - LARGEST)
    return slice((start + stop) // 2 if segment.label in _TRANSIENT else start, stop)


def _change(
    read: Callable[[str, slice], FloatArray], name: str, first: slice, last: slice
) -> float:
    """What a channel changed by between two rows."""
    return float(read(name, last)[0] - read(name, first)[0])


def _settled(segment: Segment) -> int:
    return segment.start + int(SETTLED_SHARE * (segment.stop - segment.start))
