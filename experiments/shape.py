"""When a curve is laid through too few points: one rule for plans and for results.

A curve of p numbers through n points has n - p degrees of freedom. Below `LEAST_FREEDOM` the points hardly tell whether
the curve is theirs at all, and what they scatter by is known within a third at best: its numbers are "weakly" then,
however narrow their intervals are. The same holds where hardly any point was measured twice: their scatter is assumed
there, not seen; and where it comes out as the least that is looked for. The first two are known before a run from the
segments that its plan has: plan, preflight and result say the same sentence.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from model.identify.estimate import Estimate
from model.identify.repeated import FEWEST, SMALLEST

LEAST_FREEDOM = 10
"""Points beyond the numbers of a curve from which on they tell it: their scatter is known within a quarter then."""
SAME_SPEED = 0.03
"""Relative difference up to which two holds are at one speed."""
_ON_THE_FLOOR = 0.05
"""Relative distance from the least scatter that the search for it cannot tell."""


class Labelled(Protocol):
    """What a plan's step and a recording's segment both say of a stretch."""

    @property
    def label(self) -> str: ...
    @property
    def setpoint(self) -> float: ...


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A curve that an analysis lays through the points of a run.

    - `title`: what it is called within a sentence.
    - `numbers`: how many numbers it has.
    - `names`: which quantities they are.
    - `labels`: of the segments that give a point each, or half of one where both directions do.
    - `needs_repeats`: whether its errors rest on points that were measured again.
    """

    title: str
    numbers: int
    names: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    needs_repeats: bool = False

    def planned(self, segments: Iterable[Labelled]) -> Standing:
        """How the curve will stand on the segments of a plan, or of a recording."""
        setpoints = [s.setpoint for s in segments if s.label in self.labels]
        levels: list[list[float]] = []
        for setpoint in sorted(setpoints, key=abs):
            if levels and abs(setpoint) <= abs(levels[-1][0]) * (1.0 + SAME_SPEED):
                levels[-1].append(setpoint)
            else:
                levels.append([setpoint])
        points = sum(
            max(sum(s > 0.0 for s in level), sum(s < 0.0 for s in level)) for level in levels
        )
        return Standing(self, points, len(levels))


@dataclass(frozen=True)
class Standing:
    """A curve on its points, which lie at so many `places`; `scatter` (relative) of those that were measured again, NaN
    where it is not known yet, or not looked for.
    """

    shape: Shape
    points: int
    places: int
    scatter: float = math.nan

    @property
    def freedom(self) -> int:
        """Degrees of freedom: points beyond the numbers of the curve."""
        return self.points - self.shape.numbers

    @property
    def thin(self) -> str:
        """Why the curve stands on too little, in one sentence; "" where it does not."""
        reasons: list[str] = []
        if self.freedom < LEAST_FREEDOM:
            reasons.append(
                f"{self.points} points for {self.shape.numbers} numbers, {self.freedom} degrees of freedom of "
                f"{LEAST_FREEDOM} asked for"
            )
        if self.shape.needs_repeats and self.points - self.places < FEWEST:
            reasons.append(
                f"{self.points - self.places} points measured again of {FEWEST} asked for, so that "
                "their scatter is assumed"
            )
        elif self.scatter <= SMALLEST * (1.0 + _ON_THE_FLOOR):
            reasons.append(
                f"the scatter of points measured again lies on the least that is looked for, {SMALLEST:g} of their size"
            )
        if not reasons:
            return ""
        return f'{self.shape.title} is told "weakly" at best: {"; ".join(reasons)}'

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentence as a warning, where there is one."""
        return (f"{self.thin}.",) if self.thin else ()

    def weakly(self, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
        """The estimates, those of the curve's own numbers "weakly" where it stands on too little."""
        thin = self.thin
        return dict(estimates) | {
            name: replace(estimate, identifiable="weakly", note=thin)
            for name, estimate in estimates.items()
            if thin and name in self.shape.names and estimate.identifiable == "yes"
        }
