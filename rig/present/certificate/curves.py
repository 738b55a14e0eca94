"""The curves of a certificate: those after the paper's figures, with the limits of the acceptance file in them, and
the control charts of a gear that has a history.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from experiments.protocols.friction.quantities import at_reference
from experiments.result import Plot, Series, Verdict
from rig.analysis.fit import Fit
from rig.analysis.passport.build import passport
from rig.content.data import data_grid
from rig.content.page import Figure, Section
from rig.present.certificate.gather import CHARTED_FROM, Certified
from rig.present.report import figures_of

PAPER = ("9", "12", "13", "16", "17", "19")
"""The figures of the paper that a certificate shows, in their order."""
TWICE = frozenset({"friction-curve-low"})
"""Figures that another one shows enlarged beside itself."""
_MARK = 0.06
"""Half the length of a limit's line over the speed at which it holds, as a share of the largest speed."""


def with_limits(fit: Fit, lines: Sequence[Verdict]) -> Fit:
    """A fit whose figures show the limits that its quantities were held against."""
    own = [line for line in lines if (line.run, line.kind) == (fit.result.run, fit.result.kind)]
    plots = tuple(_limited(plot, own) for plot in fit.result.plots if plot.name not in TWICE)
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


def paper_curves(fits: Sequence[Fit], before: int) -> list[tuple[Figure, Plot]]:
    """The figures after the paper's, in its order, numbered after `before`."""
    figures_and_plots: list[tuple[Figure, Plot]] = []
    for wanted in PAPER:
        for fit in fits:
            plots = [plot for plot in fit.result.plots if plot.figure == wanted]
            origin = fit.recording.metadata.origin
            figures_and_plots += figures_of(plots, origin, before + len(figures_and_plots))
    return figures_and_plots


def without_paper(fit: Fit) -> Fit:
    """A fit with the figures that stand nowhere else in the certificate."""
    plots = tuple(plot for plot in fit.result.plots if plot.figure not in PAPER)
    return replace(fit, result=replace(fit.result, plots=plots))


def chart_part(gathered: Certified, before: int) -> Section | None:
    """The control charts of all quantities that enough runs tell of; None while there are too few runs."""
    if not gathered.has_charts:
        return None
    record = passport(gathered.folder, gathered.serial)
    charted = [one for one in record.series if len(one.points) >= CHARTED_FROM]
    if not charted:
        return None
    figures: list[Figure] = []
    for one in charted:
        plot = replace(one.plot, title=f"{one.title}: {one.state}")
        figures += [figure for figure, _ in figures_of([plot], one.origin, before + len(figures))]
    tables = zip(record.series, record.tables, strict=True)
    return Section(
        title="Control charts",
        anchor="charts",
        figures=tuple(figures),
        annex=tuple(data_grid(table) for one, table in tables if one in charted),
    )


def curve_part(figures: Sequence[Figure]) -> Section:
    """The curves after the paper's figures as a part of the certificate."""
    title = "Curves after the paper's figures"
    return Section(title=title, anchor="curves", figures=tuple(figures))
