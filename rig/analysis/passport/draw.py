"""The figures and tables of a passport as data: charts over runs, sums that decide, order spectra, and the points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from experiments.quantity import Quantity
from experiments.result import Plot, Series, Table
from model.identify.estimate import Estimate
from rig.analysis.number_or_none import finite
from rig.analysis.passport.content import (
    Alarm,
    CatalogueLimit,
    PassportPoint,
    PassportSeries,
)
from rig.analysis.passport.followed import comparable, order_of, watched
from rig.analysis.passport.gather import AnalysedRun
from rig.content.phrase import phrase
from rig.content.wording import laboratory_unit
from rig.runfile.header import ORIGIN_WORDS

MEASURED, EXPECTED, CATALOGUE, CHANGED = range(4)
"""Colours: what belongs together shares one."""


def history_plot(
    axis: str,
    points: Sequence[PassportPoint],
    alarm: Alarm | None,
    limit: CatalogueLimit | None,
    *,
    factor: float,
    name: str,
    title: str,
    mark: str,
) -> Plot:
    """The chart of one series: values with U (95 %), what the runs before let expect of each, and since when the gear
    has changed; the catalogue's limit beside them.
    """
    x = np.array([point.position for point in points], dtype=np.float64)
    y = np.array([point.value for point in points]) / factor
    series = [
        Series(label="in order of time", x=x, y=y, style="line", group=MEASURED),
        *_runs(x, y, points, factor),
        *_expected(x, points, factor),
    ]
    if limit is not None:
        across = np.array([0.5, max(len(points), 1) + 0.5])
        series.append(
            Series(
                label=f"catalogue ({limit.provenance})",
                x=across,
                y=np.full(2, limit.value / factor),
                style="line",
                group=CATALOGUE,
                role="limit",
            )
        )
    days = ""
    if points:
        last = points[-1].start[:10]
        days = f"run 1 is of {points[0].start[:10]}, run {len(points)} of {last}"
    words = "" if alarm is None else f"changed since run {_position(points, alarm.since)}"
    return Plot(
        name=name,
        title=title,
        x_label="run of this series, in order of time",
        y_label=axis,
        series=tuple(series),
        note=". ".join(text for text in (mark, words, days) if text),
    )


def _position(points: Sequence[PassportPoint], run: str) -> int:
    return next(point.position for point in points if point.run == run)


def _expected(
    x: NDArray[np.float64], points: Sequence[PassportPoint], factor: float
) -> Iterator[Series]:
    told = np.array([point.expected is not None for point in points], dtype=bool)
    if told.sum() > 1:
        y = np.array([point.expected for point in points if point.expected is not None]) / factor
        yield Series(
            label="expected from the runs before",
            x=x[told],
            y=y,
            style="line",
            group=EXPECTED,
            role="null",
        )


def sums_plot(
    points: Sequence[PassportPoint], threshold: float, *, name: str, title: str, mark: str
) -> Plot:
    """The sums of a watched series from the end of its baseline on: an alarm where one is above the threshold."""
    summed = [point for point in points if point.upper_sum is not None]
    x = np.array([point.position for point in summed], dtype=np.float64)
    series = [
        Series(
            label=label,
            x=x,
            y=np.array([getattr(point, field) for point in summed], dtype=np.float64),
            style="line",
            group=group,
        )
        for label, field, group in (
            ("larger than expected", "upper_sum", MEASURED),
            ("smaller than expected", "lower_sum", EXPECTED),
        )
    ]
    across = np.array([x[0] - 0.5, x[-1] + 0.5])
    series.append(
        Series(
            label="threshold",
            x=across,
            y=np.full(2, threshold),
            style="line",
            group=CHANGED,
            role="limit",
        )
    )
    return Plot(
        name=name,
        title=f"Has it changed? {title}",
        x_label="run of this series, in order of time",
        y_label="sum of scores [standard deviations]",
        series=tuple(series),
        note=". ".join(text for text in (mark, "an alarm is a sum above the threshold") if text),
    )


def _runs(
    x: NDArray[np.float64], y: NDArray[np.float64], points: Sequence[PassportPoint], factor: float
) -> Iterator[Series]:
    """The runs with U (95 %); those since a change have a colour of their own."""
    u = np.array([point.expanded_uncertainty for point in points]) / factor
    u = np.where(np.isfinite(u), u, 0.0)
    out = np.array([point.is_changed for point in points], dtype=bool)
    for label, chosen, colour in (
        ("run, with U (95 %)", ~out, MEASURED),
        ("since the change", out, CHANGED),
    ):
        if chosen.any():
            yield Series(
                label=label,
                x=x[chosen],
                y=y[chosen],
                style="points",
                low=(y - u)[chosen],
                high=(y + u)[chosen],
                group=colour,
            )


def spectrum_plots(analysed: Sequence[AnalysedRun]) -> tuple[Plot, ...]:
    """Amplitudes over order, the first run against the newest and the mean of those between, per
    watched family of orders and set of comparable runs.
    """
    plots: list[Plot] = []
    for kind, quantity in watched():
        if quantity.placeholder != "order":
            continue
        groups: dict[tuple[str, tuple[tuple[str, str], ...]], list[AnalysedRun]] = {}
        for one in analysed:
            if one.analysis.kind == kind and _spectrum(quantity, one):
                conditions = tuple(comparable(one.facts, quantity).items())
                groups.setdefault((one.origin, conditions), []).append(one)
        for (origin, conditions), members in groups.items():
            apart = [text for _, text in conditions if len(groups) > 1]
            plots.append(_spectrum_plot(quantity, members, origin, apart))
    return tuple(plots)


def _spectrum_plot(
    quantity: Quantity, members: Sequence[AnalysedRun], origin: str, conditions: Sequence[str]
) -> Plot:
    spectra = [_spectrum(quantity, one) for one in members]
    sizes = [amplitude for spectrum in spectra for amplitude, _ in spectrum.values()]
    factor, unit = laboratory_unit(quantity.unit, max(sizes), quantity.shown)
    series = [_drawn(f"run {members[0].run.run_id}", spectra[0], 0, factor)]
    if len(members) > 2:
        orders = sorted({order for spectrum in spectra for order in spectrum})
        every = [
            [spectrum[order][0] for spectrum in spectra if order in spectrum] for order in orders
        ]
        low, high = (np.array([pick(values) for values in every]) / factor for pick in (min, max))
        mean = np.array([sum(values) / len(values) for values in every]) / factor
        series.append(
            Series(
                label=f"mean and range of {len(members)} runs",
                x=np.array(orders),
                y=mean,
                style="points",
                low=low,
                high=high,
                group=2,
            )
        )
    if len(members) > 1:
        label = f"run {members[-1].run.run_id}, the newest"
        series.append(_drawn(label, spectra[-1], 1, factor))
    words = phrase(" ({})", ", ".join(conditions))
    return Plot(
        name="passport-order-spectrum",
        title=f"Order spectrum of the {quantity.subject}{words}",
        x_label="order [cycles per input revolution]",
        y_label=f"amplitude [{unit}]",
        series=tuple(series),
        y_scale="log",
        note=ORIGIN_WORDS.get(origin, ""),
    )


def _drawn(
    label: str, spectrum: Mapping[float, tuple[float, float]], group: int, factor: float
) -> Series:
    orders = np.array(sorted(spectrum))
    values = np.array([spectrum[order] for order in orders]) / factor
    amplitude, u = values[:, 0], values[:, 1]
    # On a logarithmic scale an interval cannot reach zero.
    return Series(
        label=label,
        x=orders,
        y=amplitude,
        style="points",
        low=np.maximum(amplitude - u, 1e-3 * amplitude),
        high=amplitude + u,
        group=group,
    )


def _spectrum(quantity: Quantity, one: AnalysedRun) -> dict[float, tuple[float, float]]:
    """Amplitude and U by order, of the orders that the run identified and whose label is an order."""
    ratio = one.analysis.result.options.get("ratio")
    spectrum: dict[float, tuple[float, float]] = {}
    for name, estimate in one.estimates.items():
        if not quantity.matches(name) or not _is_drawn(estimate):
            continue
        order = order_of(quantity.member(name), ratio)
        if math.isfinite(order):
            spectrum[order] = (estimate.value, finite(estimate.expanded_uncertainty) or 0.0)
    return spectrum


def _is_drawn(estimate: Estimate) -> bool:
    return estimate.value > 0.0 and estimate.identifiable != "no"


def point_table(series: PassportSeries) -> Table:
    """The points of a series in the unit of the laboratory."""
    unit, factor = series.display_unit, series.factor
    columns = (
        "#",
        "run",
        "day",
        f"value [{unit}]",
        f"U (95 %) [{unit}]",
        f"expected [{unit}]",
        "remarks",
    )
    rows = tuple(
        (
            point.position,
            point.run,
            point.start[:10],
            point.value / factor,
            point.expanded_uncertainty / factor,
            "" if point.expected is None else point.expected / factor,
            "; ".join((*_point_words(point), *point.remarks)),
        )
        for point in series.points
    )
    return Table(f"passport-{series.quantity}", series.title, columns, rows, " ".join(series.notes))


def _point_words(point: PassportPoint) -> Iterator[str]:
    if point.is_alarm:
        yield "a change is told here"
