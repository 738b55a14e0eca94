"""Torque, raised until the input moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from experiments.steps.kind import (
    Course,
    Displaced,
    Drive,
    Leg,
    Motion,
    Note,
    Piece,
    RigView,
    SegmentLabel,
    Servo,
    Situation,
    StepForecast,
)
from experiments.steps.profile import ramp
from model.units import REVOLUTION

_COAST = 0.25 * REVOLUTION
"""rad that the input may turn on after its first motion."""


@dataclass(frozen=True)
class TorqueRamp(Motion):
    """Torque from 0 at `rate` [N m/s] (signed) until the input has moved by `motion` [rad] or
    `limit` [N m] is reached.
    """

    rate: float
    limit: float
    motion: float
    segment: SegmentLabel | None = None
    servo = Servo.TORQUE
    speed_segment = False

    def forecast(self, at: Situation) -> StepForecast:
        """Up to the starting torque, at longest to its own limit."""
        if not (self.rate and self.limit > 0.0):
            raise at.refusal(
                "a torque ramp needs a rate and a positive limit",
                f"{self.rate:g} N m/s, {self.limit:g} N m",
            )
        longest = self.limit / abs(self.rate)
        nominal = min(at.starting_torque / abs(self.rate), longest)
        low, high = sorted((0.0, math.copysign(self.motion + _COAST, self.rate)))
        # The speed when friction vanishes at the first motion: the most that the rotor can pick up until the ramp ends.
        speed = math.sqrt(2.0 * min(at.starting_torque, self.limit) * self.motion / at.inertia)
        return at.forecast(
            nominal, longest, travel=(low, high), end=0.0, speed=speed, torque=self.limit
        )

    def course(self, rig: RigView, note: Note) -> Course:
        """One leg; whether the input has moved is an event, either way a result."""
        profile = ramp(0.0, math.copysign(self.limit, self.rate), abs(self.rate), rig.period)
        end = yield Leg(max(profile.cycles, 1), profile, Displaced(self.motion))
        torque = float(profile.targets(end.cycles - 1, 1)[0])
        if end.reached:
            note("info", "first-motion", f"first motion at {torque:.4g} N m of set-point")
        else:
            note("warning", "no-motion", f"no motion up to {torque:.4g} N m")

    def pieces(self, forecast: StepForecast, left: float, drive: Drive) -> Iterator[Piece]:
        """Standing while the torque rises."""
        torque = math.copysign(min(abs(self.rate) * left, self.limit), self.rate)
        yield Piece(left, 0.0, 0.0, torque)
