"""The limits that a gear was held against, drawn into the figures of its quantities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from experiments.protocols.friction.quantities import at_reference
from experiments.result import Plot, Series, Verdict
from rig.analysis.fit.recorded import Fit
from rig.present.paper_figures import paper_figures

_MARK = 0.06
"""Half the length of a limit's line over the speed at which it holds, as a share of the largest speed."""


def with_limits(fit: Fit, lines: Sequence[Verdict]) -> Fit:
    """A fit whose figures show the limits that its quantities were held against."""
    own = [line for line in lines if (line.run, line.kind) == (fit.result.run, fit.result.kind)]
    plots = tuple(_limited(plot, own) for plot in paper_figures(fit.result.plots))
    return replace(fit, result=replace(fit.result, plots=plots))


def _limited(plot: Plot, lines: Sequence[Verdict]) -> Plot:
    if plot.name == "friction-curve":
        return replace(plot, series=(*plot.series, *_torque_limits(plot, lines)))
    if plot.name == "transmission-accuracy":
        return replace(plot, series=(*plot.series, *_accuracy_limits(plot, lines)))
    return plot


def _torque_limits(plot: Plot, lines: Sequence[Verdict]) -> Iterator[Series]:
    """Limits of the running torque, each a short line at its speed."""
    reach = _MARK * max(float(series.x.max()) for series in plot.series if len(series.x))
    said: set[str] = set()
    for line in lines:
        speed, _, reference = line.estimate.name.removeprefix("running_torque_").partition("_rpm")
        if not line.estimate.name.startswith("running_torque_") or not speed.isdigit():
            continue
        label = "limit at 20 °C" if reference == at_reference("") else "limit"
        yield Series(
            label="" if label in said else label,
            x=float(speed) + np.array([-reach, reach]),
            y=np.full(2, line.limit * 1e3),
            role="limit",
        )
        said.add(label)


def _accuracy_limits(plot: Plot, lines: Sequence[Verdict]) -> Iterator[Series]:
    """The band of the transmission accuracy about the middle of each direction's curve."""
    from model.units import ARCMIN

    said = False
    for line in lines:
        way = line.quantity.member(line.estimate.name)
        curve = next((series for series in plot.series if series.label == way), None)
        if curve is None or not line.is_upper:
            continue
        middle = 0.5 * float(curve.y.max() + curve.y.min())
        for side in (-0.5, 0.5):
            yield Series(
                label="" if said else "limit of the peak to peak",
                x=np.array([curve.x.min(), curve.x.max()]),
                y=np.full(2, middle + side * line.limit / ARCMIN),
                role="limit",
                panel=curve.panel,
            )
            said = True
