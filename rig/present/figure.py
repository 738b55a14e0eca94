"""Figures: a `Plot` (data) drawn as SVG for the page or as PNG, the same bytes for the same data.

Drawn with matplotlib's object interface (no pyplot, no global state), in colours that the colour-blind can tell apart,
with the legend outside the axes so that it hides nothing. Figures of runs that do not come from hardware carry
SIMULATED, REPLAY or IMPORTED across the data.
"""

from __future__ import annotations

import io
import re
import textwrap
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.result import Plot
from rig.content.wording import printable
from rig.present.series import INK, PAINTERS, edges_of, look_of
from rig.runfile.header import ORIGIN_WORDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FULL_WIDTH = (7.1, 2.8)
HALF_WIDTH = (3.5, 2.5)
"""Width and height [inch]: the whole text width of A4, and half of it; of the first panel."""
_TALL = 0.75
"""Share of the first panel's height that a panel of its full share adds: the axis of x is there once."""
LETTER_WIDTH, SIGN = 0.0084, 0.42
"""Width [inch] of a letter of one point, and of the sign and the gap before it in a legend."""
NUMERAL, CHARACTER = 0.067, 0.066
"""Width [inch] of a numeral at an axis, and of a letter of its label."""
_WIDTHS = {".": 0.034, "\N{MINUS SIGN}": 0.088, "e": 0.065}
EDGE, UNDER, GAP, LETTER, LINE = 0.08, 0.44, 0.1, 0.16, 0.17
"""Room [inch] at the edge of a figure, under its panels, between them; a letter, a line of the legend."""
MARKED = 0.8
"""Share of the first panel's height from which the word of the origin stands in a further one too."""
BESIDE = (2.4, 1.0)
"""Widths of a figure and of what it shows enlarged beside it."""

GRID, FAINT = "#D9DDE1", "#6A737D"
_STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.0,
    "text.parse_math": False,
    "text.color": INK,
    "axes.edgecolor": "#8C959F",
    "axes.labelcolor": INK,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "xtick.color": "#8C959F",
    "ytick.color": "#8C959F",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "path.simplify": False,
    "agg.path.chunksize": 20000,
}


@dataclass(frozen=True)
class Drawing:
    """A figure as it stands in a page: SVG text, its size [px of 96 per inch] and what a reader must know about it."""

    svg: str
    width: float
    height: float
    remarks: tuple[str, ...] = ()


def draw_svg(
    plot: Plot, origin: str, identifier: str, size: tuple[float, float] = FULL_WIDTH
) -> Drawing:
    """A plot as one inline SVG element, the same bytes for the same data.

    `origin` is that of the run (the watermark); `identifier` keeps the ids of several figures in one page apart.
    """
    import matplotlib

    plot, remarks = _drawable(plot)
    size = _size_of(plot, size)
    style: Any = {**_STYLE, "svg.hashsalt": identifier}
    with matplotlib.rc_context(style):
        figure = _draw(plot, origin, size, "")
        svg = _saved(figure, format="svg", dpi=220, metadata={"Date": None, "Creator": None})
    label = " ".join(
        part for part in (plot.title, f"({plot.x_label}; {plot.y_label})", plot.note) if part
    )
    return Drawing(_inline(svg.decode(), identifier, label), size[0] * 96, size[1] * 96, remarks)


def drawn_by(
    draw: Callable[[Figure], None],
    identifier: str,
    label: str,
    size: tuple[float, float],
    style: Mapping[str, Any],
) -> str:
    """What a function draws on an empty figure as one inline SVG element, in the look of all figures and `style`."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen: Any = {**_STYLE, **style, "svg.hashsalt": identifier}
    with matplotlib.rc_context(chosen):
        figure = Figure(figsize=size)
        FigureCanvasAgg(figure)
        draw(figure)
        svg = _saved(figure, format="svg", dpi=220, metadata={"Date": None, "Creator": None})
    return _inline(svg.decode(), identifier, label)


def draw_png(
    plot: Plot, origin: str, size: tuple[float, float] = FULL_WIDTH, dpi: float = 160.0
) -> bytes:
    """A plot as PNG with its title, to stand alone in a document or a folder."""
    import matplotlib

    plot, _ = _drawable(plot)
    size = _size_of(plot, size)
    with matplotlib.rc_context(_STYLE):
        figure = _draw(plot, origin, (size[0], size[1] + 0.3), plot.title)
        return _saved(figure, format="png", dpi=dpi, metadata={"Software": None})


def draw_figure(plot: Plot, origin: str, size: tuple[float, float] = FULL_WIDTH) -> Figure:
    """A plot as a matplotlib figure with its title, for a script or a notebook to show, save or change."""
    import matplotlib

    plot, _ = _drawable(plot)
    size = _size_of(plot, size)
    with matplotlib.rc_context(_STYLE):
        return _draw(plot, origin, (size[0], size[1] + 0.3), plot.title)


def _size_of(plot: Plot, size: tuple[float, float]) -> tuple[float, float]:
    """Width and height [inch] of a figure with all its panels; `size` is that of the first one."""
    return size[0], size[1] * (1.0 + _TALL * sum(panel.share for panel in plot.panels))


def _saved(figure: Figure, **output: Any) -> bytes:
    """A figure in a format of a file; a letter that the face does not have stands as a box."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(buffer, **output)
    return buffer.getvalue()


def _drawable(plot: Plot) -> tuple[Plot, tuple[str, ...]]:
    """The plot without what a logarithmic axis or a page cannot show, and the sentences that say so."""
    plot, remarks = without_what_logs_lose(plot)
    series = tuple(replace(one, label=printable(one.label)) for one in plot.series)
    words = {
        name: printable(getattr(plot, name)) for name in ("title", "x_label", "y_label", "note")
    }
    panels = tuple(replace(panel, y_label=printable(panel.y_label)) for panel in plot.panels)
    return replace(plot, series=series, panels=panels, **words), remarks


def without_what_logs_lose(plot: Plot) -> tuple[Plot, tuple[str, ...]]:
    """The figure without values that a logarithmic axis has no place for, and the sentences that say so."""
    drawable, remarks = [], []
    for series in plot.series:
        x, y = np.asarray(series.x, dtype=float).ravel(), np.asarray(series.y, dtype=float).ravel()
        good = np.ones(len(x), dtype=bool)
        if plot.x_scale == "log":
            good &= ~(x <= 0)
        if plot.y_scale == "log" and not series.panel:
            good &= ~(y <= 0)
        lost = int(len(x) - good.sum())
        if lost:
            remarks.append(
                f"{lost} values of “{series.label}” are not positive and have no place on a logarithmic axis."
            )
        low, high = (
            None if a is None else np.asarray(a, dtype=float).ravel()[good]
            for a in (series.low, series.high)
        )
        drawable.append(replace(series, x=x[good], y=y[good], low=low, high=high))
    return replace(plot, series=tuple(drawable)), tuple(remarks)


def _draw(plot: Plot, origin: str, size: tuple[float, float], title: str) -> Figure:
    """The matplotlib figure of a plot: its panels under each other over one x, what is enlarged beside the first."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size)
    FigureCanvasAgg(figure)
    shares = [1.0, *(panel.share for panel in plot.panels)]
    widths = BESIDE if plot.enlarged else (1.0,)
    grid = figure.add_gridspec(len(shares), len(widths), height_ratios=shares, width_ratios=widths)
    first = figure.add_subplot(grid[0, 0])
    lower = [figure.add_subplot(grid[k, 0], sharex=first) for k in range(1, len(shares))]
    scales = [plot.y_scale, *("linear" for _ in lower)]
    labels = [plot.y_label, *(panel.y_label for panel in plot.panels)]
    for panel, axes in enumerate((first, *lower)):
        axes.set_xscale(plot.x_scale)
        axes.set_yscale(scales[panel])
        axes.set_ylabel(labels[panel])
        if shares[panel] >= MARKED:
            _watermark(axes, origin, size)
        _paint(axes, plot, panel, int(100 * size[0]))
        if axes is not (first, *lower)[-1]:
            axes.tick_params(labelbottom=False)
        _ticks(axes, plot, scales[panel])
    (first, *lower)[-1].set_xlabel(plot.x_label)
    above = heading = 0.0
    if any(np.isfinite(s.y).any() for s in plot.series):
        above = LINE * _legend(first, lower, plot, size)
    beside = None
    if plot.enlarged:
        beside = figure.add_subplot(grid[:, 1])
        _enlarge(beside, first, plot)
        above = max(above, LINE)
    if title:
        heading = 0.3
        figure.text(0.02, 1.0 - 0.08 / size[1], title, va="top", fontsize=9.0, fontweight="bold")
    _lay_out(figure, (first, *lower), beside, plot, _Margins(above, heading))
    return figure


@dataclass(frozen=True)
class _Margins:
    """Room around the panels [inch]: above them for the legend, and for a title."""

    legend: float
    title: float


def _lay_out(
    figure: Figure, panels: Sequence[Axes], beside: Axes | None, plot: Plot, margins: _Margins
) -> None:
    """Give every part its room: numbers and words outside the panels, panels of one width under each other.

    By hand, because matplotlib's own layout takes longer than all the drawing.
    """
    width, height = figure.get_size_inches()
    top = height - margins.title - margins.legend - EDGE
    shares = [1.0, *(panel.share for panel in plot.panels)]
    unit = (top - UNDER - GAP * (len(shares) - 1)) / sum(shares)
    lines = max(_fold_label(a, unit * share) for a, share in zip(panels, shares, strict=True))
    left = _beside_numbers(panels) + (lines + 0.4) * LETTER
    right = width - EDGE
    if beside is not None:
        room = _beside_numbers([beside])
        whole = right - left - room - GAP
        inner = whole * BESIDE[1] / sum(BESIDE)
        beside.set_position(
            ((right - inner) / width, UNDER / height, inner / width, (top - UNDER) / height)
        )
        right -= inner + room + GAP
    for axes, share in zip(panels, shares, strict=True):
        size = unit * share
        place = (left / width, (top - size) / height, (right - left) / width, size / height)
        axes.set_position(place)
        axes.yaxis.set_label_coords((lines * LETTER - left) / (right - left), 0.5)
        top -= size + GAP


def _fold_label(axes: Axes, height: float) -> int:
    """Break the label of a panel of this height [inch] into lines that are no longer; how many they are."""
    whole = re.sub(r"\[[^\]]*\]", lambda unit: unit[0].replace(" ", "\u00a0"), axes.get_ylabel())
    text = textwrap.fill(whole, max(int(height / CHARACTER), 8), break_long_words=False)
    axes.set_ylabel(text)
    return text.count("\n") + 1


def _beside_numbers(panels: Sequence[Axes]) -> float:
    """Room [inch] for the numbers left of these axes."""
    texts = [label.get_text() for axes in panels for label in axes.yaxis.get_majorticklabels()]
    widest = max((sum(_WIDTHS.get(c, NUMERAL) for c in text) for text in texts), default=0.0)
    return widest + 0.1


def _paint(axes: Axes, plot: Plot, panel: int, bins: int) -> None:
    """The series of one panel."""
    if not any(np.isfinite(s.y).any() for s in plot.of_panel(panel)):
        words: dict[str, Any] = {"ha": "center", "va": "center", "color": FAINT}
        axes.text(0.5, 0.5, "no data", transform=axes.transAxes, **words)
        return
    logarithmic = plot.y_scale == "log" and not panel
    for number, series in enumerate(plot.series):
        if series.panel == panel:
            PAINTERS[series.style](axes, series, look_of(plot.series, number, logarithmic), bins)
    axes.margins(x=0.02, y=0.06)


def _enlarge(axes: Axes, whole: Axes, plot: Plot) -> None:
    """A range of x of the first panel once more, with the room that its values need."""
    assert plot.enlarged is not None
    low, high = plot.enlarged
    _paint(axes, plot, 0, 200)
    inside = [
        np.concatenate([edge[(series.x >= low) & (series.x <= high)] for edge in edges_of(series)])
        for series in plot.of_panel(0)
    ]
    values = np.concatenate(inside)
    values = values[np.isfinite(values)]
    if len(values):
        spare = 0.08 * float(np.ptp(values)) or 1.0
        axes.set_ylim(float(values.min()) - spare, float(values.max()) + spare)
    axes.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    axes.set_title("the same, enlarged", fontsize=7.5, color=FAINT, loc="left")
    axes.set_xlabel(plot.x_label)
    bottom, top = axes.get_ylim()
    whole.indicate_inset((low, bottom, high - low, top - bottom), edgecolor=FAINT, linewidth=0.7)


def _legend(first: Axes, lower: Sequence[Axes], plot: Plot, size: tuple[float, float]) -> int:
    """The legend of all panels above the first one, in as many columns as fit: it hides nothing."""
    from matplotlib.transforms import ScaledTranslation

    labels = list(dict.fromkeys(s.label for s in plot.series if s.label))
    if len(labels) < 2 and not (labels and plot.series[0].style == "points"):
        return 0
    named = [axes.get_legend_handles_labels() for axes in (first, *lower)]
    handles = {
        label: handle
        for some, texts in reversed(named)
        for handle, label in zip(some, texts, strict=True)
    }
    # In little room the legend begins left of the panel, over the numbers of its axis.
    letters, begin = (7.5, 0.0) if size[0] > 5 else (6.0, -0.3)
    columns = _columns(labels, size[0] - 0.65 - begin, letters)
    place = first.transAxes + ScaledTranslation(begin, 0.0, _figure_of(first).dpi_scale_trans)
    legend = first.legend(
        [handles[label] for label in labels if label in handles],
        [label for label in labels if label in handles],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        bbox_transform=place,
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.9,
        columnspacing=1.4,
        labelspacing=0.3,
        markerscale=1.0,
        fontsize=letters,
    )
    for line in legend.get_lines():
        # A dot of a crowded curve is too small to tell its colour.
        line.set_markersize(max(line.get_markersize(), 3.4))
        line.set_alpha(1.0)
    return -(-len(labels) // columns)


def _columns(labels: Sequence[str], room: float, letters: float) -> int:
    """Into how many columns a legend goes that has this room [inch] and letters of this size [pt]."""
    for count in range(len(labels), 1, -1):
        # The first columns are longer by one where they are not even: no column stays away.
        rows, longer = divmod(len(labels), count)
        ends = [(column + 1) * rows + min(column + 1, longer) for column in range(count)]
        columns = [labels[first:last] for first, last in zip((0, *ends), ends, strict=False)]
        widths = [max(map(len, column)) * letters * LETTER_WIDTH + SIGN for column in columns]
        if sum(widths) <= room:
            return count
    return 1


def _figure_of(axes: Axes) -> Figure:
    """The figure in which axes stand."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return figure


def _ticks(axes: Axes, plot: Plot, y_scale: str) -> None:
    """Plain numbers on logarithmic axes (10, 100, 1000), and no scientific offsets without need."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    pointed = [series for series in plot.series if series.style == "points"]
    places = [np.asarray(series.x, dtype=np.float64) for series in pointed or plot.series]
    if plot.x_scale != "log" and places and all(np.array_equal(x, np.round(x)) for x in places):
        # Runs, orders, segments: nothing lies between them.
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    for axis, scale in ((axes.xaxis, plot.x_scale), (axes.yaxis, y_scale)):
        if scale != "log":
            continue
        low, high = sorted(axis.get_view_interval())
        wide = low <= 0 or high / low > 30
        axis.set_major_locator(LogLocator(10.0, (1.0,) if wide else (1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(_plain))
        axis.set_minor_formatter(NullFormatter())


def _plain(value: float, _: object = None) -> str:
    return f"{value:g}" if 1e-4 <= abs(value) < 1e6 else f"{value:.0e}"


def _watermark(axes: Axes, origin: str, size: tuple[float, float]) -> None:
    """The word that tells a simulated, replayed or imported run, across the data and behind it."""
    word = printable(ORIGIN_WORDS.get(origin, origin.upper()))
    if word:
        axes.text(
            0.5,
            0.5,
            word,
            transform=axes.transAxes,
            ha="center",
            va="center",
            rotation=16,
            zorder=0.5,
            fontsize=7.5 * size[0] if size[0] < 5 else 5.6 * size[0],
            fontweight="bold",
            color="#24292F",
            alpha=0.10,
            gid="watermark",
            clip_on=True,
        )


_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_ID = re.compile(r'(\bid="|url\(#|href="#)([^")]+)')


def _inline(text: str, identifier: str, label: str) -> str:
    """The bare svg element: ids made unique within the page, coordinates to a hundredth of a point,
    and a name for it.
    """
    from xml.sax.saxutils import escape, quoteattr

    body = text[text.index("<svg") :]
    head, _, rest = body.partition(">")
    rest = re.sub(r"<metadata>.*?</metadata>", "", rest, count=1, flags=re.DOTALL)
    rest = re.sub(r' d="[^"]*"', lambda m: _NUMBER.sub(lambda n: f"{float(n[0]):.2f}", m[0]), rest)
    rest = _ID.sub(lambda m: f"{m[1]}{identifier}-{m[2]}", rest)
    rest = re.sub(r"\n\s*", "\n", rest)
    return f'{head} role="img" aria-label={quoteattr(label)}>\n<title>{escape(label)}</title>{rest.strip()}'
