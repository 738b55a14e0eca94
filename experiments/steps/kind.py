"""What every kind of step must say of itself: its course on a rig that turns, its forecast, its words, and the label of
what it records.

A course is legs of set-points, and the conditions that end them. A step sees a rig by `RigView` alone, in SI, and
between legs only. Within a leg it is the rig's port that watches the condition, in every cycle; so all decisions fall
at cycles that do not depend on how a run is cut into blocks. A forecast is what a step does on an ideal rig, in closed
form, before anything moves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, Protocol

from experiments.errors import PlanError
from experiments.steps.profile import Constant, Profile
from model.units import RPM

SWITCHING_TIME = 0.05
"""s; the least that switching the servo on or off takes: the drive's state is looked at after each such window."""


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

    def output_angle(self) -> float:
        """The latest output angle as its encoder counts [rad]."""
        ...

    def has_index(self, which: str) -> bool:
        """Whether an index mark ("input" or "output") has passed since the rig was opened."""
        ...

    def index_angle(self, which: str) -> float:
        """The angle that was latched at the latest index mark ("input" or "output") [rad]."""
        ...


Note = Callable[[str, str, str], None]
"""Writes an event of a step into the run: level, code, text."""


class OperatingPoint(NamedTuple):
    """Input speed [rad/s] and acceleration [rad/s2] of a share of a step's time."""

    share: float
    speed: float
    acceleration: float


class Piece(NamedTuple):
    """A part of a step with linear speed: duration [s], input speed at its begin and its end
    [rad/s], and the torque that a torque ramp reaches in it [N m].
    """

    duration: float
    begin: float
    end: float
    torque: float = 0.0


@dataclass(frozen=True, slots=True)
class Drive:
    """What shapes the set-points of a step: the drive's own ramp [rad/s2], infinite where it has none, and the
    SYNC period [s].
    """

    ramp: float
    period: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StepForecast:
    """One step without a rig: nominal and longest time [s], input angles [rad], set-points that matter (SI).

    `net` is the input angle from begin to end, signed; `turned` what was turned on the way, both
    directions added; `travel` the lowest and highest `net` that the step may end with. `speed`,
    `acceleration` and `torque` are peaks of the set-points; at the drive's ramp the acceleration is
    the drive's. `points` is for a step that is at its peaks for moments only: its course as points
    of operation; where there are none, the peak stands for the whole step.
    """

    index: int
    what: str
    nominal: float
    longest: float
    net: float
    turned: float
    travel: tuple[float, float]
    begin: float
    end: float
    speed: float
    acceleration: float = 0.0
    torque: float = 0.0
    at_drive_ramp: bool = False
    points: tuple[OperatingPoint, ...] = ()

    @property
    def where(self) -> str:
        """The step as messages name it."""
        return f"step {self.index + 1} ({self.what})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Where a plan stands when a step begins, on an ideal rig: index and words of the step, the
    speed set-point [rad/s], SYNC period [s], inertia at the input [kg m2], ratio, and the torque at
    which the input begins to move [N m].
    """

    index: int
    what: str
    setpoint: float
    period: float
    inertia: float
    ratio: float
    starting_torque: float

    def forecast(self, nominal: float, longest: float | None = None, **values: Any) -> StepForecast:
        """The forecast of a step; begin, end, turned and travel are those of a steady speed unless they are given."""
        values = {"begin": self.setpoint, "end": self.setpoint, "net": 0.0, **values}
        values.setdefault("turned", abs(values["net"]))
        values.setdefault("travel", (values["net"], values["net"]))
        values["speed"] = max(
            abs(values["begin"]), abs(values["end"]), abs(values.get("speed", 0.0))
        )
        return StepForecast(
            index=self.index,
            what=self.what,
            nominal=nominal,
            longest=nominal if longest is None else longest,
            **values,
        )

    def require_within(self, nominal: float, at_most: float) -> None:
        """Raise `PlanError` for a step that takes longer [s] than its own limit."""
        if nominal > at_most:
            raise self.refusal(
                f"takes longer than its own limit of {at_most:g} s", f"{nominal:.4g} s"
            )

    def refusal(self, what: str, value: str) -> PlanError:
        """The error of a step that is impossible here."""
        return PlanError(what, where=f"step {self.index + 1} ({self.what})", value=value)


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
