"""A parameter set held against a run: value beside value, and how well the set predicts what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtWidgets import QTextBrowser, QWidget

from model.errors import ModelError
from model.gear import HarmonicDrive
from model.gear_file import load_gear
from rig.analysis.adopt import Comparison, comparison_grid
from rig.analysis.result_data import result_from_mapping
from rig.analysis.rows import metric_grid
from rig.window.review.grid import GridTable
from rig.window.review.words import facts_html, grid_html
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    set_tip,
    text_label,
)


class ComparisonView(QWidget):
    """What `rig validate --against --json` told."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._content: Mapping[str, Any] = {}
        self.title = text_label("", "heading", wraps=True)
        self.table = GridTable(session, "Parameter set against run")
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

    def show_comparison(self, content: Mapping[str, Any], parameters: Path) -> None:
        """What was told of a run and a parameter set."""
        self._content = content
        compared = content.get("comparison") or {}
        rows = [Comparison.from_json(path, row) for path, row in compared.items()]
        kind, run, against = (content.get(key, "") for key in ("kind", "run", "parameter_set"))
        self.title.setText(f"{kind}: run {run} against the set {against}")
        set_tip(self.title, str(parameters))
        self.table.show_grid(comparison_grid(rows, _gear(parameters)))
        self.table.setVisible(bool(rows))
        self.nothing.setVisible(not rows)
        self._write()

    def _write(self) -> None:
        content, palette = self._content, self._session.palette
        told = {key: content.get(key, "") for key in ("run", "kind")}
        metrics = content.get("metrics", {})
        scored = result_from_mapping({**told, "parameters": {}, "metrics": metrics})
        merits = replace(metric_grid(scored), title="How well the set predicts")
        warnings = [("", str(text)) for text in content.get("warnings", ())]
        self.page.setHtml(
            facts_html("To beware of", warnings, palette)
            + (grid_html(merits, palette) if merits.rows else "")
        )


def _gear(path: Path) -> HarmonicDrive | None:
    """The set, for the names of its values only: without it they go by their paths."""
    try:
        return load_gear(path)
    except (ModelError, OSError):
        return None
