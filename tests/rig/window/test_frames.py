"""What a frame of the Run page costs, without a clock: rows come evenly, curves are as long as the
screen asks for, and only what
has changed is painted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pytestqt.qtbot import QtBot

from experiments.recording import ArraySource, Recording, RunMetadata
from model.channel import Channel
from model.gear_file import shipped_gear
from model.units import ARCMIN, REVOLUTION, RPM
from rig.errors import RunFileError
from rig.run.state import RunState
from rig.window.plot.plots import LabPlot
from rig.window.run.banner import Banner
from rig.window.run.kinematic_view import WAVE_BINS, OutputView, Revolutions, WaveView
from rig.window.run.live_axes import RECENT, TimeAxis, ValueAxis
from rig.window.run.live_view import LiveContext, LiveView, SpeedView, torque_view
from rig.window.run.pacing import LONGEST, MOST, Pacer
from rig.window.shell.session import WindowSession
from rig.window.work.live_file import Block
from rig.window.work.segment_work import MOST_WAITING, SegmentWork

RATE = 1000.0
FRAME = 0.025
SPEED = 20.0
RATIO = 120.0
LONGEST_REST = 10_000
"""ms until a window that is left alone paints nothing more."""


class HandClock:
    """A clock that is moved by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def rows(start: int, count: int, spike: float = 0.0) -> Block:
    """Rows of a gear that turns steadily, with a spike of torque in the middle."""
    time = np.arange(start, start + count) / RATE
    angle = SPEED * time
    torque = 0.07 + 0.01 * np.cos(2.0 * angle)
    torque[count // 2] += spike
    si = {
        "input_angle": angle,
        "output_angle": -(angle / RATIO + 1e-4 * np.sin(2.0 * angle)),
        "torque": torque,
        "target_speed": np.full(count, SPEED),
    }
    return Block(start, time, si, np.ones(count, dtype=bool))


def context() -> LiveContext:
    """A run that has begun; the views are given its rows by hand."""
    names = ("input_angle", "output_angle", "torque", "target_speed")
    block = rows(0, 10)
    source = ArraySource(
        {name: block.si[name] for name in names},
        (1e9 * block.time).astype(np.int64),
        np.zeros(10, np.uint16),
    )
    metadata = RunMetadata(
        run_id="00001-k",
        experiment="kinematic-error",
        origin="simulated",
        gear=shipped_gear(),
        ratio=RATIO,
        sample_rate=RATE,
    )
    return LiveContext(
        Recording(
            metadata,
            {name: Channel(name=name, unit="rad", is_counted=False) for name in names},
            (),
            (),
            source,
        )
    )


def count_paintings(widget: Any) -> list[int]:
    """One entry for every painting of a widget, from now on."""
    painted: list[int] = []
    paint = widget.paintEvent

    def counted(event: Any) -> None:
        painted.append(1)
        paint(event)

    # The method, never the class: a Qt object whose class has changed under it ends the interpreter.
    widget.paintEvent = counted
    return painted


def come_to_rest(qtbot: QtBot, painted: list[list[int]]) -> None:
    """Let the window paint what it still owes, and forget it."""

    def nothing_more() -> bool:
        was = any(painted)
        for counted in painted:
            counted.clear()
        qtbot.wait(20)
        return not was and not any(painted)

    qtbot.waitUntil(nothing_more, timeout=LONGEST_REST)


@pytest.fixture
def show(session: WindowSession, qtbot: QtBot) -> Callable[[LabPlot], LabPlot]:
    def made(plot: LabPlot) -> LabPlot:
        qtbot.addWidget(plot)
        plot.resize(420, 260)
        plot.show()
        qtbot.waitExposed(plot)
        return plot

    return made


# Rows come evenly.


def test_bursts_become_an_even_stream() -> None:
    clock = HandClock()
    pacer, given_rows, seen = Pacer(clock), 0, []
    for frame in range(400):
        clock.now += FRAME
        if frame % 2 == 0:
            pacer.put(rows(given_rows, 50))
            given_rows += 50
        seen.append(pacer.due())
    counts = [sum(map(len, blocks)) for blocks in seen[40:]]
    assert min(counts) >= 20, "no frame is without new rows"
    assert max(counts) <= 30
    assert pacer.waiting <= 2 * 50
    seen.append(pacer.rest())
    assert pacer.waiting == 0
    told = np.concatenate([block.time for blocks in seen for block in blocks])
    np.testing.assert_array_equal(told, np.arange(given_rows) / RATE)


BURSTS = st.tuples(st.integers(0, 25), st.lists(st.integers(1, 9000), max_size=3), st.booleans())
"""Beats before it, rows of its parts, whether the file has more than could be read."""


@given(bursts=st.lists(BURSTS, min_size=1, max_size=30))
@settings(max_examples=40)
def test_no_row_is_lost_doubled_or_kept_for_long(bursts: list[tuple[int, list[int], bool]]) -> None:
    clock = HandClock()
    pacer, put, got = Pacer(clock), 0, []
    for frames, counts, behind in bursts:
        for _ in range(frames):
            clock.now += FRAME
            got += pacer.due()
        for count in counts:
            pacer.put(rows(put, count))
            put += count
        got += pacer.due(behind)
        assert pacer.waiting <= MOST
    clock.now += LONGEST + FRAME
    got += pacer.due()
    assert pacer.waiting == 0, "nothing waits longer than that"
    assert [block.start for block in got] == list(
        np.cumsum([0, *(len(block) for block in got)])[:-1]
    )
    if put:
        np.testing.assert_array_equal(
            np.concatenate([block.time for block in got]), np.arange(put) / RATE
        )
    assert sum(map(len, got)) == put


def test_a_burst_that_is_read_in_parts_is_one_burst_and_the_file_is_left_alone_until_the_next() -> (
    None
):
    clock = HandClock()
    pacer = Pacer(clock)
    for burst in range(20):
        for part in range(20):
            clock.now += FRAME
            if part < 3:
                pacer.put(rows(0, 8000))
            pacer.due(behind=part < 2)
            if part == 4 and burst > 10:
                assert not pacer.expects
        assert pacer.expects
    assert pacer.waiting > 0, "shared out until the next burst"


def test_a_window_that_opens_a_long_run_does_not_keep_it() -> None:
    clock = HandClock()
    pacer = Pacer(clock)
    for _ in range(100):
        clock.now += 0.001
        pacer.put(rows(0, 8192))
        pacer.due(behind=True)
        assert pacer.waiting <= MOST


# Axes.


def test_a_value_axis_is_made_anew_only_when_something_would_leave_it(
    session: WindowSession, show: Callable[..., LabPlot]
) -> None:
    plot = show(LabPlot(session, "Torque", "t [s]", "torque [N m]"))
    curve, axis = plot.curve("measured", dense=True), ValueAxis(plot)
    x = np.arange(10.0)
    axis.follow()
    curve.item.setData(x, np.linspace(-1.0, 1.0, 10))
    axis.follow()
    first = plot.item.viewRange()[1]
    assert first[0] < -1.0 < 1.0 < first[1]
    curve.item.setData(x, np.linspace(-1.02, 1.05, 10))
    axis.follow()
    assert plot.item.viewRange()[1] == first
    curve.item.setData(x, np.linspace(-1.0, 9.0, 10))
    axis.follow()
    low, high = plot.item.viewRange()[1]
    assert low < -1.0
    assert high > 9.0
    curve.item.setData(x, np.linspace(0.0, 1.0, 10))
    axis.follow()
    low, high = plot.item.viewRange()[1]
    assert high < 2.0, "what has become small is shown large again"
    curve.item.setData(x, np.full(10, 3.0))
    axis.follow()
    assert plot.item.viewRange()[1] == pytest.approx([2.42, 3.58])


def test_a_look_by_hand_stays_until_the_latest_is_asked_for(
    session: WindowSession, show: Callable[..., LabPlot]
) -> None:
    plot = show(LabPlot(session, "Torque", "t [s]", "torque [N m]"))
    curve, time_axis, axis = plot.curve("measured", dense=True), TimeAxis(plot), ValueAxis(plot)

    def draw(high: float, recent: bool) -> None:
        curve.item.setData(np.arange(40.0), np.linspace(0.0, high, 40))
        time_axis.follow(39.0, recent)
        axis.follow(recent)

    draw(1.0, False)
    box = plot.item.getViewBox()
    box.setRange(xRange=(1.0, 2.0), yRange=(0.2, 0.3), padding=0.0)
    box.sigRangeChangedManually.emit(box.state["mouseEnabled"])
    draw(8.0, False)
    assert plot.item.viewRange() == [[1.0, 2.0], [0.2, 0.3]]
    draw(8.0, True)
    (left, right), (_, top) = plot.item.viewRange()
    assert (left, right) == (39.0 - RECENT, 39.0)
    assert top > 8.0


def test_the_picture_of_an_axis_is_made_when_it_changes_and_not_with_every_frame(
    session: WindowSession, show: Callable[..., LabPlot], qtbot: QtBot
) -> None:
    plot = show(LabPlot(session, "Torque", "t [s]", "torque [N m]", mark="SIMULATED"))
    curve = plot.curve("measured", dense=True)
    plot.item.setRange(xRange=(0.0, 10.0), yRange=(0.0, 1.0), padding=0.0)
    axes = [plot.item.getAxis(side) for side in ("left", "bottom")]
    plot.canvas.grab()
    before = [axis.times_drawn for axis in axes]
    for frame in range(5):
        curve.item.setData([0.0, 10.0], [0.0, 0.1 * frame])
        plot.canvas.grab()
    assert [axis.times_drawn for axis in axes] == before
    plot.item.setYRange(0.0, 2.0, padding=0.0)
    plot.canvas.grab()
    assert axes[0].times_drawn > before[0]
    before = [axis.times_drawn for axis in axes]
    for theme in ("dark", "light"):
        session.set_theme(theme)
        plot.canvas.grab()
    assert all(axis.times_drawn >= count + 2 for axis, count in zip(axes, before, strict=True))


def test_a_kept_axis_looks_as_one_that_is_painted(
    session: WindowSession, show: Callable[..., LabPlot]
) -> None:
    plot = show(LabPlot(session, "Torque", "t [s]", "torque [N m]", mark="SIMULATED"))
    plot.item.setRange(xRange=(0.0, 10.0), yRange=(0.0, 1.0), padding=0.0)

    def pixels() -> np.ndarray:
        image = (
            plot.canvas.grab()
            .toImage()
            .convertToFormat(plot.canvas.grab().toImage().Format.Format_RGB32)
        )
        return (
            np.frombuffer(image.constBits(), np.uint8)
            .reshape(image.height(), image.width(), 4)[..., :3]
            .astype(int)
        )

    kept = pixels()
    for side in ("left", "bottom"):
        axis = plot.item.getAxis(side)
        axis.paint = lambda p, opt, widget, axis=axis: type(axis).paint(axis, p, opt, None)
    plot.canvas.viewport().update()
    painted = pixels()
    assert np.abs(kept - painted).max() <= 3, (
        "blended once more, and nowhere else, larger or cut off"
    )
    assert len(np.unique(kept.reshape(-1, 3), axis=0)) > 10


# What is handed to the curves, and what is painted.


@pytest.mark.parametrize("recent", [False, True])
def test_a_curve_has_no_more_points_than_a_screen_can_show_and_keeps_its_peaks(
    session: WindowSession, qtbot: QtBot, recent: bool
) -> None:
    run = context()
    views: list[LiveView] = [
        SpeedView(session, run),
        torque_view(session, run),
        WaveView(session, run),
        OutputView(session, run),
    ]
    for view in views:
        qtbot.addWidget(view.plot)
    count = 8192
    for block in range(20):
        for view in views:
            view.take(rows(block * count, count, spike=0.5 if block == 18 else 0.0))
    for view in views:
        view.draw(recent)
        for curve in view.plot.curves:
            x = curve.item.getData()[0]
            assert x is None or len(x) <= 2 * 768
    torque = views[1].plot.curves[0].item.getData()[1]
    assert torque.max() == pytest.approx(570.0, abs=11.0), "one row in 160 000"
    speed = views[0].plot.curves[0].item.getData()[1]
    np.testing.assert_allclose(speed, SPEED / RPM, rtol=1e-6)


def test_only_a_plot_that_changed_is_painted(
    session: WindowSession, qtbot: QtBot, show: Callable[..., LabPlot]
) -> None:
    run = context()
    torque, error, over_output = (
        torque_view(session, run),
        WaveView(session, run),
        OutputView(session, run),
    )
    views: list[LiveView] = [torque, error, over_output]
    for view in views:
        show(view.plot)
    # More than a whole turn of the output: both ways of its error are known.
    whole = int(1.2 * RATIO * REVOLUTION / SPEED * RATE)
    for first in range(0, whole, 8192):
        for view in views:
            view.take(rows(first, 8192))
    for view in views:
        view.draw(False)
    painted = {view.plot: count_paintings(view.plot.canvas) for view in views}
    come_to_rest(qtbot, list(painted.values()))
    drawn = {view.plot: [] for view in views}
    for view in views:
        for curve in view.plot.curves:
            curve.item.sigPlotChanged.connect(lambda *_, plot=view.plot: drawn[plot].append(1))
    # The torque alone is new.
    torque.take(rows(whole, 33))
    for view in views:
        view.draw(False)
    qtbot.waitUntil(lambda: len(painted[torque.plot]) > 0)
    assert drawn[torque.plot]
    assert not drawn[error.plot]
    assert not drawn[over_output.plot]
    assert not painted[error.plot]
    assert not painted[over_output.plot]
    before = len(drawn[torque.plot])
    for view in views:
        view.draw(False)
    assert len(drawn[torque.plot]) == before, "nothing came, nothing is drawn"
    torque.draw(True)
    assert len(drawn[torque.plot]) > before, "the latest seconds are another curve"


def test_the_mean_of_the_revolutions_is_drawn_when_one_is_whole(
    session: WindowSession, qtbot: QtBot
) -> None:
    view = WaveView(session, context())
    qtbot.addWidget(view.plot)
    means: list[int] = []
    view.plot.curves[1].item.sigPlotChanged.connect(lambda *_: means.append(1))
    turn = int(REVOLUTION / SPEED * RATE) + 1
    for first in range(0, 6 * turn, 33):
        view.take(rows(first, 33))
        view.draw(False)
    assert len(means) == view.revolutions.count[1] == 4
    # At standstill nothing is under way any more.
    current = view.plot.curves[0].item
    assert np.isfinite(current.getOriginalDataset()[1]).any()
    still = rows(6 * turn, 33)
    view.take(
        Block(still.start, still.time, {**still.si, "target_speed": np.zeros(33)}, still.good)
    )
    view.draw(False)
    assert not np.isfinite(current.getOriginalDataset()[1]).any()


def test_a_fast_revolution_has_fewer_rows_than_bins_and_counts() -> None:
    revolutions = Revolutions()
    truth, under_way = 0.5 * ARCMIN, np.empty(0)
    for first in range(0, 2000, 25):
        angle = np.asarray((300.0 * RPM) * np.arange(first, first + 25) / RATE, dtype=np.float64)
        revolutions.add(angle, truth * np.sin(2.0 * angle), 1)
        if first == 300:
            under_way = revolutions.current()
    assert revolutions.count[1] == 9
    mean = revolutions.mean(1)
    assert mean is not None
    centres = (np.arange(WAVE_BINS) + 0.5) * REVOLUTION / WAVE_BINS
    np.testing.assert_allclose(mean, truth * np.sin(2.0 * centres), atol=0.04 * truth)
    # One row in nearly two bins: the revolution under way is a line, not dots.
    been = np.flatnonzero(np.isfinite(under_way))
    assert len(been) > 200
    assert (np.diff(been) == 1).all()


def test_half_a_revolution_does_not_count() -> None:
    revolutions = Revolutions()
    angle = np.linspace(0.0, 0.85 * REVOLUTION, 5000)
    revolutions.add(angle, np.sin(angle), 1)
    revolutions.cut()
    assert revolutions.count[1] == 0


def test_a_state_that_is_told_again_does_not_set_the_style_again(
    qtbot: QtBot, session: WindowSession
) -> None:
    banner = Banner()
    qtbot.addWidget(banner)
    styles: list[str] = []
    kept = banner.setStyleSheet
    banner.setStyleSheet = lambda text: (styles.append(text), kept(text))[0]  # type: ignore[method-assign]
    armed = RunState().armed()
    for what in ("one", "two", "three"):
        banner.show_state(armed, what)
    assert len(styles) == 1
    assert banner._title.text() == "three"
    banner.show_state(RunState())
    assert len(styles) == 2


# What a segment says is worked out beside the window.


def test_work_on_segments_holds_up_no_frame_and_is_handed_over_in_order() -> None:
    work, gate, kept = SegmentWork(), threading.Event(), []
    here = threading.get_ident()

    def worked_out(number: int) -> tuple[int, int]:
        assert gate.wait(600.0)
        return number, threading.get_ident()

    for number in range(MOST_WAITING):
        assert not work.is_full
        work.put(
            partial(worked_out, number), lambda made: kept.append((*made, threading.get_ident()))
        )
    assert work.is_full
    assert work.deliver() == 0, "the first is not done, and nobody waits for it"
    gate.set()
    work.finish()
    assert work.is_idle
    assert [number for number, _, _ in kept] == list(range(MOST_WAITING))
    assert all(there != here and taken == here for _, there, taken in kept)
    work.close()


def test_what_the_work_raises_is_raised_where_it_is_handed_over() -> None:
    work = SegmentWork()

    def fail() -> None:
        raise RunFileError("the disk is gone")

    work.put(fail, lambda _: None)
    with pytest.raises(RunFileError, match="the disk is gone"):
        work.finish()
    assert work.is_idle
    work.close()


def test_a_run_that_is_forgotten_leaves_no_work_behind() -> None:
    work, gate, kept = SegmentWork(), threading.Event(), []
    work.put(lambda: gate.wait(600.0), kept.append)
    for _ in range(3):
        work.put(lambda: 1, kept.append)
    gate.set()
    work.close()
    assert work.is_idle
    assert work.deliver() == 0
    assert not kept
