"""Figures of results in the window: every kind of plot drawn as the report draws it, marked, in both themes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from experiments.result import Panel, Plot, Result, Series
from rig.analysis.result_data import plot_from_mapping, result_from_mapping, table_to_mapping
from rig.analysis.result_data import plot_to_mapping as as_mapping
from rig.analysis.store import json_text
from rig.window.plot.axis import LabAxis, log_ticks, plain
from rig.window.plot.overlay import Overlaid, common_figures, mark_of, overlay, short_names
from rig.window.plot.plots import LabPlot
from rig.window.plot.result_plot import (
    PlotGallery,
    ResultPlot,
    dash_of,
    distinct_titles,
    without_what_logs_lose,
)
from rig.window.shell.session import WindowSession
from tests.rig.handmade import friction_plot, friction_result, kinematic_result

X = np.array([1.0, 10.0, 100.0])


def plot_of(*series: Series, **changes: str) -> Plot:
    words = {
        "name": "p",
        "title": "Torque over speed",
        "x_label": "input speed [r/min]",
        "y_label": "torque [mN m]",
    }
    return Plot(series=series, **(words | changes))  # type: ignore[arg-type]


@pytest.fixture
def drawn(session: WindowSession, qtbot: QtBot) -> ResultPlot:
    made = ResultPlot(session, mark="SIMULATED")
    qtbot.addWidget(made)
    made.resize(500, 320)
    return made


def test_the_wheel_zooms_along_x_and_over_an_axis_along_that(drawn: ResultPlot) -> None:
    box = drawn.item.getViewBox()
    box.setRange(xRange=(0.0, 10.0), yRange=(-5.0, 5.0), padding=0.0)
    turned = SimpleNamespace(delta=lambda: 120, pos=box.boundingRect().center, accept=lambda: None)
    before = np.ptp(box.viewRange(), axis=1)
    box.wheelEvent(turned)
    width, height = np.ptp(box.viewRange(), axis=1)
    assert width < before[0]
    assert height == pytest.approx(before[1])
    box.wheelEvent(turned, axis=1)
    assert np.ptp(box.viewRange()[0]) == pytest.approx(width)
    assert np.ptp(box.viewRange()[1]) < height


def test_lines_points_steps_and_bars_are_drawn_with_units_legend_and_mark(
    drawn: ResultPlot,
) -> None:
    drawn.show_data(
        plot_of(
            Series(label="fit", x=X, y=X, style="line"),
            Series(label="band", x=X, y=X, style="band", low=0.9 * X, high=1.1 * X, group=1),
            Series(label="held", x=X, y=X, style="steps", group=2),
            Series(label="measured", x=X, y=X, style="points", low=X - 0.5, high=X + 0.5, group=3),
            Series(label="orders", x=X, y=X, style="bars", low=X - 0.1, high=X + 0.1, group=4),
        )
    )
    assert [curve.name for curve in drawn.curves] == ["fit", "band", "held", "measured", "orders"]
    assert [curve.style for curve in drawn.curves][:4] == ["line", "line", "steps", "points"]
    assert drawn.curves[2].item.opts["stepMode"] == "left"
    assert drawn.item.getAxis("bottom").labelText == "input speed [r/min]"
    assert drawn.item.getAxis("left").labelText == "torque [mN m]"
    assert drawn.mark == "SIMULATED"
    assert drawn.item.titleLabel.text == "SIMULATED"
    for name in ("fit", "measured", "orders"):
        assert name in drawn._legend.text()


def test_error_bars_reach_from_low_to_high(drawn: ResultPlot) -> None:
    drawn.show_data(
        plot_of(Series(label="measured", x=X, y=X, style="points", low=X - 0.5, high=X + 2.0))
    )
    arms = [item for item in drawn.item.listDataItems() if item is not drawn.curves[0].item]
    x, y = arms[0].getOriginalDataset()
    np.testing.assert_array_equal(x, np.repeat(X, 3))
    np.testing.assert_array_equal(y.reshape(3, 3)[:, :2], np.column_stack([X - 0.5, X + 2.0]))


def test_bars_on_a_logarithmic_axis_begin_below_the_smallest(drawn: ResultPlot) -> None:
    drawn.show_data(
        plot_of(
            Series(label="orders", x=X, y=np.array([1.0, 0.01, 5.0]), style="bars"), y_scale="log"
        )
    )
    _, y = drawn.curves[0].item.getOriginalDataset()
    assert y[0] == pytest.approx(0.004)
    _, shown = drawn.curves[0].item.getData()
    assert shown[1] == pytest.approx(0.0)
    assert shown[0] == pytest.approx(math.log10(0.004))


def test_bars_of_two_series_stand_beside_each_other(drawn: ResultPlot) -> None:
    drawn.show_data(
        plot_of(
            Series(label="a", x=X, y=X, style="bars"),
            Series(label="b", x=X, y=X, style="bars", group=1),
        )
    )
    a, b = (curve.item.getOriginalDataset()[0][0] for curve in drawn.curves)
    assert a < X[0] < b
    assert b - a < 0.5 * (X[1] - X[0])


def test_what_a_logarithmic_axis_loses_is_said(drawn: ResultPlot) -> None:
    drawn.show_data(plot_of(Series(label="fit", x=np.array([-1.0, 0.0, 10.0]), y=X), x_scale="log"))
    assert drawn.remarks == (
        "2 values of “fit” are not positive and have no place on a logarithmic axis.",
    )
    assert len(drawn.curves[0].item.getOriginalDataset()[0]) == 1
    kept, remarks = without_what_logs_lose(plot_of(Series(label="fit", x=X, y=X)))
    assert remarks == ()
    np.testing.assert_array_equal(kept.series[0].x, X)


def test_dashes_follow_the_place_within_the_colour() -> None:
    series = [
        Series(label="a", x=X, y=X),
        Series(label="b", x=X, y=X),
        Series(label="c", x=X, y=X, group=1),
        Series(label="d", x=X, y=X, style="points"),
        Series(label="e", x=X, y=X),
    ]
    assert [dash_of(series, k) for k in (0, 1, 2, 4)] == ["line", "dashed", "line", "dotted"]


def test_many_points_are_thinned_and_none_of_the_extremes_is_lost(drawn: ResultPlot) -> None:
    generator = np.random.default_rng(3)
    x, y = generator.normal(size=(2, 40_000))
    drawn.show_data(plot_of(Series(label="samples", x=x, y=y, style="points")))
    shown_x, shown_y = drawn.curves[0].item.getOriginalDataset()
    assert len(shown_x) < 40_000
    assert (shown_x.min(), shown_y.max()) == (x.min(), y.max())


def test_a_figure_without_data_says_so(drawn: ResultPlot) -> None:
    drawn.show_data(plot_of(Series(label="fit", x=np.empty(0), y=np.empty(0))))
    assert any(getattr(item, "toPlainText", lambda: "")() == "no data" for item in drawn.item.items)
    drawn.show_data(plot_of(Series(label="fit", x=X, y=X)))
    assert not any(
        getattr(item, "toPlainText", lambda: "")() == "no data" for item in drawn.item.items
    )


@pytest.mark.parametrize("result", [friction_result(), kinematic_result()], ids=lambda r: r.kind)
def test_every_figure_of_a_result_is_drawn_in_both_themes(
    result: Result, drawn: ResultPlot, session: WindowSession
) -> None:
    for plot in result.plots:
        drawn.show_data(plot)
        assert [c.name for c in drawn.curves] == [s.label for s in plot.series]
        for theme in ("dark", "light"):
            session.set_theme(theme)
            assert drawn.canvas.backgroundBrush().color().name() == session.palette.surface
            assert not drawn.grab().isNull()


def test_ticks_of_logarithmic_axes_are_plain_numbers() -> None:
    numbered, bare = log_ticks(0.0, 2.0)
    assert [round(10**t) for t in numbered] == [1, 2, 5, 10, 20, 50, 100]
    assert len(bare) == 12
    assert [round(10**t) for t in log_ticks(0.0, 4.0)[0]] == [1, 10, 100, 1000, 10000]
    assert [round(10**t, 6) for t in log_ticks(math.log10(20.0), math.log10(30.0))[0]] == [
        20,
        22,
        24,
        26,
        28,
        30,
    ]
    assert [plain(v) for v in (0.001, 100.0, 1e6)] == ["0.001", "100", "1e6"]


def test_the_axis_numbers_only_its_numbered_ticks(qtbot: QtBot) -> None:
    axis = LabAxis("bottom")
    axis.setLogMode((True, True))
    (level, numbered), (bare_level, bare) = axis.logTickValues(0.0, 1.0, 300.0, [])
    assert axis.logTickStrings(numbered, 1.0, level) == ["1", "2", "5", "10"]
    assert set(axis.logTickStrings(bare, 1.0, bare_level)) == {""}


def test_the_gallery_goes_by_keyboard_and_keeps_its_place(
    session: WindowSession, qtbot: QtBot
) -> None:
    gallery = PlotGallery(session)
    qtbot.addWidget(gallery)
    plots = (
        replace(friction_plot(), note="a note"),
        replace(friction_plot(), name="second", title="Second"),
    )
    gallery.show_plots(plots, "REPLAY")
    assert gallery.note.text() == "A note. Figure 9, 17 of the paper."
    qtbot.keyClick(gallery.titles, Qt.Key.Key_Down)
    assert gallery.plot.shown is plots[1]
    gallery.show_plots((plots[1], plots[0]), "REPLAY", keep=True)
    assert gallery.plot.shown is plots[1]
    assert gallery.plot.mark == "REPLAY"
    gallery.show_plots((), "")
    assert gallery.plot.curves == ()


def test_two_figures_of_one_title_are_told_apart() -> None:
    one = plot_of(Series(label="fit", x=X, y=X))
    assert distinct_titles((one, replace(one, name="q"), replace(one, title="Other"))) == [
        "Torque over speed (p)",
        "Torque over speed (q)",
        "Other",
    ]


def test_a_result_survives_json_whole() -> None:
    result = friction_result()
    told = {**result.as_json(), "plots": [as_mapping(p) for p in result.plots]}
    told["tables"] = [table_to_mapping(t) for t in result.tables]
    back = result_from_mapping(json.loads(json_text(told)))
    assert back.estimates == result.estimates
    assert (back.metrics, back.warnings, back.tables, back.options) == (
        result.metrics,
        result.warnings,
        result.tables,
        result.options,
    )
    for mine, theirs in zip(back.plots[0].series, result.plots[0].series, strict=True):
        np.testing.assert_allclose(mine.y, theirs.y, rtol=1e-8)
        assert (mine.low is None) == (theirs.low is None)


def test_what_json_cannot_hold_comes_back_as_nan() -> None:
    plot = plot_of(Series(label="fit", x=X, y=np.array([1.0, math.nan, math.inf])))
    told = json.loads(
        json_text({"run": "r", "kind": "k", "parameters": {}, "plots": [as_mapping(plot)]})
    )
    np.testing.assert_array_equal(
        result_from_mapping(told).plots[0].series[0].y, [1.0, math.nan, math.nan]
    )


def overlaid(name: str, place: int, *plots: Plot, mark: str = "SIMULATED") -> Overlaid:
    return Overlaid(name, mark, plots, place)


def test_an_overlay_has_a_colour_per_run_and_every_curve_of_it() -> None:
    runs = [overlaid("00001 A", 0, friction_plot()), overlaid("00002 B", 3, friction_plot())]
    made = overlay(runs, "friction")
    assert made is not None
    assert made.runs == ("00001 A", "00002 B")
    assert [s.group for s in made.plot.series] == [0, 0, 0, 0, 3, 3, 3, 3]
    assert made.plot.series[0].label == "00001 A: measured, forward"
    assert made.plot.series[5].label == "00002 B: fit, forward"
    assert (made.plot.x_label, made.plot.x_scale) == (friction_plot().x_label, "log")


def test_an_overlay_leaves_out_other_axes_and_says_so() -> None:
    odd = replace(friction_plot(), y_label="Torque of motor + gear [N m]")
    other = replace(friction_plot(), name="else")
    made = overlay(
        [
            overlaid("1", 0, odd),
            overlaid("2", 1, friction_plot()),
            overlaid("3", 2, friction_plot()),
            overlaid("4", 3, other),
        ],
        "friction",
    )
    assert made is not None
    assert made.runs == ("2", "3")
    assert made.left_out == (
        "4 has no such figure.",
        "1 is drawn over other axes (Torque of motor + gear [N m]).",
    )
    assert overlay([overlaid("1", 0, odd)], "nothing") is None


def test_figures_that_two_runs_have_can_be_overlaid() -> None:
    other = replace(friction_plot(), name="else", title="Else")
    assert common_figures(
        [overlaid("1", 0, friction_plot(), other), overlaid("2", 1, friction_plot())]
    ) == {"friction": friction_plot().title}


def test_names_in_a_legend_tell_runs_apart() -> None:
    assert short_names({"a": (3, "SN-1"), "b": (4, "SN-1")}) == {
        "a": "00003 SN-1",
        "b": "00004 SN-1",
    }
    assert short_names({"a": (3, "SN-1"), "b": (3, "SN-1")}) == {"a": "a", "b": "b"}


def test_the_mark_of_an_overlay_names_every_origin() -> None:
    simulated, hardware = overlaid("1", 0), overlaid("2", 1, mark="")
    assert mark_of([simulated, simulated]) == "SIMULATED"
    assert mark_of([hardware]) == ""
    assert mark_of([hardware, simulated]) == "HARDWARE + SIMULATED"


def test_the_panels_of_a_figure_stand_under_each_other_over_one_x(
    drawn: ResultPlot, session: WindowSession
) -> None:
    made = replace(
        plot_of(
            Series(label="measured", x=X, y=X),
            Series(label="rigid gear", x=X, y=0.5 * X, role="null"),
            Series(label="", x=X, y=0.1 * X, panel=1),
        ),
        panels=(Panel("residual [mN m]", 0.4),),
    )
    drawn.show_data(made)
    (low,) = drawn.below
    assert [curve.name for curve in drawn.curves] == ["measured", "rigid gear"]
    assert len(low.curves) == 1
    assert low.item.getViewBox().linkedView(0) is drawn.item.getViewBox()
    null = drawn.curves[1]
    assert null.item.zValue() < drawn.curves[0].item.zValue()
    assert null.item.opts["pen"].color().name() == session.palette.muted
    drawn.show_data(plot_of(Series(label="alone", x=X, y=X)))
    assert drawn.below == ()


def test_a_figure_of_other_panels_lies_over_other_axes() -> None:
    whole = plot_of(Series(label="a", x=X, y=X))
    parted = replace(whole, panels=(Panel("residual [mN m]"),))
    runs = [Overlaid(f"r{k}", "", (p,), k) for k, p in enumerate((whole, whole, parted))]
    found = overlay(runs, "p")
    assert found is not None
    assert found.runs == ("r0", "r1")
    assert "residual [mN m]" in found.left_out[0]


def test_a_figure_comes_back_from_json_with_panels_and_roles() -> None:
    made = replace(
        plot_of(Series(label="a", x=X, y=X, role="limit", panel=1)),
        panels=(Panel("residual [mN m]", 0.4),),
        enlarged=(0.0, 20.0),
    )
    back = plot_from_mapping(json.loads(json_text(as_mapping(made))))
    assert (back.panels, back.enlarged) == (made.panels, made.enlarged)
    assert (back.series[0].role, back.series[0].panel) == ("limit", 1)
    older = as_mapping(made)
    del older["panels"], older["enlarged"], older["series"][0]["role"], older["series"][0]["panel"]
    assert plot_from_mapping(older).series[0].role == "data"


def test_a_label_that_does_not_fit_its_axis_leaves_its_unit(
    session: WindowSession, qtbot: QtBot
) -> None:
    plot = LabPlot(session, "Motor torque", "time [s]", "motor torque [mN m]")
    qtbot.addWidget(plot)
    plot.show()
    axis = plot.item.getAxis("left")
    for height, label in (
        (400, "motor torque [mN m]"),
        (150, "[mN m]"),
        (400, "motor torque [mN m]"),
    ):
        plot.resize(500, height)
        qtbot.waitUntil(lambda label=label: axis.label.toPlainText().strip() == label)
        assert axis.label.boundingRect().width() <= axis.height()
    assert axis.labelText == "motor torque [mN m]"
