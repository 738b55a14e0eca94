"""Fourier series of a channel per revolution of an angle: cogging, eccentricity, friction, with both directions apart.

    y(theta) = c_± + sum_n (a_n± cos n theta + b_n± sin n theta)

Orders are chosen by significance; half the difference of the directions' constants is friction.
"""

from __future__ import annotations

import numpy as np

from experiments.angle.phase_reference import phase_reference
from experiments.contract import Evidence, Experiment, NoParameters, no_plan
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_recording, check_settings, usable
from experiments.planning.parts import ZERO_AFTER, ZERO_BEFORE
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.recordings.channels import ANGLES, EFFORTS, chosen_channel
from experiments.result import Plot, Result, Series, Table
from experiments.torque.zero import torque_zero
from model.arrays import FloatArray
from model.identify.revolution import (
    HIGHEST_ORDER,
    RevolutionFit,
    directions_of_travel,
    fit_revolution,
)
from model.units import DEGREE, REVOLUTION

NAME = "revolution"
SETTINGS = ("channel", "angle", "highest_order")
MOST_SAMPLES = 100_000
"""Samples above which those of all revolutions are averaged per cell of angle before the fit, each direction apart."""
CELLS_PER_PERIOD = 12
"""Cells per period of the highest order where samples are averaged."""
COUNTED = ("traverse", "hold")

QUANTITIES = (
    Quantity(name="amplitude_{order}", title="order {order}, amplitude", unit=""),
    Quantity(
        name="phase_{order}", title="order {order}, phase", unit="rad", shown="°", is_circular=True
    ),
    Quantity(name="mean", title="mean", unit="", is_signed=True),
    Quantity(
        name="friction",
        title="friction",
        unit="",
        definition="half the difference of the directions",
    ),
    Quantity(
        name="direction_shift",
        title="direction shift",
        unit="rad",
        definition="angle by which the series of the directions are shifted",
        is_signed=True,
    ),
    Quantity(name="residual_rms", title="residual rms", unit=""),
    Quantity(name="samples", title="samples", unit="1"),
    Quantity(name="candidates", title="candidates", unit="1"),
    Quantity(name="revolutions", title="revolutions", unit="1"),
)


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Amplitude and phase of the orders that rise above the noise, mean and friction of the channel.

    Settings: channel (the torque, force or current that is there), angle ("input_angle" or
    "position"), highest_order (200). Of a run with segments those at constant speed are used, of a
    foreign recording all of it.
    """
    settings = evidence.settings
    check_settings(settings, SETTINGS, NAME)
    angle_name = chosen_channel(
        recording, settings, "angle", ANGLES, "a Fourier series per revolution"
    )
    channel = chosen_channel(
        recording, settings, "channel", EFFORTS, "a Fourier series per revolution"
    )
    if recording.signals[angle_name].unit != "rad":
        raise AnalysisError(
            "a revolution needs an angle",
            where=recording.metadata.run_id,
            value=f"{angle_name} in {recording.signals[angle_name].unit}",
            limit="rad",
        )
    highest = int(settings.get("highest_order", HIGHEST_ORDER))
    warnings = list(
        check_recording(
            recording, "a Fourier series", evidence.maximum_missed_share, least_rows=60
        ).warnings
    )
    angle, value, reference, said = _channels(recording, angle_name, channel)
    unit = recording.signals[channel].unit
    with analysing(recording.metadata.run_id):
        angle, value = _averaged(angle, value, highest)
        fit = fit_revolution(angle, value, highest_order=highest, unit=unit)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates=fit.estimates,
        metrics=dict(fit.metrics),
        warnings=(*warnings, *said, *fit.warnings),
        plots=_plots(fit, channel, unit),
        tables=(_table(fit, unit),),
        options={"channel": channel, "angle": angle_name, "phases_count_from": reference},
    )


def _channels(
    recording: Recording, angle_name: str, channel: str
) -> tuple[FloatArray, FloatArray, str, list[str]]:
    """Angle from its phase reference and the channel, of everything that counts, in order of time."""
    parts = [slice(s.start, s.stop) for s in recording.labelled(*COUNTED)] or [
        slice(0, recording.rows)
    ]
    reference, what = 0.0, "the recorded angle"
    if angle_name == "input_angle":
        phase = phase_reference(recording)
        reference, what = phase.input_angle, phase.what
    zero = None
    said: list[str] = []
    if recording.labelled(ZERO_BEFORE, ZERO_AFTER) and channel in ("torque", "drive_torque"):
        zero = torque_zero(recording, channel)
        said += zero.warnings
    angles, values = [], []
    for rows in parts:
        good = usable(recording, rows)
        angle = (
            recording.output_angle(rows)
            if angle_name == "output_angle"
            else recording.si(angle_name, rows)
        )
        value = recording.si(channel, rows)[good]
        angles.append(angle[good] - reference)
        values.append(value if zero is None else value - zero.at(recording.time(rows)[good]))
    return np.concatenate(angles), np.concatenate(values), what, said


def _averaged(angle: FloatArray, value: FloatArray, highest: int) -> tuple[FloatArray, FloatArray]:
    """One revolution forward and one back of means per cell of angle, where there are very many samples."""
    if len(angle) <= MOST_SAMPLES:
        return angle, value
    cells = CELLS_PER_PERIOD * highest
    sign = directions_of_travel(angle)
    place = angle % REVOLUTION
    angles, values = [], []
    for direction in (1.0, -1.0):
        chosen = sign == direction
        cell = np.minimum((place[chosen] * (cells / REVOLUTION)).astype(np.int64), cells - 1)
        counts = np.bincount(cell, minlength=cells)
        filled = counts > 0
        at = np.bincount(cell, weights=place[chosen], minlength=cells)[filled] / counts[filled]
        mean = np.bincount(cell, weights=value[chosen], minlength=cells)[filled] / counts[filled]
        order = slice(None) if direction > 0 else slice(None, None, -1)
        angles.append(at[order])
        values.append(mean[order])
    return np.concatenate(angles), np.concatenate(values)


def _plots(fit: RevolutionFit, channel: str, unit: str) -> tuple[Plot, ...]:
    degrees = fit.angle / DEGREE
    label = f"{channel.replace('_', ' ')} [{unit}]"
    series = [
        Series(label="mean of the directions", x=degrees, y=fit.mean_curve, style="line", group=0)
    ]
    for name, curve, group in (
        ("forward", fit.forward_curve, 1),
        ("reverse", fit.reverse_curve, 2),
    ):
        if curve is not None:
            series.append(Series(label=name, x=degrees, y=curve, style="line", group=group))
    orders = fit.spectrum_order.astype(np.float64)
    spectrum = (
        Series(label="amplitude", x=orders, y=fit.spectrum_amplitude, style="bars", group=0),
        Series(label="noise floor", x=orders, y=fit.noise_floor, style="line", group=1),
    )
    return (
        Plot(
            name="revolution",
            title=f"{channel.replace('_', ' ')} over one revolution",
            x_label="angle [deg]",
            y_label=label,
            series=tuple(series),
        ),
        Plot(
            name="revolution-orders",
            title="Orders and their noise floor",
            x_label="order per revolution",
            y_label=f"amplitude [{unit}]",
            series=spectrum,
            y_scale="log",
        ),
    )


def _table(fit: RevolutionFit, unit: str) -> Table:
    rows = tuple(
        (
            int(n),
            float(a),
            fit.estimates[f"phase_{n}"].value / DEGREE,
            float(fit.noise_floor[n - 1]),
        )
        for n, a in zip(fit.orders.tolist(), fit.amplitude, strict=True)
    )
    columns = ("order", f"amplitude [{unit}]", "phase [deg]", f"noise floor [{unit}]")
    return Table("orders", "Orders that rise above the noise, strongest first", columns, rows)


EXPERIMENT = Experiment(
    name=NAME,
    title="Fourier series per revolution",
    summary="Fourier series of a channel per revolution, both ways",
    parameters=NoParameters,
    plan=no_plan,
    analyse=analyse,
    needs=(),
    has_plan=False,
    quantities=QUANTITIES,
    version=2,
)
