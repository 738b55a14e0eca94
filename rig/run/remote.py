"""A run that another program looks after: its words come in as lines, events go out as lines of JSON.

In (standard input): `STOP`, `ABORT`, `note TEXT`, `answer TEXT` to the prompt that waits. The end
of the input is a STOP: a dead man's switch. Out (standard output), one object per line, told apart
by "kind":

    {"kind": "event", "time_ns", "level", "code", "source", "text"} {"kind": "progress", "step",
    "steps", "what", "elapsed", "left", "speed", "events", "nearest", "margin", "margins", "file", "begun"}
    {"kind": "prompt", "text", "key", "consent"}    consent: what is consented to; empty: text is wanted
    {"kind": "report", ...}     the object that `rig run --json` prints; always the last line

A campaign tells of its stages as well, and its report is the object that `rig campaign --json` prints:

    {"kind": "campaign", "campaign", "title", "gear", "stages": [{"protocol", "nominal", "longest"}]}
    {"kind": "stage", "index", "protocol", "state", "run", "outcome", "message", "report"}
        state: begun, ended (report: the object that `rig run --json` prints), counts (run before)
"""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from drivers.clock import Clock
from experiments.recording import Event
from experiments.steps.vocabulary import Prompt
from rig.run.parts import Progress
from rig.run.stop import StopRequest

PROGRESS_INTERVAL = 0.1
"""s of wall time between two lines of progress."""


PATIENCE = 0.05
"""s that a question waits for its answer before the rig is held for another window, which is as long (`engine`)."""


class RemoteOperator:
    """Whoever sits at the other end of two pipes. `write` takes one line without its end."""

    def __init__(self, stop: StopRequest, write: Callable[[str], None], clock: Clock) -> None:
        self._stop, self._write, self._clock = stop, write, clock
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._asked: Prompt | None = None
        self._reported_ns: int | None = None
        self._is_gone = False

    def listen(self, lines: Iterable[str]) -> None:
        """Take lines until they end; the end is a STOP."""
        for line in lines:
            self.take(line)
        self._is_gone = True
        self._stop.stop()

    def listen_in_background(self, lines: Iterable[str]) -> None:
        """`listen` in a thread that nobody waits for."""
        threading.Thread(
            target=self.listen, args=(lines,), name="remote operator", daemon=True
        ).start()

    def serve(self, stop: StopRequest) -> None:
        """From now on STOP and ABORT are said to this: one stop was obeyed, and was the purpose."""
        if self._is_gone:
            stop.stop()
        self._stop = stop

    def take(self, line: str) -> None:
        """One line: a word, and what follows it."""
        word, _, rest = line.strip().partition(" ")
        if word == "STOP":
            self._stop.stop()
        elif word == "ABORT":
            self._stop.abort()
        elif word == "note" and rest.strip():
            self._stop.note(rest.strip())
        elif word == "answer":
            self._answers.put(rest.strip())
        elif word:
            self._stop.note(
                f"not understood: {line.strip()[:200]!r}; words are STOP, ABORT, note, answer"
            )

    def ask(self, prompt: Prompt) -> str | None:
        """Put a prompt once; the answer, or None while there is none. Nobody there: not answered."""
        if self._asked is not prompt:
            self._asked = prompt
            self.tell("prompt", asdict(prompt))
        if self._is_gone:
            return "(nobody there: not answered)"
        try:
            # A rig in virtual time would count hours while somebody reads the question.
            answer = self._answers.get(timeout=PATIENCE)
        except queue.Empty:
            return None
        self._asked = None
        return answer

    def on_event(self, event: Event) -> None:
        """Tell an event."""
        self.tell("event", asdict(event))

    def on_progress(self, progress: Progress) -> None:
        """Tell progress, not more often than a window needs."""
        now = self._clock.monotonic_ns()
        if self._reported_ns is not None and now - self._reported_ns < PROGRESS_INTERVAL * 1e9:
            return
        self._reported_ns = now
        self.tell("progress", asdict(progress))

    def report(self, report: Mapping[str, Any]) -> None:
        """Tell how it ended: the object that `rig run --json` prints."""
        self.tell("report", dict(report))

    def tell(self, kind: str, fields: Mapping[str, Any]) -> None:
        """One line: what it is, and its fields."""
        self._write(json.dumps({"kind": kind, **fields}, allow_nan=False, default=str))


def lines_of(descriptor: int) -> Iterator[str]:
    """The lines of a file descriptor as they come; past Python's buffers, so that a thread may
    still read at the exit.
    """
    waiting = b""
    while True:
        try:
            data = os.read(descriptor, 4096)
        except OSError:
            data = b""
        if not data:
            break
        *whole, waiting = (waiting + data).split(b"\n")
        yield from (line.decode("utf-8", "replace") for line in whole)
    if waiting:
        yield waiting.decode("utf-8", "replace")
