"""The present speed, held for a time, for revolutions, or until the torque is steady."""

from __future__ import annotations

import math
from dataclasses import dataclass

from experiments.steps.kind import (
    Course,
    Goal,
    Leg,
    Motion,
    Note,
    RigView,
    SegmentLabel,
    Situation,
    StepForecast,
    Turned,
)
from experiments.steps.profile import Constant, cycles_of
from model.units import REVOLUTION, RPM


@dataclass(frozen=True)
class HoldTime(Motion):
    """Hold the present speed (0 is standstill with the servo on) for `duration` [s]."""

    duration: float
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        return at.forecast(self.duration, net=at.setpoint * self.duration)

    def course(self, rig: RigView, note: Note) -> Course:
        yield Leg(cycles_of(self.duration, rig.period), Constant(rig.setpoint))


@dataclass(frozen=True)
class HoldRevolutions(Motion):
    """Hold the present speed until the input has turned `revolutions` (> 0, counted by the motor encoder)."""

    revolutions: float
    at_most: float
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """Steady; refused at standstill, where no revolution is ever done."""
        if at.setpoint == 0.0:
            raise at.refusal("revolutions cannot be counted at standstill", "0 r/min")
        nominal = self.revolutions * REVOLUTION / abs(at.setpoint)
        at.require_within(nominal, self.at_most)
        net = math.copysign(self.revolutions * REVOLUTION, at.setpoint)
        return at.forecast(nominal, self.at_most, net=net)

    def course(self, rig: RigView, note: Note) -> Course:
        until = Turned(self.revolutions * REVOLUTION, rig.setpoint)
        goal = Goal(f"{self.revolutions:g} revolutions", self.at_most)
        yield Leg(cycles_of(self.at_most, rig.period), Constant(rig.setpoint), until, goal)


@dataclass(frozen=True)
class Settle(Motion):
    """Hold the present speed until the mean torque of consecutive windows agrees within `tolerance` [N m], at most
    `at_most` [s]. `window` [s] is rounded up to whole input revolutions by whoever plans."""

    window: float
    tolerance: float
    at_most: float
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """Steady for the least time: two windows that agree."""
        nominal = min(2.0 * self.window, self.at_most)
        low, high = sorted((at.setpoint * nominal, at.setpoint * self.at_most))
        return at.forecast(nominal, self.at_most, net=at.setpoint * nominal, travel=(low, high))

    def course(self, rig: RigView, note: Note) -> Course:
        """Window after window. What never settles goes on with a warning: a plan decides by its analysis."""
        window, left = cycles_of(self.window, rig.period), cycles_of(self.at_most, rig.period)
        previous = math.nan
        while left >= window:
            end = yield Leg(window, Constant(rig.setpoint), averaged=True)
            left -= window
            # A comparison with NaN is false: the first window, or one without a complete cycle, settles nothing.
            if abs(end.mean_torque - previous) <= self.tolerance:
                return
            previous = end.mean_torque
        note(
            "warning",
            "not-settled",
            f"torque at {rig.setpoint / RPM:.4g} r/min still changed by more than {self.tolerance:g} "
            f"N m per {self.window:.3g} s "
            f"after {self.at_most:g} s",
        )
