"""A thousand painted frames take no reference away from None.

A binding that gives back one reference too many at each paint ends the interpreter after some
minutes of a run ("deallocating None"); PySide6 6.12.0 with pyqtgraph on Python 3.11 does.
References that are kept instead do no harm. Python 3.12 and later cannot die of it, and count
nothing.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from pytestqt.qtbot import QtBot

from rig.window.plot.plots import LabPlot
from rig.window.shell.session import WindowSession

FRAMES = 1000
MOST_LOST = 50
"""References that may be missing after all frames; the defect loses several in each."""


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
    plot.resize(240, 180)
    line, points = plot.curve("measured"), plot.curve("points", 1, "points")
    x = np.linspace(0.0, 1.0, 50)
    plot.show()
    qtbot.waitExposed(plot)
    for curve in (line, points):
        curve.item.setData(x, x)
    painted: list[int] = []
    watch_painting(line.item.curve, painted)
    plot.canvas.grab()
    before = sys.getrefcount(None)
    for frame in range(FRAMES):
        (line, points)[frame % 2].item.setData(x, x + 1e-3 * frame)
        plot.canvas.grab()
    assert sys.getrefcount(None) - before > -MOST_LOST
    assert len(painted) > FRAMES, "the curve was painted in every frame"
