"""The main window: pages by keyboard, themes, what is remembered; and that no run ever loads Qt."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QPushButton
from pytestqt.qtbot import QtBot
from typer.testing import CliRunner

from experiments.result import Plot, Series
from experiments.steps.note import Prompt
from rig.errors import ConfigurationError
from rig.main import app
from rig.window.main import (
    PAGES,
    MainWindow,
    _defects_shown,
    open_window,
    refuse_a_screen_that_qt_cannot_use,
)
from rig.window.plot.plots import LabPlot
from rig.window.shell.collector import collector_in_this_thread
from rig.window.shell.palette import palette_of
from rig.window.shell.session import REMEMBERED_FILE, WindowSession
from rig.window.shell.theme import theme_named


def test_pages_by_keyboard(window: MainWindow, qtbot: QtBot) -> None:
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    for index in (2, 0, 3, 1):
        qtbot.keyClick(
            window, getattr(Qt.Key, f"Key_{index + 1}"), Qt.KeyboardModifier.ControlModifier
        )
        assert window.stack.currentIndex() == index, PAGES[index]


def test_light_and_dark_reach_every_plot_and_are_remembered(
    window: MainWindow, session: WindowSession
) -> None:
    plot = LabPlot(session, "t", "x [s]", "y [N m]", mark="SIMULATED")
    plot.curve("measured").item.setData([0.0, 1.0], [0.0, 1.0])
    assert session.theme == "light"
    window.switch_theme()
    assert session.theme == "dark"
    assert plot.canvas.backgroundBrush().color().name() == palette_of("dark").surface
    assert json.loads((session.folder / REMEMBERED_FILE).read_text())["theme"] == "dark"
    assert WindowSession(session.folder).recall("theme") == "dark"
    assert plot.mark == "SIMULATED"
    window.switch_theme()


def test_what_is_remembered_survives_damage(tmp_path: Path, qtbot: QtBot) -> None:
    folder = tmp_path / "runs"
    session = WindowSession(folder)
    session.remember("operator", "A. Example")
    assert WindowSession(folder).operator == "A. Example"
    (folder / REMEMBERED_FILE).write_text("{ half")
    assert WindowSession(folder).operator == ""
    blocked = tmp_path / "file"
    blocked.write_text("")
    unwritable = WindowSession(blocked / "runs")
    with qtbot.waitSignal(unwritable.message) as said:
        unwritable.remember("operator", "B")
    assert "cannot be written" in said.args[0]


def test_a_figure_of_a_result_is_drawn_with_its_units(session: WindowSession, qtbot: QtBot) -> None:
    import numpy as np

    plot = LabPlot(session)
    qtbot.addWidget(plot)
    x, y = np.array([1.0, 10.0, 100.0]), np.array([60.0, 50.0, 90.0])
    series = (
        Series(label="measured", x=x, y=y, style="points", low=y - 1.0, high=y + 1.0),
        Series(label="fit", x=x, y=y, style="line", low=y - 2.0, high=y + 2.0, group=1),
        Series(label="amplitude", x=x, y=y, style="bars", group=2),
        Series(label="steps", x=x, y=y, style="steps", group=3),
    )
    plot.show_data(
        Plot(
            name="friction",
            title="Friction",
            x_label="input speed [r/min]",
            y_label="torque [mN m]",
            series=series,
            x_scale="log",
        )
    )
    assert [curve.name for curve in plot.curves] == ["measured", "fit", "amplitude", "steps"]
    assert plot.item.getAxis("left").labelText == "torque [mN m]"
    assert not plot.item.getAxis("left").autoSIPrefix
    plot.clear_data()
    assert plot.curves == ()


def test_a_defect_is_told_and_the_window_stays(session: WindowSession, qtbot: QtBot) -> None:
    with _defects_shown(session), qtbot.waitSignal(session.message) as said:
        sys.excepthook(KeyError, KeyError("x"), None)
    assert "A defect of the program: KeyError" in said.args[0]
    log = Path(said.args[0].rpartition(" ")[2])
    assert "KeyError" in log.read_text()
    log.unlink()


def test_the_window_opens_and_closes(tmp_path: Path, qtbot: QtBot) -> None:
    def close_it() -> None:
        (shown,) = [
            w for w in QApplication.topLevelWidgets() if isinstance(w, MainWindow) and w.isVisible()
        ]
        assert shown.stack.currentIndex() == 2
        shown.close()

    QTimer.singleShot(50, close_it)
    assert open_window(tmp_path, theme="dark", page="review") == 0


def test_every_page_is_there(session: WindowSession, qtbot: QtBot) -> None:
    window = MainWindow(session)
    qtbot.addWidget(window)
    assert [type(page).__name__ for page in (window.prepare, window.run, window.review)] == [
        "PreparePage",
        "RunPage",
        "ReviewPage",
    ]
    assert window.run.may_close()


def test_garbage_is_collected_in_the_thread_of_the_window_only(qtbot: QtBot) -> None:
    """A thread that makes garbage never runs the collector; the timer does."""
    threads: set[str] = set()

    class Loop:
        def __init__(self) -> None:
            self.itself = self

        def __del__(self) -> None:
            threads.add(threading.current_thread().name)

    def waste() -> None:
        for _ in range(5000):
            Loop()

    gc.enable()
    with collector_in_this_thread():
        assert not gc.isenabled()
        worker = threading.Thread(target=waste, name="worker")
        worker.start()
        worker.join()
        assert threads == set()
        qtbot.waitUntil(lambda: threads == {threading.main_thread().name})
    assert gc.isenabled()


def test_the_theme_that_was_asked_for(qapp: object) -> None:
    assert theme_named("dark") == "dark"
    assert theme_named("light") == "light"
    assert theme_named("system") in ("light", "dark")


@pytest.mark.parametrize(
    "arguments", [["--theme", "pink"], ["--page", "four"], ["--config", "nowhere.toml"]]
)
def test_arguments_of_the_window_are_checked(arguments: list[str]) -> None:
    done = CliRunner().invoke(app, ["live", *arguments])
    assert done.exit_code != 0
    assert not isinstance(done.exception, AssertionError)


@pytest.mark.parametrize(
    ("flag", "value", "words"),
    [
        ("--backend", "nonsense", "no such rig"),
        ("--backend", "replay:nowhere.h5", "no such run to replay"),
        ("--runs", "{file}", "is no folder"),
        ("--runs", "{file}/runs", "is no folder"),
        ("--runs", "{refused}", "cannot be written (Permission denied)"),
        ("--runs", "{refused}/runs", "cannot be written (Permission denied)"),
    ],
)
def test_what_cannot_work_is_refused_before_a_window_opens(
    flag: str, value: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, refused = tmp_path / "file", tmp_path / "refused"
    file.write_text("")
    refused.mkdir()

    def no_file(dir: Path) -> None:
        assert dir == refused
        raise PermissionError(13, "Permission denied")

    def no_window(*_: object) -> int:
        raise AssertionError("a window was opened")

    monkeypatch.setattr("rig.run.preflight.tempfile.TemporaryFile", no_file)
    monkeypatch.setattr("rig.window.main.open_window", no_window)
    done = CliRunner().invoke(app, ["live", flag, value.format(file=file, refused=refused)])
    assert isinstance(done.exception, ConfigurationError)
    assert words in str(done.exception)
    assert flag in str(done.exception)


def test_a_folder_that_can_be_written_opens_and_nothing_is_left_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[object] = []
    monkeypatch.setattr("rig.window.main.open_window", lambda *a: (opened.append(a[0]), 0)[1])
    for folder in (tmp_path, tmp_path / "runs"):
        assert CliRunner().invoke(app, ["live", "--runs", str(folder)]).exit_code == 0
    assert opened == [tmp_path, tmp_path / "runs"]
    assert list(tmp_path.iterdir()) == []


def test_a_run_never_loads_qt(tmp_path: Path) -> None:
    """Everything that `rig run` imports, in a process of its own: no window, no Qt, no figures."""
    program = (
        "import sys\n"
        "import rig.main, rig.commands.running, rig.run.start, rig.run.realtime, rig.run.remote, rig.runfile.write\n"
        "print([name for name in ('PySide6', 'pyqtgraph', 'matplotlib', 'rig.window') if name in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout.strip() == "[]"


def test_enter_presses_the_button_that_has_the_focus(window: MainWindow, qtbot: QtBot) -> None:
    window.activateWindow()
    review = window._buttons.button(2)
    review.setFocus()
    qtbot.waitUntil(review.hasFocus)
    qtbot.keyClick(review, Qt.Key.Key_Return)
    assert window.stack.currentIndex() == 2


def test_enter_that_answers_a_question_presses_nothing_else(
    window: MainWindow, qtbot: QtBot
) -> None:
    window.activateWindow()
    pressed: list[str] = []
    buttons = window.findChildren(QPushButton)
    for button in buttons:
        button.clicked.connect(lambda _=False, name=button.text(): pressed.append(name))
    next_in_turn, prompt = window._buttons.button(0), window.run.prompt
    prompt.answered.connect(lambda _: next_in_turn.setFocus())
    prompt.ask(Prompt("Temperature [°C]?"))
    prompt.field.setFocus()
    qtbot.waitUntil(prompt.field.hasFocus)
    qtbot.keyClicks(prompt.field, "22")
    qtbot.waitUntil(lambda: prompt.is_armed)
    with qtbot.waitSignal(prompt.answered):
        qtbot.keyClick(prompt.field, Qt.Key.Key_Return)
    assert next_in_turn.hasFocus()
    assert pressed == []


def test_a_missing_library_of_x11_is_named_instead_of_an_abort(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "xcb")
    refuse_a_screen_that_qt_cannot_use("linux", tmp_path)
    (tmp_path / "libqxcb.so").write_text("no library")
    with pytest.raises(ConfigurationError, match="sudo apt install libxcb-cursor0"):
        refuse_a_screen_that_qt_cannot_use("linux", tmp_path)
    refuse_a_screen_that_qt_cannot_use("win32", tmp_path)
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    refuse_a_screen_that_qt_cannot_use("linux", tmp_path)
