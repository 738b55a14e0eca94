"""Spectrum and table of the orders of a channel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.result import Plot, Series, Table, way_of
from model.identify.orders.by_speed import ChangingOrder
from model.identify.orders.fit import OrdersFit
from model.units import DEGREE

MOST_POINTS = 20_000
"""Of a curve: of a longer one the largest of neighbours is drawn."""


def spectrum_plot(
    fit: OrdersFit, channel: str, unit: str, angle_name: str, name: str = "order-spectrum"
) -> Plot:
    """The amplitude over the order with nothing but trends taken out, and the noise floor of what the fit leaves."""
    series: list[Series] = []
    for d, (orders, amplitude) in fit.spectrum.items():
        x, y = _thinned(orders, amplitude)
        series.append(Series(label=way_of(d), x=x, y=y, style="line", group=int(d <= 0)))
    for d, (orders, floor) in fit.floor.items():
        x, y = _thinned(orders, floor)
        label = f"noise floor, {way_of(d)}"
        series.append(Series(label=label, x=x, y=y, style="line", group=2 + int(d <= 0)))
    return Plot(
        name=name,
        title=f"Orders of the {channel.replace('_', ' ')}",
        x_label=f"order per revolution of the {angle_name.replace('_', ' ')}",
        y_label=f"amplitude [{unit}]",
        series=tuple(series),
        y_scale="log",
        note="The amplitude of each order of the angle, on a logarithmic scale. What stands out of its neighbours is "
        "periodic in the angle; the floor is noise.",
    )


def by_speed_plots(
    changing: Mapping[int, tuple[ChangingOrder, ...]], channel: str, unit: str
) -> tuple[Plot, ...]:
    """The amplitude over the speed of orders whose amplitude changes with it; no plot where none does."""
    series: list[Series] = []
    for direction, orders in changing.items():
        for one in orders:
            speed = np.linspace(one.slow, one.fast, 101)
            label = f"order {one.order:.6g}, {way_of(direction)}"
            series.append(Series(label=label, x=speed, y=one.amplitude(speed), group=len(series)))
    if not series:
        return ()
    title = f"Orders of the {channel.replace('_', ' ')} whose amplitude changes with speed"
    return (
        Plot(
            name="amplitude-over-speed",
            title=title,
            x_label="speed of the angle [rad/s]",
            y_label=f"amplitude [{unit}]",
            series=tuple(series),
            note="Orders that grow or fall with the speed, each a parabola over it, fitted with all others. One that "
            "grows towards an end nears a resonance there.",
        ),
    )


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest of neighbours where there are too many points."""
    share = -(-len(x) // MOST_POINTS)
    if share <= 1:
        return x, y
    whole = len(x) // share * share
    rows = y[:whole].reshape(-1, share)
    return x[:whole].reshape(-1, share)[np.arange(len(rows)), rows.argmax(axis=1)], rows.max(axis=1)


def orders_table(fit: OrdersFit, unit: str) -> Table:
    """Every order in each direction, strongest first, with its standard uncertainties."""
    rows: list[tuple[float | int | str, ...]] = []
    for order in fit.orders:
        for d, wave in order.waves.items():
            u = float(np.sqrt(0.5 * np.trace(wave.covariance)))
            u_order = order.line.uncertainty
            rows.append((way_of(d), order.order, u_order, wave.amplitude, u, wave.phase / DEGREE))
    columns = (
        "direction",
        "order",
        "u of the order",
        f"amplitude [{unit}]",
        f"u of the amplitude [{unit}]",
        "phase [deg]",
    )
    note = "u of the order is 0 for one that cannot be told from a whole order, or from one of the gear's lattice."
    return Table(
        "orders", "Orders that rise above the noise, strongest first", columns, tuple(rows), note
    )
