"""The present speed, held until the torque is steady."""

from __future__ import annotations

import math
from dataclasses import dataclass

from experiments.steps.course import Course, Leg, RigView
from experiments.steps.forecast import Situation, StepForecast
from experiments.steps.kind import Motion, SegmentLabel
from experiments.steps.profile import Constant, cycles_of
from model.units import RPM


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

    def course(self, rig: RigView) -> Course:
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
        rig.note(
            "warning",
            "not-settled",
            f"torque at {rig.setpoint / RPM:.4g} r/min still changed by more than {self.tolerance:g} "
            f"N m per {self.window:.3g} s "
            f"after {self.at_most:g} s",
        )
