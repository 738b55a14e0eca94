"""Warm-up: turn at one speed until the running torque is steady, so that what follows has one thermal state."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from experiments.budget import scale_line
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import check_settings, quality_remarks, usable
from experiments.protocols.friction.influences import (
    LOSS_RELATIVE,
    OWN_RELATIVE,
    PRODUCT_RELATIVE,
    VIBRATION,
)
from experiments.protocols.friction.vibration import ripple_of
from experiments.protocols.warm_up.declaration import NAME, QUANTITIES, Parameters
from experiments.recording import Recording, Segment
from experiments.result import Plot, Result, Series
from experiments.tares.motor_heat import MotorHeat, motor_heat
from experiments.torque.ripple import PORT_LAG, port_lag
from experiments.torque.running_torque import Hold, measured_holds
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.identify.least_squares import student_quantile
from model.identify.running_torque import FrictionPoints, pair_directions


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Running torque against time, whether it became steady, and the running torque of the warm rig at this speed."""
    check_settings(evidence.settings, (), NAME)
    recording.require("warm-up", "input_angle", "torque")
    warnings = quality_remarks(recording, "warm-up", evidence)
    zero = torque_zero(recording)
    warnings += zero.warnings
    segments = recording.labelled("warm-up")
    if not segments:
        raise AnalysisError("the run has no warm-up segment", where=recording.metadata.run_id)
    tolerance = float(recording.metadata.parameters.get("tolerance", Parameters.tolerance))
    time, torque = _over_time(recording, segments, zero)
    change = float(abs(torque[-1] - torque[-2]))
    steady = change <= tolerance
    if not steady:
        warnings.append(
            f"The torque was not steady: it changed by {change * 1e3:.2f} mN m between the last two windows "
            f"(limit {tolerance * 1e3:.2f} mN m). Warm up longer."
        )
    holds, remarks = measured_holds(recording, recording.labelled("hold"), zero)
    estimates, conditions = _when_warm(recording, evidence, holds)
    metrics = conditions | {
        "last_change": change,
        "total_change": float(torque[-1] - torque[0]),
        "time_until_steady": _steady_since(time, torque, tolerance),
        "steady": float(steady),
    }
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=(*warnings, *remarks),
        plots=(_plot(time, torque, change, tolerance),),
        options={"torque_is_of": "motor + gear"},
    )


def _when_warm(
    recording: Recording, evidence: Evidence, holds: list[Hold]
) -> tuple[dict[str, Estimate], dict[str, float]]:
    """The running torque at the end, where there is a hold each way, and the conditions under which it holds."""
    points = pair_directions([h.torque for h in holds]) if holds else None
    if points is None or not points.paired.any():
        return {}, {}
    pair = [holds[k] for k in points.members[int(np.argmax(points.paired))]]
    housing = float(np.mean([h.torque.temperature for h in pair]))
    conditions = {"speed": float(np.mean([abs(h.torque.speed) for h in pair]))}
    if math.isfinite(housing):
        conditions["housing_temperature"] = housing
    heat = motor_heat(recording, housing)
    conditions["torque_constant_factor"] = heat.constant_factor()[0]
    return {"running_torque": _running_torque(recording, evidence, points, pair, heat)}, conditions


def _plot(time: FloatArray, torque: FloatArray, change: float, tolerance: float) -> Plot:
    """The torque over the time of the run, and how far it still changed at the end [N m]."""
    series = Series(label="mean per window", x=time - time[0], y=torque * 1e3, style="points")
    return Plot(
        name="warm-up",
        title="Running torque while warming up",
        x_label="time [s]",
        y_label="torque of motor + gear [mN m]",
        series=(series,),
        note=f"The mean torque of each window of time. Good where the end is flat: between the last two windows it "
        f"changed by {change * 1e3:.2g} mN m, and {tolerance * 1e3:.2g} mN m is allowed.",
    )


def _running_torque(
    recording: Recording,
    evidence: Evidence,
    points: FrictionPoints,
    pair: list[Hold],
    heat: MotorHeat,
) -> Estimate:
    """Friction of the first pair of holds, without what the vibrating output takes and what the port's lag makes of
    ripples; both are known by the card only, and the data of one speed cannot tell them from friction. What the port
    reads too much because the magnets are warm is taken off."""
    at = int(np.argmax(points.paired))
    error, freedom = float(points.standard_error[at]), float(points.freedom[at])
    ripple = ripple_of(recording, pair, evidence.gear, "torque")
    loss = float(ripple.loss.mean())
    lag = float(np.mean(ripple.lag + ripple.between))
    hidden = float(ripple.unseen.mean())
    shaken = math.hypot(
        LOSS_RELATIVE * (loss - hidden),
        OWN_RELATIVE * (loss - hidden) + hidden + PRODUCT_RELATIVE * abs(lag),
    )
    factor, warmth = heat.constant_factor()
    error *= factor
    value = factor * float(points.friction[at]) - loss + lag
    lagging = abs(float(ripple.lag_uncertainty.mean()))
    by_speed = (
        BudgetLine(VIBRATION, "B", shaken, "damping and first mode of the card, orders that hide"),
        BudgetLine(PORT_LAG, "B", lagging, port_lag(recording, "torque")[2]),
    )
    half = math.hypot(
        student_quantile(freedom) * error,
        *(NORMAL_COVERAGE_FACTOR * line.standard_uncertainty for line in by_speed),
    )
    return Estimate(
        name="running_torque",
        value=value,
        unit="N m",
        low=value - half,
        high=value + half,
        identifiable="yes",
        note="motor + gear, half-difference of the directions",
        budget=(
            BudgetLine("whole revolutions", "A", error, degrees_of_freedom=freedom),
            *by_speed,
            scale_line(recording, value),
            replace(heat.line(value), standard_uncertainty=warmth * abs(value)),
        ),
    )


def _over_time(
    recording: Recording, segments: tuple[Segment, ...], zero: TorqueZero
) -> tuple[FloatArray, FloatArray]:
    """Middle [s] and mean torque [N m] of every window of the run."""
    window = float(recording.metadata.parameters.get("window", Parameters.window))
    windows = [_windows(recording, segment, zero, window) for segment in segments]
    time, torque = (np.concatenate(parts) for parts in zip(*windows, strict=True))
    if len(time) < 2:
        raise AnalysisError(
            "the warm-up is shorter than two windows",
            where=recording.metadata.run_id,
            value=len(time),
            limit=">= 2",
            remedy="Run longer or with a shorter window.",
        )
    return time, torque


def _windows(
    recording: Recording, segment: Segment, zero: TorqueZero, window: float
) -> tuple[FloatArray, FloatArray]:
    """Middle [s] and mean torque [N m] of consecutive windows, in constant memory."""
    start = float(recording.time(slice(segment.start, segment.start + 1))[0])
    sums: dict[int, FloatArray] = {}
    for rows in recording.blocks(segment):
        good = usable(recording, rows)
        time = recording.time(rows)[good]
        torque = recording.si("torque", rows)[good] - zero.at(time)
        which = np.floor((time - start) / window).astype(np.int64)
        for k in np.unique(which):
            part = which == k
            here = np.array([part.sum(), time[part].sum(), torque[part].sum()])
            sums[int(k)] = sums.get(int(k), np.zeros(3)) + here
    most = max((s[0] for s in sums.values()), default=0.0)
    whole = [s for _, s in sorted(sums.items()) if s[0] > 0.9 * most]
    return np.array([s[1] / s[0] for s in whole]), np.array([s[2] / s[0] for s in whole])


def _steady_since(time: FloatArray, torque: FloatArray, tolerance: float) -> float:
    """Time [s] after which no window differs from the last one by more than the tolerance; NaN where it never was."""
    away = np.flatnonzero(np.abs(torque - torque[-1]) > tolerance)
    first = int(away.max(initial=-1)) + 1
    return float(time[first] - time[0]) if first < len(time) - 1 else math.nan
