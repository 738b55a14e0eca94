"""No power for a time."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.steps.kind import (
    Course,
    Leg,
    Motion,
    Note,
    RigView,
    SegmentLabel,
    Servo,
    Situation,
    StepForecast,
)
from experiments.steps.profile import cycles_of


@dataclass(frozen=True)
class ServoOff(Motion):
    """Power stage off for a time [s]: nothing is held, the torque port shows its zero."""

    duration: float
    segment: SegmentLabel | None = None
    servo = Servo.OFF

    def forecast(self, at: Situation) -> StepForecast:
        """Stands from the first moment: what coasts has no set-point."""
        return at.forecast(self.duration, begin=0.0, end=0.0)

    def course(self, rig: RigView, note: Note) -> Course:
        yield Leg(cycles_of(self.duration, rig.period))
