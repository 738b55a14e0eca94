"""The watchdog of a run in real time: a thread that only watches that turns happen, and can stop the drive alone.

It is a thread of this process: it ends after the turn thread, whatever becomes of the thread that serves the run, and
it sees nothing of what stops all threads at once (the process killed or suspended, another thread that keeps the
interpreter, a computer without power). For that there is the drive's watch over the heartbeat.

It takes no part in the loop: the loop tells it "I have turned", it compares the clock with a
deadline, and when the loop is late it sends the drive's quick stop over a bus handle of its own,
once, as process data: the SDO channel of the drive belongs to the loop. Below it the drive misses
the computer's heartbeat, which the loop itself sends, and stops by its own reaction; below that is
the hardwired stop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from drivers.clock import Clock

_NS = 1e-9


class Watchdog:
    """Watches the turns of one run. `deadline` [s] between two turns; `quick_stop` is called at most once.

    `check` is the whole of it; `start` only calls it in a thread every `interval` [s]. It begins to
    watch with the first turn. `close` releases the bus handle.
    """

    def __init__(
        self,
        clock: Clock,
        deadline: float,
        quick_stop: Callable[[], None],
        interval: float | None = None,
        close: Callable[[], None] = lambda: None,
    ) -> None:
        self.deadline = deadline
        self.acted = False
        self.problem = ""
        self.longest_pause = 0.0
        self._clock, self._quick_stop, self._close = clock, quick_stop, close
        self._interval = interval or deadline / 4.0
        self._last: int | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def turned(self) -> None:
        """The loop has turned."""
        now = self._clock.monotonic_ns()
        if self._last is not None:
            self.longest_pause = max(self.longest_pause, (now - self._last) * _NS)
        self._last = now

    def take_problem(self) -> str:
        """Why the drive was not stopped when it should have been, once; empty: it was."""
        problem, self.problem = self.problem, ""
        return f"the watchdog could not stop the drive: {problem}" * bool(problem)

    def rest(self) -> None:
        """No turn is expected for a while: the rig is safe, or the drive is being switched on."""
        self._last = None

    def check(self) -> bool:
        """Whether the loop is late; the first time that it is, the drive is quick-stopped."""
        last = self._last
        if last is None:
            return False
        late = (self._clock.monotonic_ns() - last) * _NS
        if late <= self.deadline:
            return False
        self.longest_pause = max(self.longest_pause, late)
        if not self.acted:
            self.acted = True
            try:
                self._quick_stop()
            except Exception as error:  # noqa: BLE001  the drive's own reaction to the lost heartbeat is what is left
                self.problem = f"{type(error).__name__}: {error}"
        return True

    def start(self) -> None:
        """Watch in a thread of its own until `stop`."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End the thread and release the bus handle."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(10.0 * self._interval + 1.0)
            self._thread = None
        self._close()

    def _watch(self) -> None:
        while not self._over.wait(self._interval):
            self.check()
