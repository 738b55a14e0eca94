"""The Run page as a person uses it: a whole run, STOP, a trip, an acquisition that dies, closing in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QWidget
from pytestqt.qtbot import QtBot

from experiments.recording import Recording
from rig.run.latch import LATCH_NAME
from rig.run.parts import Progress
from rig.run.state import LOST, State
from rig.runfile.read import close_recording, open_run
from rig.runfile.recover import recover_run
from rig.window.main import MainWindow
from rig.window.run.points_view import StartingPoints, TorquePoints
from rig.window.shell.session import WindowSession
from rig.window.work.child import RunProcess
from tests.rig.window.conftest import LONGEST, MakePrepared, begin, child

SIZES = ((1366, 768), (1920, 1080))
SHORT = {
    "speeds_rpm": (200.0, 600.0),
    "up_and_down": False,
    "measure_time": 0.3,
    "settle_time": 0.2,
    "zero_time": 0.5,
}
FLAGS = (
    "--speeds-rpm",
    "200",
    "600",
    "--no-up-and-down",
    "--measure-time",
    "0.3",
    "--settle-time",
    "0.2",
    "--zero-time",
    "0.5",
)


def outcome_in(path: Path) -> str:
    recording = open_run(path, digest=False)
    try:
        return recording.metadata.outcome
    finally:
        close_recording(recording)


def start_long_run(window: MainWindow, prepared: MakePrepared, qtbot: QtBot) -> None:
    """A friction run of hours of rig time, which no window is too slow to stop, and the wait until it turns."""
    window.start(prepared("friction", {"measure_time": 300.0}, "--measure-time", "300"))
    qtbot.waitUntil(lambda: window.run.state.state is State.RUNNING, timeout=LONGEST)


def wait_for_end(window: MainWindow, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: window.run.state.ended, timeout=LONGEST)


def test_a_full_friction_run(window: MainWindow, prepared: MakePrepared, qtbot: QtBot) -> None:
    states: list[str] = []
    window.run.state_changed.connect(states.append)
    window.start(prepared("friction", SHORT, *FLAGS))
    assert window.run.banner.word == "ARMED"
    assert window.run.buttons.is_live
    wait_for_end(window, qtbot)
    page = window.run
    assert page.banner.word == "COMPLETED: NOT JUDGED"
    assert not page.buttons.is_live
    assert page.buttons.stop.isEnabled(), "it can be pressed in every state"
    # Whether the short making safe is seen depends on the beat of the progress.
    assert [word for word in dict.fromkeys(states) if word != "stopping"] == [
        "armed",
        "running",
        "completed: not judged",
    ]
    # Every row of the run was drawn, every hold became a point, and nothing looks like hardware.
    assert page.plots.rows_read == page.report["rows"] > 5000
    # What was drawn is what is in the sealed file: the fastest speed, and no time but that of the run.
    x, y = page.plots.plots[0].curves[1].item.getData()
    assert (x.min(), x.max()) == (
        pytest.approx(0.0, abs=0.1),
        pytest.approx(1e-3 * page.report["rows"], rel=0.02),
    )
    assert 600.0 < np.abs(y).max() < 2500.0
    points = next(view for view in page.plots.views if isinstance(view, TorquePoints))
    segments = page.plots.live.recording.labelled("hold", "bracket") if page.plots.live else ()
    assert len(segments) >= 4
    qtbot.waitUntil(lambda: points.points == len(segments), timeout=LONGEST)
    assert [plot.mark for plot in page.plots.plots] == ["SIMULATED"] * 3
    assert "input_speed" in page.margins.shown
    assert any("standstill verified" in text for text in page.events.texts)
    assert float(page.events.clocks[-1]) == pytest.approx(page.report["rows"] * 1e-3, abs=0.2)
    for size in SIZES:
        window.resize(*size)
        qtbot.waitUntil(lambda: check_layout(window))


def test_the_end_of_a_run_leads_to_results_review_and_report(
    window: MainWindow, prepared: MakePrepared, qtbot: QtBot
) -> None:
    window.start(prepared("starting-torque", {"positions": 7}, "--positions", "7"))
    wait_for_end(window, qtbot)
    outcome = window.run.outcome
    points = next(view for view in window.run.plots.views if isinstance(view, StartingPoints))
    qtbot.waitUntil(lambda: points.points > 4, timeout=LONGEST)
    qtbot.waitUntil(lambda: "±" in outcome.results.text(), timeout=LONGEST)
    assert "starting torque" in outcome.results.text()
    assert "mN m" in outcome.results.text()
    with qtbot.waitSignal(window.run.review_requested) as asked:
        qtbot.mouseClick(outcome.review, Qt.MouseButton.LeftButton)
    assert asked.args == [Path(window.run.report["path"])]
    assert window.stack.currentIndex() == 2
    window.show_page("run")
    qtbot.mouseClick(outcome.report, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: outcome.report.text() == "Open report", timeout=LONGEST)
    page = Path(window.run.report["path"]).with_suffix(".html")
    assert "SIMULATED" in page.read_text(encoding="utf-8")


def test_stop_by_the_space_bar_and_a_note_before(
    window: MainWindow, prepared: MakePrepared, qtbot: QtBot
) -> None:
    start_long_run(window, prepared, qtbot)
    page = window.run
    # In the field the space bar writes; nowhere else.
    page.events.note.setFocus()
    qtbot.keyClicks(page.events.note, "smells of warm grease")
    assert page.state.state is State.RUNNING
    qtbot.keyClick(page.events.note, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: "smells of warm grease" in page.events.texts, timeout=LONGEST)
    page.buttons.stop.setFocus()
    qtbot.keyClick(page.buttons.stop, Qt.Key.Key_Space)
    assert page.banner.word == "STOPPING"
    wait_for_end(window, qtbot)
    assert page.banner.word == "FINISHED: ABORTED"
    assert page.state.safe
    assert "controlled stop" in page.outcome.text.text()
    assert outcome_in(Path(page.report["path"])) == "ABORTED"


def test_abort_from_another_page(window: MainWindow, prepared: MakePrepared, qtbot: QtBot) -> None:
    start_long_run(window, prepared, qtbot)
    window.show_page("review")
    assert window.stop.isVisible()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    qtbot.keyClick(window, Qt.Key.Key_Escape, Qt.KeyboardModifier.ShiftModifier)
    assert window.run.banner.word == "STOPPING"
    wait_for_end(window, qtbot)
    assert not window.stop.isVisible()
    assert window.run.report["make_safe"]["action"] == "quick stop"


def test_a_trip_names_cause_and_remedy(window: MainWindow, qtbot: QtBot) -> None:
    window.resize(*SIZES[1])
    page = window.run
    page._start_process = lambda _: child("trip", str(window.session.folder))
    begin(page, "drill")
    wait_for_end(window, qtbot)
    assert page.banner.word == "TRIPPED"
    assert page.state.cause in ("over_speed", "following_error", "over_torque")
    assert "What to do: " in page.outcome.text.text()
    assert "limit" in page.outcome.text.text()
    assert "rig acknowledge" in page.outcome.text.text()
    assert (window.session.folder / LATCH_NAME).exists()
    assert page.plots.rows_read == page.report["rows"]
    qtbot.waitUntil(lambda: check_layout(window))


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_crash_of_the_acquisition_is_told_loudly(
    window: MainWindow, prepared: MakePrepared, qtbot: QtBot
) -> None:
    start_long_run(window, prepared, qtbot)
    page = window.run
    qtbot.waitUntil(lambda: page.plots.rows_read > 0, timeout=LONGEST)
    assert page.process is not None
    os.kill(page.process.pid, signal.SIGKILL)
    wait_for_end(window, qtbot)
    assert page.banner.word == "LOST"
    assert page.state.safe is None
    assert LOST in page.outcome.text.text()
    assert "rig recover" in page.outcome.text.text()
    assert not page.buttons.is_live
    assert page.buttons.stop.isEnabled(), "it can be pressed in every state"
    # What was drawn is in the file, and the file can be recovered.
    part = next(window.session.folder.glob("*.part"))
    drawn = page.plots.rows_read
    page.plots.close_file()
    assert recover_run(part).rows >= drawn
    # A window with a lost run closes without a question: there is nothing left to stop.
    assert page.may_close()


def test_closing_during_a_run_asks_and_makes_safe(
    window: MainWindow, prepared: MakePrepared, qtbot: QtBot
) -> None:
    start_long_run(window, prepared, qtbot)
    page = window.run
    assert not window.close()
    asked = page.close_question
    assert asked.isVisible()
    qtbot.mouseClick(asked.stay, Qt.MouseButton.LeftButton)
    assert window.isVisible()
    assert not asked.isVisible()
    assert page.state.state is State.RUNNING
    window.show_page("review")
    assert not window.close()
    assert asked.isVisible(), "on the page Run, which comes to the front"
    with qtbot.waitSignal(page.closed_safely, timeout=LONGEST):
        qtbot.mouseClick(asked.leave, Qt.MouseButton.LeftButton)
        assert window.isVisible()
        assert not window.close()
    assert not window.isVisible()
    assert page.state.safe
    assert outcome_in(Path(page.report["path"])) == "ABORTED"


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_the_death_of_the_window_is_a_stop(tmp_path: Path, qtbot: QtBot) -> None:
    """A parent that is killed in the middle of a run: the pipe ends, the run stops and seals its file."""
    parent = (
        "import os, signal, subprocess, sys\n"
        "run = subprocess.Popen([sys.executable, '-m', 'rig', 'run', 'friction', '--output', sys.argv[1], '--events',"
        " '--stdin-control'], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)\n"
        "for line in run.stdout:\n"
        "    if b'progress' in line: os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", parent, str(tmp_path)], stderr=subprocess.DEVNULL, check=False
    )
    assert done.returncode == -signal.SIGKILL
    qtbot.waitUntil(
        lambda: any(tmp_path.glob("*.h5.sha256")) and any(tmp_path.glob("*.h5")), timeout=LONGEST
    )
    assert outcome_in(next(tmp_path.glob("*.h5"))) == "ABORTED"


def test_a_sealed_run_beside_the_growing_one_reads_the_same(
    session: WindowSession, qtbot: QtBot
) -> None:
    """One process that still holds a run open as growing and opens it sealed must not be handed the wrong chunks."""
    held: list[Recording] = []

    def hold(progress: Progress) -> None:
        if not held and progress.file and progress.elapsed > 30.0:
            held.append(open_run(progress.file, digest=False))
            run.stop()

    words = ["run", "friction", "--measure-time", "300", "--output", str(session.folder)]
    run = RunProcess([*words, "--events", "--stdin-control"])
    run.progress.connect(hold)
    with qtbot.waitSignal(run.finished, timeout=LONGEST):
        run.start()
    sealed = next(session.folder.glob("*.h5"))
    beside = open_run(sealed, digest=False)
    angle = beside.si("input_angle")
    for recording in (*held, beside):
        close_recording(recording)
    alone = open_run(sealed, digest=False)
    assert len(held) == 1
    assert np.ptp(alone.si("input_angle")) > 100.0
    np.testing.assert_array_equal(angle, alone.si("input_angle"))
    close_recording(alone)


def test_a_question_of_the_run(window: MainWindow, qtbot: QtBot) -> None:
    page = window.run
    page._start_process = lambda _: child("ask")
    begin(page, "asking")
    qtbot.waitUntil(lambda: page.prompt.isVisible(), timeout=LONGEST)
    assert "hand thermometer [°C]?" in page.prompt.question.text()
    qtbot.waitUntil(lambda: check_layout(window))
    assert page.banner.word == "WAITING FOR YOU"
    assert not page.prompt.field.hasFocus()
    page.prompt.field.setFocus()
    qtbot.keyClicks(page.prompt.field, "22.5")
    assert page.state.state is State.WAITING
    qtbot.waitUntil(lambda: page.prompt.is_armed)
    qtbot.keyClick(page.prompt.field, Qt.Key.Key_Return)
    wait_for_end(window, qtbot)
    assert not page.prompt.isVisible()
    assert "22.5" in page.events.texts
    assert page.banner.word == "FINISHED: COMPLETED"


def test_standstill_that_was_not_verified_is_the_loudest_thing(
    window: MainWindow, qtbot: QtBot
) -> None:
    page = window.run
    page._start_process = lambda _: child("unsafe")
    begin(page)
    wait_for_end(window, qtbot)
    assert page.banner.word == "TRIPPED"
    assert "press the emergency stop" in page.outcome.headline.text()
    assert "Press the emergency stop" in page.outcome.text.text()
    qtbot.waitUntil(lambda: check_layout(window))


def test_a_run_that_is_refused_says_why(window: MainWindow, qtbot: QtBot) -> None:
    page = window.run
    page._start_process = lambda _: child("mute")
    begin(page)
    wait_for_end(window, qtbot)
    assert page.banner.word == "NOT STARTED"
    assert "no such motor" in page.outcome.text.text()
    assert "Nothing has moved" in page.outcome.text.text()
    assert page.may_close()


def check_layout(window: MainWindow) -> None:
    """Nothing is cut off and nothing overlaps: every visible label has the room that it asks for,
    within the window. To be waited
    for: a layout follows its texts with the next turn of the event loop."""
    page = window.run
    rooms: list[tuple[QWidget, Any]] = []
    for widget in (
        page.banner,
        page.buttons.stop,
        page.buttons.abort,
        page.plots,
        page.margins.parentWidget(),
        page.events,
        page.outcome,
        page.prompt,
        page.close_question,
    ):
        if widget is None or not widget.isVisible():
            continue
        corner = widget.mapTo(window, widget.rect().topLeft())
        room = widget.rect().translated(corner)
        assert window.rect().contains(room), widget
        assert not any(room.intersects(other) for _, other in rooms), widget
        rooms.append((widget, room))
    for label in page.findChildren(QLabel):
        if (
            label.isVisible()
            and label.text()
            and not label.wordWrap()
            and label.textFormat() is not Qt.TextFormat.RichText
        ):
            assert label.width() >= label.sizeHint().width() - 1, label.text()
            assert label.height() >= label.sizeHint().height() - 1, label.text()
    for plot in page.plots.plots:
        for side in ("left", "bottom"):
            assert plot.item.getAxis(side).labelText.rstrip().endswith("]"), plot.item.getAxis(
                side
            ).labelText
