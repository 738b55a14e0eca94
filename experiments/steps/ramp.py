"""A linear change of speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.steps.course import Course, Leg, RigView
from experiments.steps.forecast import Situation, StepForecast
from experiments.steps.kind import Motion, SegmentLabel
from experiments.steps.profile import ramp, ramp_travel
from model.units import RPM


@dataclass(frozen=True)
class Ramp(Motion):
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

    def course(self, rig: RigView) -> Course:
        """One leg, from the speed that there is."""
        profile = ramp(rig.speed(), self.speed, self.acceleration, rig.period)
        yield Leg(max(profile.cycles, 1), profile)

    def words(self) -> str:
        """Where it leads to."""
        return f"{self.name} {self.speed / RPM:.4g} r/min"
