"""The operator's two words: STOP (controlled ramp) and ABORT (quick stop). The E-stop is hardware and only observed.

The object is handed in, so that a signal handler, a window or a test can press it, at any cycle and from any thread.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager


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


@contextmanager
def pressed_by_signals(stop: StopRequest) -> Iterator[None]:
    """Ctrl-C presses STOP, then ABORT; a termination request is a STOP. The handlers before are put back."""
    import signal

    def press(number: int, frame: object) -> None:
        stop.press()
        word = "STOP" if stop.level == 1 else "ABORT"
        sys.stderr.write(
            f"\n{word}: {'controlled ramp; Ctrl-C again is a quick stop' if stop.level == 1 else 'quick stop'}\n"
        )

    before = {number: signal.signal(number, press) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
