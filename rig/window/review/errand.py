"""Reading beside the window: a function in a thread of its own, of which only the latest answer counts."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QCoreApplication, QObject, Signal

from model.errors import WordedError
from rig.exits import explain

LONGEST_WAIT = 5.0
"""s that the end of the window waits for a file that is being read."""


class Errand(QObject):
    """`done` carries what the latest function gave, `failed` in words why it could not. Earlier ones are not told."""

    done = Signal(object)
    failed = Signal(str)
    _back = Signal(int, bool, object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._latest = 0
        self._running = 0
        self._threads: list[threading.Thread] = []
        self._back.connect(self._take)
        program = QCoreApplication.instance()
        if program is not None:
            program.aboutToQuit.connect(self.wait)

    @property
    def is_running(self) -> bool:
        """Whether the latest answer is still awaited."""
        return self._running > 0

    def start(self, work: Callable[[], Any]) -> None:
        """Do this; whatever was asked for before is forgotten."""
        self._latest += 1
        self._running += 1
        thread = threading.Thread(
            target=self._work, args=(self._latest, work), name="errand", daemon=True
        )
        self._threads = [*(one for one in self._threads if one.is_alive()), thread]
        thread.start()

    def wait(self) -> None:
        """Wait for what is being done, a few seconds at most: a program must not end within the HDF5 library."""
        for thread in self._threads:
            thread.join(LONGEST_WAIT)

    def forget(self) -> None:
        """Nothing is awaited any more."""
        self._latest += 1

    def _work(self, number: int, work: Callable[[], Any]) -> None:
        try:
            made, good = work(), True
        except (WordedError, OSError) as error:
            known = explain(error)
            made, good = known[1] if known else str(error), False
        # The window may be gone by now, and its signals with it.
        with contextlib.suppress(RuntimeError):
            self._back.emit(number, good, made)

    def _take(self, number: int, good: bool, made: object) -> None:
        self._running -= 1
        if number != self._latest:
            return
        if good:
            self.done.emit(made)
        else:
            self.failed.emit(str(made))
