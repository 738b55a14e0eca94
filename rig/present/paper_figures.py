"""Which figures of a result stand on paper: of several alike the one that says most; the window shows all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from experiments.result import Plot

TWICE = frozenset({"friction-curve-low"})
"""Figures that another one shows enlarged beside itself."""
STEP = "velocity-step-"
"""How the figures of single speeds begin: all of them are one picture, beside which the worst told one stands alone."""


def paper_figures(plots: Sequence[Plot]) -> Iterator[Plot]:
    """The figures for paper, in their order."""
    steps = [plot for plot in plots if plot.name.startswith(STEP)]
    worst = max(steps, key=_left_of, default=None)
    for plot in plots:
        if plot.name in TWICE or (plot.name.startswith(STEP) and plot is not worst):
            continue
        yield plot


def _left_of(plot: Plot) -> float:
    """What is left of a step over its height, root mean square."""
    height = float(np.abs(plot.of_panel(0)[-1].y).max())
    left = plot.of_panel(1)[-1].y
    return float(np.sqrt(np.mean(left**2))) / height if height > 0.0 else 0.0
