"""Friction over speed from an angle and a motor current alone: the Stribeck curve in the channel's own unit."""

from __future__ import annotations

import math

import numpy as np

from experiments.errors import analysing
from experiments.protocols.friction.plots import point_table
from experiments.protocols.friction.points import MeasuredFriction
from experiments.protocols.friction.quantities import CURVE, QUANTITIES
from experiments.recording import Recording
from experiments.result import Covariance, Result
from experiments.shape import Standing
from model.arrays import FloatArray
from model.identify.common_errors import UNREPEATED, means_by, spread_beyond
from model.identify.estimate import BudgetLine, Estimate, open_ends
from model.identify.friction import check_curve
from model.identify.least_squares import student_quantile
from model.identify.repeated import FEWEST
from model.identify.running_torque import FrictionPoints, pair_directions
from model.identify.stribeck import NAMES, StribeckFit, fit_stribeck, profile_intervals

KIND = "friction"
SCATTER = "scatter of the points"
_OPEN = "the profile of the likelihood does not close: the data do not bound it"


def friction_in_foreign_unit(
    recording: Recording, measured: MeasuredFriction, chi_square_limit: float
) -> Result:
    """Friction over speed in the channel's own unit (a motor current): the Stribeck curve without
    levers and bearing.
    """
    unit = measured.unit
    with analysing(recording.metadata.run_id):
        points = pair_directions([h.torque for h in measured.holds])
        size = np.maximum(np.abs(points.friction), 1e-12)
        point = _scatter(points, size)
        error = np.hypot(points.standard_error, point * size)
        fit = fit_stribeck(points.speed, points.friction, error)
        check_curve(fit, chi_square_limit)
        intervals = profile_intervals(fit, points.speed, points.friction, error)
    standing = Standing(CURVE, len(points.speed), len(np.unique(points.level)), point)
    text = f'The channel "{measured.channel}" is in {unit}, not N m: friction is that of the whole axis, in {unit}.'
    return Result(
        run=recording.metadata.run_id,
        kind=KIND,
        quantities=QUANTITIES,
        estimates=standing.weakly(_estimates(fit, intervals, unit)),
        metrics={
            "points": float(len(points.speed)),
            "chi_square": fit.chi_square,
            "freedom": float(fit.freedom),
        },
        warnings=(*measured.warnings, *points.warnings, *standing.warnings, text),
        tables=(point_table(measured.holds, measured.bracket, None, unit),),
        options={
            "torque_is_of": "motor + gear",
            "channel": measured.channel,
            "torque_balance": "none",
        },
        covariance=Covariance(NAMES, fit.covariance, at_bound=fit.at_bound),
    )


def _scatter(points: FrictionPoints, size: FloatArray) -> float:
    """Relative standard deviation of a point that is measured again, by the visits to one speed; `size` (n,) is the
    magnitude of the friction.
    """
    free, nothing = means_by(points.level), np.empty((len(size), 0))
    if len(size) - free.shape[1] < FEWEST:
        return UNREPEATED.point
    mean = np.array([size[points.level == level].mean() for level in points.level])
    relative = points.standard_error / size
    point, _ = spread_beyond(free, size / mean - 1.0, relative, nothing, nothing)
    return point


def _estimates(fit: StribeckFit, intervals: FloatArray, unit: str) -> dict[str, Estimate]:
    """The parameters with their profile intervals (5, 2); one that the data do not bound is open on that side."""
    units = {
        "coulomb": unit,
        "static": unit,
        "stribeck_velocity": "rad/s",
        "shape": "1",
        "viscous": f"{unit} s/rad",
    }
    estimates: dict[str, Estimate] = {}
    for k, name in enumerate(NAMES):
        low, high = (float(x) for x in intervals[k])
        u, verdict, note = math.inf, "no", _OPEN
        if math.isfinite(low) and math.isfinite(high):
            u, verdict, note = (high - low) / (2.0 * student_quantile(fit.freedom)), "yes", ""
        low, high = open_ends(low, high)
        estimates[name] = Estimate(
            name=name,
            value=float(fit.values[k]),
            unit=units[name],
            low=low,
            high=high,
            identifiable=verdict,
            note=note,
            budget=(BudgetLine(SCATTER, "A", u, degrees_of_freedom=fit.freedom),),
        )
    return estimates
