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
import pytest
from pytestqt.qtbot import QtBot

from rig.window.plot.plots import LabPlot
from rig.window.shell.session import WindowSession

FRAMES = 1000
MOST_LOST = 50
"""References that may be missing after all frames; the defect loses several in each."""


def watch_painting(item: Any, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the paintings of an item, from now on.

    The method of its class is replaced, never the class of a Qt object: the binding looks methods up
    by the class that it made the object of, and ends the interpreter where that has changed.
    """
    painted: list[int] = []
    paint = type(item).paint

    def counted(one: Any, *arguments: Any) -> None:
        if one is item:
            painted.append(1)
        paint(one, *arguments)

    monkeypatch.setattr(type(item), "paint", counted)
    return painted


def test_a_thousand_frames(
    session: WindowSession, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    plot = LabPlot(session, "Motor torque", "time [s]", "motor torque [mN m]", mark="SIMULATED")
    qtbot.addWidget(plot)
    plot.resize(240, 180)
    line, points = plot.curve("measured"), plot.curve("points", 1, "points")
    x = np.linspace(0.0, 1.0, 50)
    plot.show()
    qtbot.waitExposed(plot)
    for curve in (line, points):
        curve.item.setData(x, x)
    painted = watch_painting(line.item.curve, monkeypatch)
    plot.canvas.grab()
    before = sys.getrefcount(None)
    for frame in range(FRAMES):
        (line, points)[frame % 2].item.setData(x, x + 1e-3 * frame)
        plot.canvas.grab()
    assert sys.getrefcount(None) - before > -MOST_LOST
    assert len(painted) > FRAMES, "the curve was painted in every frame"
