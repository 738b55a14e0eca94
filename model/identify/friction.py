"""The friction of a gear from running torques at constant speeds (equations 18-20): parameters, intervals, budget.

    T(v) = l_b M_0(v) + l_m {F_c + (F_s - F_c) exp[-(v/v_s)^sigma] + c_v v}

M_0 and the levers l_b, l_m come from the parameter set in the torque balance that it names
("energy" or "published"); F_c, F_s, v_s, sigma and c_v are identified. Points share errors (heat,
place on the output, the factor of M_0, the tare): the fit weighs them by what they share, and each
is a line of the budget. The torque port sees motor and gear: without a valid tare the result is
labelled "motor + gear" and claims nothing about the gear alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from model.errors import IdentificationError
from model.friction import TorqueBalance, bearing_lever, bearing_magnitude, mesh_lever
from model.gear import HarmonicDrive
from model.identify.checks import Array
from model.identify.common_errors import CommonError, Spread
from model.identify.estimate import BudgetLine, Estimate, Identifiable, open_ends
from model.identify.friction_result import FrictionFit, Subject
from model.identify.least_squares import student_quantile
from model.identify.running_torque import (
    FrictionPoints,
    RunningTorque,
    Tare,
    bracket_drift,
    pair_directions,
    pooled_errors,
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

TARE_SCATTER = "scatter of the tare"
HALF_SUMS = "scatter of the half-sums"
_NO_DIP = "no Stribeck dip"
_WITH_MOTOR = (
    "Without a valid tare this is the friction of motor and gear together, not of the gear."
)
UNITS = {
    "coulomb": "N",
    "static": "N",
    "stribeck_velocity": "rad/s",
    "shape": "1",
    "viscous": "N s/rad",
}


LARGEST_REDUCED_CHI_SQUARE = 4.0
"""Chi-square per degree of freedom above which the points do not lie on the curve of equation 19."""
CHANCE = 0.05
"""Probability of being chance below which the points are said to bend."""


def fit_friction(
    holds: Sequence[RunningTorque],
    gear: HarmonicDrive,
    *,
    tare: Tare | None = None,
    bracket: Sequence[RunningTorque] = (),
    common: Sequence[CommonError] = (),
    spread: Spread | None = None,
    bearing_torque: Callable[[Array], Array] | None = None,
    balance: TorqueBalance | None = None,
    bounds: StribeckBounds | None = None,
    bracket_limit: float = 0.03,
    profile: bool = True,
) -> FrictionFit:
    """The friction of a gear from holds at constant speeds in both directions.

    `tare` is subtracted with its uncertainty; `bracket`: the visits to the reference speed;
    `common`: errors that the holds share; `spread`: how far a point that is measured again comes out
    (None: no further than its revolutions say); `bearing_torque`: the part l_b M_0 [N m] over speed
    where it is not the parameter set's at its own temperature; `balance`: the torque balance (the
    parameter set's own by default). Without `profile` the intervals are the linearised ones.
    """
    chosen: TorqueBalance = balance or gear.options.torque_balance
    points = pair_directions(holds)
    subject, tare_torque, said = _without_motor(points.speed, tare)
    if tare is not None:
        common = [*common, tare_scatter(tare, np.array([abs(h.speed) for h in holds]))]
    error = pooled_errors(points)
    if spread is not None:
        error = np.hypot(error, spread.point * np.abs(points.friction - tare_torque))

    sweep = _Sweep(
        subject=subject,
        balance=chosen,
        holds=tuple(holds),
        points=points,
        tare=tare_torque,
        error=error,
        drag=bearing_torque or partial(nominal_bearing_torque, gear, balance=chosen),
        lever=mesh_lever(gear, chosen),
        common=tuple(common),
    )
    drift, sentence = bracket_drift(bracket, limit=bracket_limit) if bracket else (math.nan, None)
    found = sweep.fit(bounds, drift)
    estimates = _estimates(found, sweep.ends(found, bounds) if profile else None) | _offset(points)
    warnings = [*points.warnings, *said, *filter(None, (sentence,))]
    warnings += _judge(found.stribeck, estimates, points, holds)
    return replace(found, estimates=estimates, warnings=tuple(warnings))


@dataclass(frozen=True, kw_only=True)
class _Sweep:
    """Friction at the input over speed [N m] and its errors, and the forces at the mesh [N] that it stands for.

    `tare`: the motor's part (n,); `drag`: l_b M_0 over speed; `lever`: l_m; `common`: what the holds share.
    """

    subject: Subject
    balance: TorqueBalance
    holds: tuple[RunningTorque, ...]
    points: FrictionPoints
    tare: Array
    error: Array
    drag: Callable[[Array], Array]
    lever: float
    common: tuple[CommonError, ...]

    @cached_property
    def torque(self) -> Array:
        """The motor's part taken off (n,) [N m]."""
        return self.points.friction - self.tare

    @cached_property
    def force(self) -> Array:
        return (self.torque - self.drag(self.points.speed)) / self.lever

    @cached_property
    def columns(self) -> Array | None:
        """What one standard uncertainty of each fitted common error does to the forces (n, m); None without one."""
        effects = [self.points.mean_of(c.columns) for c in self.common if c.is_fitted]
        return np.column_stack(effects) / self.lever if effects else None

    def fit(self, bounds: StribeckBounds | None, drift: float) -> FrictionFit:
        """The curve with its data, before anything is said of it."""
        speed, lever, torque = self.points.speed, self.lever, self.torque
        fit = fit_stribeck(
            speed, self.force, self.error / lever, common=self.columns, bounds=bounds
        )
        fitted = lever * fit.fitted + self.drag(speed)
        if self.columns is not None:
            torque = torque - lever * (self.columns @ fit.common)
        curve_speed = np.geomspace(float(speed.min()), float(speed.max()), 300)
        return FrictionFit(
            subject=self.subject,
            torque_balance=self.balance,
            estimates={},
            metrics=_metrics(fit, speed, torque, torque - fitted) | {"bracket_drift": drift},
            warnings=(),
            speed=speed,
            torque=torque,
            standard_error=self.error,
            tare=self.tare,
            fitted=fitted,
            offset=self.points.offset,
            offset_error=self.points.offset_error,
            curve_speed=curve_speed,
            curve_torque=lever * stribeck_curve(curve_speed, fit.values) + self.drag(curve_speed),
            stribeck=fit,
            holds=self.holds,
            points=self.points,
            force=self.force,
            force_error=self.error / lever,
            columns=self.columns,
            common=self.common,
            lever=lever,
        )

    def ends(self, found: FrictionFit, bounds: StribeckBounds | None) -> Array:
        """Both ends of the parameters' intervals (5, 2), by the profile of the likelihood."""
        return profile_intervals(
            found.stribeck,
            found.speed,
            found.force,
            found.force_error,
            common=found.columns,
            bounds=bounds,
        )


def _without_motor(speed: Array, tare: Tare | None) -> tuple[Subject, Array, list[str]]:
    """Whose friction it is with this tare, the motor's part at these speeds [N m], and what is to be said of it."""
    if tare is None:
        return "motor + gear", np.zeros_like(speed), [_WITH_MOTOR]
    torque, _, beyond = tare.at(speed)
    said: list[str] = []
    if beyond.any():
        fastest = float(speed[beyond].max()) / RPM
        said.append(
            f"{int(beyond.sum())} speeds (to {fastest:.0f} r/min) lie beyond the tare's "
            "range: a straight line through it is used there."
        )
    if tare.note:
        said.append(f"Tare: {tare.note}.")
    return ("gear", torque, said) if tare.valid else ("motor + gear", torque, [*said, _WITH_MOTOR])


def _metrics(fit: StribeckFit, speed: Array, torque: Array, residual: Array) -> dict[str, float]:
    """How well the curve goes through the points."""
    return {
        "chi_square": fit.chi_square,
        "freedom": float(fit.freedom),
        "birge": math.sqrt(fit.chi_square / max(fit.freedom, 1)),
        "residual_rms": float(np.sqrt(np.mean(residual**2))),
        "relative_rms": float(np.sqrt(np.mean((residual / torque) ** 2))),
        "points": float(len(torque)),
        "slowest_speed": float(speed.min()),
    }


def tare_scatter(tare: Tare, speed: Array) -> CommonError:
    """The errors of a tare's points, which all holds at the same speeds [rad/s] share."""
    return CommonError(
        source=TARE_SCATTER,
        effect=tare.columns(speed),
        kind="A",
        # What scatter leaves of a straight line over speed.
        degrees_of_freedom=max(len(tare.speed) - 2.0, 1.0),
    )


def nominal_bearing_torque(gear: HarmonicDrive, speed: Array, balance: TorqueBalance) -> Array:
    """l_b M_0 of the parameter set at input speeds [rad/s], in a torque balance [N m]."""
    magnitude = bearing_magnitude(
        gear.bearing, speed, low_speed_branch=gear.options.low_speed_branch
    )
    return bearing_lever(gear, balance) * magnitude


def _estimates(found: FrictionFit, ends: Array | None) -> dict[str, Estimate]:
    """The five parameters with intervals (`ends` (5, 2) of the profile, linearised without) and budgets."""
    fit, estimates = found.stribeck, dict[str, Estimate]()
    quantile, nothing = student_quantile(fit.freedom), np.zeros(len(fit.common))
    for k, name in enumerate(NAMES):
        value = float(fit.values[k])
        lines = found.budget_lines(np.eye(5)[k], nothing, {})
        inside = sum(b.standard_uncertainty**2 for b, c in lines if c is None or c.is_fitted)
        half = quantile * math.sqrt(inside)
        low, high = (value - half, value + half) if ends is None else map(float, ends[k])
        closed = math.isfinite(low) and math.isfinite(high)
        scatter = lines[0][0].standard_uncertainty if closed else math.inf
        if closed:
            # A profile that is wider than the linearised interval is wider by what scatter does. Zero cuts it short.
            wide = 0.5 * (high - low) if low > 0.0 else max(high - value, half)
            whole = (wide / quantile) ** 2
            scatter = math.sqrt(max(whole - inside + scatter**2, scatter**2))
        first = replace(lines[0][0], standard_uncertainty=scatter)
        verdict, note = _verdict_on(name, found, low, high)
        low, high = open_ends(low, high)
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit=UNITS[name],
            low=low,
            high=high,
            identifiable=verdict,
            note=note,
            budget=(first, *(b for b, _ in lines[1:])),
        )
    return estimates


def _verdict_on(name: str, found: FrictionFit, low: float, high: float) -> tuple[Identifiable, str]:
    """Whether the data tell a parameter, and why not: both ends of its interval lie inside what was searched.

    Whether it is told closely enough is for the target of its quantity to say, not for a rule of thumb here.
    """
    fit = found.stribeck
    coulomb, static = (float(v) for v in fit.values[:2])
    if name in ("stribeck_velocity", "shape") and fit.chance > CHANCE:
        return "no", f"{_NO_DIP}: the points do not bend"
    if not (math.isfinite(low) and math.isfinite(high)):
        return "no", "the profile of the likelihood does not close: the data do not bound it"
    if name in ("stribeck_velocity", "shape") and name in fit.at_bound:
        return "weakly", "stopped at its bound"
    if name == "stribeck_velocity" and "shape" in fit.at_bound:
        return "weakly", "beside a shape that stopped at its bound"
    return (
        "yes",
        f"{_NO_DIP}: below Coulomb friction" if name == "static" and static < coulomb else "",
    )


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
    freedom = len(speed) - 2
    chi = float(np.sum((offset / u - design @ values) ** 2)) / freedom
    errors = np.sqrt(np.diag(covariance) * max(chi, 1.0))
    return {
        name: Estimate.about(
            name,
            float(value),
            student_quantile(freedom) * float(error),
            unit,
            (BudgetLine(HALF_SUMS, "A", float(error), degrees_of_freedom=freedom),),
        )
        for name, unit, value, error in zip(
            ("offset", "asymmetry"), ("N m", "N m s/rad"), values, errors, strict=True
        )
    }


def _judge(
    fit: StribeckFit,
    estimates: dict[str, Estimate],
    points: FrictionPoints,
    holds: Sequence[RunningTorque],
) -> list[str]:
    """What a reader must know before using the numbers."""
    remarks: list[str] = []
    slowest, velocity = float(points.speed.min()), float(fit.values[2])
    if slowest > velocity / 10.0 * 1.05:
        remarks.append(
            f"The slowest speed ({slowest / RPM:.3g} r/min) is above a tenth of the Stribeck velocity "
            f"({velocity / RPM:.3g} r/min): the Stribeck part rests on little of its bend. Measure down to "
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
        named = ", ".join(f"{s:g}" for s in stuck)
        remarks.append(
            f"The input stopped and went at {named} r/min: the mean torque there is not that of one speed."
        )
    remarks += _dip(fit)
    return remarks


def _dip(fit: StribeckFit) -> list[str]:
    """What is to be said where friction does not fall from rest."""
    coulomb, static = float(fit.values[0]), float(fit.values[1])
    if fit.chance > CHANCE:
        return [
            f"{_NO_DIP}: friction at low speed is not distinguishable from a straight line over speed "
            f"(chance {fit.chance:.2g}); Stribeck velocity and shape are not told."
        ]
    if static <= coulomb:
        return [
            f"{_NO_DIP}: static friction ({static:.4g} N) is below Coulomb friction ({coulomb:.4g} N), "
            "friction rises from rest."
        ]
    return []


def check_identifiable(
    fit: FrictionFit, *, limit: float = 0.03, chi_square_limit: float = LARGEST_REDUCED_CHI_SQUARE
) -> None:
    """Refuse a sweep whose reference speed drifted by more than `limit`, and points that do not lie on the curve.

    Raises `IdentificationError`.
    """
    drift = fit.metrics["bracket_drift"]
    if math.isfinite(drift) and drift > limit:
        raise IdentificationError(
            "the reference speed drifted during the sweep",
            where="bracket",
            value=f"{100 * drift:.1f} %",
            limit=f"<= {100 * limit:g} %",
            remedy="Warm up until the running torque is steady, then repeat.",
        )
    check_curve(fit.stribeck, chi_square_limit)


def check_curve(fit: StribeckFit, limit: float = LARGEST_REDUCED_CHI_SQUARE) -> None:
    """Refuse a Stribeck curve that misses its points by more than their errors explain: raise `IdentificationError`."""
    reduced = fit.chi_square / max(fit.freedom, 1)
    if reduced > limit:
        raise IdentificationError(
            "the points do not lie on the curve of equation 19",
            where="holds",
            value=f"chi-square {reduced:.3g} per degree of freedom",
            limit=f"<= {limit:g}",
            remedy="Look at the residuals over speed: stick-slip, a resonance, heat, or another law of friction.",
        )
