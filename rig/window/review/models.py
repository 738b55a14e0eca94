"""Models judged by runs in the window: every rung of a ladder, fitted to some of the runs and judged on the others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from rig.analysis.validate import Validation
from rig.content.data import data_grid
from rig.content.grid import Grid
from rig.runfile.header import ORIGIN_WORDS
from rig.window.plot.result_plot import ResultPlot
from rig.window.review.grid import GridTable
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, split, text_label
from rig.window.work.background import BackgroundCommand, in_words, json_object


class ModelsView(QWidget):
    """A ladder of models. `show_runs` works it out beside the window, as `rig validate` does."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self.validation: Validation | None = None
        self.title = text_label("Models", "title", wraps=True)
        self.says = text_label("", "muted", wraps=True)
        self.plot = ResultPlot(session)
        self.table = GridTable(session, "Models")
        self._judging: BackgroundCommand | None = None
        upright = Qt.Orientation.Vertical
        both = split((self.plot, 1), (self.table, 0), sizes=[420, 260], way=upright)
        self.setLayout(in_column(self.title, self.says, (both, 1), margins=(8, 8, 8, 4)))

    def show_runs(self, paths: Sequence[Path]) -> None:
        """Judge the models by these runs, each held out in its turn."""
        self.cancel()
        self.validation = None
        self.title.setText(f"Models judged by {len(paths)} runs")
        self.says.setText("Every model is fitted to all runs but one, and judged on that one …")
        self.plot.clear_data()
        self.plot.set_labels("", "", "")
        self.table.show_grid(Grid("", (), ()))
        words = ["validate", *(str(path) for path in paths), "--json"]
        self._judging = BackgroundCommand(words, self, self._take)
        self._judging.start()

    def cancel(self) -> None:
        """Give up what is not done."""
        if self._judging is not None:
            self._judging.cancel()
            self._judging = None

    def _take(self, code: int, out: str, complaint: str) -> None:
        self._judging = None
        content = json_object(out) if code == 0 else None
        if content is None:
            self.says.setText(in_words(complaint))
            return
        found = self.validation = Validation.from_json(content)
        table = found.table()
        self.title.setText(table.title)
        self.says.setText(
            f"{found.sentence}. Least hold-out error: {found.best.name}; least BIC: {found.best_by_bic.name}."
        )
        self.plot.set_mark(ORIGIN_WORDS.get(found.origin, found.origin))
        self.plot.show_data(found.plot())
        self.table.show_grid(data_grid(table))
