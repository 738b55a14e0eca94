"""What differs between two runs, and only that: a table by group, results with the significance of their difference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtWidgets import QComboBox, QWidget

from rig.analysis.difference import Change, Difference, change_grid, difference
from rig.content.phrase import phrase
from rig.window.review.grid import GridTable
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    choice_box,
    in_column,
    in_row,
    text_label,
)
from rig.window.work.background import LatestTask

EVERYTHING = "everything that differs"
WIDEST = 170
"""Pixels of a column at first, so that the significance of a result is in view."""


class DifferenceView(QWidget):
    """A difference. `show_runs` works it out beside the window."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self.difference: Difference | None = None
        self.title = text_label("Difference", "title", wraps=True)
        self.says = text_label("", "muted", wraps=True)
        self.group = choice_box("Which group")
        self.group.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        self.group.currentIndexChanged.connect(lambda _: self._fill())
        self.table = GridTable(session, "Differences", widest=WIDEST)
        self._comparing = LatestTask(self, self._take, self.says.setText)
        head = in_row(text_label("show"), self.group, (self.says, 1))
        self.setLayout(in_column(self.title, head, (self.table, 1), margins=(8, 8, 8, 4)))

    def show_runs(self, first: Path, second: Path) -> None:
        """Compare two run files."""
        self.difference = None
        self.title.setText("Difference")
        self.group.clear()
        self.table.show_grid(change_grid(()))
        self.says.setText("Reading both runs …")
        self._comparing.start(lambda: difference(first, second))

    def _take(self, compared: Difference) -> None:
        self.difference = compared
        self.title.setText(f"{compared.first}  against  {compared.second}")
        counts = {group: len(compared.of(group)) for group in compared.compared}
        self.group.clear()
        self.group.addItem(EVERYTHING, "")
        for group, count in counts.items():
            if count:
                self.group.addItem(f"{group} ({count})", group)
        same = [group for group, count in counts.items() if not count and compared.compared[group]]
        looked_at = sum(compared.compared.values())
        text = "Nothing differs but number and time."
        if compared.differs:
            text = f"{len(compared.changes)} of {looked_at} things differ."
        self.says.setText(text + phrase(" The same in both: {}.", ", ".join(same)))
        self._fill()

    def _fill(self) -> None:
        if self.difference is None:
            return
        group = self.group.currentData()
        changes = self.difference.of(group) if group else self.difference.changes
        self.table.show_grid(change_grid(_results_first(changes)))


def _results_first(changes: Sequence[Change]) -> list[Change]:
    """The order in which a reader asks: what came out, then why."""
    return sorted(changes, key=lambda change: change.group != "results")
