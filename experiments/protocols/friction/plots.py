"""Figures 9 and 17 and the table of points, as data: running torque over speed, measured and
fitted, both directions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from experiments.result import Plot, Series, Table, both_ways, residual_panel, way_of
from experiments.torque.running_torque import Hold
from model.arrays import FloatArray
from model.friction import friction_torque
from model.gear import HarmonicDrive
from model.identify.friction_result import FrictionFit
from model.identify.running_torque import FrictionPoints, RunningTorque, Tare, pair_directions
from model.units import RPM

_ENLARGED_BELOW_RPM = 100.0
MILLI = 1e-3
MEASURED = "measured, half-difference"
_SEEN = 0.05
"""mN m by which points must have been moved to be shown as they were measured too."""


def friction_plots(
    fit: FrictionFit,
    holds: list[Hold],
    bracket: list[Hold],
    tare: Tare | None,
    raw: list[Hold],
) -> tuple[Plot, ...]:
    """Every figure of a friction run; `raw` are the holds before anything was taken off them."""
    plots = [
        replace(
            _figure_9(
                fit, "friction-curve", "No-load running torque over speed", fit.speed.max() / RPM
            ),
            enlarged=(0.0, _knee(fit)),
        ),
        _figure_9(fit, "friction-curve-low", "Enlargement of the low speeds", _ENLARGED_BELOW_RPM),
    ]
    plots = [_beside_raw(plot, fit, raw, tare) for plot in plots]
    plots += [
        _figure_17(fit, holds, tare),
        _residuals(fit),
    ]
    if bracket:
        plots.append(_bracket(bracket))
    return tuple(plots)


def _beside_raw(plot: Plot, fit: FrictionFit, raw: list[Hold], tare: Tare | None) -> Plot:
    """Figure 9 with the points as they were measured, and how far they were moved; without, where none was."""
    points = pair_directions([hold.torque for hold in raw])
    own = np.zeros(len(points.speed)) if tare is None else tare.at(points.speed)[0]
    torque = points.friction - own
    # The same points in the same order: between visits to one speed nothing may be interpolated.
    moved = float(np.abs(torque - fit.torque).max()) / MILLI
    there = plot.of_panel(0)[0].x
    if not moved > _SEEN or not len(there):
        return plot
    highest = float(there.max())
    shown = points.speed / RPM <= highest * 1.001
    as_measured = Series(
        label="as measured",
        x=points.speed[shown] / RPM,
        y=torque[shown] / MILLI,
        style="points",
        role="null",
    )
    note = (
        f"{plot.note} Warmth, place on the output, vibration and output bearing, taken off or brought to "
        f"their mean, moved points by up to {moved:.2g} mN m from as measured."
    )
    series = [
        replace(one, label="corrected") if one.label == MEASURED else one for one in plot.series
    ]
    return replace(plot, series=(as_measured, *series), note=note)


def _knee(fit: FrictionFit) -> float:
    """Speed [r/min] below which figure 9 is shown once more: the Stribeck velocity where the data
    tell one, further where fewer than three points lie below it.
    """
    velocity = fit.estimates["stribeck_velocity"]
    known = velocity.identifiable != "no" and np.isfinite(velocity.value)
    speeds = np.sort(fit.speed) / RPM
    third = float(speeds[min(2, len(speeds) - 1)])
    return max(velocity.value / RPM if known else _ENLARGED_BELOW_RPM, third)


def _label(fit: FrictionFit) -> str:
    return f"friction torque of {'the gear' if fit.subject == 'gear' else 'motor + gear'} [mN m]"


def _figure_9(fit: FrictionFit, name: str, title: str, highest_rpm: float) -> Plot:
    """Half-differences of the directions and the fitted curve, up to a speed."""
    shown = fit.speed / RPM <= highest_rpm * 1.001
    line = fit.curve_speed / RPM <= highest_rpm * 1.001
    x, y, u = fit.speed[shown] / RPM, fit.torque[shown] / MILLI, _bars(fit.standard_error[shown])
    fitted = fit.fitted[shown] / MILLI
    series = (
        Series(label=MEASURED, x=x, y=y, style="points").with_bars(u),
        Series(
            label="fitted, equations 18-20",
            x=fit.curve_speed[line] / RPM,
            y=fit.curve_torque[line] / MILLI,
            style="line",
            group=1,
        ),
        Series(
            label="",
            x=x,
            y=y - fitted,
            style="points",
            low=y - u - fitted,
            high=y + u - fitted,
            group=0,
            panel=1,
        ),
        _zero(x),
    )
    note = (
        f"The mean of both directions at each speed, and the fitted curve (torque balance: {fit.torque_balance}). Good "
        f"where the points below lie on zero within their bars: scatter over stated noise {fit.metrics['birge']:.2g}, "
        "expected 1."
    )
    return Plot(
        name=name,
        title=title,
        x_label="input speed [r/min]",
        y_label=_label(fit),
        series=series,
        figure="9",
        note=note,
        panels=(residual_panel("mN m"),),
    )


def _bars(error: FloatArray) -> FloatArray:
    """Half lengths of error bars [mN m] for standard errors [N m]: 95 %."""
    return 1.96 * error / MILLI


def _zero(x: FloatArray) -> Series:
    """The line of a residual panel at which nothing is left."""
    ends = np.array([x.min(), x.max()]) if len(x) else np.zeros(0)
    return Series(label="", x=ends, y=np.zeros(len(ends)), role="null", panel=1)


def _figure_17(fit: FrictionFit, holds: list[Hold], tare: Tare | None) -> Plot:
    """Measured and fitted torque, forward and reverse, over signed speed."""
    series: list[Series] = []
    for group, direction in enumerate((1.0, -1.0)):
        chosen = sorted(
            (h.torque for h in holds if h.torque.direction == direction), key=lambda t: t.speed
        )
        if chosen:
            series += _one_way(fit, chosen, tare, group)
    both = np.array([-1.0, 1.0]) * fit.speed.max() / RPM
    shared = float(np.abs(fit.points.friction - fit.tare - fit.torque).max()) / MILLI
    return Plot(
        name="friction-directions",
        title="Friction torque, measured and fitted",
        x_label="input speed [r/min]",
        y_label=_label(fit),
        series=(*series, _zero(both)),
        figure="17",
        note="Each direction for itself, and the curve through both. Good where neither side lies off its curve as a "
        f"whole. Points are as measured; what errors that they share make of them, at most {shared:.2g} mN m by the "
        "fit, is not taken off.",
        panels=(residual_panel("mN m"),),
    )


def _one_way(
    fit: FrictionFit, chosen: list[RunningTorque], tare: Tare | None, group: int
) -> tuple[Series, Series, Series]:
    """Points of one direction, what the curve leaves of them, and the curve."""
    direction = chosen[0].direction
    speed = np.array([t.speed for t in chosen])
    torque = np.array([t.torque for t in chosen])
    if tare is not None:
        torque = torque - direction * tare.at(np.abs(speed))[0]
    bar = np.array([1.96 * t.standard_error for t in chosen]) / MILLI
    x, y = speed / RPM, torque / MILLI
    left = y - np.sign(speed) * np.interp(np.abs(speed), fit.curve_speed, fit.curve_torque) / MILLI
    way = way_of(direction)
    measured = Series(label=f"measured, {way}", x=x, y=y, style="points", group=group)
    return (
        measured.with_bars(bar),
        replace(measured, label="", y=left, panel=1).with_bars(bar),
        Series(
            label=f"fitted, {way}",
            x=direction * fit.curve_speed / RPM,
            y=direction * fit.curve_torque / MILLI,
            style="line",
            group=group,
        ),
    )


def _residuals(fit: FrictionFit) -> Plot:
    y, u = (fit.torque - fit.fitted) / MILLI, _bars(fit.standard_error)
    series = (
        Series(label="measured minus fitted", x=fit.speed / RPM, y=y, style="points").with_bars(u),
    )
    return Plot(
        name="friction-residuals",
        title="What the fit leaves",
        x_label="input speed [r/min]",
        y_label="residual [mN m]",
        series=series,
        x_scale="log",
        note="Measured less fitted, over the logarithm of the speed. Good where the points scatter about zero within "
        "their bars; a wave or a slope is friction that the curve cannot follow.",
    )


def _bracket(bracket: list[Hold]) -> Plot:
    """The reference speed over the run: what heat did to the torque in between."""
    direction, time, torque = np.array(
        [(h.torque.direction, h.torque.time, h.torque.torque) for h in bracket]
    ).T
    series = both_ways(direction, time / 60.0, direction * torque / MILLI)
    speed = abs(bracket[0].torque.speed) / RPM
    size: FloatArray = direction * torque
    moved = 100.0 * float(np.ptp(size)) / max(abs(float(np.mean(size))), 1e-12)
    return Plot(
        name="friction-bracket",
        title=f"Reference speed of {speed:.0f} r/min during the sweep",
        x_label="time [min]",
        y_label="torque of motor + gear [mN m]",
        series=tuple(series),
        note="One speed measured again and again between the others. Good where it is flat: warmth and running-in "
        f"moved it by {moved:.2g} % of itself over the sweep.",
    )


def friction_prediction_plot(
    gear: HarmonicDrive,
    points: FrictionPoints,
    torque: FloatArray,
    predicted: FloatArray,
    subject: str,
) -> Plot:
    """A given parameter set against the measured friction."""
    x = points.speed / RPM
    speed = np.geomspace(float(points.speed.min()), float(points.speed.max()), 300)
    u, y = _bars(points.standard_error), torque / MILLI
    series = (
        Series(label=MEASURED, x=x, y=y, style="points").with_bars(u),
        Series(
            label=gear.name,
            x=speed / RPM,
            y=friction_torque(gear, speed) / MILLI,
            style="line",
            group=1,
        ),
        Series(
            label="",
            x=x,
            y=(torque - predicted) / MILLI,
            style="points",
            group=0,
            panel=1,
        ),
        _zero(x),
    )
    return Plot(
        name="friction-prediction",
        note="The curve of a given parameter set beside what was measured; nothing is fitted. Good where the points "
        "below lie on zero within their bars.",
        title=f"Friction of {gear.name} against the run",
        x_label="input speed [r/min]",
        y_label=f"friction torque of {subject} [mN m]",
        series=series,
        x_scale="log",
        figure="17",
        panels=(residual_panel("mN m"),),
    )


def point_table(
    holds: list[Hold], bracket: list[Hold], tare: Tare | None, unit: str = "N m"
) -> Table:
    """Every point of the run in the order in which it was measured."""
    rows: list[tuple[float | int | str, ...]] = []
    for hold in sorted((*holds, *bracket), key=lambda h: h.torque.time):
        t = hold.torque
        motor = 0.0
        if tare is not None:
            motor = float(tare.at(np.array([abs(t.speed)]))[0][0]) * t.direction
        rows.append(
            (
                hold.segment.label,
                hold.segment.repeat,
                t.speed / RPM,
                t.torque,
                t.standard_error,
                motor,
                t.revolutions,
                t.time,
                "" if np.isnan(t.temperature) else t.temperature,
            )
        )
    columns = (
        "segment",
        "sweep",
        "speed [r/min]",
        f"torque [{unit}]",
        f"standard error [{unit}]",
        f"motor tare [{unit}]",
        "revolutions",
        "time [s]",
        "housing [degC]",
    )
    return Table(
        "points",
        "Running torque per point",
        columns,
        tuple(rows),
        "torque as measured, servo-off zero subtracted",
    )


_FIT_TABLE = "fitted-points"


def fit_table(fit: FrictionFit) -> Table:
    """What was fitted: friction of each pair of directions as measured, tare subtracted; what errors that the points
    share have made of it, as far as they tell; the curve without them, and what is left.
    """
    measured = fit.points.friction - fit.tare
    rows = tuple(
        (float(v) / RPM, float(m), float(u), float(f), float(t - f), float(m - t))
        for v, m, t, u, f in zip(
            fit.speed, measured, fit.torque, fit.standard_error, fit.fitted, strict=True
        )
    )
    columns = (
        "speed [r/min]",
        "friction [N m]",
        "standard error [N m]",
        "fitted [N m]",
        "residual [N m]",
        "shared errors [N m]",
    )
    return Table(
        _FIT_TABLE, "Friction points and fit", columns, rows, "half-difference of the directions"
    )
