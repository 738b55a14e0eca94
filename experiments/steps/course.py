"""The course of a step on a rig that turns: legs of set-points, and the conditions that end them.

A step sees a rig by `RigView` alone, in SI, and between legs only. Within a leg it is the rig's port that watches the
condition, in every cycle; so all decisions fall at cycles that do not depend on how a run is cut into blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from experiments.steps.profile import Constant, Profile


class Servo(IntEnum):
    """What the servo does during a step: no power, a speed, a torque."""

    OFF = 0
    SPEED = 1
    TORQUE = 2


@dataclass(frozen=True, slots=True)
class Turned:
    """The input has turned by `angle` [rad] >= 0 in `direction` (its sign) since the leg began."""

    angle: float
    direction: float


@dataclass(frozen=True, slots=True)
class Displaced:
    """The input is `angle` [rad] away from where the leg began, to either side."""

    angle: float


@dataclass(frozen=True, slots=True)
class IndexPassed:
    """An index mark ("input" or "output") has passed since the leg began."""

    which: str


Until = Turned | Displaced | IndexPassed


@dataclass(frozen=True, slots=True)
class Goal:
    """What a leg must have reached when its cycles are up, in words, and the time that it had [s]."""

    what: str
    at_most: float


@dataclass(frozen=True, slots=True)
class Leg:
    """`cycles` at most along `profile`, shorter once `until` is fulfilled.

    A leg that is over without reaching its `goal` fails the step. `averaged` asks for the mean torque.
    """

    cycles: int
    profile: Profile = Constant(0.0)  # noqa: RUF009  frozen
    until: Until | None = None
    goal: Goal | None = None
    averaged: bool = False


@dataclass(frozen=True, slots=True)
class LegEnd:
    """How a leg ended: cycles done, whether its condition ended it, the input angle turned [rad,
    signed], and the mean torque of its complete cycles [N m] (NaN: there was none, or nobody asked).
    """

    cycles: int
    reached: bool
    turned: float
    mean_torque: float


Course = Generator[Leg, LegEnd, None]


class RigView(Protocol):
    """What a step may know of the rig between two legs."""

    @property
    def period(self) -> float:
        """SYNC period [s]."""
        ...

    @property
    def setpoint(self) -> float:
        """The present speed set-point [rad/s]."""
        ...

    def present_speed(self) -> float:
        """What a ramp begins at: the set-point, under torque control the speed as measured [rad/s]."""
        ...

    def input_angle(self) -> float:
        """The latest input angle [rad]."""
        ...

    def phase_origin(self) -> float:
        """The input angle that phases count from: the index mark where one has passed, else the start of the run."""
        ...

    def index_angle(self, which: str) -> float:
        """The angle that was latched at the latest index mark ("input" or "output") [rad]."""
        ...


Note = Callable[[str, str, str], None]
"""Writes an event of a step into the run: level, code, text."""
