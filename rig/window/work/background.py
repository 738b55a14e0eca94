"""What works while the window stays alive: a `rig` command in a process of its own, a function in a thread."""

from __future__ import annotations

import contextlib
import json
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import QCoreApplication, QObject, QProcess, QProcessEnvironment, QTimer, Signal

from model.errors import WordedError, without_traceback
from rig.exits import explain

PATIENCE = 3000
"""ms that a command is given to end by itself when it is called off."""
LONGEST_COMPLAINT = 1200
"""Characters of what a command said that are shown, the last ones."""
TASK = "latest task"
"""Name of the threads that work for a window."""
LONGEST_WAIT = 5.0
"""s that the end of the window waits for a file that is being read."""


class BackgroundCommand(QObject):
    """One command; `done` carries exit code, standard output and standard error. `start()` once."""

    done = Signal(int, str, str)

    def __init__(
        self,
        arguments: Sequence[str],
        parent: QObject | None = None,
        done: Callable[[int, str, str], Any] | None = None,
    ) -> None:
        super().__init__(parent)
        if done is not None:
            self.done.connect(done)
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
        """End it; `done` is not emitted."""
        self._process.finished.disconnect(self._end)
        self._process.errorOccurred.disconnect(self._refuse)
        if not self.is_running:
            return
        # Asked first: a command that turns a simulated rig or writes a file may want to leave it whole.
        self._process.terminate()
        if not self._process.waitForFinished(PATIENCE):
            self._process.kill()
            self._process.waitForFinished(PATIENCE)

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


def single_shot(parent: QObject, interval: int, act: Callable[[], Any]) -> QTimer:
    """A timer that acts once when it has rested for `interval` [ms]; every start begins it anew."""
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(interval)
    timer.timeout.connect(act)
    return timer


def json_object(text: str) -> dict[str, Any] | None:
    """The JSON object that a command printed; None where it printed none."""
    try:
        value = json.loads(text)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


def in_words(complaint: str) -> str:
    """What a command said on standard error, or that it said nothing."""
    return (
        without_traceback(complaint).strip()[-LONGEST_COMPLAINT:]
        or "The program ended without a result and without a word."
    )


class LatestTask(QObject):
    """A function in a thread of its own, of which only the latest answer counts.

    `done` carries what the latest function returned, `failed` in words why it could not.
    """

    done = Signal(object)
    failed = Signal(str)
    _answered = Signal(int, bool, object)

    def __init__(
        self,
        parent: QObject | None = None,
        done: Callable[[Any], Any] | None = None,
        failed: Callable[[str], Any] | None = None,
    ) -> None:
        super().__init__(parent)
        if done is not None:
            self.done.connect(done)
        if failed is not None:
            self.failed.connect(failed)
        self._count = 0
        self._awaited = 0
        self._threads: list[threading.Thread] = []
        self._answered.connect(self._take)
        program = QCoreApplication.instance()
        if program is not None:
            program.aboutToQuit.connect(self.wait)

    @property
    def is_running(self) -> bool:
        """Whether the latest answer is still awaited."""
        return self._awaited > 0

    def start(self, work: Callable[[], Any]) -> None:
        """Do this; whatever was asked for before is forgotten."""
        self._count += 1
        self._awaited = self._count
        thread = threading.Thread(
            target=self._work, args=(self._count, work), name=TASK, daemon=True
        )
        self._threads = [*(one for one in self._threads if one.is_alive()), thread]
        thread.start()

    def wait(self) -> None:
        """Wait for what is being done, a few seconds at most: a program must not end within the HDF5 library."""
        for thread in self._threads:
            thread.join(LONGEST_WAIT)

    def forget(self) -> None:
        """Nothing is awaited any more."""
        self._awaited = 0

    def _work(self, number: int, work: Callable[[], Any]) -> None:
        try:
            answer, good = work(), True
        except (WordedError, OSError) as error:
            explained = explain(error)
            answer, good = explained[1] if explained else str(error), False
        # The window may be gone by now, and its signals with it.
        with contextlib.suppress(RuntimeError):
            self._answered.emit(number, good, answer)

    def _take(self, number: int, good: bool, answer: object) -> None:
        if number != self._awaited:
            return
        self._awaited = 0
        if good:
            self.done.emit(answer)
        else:
            self.failed.emit(str(answer))
