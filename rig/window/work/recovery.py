"""Making a run file of what a dead acquisition left behind: `rig recover` in a process of its own."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Signal

from rig.runfile.layout import PART_SUFFIX
from rig.window.work.background import BackgroundCommand, in_words


class Recovery(QObject):
    """Recovers one file at a time. `recovered` carries file and run file, `refused` the file and why there is none."""

    recovered = Signal(Path, Path)
    refused = Signal(Path, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._command: BackgroundCommand | None = None

    @property
    def is_running(self) -> bool:
        """Whether a file is being recovered."""
        return self._command is not None

    def start(self, path: Path) -> None:
        """Recover this file, unless another one is being recovered."""
        if self._command is not None:
            return
        self._command = BackgroundCommand(
            ["recover", str(path), "--json"],
            self,
            lambda code, _, aside: self._take(path, code, aside),
        )
        self._command.start()

    def _take(self, path: Path, code: int, complaint: str) -> None:
        self._command = None
        final = path.with_name(path.name.removesuffix(PART_SUFFIX))
        if code != 0 or not final.exists():
            self.refused.emit(path, in_words(complaint))
        else:
            self.recovered.emit(path, final)
