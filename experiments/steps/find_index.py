"""A search for an index mark."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.steps.course import Course, Goal, IndexPassed, Leg, Note, RigView
from experiments.steps.forecast import Situation, StepForecast
from experiments.steps.kind import SegmentLabel, SpeedChange
from experiments.steps.profile import Constant, cycles_of
from model.units import REVOLUTION


@dataclass(frozen=True)
class FindIndex(SpeedChange):
    """Turn slowly at `speed` until an index mark has passed ("input" or "output"), at most `at_most` [s]."""

    which: str
    speed: float
    at_most: float
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """Half-way round, the mean of what it may be."""
        if self.which not in ("input", "output"):
            raise at.refusal('index marks are of "input" and "output"', self.which)
        half = 0.5 * REVOLUTION * (at.ratio if self.which == "output" else 1.0)
        nominal = min(half / abs(self.speed), self.at_most) if self.speed else self.at_most
        low, high = sorted((0.0, self.speed * self.at_most))
        return at.forecast(
            nominal,
            self.at_most,
            net=self.speed * nominal,
            travel=(low, high),
            end=self.speed,
            at_drive_ramp=True,
        )

    def course(self, rig: RigView, note: Note) -> Course:
        goal = Goal(f"the {self.which} index mark", self.at_most)
        cycles = cycles_of(self.at_most, rig.period)
        yield Leg(cycles, Constant(self.speed), IndexPassed(self.which), goal)
        angle = rig.index_angle(self.which)
        note(
            "info",
            f"index-{self.which}",
            f"{self.which} index mark latched at {angle:.6f} rad",
        )
