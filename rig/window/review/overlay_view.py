"""Several runs over each other in the window: each is fitted beside the window, then their common
figures can be chosen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import (
    QListWidgetItem,
    QProgressBar,
    QWidget,
)

from experiments.result import Result
from rig.analysis.store import read_analyses
from rig.errors import RigError
from rig.library.index import IndexedRun
from rig.runfile.header import ORIGIN_WORDS
from rig.window.plot.overlay import Overlaid, common_figures, mark_of, overlay, short_names
from rig.window.plot.result_plot import ResultPlot
from rig.window.review.fit import FitDesk, FitOrder, ResultCache, order_of
from rig.window.review.table_model import local_time
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    check_state,
    choice_box,
    in_column,
    in_row,
    push_button,
    set_tip,
    side_list,
    split,
    text_label,
)


@dataclass
class _Line:
    """One run of the overlay as it comes along."""

    run: IndexedRun
    name: str
    order: FitOrder
    result: Result | None = None
    problem: str = ""


class OverlayView(QWidget):
    """An overlay. `show_runs` begins it; `cancel` leaves the runs that are not there yet out."""

    def __init__(self, session: WindowSession, cache: ResultCache) -> None:
        super().__init__()
        self._session = session
        self._lines: list[_Line] = []
        self.desk = FitDesk(cache, self)
        self.title = text_label("Overlay", "title")
        self.figure = choice_box("Figure")
        self.figure.setMinimumContentsLength(12)
        self.runs = side_list("Runs of the overlay", 150)
        self.plot = ResultPlot(session)
        self.says = text_label("", "muted", wraps=True)
        self.busy = QProgressBar()
        self.busy.setFormat("fitted %v of %m")
        self.stop = push_button("Cancel", act=self.cancel)
        self.figure.currentIndexChanged.connect(lambda _: self._draw())
        self.runs.itemChanged.connect(lambda _: self._offer())
        self.desk.fitted.connect(self._take)
        self.desk.refused.connect(self._refuse)
        self.desk.progressed.connect(self._progress)
        session.theme_changed.connect(lambda _: self._list())
        self._lay_out()
        self._progress(0, 0)

    def _lay_out(self) -> None:
        head = in_row(self.title, (self.figure, 1), self.busy, self.stop)
        both = split(self.runs, (self.plot, 1), sizes=[190, 680])
        self.setLayout(in_column(head, (both, 1), self.says, margins=(8, 8, 8, 4)))

    def show_runs(self, runs: Sequence[IndexedRun], library: Mapping[str, Path]) -> None:
        """Overlay these runs; `library` knows where the tares of their analyses are."""
        self.desk.cancel()
        names = short_names({run.path.name: (run.number, run.gear_serial) for run in runs})
        self._lines = [_Line(run, names[run.path.name], _order(run, library)) for run in runs]
        self.title.setText(f"Overlay of {len(runs)} runs")
        self._list()
        self._offer()
        self.desk.ask(*(line.order for line in self._lines))

    def cancel(self) -> None:
        """Give up the fits that are not done."""
        self.desk.cancel()

    @property
    def overlaid(self) -> list[Overlaid]:
        """The runs that are there and wanted."""
        runs = []
        for row, line in enumerate(self._lines):
            item = self.runs.item(row)
            if (
                line.result is not None
                and item is not None
                and item.checkState() is Qt.CheckState.Checked
            ):
                mark = ORIGIN_WORDS.get(line.run.origin, line.run.origin)
                runs.append(Overlaid(line.name, mark, line.result.plots, row))
        return runs

    def _take(self, order: FitOrder, result: Result) -> None:
        for line in self._lines:
            if line.order == order:
                line.result, line.problem = result, ""
        self._list()
        self._offer()

    def _refuse(self, order: FitOrder, complaint: str) -> None:
        for line in self._lines:
            if line.order == order:
                line.problem = complaint
        self._list()
        self._offer()

    def _progress(self, done: int, asked: int) -> None:
        running = asked > done
        self.busy.setVisible(running)
        self.stop.setVisible(running)
        if running:
            self.busy.setRange(0, asked)
            self.busy.setValue(done)
        self._draw()

    def _list(self) -> None:
        """The runs with their colours, and whether they are there."""
        with QSignalBlocker(self.runs):
            hidden = [
                row
                for row in range(self.runs.count())
                if (item := self.runs.item(row)) and item.checkState() is Qt.CheckState.Unchecked
            ]
            keep = self.runs.count() == len(self._lines)
            self.runs.clear()
            for row, line in enumerate(self._lines):
                unfitted = "\ncannot be fitted" if line.problem else "\nbeing fitted …"
                state = "" if line.result else unfitted
                item = QListWidgetItem(
                    f"{line.name}\n{line.run.protocol}, {local_time(line.run.start)}{state}"
                )
                set_tip(item, line.problem or line.run.path.name)
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsUserCheckable)
                item.setCheckState(check_state(not (keep and row in hidden)))
                item.setIcon(_swatch(self._session.palette.series_colour(row)))
                self.runs.addItem(item)

    def _offer(self) -> None:
        """The figures that at least two runs have."""
        figures = common_figures(self.overlaid)
        chosen = self.figure.currentData()
        with QSignalBlocker(self.figure):
            self.figure.clear()
            for name, title in figures.items():
                self.figure.addItem(title, name)
            self.figure.setCurrentIndex(max(0, self.figure.findData(chosen)))
        self._draw()

    def _draw(self) -> None:
        name = self.figure.currentData()
        runs = self.overlaid
        overlaid = overlay(runs, name) if name else None
        if overlaid is None:
            self.plot.clear_data()
            self.plot.set_labels("", "", "")
            self.says.setText(self._why_nothing())
            return
        self.plot.set_mark(mark_of(runs))
        self.plot.show_data(overlaid.plot)
        self.says.setText(" ".join((*overlaid.left_out, *self.plot.remarks)))

    def _why_nothing(self) -> str:
        problems = [f"{line.name}: {line.problem}" for line in self._lines if line.problem]
        if problems:
            return "\n".join(problems)
        if self.desk.is_running:
            return "The runs are being fitted. Their figures appear as they are done."
        return "These runs have no figure in common: choose runs of one protocol."


def _order(run: IndexedRun, library: Mapping[str, Path]) -> FitOrder:
    """The newest stored analysis made again; without one the fit of the run's protocol."""
    try:
        stored = read_analyses(run.path)
    except RigError:
        stored = ()
    return order_of(stored[-1], run.path, library) if stored else FitOrder(run.path)


def _swatch(colour: str) -> QIcon:
    picture = QPixmap(14, 14)
    picture.fill(QColor(colour))
    return QIcon(picture)
