"""Moves from standstill to standstill: to an angle, or by revolutions."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

from experiments.steps.kind import (
    Course,
    Drive,
    Goal,
    Leg,
    Motion,
    Note,
    Piece,
    RigView,
    SegmentLabel,
    Situation,
    StepForecast,
    Turned,
)
from experiments.steps.profile import cruise_speed, cycles_of, ramp, stopping_distance
from model.units import REVOLUTION

_STAND_TIME = 0.05
"""s of standstill at the end of a move."""
_SHORTEST_APPROACH = 0.1
"""rad; an angle that is nearer than this is approached by a whole revolution, so that it is reached
from the stated side.
"""


class Move(Motion):
    """Ramp, cruise, brake in time and stand, without coming back."""

    speed: float
    acceleration: float
    at_most: float

    @abstractmethod
    def distance(self, rig: RigView) -> float:
        """How far it is from here [rad, signed]."""

    def course(self, rig: RigView, note: Note) -> Course:
        """Away until there is just room to brake, to a stop, and a moment at rest."""
        distance = self.distance(rig)
        speed = cruise_speed(self.speed, self.acceleration, distance, rig.period)
        brake = stopping_distance(speed, self.acceleration, rig.period)
        until = Turned(max(abs(distance) - brake, 0.0), distance)
        away = ramp(rig.setpoint, math.copysign(speed, distance), self.acceleration, rig.period)
        goal = Goal(f"{distance / REVOLUTION:.4g} revolutions", self.at_most)
        yield Leg(cycles_of(self.at_most, rig.period), away, until, goal)
        stop = ramp(rig.setpoint, 0.0, self.acceleration, rig.period)
        yield Leg(max(stop.cycles, 1), stop)
        yield Leg(cycles_of(_STAND_TIME, rig.period))

    def pieces(self, forecast: StepForecast, left: float, drive: Drive) -> Iterator[Piece]:
        """Ramp, cruise, ramp, stand."""
        if forecast.net == 0.0:
            yield from super().pieces(forecast, left, drive)
            return
        peak = math.copysign(forecast.speed, forecast.net)
        away = ramp(forecast.begin, peak, self.acceleration, drive.period).cycles * drive.period
        brake = ramp(peak, 0.0, self.acceleration, drive.period).cycles * drive.period
        stand = min(
            cycles_of(_STAND_TIME, drive.period) * drive.period, max(left - away - brake, 0.0)
        )
        yield Piece(away, forecast.begin, peak)
        yield Piece(max(left - away - brake - stand, 0.0), peak, peak)
        yield Piece(brake, peak, 0.0)
        yield Piece(stand, 0.0, 0.0)

    def _forecast(
        self, at: Situation, distance: float, travel: tuple[float, float]
    ) -> StepForecast:
        if not (self.acceleration > 0.0 and self.speed != 0.0):
            raise at.refusal(
                "a move needs a speed and a positive acceleration",
                f"{self.speed:g}, {self.acceleration:g}",
            )
        speed = cruise_speed(self.speed, self.acceleration, distance, at.period)
        up = speed / self.acceleration
        brake = stopping_distance(speed, self.acceleration, at.period)
        cruise = max(abs(distance) - 2.0 * brake, 0.0) / speed
        nominal = 2.0 * up + cruise + cycles_of(_STAND_TIME, at.period) * at.period
        at.require_within(nominal, self.at_most)
        return at.forecast(
            nominal,
            self.at_most + up + _STAND_TIME,
            net=distance,
            travel=travel,
            speed=speed,
            end=0.0,
            acceleration=self.acceleration,
        )


@dataclass(frozen=True)
class MoveToAngle(Move):
    """Bring the input to `phase` [rad] within its revolution, from one side (sign of `speed`), and stand there.

    `phase` counts from the input index mark where it is known, from the start of the run otherwise.
    """

    phase: float
    speed: float
    acceleration: float
    at_most: float
    segment: SegmentLabel | None = None
    speed_segment = False

    def forecast(self, at: Situation) -> StepForecast:
        """Half a revolution, the mean of what it may be."""
        farthest = math.copysign(REVOLUTION + _SHORTEST_APPROACH + self._runway, self.speed)
        low, high = sorted((0.0, farthest))
        return self._forecast(at, math.copysign(0.5 * REVOLUTION, self.speed), (low, high))

    def distance(self, rig: RigView) -> float:
        """Ahead to the angle, a revolution more where there is no room to get up to speed."""
        ahead = math.copysign(1.0, self.speed) * (
            rig.phase_origin() + self.phase - rig.input_angle()
        )
        ahead %= REVOLUTION
        if ahead < max(_SHORTEST_APPROACH, self._runway):
            ahead += REVOLUTION
        return math.copysign(ahead, self.speed)

    @property
    def _runway(self) -> float:
        """Angle of getting up to speed and stopping again [rad]."""
        return self.speed**2 / self.acceleration


@dataclass(frozen=True)
class MoveRevolutions(Move):
    """Turn the input by `revolutions` (signed) at |speed| with ramps and stand there."""

    revolutions: float
    speed: float
    acceleration: float
    at_most: float
    segment: SegmentLabel | None = None

    def forecast(self, at: Situation) -> StepForecast:
        """As the set-points; standing for a moment where there is nothing to turn."""
        distance = self.revolutions * REVOLUTION
        if distance == 0.0:
            return at.forecast(_STAND_TIME, end=0.0)
        return self._forecast(at, distance, (distance, distance))

    def distance(self, rig: RigView) -> float:
        return self.revolutions * REVOLUTION
