"""Figures 12, 13 and 16 and the table of orders, as data: kinematic error over the input, its
spectrum, torque beside it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from experiments.angle.phase_reference import PhaseReference
from experiments.evidence import usable
from experiments.recording import Recording
from experiments.result import Panel, Plot, Series, Table, residual_panel, way_of
from model.arrays import FloatArray, IntArray
from model.gear import Harmonic, HarmonicDrive
from model.identify.directions import CombinedKinematicError, PhaseRelation
from model.identify.kinematic_error import KinematicErrorFit
from model.kinematic_error import series_value
from model.units import ARCMIN, ARCSEC, DEGREE, REVOLUTION

_RAW_REVOLUTIONS = 4.0
"""Input revolutions of raw samples that figure 12 shows."""
_RAW_POINTS = 4000
FITTED = 6
"""Group of the fitted curves, whose colour is that of no direction."""


def kinematic_error_plots(
    fits: list[KinematicErrorFit],
    combined: CombinedKinematicError | None,
    relation: PhaseRelation | None,
    recording: Recording,
    reference: PhaseReference,
) -> tuple[Plot, ...]:
    """Every figure of a kinematic-error run."""
    plots = [
        _over_input(fits[0], recording, reference),
        _averaged(fits),
        _spectrum(fits, combined),
        _over_output(fits),
    ]
    if relation is not None:
        plots += _figure_16(relation)
    return tuple(plots)


def _over_input(fit: KinematicErrorFit, recording: Recording, reference: PhaseReference) -> Plot:
    """Figure 12: some input revolutions of raw samples and the fitted curve through them."""
    start, sign = fit.regression.cells.first_angle, fit.direction
    angle, raw = _raw_samples(fit, recording, reference)
    pick = slice(None, None, max(1, len(angle) // _RAW_POINTS))
    fitted_at = np.linspace(start, start + sign * _RAW_REVOLUTIONS * REVOLUTION, 1500)
    fitted = _value(fit, fitted_at)
    middle = float(np.mean(raw - _value(fit, angle))) if len(angle) else 0.0
    series = (
        Series(
            label="measured",
            x=np.abs(angle[pick] - start) / REVOLUTION,
            y=(raw[pick] - middle) / ARCMIN,
            style="points",
            group=0,
        ),
        Series(
            label="fitted, equation 16",
            x=np.abs(fitted_at - start) / REVOLUTION,
            y=fitted / ARCMIN,
            style="line",
            group=1,
        ),
        Series(
            label="",
            x=np.abs(angle[pick] - start) / REVOLUTION,
            y=(raw[pick] - middle - _value(fit, angle[pick])) / ARCMIN,
            style="points",
            group=0,
            panel=1,
        ),
    )
    return Plot(
        name="kinematic-error",
        title="Kinematic error over the input",
        x_label="input revolutions",
        y_label="kinematic error [arcmin]",
        series=series,
        figure="12",
        note=f"Raw samples of the {way_of(sign)} traverse, nothing averaged, and the fitted series. Good where what is "
        f"left below shows no wave: {_residual(fit)}.",
        panels=(residual_panel("arcmin"),),
    )


def _raw_samples(
    fit: KinematicErrorFit, recording: Recording, reference: PhaseReference
) -> tuple[FloatArray, FloatArray]:
    """Input angle and deviation [rad] of some input revolutions from the start of a traverse."""
    start, sign = fit.regression.cells.first_angle, fit.direction
    angles: list[FloatArray] = []
    values: list[FloatArray] = []
    segment_rows = _rows_from(recording, start + reference.input_angle, sign)
    for rows in recording.blocks(segment_rows, size=1 << 15):
        good = usable(recording, rows)
        angle = recording.si("input_angle", rows)[good] - reference.input_angle
        inside = sign * (angle - start) <= _RAW_REVOLUTIONS * REVOLUTION
        angles.append(angle[inside])
        values.append(recording.output_angle(rows)[good][inside] - angle[inside] / fit.ratio)
        if not inside.all():
            break
    return np.concatenate(angles), np.concatenate(values)


def _residual(fit: KinematicErrorFit) -> str:
    """What the fit leaves of the raw samples, in words."""
    return f"it is {fit.metrics['residual_rms'] / ARCSEC:.2g} arcsec (root mean square)"


def _rows_from(recording: Recording, angle: float, sign: float) -> slice:
    """Rows from where a traverse that begins at `angle` was entered: found by the segments, else by
    the angle itself.
    """
    for segment in recording.labelled("traverse", "traverse (cut)"):
        first = float(recording.si("input_angle", slice(segment.start, segment.start + 1))[0])
        if segment.direction * sign > 0 and abs(first - angle) < 0.1 * REVOLUTION:
            return slice(segment.start, segment.stop)
    for rows in recording.blocks():
        here = recording.si("input_angle", rows)
        hit = np.flatnonzero(sign * (here - angle) >= 0.0)
        if len(hit):
            return slice(rows.start + int(hit[0]), recording.rows)
    return slice(0, recording.rows)


def _value(fit: KinematicErrorFit, angle: FloatArray) -> FloatArray:
    """The fitted series without constant and trend at these input angles."""
    total = np.zeros_like(angle)
    for order in fit.orders:
        total += order.cosine.value * np.cos(order.order * angle) + order.sine.value * np.sin(
            order.order * angle
        )
    return total


def _averaged(fits: list[KinematicErrorFit]) -> Plot:
    """Figure 13: the error averaged over all revolutions per input angle, and the fit: a panel for
    each direction, and what both leave.
    """
    series: list[Series] = []
    ways = _one_each_way(fits)
    for k, fit in enumerate(ways):
        way = way_of(fit.direction)
        measured = Series(
            label=f"measured, {way}",
            x=fit.input_angle / DEGREE,
            y=fit.measured_curve / ARCMIN,
            style="points",
            group=k,
            panel=k,
        )
        fitted = replace(
            measured,
            label=f"fitted, {way}",
            y=fit.fitted_curve / ARCMIN,
            style="line",
            group=FITTED,
        )
        left = (fit.measured_curve - fit.fitted_curve) / ARCMIN
        series += [
            measured,
            fitted,
            replace(measured, label="", y=left, style="line", panel=len(ways)),
        ]
    note = ", ".join(
        f"{way_of(f.direction)} {f.metrics['mse_curve']:.2g} (on revolutions left out {f.metrics['mse_left_out']:.2g})"
        for f in ways
    )
    return Plot(
        name="kinematic-error-fit",
        title="Kinematic error, averaged per input angle",
        x_label="input angle [deg]",
        y_label=_way_label(ways[0]),
        series=tuple(series),
        figure="13",
        note=f"All revolutions averaged, and what the fit leaves of them. Its MSE (22) is {note}: below 1 is "
        "excellent, below 5 good, 100 no better than the mean.",
        panels=(*_further_ways(ways), residual_panel("arcmin")),
    )


def _way_label(fit: KinematicErrorFit) -> str:
    """The axis of one direction's panel."""
    return f"{way_of(fit.direction)} [arcmin]"


def _further_ways(ways: list[KinematicErrorFit]) -> tuple[Panel, ...]:
    """The panels of the directions after the first: no curve hides another."""
    return tuple(Panel(_way_label(fit), 1.0) for fit in ways[1:])


def _spectrum(fits: list[KinematicErrorFit], combined: CombinedKinematicError | None) -> Plot:
    """The amplitudes of all orders of the basis."""
    if combined is not None:
        orders = np.array(combined.orders)
        amplitude = np.hypot(combined.cosine, combined.sine)
        label = "mean of both directions"
    else:
        orders = np.array([o.order for o in fits[0].orders])
        amplitude = np.array([o.amplitude.value for o in fits[0].orders])
        label = "one direction"
    bars = Series(label=label, x=orders, y=amplitude / ARCSEC, style="bars")
    return Plot(
        name="kinematic-error-orders",
        title="Orders of the kinematic error",
        x_label="order per input revolution",
        y_label="amplitude [arcsec]",
        series=(bars,),
        y_scale="log",
        figure="13",
        note="One bar for each order of the series, on a logarithmic scale. A harmonic drive errs by order 2, its "
        "multiples and their neighbours at 1/N; another large order comes from the bench, the mounting or a damage.",
    )


def _over_output(fits: list[KinematicErrorFit]) -> Plot:
    """The fitted curve over one output revolution, with what encoders and mounting add to it."""
    series: list[Series] = []
    ways = _one_each_way(fits)
    for k, fit in enumerate(ways):
        x = fit.output_curve_angle / (REVOLUTION * fit.ratio) * 360.0
        pick = slice(None, None, max(1, len(x) // 12000))
        series.append(
            Series(
                label=way_of(fit.direction),
                x=x[pick],
                y=fit.output_curve[pick] / ARCMIN,
                group=k,
                panel=k,
            )
        )
    return Plot(
        name="transmission-accuracy",
        title="Fitted error over one output revolution",
        x_label="output angle [deg]",
        y_label=_way_label(ways[0]),
        series=tuple(series),
        note="What was fitted over one turn of the output: the gear's error, and what encoders and mounting add to it. "
        "The transmission accuracy is its peak-to-peak less what these add; good where it keeps the limit, if there "
        "is one.",
        panels=_further_ways(ways),
    )


def _figure_16(relation: PhaseRelation) -> list[Plot]:
    """Figure 16: friction torque over one input revolution, the kinematic error under it, both with
    their extremes.
    """
    x = relation.input_angle / DEGREE
    both = (
        ("friction torque", relation.friction_torque, 1e-3),
        ("kinematic error", relation.kinematic_error, ARCMIN),
    )
    series: list[Series] = []
    for k, (name, curve, unit) in enumerate(both):
        extremes = _extremes(curve)
        series.append(Series(label=name, x=x, y=curve / unit, group=k, panel=k))
        series.append(
            Series(
                label=f"extremes of the {name}",
                x=x[extremes],
                y=curve[extremes] / unit,
                style="points",
                group=k,
                panel=k,
            )
        )
    return [
        Plot(
            name="figure-16",
            title="Do friction torque and kinematic error have their extremes together?",
            x_label="input angle [deg]",
            y_label="friction torque [mN m]",
            series=tuple(series),
            figure="16",
            note=relation.sentence,
            panels=(Panel("kinematic error [arcmin]", 1.0),),
        )
    ]


def _extremes(curve: FloatArray) -> IntArray:
    """Rows of the local extremes of a periodic curve that reach half way to its largest or smallest value."""
    centred = curve - 0.5 * (curve.max() + curve.min())
    before, after = np.roll(centred, 1), np.roll(centred, -1)
    turns = ((centred > before) & (centred >= after)) | ((centred < before) & (centred <= after))
    return np.flatnonzero(turns & (np.abs(centred) >= 0.5 * np.abs(centred).max()))


def _one_each_way(fits: list[KinematicErrorFit]) -> list[KinematicErrorFit]:
    """The first fit of each direction."""
    ahead = [f for f in fits if f.direction > 0][:1]
    return ahead + [f for f in fits if f.direction < 0][:1]


def whole_orders(gear: HarmonicDrive) -> list[Harmonic]:
    """The orders of a parameter set that do not average out in the curve over the input."""
    return [h for h in gear.kinematic_error if abs(h.order - round(h.order)) < 1e-9]


def predicted_curve(gear: HarmonicDrive, fit: KinematicErrorFit, shift: float = 0.0) -> FloatArray:
    """The curve of a parameter set [rad] at the angles of the averaged one, moved by `shift` [rad], and to its mean."""
    predicted = series_value(whole_orders(gear), fit.input_angle + shift)
    return predicted - predicted.mean() + fit.measured_curve.mean()


def prediction_plot(gear: HarmonicDrive, fit: KinematicErrorFit) -> Plot:
    """A given parameter set against the averaged curve of one direction, and what is left."""
    predicted = predicted_curve(gear, fit)
    x = fit.input_angle / DEGREE
    series = (
        Series(label="measured", x=x, y=fit.measured_curve / ARCMIN, style="points", group=0),
        Series(label=gear.name, x=x, y=predicted / ARCMIN, style="line", group=1),
        Series(
            label="",
            x=x,
            y=(fit.measured_curve - predicted) / ARCMIN,
            style="line",
            group=0,
            panel=1,
        ),
    )
    return Plot(
        name=f"kinematic-error-prediction-{way_of(fit.direction)}",
        title=f"Kinematic error of {gear.name} against the run, {way_of(fit.direction)}",
        x_label="input angle [deg]",
        y_label="kinematic error [arcmin]",
        series=series,
        figure="13",
        note="The curve of a given parameter set beside what was measured; nothing is fitted. Good where what is left "
        "below is small and has no wave.",
        panels=(residual_panel("arcmin"),),
    )


def order_table(combined: CombinedKinematicError) -> Table:
    """Every order of the basis: a, b, amplitude, phase, and the 95 % half width of the amplitude."""
    rows: list[tuple[float | int | str, ...]] = []
    for k, (order, label) in enumerate(zip(combined.orders, combined.labels, strict=True)):
        a, b = float(combined.cosine[k]), float(combined.sine[k])
        size = math.hypot(a, b)
        block = combined.covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        error = math.sqrt(max(float(np.trace(block)) / 2.0, 0.0))
        phase = math.atan2(b, a)
        rows.append(
            (label, order, a / ARCSEC, b / ARCSEC, size / ARCSEC, phase / DEGREE, error / ARCSEC)
        )
    columns = (
        "order",
        "cycles per input revolution",
        "a [arcsec]",
        "b [arcsec]",
        "amplitude [arcsec]",
        "phase [deg]",
        "standard error of a, b [arcsec]",
    )
    return Table(
        "orders", "Orders of the kinematic error, mean of both directions", columns, tuple(rows)
    )


_GOODNESS = (
    ("MSE (22), samples that were fitted", "mse_curve"),
    ("MSE (22), revolutions that were left out", "mse_left_out"),
    ("MSE (22), raw samples", "mse_raw"),
    ("harmonics fitted", "harmonics"),
)
PAPERS_GOODNESS = (
    "Zou et al. state 0.71 for their fit, and call an MSE below 5 good and below 1 excellent, 100 being no better "
    "than the mean. What differs: another gear and other encoders; their speed, their number of harmonics and of "
    "revolutions are not known; they do not say that the samples were others than those fitted. Here the curves are "
    "averaged per input angle, which takes the rounding of the counters out."
)
"""What stands beside every MSE of this program."""


def goodness_table(fits: list[KinematicErrorFit]) -> Table:
    """MSE (22) of each direction, on the samples fitted and on revolutions left out, beside the paper's figures."""
    ways = _one_each_way(fits)
    rows = tuple((title, *(float(fit.metrics[name]) for fit in ways)) for title, name in _GOODNESS)
    columns = ("goodness of fit", *(way_of(fit.direction) for fit in ways))
    return Table("goodness", "How well the series fits", columns, rows, note=PAPERS_GOODNESS)
