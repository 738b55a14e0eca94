"""What the Run page is made of, without a process: envelopes lose no peak, revolutions find a known
error, states in order.
"""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pytestqt.qtbot import QtBot

import rig.run.session
from experiments import catalogue
from experiments.recording import Event, RunMetadata, Segment
from model.channel import Channel
from model.units import ARCMIN, REVOLUTION
from rig.analysis.result_data import result_from_mapping
from rig.run.margins import number, worded
from rig.run.parts import Progress
from rig.run.state import LOST, STOOD, RunState, State
from rig.run.trips import SESSION_ERRORS, TRIPS
from rig.runfile.header import RunHeader
from rig.runfile.layout import Column
from rig.runfile.write import RunWriter
from rig.window.run.banner import LOOKS, look_of
from rig.window.run.kinematic_view import WAVE_BINS, WIND_UP, Revolutions, SteadyRows, WaveView
from rig.window.run.live_plots import VIEWS, LivePlots
from rig.window.run.outcome_view import result_lines
from rig.window.shell.palette import DARK, LIGHT, Palette
from rig.window.shell.session import WindowSession
from rig.window.work.live_file import Block, Envelope, LiveFile, RollingEnvelope, SlidingSpeed


def fed(
    pieces: list[int], made: Envelope | RollingEnvelope, values: np.ndarray, period: float = 1e-3
) -> np.ndarray:
    """Values handed on in pieces of these lengths, over and over; returns the times."""
    time, start, k = np.arange(len(values)) * period, 0, 0
    while start < len(values):
        stop = start + pieces[k % len(pieces)]
        made.add(time[start:stop], values[start:stop])
        start, k = stop, k + 1
    return time


@settings(max_examples=40)
@given(
    rows=st.integers(1, 9000),
    pieces=st.lists(st.integers(1, 3000), min_size=1, max_size=5),
    seed=st.integers(0, 99),
    bins=st.sampled_from([8, 64, 1024]),
)
def test_an_envelope_keeps_every_extreme_in_little_memory(
    rows: int, pieces: list[int], seed: int, bins: int
) -> None:
    values = np.random.default_rng(seed).normal(size=rows)
    made = Envelope(bins)
    fed(pieces, made, values)
    x, y = made.curve()
    assert len(x) == len(y) <= 2 * bins + 2
    assert (y.min(), y.max()) == (values.min(), values.max())
    assert np.all(np.diff(x) >= 0.0)
    # How the rows were cut into pieces changes nothing.
    whole = Envelope(bins)
    fed([rows], whole, values)
    np.testing.assert_array_equal(whole.curve()[1], y)


@settings(max_examples=40)
@given(pieces=st.lists(st.integers(1, 4000), min_size=1, max_size=4), seed=st.integers(0, 99))
def test_a_rolling_envelope_is_the_latest_seconds(pieces: list[int], seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=9000)
    made = RollingEnvelope(span=2.0, bins=100)
    time = fed(pieces, made, values)
    x, y = made.curve()
    assert len(x) == 200
    shown = time >= x[0] - 1e-9
    assert (y.min(), y.max()) == (values[shown].min(), values[shown].max())
    assert x[-1] - x[0] == pytest.approx(2.0, abs=0.05)


def test_a_speed_is_the_same_however_the_rows_come() -> None:
    time = np.arange(5000) * 1e-3
    angle = 30.0 * time + 0.1 * np.sin(time)
    found = []
    for step in (1, 7, 5000):
        sliding, parts = SlidingSpeed(1e-3), []
        for start in range(0, 5000, step):
            rows = slice(start, start + step)
            block = Block(
                start,
                time[rows],
                {"input_angle": angle[rows]},
                np.ones(len(time[rows]), dtype=bool),
            )
            parts.append(sliding.of(block, "input_angle")[1])
        found.append(np.concatenate(parts))
    assert len(found[0]) == len(found[1]) == len(found[2]) == 4980
    np.testing.assert_allclose(found[0], found[2], rtol=1e-9)
    assert found[2].mean() == pytest.approx(30.0, abs=0.1)


def test_revolutions_find_a_known_kinematic_error_in_both_directions() -> None:
    revolutions = Revolutions()
    truth = 0.5 * ARCMIN
    for way in (1, -1):
        angle = way * np.linspace(0.0, 5.3 * REVOLUTION, 20_000)
        error = truth * np.sin(2.0 * angle) + 3.0 * ARCMIN * angle / (120.0 * REVOLUTION)
        for part in np.array_split(np.arange(len(angle)), 13):
            revolutions.add(angle[part], error[part], way)
        revolutions.cut()
    assert revolutions.count == {1: 5, -1: 5}
    centres = (np.arange(WAVE_BINS) + 0.5) * REVOLUTION / WAVE_BINS
    for way in (1, -1):
        mean = revolutions.mean(way)
        assert mean is not None
        np.testing.assert_allclose(mean, truth * np.sin(2.0 * centres), atol=0.05 * ARCMIN)
    assert np.isnan(revolutions.current()).all()


def test_rows_count_as_steady_after_the_wind_up_and_only_at_one_set_point() -> None:
    speed = np.repeat([0.0, 3.0, -3.0, 100.0], 6000)
    angle = np.cumsum(speed) * 1e-3
    whole = SteadyRows().of(speed, angle)
    rows = SteadyRows()
    parts = [rows.of(speed[k : k + 501], angle[k : k + 501]) for k in range(0, len(speed), 501)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    first = np.flatnonzero(whole)[0]
    assert angle[first] - angle[6000] == pytest.approx(WIND_UP, abs=0.01)
    assert not whole[:6000].any()
    assert not whole[18000:].any(), "too fast: the output vibrates"
    assert set(np.sign(speed[whole])) == {1.0, -1.0}


def event(code: str, source: str = "session", level: str = "error", text: str = "") -> Event:
    return Event(0, level, code, source, text)


def test_states_of_a_run_in_order() -> None:
    progress = Progress(
        step=1, steps=3, what="hold 30 r/min", elapsed=1.0, left=2.0, speed=3.0, events=0
    )
    safe = Progress(step=3, steps=3, what="making safe", elapsed=1.0, left=0.0, speed=3.0, events=0)
    assert not RunState().active
    armed = RunState().armed()
    running = armed.went_on(progress)
    assert (armed.state, running.state, running.what) == (
        State.ARMED,
        State.RUNNING,
        "hold 30 r/min",
    )
    pressed = running.pressed("STOP")
    assert pressed.went_on(progress).state is State.STOPPING, (
        "progress after STOP does not look like running"
    )
    assert running.went_on(safe).state is State.STOPPING
    ended = pressed.after(event("made-safe", "make-safe", "info")).reported(
        {"outcome": "ABORTED", "make_safe": {"safe": True}}
    )
    assert (ended.state, ended.outcome, ended.safe) == (State.FINISHED, "ABORTED", True)
    assert ended.active, "the process is still there"
    assert not ended.gone(reported=True, complaint="").active


@pytest.mark.parametrize("cause", sorted(TRIPS))
def test_every_trip_names_its_cause_and_its_remedy(cause: str) -> None:
    running = (
        RunState()
        .armed()
        .went_on(Progress(step=1, steps=3, what="hold", elapsed=1.0, left=2.0, speed=3.0, events=0))
    )
    tripped = running.after(event(cause, text="in any words"))
    assert tripped.state is State.TRIPPED
    assert (tripped.what, tripped.remedy) == (TRIPS[cause].what, TRIPS[cause].remedy)
    later = tripped.after(event("over_speed", text="later")).pressed("STOP")
    assert later.cause == cause, "the first cause stays"
    assert later.state is State.TRIPPED
    report = {
        "outcome": "TRIPPED",
        "make_safe": {"safe": True},
        "trip": {"cause": cause},
        "message": "m",
    }
    assert later.reported(report).remedy == TRIPS[cause].remedy


def test_an_error_that_is_no_trip_is_shown_as_none() -> None:
    running = RunState(state=State.RUNNING, moved=True)
    for code in SESSION_ERRORS:
        assert running.after(event(code, text="TRIPPED over a cable")) == running
    # An ABORT while an error is being brought to standstill is written at the level of that error.
    assert running.after(event("ABORT")).state is State.STOPPING


def test_every_error_of_the_session_is_in_the_table() -> None:
    """Whatever ends a run in ERROR is no trip; a new code that is not in the table would be shown as one."""
    calls = [
        [ast.literal_eval(a) if isinstance(a, ast.Constant) else None for a in node.args]
        for node in ast.walk(ast.parse(inspect.getsource(rig.run.session)))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]
    ends = {words[-1] for words in calls if len(words) == 4 and words[1] == "ERROR"}
    # None is a trip's own cause.
    logged = {
        words[1]
        for words in calls
        if words[:1] == ["error"] and words[2:3] == ["session"] and words[1] is not None
    }
    assert ends | logged == SESSION_ERRORS


def test_an_end_without_a_report() -> None:
    moved = (
        RunState()
        .armed()
        .went_on(Progress(step=1, steps=3, what="hold", elapsed=1.0, left=2.0, speed=3.0, events=0))
    )
    assert RunState().armed().gone(False, "no such motor").state is State.REFUSED
    assert RunState().armed().gone(False, "", killed=True).state is State.LOST, (
        "killed: nobody knows"
    )
    lost = moved.gone(False, "boom")
    assert (lost.state, lost.safe, lost.remedy) == (State.LOST, None, LOST)
    assert "boom" in lost.what
    stood = moved.after(event("made-safe", "make-safe", "info")).gone(False, "")
    assert (stood.safe, stood.remedy) == (True, STOOD)
    unsafe = moved.reported({"outcome": "COMPLETED", "make_safe": {"safe": False}})
    assert unsafe.state is State.TRIPPED
    assert "emergency stop" in unsafe.remedy


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_states_are_told_apart_without_colour_and_read_from_afar() -> None:
    words = [look.word for look in LOOKS.values()]
    assert len(set(words)) == len(words)
    for state in State:
        for outcome in ("COMPLETED", "ABORTED", "ERROR"):
            look = look_of(RunState(state=state, outcome=outcome))
            assert contrast(look.background, look.text) >= 4.5, look
    active = [LOOKS[state] for state in (State.ARMED, State.RUNNING, State.STOPPING, State.TRIPPED)]
    lightness = sorted(luminance(look.background) for look in active)
    assert len({look.symbol for look in active}) == 4
    assert min(np.diff(lightness)) > 0.05, "grey copies of the colours differ as well"


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_text_and_curves_stand_out_in_both_themes(palette: Palette) -> None:
    for colour in (palette.text, palette.muted, palette.good, palette.warning, palette.bad):
        assert contrast(colour, palette.surface) >= 4.5, colour
        assert contrast(colour, palette.window) >= 4.5, colour
    assert contrast(palette.stop, palette.stop_text) >= 4.5
    assert contrast(palette.accent, palette.accent_text) >= 4.5
    for colour in palette.series[:4]:
        assert contrast(colour, palette.surface) >= 2.5, colour


def test_margins_and_results_carry_their_units() -> None:
    assert worded("input_speed")[1] == "r/min"
    assert worded("housing_temperature") == ("housing temperature", "°C", 1.0)
    assert all(
        worded(name)[1]
        for name in ("travel", "following_error", "missed_cycles", "stale_data", "torsion_torque")
    )
    assert [number(v) for v in (3016.2, 0.07242, 22.1)] == ["3016", "0.0724", "22.1"]
    told = {
        "value": 0.0649,
        "unit": "N m",
        "low": 0.063,
        "high": 0.067,
        "identifiability": "weakly",
        "budget": [{"source": "scale", "kind": "B", "standard_uncertainty": 0.00125}],
    }
    result = result_from_mapping(
        {"run": "7", "kind": "starting-torque", "parameters": {"starting_torque": told}}
    )
    assert result_lines(result) == ["starting torque 64.9 ± 2.5 mN m (weakly identifiable)"]


def test_every_live_plot_that_a_protocol_asks_for_is_there() -> None:
    wanted = {name for kind in catalogue.kinds() for name in catalogue.load(kind).live}
    assert wanted <= set(VIEWS)


def test_a_growing_file_is_read_once_and_goes_on_in_the_sealed_one(tmp_path: Path) -> None:
    """Rows and segments as a writer brings them; let go before it is renamed, as where an open file cannot be."""
    metadata = RunMetadata(
        run_id="00001-home",
        experiment="home",
        origin="simulated",
        sample_rate=1000.0,
        ratio=100.0,
        gear_mounted=False,
    )
    columns = (
        Column(Channel(name="input_angle", unit="rad", scale=1e-3)),
        Column(Channel(name="torque", unit="N m", scale=1e-4)),
    )
    writer = RunWriter(
        tmp_path / "00001-home.h5", RunHeader(metadata, columns), compress=False, chunk_rows=64
    )
    angle = np.arange(1000)
    seen: list[Block] = []

    def put(start: int, stop: int) -> None:
        rows = angle[start:stop]
        writer.append_rows(rows * 1_000_000, rows, np.zeros(len(rows), np.uint16), [rows, -rows])
        writer.flush()

    put(0, 300)
    clock = iter(range(1000))
    live = LiveFile(writer.part, clock=lambda: next(clock))
    live.want({"torque", "no_such_channel"})
    assert live.read(1.0, seen.append) == 300
    assert live.next_segment() is None
    writer.segment(Segment(index=0, label="hold", start=100, stop=350))
    put(300, 400)
    live.look()
    assert (live.rows, live.behind) == (400, 100)
    assert live.next_segment() is None, "its rows were not handed on yet"
    live.read(1.0, seen.append)
    found = live.next_segment()
    assert found is not None
    assert (found.label, live.next_segment()) == ("hold", None)
    put(400, 1000)
    live.close()
    sealed = writer.seal("COMPLETED")
    live.continue_in(sealed)
    live.look()
    live.read(1.0, seen.append)
    live.close()
    assert [block.start for block in seen] == [0, 300, 400]
    np.testing.assert_allclose(
        np.concatenate([block.si["torque"] for block in seen]), -1e-4 * angle
    )
    np.testing.assert_allclose(
        np.concatenate([block.time for block in seen]), 1e-3 * angle, atol=1e-12
    )


def test_what_is_first_seen_in_the_sealed_file_is_read_from_it(
    tmp_path: Path, session: WindowSession, qtbot: QtBot
) -> None:
    """The first steady rows of a quick run come with its end: the growing file has been let go of by then."""
    metadata = RunMetadata(
        run_id="00001-kinematic-error",
        experiment="kinematic-error",
        origin="simulated",
        sample_rate=1000.0,
        ratio=100.0,
    )
    names = ("input_angle", "output_angle", "target_speed", "torque", "input_index", "index_seen")
    columns = [Column(Channel(name=name, unit="1", scale=1e-2)) for name in names]
    writer = RunWriter(
        tmp_path / "00001-kinematic-error.h5", RunHeader(metadata, tuple(columns)), chunk_rows=64
    )

    def put(start: int, stop: int, speed: int) -> None:
        rows = np.arange(start, stop)
        still = np.full(len(rows), 0)
        turned = rows * speed
        channels = [turned, turned // 100, still + speed, still, still, still + 100]
        writer.append_rows(rows * 1_000_000, rows, np.zeros(len(rows), np.uint16), channels)
        writer.flush()

    put(0, 100, 0)
    plots, said = LivePlots(session), []
    qtbot.addWidget(plots)
    session.message.connect(said.append)
    plots.expect()
    plots.open(writer.part)
    put(100, 2000, 1)
    sealed = writer.seal("COMPLETED")
    plots.finish(sealed)
    (wave,) = [view for view in plots.views if isinstance(view, WaveView)]
    assert wave._rows.reference is not None
    assert (said, plots.rows_read) == ([], 2000)
    plots.close_file()
