"""Another `rig` command run beside the window: its JSON when it ends, or why there is none."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QObject, QProcess, Signal

PATIENCE = 3000
"""ms that a process is given to end when its window is closed."""


class SideProcess(QObject):
    """One process at a time. `finished` carries its JSON object (None where it printed none), exit
    code, standard error.
    """

    finished = Signal(object, int, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._process: QProcess | None = None

    @property
    def is_running(self) -> bool:
        """Whether one is still at work."""
        return self._process is not None

    def start(self, arguments: Sequence[str]) -> bool:
        """Start `rig` with these arguments; False while another is at work."""
        if self._process is not None:
            return False
        process = QProcess(self)
        process.setProgram(sys.executable)
        process.setArguments(["-m", "rig", *arguments])
        process.finished.connect(self._ended)
        process.errorOccurred.connect(self._failed)
        self._process = process
        process.start()
        return True

    def stop(self) -> None:
        """End it and wait for it; nothing is told of it."""
        process, self._process = self._process, None
        if process is None:
            return
        process.blockSignals(True)
        process.terminate()
        if not process.waitForFinished(PATIENCE):
            process.kill()
            process.waitForFinished(PATIENCE)
        process.deleteLater()

    def _failed(self, error: QProcess.ProcessError) -> None:
        if error is QProcess.ProcessError.FailedToStart and self._process is not None:
            self._process.deleteLater()
            self._process = None
            self.finished.emit(None, -1, "the program cannot be started")

    def _ended(self, code: int, _: QProcess.ExitStatus) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        output = bytes(process.readAllStandardOutput().data()).decode(errors="replace")
        told = bytes(process.readAllStandardError().data()).decode(errors="replace").strip()
        process.deleteLater()
        self.finished.emit(_json_object(output), code, told)


def _json_object(text: str) -> dict[str, Any] | None:
    try:
        found = json.loads(text)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
