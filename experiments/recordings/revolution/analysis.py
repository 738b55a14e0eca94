"""Fourier series of a channel per revolution of an angle: cogging, eccentricity, friction, with both directions apart.

    y(theta) = c_± + sum_n (a_n± cos n theta + b_n± sin n theta)

Orders are chosen by significance; half the difference of the directions' constants is friction.
"""

from __future__ import annotations

import math

from experiments.contract import Evidence
from experiments.errors import analysing
from experiments.evidence import check_recording, check_settings, rotary_ratio
from experiments.need import ANGLES, EFFORTS
from experiments.recording import Recording
from experiments.recordings.channels import chosen_channel
from experiments.recordings.orders_plots import orders_table, spectrum_plot
from experiments.recordings.orders_source import order_source
from experiments.recordings.orders_words import order_estimates, said_of
from experiments.recordings.revolution.declaration import NAME, QUANTITIES, SETTINGS
from experiments.result import Plot, Result, Series
from experiments.setting import names_of
from model.identify.orders.near_two import near_two
from model.identify.revolution import HIGHEST_ORDER, RevolutionFit, fit_series
from model.units import DEGREE


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """Amplitude and phase of the whole orders that rise above the noise, mean and friction of the channel.

    Settings: channel (the torque, force or current that is there), angle ("input_angle" or
    "position"), highest_order (200). Of a run with segments those at constant speed are used, of a
    foreign recording all that turns one way. Directions that differ are listed apart, with their mean beside them.
    """
    settings = evidence.settings
    check_settings(settings, names_of(SETTINGS), NAME)
    purpose = "a Fourier series per revolution"
    angle_name = chosen_channel(recording, settings, "angle", ANGLES, purpose)
    channel = chosen_channel(recording, settings, "channel", EFFORTS, purpose)
    highest = int(settings.get("highest_order", HIGHEST_ORDER))
    checked = check_recording(
        recording, "a Fourier series", evidence.maximum_missed_share, least_rows=60
    )
    with analysing(recording.metadata.run_id):
        source = order_source(recording, angle_name, channel, math.nan)
        unit = recording.signals[channel].unit
        series = fit_series(
            source.pieces, highest_order=highest, unit=unit, has_line=source.has_line
        )
    whole = set(series.orders.tolist())
    of_orders = order_estimates(series.fit, recording, channel, unit)
    explained = None
    if angle_name == "input_angle":
        explained = near_two(series.fit, rotary_ratio(recording, math.nan))
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={
            **{name: e for name, e in of_orders.items() if _order_of(name) in whole},
            **{n: e for n, e in series.estimates.items() if _order_of(n) is None},
        },
        metrics=dict(series.metrics),
        warnings=(
            *checked.warnings,
            *source.warnings,
            *said_of(series.fit, source.left_out),
            *series.warnings,
            *filter(None, (explained,)),
        ),
        plots=(
            _curve_plot(series, channel, unit),
            spectrum_plot(series.fit, channel, unit, angle_name, name="revolution-orders"),
        ),
        tables=(orders_table(series.fit, unit),),
        options={"channel": channel, "angle": angle_name, "phases_count_from": source.reference},
    )


def _order_of(name: str) -> int | None:
    """The whole order that the name of an estimate speaks of; None for one that is of no order, -1 for none whole."""
    kind, _, order = name.rpartition("_")
    if not kind.endswith(("amplitude", "phase")):
        return None
    return int(order) if order.isdigit() else -1


def _curve_plot(fit: RevolutionFit, channel: str, unit: str) -> Plot:
    degrees = fit.angle / DEGREE
    series = [
        Series(label="mean of the directions", x=degrees, y=fit.mean_curve, style="line", group=0)
    ]
    for name, curve, group in (
        ("forward", fit.forward_curve, 1),
        ("reverse", fit.reverse_curve, 2),
    ):
        if curve is not None:
            series.append(Series(label=name, x=degrees, y=curve, style="line", group=group))
    return Plot(
        name="revolution",
        title=f"{channel.replace('_', ' ')} over one revolution",
        x_label="angle [deg]",
        y_label=f"{channel.replace('_', ' ')} [{unit}]",
        series=tuple(series),
        note="The mean over all revolutions at each angle, and the fitted series. What comes again with every turn is "
        "here; what does not was averaged out.",
    )
