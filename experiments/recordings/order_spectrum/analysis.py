"""Order spectrum: amplitude of any channel per order of an angle, any order, each direction."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import replace

from experiments.contract import Evidence
from experiments.errors import AnalysisError, analysing
from experiments.evidence import check_settings, quality_remarks, rotary_ratio
from experiments.need import EFFORTS, NOMINAL_ANGLE, TURNING
from experiments.recording import Recording
from experiments.recordings.channels import chosen_channel
from experiments.recordings.order_spectrum.declaration import NAME, QUANTITIES, SETTINGS
from experiments.recordings.orders_plots import by_speed_plots, orders_table, spectrum_plot
from experiments.recordings.orders_source import KINEMATIC_ERROR, OrderSource, order_source
from experiments.recordings.orders_words import (
    BESIDE_TREND,
    BY_STATED_SPEED,
    by_speed,
    by_stated_speed,
    order_estimates,
    said_of,
)
from experiments.result import Result, way_of
from experiments.setting import names_of
from model.identify.orders.by_speed import (
    ChangingOrder,
    SpeedTrend,
    changing_orders,
    speed_range,
    speed_trend,
)
from model.identify.orders.fit import fit_samples
from model.identify.orders.near_two import near_two
from model.identify.orders.samples import OrderSamples
from model.identify.orders.search import Search

STRONGEST = 12
"""Orders that are listed as results; the table has all."""

HIGHEST = 64.0
FIRST_ROUNDS = 2
"""Rounds of the search that find the lines whose amplitude may change with the speed."""
TURNS_OF_A_TREND = 20.0
"""Revolutions from which on a trend over the speed is taken off: over fewer that of each stretch follows it."""

PERIODS = 50.0
"""Periods of the highest order that an angle below one revolution must cover."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """The orders of a channel over an angle that rise above the noise, and the spectrum of each direction as a plot.

    Settings: channel ("kinematic_error" where both angles are there, else the torque), angle ("input_angle" or
    "output_angle"), highest_order (64). Stretches in one direction are the run's
    segments, or found from the angle. Directions that differ are listed apart, with their mean beside them.
    """
    settings = evidence.settings
    check_settings(settings, names_of(SETTINGS), NAME)
    angle_name = chosen_channel(recording, settings, "angle", TURNING, "an order spectrum")
    channel, unit = channel_of(recording, settings)
    warnings = quality_remarks(recording, "an order spectrum", evidence)
    stated = rotary_ratio(recording, math.nan)
    ratio = evidence.gear.mounted_ratio(recording.metadata.mounting)
    source = order_source(recording, angle_name, channel, rotary_ratio(recording, ratio))
    on_input = angle_name in ("input_angle", NOMINAL_ANGLE)
    with analysing(recording.metadata.run_id):
        highest = float(settings.get("highest_order", HIGHEST))
        samples = OrderSamples.gathered(source.pieces, highest, has_line=source.has_line)
        _require_turns(recording, samples, highest)
        search = Search(highest, stated if on_input else math.nan)
        samples, trends, changing = _at_one_speed(recording, source, samples, search, channel)
        fit = fit_samples(samples, search)
    warnings += [*source.warnings, *said_of(fit, source.left_out)]
    explained = near_two(fit, stated, _measured_ratio(recording)) if on_input else None
    chosen = replace(fit, orders=fit.orders[:STRONGEST])
    estimates = order_estimates(chosen, recording, channel, unit)
    estimates, said = by_speed(estimates, changing, unit)
    warnings += [*said, *([BESIDE_TREND] if trends else [])]
    if angle_name == NOMINAL_ANGLE:
        warnings.append(BY_STATED_SPEED)
        estimates = {k: by_stated_speed(e) for k, e in estimates.items()}
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={k: e for k, e in estimates.items() if not k.startswith("phase")},
        metrics={f"revolutions_{way_of(d)}": samples.revolutions(d) for d in samples.directions},
        warnings=(*warnings, *filter(None, (explained,))),
        plots=(
            spectrum_plot(fit, channel, unit, angle_name),
            *by_speed_plots(changing, channel, unit),
        ),
        tables=(orders_table(fit, unit),),
        options={"channel": channel, "angle": angle_name},
    )


def _at_one_speed(
    recording: Recording, source: OrderSource, samples: OrderSamples, search: Search, channel: str
) -> tuple[OrderSamples, dict[int, SpeedTrend], dict[int, tuple[ChangingOrder, ...]]]:
    """The samples as the middle speed would have them, and by direction the trend over the speed and the orders whose
    amplitude changes with it.

    They are what they were where the speed is steady, or not known.
    """
    if recording.metadata.time_base == "none" or recording.has(NOMINAL_ANGLE):
        return samples, {}, {}
    varied = [d for d in samples.directions if speed_range(source.moved(d)) is not None]
    trends = {
        d: trend
        for d in (varied if channel in EFFORTS else ())
        if samples.revolutions(d) >= TURNS_OF_A_TREND
        and (trend := speed_trend(functools.partial(source.moved, d))) is not None
    }
    if trends:
        samples = _gathered(source, search, trends, {})
    if not varied:
        return samples, {}, {}
    # The strongest lines are enough here: with all of them every sidelobe would be searched first.
    first = fit_samples(samples, replace(search, rounds=FIRST_ROUNDS))
    strongest = [order.order for order in first.orders]
    found = {d: changing_orders(functools.partial(source.moved, d), strongest) for d in varied}
    changing = {d: orders for d, orders in found.items() if orders}
    if changing:
        samples = _gathered(source, search, trends, changing)
    return samples, trends, changing


def _gathered(
    source: OrderSource,
    search: Search,
    trends: Mapping[int, SpeedTrend],
    changing: Mapping[int, tuple[ChangingOrder, ...]],
) -> OrderSamples:
    """The samples without what changes with the speed."""
    rest = functools.partial(source.without, trends, changing)
    return OrderSamples.gathered(rest, search.highest, has_line=source.has_line)


def channel_of(recording: Recording, settings: dict[str, object]) -> tuple[str, str]:
    """The channel and its unit; the kinematic error is made of both angles."""
    both = recording.has("input_angle", "output_angle")
    wanted = settings.get("channel", KINEMATIC_ERROR if both else None)
    if wanted == KINEMATIC_ERROR:
        recording.require("the kinematic error", "input_angle", "output_angle")
        return KINEMATIC_ERROR, "rad"
    name = chosen_channel(recording, settings, "channel", EFFORTS, "an order spectrum")
    return name, recording.signals[name].unit


def _require_turns(recording: Recording, samples: OrderSamples, highest: float) -> None:
    """Refuse an angle that covers neither a whole revolution nor enough periods of the highest order asked for."""
    turns = max(samples.revolutions(d) for d in samples.directions)
    if turns >= 1.0 or turns * highest >= PERIODS:
        return
    raise AnalysisError(
        "there is no stretch of a whole revolution in one direction",
        where=recording.metadata.run_id,
        value=f"{turns:.3g} revolutions",
        limit=f">= 1, or {PERIODS:g} periods of the highest order",
        remedy="Record at least one whole revolution; or, of a joint behind a gear, ask for the orders of its motor: "
        f"--set highest_order={math.ceil(max(2.0 * PERIODS / max(turns, 1e-3), 500.0)):g}.",
    )


def _measured_ratio(recording: Recording) -> float:
    """Travel of the input over that of the output, where both were recorded; NaN where not."""
    if not recording.has("input_angle", "output_angle") or recording.rows < 2:
        return math.nan
    ends = slice(0, 1), slice(recording.rows - 1, None)
    first, last = (recording.si("input_angle", rows)[0] for rows in ends)
    begin, end = (recording.output_angle(rows)[0] for rows in ends)
    # A run that comes back to where it began tells nothing by its ends.
    return float((last - first) / (end - begin)) if abs(end - begin) > 0.5 else math.nan
