"""Motor tare: friction and cogging of the bare motor, so that the friction fit can speak of the gear alone.

The torque port shows motor + gear. With the gear removed the same speeds and directions are run in the same warm state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from experiments.budget import budget_table, scale_line
from experiments.contract import Evidence
from experiments.errors import analysing
from experiments.evidence import (
    check_settings,
    quality_remarks,
    require_bare_motor,
    time_base_remark,
)
from experiments.protocols.friction.quantities import at_reference
from experiments.protocols.motor_tare.declaration import LINE, NAME, NAMES, QUANTITIES
from experiments.recording import Recording
from experiments.result import Covariance, Plot, Result, Series, both_ways, residual_panel
from experiments.shape import Standing
from experiments.tares.motor_heat import FRICTION, MotorHeat, motor_heat
from experiments.tares.tare import tare_table
from experiments.tares.tare_chart import tare_chart
from experiments.tares.tare_witness import remarks_of
from experiments.torque.pattern import PatternPair, TorquePattern, direction_patterns
from experiments.torque.ripple import PORT_LAG, LateTorque, port_lag, waves_of
from experiments.torque.running_torque import Hold, measured_holds
from experiments.torque.zero import TorqueZero, torque_zero
from model.arrays import FloatArray
from model.identify.common_errors import whitening_of
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Estimate
from model.identify.friction import HALF_SUMS
from model.identify.least_squares import student_quantile
from model.identify.running_torque import (
    FrictionPoints,
    RunningTorque,
    pair_directions,
    pooled_errors,
    tare_from,
)
from model.units import REVOLUTION, RPM

_HEAT_CAPACITY = 350.0
"""J/K of a servo motor of this size (some 0.9 kg of steel and copper), assumed within a factor of two."""

_UNSEEN_LOSSES = 2.0
"""Losses of the whole run over those of the holds: ramps and settling turn as far again."""

_COGGING_BELOW = 100.0 * RPM
"""Input speed up to which the torque over angle shows cogging and not the inertia of a rippling speed."""
_LOWEST_ORDERS, _MOST_ORDERS, _STANDS_OUT = range(1, 7), 8, 4.0
"""Orders of the input that are always looked at; how many of the cogging are, and how far each stands out of its
standard error."""
_SHOWN = 0.5 * math.pi
"""Radians that an order turns between two samples, up to which it is looked at."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Friction of the bare motor per speed and direction, its Coulomb and viscous part, cogging over the angle."""
    check_settings(evidence.settings, (), NAME)
    recording.require("motor tare", "input_angle", "torque")
    require_bare_motor(recording, NAME, "it holds the gear's friction and is no tare")
    warnings = quality_remarks(recording, "motor tare", evidence)
    warnings += time_base_remark(recording)
    zero = torque_zero(recording)
    warnings += zero.warnings
    segments = recording.labelled("hold")
    holds, remarks = measured_holds(recording, segments, zero)
    housing = float(np.mean([h.torque.temperature for h in holds])) if holds else math.nan
    heat = motor_heat(recording, housing)
    with analysing(recording.metadata.run_id):
        averages = [h.torque for h in holds]
        points = pair_directions(averages)
        tare = tare_from(averages)
    warnings += points.warnings
    slow = [s for s in segments if abs(s.setpoint) <= _COGGING_BELOW]
    patterns = direction_patterns(recording, slow, zero)
    late = _late(recording, holds, _rippling_orders(patterns))
    estimates, covariance = _straight_line(recording, averages, points, late, heat)
    estimates |= _offset(points, zero)
    plots = [_plot(holds, estimates)]
    metrics = {"speeds": float(len(tare.speed)), "torque_zero_drift": zero.drift}
    if math.isfinite(housing):
        metrics["housing_temperature"] = housing
    if patterns is not None:
        metrics |= _cogging_metrics(patterns.cogging)
        plots.append(_cogging_plot(patterns.cogging))
    standing = Standing(LINE, len(points.speed), len(np.unique(points.level)))
    estimates = standing.weakly(estimates)
    result = Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=estimates,
        metrics=metrics,
        warnings=(*warnings, *remarks, *standing.warnings),
        plots=tuple(plots),
        tables=(tare_table(tare), budget_table(estimates.values())),
        options={"torque_is_of": "motor"},
        covariance=covariance,
    )
    return _witnessed(recording, result, evidence.other_tares)


def _witnessed(recording: Recording, tare: Result, others: Sequence[Result]) -> Result:
    """The tare with what the motor's card and other tares say of it."""
    said = remarks_of(recording, tare, others)
    chart = tare_chart(tare, others)
    return replace(
        tare,
        warnings=(*tare.warnings, *said),
        plots=(*tare.plots, *filter(None, (chart,))),
    )


def _straight_line(
    recording: Recording,
    averages: Sequence[RunningTorque],
    points: FrictionPoints,
    late: Sequence[LateTorque],
    heat: MotorHeat,
) -> tuple[dict[str, Estimate], Covariance | None]:
    """Coulomb and viscous friction of the bare motor from the half-differences: T = T_c + c omega.

    Weighed by the errors of the points, widened where they miss the line. An error estimated from the residuals alone
    would be too small: the fastest points carry the slope, and a line passes by a point that carries it. The motor
    warms by its own losses while it is run from slow to fast, and what the port's lag makes of its cogging is taken
    off: two errors that all points share.
    """
    speed = points.speed
    torque = points.friction + points.mean_of(np.array([one.lag + one.between for one in late]))
    warming = abs(FRICTION) * points.mean_of(_warming(averages)) * torque
    lagging = points.mean_of(np.array([one.lag_uncertainty for one in late]))
    whitening = whitening_of(pooled_errors(points), np.column_stack([warming, lagging]))
    design = np.column_stack([np.ones_like(speed), speed])
    white = whitening @ design
    values = np.linalg.lstsq(white, whitening @ torque, rcond=None)[0]
    freedom = len(speed) - 2
    estimates: dict[str, Estimate] = {}
    covariance = None
    error = np.full(2, math.inf)
    if freedom >= 2:
        left = whitening @ (torque - design @ values)
        scale = max(float(left @ left) / freedom, 1.0)
        covariance = Covariance(
            NAMES, np.asarray(scale * np.linalg.inv(white.T @ white), dtype=float)
        )
        error = np.sqrt(np.diag(covariance.matrix))
    warm, cold = heat.friction_factor()
    said = port_lag(recording, "torque")[2]
    for k, (name, unit) in enumerate(zip(NAMES, ("N m", "N m s/rad"), strict=True)):
        value = float(values[k])
        lines = [
            BudgetLine(
                "scatter about the line",
                "A",
                float(error[k]),
                f"with the motor's warming and the {PORT_LAG}, {said}",
                degrees_of_freedom=float(freedom),
            )
        ]
        outside = (heat.line(value), scale_line(recording, value))
        estimates[name] = _tare_estimate(name, value, unit, lines, outside, freedom)
        if math.isfinite(heat.temperature):
            found = at_reference(name)
            moved, others = (
                [replace(b, standard_uncertainty=warm * b.standard_uncertainty) for b in part]
                for part in (lines, outside)
            )
            # As of friction: what brings a number to 20 degC is in its interval too.
            moved.append(BudgetLine("temperature of the motor", "B", cold * abs(warm * value)))
            estimates[found] = _tare_estimate(found, warm * value, unit, moved, others, freedom)
    return estimates, covariance


def _rippling_orders(patterns: PatternPair | None) -> FloatArray:
    """Orders of the input at which torque and speed may ripple together: the lowest, and those of the cogging."""
    orders = set(_LOWEST_ORDERS)
    if patterns is not None:
        size = np.abs(patterns.cogging.amplitude)
        seen = size > _STANDS_OUT * patterns.cogging.standard_error
        orders |= {int(k) + 1 for k in np.argsort(-size)[:_MOST_ORDERS] if seen[k]}
    return np.array(sorted(orders), dtype=np.float64)


def _late(recording: Recording, holds: Sequence[Hold], orders: FloatArray) -> list[LateTorque]:
    """What the port's lag does to the torque of each hold. The table of the tare keeps it: a gear's torque, of which
    that is taken off, has it too.
    """
    lag, u, _ = port_lag(recording, "torque")
    period = 1.0 / recording.metadata.sample_rate
    found: list[LateTorque] = []
    for hold in holds:
        speed = abs(hold.torque.speed)
        shown = orders[orders * speed * period < _SHOWN]
        waves = waves_of(recording, hold, ("input_angle", "torque"), shown) if len(shown) else None
        found.append(waves.late(shown, speed, (lag, u), period) if waves else LateTorque())
    return found


def _offset(points: FrictionPoints, zero: TorqueZero) -> dict[str, Estimate]:
    """The half-sum of the directions: whatever is not known of the zero is in it in full."""
    offset = points.offset[points.paired]
    if len(offset) < 2:
        return {}
    spread = float(offset.std(ddof=1)) / math.sqrt(len(offset))
    mean, half = float(offset.mean()), student_quantile(len(offset) - 1) * spread
    scatter = BudgetLine(HALF_SUMS, "A", spread, degrees_of_freedom=len(offset) - 1.0)
    estimate = Estimate(
        name="offset",
        value=mean,
        unit="N m",
        low=mean - half,
        high=mean + half,
        note="half-sum of the directions: rest of the zero and asymmetry",
        budget=(scatter, zero.budget()),
    )
    return {"offset": estimate}


def _warming(averages: Sequence[RunningTorque]) -> FloatArray:
    """How far the motor had warmed by its own losses at each hold [K]."""
    order = np.argsort([t.time for t in averages])
    losses = np.array([abs(t.torque) * REVOLUTION * t.revolutions for t in averages])[order]
    warmer = np.empty(len(averages))
    warmer[order] = np.cumsum(losses) * _UNSEEN_LOSSES / _HEAT_CAPACITY
    return warmer


def _tare_estimate(
    name: str,
    value: float,
    unit: str,
    inside: Sequence[BudgetLine],
    outside: Sequence[BudgetLine],
    freedom: int,
) -> Estimate:
    """A number of the line, its statistical interval from the lines `inside`."""
    half = math.hypot(
        *(
            (student_quantile(freedom) if b.kind == "A" else NORMAL_COVERAGE_FACTOR)
            * b.standard_uncertainty
            for b in inside
        )
    )
    return Estimate(
        name=name,
        value=value,
        unit=unit,
        low=value - half,
        high=value + half,
        identifiable="yes" if math.isfinite(half) else "no",
        budget=(*inside, *outside),
    )


def _cogging_metrics(cogging: TorquePattern) -> dict[str, float]:
    """How large the cogging is over one turn [N m], and its strongest order."""
    curve = cogging.curve(np.linspace(0.0, 2.0 * math.pi, 2048))
    return {
        "cogging_peak_to_peak": float(np.ptp(curve)),
        "strongest_cogging_order": _strongest(cogging),
    }


def _strongest(cogging: TorquePattern) -> float:
    """The strongest order of the cogging."""
    return float(np.argmax(np.abs(cogging.amplitude)) + 1)


def _cogging_plot(cogging: TorquePattern) -> Plot:
    """Cogging by its orders."""
    bars = Series(
        label="half-sum of the directions",
        x=cogging.orders,
        y=np.abs(cogging.amplitude) * 1e3,
        style="bars",
    )
    return Plot(
        name="cogging",
        title="Cogging of the bare motor, seen through the servo's closed loop",
        x_label="order per input revolution",
        y_label="amplitude [mN m]",
        series=(bars,),
        note="What does not turn round with the direction, by order of a turn: slots and poles of the motor. "
        f"It averages out over whole turns; the strongest is order {_strongest(cogging):.0f}.",
    )


def _plot(holds: list[Hold], estimates: dict[str, Estimate]) -> Plot:
    points = [h.torque for h in holds]
    direction, every, torque, error = np.array(
        [(p.direction, abs(p.speed), p.torque, p.standard_error) for p in points]
    ).T
    y, spread = direction * torque * 1e3, 1.96e3 * error
    series = both_ways(direction, every / RPM, y, low=y - spread, high=y + spread)
    speed = np.geomspace(float(every.min()), float(every.max()), 200)
    line = estimates["motor_coulomb"].value + estimates["motor_viscous"].value * speed
    series.append(Series(label="Coulomb + viscous", x=speed / RPM, y=line * 1e3, group=2))
    straight = estimates["motor_coulomb"].value + estimates["motor_viscous"].value * every
    left = y - straight * 1e3
    residuals = both_ways(direction, every / RPM, left, low=left - spread, high=left + spread)
    series += [replace(one, label="", panel=1) for one in residuals]
    return Plot(
        name="motor-friction",
        title="Friction of the bare motor",
        x_label="input speed [r/min]",
        y_label="torque [mN m]",
        series=tuple(series),
        x_scale="log",
        note="What the motor takes without a gear: this is taken off the torque of every run with one. Good where what "
        "the line leaves below is small beside the gear's own friction.",
        panels=(residual_panel("mN m"),),
    )
