"""The serving of a run in real time: the rig turns in a thread of its own, and its caller's thread calls the callbacks.

The turn thread never waits for a callback. It is served until it has ended, whatever is raised meanwhile
(`rig.run.callbacks`); the watchdog ends after it.
"""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from rig.run.callbacks import SERVING, Callbacks
from rig.run.stop import StopRequest, pressed_by_the_exit
from rig.run.watchdog import Watchdog

if TYPE_CHECKING:
    from experiments.recording import Event
    from experiments.steps.note import Prompt
    from rig.run.parts import Progress, RunReport

_SERVE_INTERVAL = 0.05
"""s between two looks of the serving thread at what the turn thread has to tell."""
_SWITCH_INTERVAL = 0.0002
"""s that another thread may go on in the interpreter once the turn thread wants it; the usual 5 ms
are several SYNCs.
"""
_BEGIN_PATIENCE = 1.0
"""s that a turn thread may take to begin when Ctrl-C came while it was started."""


class Relay:
    """Hands what the turn thread tells to the serving thread, and answers back. The turn thread never waits."""

    def __init__(self, callbacks: Callbacks) -> None:
        self._callbacks = callbacks
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._progress: Progress | None = None
        self._lock = threading.Lock()
        self._prompt: Prompt | None = None
        self._answers: dict[int, str] = {}
        self._is_broken = False

    def progress(self, progress: Progress) -> None:
        """Take the latest progress."""
        self._progress = progress

    def event(self, event: Event) -> None:
        """Take an event."""
        self._events.put(event)

    def ask(self, prompt: Prompt) -> str | None:
        """The answer to a prompt, None while there is none."""
        with self._lock:
            answer = self._answers.pop(id(prompt), None)
            if answer is None:
                self._prompt = prompt
            return answer

    def serve(self) -> None:
        """In the serving thread: tell what there is, put the prompt that waits."""
        if self._is_broken:
            return
        while not self._events.empty():
            self._callbacks.on_event(self._events.get())
        progress, self._progress = self._progress, None
        if progress is not None:
            self._callbacks.on_progress(progress)
        with self._lock:
            prompt, self._prompt = self._prompt, None
        if prompt is not None:
            answer = self._callbacks.ask(prompt)
            if answer is not None:
                with self._lock:
                    self._answers[id(prompt)] = answer

    def took(self, error: BaseException) -> None:
        """Serving itself has raised: a defect is not served again, a Ctrl-C may come at any moment."""
        self._is_broken = self._is_broken or isinstance(error, Exception)
        self._callbacks.took(SERVING, error)


class _TurnThread(threading.Thread):
    """The thread in which the rig turns. Never a daemon: the interpreter would end it in the middle of a motion."""

    def __init__(self, turn: Callable[[], RunReport]) -> None:
        super().__init__(name="turn", daemon=False)
        self.begun = threading.Event()
        self._turn = turn
        self._report: RunReport | None = None
        self._error: BaseException | None = None

    def run(self) -> None:
        """Turn until the rig stands."""
        self.begun.set()
        try:
            self._report = self._turn()
        except BaseException as error:  # noqa: BLE001  raised again in the serving thread
            self._error = error

    def result(self) -> RunReport:
        """The report; raises what turning has raised."""
        if self._error is not None:
            raise self._error
        if self._report is None:
            raise RuntimeError("the turn thread did not begin: nothing has moved")
        return self._report


def serve(
    turn: Callable[[Relay], RunReport],
    callbacks: Callbacks,
    stop: StopRequest,
    watchdog: Watchdog | None,
) -> RunReport:
    """Turn in a thread of its own and serve it from this one. Raises what `turn` raises, and only once it has ended."""
    relay = Relay(callbacks)
    thread = _TurnThread(lambda: turn(relay))
    usual = sys.getswitchinterval()
    if threading.current_thread() is not threading.main_thread():
        pressed_by_the_exit(stop)
    try:
        sys.setswitchinterval(_SWITCH_INTERVAL)
        if watchdog is not None:
            watchdog.start()
        _start(thread, relay)
        _serve_until_over(thread, relay)
    finally:
        sys.setswitchinterval(usual)
        if watchdog is not None:
            watchdog.stop()
    relay.serve()
    return thread.result()


def _start(thread: _TurnThread, relay: Relay) -> None:
    try:
        thread.start()
    except Exception:
        # There is no such thread, and nothing has moved.
        raise
    except BaseException as error:  # noqa: BLE001  Ctrl-C while it begins: it is served like any other
        relay.took(error)
        thread.begun.wait(_BEGIN_PATIENCE)


def _serve_until_over(thread: _TurnThread, relay: Relay) -> None:
    try:
        while thread.is_alive():
            relay.serve()
            thread.join(_SERVE_INTERVAL)
    except BaseException as error:  # noqa: BLE001  a STOP; it is raised again once the rig stands
        try:
            relay.took(error)
        finally:
            # Another Ctrl-C may come right here.
            _serve_until_over(thread, relay)
