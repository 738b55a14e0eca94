"""What a friction fit says beyond its parameters: uncertainties of type B, torques at catalogue
speeds, the paper's search.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from experiments.budget import torque_scale_uncertainty
from experiments.protocols.friction.points import Correction, MeasuredFriction
from experiments.protocols.friction.quantities import CATALOGUE_SPEEDS_RPM
from experiments.recording import Recording
from experiments.torque.running_torque import TEMPERATURE
from experiments.torque.zero import TorqueZero
from model.friction import bearing_lever, bearing_magnitude, mesh_lever
from model.gear import HarmonicDrive, Origin
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.friction import FrictionFit, TorqueUncertainty
from model.identify.stribeck import NAMES, fit_stribeck_genetic
from model.units import RPM

TARE_RELATIVE = 0.03
"""Relative standard uncertainty of a tare as a whole: the same motor, another day, another temperature."""
BEARING_RELATIVE = 0.2
"""Relative standard uncertainty of M_0 where f_0 and nu_0 are taken from the literature."""
TEMPERATURE_COEFFICIENT = -0.04
"""Change of friction per kelvin, relative: typical of grease."""
UNKNOWN_TEMPERATURE = 0.5
"""K, standard uncertainty of the temperature of a run without a thermometer on the housing."""
MOTOR_TEMPERATURE = 1e-3
"""Relative standard uncertainty of the torque constant within a day: magnets lose 0.1 % per kelvin,
and nothing measures the
motor's temperature. It is common to all points of a run, so more points do not average it out."""
THERMOMETER = 0.2
"""K, standard uncertainty of a thermometer without calibration."""


def type_b(
    recording: Recording, gear: HarmonicDrive, measured: MeasuredFriction, correction: Correction
) -> TorqueUncertainty:
    """What the data cannot show: torque scale, zero, the tare as a whole, temperature of the points, literature values.

    Points that were brought to their mean temperature leave the thermometer's own uncertainty,
    others their spread of temperature.
    """
    scale, _ = torque_scale_uncertainty(recording, measured.channel)
    temperature, coefficient = measured.temperature, TEMPERATURE_COEFFICIENT
    spread = float(np.std(temperature)) if np.isfinite(temperature).all() else UNKNOWN_TEMPERATURE
    if correction.per_kelvin is not None:
        spread = recording.signals[TEMPERATURE].calibration.offset_uncertainty or THERMOMETER
        coefficient = correction.per_kelvin[1]
    factor = gear.origins.get("bearing.friction_factor", Origin("assumed"))
    relative = BEARING_RELATIVE
    if factor.standard_uncertainty is not None and gear.bearing.friction_factor > 0.0:
        relative = factor.standard_uncertainty / gear.bearing.friction_factor
    return TorqueUncertainty(
        scale=scale,
        zero=measured.zero.standard_uncertainty,
        tare=TARE_RELATIVE if measured.tare is not None else 0.0,
        temperature=spread,
        temperature_coefficient=coefficient,
        bearing=relative,
    )


def with_motor_temperature(estimates: dict[str, Estimate], scale: float) -> dict[str, Estimate]:
    """The parameters with the temperature of the motor in their 95 % intervals.

    It changes from run to run and is common to the points of one: the scatter between points does
    not show it. `scale` is the relative uncertainty that the budget's line "torque scale" stands
    for.
    """
    return {
        name: _widened(estimate, scale) if name in NAMES else estimate
        for name, estimate in estimates.items()
    }


def _widened(estimate: Estimate, scale: float) -> Estimate:
    by_scale = next(
        (b.standard_uncertainty for b in estimate.budget if b.cause is Cause.TORQUE_SCALE), 0.0
    )
    motor = by_scale * MOTOR_TEMPERATURE / scale if scale > 0.0 else 0.0
    common = 1.96 * motor
    low = estimate.value - math.hypot(estimate.value - estimate.low, common)
    high = estimate.value + math.hypot(estimate.high - estimate.value, common)
    return dataclasses.replace(estimate, low=low, high=high).with_budget(
        [BudgetLine("warmth of the motor", "A", motor)]
    )


def _forces(fit: FrictionFit, gear: HarmonicDrive) -> tuple[np.ndarray, np.ndarray]:
    """Mesh friction [N] and its standard error behind the torques of a fit, in its balance."""
    lever = mesh_lever(gear, fit.torque_balance)
    drag = bearing_lever(gear, fit.torque_balance) * bearing_magnitude(
        gear.bearing, fit.speed, low_speed_branch=gear.options.low_speed_branch
    )
    return (fit.torque - drag) / lever, fit.standard_error / lever


def genetic_metrics(fit: FrictionFit, gear: HarmonicDrive, seed: int) -> dict[str, float]:
    """The paper's genetic search on the same data: how far it stays behind variable projection."""
    force, error = _forces(fit, gear)
    search = fit_stribeck_genetic(fit.speed, force, error, seed=seed)
    best = max(fit.stribeck.chi_square, 1e-12)
    names = {f"genetic_{name}": float(v) for name, v in zip(NAMES, search.values, strict=True)}
    return {
        "genetic_chi_square_excess": search.chi_square / best - 1.0,
        "genetic_evaluations": float(search.evaluations),
        **names,
    }


def running_torques(
    recording: Recording, fit: FrictionFit, gear: HarmonicDrive, measured: MeasuredFriction
) -> dict[str, Estimate]:
    """The no-load running torque at the catalogue's input speeds that lie within the run.

    Interpolated between the points of the two nearest speeds, along the fitted curve: where the
    curve misses the points, the points are right.
    """
    estimates: dict[str, Estimate] = {}
    scale, source = torque_scale_uncertainty(recording, measured.channel)
    for rpm in CATALOGUE_SPEEDS_RPM:
        speed = rpm * RPM
        if not fit.speed.min() <= speed <= fit.speed.max() * 1.01:
            continue
        value, error = _between_points(fit, speed)
        motor = MOTOR_TEMPERATURE * value
        budget = [
            BudgetLine("points nearby", "A", error),
            BudgetLine("warmth of the motor", "A", motor),
            BudgetLine("torque scale", "B", scale * value, source, Cause.TORQUE_SCALE),
        ]
        half = 1.96 * math.hypot(error, motor)
        if measured.tare is not None:
            at, _, _ = measured.tare.at(np.array([speed]))
            tare = TARE_RELATIVE * float(at[0])
            budget.append(BudgetLine("tare", "B", tare, "same motor, another day", Cause.TARE))
        name = f"running_torque_{rpm:.0f}_rpm"
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit="N m",
            low=value - half,
            high=value + half,
            identifiable="yes",
            note=fit.subject,
            budget=tuple(budget),
        )
    return estimates


def _between_points(fit: FrictionFit, speed: float) -> tuple[float, float]:
    """Torque at a speed and its standard error: the curve, and what the nearest speeds below and above leave of it."""
    curve = float(np.interp(speed, fit.curve_speed, fit.curve_torque))
    keys = np.round(np.log(fit.speed), 2)
    levels = np.unique(keys)
    away, errors = [], []
    for level in levels:
        same = keys == level
        weight = fit.standard_error[same] ** -2.0
        relative = (fit.torque[same] - fit.fitted[same]) / fit.fitted[same]
        away.append(float(weight @ relative / weight.sum()))
        errors.append(float(weight.sum() ** -0.5 / fit.fitted[same].mean()))
    at = math.log(speed)
    right = int(np.clip(np.searchsorted(levels, at), 1, len(levels) - 1))
    share = float(np.clip((at - levels[right - 1]) / (levels[right] - levels[right - 1]), 0.0, 1.0))
    residual = (1.0 - share) * away[right - 1] + share * away[right]
    error = math.hypot((1.0 - share) * errors[right - 1], share * errors[right])
    return curve * (1.0 + residual), curve * max(error, 1e-9)


def offset_estimate(fit: FrictionFit, zero: TorqueZero) -> dict[str, Estimate]:
    """The half-sum of the directions with the torque zero in its budget."""
    if "offset" not in fit.estimates:
        return {}
    offset = fit.estimates["offset"]
    line = BudgetLine("scatter of the half-sums", "A", 0.25 * (offset.high - offset.low))
    return {"offset": offset.with_budget((line, zero.budget()))}
