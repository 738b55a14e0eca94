"""Figures and tables of a motion: effort and what is left of it, friction over speed, rungs, cut-offs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.recordings.motion_channels import RecordedMotion
from experiments.result import Plot, Series, Table, residual_panel
from model.arrays import FloatArray
from model.identify.estimate import Estimate
from model.identify.motion_result import MotionFit

CURVE_POINTS = 400


def motion_plots(fit: MotionFit, motion: RecordedMotion) -> tuple[Plot, ...]:
    """Effort over time with its residual, and friction over speed with the fitted curve."""
    return _force_plot(fit, motion), _friction_plot(fit, motion)


def motion_tables(fit: MotionFit, estimates: Mapping[str, Estimate]) -> tuple[Table, ...]:
    """Every rung of the ladder side by side, and the parameters at half, at once and at twice the cut-off."""
    return _rungs(fit), _cutoffs(fit, estimates)


def _force_plot(fit: MotionFit, motion: RecordedMotion) -> Plot:
    left = fit.measured - fit.predicted
    return Plot(
        name="motion-effort",
        title=f"{motion.effort}, measured and predicted",
        x_label="time [s]",
        y_label=f"{motion.effort} [{motion.effort_unit}]",
        series=(
            Series(label="measured", x=fit.time, y=fit.measured, style="line", group=0),
            Series(label="inverse dynamics", x=fit.time, y=fit.predicted, style="line", group=1),
            Series(label="residual", x=fit.time, y=left, style="line", group=2, panel=1),
        ),
        note="The effort as recorded, and what the fitted inertia, friction and load ask for. Good where what is "
        "left below does not follow the motion.",
        panels=(residual_panel(motion.effort_unit),),
    )


def _friction_plot(fit: MotionFit, motion: RecordedMotion) -> Plot:
    """What is left of the effort without inertia and load, over velocity, and the friction that was fitted to it."""
    order = np.argsort(fit.velocity)
    velocity = fit.velocity[order]
    friction = fit.measured - fit.predicted + fit.friction
    ends = float(velocity[0]), float(velocity[-1])
    curve = np.linspace(*ends, CURVE_POINTS)
    return Plot(
        name="motion-friction",
        title="Friction over velocity",
        x_label=f"velocity [{motion.position_unit}/s]",
        y_label=f"{motion.effort} [{motion.effort_unit}]",
        series=(
            Series(
                label="effort without inertia and load",
                x=velocity,
                y=friction[order],
                style="points",
            ),
            Series(label=fit.variant, x=curve, y=_friction(fit, curve), style="line", group=1),
        ),
        note="What is left of the effort without inertia and load, and the fitted friction. Good where the points "
        "lie about the line at every speed; "
        f"{100.0 * fit.metrics['standstill_share']:.2g} % at standstill are left out.",
    )


def _friction(fit: MotionFit, velocity: FloatArray) -> FloatArray:
    """The fitted friction with its offset at velocities (n,)."""
    value = {name: e.value for name, e in fit.estimates.items()}
    sign = np.sign(velocity)
    if fit.variant == "asymmetric":
        forward = value["viscous_forward"] * velocity + value["coulomb_forward"]
        reverse = value["viscous_reverse"] * velocity - value["coulomb_reverse"]
        return np.where(velocity > 0.0, forward, reverse)
    friction = value["viscous"] * velocity + value["coulomb"] * sign
    friction += value.get("offset", 0.0)
    if fit.variant == "stribeck":
        drop = value["static"] - value["coulomb"]
        friction = friction + drop * sign * np.exp(-((velocity / value["stribeck_velocity"]) ** 2))
    return friction


def _rungs(fit: MotionFit) -> Table:
    names = list(dict.fromkeys(name for rung in fit.rungs for name in rung.values))
    rows = tuple(
        (
            rung.name,
            "taken" if rung.name == fit.variant else "",
            100.0 * rung.relative_error,
            100.0 * rung.hold_out_error,
            rung.bic,
            *(rung.values.get(name, "") for name in names),
        )
        for rung in fit.rungs
    )
    columns = ("model", "", "relative error [%]", "hold-out error [%]", "BIC", *names)
    return Table(
        "rungs",
        "Models of the friction on these data",
        columns,
        rows,
        note="BIC counts samples as independent, which they are not: the hold-out error decides.",
    )


def _cutoffs(fit: MotionFit, estimates: Mapping[str, Estimate]) -> Table:
    names = [name for name in estimates if name in fit.estimates]
    rows = tuple(
        (cutoff, *(values[name] for name in names)) for cutoff, values in fit.cutoffs.items()
    )
    units = tuple(f"{name} [{estimates[name].unit}]" for name in names)
    return Table(
        "cutoffs", "The same with half and with twice the cut-off", ("cut-off [Hz]", *units), rows
    )
