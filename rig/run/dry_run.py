"""The dry run: a plan walked with no rig. Duration, revolutions, samples, file size, peaks, and the
margin to every limit.

Torque at the input: T = T_f(omega) + T_f,motor(omega) + (J_i + J_o/N^2) alpha, with T_f of equation 20 (or its energy
balance). A plan that would break a limit is refused here, before a file is made or anything moves.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from experiments.contract import Experiment
from experiments.steps.kind import (
    SWITCHING_TIME,
    Motion,
    OperatingPoint,
    Servo,
    Situation,
    StepForecast,
)
from experiments.steps.vocabulary import Step
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from model.units import REVOLUTION, RPM
from rig.bench import limits as lim
from rig.bench.limits import Limit, Limits, Load, derive_limits, load_of
from rig.content.grid import Grid, columns, number_columns
from rig.content.wording import laboratory_unit, number, percent
from rig.errors import LimitError

DEFAULT_SAMPLE_RATE = 1000.0
_TYPICAL_CHANNELS = 12
_BYTES_PER_SAMPLE = 0.7
"""Bytes on disk per channel and cycle, counts compressed, as measured on the simulated rig with all its noise."""
_WORST_BYTES_PER_SAMPLE = 8.0
"""Bytes while it is written, if nothing compresses."""
_TRAVEL_ROOM = 5.0 * REVOLUTION
"""Input angle beyond the plan's own travel at which the run trips [rad]."""


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

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Quantity, value, limit and what is left of it, in the units of a laboratory."""
        return self._cells()

    def _cells(self, uncertainty: float = 0.0) -> tuple[str, str, str, str]:
        factor, unit = laboratory_unit(self.limit.unit, self.limit.value, "r/min")
        doubt = f" ± {number(uncertainty / factor, 2)}" if uncertainty else ""
        value, limit = (number(size / factor) for size in (self.value, self.limit.value))
        what = self.quantity.replace("_", " ")
        return what, f"{value}{doubt} {unit}", f"{limit} {unit}", percent(self.margin)

    def as_json(self) -> dict[str, Any]:
        """The margin as `rig plan --json` prints it."""
        return {
            "quantity": self.quantity,
            "value": self.value,
            "unit": self.limit.unit,
            "where": self.where,
            "limit": self.limit.value,
            "tier": self.limit.tier,
            "origin": self.limit.origin,
            "margin": self.margin,
        }


def margin_grid(margins: Iterable[Margin]) -> Grid:
    """What is planned beside every limit, and where the limit is from."""
    rows = [
        (*one.cells, f"{one.limit.tier}: {one.limit.origin}{one.limit.doubt}", one.where)
        for one in margins
    ]
    numbers = number_columns("planned", "allowed", "margin")
    return Grid("Margins", (*columns("limit on"), *numbers, *columns("origin", "where")), rows)


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """A protocol with its parameters, walked: what it will do, how long, and how near to which limit."""

    experiment: Experiment
    parameters: Any
    gear: HarmonicDrive
    motor: ServoMotor
    mounting: Mounting
    sample_rate: float
    plan: tuple[Step, ...]
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
        return sum(step.turned for step in self.steps) / REVOLUTION

    @property
    def samples(self) -> int:
        """Nominal number of cycles."""
        return round(self.nominal * self.sample_rate)

    def file_size(self, channels: int = _TYPICAL_CHANNELS) -> int:
        """Expected size of the run file [bytes]."""
        return round(self.samples * channels * _BYTES_PER_SAMPLE) + 100_000

    def space_needed(self, channels: int = _TYPICAL_CHANNELS) -> int:
        """Disk space for the longest run before anything is compressed [bytes]."""
        return (
            round(self.longest * self.sample_rate * channels * _WORST_BYTES_PER_SAMPLE) + 1_000_000
        )

    @property
    def travel(self) -> tuple[float, float]:
        """Lowest and highest input angle from the start [rad] that the plan can reach, with room."""
        low = high = lowest = highest = 0.0
        for step in self.steps:
            low, high = low + step.travel[0], high + step.travel[1]
            lowest, highest = min(lowest, low), max(highest, high)
        return lowest - _TRAVEL_ROOM, highest + _TRAVEL_ROOM

    @functools.cached_property
    def remaining(self) -> tuple[float, ...]:
        """Nominal time of the steps after each of them [s]; asked for in every turn of a run."""
        after = itertools.accumulate((step.nominal for step in self.steps[:0:-1]), initial=0.0)
        return tuple(after)[::-1]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the plan is too thin for: the curves of its analysis that stand on too few points."""
        segments = [
            step.segment
            for step in self.plan
            if isinstance(step, Motion) and step.segment is not None
        ]
        standings = (shape.planned(segments) for shape in self.experiment.shapes)
        return tuple(text for standing in standings for text in standing.warnings)

    def as_json(self) -> dict[str, Any]:
        """The object that `rig plan --json` prints."""
        peak = max((abs(step.speed) for step in self.steps), default=0.0)
        turned = self.input_revolutions / self.load.ratio if self.experiment.gear_mounted else 0.0
        return {
            "protocol": self.experiment.name,
            "parameters": {name: _plain(value) for name, value in vars_of(self.parameters).items()},
            "gear": self.gear.name,
            "mounting": self.mounting,
            "steps": len(self.plan),
            "duration": {"nominal": self.nominal, "longest": self.longest, "unit": "s"},
            "input_revolutions": self.input_revolutions,
            "output_revolutions": turned,
            "samples": self.samples,
            "sample_rate": {"value": self.sample_rate, "unit": "Hz"},
            "file_size": {"value": self.file_size(), "unit": "bytes"},
            "peak_speed": {"value": peak / RPM, "unit": "r/min"},
            "margins": [margin.as_json() for margin in self.margins],
            "limits": self.limits.as_json(),
            "remarks": list(self.remarks),
        }


def walk(
    plan: Iterable[Step], load: Load, starting_torque: float, period: float
) -> tuple[StepForecast, ...]:
    """Every step of a plan with an ideal rig: `load` it turns, `starting_torque` [N m] at which it begins to move."""
    forecasts: list[StepForecast] = []
    setpoint, powered = 0.0, False
    for index, step in enumerate(plan):
        forecast = step.forecast(
            Situation(
                index=index,
                what=step.words(),
                setpoint=setpoint,
                period=period,
                inertia=load.total_inertia,
                ratio=load.ratio,
                starting_torque=starting_torque,
            )
        )
        if isinstance(step, Motion) and (step.servo is not Servo.OFF) is not powered:
            powered = not powered
            nominal, longest = forecast.nominal + SWITCHING_TIME, forecast.longest + SWITCHING_TIME
            forecast = replace(forecast, nominal=nominal, longest=longest)
        setpoint = forecast.end
        forecasts.append(forecast)
    return tuple(forecasts)


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
    """Walk a protocol's plan. Raises `PlanError` for one that is impossible, `LimitError` for one
    that breaks a limit.
    """
    plan = tuple(experiment.plan(parameters, gear))
    disc = float(getattr(parameters, "disc_inertia", 0.0))
    load = load_of(gear, motor, mounting, experiment.gear_mounted, disc)
    static = _friction(gear, motor, experiment.gear_mounted, 0.0)
    steps = walk(plan, load, static, 1.0 / sample_rate)
    fastest = max((abs(step.speed) for step in steps), default=0.0)
    limits = derive_limits(
        gear,
        motor,
        mounting,
        gear_mounted=experiment.gear_mounted,
        disc_inertia=disc,
        plan_speed=fastest,
        configured=configured,
    )
    margins = tuple(
        _margins(steps, limits, load, lambda w: _friction(gear, motor, experiment.gear_mounted, w))
    )
    planned = PlannedRun(
        experiment=experiment,
        parameters=parameters,
        gear=gear,
        motor=motor,
        mounting=mounting,
        sample_rate=sample_rate,
        plan=plan,
        steps=steps,
        limits=limits,
        load=load,
        margins=margins,
    )
    for margin in margins:
        _refuse_broken(margin)
    return planned


def _refuse_broken(margin: Margin) -> None:
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

    def running(point: OperatingPoint) -> float:
        # A swing goes both ways alike: half of it, turning forward, stands for all of it.
        return abs(friction(point.speed) + load.total_inertia * point.acceleration)

    def motor_torque(step: StepForecast) -> float:
        if step.points:
            return max(running(point) for point in step.points)
        turning = friction(step.speed) + load.total_inertia * acceleration(step)
        return max(step.torque, turning if step.speed else 0.0)

    def mean_square(step: StepForecast) -> float:
        if step.points:
            return sum(point.share * running(point) ** 2 for point in step.points)
        return (friction(step.speed) if step.turned else step.torque) ** 2

    peaks: dict[str, Callable[[StepForecast], float]] = {
        lim.INPUT_SPEED: lambda step: abs(step.speed),
        lim.ACCELERATION: lambda step: step.acceleration,
        lim.MOTOR_TORQUE: motor_torque,
        lim.TORSION_TORQUE: lambda step: max(
            load.gear_torque(acceleration(step)), load.ratio * step.torque
        ),
    }
    for quantity, of in peaks.items():
        limit = limits.tightest(quantity)
        if limit is not None and steps:
            worst = max(steps, key=of)
            yield Margin(quantity, of(worst), worst.where, limit)
    duration = sum(step.nominal for step in steps)
    means = {lim.AVERAGE_SPEED: 0.0, lim.RMS_TORQUE: 0.0}
    if duration:
        squares = sum(step.nominal * mean_square(step) for step in steps)
        means[lim.AVERAGE_SPEED] = sum(step.turned for step in steps) / duration
        means[lim.RMS_TORQUE] = math.sqrt(squares / duration)
    for quantity, value in means.items():
        limit = limits.tightest(quantity)
        if limit is not None:
            yield Margin(quantity, value, "the whole plan", limit)


def vars_of(parameters: Any) -> dict[str, Any]:
    """The fields of a protocol's parameters by name."""
    import dataclasses

    return {f.name: getattr(parameters, f.name) for f in dataclasses.fields(parameters)}


def _plain(value: Any) -> Any:
    return list(cast("tuple[Any, ...]", value)) if isinstance(value, tuple) else value
