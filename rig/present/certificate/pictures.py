"""The two pictures of page one: error over one output turn, and running torque over speed as it was measured.

Letters of one size, one accent colour, and marks that are told apart in grey too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments.protocols.friction.quantities import at_reference
from experiments.result import Plot, Verdict
from rig.analysis.fit.recorded import Fit
from rig.present.certificate.gather import Certified
from rig.present.certificate.words import Words
from rig.present.decimate import peak_rows
from rig.present.figure import drawn_by

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 6.85, 3.15
"""Of a picture [inch], above nothing else; every line that stands above both takes half its own height of each."""
LINE = 0.075
ACCENT, DARK = "#0B4F7D", "#1F2328"
_TYPEFACE = "'Libertinus Serif', 'DejaVu Sans'"
"""That of the page; matplotlib measures with a wider one, so that everything has room."""
_LETTERS = 8.5
_BINS = 500
_STYLE: Any = {
    "font.size": _LETTERS,
    "axes.labelsize": _LETTERS,
    "xtick.labelsize": _LETTERS,
    "ytick.labelsize": _LETTERS,
    "legend.fontsize": _LETTERS,
}


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One picture of page one: its drawing, and what it shows."""

    svg: str
    title: str


def pictures_of(gathered: Certified, lines: int, words: Words) -> tuple[Picture, ...]:
    """The pictures that there are runs for, under so many lines of limits and reasons."""
    size = (WIDTH, HEIGHT - LINE * lines)
    both = (_error(gathered, size, words), _torque(gathered, size, words))
    return tuple(picture for picture in both if picture is not None)


def _error(gathered: Certified, size: tuple[float, float], words: Words) -> Picture | None:
    plot = _plot(gathered.fit_of("kinematic-error"), "transmission-accuracy")
    if plot is None:
        return None

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(plot.series), sharey=True, squeeze=False)[0]
        for number, (axes, series) in enumerate(zip(panels, plot.series, strict=True)):
            x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
            rows = peak_rows(y, _BINS)
            axes.plot(x[rows], y[rows], color=ACCENT, linewidth=0.5)
            axes.set_xlim(0.0, 360.0)
            axes.set_xticks([0, 90, 180, 270, 360])
            axes.set_title(words.named(series.label), fontsize=_LETTERS, loc="left", pad=3.0)
            axes.set_xlabel(words.ANGLE_AXIS)
            axes.margins(y=0.1)
            _bracket(axes, float(y.min()), float(y.max()))
            if not number:
                axes.set_ylabel(words.ERROR_AXIS)
        figure.subplots_adjust(
            left=0.66 / size[0],
            right=1 - 0.14 / size[0],
            bottom=0.42 / size[1],
            top=1 - 0.2 / size[1],
            wspace=0.12,
        )

    return _picture("error", words.ERROR_TITLE, size, draw, words)


def _bracket(axes: Axes, low: float, high: float) -> None:
    """A square bracket beside the panel, from the lowest to the highest value."""
    place = axes.get_yaxis_transform()
    axes.plot(
        [1.01, 1.025, 1.025, 1.01],
        [low, low, high, high],
        transform=place,
        color=DARK,
        linewidth=1.2,
        clip_on=False,
        solid_joinstyle="miter",
        gid="bracket",
    )


def _torque(gathered: Certified, size: tuple[float, float], words: Words) -> Picture | None:
    fit = gathered.fit_of("friction")
    plot = _plot(fit, "friction-directions")
    if fit is None or plot is None:
        return None
    limits = tuple(_limits(gathered.verdict.lines, words))
    subject = str(fit.result.options.get("torque_is_of", "")) or "gear"

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_xscale("log")
        _points(axes, plot, words)
        reach = 10.0 ** np.array([-0.06, 0.06])
        for number, (speed, torque, label) in enumerate(limits):
            told = label if label not in [one[2] for one in limits[:number]] else "_"
            axes.plot(speed * reach, [torque, torque], color=DARK, linewidth=2.4, label=told)
        axes.margins(x=0.03, y=0.08)
        axes.xaxis.set_major_formatter(lambda value, _: words.numbers(f"{value:g}"))
        axes.set_xlabel(words.SPEED_AXIS)
        axes.set_ylabel(words.TORQUE_AXIS.format(subject=words.name(subject)), y=0.45)
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(-0.01, 0.98),
            ncols=5,
            borderaxespad=0.0,
            handlelength=1.4,
            columnspacing=1.4,
            frameon=False,
        )
        figure.subplots_adjust(
            left=0.66 / size[0],
            right=1 - 0.14 / size[0],
            bottom=0.42 / size[1],
            top=1 - 0.22 / size[1],
        )

    tare = words.TORQUE_TARE if subject == "gear" else ""
    return _picture("torque", words.TORQUE_TITLE.format(tare=tare), size, draw, words)


def measured_points(plot: Plot) -> Iterator[tuple[str, NDArray[np.float64], NDArray[np.float64]]]:
    """Of each direction the points as measured: speed [r/min] and torque [mN m], both without their sign."""
    for series in plot.of_panel(0):
        if series.style == "points" and series.role == "data":
            x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
            way = "reverse" if x.size and x.mean() < 0 else "forward"
            yield way, np.abs(x), np.where(x < 0, -y, y)


_POINTS_OF: Mapping[str, Mapping[str, Any]] = {
    "forward": {"marker": "o", "markersize": 2.6, "color": ACCENT, "markerfacecolor": ACCENT},
    "reverse": {"marker": "s", "markersize": 5.2, "color": DARK, "markerfacecolor": "none"},
}
"""How the points of a direction look: full, and open around them."""


def _points(axes: Axes, plot: Plot, words: Words) -> None:
    """The points of both directions: full, and open around them."""
    for way, speed, torque in measured_points(plot):
        called = words.MEASURED.format(
            way={"forward": words.FORWARD, "reverse": words.REVERSE}[way]
        )
        axes.plot(speed, torque, linestyle="", markeredgewidth=0.7, label=called, **_POINTS_OF[way])


def _limits(lines: Sequence[Verdict], words: Words) -> Iterator[tuple[float, float, str]]:
    """Limits of the running torque: speed [r/min], torque [mN m], and what it is called."""
    for line in lines:
        head, _, rest = line.estimate.name.partition("running_torque_")
        speed, _, reference = rest.partition("_rpm")
        if not head and speed.isdigit():
            is_at = reference == at_reference("")
            yield float(speed), line.limit * 1e3, words.LIMIT_AT_REFERENCE if is_at else words.LIMIT


def _plot(fit: Fit | None, name: str) -> Plot | None:
    plots = () if fit is None else fit.result.plots
    return next((plot for plot in plots if plot.name == name and plot.series), None)


def _picture(
    name: str,
    title: str,
    size: tuple[float, float],
    draw: Callable[[Figure], None],
    words: Words,
) -> Picture:
    def draw_it(figure: Figure) -> None:
        draw(figure)
        if words.decimal != ".":
            for axes in figure.axes:
                axes.yaxis.set_major_formatter(_numbers_as(words))

    style = dict(_STYLE)
    if words.fonts:
        register(words)
        style["font.sans-serif"] = ["DejaVu Sans", *words.fonts]
    svg = drawn_by(draw_it, f"front-{name}", title, size, style)
    return Picture(svg=svg.replace("'DejaVu Sans'", _TYPEFACE), title=title)


def _numbers_as(words: Words) -> Any:
    """The usual numbers of an axis with the decimal mark of a language."""
    from matplotlib.ticker import ScalarFormatter

    class Marked(ScalarFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return words.numbers(super().__call__(x, pos))

    return Marked()


def register(words: Words) -> None:
    """Let matplotlib measure the letters of a language."""
    from matplotlib import font_manager

    known = {font.fname for font in font_manager.fontManager.ttflist}
    for file in words.font_files():
        if str(file) not in known:
            font_manager.fontManager.addfont(str(file))
