"""A thousand painted frames leave the reference count of None where it was.

A binding that takes one reference too many from None at each paint ends the interpreter after some minutes of a run
("deallocating None"); PySide6 6.12.0 with pyqtgraph does. Python 3.12 and later cannot die of it, and count nothing.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from pytestqt.qtbot import QtBot

from rig.window.plots import LabPlot
from rig.window.session import WindowSession

FRAMES = 1000
MOST_DRIFT = 200
"""References that frames may leave or take in all; the defect takes several per frame."""


def watch_painting(item: Any, painted: list[int]) -> None:
    """Count the paintings of an item."""
    kind = type(item)

    class Watched(kind):
        def paint(self, *arguments: Any) -> None:
            painted.append(1)
            super().paint(*arguments)

    item.__class__ = Watched


def test_a_thousand_frames(session: WindowSession, qtbot: QtBot) -> None:
    plot = LabPlot(session, "Motor torque", "time [s]", "motor torque [mN m]", mark="SIMULATED")
    qtbot.addWidget(plot)
    plot.resize(480, 240)
    lines = [plot.curve(name, k, style) for k, (name, style) in enumerate((("a", "line"), ("b", "dashed"), ("c", "points")))]
    x = np.linspace(0.0, 1.0, 100)
    y = np.sin(20.0 * x)
    plot.show()
    qtbot.waitExposed(plot)
    for line in lines:
        line.item.setData(x, y)
    painted = []
    for line in lines:
        watch_painting(line.item.curve if line.style != "points" else line.item.scatter, painted)
    plot.grab()
    before = sys.getrefcount(None)
    for frame in range(FRAMES):
        lines[frame % 3].item.setData(x, y + 1e-3 * frame)
        plot.grab()
    assert abs(sys.getrefcount(None) - before) < MOST_DRIFT
    assert len(painted) >= 3 * FRAMES, "every curve was painted in every frame"
