"""The operator's two words: STOP (controlled ramp) and ABORT (quick stop). The E-stop is hardware and only observed.

The object is handed in, so that a signal handler, a window or a test can press it, at any cycle and from any thread.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rig.run import console_windows


class StopRequest:
    """What the operator has asked for so far: 0 nothing, 1 STOP, 2 ABORT; it only ever rises. And
    notes for the run file.
    """

    def __init__(self) -> None:
        self._level = 0
        self._notes: deque[str] = deque()

    @property
    def level(self) -> int:
        """0: go on, 1: STOP, 2: ABORT."""
        return self._level

    def stop(self) -> None:
        """Ask for a controlled stop."""
        self._level = max(self._level, 1)

    def abort(self) -> None:
        """Ask for a quick stop."""
        self._level = 2

    def press(self) -> None:
        """One Ctrl-C: the first is a STOP, the second an ABORT."""
        if self._level:
            self.abort()
        else:
            self.stop()

    def note(self, text: str) -> None:
        """Write something into the run."""
        self._notes.append(text)

    def take_notes(self) -> list[str]:
        """The notes since the last call."""
        taken = []
        while self._notes:
            taken.append(self._notes.popleft())
        return taken


ESCALATING = ("SIGINT", "SIGQUIT", "SIGTERM", "SIGBREAK")
"""Signals that somebody sends: the first is a STOP, the next an ABORT."""
SAID_TWICE = ("SIGHUP",)
"""The terminal is gone. The system and the shell both say so: that is one STOP, however often."""


@contextmanager
def pressed_by_signals(stop: StopRequest) -> Iterator[None]:
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
