"""The friction of a gear from running torques at constant speeds (equations 18-20): parameters, intervals, budget.

    T(v) = l_b M_0(v) + l_m {F_c + (F_s - F_c) exp[-(v/v_s)^sigma] + c_v v}

M_0 and the levers l_b, l_m come from the parameter set in the torque balance that it names
("energy" or "published"); F_c, F_s, v_s, sigma and c_v are identified. The torque port sees motor
and gear: without a valid tare the result is labelled "motor + gear" and claims nothing about the
gear alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from model.errors import IdentificationError
from model.friction import TorqueBalance, bearing_lever, bearing_magnitude, mesh_lever
from model.gear import HarmonicDrive
from model.identify.checks import Array
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.identify.running_torque import (
    FrictionPoints,
    RunningTorque,
    Tare,
    bracket_drift,
    pair_directions,
)
from model.identify.stribeck import (
    NAMES,
    StribeckBounds,
    StribeckFit,
    fit_stribeck,
    profile_intervals,
    stribeck_curve,
)
from model.units import RPM

Object = Literal["gear", "motor + gear"]
UNITS = {
    "coulomb": "N",
    "static": "N",
    "stribeck_velocity": "rad/s",
    "shape": "1",
    "viscous": "N s/rad",
}


@dataclass(frozen=True)
class TorqueUncertainty:
    """Standard uncertainties of type B of the torque channel and the conditions.

    scale: relative, of the torque constant; zero [N m]: of the servo-off zero (matters for holds
    without a partner); tare: relative, of the tare as a whole (same motor, another day);
    temperature [K] with temperature_coefficient [1/K] of the friction; bearing: relative, of M_0.
    """

    scale: float = 0.0
    zero: float = 0.0
    tare: float = 0.0
    temperature: float = 0.0
    temperature_coefficient: float = -0.04
    bearing: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FrictionFit:
    """Friction of a gear (or of motor and gear together), fitted, with what is needed to judge and to plot it.

    estimates: coulomb, static, stribeck_velocity, shape, viscous, and offset, asymmetry of the
    torque (half sums). metrics: chi_square, freedom, birge, residual_rms [N m], relative_rms,
    bracket_drift, points, slowest_speed. speed, torque, standard_error, fitted (n,): friction at
    the input [N m], tare subtracted; tare (n,); curve_speed, curve_torque for plots.
    """

    subject: Object
    torque_balance: TorqueBalance
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    speed: Array
    torque: Array
    standard_error: Array
    tare: Array
    fitted: Array
    offset: Array
    offset_error: Array
    curve_speed: Array
    curve_torque: Array
    stribeck: StribeckFit

    @property
    def parameters(self) -> dict[str, float]:
        """`mesh_friction.*` values for `HarmonicDrive.with_values`."""
        return {f"mesh_friction.{name}": self.estimates[name].value for name in NAMES}


def _pooled_errors(points: FrictionPoints) -> Array:
    """Standard errors shrunk towards their common relative size: few revolutions say little about their own scatter."""
    relative = points.standard_error / np.maximum(np.abs(points.friction), 1e-12)
    typical = float(np.median(relative))
    prior = 4.0
    variance = (prior * typical**2 + points.freedom * relative**2) / (prior + points.freedom)
    return np.sqrt(variance) * np.maximum(np.abs(points.friction), 1e-12)


def fit_friction(
    holds: Sequence[RunningTorque],
    gear: HarmonicDrive,
    *,
    tare: Tare | None = None,
    bracket: Sequence[RunningTorque] = (),
    uncertainty: TorqueUncertainty | None = None,
    balance: TorqueBalance | None = None,
    bounds: StribeckBounds | None = None,
    bracket_limit: float = 0.03,
    profile: bool = True,
) -> FrictionFit:
    """The friction of a gear from holds at constant speeds in both directions.

    `tare` is subtracted with its uncertainty; `bracket`: the visits to the reference speed;
    `balance`: the torque balance (the parameter set's own by default). Without `profile` the
    intervals are the linearised ones.
    """
    chosen: TorqueBalance = balance or gear.options.torque_balance
    points = pair_directions(holds)
    warnings = list(points.warnings)
    tare_torque, tare_error = np.zeros_like(points.speed), np.zeros_like(points.speed)
    subject: Object = "motor + gear"
    if tare is not None:
        tare_torque, tare_error, beyond = tare.at(points.speed)
        if beyond.any():
            fastest = float(points.speed[beyond].max()) / RPM
            warnings.append(
                f"{int(beyond.sum())} speeds (to {fastest:.0f} r/min) lie beyond the tare's "
                "range: its ends are used there."
            )
        subject = "gear" if tare.valid else "motor + gear"
        if tare.note:
            warnings.append(f"Tare: {tare.note}.")
    if subject == "motor + gear":
        warnings.append(
            "Without a valid tare this is the friction of motor and gear together, not of the gear."
        )
    torque = points.friction - tare_torque
    error = np.hypot(_pooled_errors(points), tare_error)
    lever, drag = mesh_lever(gear, chosen), _bearing_torque(gear, points.speed, chosen)
    force, force_error = (torque - drag) / lever, error / lever
    fit = fit_stribeck(points.speed, force, force_error, bounds=bounds)
    intervals = _intervals(fit, points.speed, force, force_error, bounds, profile)
    estimates = _estimates(fit, intervals, points.speed)
    sources = _type_b(
        uncertainty or TorqueUncertainty(),
        fit,
        points=points,
        torque=torque,
        tare=tare_torque,
        drag=drag,
        force_error=force_error,
        lever=lever,
    )
    for k, name in enumerate(NAMES):
        lines = [
            BudgetLine("scatter between revolutions and points", "A", _half_width(estimates[name]))
        ]
        lines += [
            BudgetLine(source, "B", abs(float(change[k])), cause=cause)
            for source, cause, change in sources
        ]
        estimates[name] = estimates[name].with_budget(lines)
    estimates.update(_offset(points))
    drift, sentence = bracket_drift(bracket, limit=bracket_limit) if bracket else (math.nan, None)
    warnings += [sentence] if sentence else []
    warnings += _judge(fit, estimates, points, holds)
    fitted = lever * fit.fitted + drag
    curve_speed = np.geomspace(points.speed.min(), points.speed.max(), 300)
    residual = torque - fitted
    return FrictionFit(
        subject=subject,
        torque_balance=chosen,
        estimates=estimates,
        metrics={
            "chi_square": fit.chi_square,
            "freedom": float(fit.freedom),
            "birge": math.sqrt(fit.chi_square / max(fit.freedom, 1)),
            "residual_rms": float(np.sqrt(np.mean(residual**2))),
            "relative_rms": float(np.sqrt(np.mean((residual / torque) ** 2))),
            "bracket_drift": drift,
            "points": float(len(torque)),
            "slowest_speed": float(points.speed.min()),
        },
        warnings=tuple(warnings),
        speed=points.speed,
        torque=torque,
        standard_error=error,
        tare=tare_torque,
        fitted=fitted,
        offset=points.offset,
        offset_error=points.offset_error,
        curve_speed=curve_speed,
        curve_torque=lever * stribeck_curve(curve_speed, fit.values)
        + _bearing_torque(gear, curve_speed, chosen),
        stribeck=fit,
    )


def _bearing_torque(gear: HarmonicDrive, speed: Array, balance: TorqueBalance) -> Array:
    magnitude = bearing_magnitude(
        gear.bearing, speed, low_speed_branch=gear.options.low_speed_branch
    )
    return bearing_lever(gear, balance) * magnitude


def _intervals(
    fit: StribeckFit,
    speed: Array,
    force: Array,
    error: Array,
    bounds: StribeckBounds | None,
    profile: bool,
) -> Array:
    if profile:
        return profile_intervals(fit, speed, force, error, bounds=bounds)
    half = 1.96 * np.sqrt(np.diag(fit.covariance))
    return np.column_stack([fit.values - half, fit.values + half])


def _estimates(fit: StribeckFit, intervals: Array, speed: Array) -> dict[str, Estimate]:
    estimates: dict[str, Estimate] = {}
    unpinned = bool(speed.min() > fit.values[2] / 10.0 * 1.05)
    for k, name in enumerate(NAMES):
        low, high = (float(x) for x in intervals[k])
        value = float(fit.values[k])
        verdict: Literal["yes", "weakly", "no"] = "yes"
        note = ""
        if not (math.isfinite(low) and math.isfinite(high)):
            verdict, note = (
                "no",
                "the profile of the likelihood does not close: the data do not bound it",
            )
            low, high = (
                (low if math.isfinite(low) else 0.0),
                (high if math.isfinite(high) else math.inf),
            )
        elif name in fit.at_bound:
            verdict, note = "weakly", "stopped at its bound"
        elif high - low > abs(value):
            verdict, note = "weakly", "the interval is wider than the value"
        elif unpinned and name in ("static", "stribeck_velocity", "shape"):
            verdict, note = "weakly", "the slowest speed is above a tenth of the Stribeck velocity"
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit=UNITS[name],
            low=low,
            high=high,
            identifiable=verdict,
            note=note,
        )
    return estimates


def _half_width(estimate: Estimate) -> float:
    return 0.25 * (estimate.high - estimate.low) if math.isfinite(estimate.high) else math.inf


def _type_b(
    given: TorqueUncertainty,
    fit: StribeckFit,
    points: FrictionPoints,
    torque: Array,
    tare: Array,
    drag: Array,
    force_error: Array,
    lever: float,
) -> list[tuple[str, Cause | None, Array]]:
    """Change of the five parameters for one standard uncertainty of each source of type B (linearised)."""
    weighted = fit.jacobian / force_error[:, None]
    gain = np.linalg.pinv(weighted, rcond=1e-10) / (force_error * lever)
    warmer = given.temperature * given.temperature_coefficient
    changes = [
        ("torque scale", Cause.TORQUE_SCALE, given.scale * torque),
        ("torque zero", None, np.where(points.paired, 0.0, given.zero)),
        ("tare", Cause.TARE, given.tare * tare),
        ("temperature", None, warmer * torque),
        ("bearing no-load torque", Cause.BEARING_TORQUE, given.bearing * drag),
    ]
    return [(source, cause, gain @ by) for source, cause, by in changes if np.any(by != 0.0)]


def _offset(points: FrictionPoints) -> dict[str, Estimate]:
    """Constant part of the half sums (torque zero) and their slope over speed (asymmetry),
    weighted, with 95 % intervals.
    """
    use = points.paired
    if use.sum() < 3:
        return {}
    speed, offset = points.speed[use], points.offset[use]
    u = np.maximum(points.offset_error[use], 0.2 * np.median(points.offset_error[use]))
    design = np.column_stack([np.ones_like(speed), speed]) / u[:, None]
    covariance = np.linalg.inv(design.T @ design)
    values = covariance @ design.T @ (offset / u)
    chi = float(np.sum((offset / u - design @ values) ** 2)) / max(len(speed) - 2, 1)
    half = 2.0 * np.sqrt(np.diag(covariance) * max(chi, 1.0))
    return {
        "offset": Estimate(
            name="offset",
            value=values[0],
            unit="N m",
            low=values[0] - half[0],
            high=values[0] + half[0],
        ),
        "asymmetry": Estimate(
            name="asymmetry",
            value=values[1],
            unit="N m s/rad",
            low=values[1] - half[1],
            high=values[1] + half[1],
        ),
    }


def _judge(
    fit: StribeckFit,
    estimates: dict[str, Estimate],
    points: FrictionPoints,
    holds: Sequence[RunningTorque],
) -> list[str]:
    """What a reader must know before using the numbers."""
    remarks = []
    slowest, velocity = float(points.speed.min()), float(fit.values[2])
    if slowest > velocity / 10.0 * 1.05:
        remarks.append(
            f"The slowest speed ({slowest / RPM:.3g} r/min) is above a tenth of the Stribeck velocity "
            f"({velocity / RPM:.3g} r/min): it cannot pin the Stribeck part. Measure down to "
            f"{velocity / 10.0 / RPM:.2g} r/min."
        )
    remarks += [
        f"{name} stopped at its bound ({estimates[name].value:.4g} {UNITS[name]})."
        for name in fit.at_bound
    ]
    remarks += [
        f"{name} is not identified: {e.note}."
        for name, e in estimates.items()
        if e.identifiable == "no"
    ]
    stuck = sorted({round(abs(h.speed) / RPM, 2) for h in holds if h.sticks})
    if stuck:
        remarks.append(
            f"The input stuck at {', '.join(f'{s:g}' for s in stuck)} r/min: the mean there is not a running torque."
        )
    birge = math.sqrt(fit.chi_square / max(fit.freedom, 1))
    if birge > 2.0:
        remarks.append(
            f"The points scatter {birge:.1f} times as much about the curve as they do from "
            "revolution to revolution: something "
            "drifts between them, or the curve is not theirs. Intervals are widened by that factor."
        )
    return remarks


def check_identifiable(fit: FrictionFit, *, limit: float = 0.03) -> None:
    """Refuse a sweep whose reference speed drifted by more than `limit`: raise `IdentificationError`."""
    drift = fit.metrics["bracket_drift"]
    if math.isfinite(drift) and drift > limit:
        raise IdentificationError(
            "the reference speed drifted during the sweep",
            where="bracket",
            value=f"{100 * drift:.1f} %",
            limit=f"<= {100 * limit:g} %",
            remedy="Warm up until the running torque is steady, then repeat.",
        )
