"""What a fit of a motion says: estimates with intervals, metrics, curves and warnings of a fitted rung."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from model.identify.checks import Array
from model.identify.estimate import Estimate
from model.identify.least_squares import student_quantile
from model.identify.motion_columns import Basis, MotionFilter
from model.identify.motion_ladder import Fitted, Rung
from model.identify.motion_look import SpeedChannel
from model.identify.motion_moments import MomentFit

LARGEST_ERROR = 0.5
"""|residual|/|effort| above which the model does not describe the effort: nothing of it is identified."""


@dataclass(frozen=True, kw_only=True)
class MotionFit:
    """Inertia and friction of a motion, with what is needed to judge and to plot them.

    estimates by name; covariance (p, p) in their order; time, velocity, acceleration, measured,
    predicted, friction with offset: (n,), some of the decimated samples. `filter_uncertainty`, `rung_uncertainty`,
    `lag_uncertainty`, `shared_uncertainty`: standard uncertainties (type B) by parameter. `cutoffs`: the parameters at
    half, at once and at twice the cut-off [Hz]; `rungs` those of every model.
    """

    variant: str
    recipe: MotionFilter
    basis: Basis
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    time: Array
    velocity: Array
    acceleration: Array
    measured: Array
    predicted: Array
    friction: Array
    covariance: Array
    freedom: float
    coefficients: Array
    regressors: tuple[str, ...]
    rungs: tuple[Rung, ...] = ()
    instrument: str = ""
    filter_uncertainty: Mapping[str, float] = field(default_factory=dict[str, float])
    rung_uncertainty: Mapping[str, float] = field(default_factory=dict[str, float])
    lag_uncertainty: Mapping[str, float] = field(default_factory=dict[str, float])
    shared_uncertainty: Mapping[str, float] = field(default_factory=dict[str, float])
    cutoffs: Mapping[float, Mapping[str, float]] = field(
        default_factory=dict[float, Mapping[str, float]]
    )
    speed_channel: SpeedChannel | None = None

    @property
    def values(self) -> Array:
        """The parameters in the order of the estimates."""
        return np.array([e.value for e in self.estimates.values()])


def reported(chosen: Fitted, rotary: bool, rungs: tuple[Rung, ...] = ()) -> MotionFit:
    """A fitted rung as estimates with intervals, metrics and curves."""
    fit, moments = chosen.fit, chosen.moments
    shown = dict(zip(moments.names, moments.shown.T, strict=True))
    estimates = _estimates(chosen, rotary)
    parts = np.stack([shown[name] for name in fit.names], axis=1) * fit.values
    rests = [k for k, n in enumerate(fit.names) if n != "acceleration" and "load" not in n]
    return MotionFit(
        variant=chosen.rung,
        recipe=chosen.recipe,
        basis=chosen.basis,
        estimates=estimates,
        metrics={
            "relative_error_percent": 100.0 * fit.relative_error,
            "hold_out_error_percent": 100.0 * fit.hold_out_error,
            "condition": fit.condition_raw,
            "condition_scaled": fit.condition,
            "residual_norm": fit.residual_norm,
            "samples": float(fit.samples),
            "standstill_share": moments.standing_share,
            "least_speed": chosen.recipe.least_speed,
            "cutoff": chosen.recipe.cutoff_hz,
        },
        warnings=_warnings(fit, estimates),
        time=moments.shown_time,
        velocity=shown["speed"],
        acceleration=shown["acceleration"],
        measured=shown["effort"],
        predicted=parts.sum(axis=1),
        friction=parts[:, rests].sum(axis=1),
        covariance=chosen.covariance,
        freedom=fit.freedom,
        coefficients=fit.values,
        regressors=fit.names,
        rungs=rungs,
    )


def _units(names: tuple[str, ...], rotary: bool) -> dict[str, str]:
    force, length, inertia = ("N m", "rad", "kg m2") if rotary else ("N", "m", "kg")
    table = {
        "inertia": inertia,
        "viscous": f"{force} s/{length}",
        "stribeck": f"{length}/s",
    }
    return {name: table.get(name.split("_")[0], force) for name in names}


def _estimates(chosen: Fitted, rotary: bool) -> dict[str, Estimate]:
    """The parameters with 95 % intervals; none is identified where the model does not describe the effort."""
    names, _ = chosen.transform
    half = student_quantile(chosen.fit.freedom) * np.sqrt(
        np.maximum(np.diag(chosen.covariance), 0.0)
    )
    error = chosen.fit.relative_error
    values = dict(zip(names, chosen.values.tolist(), strict=True))
    wrong = [n for n, v in values.items() if _is_size(n) and v < 0.0]
    estimates: dict[str, Estimate] = {}
    for place, (name, unit) in enumerate(_units(names, rotary).items()):
        verdict, note = "yes", ""
        if not error <= LARGEST_ERROR:
            verdict, note = (
                "no",
                f"the model leaves {100.0 * error:.0f} % of the effort unexplained",
            )
        elif name in wrong:
            verdict, note = "no", "negative, which is not physical"
        elif wrong:
            verdict, note = "weakly", f"{' and '.join(wrong)} came out negative in the same fit"
        width = float(half[place])
        estimates[name] = Estimate.about(
            name, values[name], width, unit, identifiable=verdict, note=note
        )
    return estimates


def _is_size(name: str) -> bool:
    """Whether a parameter cannot be negative."""
    return name.split("_")[0] in ("inertia", "viscous", "coulomb", "static")


def _warnings(fit: MomentFit, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    """What a reader must know of the fit."""
    sizes = [estimate for name, estimate in estimates.items() if _is_size(name)]
    negative = [estimate for estimate in sizes if estimate.value < 0.0]
    # A force of the wrong sign turns all of them round; of one alone something else is the cause.
    cause = "what moves this axis beside inertia and friction is in it (a load over position, another axis, a lag)"
    if len(negative) == len(sizes):
        cause = "check the sign of the force"
    warnings = [
        f"{one.name} is {one.value:.4g} {one.unit}, which is not physical: {cause}."
        for one in negative
    ]
    if not fit.relative_error <= LARGEST_ERROR:
        warnings.append(
            f"The model leaves {100.0 * fit.relative_error:.0f} % of the effort unexplained: something else "
            "than inertia and friction moves this axis (a load over position, a coupled axis, a wrong channel)."
        )
    if fit.condition_raw > 100.0 and fit.condition > 100.0:
        warnings.append(
            f"The regressors are nearly dependent (condition number {fit.condition:.3g}): excite more richly."
        )
    return tuple(warnings)
