"""A sudden change of speed."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.steps.course import Course, Goal, Leg, RigView, Turned
from experiments.steps.forecast import Situation, StepForecast
from experiments.steps.kind import Motion, SegmentLabel
from experiments.steps.profile import Constant, cycles_of
from model.units import REVOLUTION, RPM

PATIENCE = 1.5
"""Times the nominal duration that missing revolutions may take ..."""
PATIENCE_MORE = 2.0
"""... and so many seconds more."""


@dataclass(frozen=True)
class SpeedStep(Motion):
    """Set the speed at once (the drive's own limits shape it) and hold it for `duration` [s], longer if
    `least_revolutions` of the input are not done by then."""

    speed: float
    duration: float
    least_revolutions: float = 0.0
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """There at once: the drive's ramp is known only when the limits are."""
        needed = self.least_revolutions * REVOLUTION / abs(self.speed) if self.speed else 0.0
        missing = max(needed - self.duration, 0.0)
        nominal = max(self.duration, needed)
        longest = self.duration + (PATIENCE * missing + PATIENCE_MORE if missing else 0.0)
        low, high = sorted((0.0, self.speed * longest))
        return at.forecast(
            nominal,
            longest,
            net=self.speed * nominal,
            travel=(low, high),
            end=self.speed,
            at_drive_ramp=True,
        )

    def course(self, rig: RigView) -> Course:
        """The time, then what is missing of the revolutions."""
        end = yield Leg(cycles_of(self.duration, rig.period), Constant(self.speed))
        missing = self.least_revolutions * REVOLUTION - abs(end.turned)
        if missing > 0.0 and self.speed != 0.0:
            patience = PATIENCE * missing / abs(self.speed) + PATIENCE_MORE
            cycles = cycles_of(patience, rig.period)
            goal = Goal(f"{self.least_revolutions:g} revolutions", cycles * rig.period)
            yield Leg(cycles, Constant(self.speed), Turned(missing, self.speed), goal)

    def words(self) -> str:
        """Where it leads to."""
        return f"{self.name} {self.speed / RPM:.4g} r/min"
