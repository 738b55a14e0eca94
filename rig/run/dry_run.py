"""The dry run: a plan walked with no rig. Duration, revolutions, samples, file size, peaks, and the margin to every limit.

Torque at the input: T = T_f(omega) + T_f,motor(omega) + (J_i + J_o/N^2) alpha, with T_f of equation 20 (or its energy
balance). A plan that would break a limit is refused here, before a file is made or anything moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from experiments import steps as s
from experiments.contract import Experiment
from experiments.errors import PlanError
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from model.units import REVOLUTION, RPM
from rig import limits as lim
from rig.errors import LimitError
from rig.limits import Limit, Limits, Load, derive_limits, load_of
from rig.run.engine import ENABLE_WINDOW, SHORTEST_APPROACH, STAND_TIME, describe
from rig.run.trajectory import cruise_speed, cycles_of, ramp, ramp_travel, stopping_distance

DEFAULT_SAMPLE_RATE = 1000.0
TYPICAL_CHANNELS = 10
BYTES_PER_SAMPLE = 1.2
"""Bytes on disk per channel and cycle, counts compressed, as measured on the simulated rig with all its noise."""
WORST_BYTES_PER_SAMPLE = 8.0
"""Bytes while it is written, if nothing compresses."""
TRAVEL_ROOM = 5.0 * REVOLUTION
"""Input angle beyond the plan's own travel at which the run trips [rad]."""
LIST_LONGEST = 12
"""Steps that the table of a plan shows."""


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class Margin:
    """The largest planned or predicted value of a limited quantity, where it occurs, and the limit that holds."""

    quantity: str
    value: float
    where: str
    limit: Limit

    @property
    def margin(self) -> float:
        """Share of the limit that is left; negative when it is broken."""
        return 1.0 - self.value / self.limit.value

    def as_json(self) -> dict[str, Any]:
        """The margin as `rig plan --json` prints it."""
        return {
            "quantity": self.quantity, "value": self.value, "unit": self.limit.unit, "where": self.where,
            "limit": self.limit.value, "tier": self.limit.tier, "origin": self.limit.origin, "margin": self.margin,
        }  # fmt: skip


@dataclass(frozen=True)
class PlannedRun:
    """A protocol with its parameters, walked: what it will do, how long, and how near to which limit."""

    experiment: Experiment
    parameters: Any
    gear: HarmonicDrive
    motor: ServoMotor
    mounting: Mounting
    sample_rate: float
    plan: tuple[s.Step, ...]
    steps: tuple[StepForecast, ...]
    limits: Limits
    load: Load
    margins: tuple[Margin, ...]

    @property
    def nominal(self) -> float:
        """Nominal duration [s]."""
        return sum(step.nominal for step in self.steps)

    @property
    def longest(self) -> float:
        """Duration if every step takes as long as it may [s]."""
        return sum(step.longest for step in self.steps)

    @property
    def input_revolutions(self) -> float:
        """Revolutions of the input, both directions added."""
        return sum(abs(step.angle) for step in self.steps) / REVOLUTION

    @property
    def samples(self) -> int:
        """Nominal number of cycles."""
        return round(self.nominal * self.sample_rate)

    def file_size(self, channels: int = TYPICAL_CHANNELS) -> int:
        """Expected size of the run file [bytes]."""
        return round(self.samples * channels * BYTES_PER_SAMPLE) + 100_000

    def space_needed(self, channels: int = TYPICAL_CHANNELS) -> int:
        """Disk space for the longest run before anything is compressed [bytes]."""
        return round(self.longest * self.sample_rate * channels * WORST_BYTES_PER_SAMPLE) + 1_000_000

    @property
    def travel(self) -> tuple[float, float]:
        """Lowest and highest input angle from the start [rad] that the plan can reach, with room."""
        low = high = lowest = highest = 0.0
        for step in self.steps:
            low, high = low + step.travel[0], high + step.travel[1]
            lowest, highest = min(lowest, low), max(highest, high)
        return lowest - TRAVEL_ROOM, highest + TRAVEL_ROOM

    def remaining(self, index: int) -> float:
        """Nominal time of the steps after `index` [s]."""
        return sum(step.nominal for step in self.steps[index + 1 :])

    def as_json(self) -> dict[str, Any]:
        """The object that `rig plan --json` prints."""
        peak = max((abs(step.speed) for step in self.steps), default=0.0)
        return {
            "protocol": self.experiment.name,
            "parameters": {name: _plain(value) for name, value in vars_of(self.parameters).items()},
            "gear": self.gear.name,
            "mounting": self.mounting,
            "steps": len(self.plan),
            "duration": {"nominal": self.nominal, "longest": self.longest, "unit": "s"},
            "input_revolutions": self.input_revolutions,
            "output_revolutions": self.input_revolutions / self.load.ratio if self.experiment.gear_mounted else 0.0,
            "samples": self.samples,
            "sample_rate": {"value": self.sample_rate, "unit": "Hz"},
            "file_size": {"value": self.file_size(), "unit": "bytes"},
            "peak_speed": {"value": peak / RPM, "unit": "r/min"},
            "margins": [margin.as_json() for margin in self.margins],
            "limits": self.limits.as_json(),
        }


def plan_run(
    experiment: Experiment,
    parameters: Any,
    gear: HarmonicDrive,
    motor: ServoMotor,
    mounting: Mounting = "circular-spline-fixed",
    *,
    sample_rate: float = DEFAULT_SAMPLE_RATE,
    configured: Mapping[str, float] | None = None,
) -> PlannedRun:
    """Walk a protocol's plan. Raises `PlanError` for one that is impossible, `LimitError` for one that breaks a limit."""
    plan = tuple(experiment.plan(parameters, gear))
    load = load_of(gear, motor, mounting, experiment.gear_mounted)
    static = _friction(gear, motor, experiment.gear_mounted, 0.0)
    steps = walk(plan, load, static, 1.0 / sample_rate)
    fastest = max((abs(step.speed) for step in steps), default=0.0)
    limits = derive_limits(
        gear, motor, mounting, gear_mounted=experiment.gear_mounted, plan_speed=fastest, configured=configured
    )
    margins = tuple(_margins(steps, limits, load, lambda w: _friction(gear, motor, experiment.gear_mounted, w)))
    planned = PlannedRun(
        experiment, parameters, gear, motor, mounting, sample_rate, plan, steps, limits, load, margins
    )
    for margin in margins:
        refuse_broken(margin)
    return planned


def refuse_broken(margin: Margin) -> None:
    """Raise `LimitError` if the planned value is above its limit."""
    if margin.margin >= -1e-9:
        return
    factor, unit = (RPM, "r/min") if margin.limit.unit == "rad/s" else (1.0, margin.limit.unit)
    raise LimitError(
        f"the plan would break the limit on {margin.quantity.replace('_', ' ')}",
        where=margin.where,
        value=f"{margin.value / factor:.4g} {unit} (margin {100.0 * margin.margin:.1f} %)",
        limit=f"<= {margin.limit.value / factor:.4g} {unit} ({margin.limit.tier} tier: {margin.limit.origin})",
        remedy=_REMEDIES.get(margin.quantity, "Change the protocol's parameters."),
    )


_REMEDIES = {
    lim.INPUT_SPEED: "Lower the speed.",
    lim.ACCELERATION: "Lower the acceleration.",
    lim.MOTOR_TORQUE: "Lower the acceleration, the speed or the torque of the ramp.",
    lim.TORSION_TORQUE: "Lower the acceleration or the inertia on the output.",
    lim.AVERAGE_SPEED: "Lower the speed or add rests.",
    lim.RMS_TORQUE: "Lower the speed or add rests.",
}


def walk(plan: Iterable[s.Step], load: Load, starting_torque: float, period: float) -> tuple[StepForecast, ...]:
    """Every step of a plan with an ideal rig: `load` it turns, `starting_torque` [N m] at which it begins to move."""
    found: list[StepForecast] = []
    setpoint, powered = 0.0, False
    for index, step in enumerate(plan):
        forecast = _FORECASTS[type(step)](_Context(index, setpoint, load, starting_torque, period), step)
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

    def make(self, step: s.Step, nominal: float, longest: float | None = None, **values: Any) -> StepForecast:
        values.setdefault("begin", self.setpoint)
        values.setdefault("end", self.setpoint)
        peak = max(abs(values["begin"]), abs(values["end"]), abs(values.get("speed", 0.0)))
        values["speed"] = peak
        return StepForecast(self.index, describe(step), nominal, nominal if longest is None else longest, **values)

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
        raise c.refuse(step, "a ramp needs a positive acceleration", f"{step.acceleration:g} rad/s2")
    profile = ramp(c.setpoint, step.speed, step.acceleration, c.period)
    cycles = max(profile.cycles, 1)
    angle = ramp_travel(c.setpoint, step.speed, cycles, c.period)
    return c.make(
        step, cycles * c.period, angle=angle, travel=_both(angle), end=step.speed, acceleration=step.acceleration
    )


def _speed_step(c: _Context, step: s.SpeedStep) -> StepForecast:
    needed = step.least_revolutions * REVOLUTION / abs(step.speed) if step.speed else 0.0
    missing = max(needed - step.duration, 0.0)
    nominal = max(step.duration, needed)
    longest = step.duration + (1.5 * missing + 2.0 if missing else 0.0)
    angle = step.speed * nominal
    low, high = sorted((0.0, step.speed * longest))
    return c.make(step, nominal, longest, angle=angle, travel=(low, high), end=step.speed, at_drive_ramp=True)


def _hold_revolutions(c: _Context, step: s.HoldRevolutions) -> StepForecast:
    if c.setpoint == 0.0:
        raise c.refuse(step, "revolutions cannot be counted at standstill", "0 r/min")
    nominal = step.revolutions * REVOLUTION / abs(c.setpoint)
    if nominal > step.at_most:
        raise c.refuse(step, f"takes longer than its own limit of {step.at_most:g} s", f"{nominal:.4g} s")
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
        raise c.refuse(step, "a move needs a speed and a positive acceleration", f"{step.speed:g}, {step.acceleration:g}")
    speed = cruise_speed(step.speed, step.acceleration, distance, c.period)
    up = speed / step.acceleration
    brake = stopping_distance(speed, step.acceleration, c.period)
    cruise = max(abs(distance) - 2.0 * brake, 0.0) / speed
    nominal = 2.0 * up + cruise + cycles_of(STAND_TIME, c.period) * c.period
    if nominal > step.at_most:
        raise c.refuse(step, f"takes longer than its own limit of {step.at_most:g} s", f"{nominal:.4g} s")
    longest = step.at_most + up + STAND_TIME
    return c.make(
        step, nominal, longest, angle=distance, travel=travel, speed=speed, end=0.0, acceleration=step.acceleration
    )


def _move_to_angle(c: _Context, step: s.MoveToAngle) -> StepForecast:
    farthest = math.copysign(REVOLUTION + SHORTEST_APPROACH + step.speed**2 / step.acceleration, step.speed)
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
        step, nominal, step.at_most, angle=step.speed * nominal, travel=(low, high), end=step.speed, at_drive_ramp=True
    )


def _torque_ramp(c: _Context, step: s.TorqueRamp) -> StepForecast:
    if not (step.rate and step.limit > 0.0):
        raise c.refuse(step, "a torque ramp needs a rate and a positive limit", f"{step.rate:g} N m/s, {step.limit:g} N m")
    longest = step.limit / abs(step.rate)
    nominal = min(c.starting_torque / abs(step.rate), longest)
    coast = math.copysign(step.motion + 0.25 * REVOLUTION, step.rate)
    low, high = sorted((0.0, coast))
    # The speed when friction vanishes at the first motion: the most that the rotor can pick up until the ramp ends.
    speed = math.sqrt(2.0 * min(c.starting_torque, step.limit) * step.motion / c.load.total_inertia)
    return c.make(step, nominal, longest, travel=(low, high), end=0.0, speed=speed, torque=step.limit)


def _nothing(c: _Context, step: s.Step) -> StepForecast:
    return c.make(step, 0.0)


def _both(angle: float) -> tuple[float, float]:
    return angle, angle


_FORECASTS: dict[type[Any], Callable[[_Context, Any], StepForecast]] = {
    s.ServoOff: _servo_off, s.Ramp: _ramp, s.SpeedStep: _speed_step, s.HoldRevolutions: _hold_revolutions,
    s.HoldTime: _hold_time, s.Settle: _settle, s.MoveToAngle: _move_to_angle, s.MoveRevolutions: _move_revolutions,
    s.FindIndex: _find_index, s.TorqueRamp: _torque_ramp, s.Prompt: _nothing, s.Mark: _nothing,
}  # fmt: skip


def _friction(gear: HarmonicDrive, motor: ServoMotor, gear_mounted: bool, speed: float) -> float:
    """Predicted running torque at the input [N m], magnitude; the static value at standstill."""
    from model.friction import friction_torque

    own = motor.coulomb_friction + motor.viscous_friction * abs(speed)
    if not gear_mounted:
        return own
    return own + float(friction_torque(gear, max(abs(speed), 1e-6)))


def _margins(
    steps: tuple[StepForecast, ...], limits: Limits, load: Load, friction: Callable[[float], float]
) -> Iterable[Margin]:
    """The peak of every limited quantity over the plan, with the step that causes it."""
    drive_ramp = limits.value(lim.ACCELERATION)

    def acceleration(step: StepForecast) -> float:
        return drive_ramp if step.at_drive_ramp else step.acceleration

    def motor_torque(step: StepForecast) -> float:
        turning = friction(step.speed) + load.total_inertia * acceleration(step)
        return max(step.torque, turning if step.speed else 0.0)

    peaks: dict[str, Callable[[StepForecast], float]] = {
        lim.INPUT_SPEED: lambda step: abs(step.speed),
        lim.ACCELERATION: lambda step: step.acceleration,
        lim.MOTOR_TORQUE: motor_torque,
        lim.TORSION_TORQUE: lambda step: max(load.gear_torque(acceleration(step)), load.ratio * step.torque),
    }
    for quantity, of in peaks.items():
        limit = limits.tightest(quantity)
        if limit is not None and steps:
            worst = max(steps, key=of)
            yield Margin(quantity, of(worst), worst.where, limit)
    duration = sum(step.nominal for step in steps)
    means = {
        lim.AVERAGE_SPEED: sum(abs(step.angle) for step in steps) / duration if duration else 0.0,
        lim.RMS_TORQUE: math.sqrt(
            sum(step.nominal * (friction(step.speed) if step.angle else step.torque) ** 2 for step in steps) / duration
        )
        if duration
        else 0.0,
    }
    for quantity, value in means.items():
        limit = limits.tightest(quantity)
        if limit is not None:
            yield Margin(quantity, value, "the whole plan", limit)


def vars_of(parameters: Any) -> dict[str, Any]:
    """The fields of a protocol's parameters by name."""
    import dataclasses

    return {f.name: getattr(parameters, f.name) for f in dataclasses.fields(parameters)}


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
