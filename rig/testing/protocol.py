"""What a protocol or an analysis keeps: it says what its numbers are; its plan is pure, begins and ends at rest."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from experiments.contract import Experiment
from experiments.errors import PlanError
from experiments.parameters import make_parameters, parameter_fields
from experiments.planning.parts import LABELS, ZERO_AFTER, ZERO_BEFORE
from experiments.steps.vocabulary import (
    FindIndex,
    HoldRevolutions,
    HoldTime,
    MoveRevolutions,
    MoveToAngle,
    Ramp,
    ServoOff,
    Settle,
    SpeedStep,
)
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from rig.testing.kept import keep


def check_protocol(experiment: Experiment, gear: HarmonicDrive | None = None) -> None:
    """Raise `AssertionError` with what a protocol, or an analysis without a plan, does not keep of the contract."""
    _check_words(experiment)
    gear = gear or shipped_gear()
    if not experiment.has_plan:
        _check_refuses(experiment, gear)
        return
    _check_parameters(experiment)
    for values in ({}, dict(experiment.short)):
        parameters = make_parameters(experiment.parameters, values, experiment.name)
        check_plan(experiment, parameters, gear)


def _check_words(experiment: Experiment) -> None:
    """Names and titles of all that it may return."""
    name = experiment.name
    keep(name and name == name.lower() and " " not in name, f"{name!r}: small letters, no blanks")
    keep(experiment.title and experiment.summary, f"{name}: title and summary are needed")
    keep(experiment.quantities, f"{name}: no quantity is declared, so it can return none")
    for quantity in experiment.quantities:
        where = f"{name}.{quantity.name}"
        keep(quantity.title, f"{where}: has no title")
    asked = experiment.foreign_need.channels
    keep(all(asked), f"{name}: a channel that it asks of a recording has no name")


def _check_parameters(experiment: Experiment) -> None:
    """Each has help, a unit where it is a number with a point, and is the same after it was text."""
    defaults, text = experiment.parameters(), {}
    for field in parameter_fields(experiment.parameters):
        where = f"{experiment.name}: parameter {field.name}"
        keep(field.help, f"{where} has no Help")
        keep(field.unit or field.kind is not float, f"{where} has no Unit")
        value = getattr(defaults, field.name)
        if isinstance(value, tuple):
            text[field.name] = " ".join(repr(part) for part in value)
        else:
            text[field.name] = "" if value is None else str(value)
    again = make_parameters(experiment.parameters, text, experiment.name)
    keep(again == defaults, f"{experiment.name}: its defaults are others after they were text")


def _check_refuses(experiment: Experiment, gear: HarmonicDrive) -> None:
    """An analysis of recordings moves nothing."""
    try:
        list(experiment.plan(experiment.parameters(), gear))
    except PlanError:
        return
    raise AssertionError(f"{experiment.name}: has no plan, and yet makes one (plan=no_plan)")


def check_plan(experiment: Experiment, parameters: Any, gear: HarmonicDrive) -> None:
    """One plan, or its refusal: the same when made twice, between torque zeros, finite, within the rated speed."""
    name = experiment.name
    try:
        plan = list(experiment.plan(parameters, gear))
    except PlanError as refusal:
        keep(refusal.where.startswith(name), f"{name}: a refusal does not say where: {refusal}")
        keep(refusal.limit, f"{name}: a refusal does not say the limit: {refusal}")
        return
    keep(plan == list(experiment.plan(parameters, gear)), f"{name}: two plans of one order differ")
    steps: list[Any] = [step for step in plan if hasattr(step, "segment")]
    labels = [step.segment.label for step in steps if step.segment is not None]
    ends = f"{name}: a plan begins and ends with the servo off (between_zeros)"
    keep(labels and (labels[0], labels[-1]) == (ZERO_BEFORE, ZERO_AFTER), ends)
    keep(isinstance(steps[0], ServoOff) and isinstance(steps[-1], ServoOff), ends)
    unknown = ", ".join(sorted(set(labels) - LABELS))
    keep(not unknown, f"{name}: no analysis knows the label {unknown}")
    still = isinstance(steps[-2], HoldTime) and steps[-2].duration > 0.0
    keep(still, f"{name}: it does not stand still before the power goes off (HoldTime)")
    _check_numbers(name, steps, gear.ratings.maximum_input_speed)


def _check_numbers(name: str, steps: Sequence[Any], rating: float) -> None:
    """Nothing is infinite, without an end, or faster than the gear may turn; the power goes off at rest."""
    speed = 0.0
    for step in steps:
        where = f"{name}: {type(step).__name__}"
        for value in dataclasses.asdict(step).values():
            keep(not isinstance(value, float) or math.isfinite(value), f"{where}: {value}")
        keep(getattr(step, "at_most", 1.0) > 0.0, f"{where}: has no end of its own (at_most)")
        keep(getattr(step, "acceleration", 1.0) > 0.0, f"{where}: acceleration is not positive")
        set_to = abs(getattr(step, "speed", 0.0))
        keep(set_to <= rating * (1.0 + 1e-9), f"{where}: {set_to} rad/s, rated {rating} rad/s")
        if isinstance(step, Ramp | SpeedStep):
            speed = step.speed
        elif isinstance(step, MoveToAngle | MoveRevolutions):
            # An angle is approached from either side, by the sign of the speed.
            either = isinstance(step, MoveToAngle) and step.speed < 0.0
            keep(step.speed > 0.0 or either, f"{where}: speed {step.speed} rad/s")
            speed = 0.0
        elif isinstance(step, HoldRevolutions | Settle | FindIndex):
            keep(speed != 0.0, f"{where}: nothing turns")
        if isinstance(step, HoldRevolutions):
            nominal = step.revolutions * 2.0 * math.pi / abs(speed)
            keep(step.at_most > nominal, f"{where}: may take {step.at_most} s, needs {nominal} s")
        if isinstance(step, ServoOff):
            keep(speed == 0.0, f"{where}: the power goes off at {speed} rad/s")
