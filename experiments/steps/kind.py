"""What every kind of step must say of itself, and the label of what it records."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from experiments.steps.course import Course, Note, RigView, Servo
from experiments.steps.forecast import Drive, Piece, Situation, StepForecast
from model.units import RPM

SWITCHING_TIME = 0.05
"""s; the least that switching the servo on or off takes: the drive's state is looked at after each such window."""


@dataclass(frozen=True)
class SegmentLabel:
    """What a recorded interval is: its label ("hold", "bracket", ...), set-point (SI), direction
    (+1, -1, 0), repeat.
    """

    label: str
    setpoint: float = 0.0
    direction: int = 0
    repeat: int = 0


class Motion(ABC):
    """A step that takes time, whether the input turns or stands."""

    segment: SegmentLabel | None
    servo: ClassVar[Servo] = Servo.SPEED
    """What the servo does during it."""
    takes_speed_over: ClassVar[bool] = False
    """Whether it goes on from the speed that it finds after torque control; every other step stands first."""
    speed_segment: ClassVar[bool] = True
    """Whether the set-point of its segment is a speed."""

    @abstractmethod
    def forecast(self, at: Situation) -> StepForecast:
        """What it does on an ideal rig. Raises `PlanError` for what is impossible there."""

    @abstractmethod
    def course(self, rig: RigView, note: Note) -> Course:
        """Its legs on a rig that turns."""

    def pieces(self, forecast: StepForecast, left: float, drive: Drive) -> Iterator[Piece]:
        """Its nominal course in the `left` seconds that switching leaves: linear, or at the drive's
        ramp and then held.
        """
        begin, end = forecast.begin, forecast.end
        up = min(abs(end - begin) / drive.ramp, left) if forecast.at_drive_ramp else left
        yield Piece(up, begin, end)
        yield Piece(left - up, end, end)

    @property
    def name(self) -> str:
        """The label of its segment, else its kind."""
        return type(self).__name__ if self.segment is None else self.segment.label

    def words(self) -> str:
        """The step in a few words, for the progress line and for messages."""
        label = self.segment
        if label is None or not label.direction or not self.speed_segment:
            return self.name
        return f"{self.name} {label.setpoint / RPM:.4g} r/min"


class SpeedChange(Motion):
    """A motion that leads to a `speed` [rad/s]."""

    speed: float

    def words(self) -> str:
        """Where it leads to."""
        return f"{self.name} {self.speed / RPM:.4g} r/min"


class Instant(ABC):  # noqa: B024  a common root: nothing about an instant is left open
    """A step that takes no time of the plan and moves nothing."""

    def forecast(self, at: Situation) -> StepForecast:
        return at.forecast(0.0)

    def words(self) -> str:
        return type(self).__name__
