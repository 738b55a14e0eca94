"""A `rig` command that works while the window stays alive: a fit, a report. It turns no rig and may
be ended at any time.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from PySide6.QtCore import QObject, QProcess, QProcessEnvironment, Signal


class BackgroundCommand(QObject):
    """One command; `done` carries exit code, standard output and standard error. `start()` once."""

    done = Signal(int, str, str)

    def __init__(self, arguments: Sequence[str], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._arguments = ["-m", "rig", *arguments]
        self._process = QProcess(self)
        environment = QProcessEnvironment.systemEnvironment()
        environment.insert("PYTHONUTF8", "1")
        self._process.setProcessEnvironment(environment)
        self._process.finished.connect(self._end)
        self._process.errorOccurred.connect(self._refuse)

    @property
    def is_running(self) -> bool:
        """Whether it is at work."""
        return self._process.state() is not QProcess.ProcessState.NotRunning

    def start(self) -> None:
        """Begin."""
        self._process.start(sys.executable, self._arguments)

    def cancel(self) -> None:
        """End it; `done` is not told."""
        self._process.finished.disconnect(self._end)
        self._process.errorOccurred.disconnect(self._refuse)
        if self.is_running:
            self._process.kill()
            self._process.waitForFinished(2000)

    def _end(self, code: int) -> None:
        out, aside = self._process.readAllStandardOutput(), self._process.readAllStandardError()
        self.done.emit(
            code,
            bytes(out.data()).decode("utf-8", "replace"),
            bytes(aside.data()).decode("utf-8", "replace"),
        )

    def _refuse(self, error: QProcess.ProcessError) -> None:
        if error is QProcess.ProcessError.FailedToStart:
            self.done.emit(6, "", self._process.errorString())
