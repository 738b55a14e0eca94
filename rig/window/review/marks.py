"""Segments and events of a run as a plot over time shows them: every other segment shaded, events as upright lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QLineF, QRectF, Qt
from PySide6.QtGui import QPainter, QPainterPath

from experiments import catalogue
from experiments.recording import Event, Recording, Segment
from model.units import DEGREE, RPM
from rig.window.plot.plots import shade
from rig.window.shell.palette import Palette

_EVENT_COLOURS = {"error": "bad", "warning": "warning"}
"""Colours of the palette by level of an event; any other one is muted."""
_SETPOINTS = {"speed": (RPM, "r/min"), "torque": (1.0, "N m"), "position": (DEGREE, "°")}
"""Factor from SI and unit in which a set-point is read, by what a protocol sets its segments to."""


@dataclass(frozen=True)
class TimeMarks:
    """Segments and events at their times since the first row [s]."""

    segments: tuple[tuple[float, float, Segment], ...] = ()
    events: tuple[tuple[float, Event], ...] = ()

    def segment_at(self, moment: float) -> Segment | None:
        """The segment in which a time lies."""
        return next(
            (segment for begin, end, segment in self.segments if begin <= moment <= end), None
        )

    def event_near(self, moment: float, reach: float) -> Event | None:
        """The nearest event, if it is within reach [s]."""
        at, nearest = min(
            ((abs(t - moment), event) for t, event in self.events),
            default=(0.0, None),
            key=lambda pair: pair[0],
        )
        return nearest if at <= reach else None


def marks_of(recording: Recording) -> TimeMarks:
    """The marks of a recording."""
    if not recording.rows:
        return TimeMarks()
    first = int(recording.source.time_ns(0, 1)[0])

    def at(row: int) -> float:
        row = min(max(row, 0), recording.rows - 1)
        return (int(recording.source.time_ns(row, row + 1)[0]) - first) * 1e-9

    segments = tuple(
        (at(s.start), at(s.stop - 1), s) for s in recording.segments if s.stop > s.start
    )
    return TimeMarks(segments, tuple(((e.time_ns - first) * 1e-9, e) for e in recording.events))


def segment_words(segment: Segment, protocol: str) -> str:
    """A segment in words: label, set-point, direction, repeat."""
    parts = [f"segment {segment.index}: {segment.label}"]
    if segment.setpoint:
        experiment = catalogue.declared(protocol)
        factor, unit = _SETPOINTS["speed" if experiment is None else experiment.setpoint]
        parts.append(f"{segment.setpoint / factor:.5g} {unit}".replace(" °", "°"))
    if segment.direction:
        parts.append("forward" if segment.direction > 0 else "reverse")
    if segment.repeat:
        parts.append(f"repeat {segment.repeat}")
    return ", ".join(parts)


class MarksItem(pg.GraphicsObject):
    """The marks under the curves of one plot: as many as there are cost one item."""

    def __init__(self, marks: TimeMarks, palette: Palette) -> None:
        super().__init__()
        self._marks, self._palette = marks, palette
        self._begins = np.array([begin for begin, _, _ in marks.segments])
        self._ends = np.array([end for _, end, _ in marks.segments])
        self.setZValue(-50)

    def restyle(self, palette: Palette) -> None:
        """Draw in the colours of a theme."""
        self._palette = palette
        self.update()

    def viewRangeChanged(self) -> None:
        """The marks fill the height of the view, whatever it is."""
        self.prepareGeometryChange()

    def boundingRect(self) -> QRectF:
        """The view: the marks never decide what is seen."""
        return QRectF(self.viewRect() or QRectF())

    def dataBounds(self, *_: Any, **__: Any) -> tuple[None, None]:
        """Nothing that an automatic range has to hold."""
        return (None, None)

    def paint(self, painter: QPainter, option: Any = None, widget: Any = None) -> None:
        """Shades and lines of what is in view."""
        view = self.boundingRect()
        painter.setPen(Qt.PenStyle.NoPen)
        path = QPainterPath()
        seen = np.flatnonzero((self._ends >= view.left()) & (self._begins <= view.right()))
        for place in seen[seen % 2 == 0]:
            begin, end = float(self._begins[place]), float(self._ends[place])
            path.addRect(QRectF(begin, view.top(), end - begin, view.height()))
        painter.fillPath(path, shade(self._palette.muted, 26))
        for moment, event in self._marks.events:
            if view.left() <= moment <= view.right():
                colour = getattr(self._palette, _EVENT_COLOURS.get(event.level, "muted"))
                pen = pg.mkPen(shade(colour, 150), width=1.2, style=Qt.PenStyle.DashLine)
                painter.setPen(pen)
                painter.drawLine(QLineF(moment, view.top(), moment, view.bottom()))
