"""The figures and tables of a passport as data: control charts, order spectra, and the points behind them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.result import Plot, Series, Table
from model.units import ARCSEC
from rig.analysis.passport.content import (
    CatalogueLimit,
    ControlLimits,
    PassportPoint,
    PassportSeries,
)
from rig.analysis.passport.gather import FoundRun
from rig.analysis.passport.quantities import Quantity, comparable, order_of, order_quantity
from rig.runfile.header import ORIGIN_WORDS

MEASURED, CONTROL, CATALOGUE, SIGNALS = range(4)
"""Colours: what belongs together shares one."""
SPECTRUM = order_quantity("")


def control_plot(
    quantity: Quantity,
    title: str,
    points: Sequence[PassportPoint],
    control: ControlLimits | None,
    limit: CatalogueLimit | None,
    mark: str,
) -> Plot:
    """The chart of one series: values with U (k = 2), centre line and control limits, the
    catalogue's limit beside them.
    """
    x = np.array([point.position for point in points], dtype=np.float64)
    y = np.array([point.value for point in points]) / quantity.factor
    u = np.array([point.expanded_uncertainty for point in points]) / quantity.factor
    u = np.where(np.isfinite(u), u, 0.0)
    across = np.array([0.5, max(len(points), 1) + 0.5])
    out = np.array([bool(point.signals) for point in points], dtype=bool)
    series = [Series(label="in order of time", x=x, y=y, style="line", group=MEASURED)]
    for label, chosen, colour in (
        ("run, with U (k = 2)", ~out, MEASURED),
        ("signals a change", out, SIGNALS),
    ):
        if chosen.any():
            low, high = (y - u)[chosen], (y + u)[chosen]
            series.append(
                Series(
                    label=label,
                    x=x[chosen],
                    y=y[chosen],
                    style="points",
                    low=low,
                    high=high,
                    group=colour,
                )
            )
    if control is not None:
        lines = {
            "centre line": control.centre,
            "upper control limit": control.upper,
            "lower control limit": control.lower,
        }
        for label, value in lines.items():
            series.append(
                Series(
                    label=label,
                    x=across,
                    y=np.full(2, value / quantity.factor),
                    style="line",
                    group=CONTROL,
                )
            )
    if limit is not None:
        label = f"limit ({limit.provenance})"
        series.append(
            Series(
                label=label,
                x=across,
                y=np.full(2, limit.value / quantity.factor),
                style="line",
                group=CATALOGUE,
            )
        )
    days = (
        f"run 1 is of {points[0].start[:10]}, run {len(points)} of {points[-1].start[:10]}"
        if points
        else ""
    )
    note = ". ".join(text for text in (mark, days) if text)
    return Plot(
        name=f"passport-{quantity.key}",
        title=title,
        x_label="run of this series, in order of time",
        y_label=f"{quantity.axis} [{quantity.display_unit}]",
        series=tuple(series),
        note=note,
    )


def spectrum_plots(found: Sequence[FoundRun]) -> tuple[Plot, ...]:
    """Amplitudes over order, the first run against the newest and the mean of those between, per
    set of comparable runs.
    """
    groups: dict[tuple[str, tuple[tuple[str, str], ...]], list[FoundRun]] = {}
    for one in found:
        if one.analysis.kind == SPECTRUM.kind and _spectrum(one):
            groups.setdefault(
                (one.origin, tuple(comparable(one.facts, SPECTRUM).items())), []
            ).append(one)
    return tuple(
        _spectrum_plot(members, origin, [text for _, text in conditions], several=len(groups) > 1)
        for (origin, conditions), members in groups.items()
    )


def _spectrum_plot(
    members: Sequence[FoundRun], origin: str, conditions: Sequence[str], *, several: bool
) -> Plot:
    spectra = [_spectrum(one) for one in members]
    series = [_drawn(f"run {members[0].run.run_id}", spectra[0], 0)]
    if len(members) > 2:
        orders = sorted({order for spectrum in spectra for order in spectrum})
        every = [
            [spectrum[order][0] for spectrum in spectra if order in spectrum] for order in orders
        ]
        low, high = (np.array([pick(values) for values in every]) / ARCSEC for pick in (min, max))
        mean = np.array([sum(values) / len(values) for values in every]) / ARCSEC
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
        series.append(_drawn(f"run {members[-1].run.run_id}, the newest", spectra[-1], 1))
    words = f" ({', '.join(conditions)})" if several else ""
    return Plot(
        name="passport-order-spectrum",
        title=f"Order spectrum of the kinematic error{words}",
        x_label="order [cycles per input revolution]",
        y_label="amplitude [arcsec]",
        series=tuple(series),
        y_scale="log",
        note=ORIGIN_WORDS.get(origin, ""),
    )


def _drawn(label: str, spectrum: Mapping[float, tuple[float, float]], group: int) -> Series:
    orders = np.array(sorted(spectrum))
    values = np.array([spectrum[order] for order in orders]) / ARCSEC
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


def _spectrum(one: FoundRun) -> dict[float, tuple[float, float]]:
    """Amplitude and U by order, of the orders that the run identified and whose label is an order."""
    ratio = one.analysis.result.get("options", {}).get("ratio")
    found: dict[float, tuple[float, float]] = {}
    for name, estimate in one.estimates.items():
        order = (
            order_of(name.removeprefix("amplitude_"), ratio)
            if name.startswith("amplitude_")
            else math.nan
        )
        if math.isfinite(order) and _shown(estimate):
            u = estimate.get("expanded_uncertainty")
            found[order] = (float(estimate["value"]), float(u) if u is not None else 0.0)
    return found


def _shown(estimate: Mapping[str, Any]) -> bool:
    value = estimate.get("value")
    return value is not None and value > 0.0 and estimate.get("identifiability") != "no"


def point_table(series: PassportSeries) -> Table:
    """The points of a series in the unit of the laboratory."""
    unit, factor = series.display_unit, series.factor
    columns = ("#", "run", "day", f"value [{unit}]", f"U (k = 2) [{unit}]", "signals", "remarks")
    rows = tuple(
        (
            point.position,
            point.run,
            point.start[:10],
            point.value / factor,
            point.expanded_uncertainty / factor,
            ", ".join(point.signals),
            "; ".join(point.remarks),
        )
        for point in series.points
    )
    return Table(f"passport-{series.quantity}", series.title, columns, rows, " ".join(series.notes))
