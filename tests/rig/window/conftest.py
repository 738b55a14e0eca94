"""The window without a screen: Qt draws into memory, and every test has a folder, a session and a window of its own."""

from __future__ import annotations

import contextlib
import gc
import io
import os
import shutil
import sys
import threading

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt is imported anywhere

from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

import rig.main
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.analysis.fit.recorded import store
from rig.analysis.fit.run import fit_run
from rig.bench.backends.order import Order
from rig.run.start import plan_order, run_order
from rig.window.main import MainWindow
from rig.window.review.page import ReviewPage
from rig.window.run.page import RunPage
from rig.window.shell.session import WindowSession
from rig.window.shell.theme import apply_theme
from rig.window.work.background import TASK, BackgroundCommand
from rig.window.work.child import RunProcess
from rig.window.work.prepared import PreparedRun
from tests.rig.window.reviewing import destroy

CHILDREN = Path(__file__).with_name("children.py")
LONGEST = 600_000
"""ms that a test waits for something before it fails; nothing takes a twentieth of it on an idle computer."""

QUICK = {
    "points": 6,
    "lowest_rpm": 300.0,
    "highest_rpm": 1500.0,
    "up_and_down": False,
    "bracket_every": 1000,
    "measure_time": 0.3,
    "settle_time": 0.2,
    "zero_time": 0.5,
}
TODAY = date(2025, 11, 25)

MakePrepared = Callable[..., PreparedRun]


@pytest.fixture(scope="session", autouse=True)
def what_stays() -> None:
    """What is there before the first window outlives it: no collection looks through it again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def collector_in_the_main_thread(what_stays: None) -> Iterator[None]:
    """No other thread takes a window apart: what a test leaves is collected here, as by `shell.collector`."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.fixture(autouse=True)
def windows_of_the_test_before(collector_in_the_main_thread: None) -> None:
    """At its end a test still holds its windows: a collection then would make them too old for the next one's. What
    its windows still do beside it comes to its end before the next one replaces a function of the program.
    """
    for thread in threading.enumerate():
        if thread.name == TASK:
            thread.join(LONGEST / 1e3)
    gc.collect(1)


class PatientBot(QtBot):
    """Waits for as long as a computer may take that has other things to do."""

    def waitUntil(self, callback: Callable[[], Any], *, timeout: int = LONGEST) -> None:
        super().waitUntil(callback, timeout=timeout)

    def waitSignal(self, signal: Any, *, timeout: int = LONGEST, **more: Any) -> Any:
        return super().waitSignal(signal, timeout=timeout, **more)


@pytest.fixture
def qtbot(qapp: Any, request: pytest.FixtureRequest) -> QtBot:
    """pytest-qt's own gives up after 5 s."""
    return PatientBot(request)


@pytest.fixture
def session(tmp_path: Path, qapp: Any) -> Iterator[WindowSession]:
    """The shared state of a window over an empty folder of runs."""
    made = WindowSession(tmp_path / "runs")
    made.folder.mkdir()
    apply_theme(qapp, made.theme)
    yield made
    made.deleteLater()


class EmptyPage(QWidget):
    """What the main window needs of a page that a test does not look at."""

    start_requested = Signal(object)
    run_requested = Signal(str, str)
    asking_changed = Signal()
    is_asking = False

    def __init__(self, session: WindowSession) -> None:
        super().__init__()

    def show_run(self, path: Path) -> None:
        """Nothing is shown."""

    def stop_asking(self) -> None:
        """Nothing turns."""

    def abort_asking(self) -> None:
        """Nothing turns."""


@pytest.fixture
def window(
    session: WindowSession, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> Iterator[MainWindow]:
    """A window on its Run page, the other pages left empty. At the end its run is let go, and has
    to make itself safe.
    """
    for name in ("PreparePage", "ReviewPage"):
        monkeypatch.setattr(f"rig.window.main.{name}", EmptyPage)
    made = MainWindow(session)
    qtbot.addWidget(made, before_close_func=_end_run)
    made.resize(1366, 768)
    made.show()
    made.show_page("run")
    made.run.outcome.open_report = False
    yield made
    process = made.run.process
    if process is not None and process.is_running:
        process.let_go()
        qtbot.waitUntil(lambda: not process.is_running, timeout=LONGEST)


def _end_run(window: MainWindow) -> None:
    """A window that a failed test left in the middle of a run must not ask."""
    window.run.state = type(window.run.state)()


@pytest.fixture
def prepared(session: WindowSession) -> MakePrepared:
    """Makes prepared runs on the simulated rig: `prepared(protocol, values, flags)`."""

    def make(protocol: str, values: dict[str, Any] | None = None, *flags: str) -> PreparedRun:
        request = Order(
            protocol=protocol,
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=session.folder,
            values=values or {},
            serial="SN-0815",
            operator="A. Example",
        )
        arguments = [
            "run",
            protocol,
            "--backend",
            "sim",
            "--gear",
            "SN-0815",
            "--operator",
            "A. Example",
        ]
        arguments += ["--output", str(session.folder), *flags, "--events", "--stdin-control"]
        return PreparedRun(request, plan_order(request), arguments)

    return make


def child(kind: str, *arguments: str) -> RunProcess:
    """A run of `children.py`."""
    return RunProcess([kind, *arguments], program=(sys.executable, str(CHILDREN)))


class SilentRun(RunProcess):
    """A run without a process: it says nothing, and keeps what is said to it."""

    def __init__(self) -> None:
        super().__init__([])
        self.said: list[str] = []

    def start(self) -> None:
        """Nothing is started."""

    def _say(self, line: str) -> None:
        self.said.append(line)


def begin(page: RunPage, title: str = "") -> None:
    """Let the page watch the run that a test has put in the place of a process, without a plan to compare with."""
    page._title = title
    page._begin(page._start_process([]), None, None)


def silent_run(window: MainWindow) -> SilentRun:
    """Let a silent run begin in a window."""
    run = SilentRun()
    window.run._start_process = lambda _: run
    begin(window.run, "Velocity steps, gear SN-0815-of-2025, A. Example of the day shift")
    return run


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two short friction runs of one gear on the simulated rig; the second one is analysed."""
    folder = tmp_path_factory.mktemp("simulated")
    for seed in (1, 2):
        request = Order(
            protocol="friction",
            gear=shipped_gear(),
            motor=shipped_motor(),
            folder=folder,
            values=QUICK,
            serial="SN-0815",
            operator="A. Example",
            seed=seed,
        )
        assert run_order(request).outcome == "COMPLETED"
    store(fit_run(sorted(folder.glob("*.h5"))[1]), "2025-11-21T05:00:00+00:00")
    return folder


@pytest.fixture
def friction(simulated: Path, session: WindowSession) -> list[Path]:
    """The two runs, in the folder of the window."""
    shutil.copytree(simulated, session.folder, dirs_exist_ok=True)
    return sorted(session.folder.glob("*.h5"))


@pytest.fixture
def opened(session: WindowSession, qtbot: QtBot) -> Iterator[Callable[..., ReviewPage]]:
    """Opens the page over the folder of the session; waits until the folder was read."""
    pages: list[ReviewPage] = []

    def make(**given: object) -> ReviewPage:
        page = ReviewPage(session, today=lambda: TODAY, **given)  # type: ignore[arg-type]
        pages.append(page)
        page.resize(1366, 700)
        page.show()
        qtbot.waitUntil(lambda: page.library.source.runs is not None, timeout=LONGEST)
        return page

    yield make
    for page in pages:
        page.details.cancel()
        page.overlay.cancel()
        destroy(page)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands work in this process instead of one of their own: the same words, without the seconds of a start."""

    def start(command: BackgroundCommand) -> None:
        out, aside = io.StringIO(), io.StringIO()
        code = 0
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(aside):
            try:
                rig.main.run(command._arguments[2:])
            except SystemExit as ended:
                code = int(ended.code or 0)
        QTimer.singleShot(0, lambda: command.done.emit(code, out.getvalue(), aside.getvalue()))

    monkeypatch.setattr(BackgroundCommand, "start", start)
