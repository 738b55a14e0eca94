"""The window without a screen: Qt draws into memory, and every test has a folder, a session and a window of its own."""

from __future__ import annotations

import gc
import os
import sys

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt is imported anywhere

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.run.start import RunRequest, plan_request
from rig.window.child import RunProcess
from rig.window.main import MainWindow
from rig.window.prepared import PreparedRun
from rig.window.session import WindowSession
from rig.window.theme import apply_theme

CHILDREN = Path(__file__).with_name("children.py")
LONGEST = 40_000
"""ms that a test waits for something before it fails; nothing takes a fifth of it on an idle computer."""

MakePrepared = Callable[..., PreparedRun]


@pytest.fixture(autouse=True)
def collector_in_the_main_thread() -> Iterator[None]:
    """No other thread takes a window apart: what a test leaves is collected here, as `rig.window.collector` does it."""
    gc.disable()
    yield
    gc.collect(0)
    gc.enable()


@pytest.fixture
def session(tmp_path: Path, qapp: Any) -> Iterator[WindowSession]:
    """The shared state of a window over an empty folder of runs."""
    made = WindowSession(tmp_path / "runs")
    made.folder.mkdir()
    apply_theme(qapp, made.theme)
    yield made
    made.deleteLater()


@pytest.fixture
def window(session: WindowSession, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> Iterator[MainWindow]:
    """A window on its Run page, the other pages left empty. At the end its run is let go, and has to make itself safe."""
    monkeypatch.setattr("rig.window.main._page", lambda module, name, session: QWidget())
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
        request = RunRequest(
            protocol, shipped_gear(), shipped_motor(), session.folder, values or {}, gear_serial="SN-0815",
            operator="A. Example",
        )  # fmt: skip
        arguments = ["run", protocol, "--backend", "sim", "--gear", "SN-0815", "--operator", "A. Example"]
        arguments += ["--output", str(session.folder), *flags, "--events", "--stdin-control"]
        return PreparedRun(request, plan_request(request), arguments)

    return make


def child(kind: str, *arguments: str) -> RunProcess:
    """A run of `children.py`."""
    return RunProcess([kind, *arguments], program=(sys.executable, str(CHILDREN)))
