"""The operator's two words: STOP (controlled ramp) and ABORT (quick stop). The E-stop is hardware and only observed.

The object is handed in, so that a signal handler, a window or a test can press it, at any cycle and from any thread.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
import weakref
from collections import deque
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from rig.run import console_windows

OPERATOR = "the operator"
_EXIT = "the end of the main thread"
"""Who presses STOP, in words."""


class StopRequest:
    """What the operator has asked for so far: 0 nothing, 1 STOP, 2 ABORT; it only ever rises. `by` says who asked.

    And what is to stand in the run file: notes of the operator, problems of whoever serves the run.
    """

    def __init__(self) -> None:
        self.by = OPERATOR
        self._level = 0
        self._notes: deque[str] = deque()
        self._problems: deque[str] = deque()

    @property
    def level(self) -> int:
        """0: go on, 1: STOP, 2: ABORT."""
        return self._level

    def stop(self, by: str = OPERATOR) -> None:
        """Ask for a controlled stop."""
        self._rise(1, by)

    def abort(self, by: str = OPERATOR) -> None:
        """Ask for a quick stop."""
        self._rise(2, by)

    def press(self, by: str = OPERATOR) -> None:
        """One Ctrl-C: the first is a STOP, the second an ABORT."""
        self._rise(2 if self._level else 1, by)

    def _rise(self, level: int, by: str) -> None:
        if level > self._level:
            self.by = by
            self._level = level

    def heed_main_thread(self) -> None:
        """A main thread that has ended is a STOP: nobody is left who could press it. Looked at in every turn."""
        if not self._level and not threading.main_thread().is_alive():
            self.stop(by=_EXIT)

    def note(self, text: str) -> None:
        """Write something into the run."""
        self._notes.append(text)

    def take_notes(self) -> list[str]:
        """The notes since the last call."""
        return _taken(self._notes)

    def problem(self, text: str) -> None:
        """Warn of something in the run, from any thread."""
        self._problems.append(text)

    def take_problems(self) -> list[str]:
        """The problems since the last call."""
        return _taken(self._problems)


def _taken(texts: deque[str]) -> list[str]:
    taken: list[str] = []
    while texts:
        taken.append(texts.popleft())
    return taken


def pressed_by_the_exit(stop: StopRequest) -> None:
    """The end of the main thread presses STOP of a run that turns in another one.

    `heed_main_thread` sees a main thread that waits for this one. One that waits for the threads of an executor
    (`concurrent.futures`, `asyncio.to_thread`) still counts as alive: the interpreter tells of it by this list alone,
    the latest entry first, and drops the list when it ends.
    """
    waiting = weakref.ref(stop)

    def press() -> None:
        asked = waiting()
        if asked is not None:
            asked.stop(by=_EXIT)

    register = getattr(threading, "_register_atexit", None)
    if register is not None:
        try:
            register(press)
        except RuntimeError:
            # It is ending already.
            stop.stop(by=_EXIT)


ESCALATING = ("SIGINT", "SIGQUIT", "SIGTERM", "SIGBREAK")
"""Signals that somebody sends: the first is a STOP, the next an ABORT."""
SAID_TWICE = ("SIGHUP",)
"""The terminal is gone. The system and the shell both say so: that is one STOP, however often."""


@contextmanager
def pressed_by_signals(stop: StopRequest) -> Generator[None, None, None]:
    """Ctrl-C, a termination request and a closed terminal press STOP. The handlers before are put back.

    A signal that this process was started to ignore stays ignored: `nohup` keeps a run alive without its terminal,
    and a Ctrl-C in a shell is not meant for its jobs in the background. SIGTERM (`kill`) stops those too.
    On Windows the console says some of it in another way, for as long as the block lasts.
    """

    def press(number: int, frame: object) -> None:
        stop.press()
        _say(WORDS[stop.level])

    def hang_up(number: int, frame: object) -> None:
        stop.stop()

    handlers = dict.fromkeys(ESCALATING, press) | dict.fromkeys(SAID_TWICE, hang_up)
    before: dict[int, Any] = {}
    for name, handler in handlers.items():
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, handler)
    over = threading.Event()
    console = console_windows.aborted_by_console(stop, over.wait) if on_windows() else None
    try:
        with console or contextlib.nullcontext():
            yield
    finally:
        over.set()
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


WORDS = {
    1: "\nSTOP: controlled ramp; Ctrl-C again is a quick stop\n",
    2: "\nABORT: quick stop\n",
}


def on_windows() -> bool:
    """Whether this is Windows, where consoles end without a signal and cannot be asked whether they take text."""
    return os.name == "nt"


def _say(text: str) -> None:
    """Something on standard error, from within a signal handler: it must neither raise nor wait for a reader.

    Past Python's own stream, which cannot be entered twice.
    """
    with contextlib.suppress(OSError, ValueError):
        if on_windows() or select.select([], [2], [], 0.0)[1]:
            os.write(2, text.encode())
