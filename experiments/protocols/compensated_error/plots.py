"""Before and after as data: over the output's turn, order by order, by speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.protocols.compensated_error.turns import Turn, waves_of
from experiments.result import Panel, Plot, Series
from model.arrays import FloatArray
from model.compensation import CompensationTable
from model.units import ARCSEC, RPM

_POINTS = 2880
_WITHOUT, _WITH, _PREDICTED = "without the table", "with the table", "predicted with the table"


def _first(turns: Sequence[Turn], direction: float, is_compensated: bool) -> Turn | None:
    return next(
        (t for t in turns if t.is_compensated is is_compensated and t.speed * direction > 0.0),
        None,
    )


def _curve(turn: Turn, phi: FloatArray) -> FloatArray:
    """The orders of the output's deviation over the nominal angle [arcsec]."""
    orders, waves = turn.output.basis.orders, waves_of(turn.output)
    total = np.zeros_like(phi)
    for order, wave in zip(orders, waves, strict=True):
        total += wave.real * np.cos(order * phi) - wave.imag * np.sin(order * phi)
    return total / ARCSEC


def over_output(turns: Sequence[Turn], table: CompensationTable) -> Plot:
    """The output's deviation from the nominal angle over N, over one output turn, a panel for each direction."""
    phi = np.linspace(0.0, 2.0 * np.pi * table.ratio, _POINTS)
    degrees = np.degrees(phi / table.ratio)
    series: list[Series] = []
    for panel, direction in enumerate((1.0, -1.0)):
        for group, (is_compensated, label) in enumerate(((False, _WITHOUT), (True, _WITH))):
            turn = _first(turns, direction, is_compensated)
            if turn is not None:
                series.append(
                    Series(
                        label=label if panel == 0 else "",
                        x=degrees,
                        y=_curve(turn, phi),
                        group=group,
                        panel=panel,
                    )
                )
    return Plot(
        name="compensated-error",
        title="Output error without and with the table",
        x_label="nominal output angle from the index marks [°]",
        y_label="forward [arcsec]",
        series=tuple(series),
        panels=(Panel("reverse [arcsec]", 1.0),),
        note=f"The gear's fitted error over a turn at {abs(turns[0].speed) / RPM:.4g} r/min, its constant left out. "
        "Good where the line with the table is flat.",
    )


def by_order(turns: Sequence[Turn], table: CompensationTable) -> Plot:
    """Amplitude of every order without and with the table, forward."""
    series: list[Series] = []
    for group, (is_compensated, label) in enumerate(((False, _WITHOUT), (True, _WITH))):
        turn = _first(turns, 1.0, is_compensated) or _first(turns, -1.0, is_compensated)
        if turn is not None:
            amplitudes = np.abs(waves_of(turn.output)) / ARCSEC
            series.append(
                Series(
                    label=label,
                    x=np.array(turn.output.basis.orders),
                    y=amplitudes,
                    style="bars",
                    group=group,
                )
            )
    return Plot(
        name="compensated-orders",
        title="Orders without and with the table",
        x_label="order (cycles per input revolution)",
        y_label="amplitude [arcsec]",
        series=tuple(series),
        note=f"What each of the {len(table.forward.labels)} orders of the table becomes at "
        f"{abs(turns[0].speed) / RPM:.4g} r/min. Good where the bars with it are far below those without.",
    )


def by_speed(rows: Sequence[tuple[float, float, float, float]]) -> Plot:
    """R.m.s. over the input speed: without, with, predicted."""
    speed, without, beside, predicted = np.array(rows, dtype=np.float64).T
    labels = ((_WITHOUT, without, 0), (_WITH, beside, 1))
    series = [
        Series(label=label, x=speed / RPM, y=y / ARCSEC, style="points", group=group)
        for label, y, group in labels
    ]
    series.append(
        Series(
            label=_PREDICTED,
            x=speed / RPM,
            y=predicted / ARCSEC,
            style="line",
            role="null",
            group=2,
        )
    )
    return Plot(
        name="compensated-by-speed",
        title="Where the table helps and where it harms",
        x_label="input speed [r/min]",
        y_label="r.m.s. [arcsec]",
        series=tuple(series),
        x_scale="log",
        y_scale="log",
        note="What is left without and with the table at each speed. Good below the speed at which the two meet: "
        "beyond it the table harms.",
    )
