"""The present speed, held for a time or for revolutions."""

from __future__ import annotations

import math
from dataclasses import dataclass

from experiments.steps.course import Course, Goal, Leg, RigView, Turned
from experiments.steps.forecast import Situation, StepForecast
from experiments.steps.kind import Motion, SegmentLabel
from experiments.steps.profile import Constant, cycles_of
from model.units import REVOLUTION


@dataclass(frozen=True)
class HoldTime(Motion):
    """Hold the present speed (0 is standstill with the servo on) for `duration` [s]."""

    duration: float
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """Steady."""
        return at.forecast(self.duration, net=at.setpoint * self.duration)

    def course(self, rig: RigView) -> Course:
        """One leg."""
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
        if nominal > self.at_most:
            raise at.refusal(
                f"takes longer than its own limit of {self.at_most:g} s", f"{nominal:.4g} s"
            )
        net = math.copysign(self.revolutions * REVOLUTION, at.setpoint)
        return at.forecast(nominal, self.at_most, net=net)

    def course(self, rig: RigView) -> Course:
        """One leg, ended by the encoder."""
        until = Turned(self.revolutions * REVOLUTION, rig.setpoint)
        goal = Goal(f"{self.revolutions:g} revolutions", self.at_most)
        yield Leg(cycles_of(self.at_most, rig.period), Constant(rig.setpoint), until, goal)
