"""Changes of speed: gradual, sudden, or slow until an index mark has passed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.steps.kind import (
    Course,
    Goal,
    IndexPassed,
    Leg,
    Note,
    RigView,
    SegmentLabel,
    Situation,
    SpeedChange,
    StepForecast,
    Turned,
)
from experiments.steps.profile import Constant, cycles_of, ramp, ramp_travel
from model.arrays import quotient
from model.units import REVOLUTION

PATIENCE = 1.5
"""Times the nominal duration that missing revolutions may take ..."""
_PATIENCE_MORE = 2.0
"""... and so many seconds more."""


@dataclass(frozen=True)
class Ramp(SpeedChange):
    """Change the speed linearly from the present set-point to `speed` at `acceleration` > 0 [rad/s2]."""

    speed: float
    acceleration: float
    segment: SegmentLabel | None = None
    takes_speed_over = True

    def forecast(self, at: Situation) -> StepForecast:
        """As the set-points: whole cycles, each held for one."""
        if not self.acceleration > 0.0:
            raise at.refusal(
                "a ramp needs a positive acceleration", f"{self.acceleration:g} rad/s2"
            )
        profile = ramp(at.setpoint, self.speed, self.acceleration, at.period)
        cycles = max(profile.cycles, 1)
        net = ramp_travel(at.setpoint, self.speed, cycles, at.period)
        turned = abs(net)
        if at.setpoint * self.speed < 0.0:
            turned = at.period * float(np.abs(profile.targets(0, cycles)).sum())
        return at.forecast(
            cycles * at.period,
            net=net,
            turned=turned,
            end=self.speed,
            acceleration=self.acceleration,
        )

    def course(self, rig: RigView, note: Note) -> Course:
        profile = ramp(rig.present_speed(), self.speed, self.acceleration, rig.period)
        yield Leg(max(profile.cycles, 1), profile)


@dataclass(frozen=True)
class SpeedStep(SpeedChange):
    """Set the speed at once (the drive's own limits shape it) and hold it for `duration` [s], longer if
    `least_revolutions` of the input are not done by then."""

    speed: float
    duration: float
    least_revolutions: float = 0.0
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """There at once: the drive's ramp is known only when the limits are."""
        needed = quotient(self.least_revolutions * REVOLUTION, abs(self.speed), 0.0)
        missing = max(needed - self.duration, 0.0)
        nominal = max(self.duration, needed)
        longest = self.duration + (PATIENCE * missing + _PATIENCE_MORE if missing else 0.0)
        low, high = sorted((0.0, self.speed * longest))
        return at.forecast(
            nominal,
            longest,
            net=self.speed * nominal,
            travel=(low, high),
            end=self.speed,
            at_drive_ramp=True,
        )

    def course(self, rig: RigView, note: Note) -> Course:
        """The time, then what is missing of the revolutions."""
        end = yield Leg(cycles_of(self.duration, rig.period), Constant(self.speed))
        missing = self.least_revolutions * REVOLUTION - abs(end.turned)
        if missing > 0.0 and self.speed != 0.0:
            patience = PATIENCE * missing / abs(self.speed) + _PATIENCE_MORE
            cycles = cycles_of(patience, rig.period)
            goal = Goal(f"{self.least_revolutions:g} revolutions", cycles * rig.period)
            yield Leg(cycles, Constant(self.speed), Turned(missing, self.speed), goal)


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
        nominal = min(quotient(half, abs(self.speed), math.inf), self.at_most)
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
