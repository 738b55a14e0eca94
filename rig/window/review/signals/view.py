"""The recorded channels of a run over time: chosen ones stacked by their unit, with segments, events, a readout and
two cursors; what is seen can be taken along.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import (
    QFileDialog,
    QListWidgetItem,
    QWidget,
)

from experiments.recording import Recording
from rig.errors import RunFileError
from rig.window.plot.plots import Curve, LabPlot
from rig.window.review.marks import MarksItem, TimeMarks, marks_of, segment_words
from rig.window.review.signals.cursors import Cursors
from rig.window.review.signals.data import (
    LABORATORY,
    SI,
    SPEEDS,
    Shape,
    channels_of,
    drawn_in,
    duration_of,
    rows_between,
    shapes_of,
    thinning,
    values_at,
)
from rig.window.review.signals.export import export_picture, export_rows
from rig.window.review.signals.stretch import stretches_of
from rig.window.shell.palette import Palette
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    check_state,
    choice_box,
    in_column,
    in_row,
    push_button,
    room_for,
    set_tip,
    side_list,
    split,
    text_label,
)
from rig.window.work.background import LatestTask, single_shot

_ZOOM_PAUSE_MS = 90
"""ms after the last movement of the view until finer data are read."""
_UNITS_KEY = "signals.units"
_AT_FIRST = ("input_speed", "torque")
"""Channels that are drawn at first, where a run has them."""
_MOST_PLOTS = 4
"""Units, and with that plots, that stand over each other at most."""
AXIS_WIDTH = 62
"""Pixels of the axis beside each plot."""
_HINT = "Point at a curve to read it; drag or turn the wheel to zoom."
_FIRST_LOOK = "A first look at some of the rows; all of them are being read …"
_EVENT_REACH = 6.0
"""Pixels within which an event is named."""
FORMATS = {"Rows as text (*.csv)": ".csv", "Picture (*.png)": ".png", "Drawing (*.svg)": ".svg"}
"""What is seen can be taken along as."""


class SignalsView(QWidget):
    """Signals of one run. `show_recording` opens, `jump` centres a time."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._recording: Recording | None = None
        self._marks = TimeMarks()
        self._unread: Callable[[], list[Shape]] | None = None
        """Reads every row of a stretch of which a first look is being taken."""
        self._end = 0.0
        self._mark = ""
        self.plots: dict[str, LabPlot] = {}
        """The plots by the unit of their axis."""
        self.curves: dict[str, Curve] = {}
        """The curves by channel."""
        self._drawn_marks: dict[str, MarksItem] = {}
        session.theme_changed.connect(self._restyle)
        self.channels = side_list("Channels", 130, spacing=1, wraps=False)
        self.channels.itemChanged.connect(lambda _: self._rebuild())
        self.readout = text_label(_HINT, "muted", wraps=True)
        self._reading = LatestTask(self, self._draw, self.readout.setText)
        self._marker = LatestTask(self, self._take_marks)
        self.cursors = Cursors(session)
        self._between = LatestTask(self, self.cursors.show_stretches, self.readout.setText)
        self._measuring = single_shot(self, _ZOOM_PAUSE_MS, self._measure)
        self.cursors.moved.connect(self._measuring.start)
        self.cursors.switch.toggled.connect(self._set_cursors)
        self._writing = LatestTask(self, self._say_written, session.message.emit)
        self.choose_target: Callable[[str], Path | None] = self._ask_target
        """Asks where what is seen is written; it is given a name to begin with."""
        self.export = push_button(
            "E&xport …",
            tip="What is seen: every row of these channels between the cursors, else in view (CSV, SI), "
            "or the plots as they are (PNG, SVG)",
            act=self._export,
        )
        self.whole = push_button("&Whole run", tip="Show the whole run again", act=self.show_all)
        self.units = choice_box("Units of all signals", (LABORATORY, SI))
        self.units.setCurrentText(str(session.recall(_UNITS_KEY, LABORATORY)))
        self.units.currentTextChanged.connect(self._change_units)
        self._stack = split(way=Qt.Orientation.Vertical)
        self._pause = single_shot(self, _ZOOM_PAUSE_MS, self._read)
        self._lay_out()

    def _lay_out(self) -> None:
        foot = in_row((self.readout, 1), self.units, self.export, self.whole)
        parts = ((self._stack, 1), self.cursors, foot)
        right = room_for(in_column(*parts, margins=(0, 0, 0, 0), spacing=3))
        both = split(self.channels, (right, 1), sizes=[200, 680])
        self.setLayout(in_column(both, margins=(4, 6, 4, 4)))

    @property
    def chosen(self) -> list[str]:
        """The channels that are drawn."""
        items = (self.channels.item(row) for row in range(self.channels.count()))
        return [
            item.data(Qt.ItemDataRole.UserRole)
            for item in items
            if item.checkState() is Qt.CheckState.Checked
        ]

    @property
    def view(self) -> tuple[float, float]:
        """The stretch in view [s]."""
        first = next(iter(self.plots.values()), None)
        return (0.0, self._end) if first is None else tuple(first.item.getViewBox().viewRange()[0])

    @property
    def is_busy(self) -> bool:
        """Whether something is being measured or written."""
        return self._between.is_running or self._writing.is_running

    def show_recording(self, recording: Recording, mark: str) -> None:
        """Another run, or the same one that has grown."""
        same = (
            self._recording is not None
            and self._recording.metadata.run_id == recording.metadata.run_id
        )
        checked = self.chosen if same else []
        at_end = not same or self.view[1] >= self._end
        self._recording, self._mark = recording, mark
        self._end = duration_of(recording)
        self.cursors.limit(self._end)
        channels = channels_of(recording, self.units.currentText())
        checked = (
            [name for name in checked if name in channels]
            or [name for name in _AT_FIRST if name in channels][:2]
            or [*channels][:1]
        )
        if not same or self.channels.count() != len(channels):
            self._offer(channels, checked)
            self._rebuild()
        if at_end:
            self.show_all()
        if not same and self.cursors.is_on:
            self.cursors.place_within(0.0, self._end)
        self._marker.start(lambda: marks_of(recording))

    def clear(self) -> None:
        """No run."""
        self._recording = None
        self.channels.clear()
        self._rebuild()

    def choose(self, *names: str) -> None:
        """Draw these channels and no others."""
        with QSignalBlocker(self.channels):
            for row in range(self.channels.count()):
                item = self.channels.item(row)
                item.setCheckState(check_state(item.data(Qt.ItemDataRole.UserRole) in names))
        self._rebuild()

    def show_all(self) -> None:
        """The whole run in view, and each curve as high as its plot."""
        for plot in self.plots.values():
            plot.item.enableAutoRange(y=True)
        self._look_at(0.0, max(self._end, 1e-3))

    def jump(self, moment: float, width: float = 10.0) -> None:
        """A few seconds around a moment in view."""
        self._look_at(moment - 0.5 * width, moment + 0.5 * width)

    def _look_at(self, begin: float, end: float) -> None:
        for plot in self.plots.values():
            plot.item.setXRange(begin, end, padding=0.01)
        self._pause.start()

    def _offer(self, channels: dict[str, tuple[str, str]], checked: list[str]) -> None:
        with QSignalBlocker(self.channels):
            self.channels.clear()
            for name, (what, unit) in channels.items():
                words = name.replace("_", " ")
                item = QListWidgetItem(f"{words} [{unit}]" if unit not in ("", "1") else words)
                set_tip(item, what)
                item.setData(Qt.ItemDataRole.UserRole, name)
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsUserCheckable)
                item.setCheckState(check_state(name in checked))
                self.channels.addItem(item)

    def _rebuild(self) -> None:
        """One plot per unit of the chosen channels."""
        begin, end = self.view
        for plot in self.plots.values():
            plot.setParent(None)
            plot.deleteLater()
        self.plots, self.curves, self._drawn_marks = {}, {}, {}
        if self._recording is None:
            return
        channels = channels_of(self._recording, self.units.currentText())
        for place, name in enumerate(self.chosen):
            unit = channels[name][1]
            plot = self.plots.get(unit) or (
                self._new_plot(unit) if len(self.plots) < _MOST_PLOTS else None
            )
            if plot is not None:
                self.curves[name] = plot.curve(name.replace("_", " "), place)
        plots = list(self.plots.values())
        for plot in plots[:-1]:
            plot.item.setLabel("bottom", "")
            plot.item.setXLink(plots[-1].item)
        self._look_at(begin, end)
        self._draw_marks()
        self.cursors.draw_in(plots)

    def _new_plot(self, unit: str) -> LabPlot:
        shown = unit if unit not in ("", "1") else "counts"
        plot = LabPlot(
            self._session, "", "time since the first row [s]", f"[{shown}]", mark=self._mark
        )
        plot.item.enableAutoRange(x=False, y=True)
        plot.item.setAutoVisible(y=True)
        plot.item.getViewBox().moves_along_x = True
        # One width for all, so that one moment is at one place in every plot.
        plot.item.getAxis("left").setWidth(AXIS_WIDTH)
        plot.item.sigXRangeChanged.connect(lambda *_: self._pause.start())
        scene: Any = plot.canvas.scene()
        scene.sigMouseMoved.connect(lambda place, plot=plot: self._point(plot, place))
        self.plots[unit] = plot
        self._stack.addWidget(plot)
        return plot

    def _read(self) -> None:
        recording, names = self._recording, self.chosen
        if recording is not None and names:
            rows = rows_between(recording, *self.view)
            units, thinned = self.units.currentText(), thinning(rows.stop - rows.start)
            self._unread = None

            def look(thinned: int) -> list[Shape]:
                return shapes_of(recording, names, rows, units=units, thinned=thinned)

            if thinned > 1:
                self._unread = lambda: look(1)
            self._reading.start(lambda: look(thinned))

    def _set_cursors(self, on: bool) -> None:
        if on:
            begin, end = self.view
            self.cursors.place_within(max(begin, 0.0), min(end, self._end))

    def _measure(self) -> None:
        recording, names, stretch = self._recording, list(self.curves), self.cursors.stretch
        if recording is not None and self.cursors.is_on:
            units = self.units.currentText()
            self._between.start(lambda: stretches_of(recording, names, *stretch, units))

    def _change_units(self, units: str) -> None:
        """Draw every signal in other units, over the same stretch."""
        self._session.remember(_UNITS_KEY, units)
        if self._recording is not None:
            self._offer(channels_of(self._recording, units), self.chosen)
            self._rebuild()
            self._measure()

    def _export(self) -> None:
        recording, names = self._recording, list(self.curves)
        if recording is None or not names:
            return
        target = self.choose_target(f"{recording.metadata.run_id or 'run'}-signals")
        if target is None:
            return
        if target.suffix.lower() != ".csv":
            try:
                export_picture(self._stack, f"{recording.metadata.run_id} {self._mark}", target)
            except RunFileError as error:
                self._session.message.emit(str(error))
            else:
                self._say_written(f"Written: {target}")
            return
        begin, end = self.cursors.stretch if self.cursors.is_on else self.view

        def write() -> str:
            rows = export_rows(recording, names, begin, end, target)
            return f"Written: {target}, {rows} rows"

        self._session.message.emit(f"Writing {target.name} …")
        self._writing.start(write)

    def _say_written(self, words: str) -> None:
        self._session.message.emit(words)

    def _ask_target(self, name: str) -> Path | None:
        if not self._session.free_for("Exporting signals"):
            return None
        begin = str(self._session.folder / f"{name}.csv")
        title = "Where is what is seen written?"
        chosen, kind = QFileDialog.getSaveFileName(self, title, begin, ";;".join(FORMATS))
        if not chosen:
            return None
        target, suffix = Path(chosen), FORMATS.get(kind, ".csv")
        # What is typed counts before what is chosen below it; a name without a kind takes that one.
        return target if target.suffix.lower() in FORMATS.values() else Path(f"{target}{suffix}")

    def _draw(self, shapes: list[Shape]) -> None:
        for shape in shapes:
            curve = self.curves.get(shape.name)
            if curve is not None:
                curve.item.setData(shape.time, shape.values)
        # A long stretch: what was drawn is a first look, and the rest is read now.
        if self._unread is not None:
            self.readout.setText(_FIRST_LOOK)
            self._reading.start(self._unread)
            self._unread = None
        elif self.readout.text() == _FIRST_LOOK:
            self.readout.setText(_HINT)

    def _take_marks(self, marks: TimeMarks) -> None:
        self._marks = marks
        self._draw_marks()

    def _draw_marks(self) -> None:
        for unit, plot in self.plots.items():
            old = self._drawn_marks.pop(unit, None)
            if old is not None:
                plot.item.removeItem(old)
            item = MarksItem(self._marks, self._session.palette)
            plot.item.addItem(item, ignoreBounds=True)
            self._drawn_marks[unit] = item

    def _restyle(self, palette: Palette) -> None:
        for item in self._drawn_marks.values():
            item.restyle(palette)

    def _point(self, plot: LabPlot, place: Any) -> None:
        """What stands under the pointer, in words."""
        box = plot.item.getViewBox()
        recording = self._recording
        if recording is None or not box.sceneBoundingRect().contains(place):
            return
        moment = float(box.mapSceneToView(place).x())
        if not 0.0 <= moment <= self._end:
            return
        self.readout.setText(
            "   ".join(self._words(recording, moment, _EVENT_REACH * float(box.viewPixelSize()[0])))
        )

    def _words(self, recording: Recording, moment: float, reach: float) -> list[str]:
        words = [f"{moment:.3f} s"]
        for name, value in values_at(
            recording, [n for n in self.curves if n not in SPEEDS], moment
        ).items():
            factor, unit = drawn_in(recording.signals[name].unit, self.units.currentText())
            words.append(f"{name.replace('_', ' ')} {value / factor:.6g} {unit}".rstrip())
        segment = self._marks.segment_at(moment)
        if segment is not None:
            words.append(segment_words(segment, recording.metadata.experiment))
        event = self._marks.event_near(moment, reach)
        if event is not None:
            words.append(f"{event.level}: {event.text}")
        return words
