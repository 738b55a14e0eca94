"""The figures of a preview as data: the window, a report and `rig plan` draw the same ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from experiments.result import Plot, Series
from model.units import ARCMIN, DEGREE, RPM
from rig.bench import limits as lim
from rig.present.decimate import peak_rows
from rig.present.preview.plan import PlanPreview

FloatArray = NDArray[np.float64]

BINS = 1500
"""Bins along a curve that keep their extremes: more than a screen has columns for."""
LONG = 600.0
"""s above which a plan's time is shown in minutes."""
NEAR = 2.5
"""A limit is drawn where it is within so many times the largest value; farther off it is told in the title."""


def figures_of(preview: PlanPreview) -> dict[str, Plot]:
    """The figures by name: "speed", "torque", "friction", and with a gear "output" and "kinematic-error"."""
    figures = {"speed": _speed(preview), "torque": _torque(preview)}
    if preview.error is not None:
        figures |= {"output": _output(preview), "kinematic-error": _error(preview)}
    return {**figures, "friction": _friction(preview)}


def _axis(preview: PlanPreview) -> tuple[float, str]:
    """Factor and label of the time axis."""
    minutes = preview.timeline.duration > LONG
    return (1.0 / 60.0, "nominal time [min]") if minutes else (1.0, "nominal time [s]")


def _speed(preview: PlanPreview) -> Plot:
    scale, label = _axis(preview)
    time, speed = preview.timeline.polyline()
    rows = _thinned(speed)
    series = [Series(label="set-point", x=scale * time[rows], y=speed[rows] / RPM)]
    limit, title = _limit(preview, lim.INPUT_SPEED, 1.0 / RPM, "r/min", speed / RPM)
    series += limit
    prompts = [mark for mark in preview.marks if mark.kind == "prompt"]
    if prompts:
        at = scale * np.array([mark.time for mark in prompts])
        series.append(
            Series(
                label=f"prompts: {len(prompts)}", x=at, y=np.zeros(len(at)), style="points", group=3
            )
        )
    return Plot(
        name="preview-speed",
        title=f"Input speed{title}",
        x_label=label,
        y_label="speed [r/min]",
        series=tuple(series),
    )


def _torque(preview: PlanPreview) -> Plot:
    scale, label = _axis(preview)
    torque = preview.torque
    rows = _thinned(torque.low, torque.high)
    series = [
        Series(
            label="predicted, with 95 % band",
            x=scale * preview.time[rows],
            y=torque.value[rows],
            style="band",
            low=torque.low[rows],
            high=torque.high[rows],
        )
    ]
    time, setpoint = preview.timeline.torque_line()
    if len(time):
        series.append(Series(label="torque ramps", x=scale * time, y=setpoint, group=2))
    limit, title = _limit(
        preview, lim.MOTOR_TORQUE, 1.0, "N m", np.concatenate([torque.low, torque.high])
    )
    return Plot(
        name="preview-torque",
        title=f"Torque at the motor{title}",
        x_label=label,
        y_label="torque [N m]",
        series=(*series, *limit),
    )


def _output(preview: PlanPreview) -> Plot:
    scale, label = _axis(preview)
    rows = _thinned(
        preview.output_speed - preview.output_ripple, preview.output_speed + preview.output_ripple
    )
    speed, ripple = preview.output_speed[rows] / RPM, preview.output_ripple[rows] / RPM
    series = Series(
        label="with the ripple of the kinematic error",
        x=scale * preview.time[rows],
        y=speed,
        style="band",
        low=speed - ripple,
        high=speed + ripple,
        group=2,
    )
    return Plot(
        name="preview-output",
        title="Output speed",
        x_label=label,
        y_label="speed [r/min]",
        series=(series,),
    )


def _error(preview: PlanPreview) -> Plot:
    error = preview.error
    assert error is not None
    value, doubt = error.value / ARCMIN, error.uncertainty / ARCMIN
    series = Series(
        label="of the parameter set, with 95 % band",
        x=error.angle / DEGREE,
        y=value,
        style="band",
        low=value - doubt,
        high=value + doubt,
        group=1,
    )
    title = "Kinematic error over one input revolution"
    return Plot(
        name="preview-kinematic-error",
        title=title,
        x_label="input angle [deg]",
        y_label="error [arcmin]",
        series=(series,),
    )


def _friction(preview: PlanPreview) -> Plot:
    curve = preview.curve
    of = "motor and gear" if preview.error is not None else "the motor"
    series = Series(
        label=f"{of}, with 95 % band",
        x=preview.curve_speed / RPM,
        y=curve.value,
        style="band",
        low=curve.low,
        high=curve.high,
    )
    title = f"Running torque of {of} over speed"
    return Plot(
        name="preview-friction",
        title=title,
        x_label="input speed [r/min]",
        y_label="torque [N m]",
        series=(series,),
        x_scale="log",
    )


def _thinned(*curves: FloatArray) -> NDArray[np.intp]:
    """Rows that must stay so that curves over the same instants look the same, peaks included."""
    return np.unique(np.concatenate([peak_rows(curve, BINS) for curve in curves]))


def _limit(
    preview: PlanPreview, quantity: str, factor: float, unit: str, values: FloatArray
) -> tuple[list[Series], str]:
    """A limit on both sides where the values come near it; what the title says of it where they do not."""
    limit = preview.planned.limits.value(quantity) * factor
    if not math.isfinite(limit):
        return [], ""
    if limit > NEAR * float(np.max(np.abs(values), initial=0.0)):
        return [], f" (limit ±{limit:.4g} {unit}, outside the picture)"
    end = _axis(preview)[0] * preview.timeline.duration
    ends = np.array([0.0, end, np.nan, 0.0, end])
    sides = limit * np.array([1.0, 1.0, np.nan, -1.0, -1.0])
    return [Series(label=f"limit ±{limit:.4g} {unit}", x=ends, y=sides, group=1)], ""
