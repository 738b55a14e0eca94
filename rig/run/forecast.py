"""Forecasts: every step of a plan with an ideal rig, in closed form. Times, angles turned, set-points that matter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from experiments import steps as s
from experiments.errors import PlanError
from model.units import REVOLUTION
from rig.bench.limits import Load
from rig.run.engine import ENABLE_WINDOW, SHORTEST_APPROACH, STAND_TIME, describe
from rig.run.trajectory import cruise_speed, cycles_of, ramp, ramp_travel, stopping_distance


@dataclass(frozen=True, slots=True, kw_only=True)
class StepForecast:
    """One step without a rig: nominal and longest time [s], input angles turned [rad], set-points that matter (SI)."""

    index: int
    what: str
    nominal: float
    longest: float
    angle: float = 0.0
    travel: tuple[float, float] = (0.0, 0.0)
    begin: float = 0.0
    end: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0
    torque: float = 0.0
    at_drive_ramp: bool = False

    @property
    def where(self) -> str:
        """The step as messages name it."""
        return f"step {self.index + 1} ({self.what})"


def walk(
    plan: Iterable[s.Step], load: Load, starting_torque: float, period: float
) -> tuple[StepForecast, ...]:
    """Every step of a plan with an ideal rig: `load` it turns, `starting_torque` [N m] at which it begins to move."""
    found: list[StepForecast] = []
    setpoint, powered = 0.0, False
    for index, step in enumerate(plan):
        forecast = _FORECASTS[type(step)](
            _Context(index, setpoint, load, starting_torque, period), step
        )
        if not isinstance(step, (s.Mark, s.Prompt)):
            switched = isinstance(step, s.ServoOff) is powered
            powered = not isinstance(step, s.ServoOff)
            if switched:
                forecast = _longer(forecast, ENABLE_WINDOW)
        setpoint = forecast.end
        found.append(forecast)
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Context:
    index: int
    setpoint: float
    load: Load
    starting_torque: float
    period: float

    def make(
        self, step: s.Step, nominal: float, longest: float | None = None, **values: Any
    ) -> StepForecast:
        values.setdefault("begin", self.setpoint)
        values.setdefault("end", self.setpoint)
        peak = max(abs(values["begin"]), abs(values["end"]), abs(values.get("speed", 0.0)))
        values["speed"] = peak
        return StepForecast(
            index=self.index,
            what=describe(step),
            nominal=nominal,
            longest=nominal if longest is None else longest,
            **values,
        )

    def refuse(self, step: s.Step, what: str, value: str) -> PlanError:
        return PlanError(what, where=f"step {self.index + 1} ({describe(step)})", value=value)


def _longer(forecast: StepForecast, seconds: float) -> StepForecast:
    values = {name: getattr(forecast, name) for name in StepForecast.__slots__}
    values["nominal"] += seconds
    values["longest"] += seconds
    return StepForecast(**values)


def _servo_off(c: _Context, step: s.ServoOff) -> StepForecast:
    return c.make(step, step.duration, end=0.0)


def _ramp(c: _Context, step: s.Ramp) -> StepForecast:
    if not step.acceleration > 0.0:
        raise c.refuse(
            step, "a ramp needs a positive acceleration", f"{step.acceleration:g} rad/s2"
        )
    profile = ramp(c.setpoint, step.speed, step.acceleration, c.period)
    cycles = max(profile.cycles, 1)
    angle = ramp_travel(c.setpoint, step.speed, cycles, c.period)
    return c.make(
        step,
        cycles * c.period,
        angle=angle,
        travel=_both(angle),
        end=step.speed,
        acceleration=step.acceleration,
    )


def _speed_step(c: _Context, step: s.SpeedStep) -> StepForecast:
    needed = step.least_revolutions * REVOLUTION / abs(step.speed) if step.speed else 0.0
    missing = max(needed - step.duration, 0.0)
    nominal = max(step.duration, needed)
    longest = step.duration + (1.5 * missing + 2.0 if missing else 0.0)
    angle = step.speed * nominal
    low, high = sorted((0.0, step.speed * longest))
    return c.make(
        step, nominal, longest, angle=angle, travel=(low, high), end=step.speed, at_drive_ramp=True
    )


def _hold_revolutions(c: _Context, step: s.HoldRevolutions) -> StepForecast:
    if c.setpoint == 0.0:
        raise c.refuse(step, "revolutions cannot be counted at standstill", "0 r/min")
    nominal = step.revolutions * REVOLUTION / abs(c.setpoint)
    if nominal > step.at_most:
        raise c.refuse(
            step, f"takes longer than its own limit of {step.at_most:g} s", f"{nominal:.4g} s"
        )
    angle = math.copysign(step.revolutions * REVOLUTION, c.setpoint)
    return c.make(step, nominal, step.at_most, angle=angle, travel=_both(angle))


def _hold_time(c: _Context, step: s.HoldTime) -> StepForecast:
    angle = c.setpoint * step.duration
    return c.make(step, step.duration, angle=angle, travel=_both(angle))


def _settle(c: _Context, step: s.Settle) -> StepForecast:
    nominal = min(2.0 * step.window, step.at_most)
    low, high = sorted((c.setpoint * nominal, c.setpoint * step.at_most))
    return c.make(step, nominal, step.at_most, angle=c.setpoint * nominal, travel=(low, high))


def _move(c: _Context, step: Any, distance: float, travel: tuple[float, float]) -> StepForecast:
    if not (step.acceleration > 0.0 and step.speed != 0.0):
        raise c.refuse(
            step,
            "a move needs a speed and a positive acceleration",
            f"{step.speed:g}, {step.acceleration:g}",
        )
    speed = cruise_speed(step.speed, step.acceleration, distance, c.period)
    up = speed / step.acceleration
    brake = stopping_distance(speed, step.acceleration, c.period)
    cruise = max(abs(distance) - 2.0 * brake, 0.0) / speed
    nominal = 2.0 * up + cruise + cycles_of(STAND_TIME, c.period) * c.period
    if nominal > step.at_most:
        raise c.refuse(
            step, f"takes longer than its own limit of {step.at_most:g} s", f"{nominal:.4g} s"
        )
    longest = step.at_most + up + STAND_TIME
    return c.make(
        step,
        nominal,
        longest,
        angle=distance,
        travel=travel,
        speed=speed,
        end=0.0,
        acceleration=step.acceleration,
    )


def _move_to_angle(c: _Context, step: s.MoveToAngle) -> StepForecast:
    farthest = math.copysign(
        REVOLUTION + SHORTEST_APPROACH + step.speed**2 / step.acceleration, step.speed
    )
    low, high = sorted((0.0, farthest))
    return _move(c, step, math.copysign(0.5 * REVOLUTION, step.speed), (low, high))


def _move_revolutions(c: _Context, step: s.MoveRevolutions) -> StepForecast:
    distance = step.revolutions * REVOLUTION
    if distance == 0.0:
        return c.make(step, STAND_TIME, end=0.0)
    return _move(c, step, distance, _both(distance))


def _find_index(c: _Context, step: s.FindIndex) -> StepForecast:
    half = 0.5 * REVOLUTION * (c.load.ratio if step.which == "output" else 1.0)
    nominal = min(half / abs(step.speed), step.at_most) if step.speed else step.at_most
    low, high = sorted((0.0, step.speed * step.at_most))
    return c.make(
        step,
        nominal,
        step.at_most,
        angle=step.speed * nominal,
        travel=(low, high),
        end=step.speed,
        at_drive_ramp=True,
    )


def _torque_ramp(c: _Context, step: s.TorqueRamp) -> StepForecast:
    if not (step.rate and step.limit > 0.0):
        raise c.refuse(
            step,
            "a torque ramp needs a rate and a positive limit",
            f"{step.rate:g} N m/s, {step.limit:g} N m",
        )
    longest = step.limit / abs(step.rate)
    nominal = min(c.starting_torque / abs(step.rate), longest)
    coast = math.copysign(step.motion + 0.25 * REVOLUTION, step.rate)
    low, high = sorted((0.0, coast))
    # The speed when friction vanishes at the first motion: the most that the rotor can pick up until the ramp ends.
    speed = math.sqrt(2.0 * min(c.starting_torque, step.limit) * step.motion / c.load.total_inertia)
    return c.make(
        step, nominal, longest, travel=(low, high), end=0.0, speed=speed, torque=step.limit
    )


def _nothing(c: _Context, step: s.Step) -> StepForecast:
    return c.make(step, 0.0)


def _both(angle: float) -> tuple[float, float]:
    return angle, angle


_FORECASTS: dict[type[Any], Callable[[_Context, Any], StepForecast]] = {
    s.ServoOff: _servo_off,
    s.Ramp: _ramp,
    s.SpeedStep: _speed_step,
    s.HoldRevolutions: _hold_revolutions,
    s.HoldTime: _hold_time,
    s.Settle: _settle,
    s.MoveToAngle: _move_to_angle,
    s.MoveRevolutions: _move_revolutions,
    s.FindIndex: _find_index,
    s.TorqueRamp: _torque_ramp,
    s.Prompt: _nothing,
    s.Mark: _nothing,
}
