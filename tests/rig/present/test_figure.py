"""Figures: the same bytes for the same data, nothing lost, marked where the run is not from hardware."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache

import matplotlib.axes
import matplotlib.figure
import numpy as np
import pytest

from experiments.result import Panel, Plot, Series
from rig.present import figure as figures
from rig.present.decimate import peak_rows, scatter_rows
from rig.present.paper_figures import paper_figures
from rig.present.series import LIMIT, NULL, PALETTE
from tests.rig.handmade import friction_plot
from tests.rig.present.overlap import unreadable


def text_of(svg: str) -> str:
    return " ".join(ElementTree.fromstring(svg).itertext())


@cache
def friction_svg(origin: str, identifier: str = "f1") -> str:
    """The friction figure, drawn once."""
    return figures.draw_svg(friction_plot(), origin, identifier).svg


def plot(*series: Series, **more: object) -> Plot:
    return Plot(
        name="p",
        title="A title",
        x_label="Input angle [rad]",
        y_label="Kinematic error [arcmin]",
        series=series,
        **more,
    )  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("origin", "word"),
    [("simulated", "SIMULATED"), ("replay", "REPLAY"), ("imported", "IMPORTED"), ("hardware", "")],
)
def test_every_figure_carries_the_word_of_its_origin(origin: str, word: str) -> None:
    shown = text_of(friction_svg(origin))
    assert (
        (word in shown)
        if word
        else not any(w in shown for w in ("SIMULATED", "REPLAY", "IMPORTED"))
    )


def test_the_same_data_give_the_same_bytes() -> None:
    assert figures.draw_svg(friction_plot(), "simulated", "f1").svg == friction_svg("simulated")
    assert figures.draw_png(friction_plot(), "replay") == figures.draw_png(
        friction_plot(), "replay"
    )


def test_labels_and_units_are_text_in_the_figure() -> None:
    shown = text_of(friction_svg("hardware"))
    for word in (
        "Input speed [r/min]",
        "Torque [N m]",
        "measured, forward",
        "fit, reverse",
        "1000",
    ):
        assert word in shown


def test_two_figures_share_no_identifier() -> None:
    drawings = [friction_svg("simulated", name) for name in ("f1", "f2")]
    ids = [
        {e.get("id") for e in ElementTree.fromstring(svg).iter() if e.get("id")} for svg in drawings
    ]
    assert ids[0]
    assert not ids[0] & ids[1]


def test_hostile_labels_stay_text() -> None:
    evil = 'x</text><script>alert(1)</script> $\\frac{ "quoted"\x00\x1b'
    x = np.arange(5.0)
    made = Plot(
        name=evil,
        title=evil,
        x_label=evil,
        y_label=evil,
        series=(Series(label=evil, x=x, y=x), Series(label="b", x=x, y=x * 2, group=1)),
        note=evil,
    )
    svg = figures.draw_svg(made, evil, "f1").svg
    root = ElementTree.fromstring(svg)
    assert not [e for e in root.iter() if e.tag.endswith("script")]
    assert "<script" not in svg


def test_what_a_logarithmic_axis_cannot_show_is_said() -> None:
    y = np.array([1.0, 0.0, -2.0, 4.0])
    drawing = figures.draw_svg(
        plot(Series(label="spectrum", x=np.arange(4.0), y=y, style="bars"), y_scale="log"),
        "hardware",
        "f1",
    )
    assert drawing.remarks == (
        "2 values of “spectrum” are not positive and have no place on a logarithmic axis.",
    )


@pytest.mark.parametrize("style", ["line", "points", "band", "steps", "bars"])
@pytest.mark.parametrize("scale", ["linear", "log"])
def test_every_style_is_drawn_on_every_axis(style: str, scale: str) -> None:
    x = np.linspace(1.0, 10.0, 30)
    y = 2.0 + np.sin(x)
    series = Series(label="s", x=x, y=y, style=style, low=y - 0.1, high=y + 0.1)  # type: ignore[arg-type]
    other = Series(label="t", x=x, y=y * 1.1, style=style, group=1)  # type: ignore[arg-type]
    made = plot(series, other, x_scale=scale, y_scale=scale)
    data = figures.draw_svg(made, "hardware", "f1").svg.partition("legend_1")[0]
    assert all(colour.lower() in data for colour in PALETTE[:2])


@pytest.mark.parametrize("y", [np.array([]), np.full(6, np.nan), np.array([1.0]), np.full(6, 3.0)])
def test_poor_data_make_a_figure_all_the_same(y: np.ndarray) -> None:
    made = plot(Series(label="s", x=np.arange(float(len(y))), y=y))
    shown = text_of(figures.draw_svg(made, "simulated", "f1").svg)
    assert ("no data" in shown) == (not np.isfinite(y).any())


def test_a_day_of_samples_stays_small_and_keeps_its_peak() -> None:
    x = np.linspace(0.0, 750.0, 400_000)
    y = np.sin(x)
    y[123_457] = 50.0
    svg = figures.draw_svg(
        plot(Series(label="raw", x=x, y=y), Series(label="raw", x=x, y=y, style="points", group=1)),
        "simulated",
        "f1",
    ).svg
    assert len(svg) < 400_000
    assert "50" in text_of(svg)


def test_the_legend_hides_no_data(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[matplotlib.figure.Figure] = []
    save = matplotlib.figure.Figure.savefig

    def keep(figure: matplotlib.figure.Figure, *args: object, **kwargs: object) -> None:
        save(figure, *args, **kwargs)  # type: ignore[arg-type]
        seen.append(figure)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)
    x = np.linspace(0.0, 1.0, 5)
    eight = tuple(Series(label=f"{n}00 r/min", x=x, y=n * x, group=n) for n in range(10, 18))
    several = replace(friction_plot(), series=eight, panels=())
    for plot in (friction_plot(), several):
        for size in (figures.FULL_WIDTH, figures.HALF_WIDTH):
            figures.draw_png(plot, "simulated", size)
    for figure in seen:
        axes = figure.axes[0]
        legend = axes.get_legend()
        assert legend is not None
        box = legend.get_window_extent()
        assert not box.overlaps(axes.get_window_extent())
        assert box.x1 <= figure.bbox.x1 + 1


def test_of_the_steps_by_speed_paper_shows_the_one_that_is_told_worst() -> None:
    x = np.linspace(0.0, 1.0, 5)

    def step(name: str, left: float) -> Plot:
        series = (Series(label="measured", x=x, y=x), Series(label="", x=x, y=left * x, panel=1))
        return replace(friction_plot(), name=name, series=series)

    steps = [step("velocity-step-60", 0.1), step("velocity-step-600", 0.4)]
    plots = [
        step("velocity-steps", 9.0),
        *steps,
        replace(friction_plot(), name="friction-curve-low"),
    ]
    assert [plot.name for plot in paper_figures(plots)] == ["velocity-steps", "velocity-step-600"]


def test_png_is_a_png() -> None:
    from PIL import Image

    with Image.open(io.BytesIO(figures.draw_png(friction_plot(), "simulated", dpi=100))) as image:
        assert image.size == (710, 310)


def test_thinning_keeps_extremes_and_gaps() -> None:
    rng = np.random.default_rng(5)
    y = rng.normal(size=20_000)
    y[[17, 9_999]] = 40.0, -40.0
    y[5_000:6_000] = np.nan
    rows = peak_rows(y, 300)
    assert len(rows) <= 5 * 300
    assert {17, 9_999, 0, len(y) - 1} <= set(rows.tolist())
    assert np.isnan(y[rows]).any()
    assert np.all(np.diff(rows) > 0)


def test_thinning_leaves_short_curves_alone() -> None:
    assert peak_rows(np.arange(100.0), 300).tolist() == list(range(100))


def test_scattered_points_keep_their_outline() -> None:
    rng = np.random.default_rng(6)
    x, y = rng.normal(size=(2, 50_000))
    x[7] = np.nan
    rows = scatter_rows(x, y)
    assert 7 not in rows
    assert x[rows].max() == np.nanmax(x)
    assert y[rows].min() == y[np.isfinite(x)].min()
    assert len(rows) < 50_000


def layered() -> Plot:
    """A figure with everything: two panels, a null model, a limit, and a part that is enlarged."""
    x = np.linspace(0.0, 100.0, 50)
    return plot(
        Series(label="forward", x=x, y=x),
        Series(label="rigid gear", x=x, y=0.9 * x, role="null", group=1),
        Series(label="limit", x=x, y=np.full(50, 120.0), role="limit", group=2),
        Series(label="reverse", x=x, y=2.0 * x, group=1, panel=1),
        panels=(Panel("reverse [arcmin]", 1.0),),
        enlarged=(0.0, 20.0),
    )


def axes_of(made: Plot, monkeypatch: pytest.MonkeyPatch) -> list[matplotlib.axes.Axes]:
    """The axes of a figure as they are saved."""
    seen: list[matplotlib.figure.Figure] = []
    save = matplotlib.figure.Figure.savefig

    def keep(figure: matplotlib.figure.Figure, *args: object, **kwargs: object) -> None:
        save(figure, *args, **kwargs)  # type: ignore[arg-type]
        seen.append(figure)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)
    figures.draw_svg(made, "hardware", "f1")
    return seen[0].axes


def test_directions_stand_in_panels_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, _ = axes_of(layered(), monkeypatch)
    assert {line.get_label() for line in second.lines} == {"reverse"}
    assert "reverse" not in {line.get_label() for line in first.lines}
    assert first.get_xlim() == second.get_xlim()
    upper, lower = first.get_position(), second.get_position()
    assert upper.x0 == pytest.approx(lower.x0)
    assert upper.y0 > lower.y1


def test_a_null_model_lies_thin_and_grey_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {line.get_label(): line for line in axes_of(layered(), monkeypatch)[0].lines}
    null, data, limit = lines["rigid gear"], lines["forward"], lines["limit"]
    assert null.get_color() == NULL
    assert limit.get_color() == LIMIT
    assert null.get_linewidth() < data.get_linewidth()
    assert null.get_zorder() < data.get_zorder()


def test_a_part_of_x_is_shown_enlarged_beside_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    first, _, beside = axes_of(layered(), monkeypatch)
    low, high = beside.get_xlim()
    assert -1.0 < low <= 0.0
    assert 20.0 <= high < 21.0
    assert first.get_position().x1 < beside.get_position().x0


def test_a_label_is_no_longer_than_its_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    made = plot(
        Series(label="a", x=np.arange(9.0), y=np.arange(9.0)),
        Series(label="", x=np.arange(9.0), y=np.arange(9.0), panel=1),
        panels=(Panel("friction torque that the fit leaves [mN m]", 0.4),),
    )
    low = axes_of(made, monkeypatch)[1]
    low.figure.draw_without_rendering()
    assert low.yaxis.label.get_window_extent().height < 1.6 * low.get_window_extent().height


def test_the_legend_names_the_series_of_every_panel() -> None:
    shown = text_of(figures.draw_svg(layered(), "hardware", "f1").svg)
    assert all(word in shown for word in ("forward", "reverse", "rigid gear", "limit"))


def test_what_cannot_be_read_is_found() -> None:
    """So that the figures of the whole chain can be held against it."""
    sound = figures.draw_figure(friction_plot(), "simulated")
    assert not unreadable(sound)
    axes = sound.axes[0]
    axes.text(0.5, 0.5, "first", transform=axes.transAxes)
    axes.text(0.5, 0.51, "second", transform=axes.transAxes)
    sound.text(0.99, 0.5, "beyond the edge")
    axes.legend(loc="center")
    axes.plot(*np.mean([axes.get_xlim(), axes.get_ylim()], axis=1)[:, None], "o")
    faults = " ".join(unreadable(sound))
    for words in ("'first' lies over 'second'", "'beyond the edge' goes over", "the legend hides"):
        assert words in faults
