"""A run in real time: the loop in a thread of its own, the main thread for the operator, nothing else in the process.

Main thread: Ctrl-C, prompts, progress. Turn thread: the session. Writer thread: the recorder's.
Watchdog thread: only watches that turns happen. The garbage collector is frozen and off while the
rig turns.
"""

from __future__ import annotations

import contextlib
import gc
import queue
import sys
import threading
from collections.abc import Callable, Iterator

from experiments.recording import Event
from experiments.steps.vocabulary import Prompt
from rig.run.engine import Ask
from rig.run.order import Begin, Progress, RunOrder, RunReport
from rig.run.session import execute
from rig.run.stop import StopRequest

SERVE_INTERVAL = 0.05
"""s between two looks of the main thread at what the turn thread has to tell."""
REACTION_TIME = 0.02
"""s of cycles per exchange: how soon the operator is heard."""
SWITCH_INTERVAL = 0.0002
"""s that another thread may go on in the interpreter once the turn thread wants it; the usual 5 ms
are several SYNCs.
"""
LEAST_DEADLINE = 0.25
"""s without a turn after which the watchdog stops the drive, at least."""


def block_cycles(sample_rate: float, wanted: int, reaction: float = REACTION_TIME) -> int:
    """Cycles per exchange in real time: never so many that the operator waits longer than `reaction` [s]."""
    return max(1, min(wanted, round(reaction * sample_rate)))


def watchdog_deadline(
    cycles: int, sample_rate: float, stale_cycles: int = 50, patience: float = 5.0
) -> float:
    """s that a turn may take: an exchange in which every cycle waits in full for a node that is silent, with room."""
    return max(LEAST_DEADLINE, 2.0 * (cycles + min(cycles, stale_cycles) * patience) / sample_rate)


class Relay:
    """Hands what the turn thread tells to the main thread, and prompts' answers back. The turn thread never waits."""

    def __init__(
        self,
        ask: Ask,
        on_progress: Callable[[Progress], None] | None,
        on_event: Callable[[Event], None] | None,
    ) -> None:
        self._ask, self._on_progress, self._on_event = ask, on_progress, on_event
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._progress: Progress | None = None
        self._lock = threading.Lock()
        self._prompt: Prompt | None = None
        self._answers: dict[int, str] = {}

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
        """In the main thread: tell what there is, put the prompt that waits."""
        while not self._events.empty():
            event = self._events.get()
            if self._on_event is not None:
                self._on_event(event)
        progress, self._progress = self._progress, None
        if progress is not None and self._on_progress is not None:
            self._on_progress(progress)
        with self._lock:
            prompt, self._prompt = self._prompt, None
        if prompt is not None:
            answer = self._ask(prompt)
            if answer is not None:
                with self._lock:
                    self._answers[id(prompt)] = answer


def execute_in_real_time(
    order: RunOrder,
    begin: Begin,
    *,
    stop: StopRequest | None = None,
    ask: Ask = lambda prompt: "",
    on_progress: Callable[[Progress], None] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> RunReport:
    """`execute` in a turn thread, served by the calling thread. Raises what `execute` raises."""
    stop = stop or StopRequest()
    relay = Relay(ask, on_progress, on_event)
    done: list[RunReport] = []
    failed: list[BaseException] = []

    def turn() -> None:
        try:
            with collector_off():
                done.append(
                    execute(
                        order,
                        begin,
                        stop=stop,
                        ask=relay.ask,
                        on_progress=relay.progress,
                        on_event=relay.event,
                    )
                )
        except BaseException as error:  # noqa: BLE001  raised again in the main thread
            failed.append(error)

    thread = threading.Thread(target=turn, name="turn")
    if order.watchdog is not None:
        order.watchdog.start()
    usual = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    thread.start()
    try:
        _serve_until_over(thread, relay, stop)
    finally:
        sys.setswitchinterval(usual)
        if order.watchdog is not None:
            order.watchdog.stop()
    relay.serve()
    if failed:
        raise failed[0]
    return done[0]


def _serve_until_over(thread: threading.Thread, relay: Relay, stop: StopRequest) -> None:
    while thread.is_alive():
        try:
            relay.serve()
            thread.join(SERVE_INTERVAL)
        except KeyboardInterrupt:
            # Where no handler was set: the first is a STOP, the second an ABORT, and the rig is made safe in any case.
            stop.press()


@contextlib.contextmanager
def collector_off() -> Iterator[None]:
    """The garbage collector frozen and off."""
    was_on = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_on:
            gc.enable()
