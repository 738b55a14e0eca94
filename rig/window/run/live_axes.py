"""The axes of live plots: they change in steps, so that most frames need no new axis and no new numbers beside it.

A look that somebody chose with the mouse stays until the whole or the latest is asked for again.
"""

from __future__ import annotations

import math

import numpy as np

from rig.window.plot.plots import LabPlot

RECENT = 20.0
"""s that "latest" shows."""
GROWTH = 1.2
"""How far a time axis reaches beyond the run when it has to grow."""
_HEADROOM = 0.08
"""Share of the height of the data that stays free above and below when a value axis is made anew."""
_LEAST_FILLED = 0.5
"""Share of a value axis that the data fill at least; under it the axis is made anew."""
_FLAT = 1e-12
"""Height over size of a signal that counts as constant: it gets half a unit each way."""


class TimeAxis:
    """The time axis of a live plot: the whole run so far, or its latest seconds."""

    def __init__(self, plot: LabPlot, least: float = 5.0) -> None:
        self._plot, self._end, self._least = plot, 0.0, least
        self._shown: tuple[float, float] | None = None
        self._recent: bool | None = None
        self._is_chosen = False
        plot.item.enableAutoRange(x=False)
        plot.item.getViewBox().sigRangeChangedManually.connect(self._leave)

    def follow(self, now: float, recent: bool) -> None:
        """Show the run up to now [s], or its latest seconds."""
        if recent != self._recent:
            self._recent, self._is_chosen, self._shown = recent, False, None
            self._plot.item.enableAutoRange(x=False)
        if recent:
            end = math.ceil(now)
            wanted = (end - RECENT, float(end))
        else:
            if now > self._end:
                self._end = max(GROWTH * now, self._least)
            wanted = (-0.02 * self._end, self._end)
        if wanted != self._shown and not self._is_chosen:
            self._shown = wanted
            self._plot.item.setXRange(*wanted, padding=0.0)

    def _leave(self, *_: object) -> None:
        self._is_chosen = True


class ValueAxis:
    """The value axis of a live plot: everything that is drawn, with some room. It is made anew when
    something would leave it,
    or when the data fill less than half of it."""

    def __init__(self, plot: LabPlot) -> None:
        self._plot = plot
        self._shown: tuple[float, float] | None = None
        self._recent: bool | None = None
        self._is_chosen = False
        plot.item.enableAutoRange(y=False)
        plot.item.getViewBox().sigRangeChangedManually.connect(self._leave)

    def follow(self, recent: bool = False) -> None:
        """Show all that the curves of the plot hold now; `recent` as it is drawn: a change of it
        ends a look by hand.
        """
        if recent != self._recent:
            self._recent, self._is_chosen, self._shown = recent, False, None
            self._plot.item.enableAutoRange(y=False)
        bounds = None if self._is_chosen else self._bounds()
        if bounds is None:
            return
        low, high = bounds
        if high - low <= _FLAT * max(abs(low), abs(high), 1.0):
            low, high = low - 0.5, high + 0.5
        if self._shown is not None:
            bottom, top = self._shown
            if bottom <= low and high <= top and high - low >= _LEAST_FILLED * (top - bottom):
                return
        room = _HEADROOM * (high - low)
        self._shown = (low - room, high + room)
        self._plot.item.setYRange(*self._shown, padding=0.0)

    def _bounds(self) -> tuple[float, float] | None:
        """The smallest and the largest value that is drawn."""
        low, high = math.inf, -math.inf
        for item in self._plot.item.listDataItems():
            values = item.getData()[1]
            if values is not None and len(values):
                low, high = (
                    min(low, float(np.fmin.reduce(values))),
                    max(high, float(np.fmax.reduce(values))),
                )
        return (low, high) if low <= high and math.isfinite(high - low) else None

    def _leave(self, *_: object) -> None:
        self._is_chosen = True
