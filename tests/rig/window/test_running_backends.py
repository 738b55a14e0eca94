"""The Run page on every rig: the simulated devices on the wire, a replayed run, and hardware as far
as a hub can stand for it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.order import Order
from rig.run.start import plan_order
from rig.run.state import State
from rig.window.main import MainWindow
from rig.window.shell.session import WindowSession
from rig.window.work.prepared import PreparedRun
from tests.rig.served_rig import served_rig
from tests.rig.slow_computer import says_too_slow
from tests.rig.window.conftest import LONGEST

RATE = 100.0
QUICK = {
    "speeds_rpm": (300.0,),
    "up_and_down": False,
    "measure_time": 0.3,
    "settle_time": 0.2,
    "zero_time": 0.5,
}
FLAGS = [
    "--speeds-rpm",
    "300",
    "--no-up-and-down",
    "--measure-time",
    "0.3",
    "--settle-time",
    "0.2",
    "--zero-time",
    "0.5",
]
LONG = {**QUICK, "measure_time": 60.0}
LONG_FLAGS = [flag.replace("0.3", "60") for flag in FLAGS]


def prepared(
    session: WindowSession,
    backend: str,
    values: dict[str, Any],
    flags: list[str],
    confirmation: str = "",
    **more: Any,
) -> PreparedRun:
    request = Order(
        protocol="friction",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=session.folder,
        values=values,
        backend=backend,
        serial="SN-0815",
        operator="A. Example",
        **more,
    )
    arguments = [
        "run",
        "friction",
        "--backend",
        backend,
        "--gear",
        "SN-0815",
        "--operator",
        "A. Example",
        "--output",
        str(session.folder),
        *flags,
    ]
    arguments += ["--confirm", confirmation] if confirmation else []
    for name, option in (("config", "--config"), ("sample_rate", "--sample-rate")):
        arguments += [option, str(more[name])] if name in more else []
    return PreparedRun(request, plan_order(request), [*arguments, "--events", "--stdin-control"])


def run_to_its_end(window: MainWindow, run: PreparedRun, qtbot: QtBot) -> None:
    window.start(run)
    qtbot.waitUntil(lambda: window.run.state.ended, timeout=LONGEST)


def shown_marks(window: MainWindow) -> set[str]:
    return {plot.mark for plot in window.run.plots.plots}


def test_on_the_wire_and_replayed(window: MainWindow, session: WindowSession, qtbot: QtBot) -> None:
    run_to_its_end(window, prepared(session, "wire", QUICK, FLAGS), qtbot)
    assert window.run.banner.word == "COMPLETED: NOT JUDGED", window.run.report
    assert shown_marks(window) == {"SIMULATED"}
    rows, path = window.run.report["rows"], Path(window.run.report["path"])
    assert window.run.plots.rows_read == rows
    run_to_its_end(window, prepared(session, f"replay:{path}", QUICK, FLAGS), qtbot)
    assert window.run.banner.word == "COMPLETED: NOT JUDGED", window.run.report
    assert shown_marks(window) == {"REPLAY"}
    assert (window.run.report["rows"], window.run.plots.rows_read) == (rows, rows)


@pytest.mark.realtime
def test_through_the_drivers_of_hardware_in_real_time(
    window: MainWindow, session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    with served_rig(RATE) as served:
        more = {
            "confirmation": "SN-0815",
            "config": served.configuration(tmp_path),
            "sample_rate": RATE,
        }
        window.start(prepared(session, "hardware", LONG, LONG_FLAGS, **more))

        def ended() -> bool:
            return window.run.state.ended

        qtbot.waitUntil(lambda: ended() or window.run.state.state is State.RUNNING, timeout=LONGEST)
        qtbot.waitUntil(lambda: ended() or window.run.plots.rows_read > 100, timeout=LONGEST)
        # The devices call themselves simulated, and so is the run, although it went the way of hardware.
        assert shown_marks(window) == {"SIMULATED"}
        qtbot.mouseClick(window.run.buttons.stop, Qt.MouseButton.LeftButton)
        qtbot.waitUntil(ended, timeout=LONGEST)
    if says_too_slow(str(window.run.report)):
        assert window.run.state.safe
        return
    assert window.run.banner.word == "FINISHED: ABORTED", window.run.report
    assert window.run.state.safe
    assert any("guard: closed" in text for text in window.run.events.texts)
