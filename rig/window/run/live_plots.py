"""The board of live plots of one run: which plots a protocol shows, and how often they read and draw."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QGridLayout, QWidget

from experiments import catalogue
from experiments.contract import Experiment
from rig.errors import RunFileError
from rig.present.preview.plan import PlanPreview
from rig.run.dry_run import PlannedRun
from rig.runfile.header import ORIGIN_WORDS
from rig.window.plot.plots import LabPlot
from rig.window.run.kinematic_view import OutputView, WaveView
from rig.window.run.live_axes import RECENT
from rig.window.run.live_numbers import LiveNumbers
from rig.window.run.live_view import LiveContext, LiveView, SpeedView, temperature_view, torque_view
from rig.window.run.pacing import Pacer
from rig.window.run.points_view import StartingPoints, TorquePoints
from rig.window.run.steps_view import StepView
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, in_row, push_button, text_label
from rig.window.work.live_file import Block, LiveFile, open_live
from rig.window.work.segment_work import SegmentWork

_FRAME_MS = 25
"""ms between two looks at the file, and between two frames: forty a second."""
_COUNT_FRAMES = 8
"""Frames between two counts of the rows in words: nobody reads them faster, and each lays the page out anew."""
_READING_ALLOWED = 0.010
"""s of a frame that reading may take while it catches up."""
_SEGMENTS_ALLOWED = 0.005
"""s of a frame that the views may take to take in segments."""

Maker = Callable[[WindowSession, LiveContext], LiveView]
VIEWS: dict[str, Maker] = {
    "speed": SpeedView,
    "wave": WaveView,
    "torque": torque_view,
    "output": OutputView,
    "torque points": TorquePoints,
    "starting points": StartingPoints,
    "steps": StepView,
    "temperature": temperature_view,
}
"""The live plots by the names under which protocols ask for them, in the order of the grid, row by
row. A board of three gives the second plot the whole height of its column.
"""


class LivePlots(QWidget):
    """Draws one growing run. `open` begins, `finish` reads what is left."""

    drawn = Signal()
    """A frame has brought new rows to the screen."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.live: LiveFile | None = None
        self.views: list[LiveView] = []
        self.plots: list[LabPlot] = []
        self.mark = ""
        self.protocol = ""
        self.begun: list[float] = []
        """When each step of the plan began, so far, since the start of the run [s]."""
        self.numbers = LiveNumbers()
        """The latest values, to be laid out by the page."""
        self._frames = 0
        self._pacer = Pacer()
        self._work: SegmentWork | None = None
        self._is_over = False
        self._waiting_for: Path | None = None
        self._seen: LiveContext | None = None
        """What the views of this run share."""
        self._context: tuple[PlannedRun | None, PlanPreview | None] = (None, None)
        self._grid_holder = QWidget()
        self._hint = text_label(
            "No run yet. Prepare one, then its plots appear here.",
            "muted",
            align=Qt.AlignmentFlag.AlignCenter,
        )
        self._recent = push_button(
            f"latest {RECENT:g} s", tip="Show the latest seconds instead of the whole run (Ctrl+L)"
        )
        self._recent.setCheckable(True)
        self._recent.setShortcut("Ctrl+L")
        self._recent.toggled.connect(lambda _: self._draw())
        self._rows = text_label("", "muted", align=Qt.AlignmentFlag.AlignRight)
        foot = in_row(self._recent, (self._rows, 1))
        self._column = in_column((self._hint, 1), foot, margins=(0, 0, 0, 0), spacing=4)
        self.setLayout(self._column)
        self._recent.setVisible(False)
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.setInterval(_FRAME_MS)
        self._timer.timeout.connect(self.refresh)
        session.theme_changed.connect(lambda _: self._draw())

    @property
    def rows_read(self) -> int:
        """Rows of the run that were drawn."""
        return self.live.rows_read - self._pacer.waiting if self.live is not None else 0

    def expect(
        self, planned: PlannedRun | None = None, prediction: PlanPreview | None = None
    ) -> None:
        """A run is about to begin: forget the one before."""
        self.close_file()
        self.views, self.plots, self.mark, self.protocol = [], [], "", ""
        self.numbers.clear()
        self._grid_holder.hide()
        self._recent.setVisible(False)
        self._rows.clear()
        self._hint.setText("The plots appear as soon as the run writes its file.")
        self._hint.setVisible(True)
        self._context, self.begun = (planned, prediction), []

    def open(self, path: Path) -> None:
        """Follow this file as soon as it can be opened."""
        if self.live is None and self._waiting_for is None:
            self._waiting_for = path
            self._timer.start()
            self.refresh()

    def refresh(self) -> None:
        """One look: read within the time allowed, draw if there is something new."""
        if self.live is None:
            self._begin()
        if self.live is None or self._work is None:
            return
        try:
            fresh = 0 if self._is_over else self._read_more(self.live)
            ended = self._take_segments() + self._work.deliver()
        except RunFileError as error:
            self._session.message.emit(str(error))
            self._timer.stop()
            return
        if fresh or ended:
            self._frames += 1
            self._draw()
            if self._frames % _COUNT_FRAMES == 1:
                self._count()
            self.drawn.emit()
        if self._is_over and not ended and self._work.is_idle:
            self._timer.stop()

    def finish(self, path: Path) -> None:
        """The run is sealed at `path`: read what is left, from there, and stop looking. What the
        last segments say may take
        a little longer to be worked out."""
        self._timer.stop()
        if self.live is None:
            self._waiting_for = self._waiting_for or path
            self._begin()
        if self.live is None:
            return
        try:
            self._finish_work()
            self.live.continue_in(path)
            if self._seen is not None:
                # The growing file was let go of: nothing can be read from it any more.
                self._seen.recording = self.live.recording
            self.live.look()
            self.live.read(float("inf"), self._pacer.put)
            self._take_all(self._pacer.rest())
            self._take_segments()
        except RunFileError as error:
            self._session.message.emit(str(error))
        self._is_over = True
        self._draw()
        self._count()
        self.drawn.emit()
        self._timer.start()

    def release(self) -> None:
        """Let go of the file before its writer renames it, where an open file cannot be renamed (Windows)."""
        if os.name == "nt" and self.live is not None:
            self._timer.stop()
            self._finish_work()
            self.live.close()

    def close_file(self) -> None:
        """Forget the run."""
        self._timer.stop()
        if self._work is not None:
            self._work.close()
        if self.live is not None:
            self.live.close()
        self._work, self._is_over = None, False
        self.live, self._waiting_for = None, None
        self._pacer = Pacer()

    def _begin(self) -> None:
        if self._waiting_for is None:
            return
        live = open_live(self._waiting_for)
        if live is None or not live.rows:
            if live is not None:
                live.close()
            return
        self._waiting_for, self.live = None, live
        metadata = live.recording.metadata
        self.protocol, self.mark = metadata.experiment, ORIGIN_WORDS[metadata.origin]
        self._work = SegmentWork()
        self._seen = context = LiveContext(
            live.recording, *self._context, work=self._work, begun=self.begun
        )
        # A recording of nobody's protocol gets the board of a protocol that asks for nothing special.
        experiment = catalogue.declared(self.protocol) or Experiment
        self._lay_out([VIEWS[name](self._session, context) for name in experiment.live])
        self.numbers.begin(live.recording)
        wanted = (*self.numbers.wanted, *(name for view in self.views for name in view.wanted))
        live.want(set(wanted))

    def _lay_out(self, views: Sequence[LiveView]) -> None:
        """Two columns: speed and torque on the left, what the protocol is about on the right."""
        self._hint.setVisible(False)
        self._recent.setVisible(True)
        self._column.removeWidget(self._grid_holder)
        self._grid_holder.deleteLater()
        self._grid_holder = QWidget()
        grid = QGridLayout(self._grid_holder)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(6)
        self.views, places = list(views), [(0, 0), (0, 1), (1, 0), (1, 1)]
        self.plots = [view.plot for view in views]
        self.plots += [view.residual.plot for view in views if isinstance(view, StepView)]
        for plot, (row, column) in zip(self.plots, places, strict=False):
            spans = 2 if len(self.plots) == 3 and column == 1 else 1
            grid.addWidget(plot, row, column, spans, 1)
        for index in (0, 1):
            grid.setRowStretch(index, 1)
            grid.setColumnStretch(index, 1)
        for plot in self.plots:
            plot.set_mark(self.mark)
        self._column.insertWidget(0, self._grid_holder, 1)

    def _finish_work(self) -> None:
        if self._work is not None:
            self._work.finish()

    def _take_all(self, blocks: Sequence[Block]) -> int:
        """Give the views the rows of this frame; returns how many."""
        for block in blocks:
            self.numbers.take(block)
            for view in self.views:
                view.take(block)
        return sum(map(len, blocks))

    def _read_more(self, live: LiveFile) -> int:
        """Look, read, and give the views the rows of this frame; returns how many."""
        if self._pacer.expects:
            live.look()
        live.read(_READING_ALLOWED, self._pacer.put)
        return self._take_all(self._pacer.due(behind=live.behind > 0))

    def _take_segments(self) -> int:
        """Tell the views of segments that have ended, as many as the work on them has room for."""
        assert self.live is not None
        begin, count = time.monotonic(), 0
        while not count or time.monotonic() - begin < _SEGMENTS_ALLOWED:
            segment = None if self._work is None or self._work.is_full else self.live.next_segment()
            if segment is None:
                break
            count += 1
            for view in self.views:
                view.ended(segment, self.live.recording)
        return count

    def _draw(self) -> None:
        """Bring every view up to date; those that have nothing new change nothing, and are not painted."""
        for view in self.views:
            view.draw(self._recent.isChecked())

    def _count(self) -> None:
        self.numbers.show_latest()
        if self.live is not None:
            self._rows.setText(
                f"{self.rows_read:,} of {self.live.rows:,} cycles drawn".replace(",", "\u202f")
            )
