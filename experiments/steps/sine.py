"""A slow swing about an angle: for what depends on where the input came from, hysteresis above all.

    theta(t)   = theta_0 + A (1 - cos(2 pi t/T))            0 <= t <= n T
    theta'(t)  = A (2 pi/T) sin(2 pi t/T)                   peak  A (2 pi/T)
    theta''(t) = A (2 pi/T)^2 cos(2 pi t/T)                 peak  A (2 pi/T)^2

So the input swings by +-A about theta_0 + A, first in the direction of A, and is back where it began, at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from experiments.steps.kind import (
    Course,
    Drive,
    Leg,
    Motion,
    Note,
    OperatingPoint,
    Piece,
    RigView,
    SegmentLabel,
    Situation,
    StepForecast,
)
from experiments.steps.profile import Sinusoid, cycles_of
from model.units import DEGREE, REVOLUTION, RPM

_LEAST_SETPOINTS = 20
"""SYNC cycles that a swing takes at least: with fewer its set-points are a staircase."""
_MOST_CYCLES = 1000
"""Swings of one step at most, so that a preview stays small."""
PIECES = 48
"""Pieces of linear speed that a swing is drawn with; their slopes miss its acceleration by 0.3 %."""
POINTS = 192
"""Intervals of half a swing at whose ends torques are predicted."""


@dataclass(frozen=True)
class Sine(Motion):
    """Swing the input sinusoidally: `cycles` whole swings of `amplitude` [rad] (its sign is the
    direction of the first half) in `period` [s] each, from standstill to standstill.

    A swing takes whole SYNC cycles, at least its `period`.
    """

    amplitude: float
    period: float
    cycles: int
    segment: SegmentLabel | None = None
    speed_segment = False

    def forecast(self, at: Situation) -> StepForecast:
        """Exact; its peaks of speed and acceleration lie a quarter of a swing apart."""
        if at.setpoint != 0.0:
            raise at.refusal("a swing begins at standstill", f"{at.setpoint / RPM:.4g} r/min")
        if not (0.0 < abs(self.amplitude) < math.inf and self.cycles in range(1, _MOST_CYCLES + 1)):
            raise at.refusal(
                f"swings need an amplitude, and are whole ones, 1 to {_MOST_CYCLES}",
                f"{self.amplitude:g} rad, {self.cycles:g} swings",
            )
        if not _LEAST_SETPOINTS * at.period <= self.period < math.inf:
            raise at.refusal(
                f"a swing needs {_LEAST_SETPOINTS} SYNC cycles at least", f"{self.period:g} s"
            )
        swing = cycles_of(self.period, at.period) * at.period
        peak, rate = self._peak(swing), REVOLUTION / swing
        angle = np.linspace(0.0, math.pi, POINTS + 1)
        share = np.full(POINTS + 1, 1.0 / POINTS)
        share[[0, -1]] *= 0.5
        speeds, accelerations = abs(peak) * np.sin(angle), abs(peak) * rate * np.cos(angle)
        low, high = sorted((0.0, 2.0 * self.amplitude))
        return at.forecast(
            self.cycles * swing,
            turned=4.0 * abs(self.amplitude) * self.cycles,
            travel=(low, high),
            speed=peak,
            acceleration=abs(peak) * rate,
            points=tuple(map(OperatingPoint._make, zip(share, speeds, accelerations, strict=True))),
        )

    def course(self, rig: RigView, note: Note) -> Course:
        swing = cycles_of(self.period, rig.period)
        profile = Sinusoid(self._peak(swing * rig.period), swing)
        yield Leg(swing * self.cycles, profile)

    def pieces(self, forecast: StepForecast, left: float, drive: Drive) -> Iterator[Piece]:
        """The swings as polygons."""
        swing = left / self.cycles
        corners = Sinusoid(self._peak(swing), PIECES).targets(-1, PIECES * self.cycles + 1)
        for begin, end in pairwise(corners.tolist()):
            yield Piece(swing / PIECES, begin, end)

    def words(self) -> str:
        return f"{self.name} +-{abs(self.amplitude) / DEGREE:.4g} deg in {self.period:.4g} s"

    def _peak(self, swing: float) -> float:
        """The peak speed [rad/s], signed, of a swing of `swing` seconds."""
        return self.amplitude * REVOLUTION / swing
