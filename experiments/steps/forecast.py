"""Forecasts: what a step does on an ideal rig, in closed form, before anything moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from experiments.errors import PlanError


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
    net: float = 0.0
    turned: float = 0.0
    travel: tuple[float, float] = (0.0, 0.0)
    begin: float = 0.0
    end: float = 0.0
    speed: float = 0.0
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

    def refusal(self, what: str, value: str) -> PlanError:
        """The error of a step that is impossible here."""
        return PlanError(what, where=f"step {self.index + 1} ({self.what})", value=value)
