"""How one series of a figure is drawn: lines, steps, bands, points and bars, each in the look of its group."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments.result import Series
from rig.present.decimate import peak_rows, scatter_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#8A6D00", "#3B3B3B", "#7A4FBF")
"""Colours of the groups: after Okabe and Ito 2008, without the yellow that white paper swallows."""
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.2, 1.6)), (0, (6, 1.5, 1.2, 1.5)), (0, (3, 1)))

CROWDED_POINTS = 120
"""More scattered points than this are drawn as small dots."""
_VECTOR_POINTS = 1500
"""More scattered points than this are painted as an image inside the SVG."""

INK = "#1F2328"
NULL, LIMIT = "#8C959F", "#9B1C1C"
"""Colours of null models and of limits: those of no group."""


def edges_of(series: Series) -> list[NDArray[np.float64]]:
    """The values of a series, and the ends of its bars or its band."""
    return [edge for edge in (series.y, series.low, series.high) if edge is not None]


@dataclass(frozen=True)
class Look:
    """How one series looks among the others: colour by group, marker by group, dash by place in the group."""

    colour: str
    marker: str
    dash: Any
    shift: float
    """Points by which bars stand beside those of the other series."""
    foot: float
    """Where bars begin: zero, or below the smallest of them on a logarithmic axis."""
    behind: bool = False
    """Whether it lies under everything else, in a thin line."""

    @property
    def zorder(self) -> float:
        """How far up its line lies."""
        return 1.6 if self.behind else 2.4


def look_of(all_series: Sequence[Series], number: int, logarithmic: bool) -> Look:
    series = all_series[number]
    groups = list(dict.fromkeys(s.group for s in all_series if s.role == "data"))
    earlier = sum(
        (s.group == series.group or s.role == "null")
        and (s.role, s.panel) == (series.role, series.panel)
        and s.style in ("line", "steps")
        for s in all_series[:number]
    )
    barred = [i for i, s in enumerate(all_series) if s.style == "bars"]
    shift = 3.2 * (barred.index(number) - 0.5 * (len(barred) - 1)) if number in barred else 0.0
    own = PALETTE[series.group % len(PALETTE)]
    place = groups.index(series.group) if series.group in groups else 0
    return Look(
        colour={"null": NULL, "limit": LIMIT}.get(series.role, own),
        marker=_MARKERS[place % len(_MARKERS)],
        dash=_DASHES[1 if series.role == "limit" else earlier % len(_DASHES)],
        shift=shift,
        foot=foot_of(all_series) if logarithmic else 0.0,
        behind=series.role == "null",
    )


def foot_of(all_series: Sequence[Series]) -> float:
    """Where bars on a logarithmic axis begin: below the smallest of them."""
    heights = np.concatenate([s.y for s in all_series if s.style == "bars"] or [np.ones(1)])
    heights = heights[np.isfinite(heights) & (heights > 0)]
    return 0.4 * float(heights.min()) if len(heights) else 1.0


def _line(axes: Axes, series: Series, look: Look, bins: int) -> None:
    rows = peak_rows(series.y, bins)
    if series.low is not None and series.high is not None:
        rows = np.unique(
            np.concatenate([rows, peak_rows(series.low, bins), peak_rows(series.high, bins)])
        )
        axes.fill_between(
            series.x[rows], series.low[rows], series.high[rows], color=look.colour, alpha=0.18, lw=0
        )
    width = 1.1 if len(series.y) < 4000 and not look.behind else 0.8
    axes.plot(
        series.x[rows],
        series.y[rows],
        ls=look.dash,
        lw=width,
        color=look.colour,
        label=series.label,
        zorder=look.zorder,
    )


def _steps(axes: Axes, series: Series, look: Look, bins: int) -> None:
    rows = peak_rows(series.y, bins)
    axes.step(
        series.x[rows],
        series.y[rows],
        where="post",
        ls=look.dash,
        lw=0.8 if look.behind else 1.1,
        color=look.colour,
        label=series.label,
        zorder=look.zorder,
    )


def _points(axes: Axes, series: Series, look: Look, bins: int) -> None:
    many, crowded = len(series.y) > _VECTOR_POINTS, len(series.y) > CROWDED_POINTS
    rows = np.arange(len(series.y))
    # Points lie under lines: where there are many of them the curve through them must still be seen.
    style: dict[str, Any] = {"ls": "none", "marker": look.marker, "ms": 3.4, "mew": 0.7}
    style |= {"color": look.colour, "mfc": "white", "label": series.label, "zorder": 2.0}
    if crowded:
        style |= {"marker": "o", "ms": 2.6, "mew": 0.0, "mfc": look.colour}
    if many:
        rows = scatter_rows(series.x, series.y)
        style["ms"] = 1.2
    if series.low is None or series.high is None or many:
        axes.plot(
            series.x[rows], series.y[rows], rasterized=many, alpha=0.55 if crowded else 1.0, **style
        )
        return
    style["elinewidth"] = 0.9
    axes.errorbar(series.x[rows], series.y[rows], yerr=_arms(series, rows), capsize=1.8, **style)


HISTOGRAM_WIDTH = 0.96
"""Of its bin that a bar fills."""


def is_histogram(x: NDArray[np.float64], y: NDArray[np.float64]) -> bool:
    """Whether bars count things in equal bins: those are read by their areas, and stand side by side."""
    steps = np.diff(x)
    return bool(
        len(steps) and np.allclose(steps, steps[0], rtol=1e-6) and np.array_equal(y, np.round(y))
    )


def _bars(axes: Axes, series: Series, look: Look, bins: int) -> None:
    from matplotlib.transforms import ScaledTranslation

    figure = axes.get_figure(root=True)
    assert figure is not None
    beside = axes.transData + ScaledTranslation(look.shift / 72.0, 0.0, figure.dpi_scale_trans)
    rows = peak_rows(series.y, bins)
    if is_histogram(series.x, series.y):
        width = HISTOGRAM_WIDTH * float(np.diff(series.x[:2])[0])
        axes.bar(series.x, series.y, width=width, color=look.colour, label=series.label)
        return
    axes.vlines(
        series.x[rows],
        look.foot,
        series.y[rows],
        color=look.colour,
        lw=2.0,
        transform=beside,
        label=series.label,
    )
    if series.low is not None and series.high is not None:
        low, high = _arms(series, rows)
        axes.vlines(
            series.x[rows],
            series.y[rows] - low,
            series.y[rows] + high,
            color=INK,
            lw=0.8,
            transform=beside,
            zorder=3,
        )
    axes.update_datalim(np.column_stack([series.x[rows], np.nan_to_num(series.y[rows])]))
    axes.update_datalim([(float(np.nanmin(series.x)), look.foot)])
    axes.autoscale_view()
    if axes.get_yscale() == "log":
        axes.set_ylim(bottom=look.foot)


def _arms(series: Series, rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Lengths (2, n) of the error bars below and above the points."""
    assert series.low is not None
    assert series.high is not None
    y = series.y[rows]
    return np.nan_to_num(np.maximum([y - series.low[rows], series.high[rows] - y], 0.0))


PAINTERS: dict[str, Callable[[Axes, Series, Look, int], None]] = {
    "line": _line,
    "band": _line,
    "steps": _steps,
    "points": _points,
    "bars": _bars,
}
