"""Starting torques with their budgets: at the run's own temperature, and at 20 degC beside it.

The gear's own friction changes from run to run; the motor's magnets weaken as it warms; a thermometer and a coefficient
bring the value to 20 degC, each with a line of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.assumed import Assumed
from experiments.budget import scale_line, thermometer_uncertainty
from experiments.evidence import usable
from experiments.protocols.friction.bearing import COULOMB, OutputBearing
from experiments.protocols.friction.influences import RUN_TO_RUN, RUN_TO_RUN_RELATIVE
from experiments.protocols.friction.temperature import (
    DRY,
    THERMOMETRY,
    Coefficient,
    TemperatureLaw,
    temperature_law,
)
from experiments.protocols.starting_torque.balance import Balance
from experiments.protocols.starting_torque.breakaway import Breakaway
from experiments.protocols.starting_torque.quantities import AT_REFERENCE
from experiments.recording import Recording, Segment
from experiments.result import way_of
from experiments.tares.motor_heat import FRICTION, FRICTION_UNCERTAINTY, MotorHeat, motor_heat
from experiments.torque.running_torque import TEMPERATURE
from experiments.torque.zero import TorqueZero
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.identify.least_squares import student_quantile

APART = "directions apart"
"""The line of a half-sum of the directions that is more than scatter and zero explain."""
_MOTOR_SHARE = 0.5
"""Share of the starting torque that may be the motor's own: a gear's coefficient does not hold for it."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What is known of a run beside its ramps: zero, output bearing, share of the approaches that stuck, temperature.

    `kelvin`: standard uncertainty of the thermometer, `thermometer` what is assumed of it where nobody states it.
    """

    zero: TorqueZero
    bearing: OutputBearing
    stuck: float
    housing: float
    law: TemperatureLaw
    heat: MotorHeat
    thermometer: Assumed | None = None


def conditions_of(
    recording: Recording,
    segments: tuple[Segment, ...],
    settings: Mapping[str, Any],
    zero: TorqueZero,
    bearing: OutputBearing,
    stuck: float,
) -> Conditions:
    """The conditions of a run; its temperature is that of its ramps."""
    housing, kelvin, assumed = math.nan, 0.0, None
    if recording.has(TEMPERATURE):
        parts = [recording.si(TEMPERATURE, s)[usable(recording, s)] for s in segments]
        housing = float(np.median(np.concatenate(parts)))
        kelvin, assumed = thermometer_uncertainty(recording)
    law = temperature_law(settings, housing, kelvin)
    return Conditions(
        zero=zero,
        bearing=bearing,
        stuck=stuck,
        housing=housing,
        law=replace(law, dry=_of_both(law.dry)) if "dry_per_kelvin" in settings else law,
        heat=motor_heat(recording, housing),
        thermometer=assumed,
    )


def _of_both(gear: Coefficient) -> Coefficient:
    """The coefficient of motor and gear together: that of the gear, and what the motor's share may make of it."""
    apart = math.hypot(gear.value - FRICTION, FRICTION_UNCERTAINTY)
    u = math.hypot(gear.standard_uncertainty, _MOTOR_SHARE / math.sqrt(3.0) * apart)
    return replace(gear, standard_uncertainty=u)


def estimates_of(
    recording: Recording, ramps: list[Breakaway], balance: Balance, known: Conditions
) -> dict[str, Estimate]:
    """Mean over positions of each direction, and of both, in which the torque zero cancels; both at 20 degC."""
    alone, zero = balance.direction, known.zero.budget()
    u_zero = zero.standard_uncertainty
    if alone:
        name = f"starting_torque_{way_of(alone)}"
        one = _estimate(recording, ramps, balance, known, name, alone)
        return {one.name: one.with_budget((zero,))}
    apart = _apart(balance, known.zero)
    found: dict[str, Estimate] = {}
    # A drift between two zeros does not cancel where one direction follows the other; an offset does.
    drift = 0.5 if math.isfinite(known.zero.drift) else 0.0
    # If one direction is right, the other is wrong by twice the half-sum.
    for sign, way, share, times in (
        (1, "_forward", 1.0, 2.0),
        (-1, "_reverse", 1.0, 2.0),
        (0, "", drift, 1.0),
    ):
        one = _estimate(recording, ramps, balance, known, f"starting_torque{way}", sign)
        own = replace(zero, standard_uncertainty=share * u_zero)
        lines = [replace(a, standard_uncertainty=times * a.standard_uncertainty) for a in apart]
        if share > 0.0:
            lines.append(own)
        found[one.name] = one.with_budget(lines)
    if known.law.is_known:
        found[AT_REFERENCE] = at_20_degrees(found["starting_torque"], known)
    return found


def _estimate(
    recording: Recording,
    ramps: list[Breakaway],
    balance: Balance,
    known: Conditions,
    name: str,
    sign: int,
) -> Estimate:
    """The torque of one direction, or of both (0), without what concerns the two of them."""
    # The same laws of motion are laid through all ramps, so that their error does not average.
    moment = float(np.mean([b.within for b in ramps])) / math.sqrt(3.0)
    bearing = known.bearing
    turning, unknown = at_rest(recording, bearing)
    held = bearing.coulomb + 2.0 * bearing.coulomb_uncertainty
    lost = known.stuck * _at_input(recording, held) / math.sqrt(3.0)
    friction = balance.friction - turning
    value = sign * friction + balance.asymmetry if sign else friction
    error = balance.error * (math.sqrt(2.0) if sign and not balance.direction else 1.0)
    half = math.hypot(
        student_quantile(balance.freedom) * error,
        NORMAL_COVERAGE_FACTOR * math.hypot(moment, lost),
    )
    note = f"assumed: {100.0 * RUN_TO_RUN_RELATIVE:g} % of dry friction"
    budget = (
        BudgetLine("between ramps", "A", error, degrees_of_freedom=balance.freedom),
        BudgetLine("moment of first motion", "A", moment, "law of motion; rectangular"),
        *[BudgetLine("wind-up lost by stick-slip", "A", lost, "rectangular")] * (lost > 0.0),
        BudgetLine(RUN_TO_RUN, "B", RUN_TO_RUN_RELATIVE * abs(friction), note),
        known.heat.line(value),
        bearing.line(COULOMB, unknown),
        scale_line(recording, value),
    )
    return Estimate(
        name=name,
        value=value,
        unit="N m",
        low=value - half,
        high=value + half,
        note="motor + gear",
        budget=budget,
    )


def _apart(balance: Balance, zero: TorqueZero) -> tuple[BudgetLine, ...]:
    """What the directions leave open of the mean of both where they differ by more than scatter and zero explain: an
    offset that is there with the servo on alone, two scales, one that changed meanwhile, a gear not alike both ways.
    """
    explained = math.hypot(
        student_quantile(balance.freedom) * balance.error,
        NORMAL_COVERAGE_FACTOR * zero.standard_uncertainty,
    )
    if abs(balance.asymmetry) <= explained:
        return ()
    u = abs(balance.asymmetry) / math.sqrt(3.0)
    return (BudgetLine(APART, "B", u, "half-sum beyond scatter and zero; rectangular"),)


def at_20_degrees(one: Estimate, known: Conditions) -> Estimate:
    """A torque brought to 20 degC, every line with it, and what coefficient and thermometer leave open."""
    law = known.law
    factor = 1.0 / law.dry_factor({})
    lines = tuple(
        replace(line, standard_uncertainty=factor * line.standard_uncertainty)
        for line in one.budget
    )
    by_coefficient = one.value * (1.0 / law.dry_factor({DRY: 1.0}) - factor)
    by_thermometer = one.value * (1.0 / law.dry_factor({THERMOMETRY: 1.0}) - factor)
    # As of friction: what brings a number to 20 degC is in its interval too.
    half = math.hypot(
        0.5 * factor * (one.high - one.low),
        NORMAL_COVERAGE_FACTOR * math.hypot(by_coefficient, by_thermometer),
    )
    value = factor * one.value
    coefficient = BudgetLine(
        DRY, "B", abs(by_coefficient), law.dry.source, distribution=law.dry.distribution
    )
    thermometer = BudgetLine(THERMOMETRY, "B", abs(by_thermometer), "of the housing")
    if known.thermometer is not None:
        thermometer = known.thermometer.marked(thermometer)
    return replace(
        one,
        name=AT_REFERENCE,
        value=value,
        low=value - half,
        high=value + half,
        note=f"motor + gear; temperature coefficient {law.dry.source}",
        budget=(*lines, coefficient, thermometer),
    )


def at_rest(recording: Recording, bearing: OutputBearing) -> tuple[float, float]:
    """What the output bearing asks of the input before it turns and is taken off, and its standard uncertainty [N m];
    0 where the ratio is not known.
    """
    taken = bearing.coulomb if bearing.is_subtracted else 0.0
    return _at_input(recording, taken), _at_input(recording, bearing.coulomb_uncertainty)


def _at_input(recording: Recording, torque: float) -> float:
    """A torque of the output as the input feels it [N m]; 0 where the ratio is not known."""
    ratio = recording.metadata.ratio
    return torque / ratio if math.isfinite(ratio) and ratio > 0.0 else 0.0
