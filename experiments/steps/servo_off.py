"""No power for a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from experiments.steps.course import Course, Leg, RigView, Servo
from experiments.steps.forecast import Drive, Piece, Situation, StepForecast
from experiments.steps.kind import Motion, SegmentLabel
from experiments.steps.profile import cycles_of


@dataclass(frozen=True)
class ServoOff(Motion):
    """Power stage off for a time [s]: nothing is held, the torque port shows its zero."""

    duration: float
    segment: SegmentLabel | None = None
    servo = Servo.OFF

    def forecast(self, at: Situation) -> StepForecast:
        """Stands."""
        return at.forecast(self.duration, end=0.0)

    def course(self, rig: RigView) -> Course:
        """One leg."""
        yield Leg(cycles_of(self.duration, rig.period))

    def pieces(self, forecast: StepForecast, left: float, drive: Drive) -> Iterator[Piece]:
        """Stands from the first moment: what coasts has no set-point."""
        yield Piece(left, 0.0, 0.0)
