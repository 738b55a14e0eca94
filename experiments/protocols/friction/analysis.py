"""No-load running torque over speed: constant speeds, both directions, up and down, bracketed by a reference speed.

(18) F_fb, (19) F_fm, (20) T_f(v), in the torque balance that the parameter set names

Half-difference of the directions is friction, half-sum is offset and asymmetry. The torque port
shows motor + gear: a valid motor tare is subtracted with its uncertainty, without one everything is
labelled "motor + gear". Figures 9 and 17.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from experiments.budget import budget_table
from experiments.contract import Evidence
from experiments.errors import AnalysisError, SettingError, analysing
from experiments.evidence import check_settings, rotary_ratio
from experiments.protocols.friction.declaration import NAME, SETTINGS
from experiments.protocols.friction.estimates import (
    at_20_degrees,
    coefficients_of,
    genetic_metrics,
    offset_estimate,
    running_torques,
)
from experiments.protocols.friction.foreign import friction_in_foreign_unit
from experiments.protocols.friction.influences import (
    BEARING,
    PLACE,
    PLACE_ORDERS,
    FittedCurve,
    bearing_relative,
    bearing_torque,
    common_errors,
    corrected,
    spread_of,
)
from experiments.protocols.friction.plots import (
    fit_table,
    friction_plots,
    friction_prediction_plot,
    point_table,
)
from experiments.protocols.friction.points import (
    MeasuredFriction,
    measure_friction,
    reproducibility,
)
from experiments.protocols.friction.quantities import CURVE, QUANTITIES
from experiments.protocols.friction.temperature import DRY, VISCOUS
from experiments.recording import Recording
from experiments.result import Covariance, Result
from experiments.setting import names_of
from experiments.shape import Standing
from model.arrays import quotient
from model.friction import TorqueBalance, friction_torque
from model.gear import HarmonicDrive, Origin
from model.identify.common_errors import UNREPEATED, Spread, Stated
from model.identify.friction import LARGEST_REDUCED_CHI_SQUARE, check_identifiable, fit_friction
from model.identify.friction_result import FrictionFit
from model.identify.running_torque import FrictionPoints, pair_directions, pooled_errors
from model.identify.stribeck import NAMES


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Friction parameters with profile intervals, running torque at the catalogue's speeds, offset and asymmetry, at
    the run's mean temperature, and at 20 degC beside it.

    Settings: channel ("torque"), balance ("energy" or "published", the gear's own), bracket_limit
    (0.03; above it a warning), bracket_refusal (0.25; above it refused), chi_square_limit (4 per degree
    of freedom; above it refused), genetic (False; True: the paper's search beside it), seed of that search (0);
    dry_per_kelvin, viscous_per_kelvin: value and U of the gear's temperature coefficients [1/K], with
    per_kelvin_source; output_bearing, output_bearing_viscous: value and U of the bench's output bearing
    [N m], [N m s/rad], with output_bearing_date and output_bearing_source.
    """
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    measured = measure_friction(recording, evidence)
    chi_square_limit = float(evidence.settings.get("chi_square_limit", LARGEST_REDUCED_CHI_SQUARE))
    if measured.unit != "N m":
        return friction_in_foreign_unit(recording, measured, chi_square_limit)
    with analysing(recording.metadata.run_id):
        fit, curve, spread = _fit(recording, evidence, measured)
        bracket_limit = float(evidence.settings.get("bracket_refusal", 0.25))
        check_identifiable(fit, limit=bracket_limit, chi_square_limit=chi_square_limit)
        metrics = dict(fit.metrics) | _genetic(fit, evidence)
    brought = _brought(measured, fit)
    span = float(np.ptp(measured.temperature)) if measured.law.is_known else 0.0
    coefficients = coefficients_of(fit, curve, span)
    metrics["torque_zero_drift"] = measured.zero.drift
    metrics["reproducibility"] = reproducibility(brought.bracket)
    metrics |= _conditions(measured, fit, spread, evidence.gear, coefficients)
    metrics |= _housing_temperature(measured)
    metrics |= _bearing_taken_off(measured, fit, rotary_ratio(recording, evidence.gear.ratio))
    points = point_table(measured.holds, measured.bracket, measured.tare)
    standing = _standing(fit, spread)
    estimates = standing.weakly(
        dict(fit.estimates)
        | running_torques(fit, curve, coefficients)
        | at_20_degrees(fit, curve, coefficients)
        | offset_estimate(fit, measured.zero)
    )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=(*measured.warnings, *fit.warnings, *standing.warnings),
        plots=friction_plots(fit, brought.holds, measured.bracket, measured.tare, measured.every),
        tables=(fit_table(fit), points, budget_table(estimates.values())),
        options=_options(measured, fit, spread, evidence.gear, coefficients),
        covariance=_covariance(fit),
    )


def _fit(
    recording: Recording, evidence: Evidence, measured: MeasuredFriction
) -> tuple[FrictionFit, FittedCurve, Spread]:
    """The fit of all points, reference speed included, weighed by what they share as the fit itself shows it (three
    rounds).
    """
    settings, gear = evidence.settings, evidence.gear
    ratio = rotary_ratio(recording, gear.ratio)
    balance: TorqueBalance = settings.get("balance") or gear.options.torque_balance
    mesh = gear.mesh_friction
    values = np.array([mesh.coulomb, mesh.static, mesh.stribeck_velocity, mesh.shape, mesh.viscous])

    def curve_of(values: np.ndarray) -> FittedCurve:
        return FittedCurve(gear=gear, balance=balance, values=values, law=measured.law)

    def fit_of(curve: FittedCurve, spread: Spread, *, profile: bool, is_first: bool) -> FrictionFit:
        common = [] if is_first else common_errors(measured, curve, spread, recording, ratio)
        return fit_friction(
            [h.torque for h in measured.every] if is_first else corrected(measured, curve, ratio),
            gear,
            tare=measured.tare,
            bracket=[h.torque for h in measured.bracket],
            common=common,
            spread=spread,
            bearing_torque=lambda speed: bearing_torque(curve, speed),
            balance=balance,
            bracket_limit=float(settings.get("bracket_limit", 0.03)),
            profile=profile,
        )

    curve, spread = curve_of(values), UNREPEATED
    fit = fit_of(curve, spread, profile=False, is_first=True)
    for is_last in (False, True):
        curve = curve_of(fit.stribeck.values)
        points = pair_directions(corrected(measured, curve, ratio))
        others = common_errors(measured, curve, UNREPEATED, recording, ratio)
        spread = spread_of(measured, points, pooled_errors(points), curve, others)
        fit = fit_of(curve, spread, profile=is_last, is_first=False)
    return fit, curve_of(fit.stribeck.values), spread


def _brought(measured: MeasuredFriction, fit: FrictionFit) -> MeasuredFriction:
    """The points at mean place and mean temperature, as far as the fit tells what place and heat did to them."""
    shown = fit.shown_of((PLACE, DRY, VISCOUS))
    moved = [
        dataclasses.replace(
            hold,
            torque=dataclasses.replace(
                torque, torque=torque.torque - torque.direction * float(there)
            ),
        )
        for hold, torque, there in zip(measured.every, fit.holds, shown, strict=True)
    ]
    split = len(measured.holds)
    return dataclasses.replace(measured, holds=moved[:split], bracket=moved[split:])


def _conditions(
    measured: MeasuredFriction,
    fit: FrictionFit,
    spread: Spread,
    gear: HarmonicDrive,
    coefficients: Mapping[str, Stated],
) -> dict[str, float]:
    """What else than speed the friction depends on, as the points show it."""
    coulomb, static = (float(v) for v in fit.stribeck.values[:2])
    numbers = {
        "scatter_of_points": spread.point,
        "stribeck_dip": quotient(static, coulomb) - 1.0,
        "dip_by_chance": fit.stribeck.chance,
        "bearing_torque_factor": 1.0 + bearing_relative(gear, measured.law) * fit.shared[BEARING],
    }
    waves = fit.parts_of(PLACE).reshape(-1, 2) * spread.place
    for order, pair in zip(PLACE_ORDERS, waves, strict=False):
        numbers[f"friction_over_output_order_{order}"] = float(np.hypot(*pair))
    law = measured.law
    if law.is_known:
        numbers["dry_friction_per_kelvin"] = law.dry.at(coefficients[DRY].value)
        numbers["viscous_friction_per_kelvin"] = law.viscous.at(coefficients[VISCOUS].value)
    return numbers


def _standing(fit: FrictionFit, spread: Spread) -> Standing:
    """The curve on the points that it was laid through."""
    places = len(np.unique(fit.points.level))
    return Standing(CURVE, len(fit.points.speed), places, spread.point)


def _bearing_taken_off(
    measured: MeasuredFriction, fit: FrictionFit, ratio: float
) -> dict[str, float]:
    """The output bearing as Coulomb and viscous friction of the mesh, as far as it was subtracted."""
    dry, both = (float(measured.output.torque(np.array([w]), ratio)[0]) for w in (0.0, 1.0))
    return {
        "output_bearing_subtracted": dry / fit.lever,
        "output_bearing_viscous_subtracted": (both - dry) / fit.lever,
    }


def _options(
    measured: MeasuredFriction,
    fit: FrictionFit,
    spread: Spread,
    gear: HarmonicDrive,
    coefficients: Mapping[str, Stated],
) -> dict[str, object]:
    """The conventions of the fit, and what was taken off its points."""
    return {
        "torque_is_of": fit.subject,
        "torque_balance": fit.torque_balance,
        "channel": measured.channel,
        "low_speed_branch": gear.options.low_speed_branch,
        "points_brought_to": _words(measured, spread),
        "output_bearing": measured.output.words(),
        "temperature_coefficients": (
            f"dry {coefficients[DRY].source}; viscous {coefficients[VISCOUS].source}"
        ),
    }


def _words(measured: MeasuredFriction, spread: Spread) -> str:
    """What the points were brought to."""
    parts = ["mean place on the output"] * (spread.place > 0.0)
    parts += ["mean warmth"] * measured.law.is_known
    return " and ".join(parts) or "nothing"


def _genetic(fit: FrictionFit, evidence: Evidence) -> dict[str, float]:
    """The paper's search beside the fit, where it is asked for."""
    is_wanted = evidence.settings.get("genetic", False)
    if not isinstance(is_wanted, bool):
        raise SettingError(
            "is of the wrong kind",
            where=f"{NAME}.genetic",
            value=repr(is_wanted),
            limit="true or false",
        )
    if not is_wanted:
        return {}
    return genetic_metrics(fit, evidence.gear, int(evidence.settings.get("seed", 0)))


def _covariance(fit: FrictionFit) -> Covariance:
    """Of the parameters: what is this fit's alone, and the errors that other results share."""
    shared = fit.shared_by_cause()
    inside = {c.cause for c in fit.common if c.is_fitted}
    own = fit.stribeck.covariance - sum(
        np.outer(vector, vector) for cause, vector in shared.items() if cause in inside
    )
    return Covariance(NAMES, own, shared, fit.stribeck.at_bound)


def _housing_temperature(measured: MeasuredFriction) -> dict[str, float]:
    """Mean and span of the housing temperature of the points [degC], where it was recorded."""
    temperature = measured.temperature
    if not np.isfinite(temperature).all():
        return {}
    return {
        "housing_temperature": float(temperature.mean()),
        "housing_temperature_span": float(np.ptp(temperature)),
    }


def compare(recording: Recording, gear: HarmonicDrive, evidence: Evidence) -> Result:
    """Score the friction of a given parameter set on a run: MSE as in (22), and skill against two null models.

    Null models: the mean torque, and a straight line over speed; both are fitted to the run, the parameter set is not.
    """
    check_settings(evidence.settings, names_of(SETTINGS), NAME)
    measured = measure_friction(recording, evidence)
    if measured.unit != "N m":
        raise AnalysisError(
            "a parameter set gives torques; this recording has none",
            where=recording.metadata.run_id,
            value=f"{measured.channel} in {measured.unit}",
            limit="N m",
        )
    with analysing(recording.metadata.run_id):
        points = pair_directions([h.torque for h in measured.holds])
    torque = points.friction - measured.motor_torque(points.speed)
    predicted = friction_torque(gear, points.speed)
    metrics = _scores(points, torque, predicted)
    warnings = [*measured.warnings, *points.warnings]
    if measured.tare is None:
        warnings.append(
            "Without a valid tare a gear's parameter set is compared with motor and gear together."
        )
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={},
        metrics=metrics,
        warnings=tuple(warnings),
        plots=(friction_prediction_plot(gear, points, torque, predicted, measured.subject),),
        options={
            "torque_is_of": measured.subject,
            "torque_balance": gear.options.torque_balance,
            "parameter_set": gear.name,
            "fitted": "nothing",
        },
    )


def _scores(points: FrictionPoints, torque: np.ndarray, predicted: np.ndarray) -> dict[str, float]:
    """MSE as in (22), rms, and skill 1 - rms/rms_null against the mean and a straight line."""
    residual = torque - predicted
    rms = float(np.sqrt(np.mean(residual**2)))
    spread = float(np.std(torque))
    line = np.array([0.0, float(torque.mean())])
    if len(torque) > 2:
        line = np.polyfit(points.speed, torque, 1)
    straight = float(np.sqrt(np.mean((torque - np.polyval(line, points.speed)) ** 2)))
    return {
        "mse": 100.0 * quotient(rms, spread) ** 2,
        "residual_rms": rms,
        "relative_rms": float(np.sqrt(np.mean((residual / torque) ** 2))),
        "mean_residual": float(residual.mean()),
        "skill_against_mean": 1.0 - quotient(rms, spread),
        "skill_against_straight_line": 1.0 - quotient(rms, straight),
        "points": float(len(torque)),
    }


def identified(result: Result, gear: HarmonicDrive) -> HarmonicDrive:
    """The gear with the identified mesh friction and its uncertainty, in the torque balance of the fit, and with the
    factor of the bearing's torque that the fit found beside it.

    Friction of motor + gear does not belong in a gear's parameter set: without a valid tare the
    gear comes back as it was.
    """
    if result.kind != NAME:
        raise AnalysisError(
            "is the result of another protocol", where=result.run, value=result.kind, limit=NAME
        )
    if result.options.get("torque_is_of") != "gear":
        return gear
    factor = result.metrics.get("bearing_torque_factor", 1.0) * gear.bearing.friction_factor
    changed = gear.with_values(
        {f"mesh_friction.{name}": result.estimates[name].value for name in NAMES}
        | {"bearing.friction_factor": factor}
    )
    origins = dict(changed.origins)
    for name in NAMES:
        estimate = result.estimates[name]
        u = estimate.standard_uncertainty
        source = "; ".join(filter(None, (f"run {result.run}", estimate.note)))
        origins[f"mesh_friction.{name}"] = Origin(
            "identified", source, u if math.isfinite(u) else None
        )
    balance = result.options["torque_balance"]
    options = dataclasses.replace(changed.options, torque_balance=balance)
    return dataclasses.replace(changed, options=options, origins=origins)
