"""A parameter set held against a run: value beside value, and how well the set predicts what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PySide6.QtWidgets import QTextBrowser, QWidget

from model.errors import ModelError
from model.gear import HarmonicDrive
from model.gear_file import load_gear
from rig.analysis.wording import metric, readable
from rig.window.review.grid import GridTable
from rig.window.review.results import COMPARISON_COLUMNS, comparison_rows
from rig.window.review.words import facts_html
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import in_column, text_label


class ComparisonView(QWidget):
    """What `rig compare --json` told."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._told: Mapping[str, Any] = {}
        self.title = text_label("", "heading", wraps=True)
        self.table = GridTable(session, "Parameter set against run", judged=("agrees",))
        self.nothing = text_label(
            "This run identifies no value that the parameter set holds.", "muted"
        )
        self.page = QTextBrowser()
        self.setLayout(
            in_column(
                self.title, self.nothing, (self.table, 3), (self.page, 2), margins=(6, 6, 6, 4)
            )
        )
        session.theme_changed.connect(lambda _: self._write())

    def show_comparison(self, told: Mapping[str, Any], parameters: Path) -> None:
        """What was told of a run and a parameter set."""
        self._told = told
        rows = comparison_rows(told, _gear(parameters))
        self.title.setText(
            f"{told.get('kind', '')}: run {told.get('run', '')} against the set {told.get('parameter_set', '')}"
        )
        self.title.setToolTip(str(parameters))
        self.table.show_rows(
            COMPARISON_COLUMNS, rows, (False, True, True, True, False, True, False)
        )
        self.table.setVisible(bool(rows))
        self.nothing.setVisible(not rows)
        self._write()

    def _write(self) -> None:
        told, palette = self._told, self._session.palette
        pairs = [
            (
                readable(name),
                "–" if value is None else metric(str(told.get("kind", "")), name, float(value)),
            )
            for name, value in told.get("metrics", {}).items()
        ]
        warnings = [("", str(text)) for text in told.get("warnings", ())]
        self.page.setHtml(
            facts_html("To beware of", warnings, palette)
            + facts_html("How well the set predicts", pairs, palette)
        )


def _gear(path: Path) -> HarmonicDrive | None:
    """The set, for the names of its values only: without it they go by their paths."""
    try:
        return load_gear(path)
    except (ModelError, OSError):
        return None
