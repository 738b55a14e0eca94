"""The operator's two words: STOP (controlled ramp) and ABORT (quick stop). The E-stop is hardware and only observed.

The object is handed in, so that a signal handler, a window or a test can press it, at any cycle and from any thread.
"""

from __future__ import annotations

from collections import deque


class StopRequest:
    """What the operator has asked for so far: 0 nothing, 1 STOP, 2 ABORT; it only ever rises. And notes for the run file."""

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
