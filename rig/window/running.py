"""The Run page: what the rig is doing, as it does it, and the one large STOP."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from rig.window.prepared import PreparedRun
from rig.window.session import WindowSession


class RunPage(QWidget):
    """Watches one run at a time, from its start to its verdict."""

    review_requested = Signal(Path)
    state_changed = Signal(str)
    closed_safely = Signal()

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.is_active = False
        column = QVBoxLayout(self)
        column.addWidget(QLabel("No run yet. Prepare one."))

    def start(self, prepared: PreparedRun) -> None:
        """Start a prepared run."""

    def may_close(self) -> bool:
        """Whether the window may be closed now."""
        return True
