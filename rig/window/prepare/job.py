"""Working an intent out beside the window, in a thread of the pool."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QRunnable, Signal

from rig.window.prepare.request import Intent, Outlook


class Told(QObject):
    """Carries the outcome of a job out of its thread."""

    done = Signal(int, object)


class OutlookJob(QRunnable):
    """An intent that is looked at in a thread of the pool; `told.done` carries its number and the `Outlook`."""

    def __init__(self, number: int, intent: Intent, work: Callable[[Intent], Outlook]) -> None:
        super().__init__()
        self.told = Told()
        self._number, self._intent, self._work = number, intent, work

    def run(self) -> None:
        """Do it, and tell."""
        self.told.done.emit(self._number, self._work(self._intent))
