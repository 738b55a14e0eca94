"""The pre-flight checklist: every item with its result, its evidence and a box that the operator ticks.

A failed item cannot be ticked, it has to be put right. A tick belongs to its evidence: when that changes, it is gone.
"""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QSizePolicy, QWidget

from experiments.finding import Finding, Severity
from rig.window.shell.stack import (
    emptied,
    set_tip,
    text_label,
)

SIGNS = {
    Severity.PASSED: ("✓ ok", "good"),
    Severity.NOTES: ("✓ note", "good"),
    Severity.WARNS: ("! warning", "warning"),
    Severity.BLOCKS: ("✗ failed", "bad"),
    Severity.NOT_LOOKED_AT: ("- not looked at", "muted"),
}
"""Severity of a finding: how it is shown, and the part of the style sheet that colours it."""


class Checklist(QWidget):
    """The items of a checklist. `changed` tells that one was ticked, or that the items are others."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._checks: tuple[Finding, ...] = ()
        self._ticked: set[Finding] = set()
        self.boxes: list[QCheckBox] = []
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(10)
        self._grid.setVerticalSpacing(3)
        self._grid.setColumnStretch(3, 1)

    @property
    def checks(self) -> tuple[Finding, ...]:
        """The items."""
        return self._checks

    @property
    def failed(self) -> tuple[Finding, ...]:
        """Items that have to be put right."""
        return tuple(check for check in self._checks if check.severity is Severity.BLOCKS)

    @property
    def open(self) -> tuple[Finding, ...]:
        """Items that are neither failed nor ticked."""
        return tuple(
            c for c in self._checks if c.severity is not Severity.BLOCKS and c not in self._ticked
        )

    def set_checks(self, checks: Sequence[Finding]) -> None:
        """Show other items; ticks stay on those whose result and evidence are the same."""
        fresh = tuple(dict.fromkeys(checks))
        if fresh == self._checks:
            return
        focused = next((i for i, box in enumerate(self.boxes) if box.hasFocus()), None)
        self._checks = fresh
        self._ticked &= set(fresh)
        emptied(self._grid)
        for row in range(self._grid.rowCount()):
            self._grid.setRowStretch(row, 0)
        self.boxes = [self._add(row, check) for row, check in enumerate(fresh)]
        self._grid.setRowStretch(len(fresh), 1)
        if focused is not None and focused < len(self.boxes):
            self.boxes[focused].setFocus()
        self.changed.emit()

    def tick_all(self) -> None:
        """Tick everything that is not failed."""
        for box in self.boxes:
            if box.isEnabled():
                box.setChecked(True)

    def clear_ticks(self) -> None:
        """Take every tick away: the next run is another run."""
        for box in self.boxes:
            box.setChecked(False)

    def _add(self, row: int, check: Finding) -> QCheckBox:
        box = QCheckBox()
        box.setEnabled(check.severity is not Severity.BLOCKS)
        box.setChecked(check in self._ticked)
        box.setAccessibleName(f"{check.what}: {check.found}")
        set_tip(box, "Seen and accepted" if box.isEnabled() else "Has to be put right first")
        box.toggled.connect(lambda on, check=check: self._tick(check, on))
        words, part = SIGNS[check.severity]
        sign = text_label(words, part)
        found = check.found
        if check.remedy and check.severity is not Severity.PASSED:
            found += f"\n→ {check.remedy}"
        text = text_label(found, wraps=True, selectable=True)
        text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        text.setMinimumSize(1, 1)
        for column, widget in enumerate((box, sign, text_label(check.what))):
            self._grid.addWidget(widget, row, column, Qt.AlignmentFlag.AlignTop)
        self._grid.addWidget(text, row, 3, Qt.AlignmentFlag.AlignTop)
        return box

    def _tick(self, check: Finding, on: bool) -> None:
        (self._ticked.add if on else self._ticked.discard)(check)
        self.changed.emit()
