"""Training: a fault is let happen on a simulated rig of its own, and what came of it is shown.
Never where hardware is.
"""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QDialog,
    QListWidget,
    QListWidgetItem,
    QWidget,
)

from rig.content.phrase import phrase
from rig.window.shell.stack import in_column, in_row, line_field, push_button, restyled, text_label
from rig.window.work.background import BackgroundCommand, json_object


class TrainingDialog(QDialog):
    """The list of drills, and the verdict on the one that was run (`rig sim drill --fault NAME --json`)."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Training drills")
        self.resize(640, 520)
        self.search = line_field("Search drills", "search, for instance: guard, encoder, heartbeat")
        self.search.textChanged.connect(self._filter)
        self.drills = QListWidget()
        self.drills.setAccessibleName("Drills")
        self.drills.currentItemChanged.connect(lambda *_: self._describe())
        self.drills.itemActivated.connect(lambda _: self.run())
        self.what = text_label(wraps=True)
        self.verdict = text_label(wraps=True, selectable=True)
        self.run_button = push_button("&Run this drill", "primary", act=self.run)
        self.run_button.setDefault(True)
        close = push_button("C&lose", act=self.reject)
        self._drill: BackgroundCommand | None = None
        explained = text_label(
            "Something goes wrong on a simulated rig of its own; the program has to notice, "
            "make the rig safe and keep the file. "
            "What would you do at the rig? Decide first, then look.",
            wraps=True,
        )
        row = in_row((None, 1), self.run_button, close)
        self.setLayout(in_column(explained, self.search, self.drills, self.what, self.verdict, row))
        self._fill()

    def _fill(self) -> None:
        from rig.trial.drill.catalogue import every_drill

        for drill in every_drill().values():
            item = QListWidgetItem(drill.name)
            item.setData(
                Qt.ItemDataRole.UserRole, f"{drill.what} (on {' or '.join(drill.carriers)})"
            )
            self.drills.addItem(item)
        self.drills.setCurrentRow(0)

    def _filter(self, text: str) -> None:
        for row in range(self.drills.count()):
            item = self.drills.item(row)
            text_of_item = f"{item.text()} {item.data(Qt.ItemDataRole.UserRole)}".lower()
            item.setHidden(text.lower() not in text_of_item)
        # What is run is what is seen: a choice that the search has hidden gives way to the first that is left.
        shown = [
            self.drills.item(row)
            for row in range(self.drills.count())
            if not self.drills.item(row).isHidden()
        ]
        if self.drills.currentItem() not in shown:
            self.drills.setCurrentRow(self.drills.row(shown[0]) if shown else -1)
        self._show_runnable()

    def _describe(self) -> None:
        item = self.drills.currentItem()
        words = "No drill is called so."
        if item is not None:
            words = str(item.data(Qt.ItemDataRole.UserRole))
        self.what.setText(words)

    def _show_runnable(self) -> None:
        self.run_button.setEnabled(self.drills.currentItem() is not None and not self.is_running)

    @property
    def is_running(self) -> bool:
        """Whether a drill is at work."""
        return self._drill is not None and self._drill.is_running

    def run(self) -> None:
        """Run the chosen drill."""
        item = self.drills.currentItem()
        if item is None or self.is_running:
            return
        self._drill = BackgroundCommand(
            ["sim", "drill", "--fault", item.text(), "--json"], self, self._take_verdict
        )
        self._drill.start()
        self.run_button.setEnabled(False)
        restyled(self.verdict, "muted")
        self.verdict.setText(f"{item.text()}: running on a simulated rig …")

    def _take_verdict(self, code: int, output: str, complaint: str) -> None:
        self.show_verdict(json_object(output), code, complaint.strip())

    def show_verdict(self, answer: dict[str, Any] | None, code: int, complaint: str) -> None:
        """What came of the drill: its JSON object, exit code, standard error."""
        self._show_runnable()
        rows = (answer or {}).get("faults")
        if not rows:
            restyled(self.verdict, "bad")
            self.verdict.setText(
                f"The drill did not come to an end (exit code {code}). {complaint}"
            )
            return
        row = rows[0]
        restyled(self.verdict, "good" if row.get("passed") else "bad")
        self.verdict.setText(verdict_text(row))

    def done(self, result: int) -> None:
        """Close; a drill that is at work is ended."""
        if self._drill is not None and self._drill.is_running:
            self._drill.cancel()
        super().done(result)


_SEEN = {
    "passed": ("✗ did NOT end as it must", "✓ ended as it must"),
    "safe": ("the motor does NOT stand", "the motor stands without power"),
    "verified": ("standstill not verified: the loudest alarm there is", "standstill verified"),
    "file_readable": ("file NOT readable", "file readable"),
}
"""What a drill looks at, by its key: in words where it is not so, and where it is."""


def verdict_text(row: dict[str, Any]) -> str:
    """One row of `rig sim drill --json` in sentences."""
    passed, safe, verified, readable = (pair[bool(row.get(key))] for key, pair in _SEEN.items())
    text = (
        f"{passed}: {row.get('fault')}\nDetected: {row.get('detected')}, after "
        f"{row.get('cycles')} SYNC cycles. Action: "
        f"{row.get('action')}; {safe}; {verified}.\nOutcome: {row.get('outcome')} (must be "
        f"{row.get('expected')}); {readable}."
    )
    return text + phrase("\n{}", row.get("message", ""))
