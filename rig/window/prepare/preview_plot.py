"""The plan as pictures: speed and predicted torque over the nominal time, the output, friction over
speed, the margins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QTableWidget,
    QTableWidgetItem,
    QTabWidget,
    QWidget,
)

from rig.present.preview.figures import figures_of
from rig.present.preview.plan import PlanPreview, PredictedMargin, predicted_grid
from rig.window.plot.plots import LabPlot
from rig.window.shell.sentence import cut_short
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    read_only,
    room_for,
    set_tip,
    split,
)

FIGURES = {
    "speed": ("Input speed", "nominal time [s]", "speed [r/min]"),
    "torque": ("Torque at the motor", "nominal time [s]", "torque [N m]"),
    "output": ("Output speed", "nominal time [s]", "speed [r/min]"),
    "kinematic-error": ("Kinematic error", "input angle [deg]", "error [arcmin]"),
    "friction": ("Running torque", "input speed [r/min]", "torque [N m]"),
}
"""The plots and what they are called while they are empty."""
_PREDICTION = "PREDICTION"
_LONGEST_NAME = 16
"""Letters of a name on a button."""


class PreviewPlots(QTabWidget):
    """A plan's preview in tabs. `show_preview(None)` empties them."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self._preview: PlanPreview | None = None
        self.plots = {
            name: LabPlot(session, *labels, mark=_PREDICTION) for name, labels in FIGURES.items()
        }
        """Every plot by the name of its figure."""
        self.margins = _table(predicted_grid(()).headings)
        plots = self.plots
        for name in ("torque", "output"):
            plots[name].item.setXLink(plots["speed"].item)
        self.addTab(_stacked(plots["speed"], plots["torque"]), "P&lan")
        self.addTab(_stacked(plots["output"], plots["kinematic-error"]), "&Output")
        self.addTab(_stacked(plots["friction"]), "&Friction")
        self.addTab(self.margins, "&Margins")
        session.theme_changed.connect(lambda _: self.show_preview(self._preview))

    def show_preview(self, preview: PlanPreview | None) -> None:
        """Draw a preview."""
        self._preview = preview
        for name, plot in self.plots.items():
            plot.clear_data()
            plot.set_labels(*FIGURES[name])
        self.margins.setRowCount(0)
        if preview is None:
            return
        figures = figures_of(preview)
        self.setTabEnabled(1, "output" in figures)
        for name, figure in figures.items():
            plot = self.plots[name]
            plot.show_data(figure)
            if figure.x_scale == "log":
                low, high = float(figure.series[0].x[0]), float(figure.series[0].x[-1])
                plot.item.getAxis("bottom").setTicks(log_ticks(low, high))
        self._fill_margins(preview.margins)

    def _fill_margins(self, margins: Sequence[PredictedMargin]) -> None:
        palette, grid = self._session.palette, predicted_grid(margins)
        self.margins.setRowCount(len(margins))
        for row, (margin, cells) in enumerate(zip(margins, grid.rows, strict=True)):
            for column, text in enumerate(cells):
                item = QTableWidgetItem(text)
                set_tip(item, f"{text}\n{margin.limit}")
                if column in (3, 4):
                    item.setTextAlignment(
                        Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
                    )
                if margin.touches:
                    item.setForeground(QColor(palette.warning))
                self.margins.setItem(row, column, item)


def log_ticks(low: float, high: float) -> list[list[tuple[float, str]]]:
    """Ticks of a logarithmic axis: 1, 2, 5 of every decade with a number, the others without."""
    major, minor = [], []
    for decade in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
        for digit in range(1, 10):
            value = digit * 10.0**decade
            if digit in (1, 2, 5):
                major.append((math.log10(value), f"{value:g}"))
            else:
                minor.append((math.log10(value), ""))
    return [major, minor]


def _stacked(*plots: LabPlot) -> QWidget:
    both = split(*plots, way=Qt.Orientation.Vertical)
    return room_for(in_column(both, margins=(4, 4, 4, 4)))


def _table(headings: Sequence[str]) -> QTableWidget:
    table = QTableWidget(0, len(headings))
    table.setHorizontalHeaderLabels(list(headings))
    read_only(table, "Margins to every limit")
    table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
    header = table.horizontalHeader()
    header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    header.setSectionResizeMode(len(headings) - 1, QHeaderView.ResizeMode.Stretch)
    return table


def summary(preview: PlanPreview) -> str:
    """The plan in one line."""
    from rig.run.progress import in_words

    planned = preview.planned
    return (
        f"{in_words(planned.nominal)} nominal, {in_words(planned.longest)} at most · "
        f"{planned.input_revolutions:.0f} input "
        f"revolutions · {len(planned.plan)} steps · about {planned.file_size() / 1e6:.1f} MB"
    )


def short_name(name: str) -> str:
    """A name as it fits on a button."""
    return cut_short(name, _LONGEST_NAME).replace("&", "&&")
