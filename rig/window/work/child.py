"""The run's parent: starts `rig run` or `rig campaign` as a process of its own, hears its lines, speaks its words.

    out of it   lines of JSON: event, progress, prompt, campaign, stage, report   (`rig.run.remote`)
    into it     STOP, ABORT, note TEXT, answer TEXT; the end of this pipe is a STOP

No sample passes here: samples come from the growing run file. The process is not tied to the
window's life: it has a session of its own, so that a closed terminal does not take it along, and
nothing ever kills it. When the window dies the pipe ends, the run stops by a controlled ramp,
verifies standstill and seals its file. (Qt's own process class kills its child when it is
destroyed, which is why it is not used.)
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import IO, Any

from PySide6.QtCore import QObject, Signal

from experiments.recording import Event
from experiments.steps.note import Prompt
from model.errors import without_traceback
from rig.run.parts import Progress

LONGEST_COMPLAINT = 8000
"""Characters of standard error that are kept: the last ones."""


@dataclass(frozen=True)
class Ending:
    """How the process of a run ended: its exit code (negative: the signal that killed it), whether
    it gave its report, what
    it said on standard error."""

    code: int
    reported: bool
    complaint: str

    @property
    def killed(self) -> bool:
        """Whether it was ended from outside instead of by itself."""
        return self.code < 0


class RunProcess(QObject):
    """One `rig run`, campaign or doctor, and the lines to and from it. Signals arrive in the window's thread.

    `start()` once.

    `arguments` is everything after `program`; by default the program is this Python with `-m rig`.
    """

    event_received = Signal(object)
    """An `Event` of the run."""
    progress = Signal(object)
    """A `Progress`, about ten times a second."""
    prompt = Signal(object)
    """A `Prompt` to the operator; `answer` answers it."""
    campaign = Signal(dict)
    """What a campaign is going to do: its stages."""
    stage = Signal(dict)
    """A stage of a campaign has begun, has ended, or counts from before."""
    analysing = Signal(dict)
    """A run of a campaign is being analysed, and the campaign waits for it."""
    report = Signal(dict)
    """The object that `rig run --json`, or `rig campaign --json`, prints; the last line."""
    failed = Signal(str)
    """It ended without a report: what it said on standard error."""
    finished = Signal(object)
    """The process is gone: its `Ending`. Always the last signal."""
    _line = Signal(str)
    _gone = Signal(object)

    def __init__(
        self, arguments: Sequence[str], program: Sequence[str] = (), parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._command = [*(program or (sys.executable, "-m", "rig")), *arguments]
        self._process: subprocess.Popen[bytes] | None = None
        self._reported = self._over = False
        self._lock = threading.Lock()
        self._line.connect(self._take)
        self._gone.connect(self._end)

    @property
    def command(self) -> tuple[str, ...]:
        """The command line of the process."""
        return tuple(self._command)

    @property
    def pid(self) -> int:
        """The process id; 0 before the start."""
        return self._process.pid if self._process is not None else 0

    @property
    def is_running(self) -> bool:
        """Whether it was started and its end was not told yet."""
        return self._process is not None and not self._over

    def start(self) -> None:
        """Start the process. One that cannot be started is told as `failed` and `finished`."""
        # Texts are UTF-8 on every system; what is printed is on the line at once.
        environment = {**os.environ, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1"}
        flags = 0
        if sys.platform == "win32":
            flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(
                self._command,
                stdin=pipe,
                stdout=pipe,
                stderr=pipe,
                env=environment,
                creationflags=flags,
                start_new_session=sys.platform != "win32",
            )
        except OSError as error:
            self._end(Ending(0, False, f"The run could not be started: {error.strerror or error}"))
            return
        self._process = process
        threading.Thread(
            target=self._listen, args=(process,), name="run's lines", daemon=True
        ).start()

    def stop(self) -> None:
        """Controlled ramp to standstill."""
        self._say("STOP")

    def abort(self) -> None:
        """Quick stop."""
        self._say("ABORT")

    def note(self, text: str) -> None:
        """A note of the operator into the run file."""
        self._say(f"note {_one_line(text)}")

    def answer(self, text: str) -> None:
        """The answer to the question that waits."""
        self._say(f"answer {_one_line(text)}")

    def let_go(self) -> None:
        """End the line to the run, which is a STOP; the process makes the rig safe by itself."""
        process = self._process
        if process is not None and process.stdin is not None:
            with self._lock, contextlib.suppress(OSError):
                process.stdin.close()

    def _say(self, line: str) -> None:
        process = self._process
        if process is None or process.stdin is None or process.stdin.closed:
            return
        # The run may end at any moment: then its report, or the lack of it, says more than this pipe could.
        with self._lock, contextlib.suppress(OSError):
            process.stdin.write(line.encode() + b"\n")
            process.stdin.flush()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        """In a thread: every line of the process as a signal, and its end."""
        complaint: list[str] = []
        assert process.stdout is not None
        assert process.stderr is not None
        aside = threading.Thread(target=_collect, args=(process.stderr, complaint), daemon=True)
        aside.start()
        # The window may be gone before the run: its signals cannot be sent any more, and nobody misses them.
        with contextlib.suppress(RuntimeError):
            for raw in process.stdout:
                self._line.emit(raw.decode("utf-8", "replace"))
        code = process.wait()
        aside.join(timeout=5.0)
        for stream in (process.stdout, process.stderr):
            stream.close()
        with contextlib.suppress(RuntimeError):
            self._gone.emit(
                Ending(
                    code, False, without_traceback("".join(complaint))[-LONGEST_COMPLAINT:].strip()
                )
            )

    def _take(self, line: str) -> None:
        """One line of the run; what is not one of its objects is passed over (a library's own printing)."""
        try:
            message = json.loads(line)
        except ValueError:
            return
        if not isinstance(message, dict):
            return
        kind = message.pop("kind", "")
        if kind == "event":
            self.event_received.emit(_from_fields(Event, message))
        elif kind == "progress":
            self.progress.emit(_from_fields(Progress, message))
        elif kind == "prompt":
            self.prompt.emit(_from_fields(Prompt, message))
        elif kind == "campaign":
            self.campaign.emit(message)
        elif kind == "stage":
            self.stage.emit(message)
        elif kind == "analysing":
            self.analysing.emit(message)
        elif kind == "report":
            self._reported = True
            self.report.emit(message)

    def _end(self, ending: Ending) -> None:
        ending = Ending(ending.code, self._reported, ending.complaint)
        self._over = True
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        if not ending.reported:
            self.failed.emit(ending.complaint)
        self.finished.emit(ending)


def _collect(stream: IO[bytes], into: list[str]) -> None:
    """Everything a stream says; only the end of it is kept."""
    for raw in stream:
        into.append(raw.decode("utf-8", "replace"))
        if len(into) > 200:
            del into[:100]


def _from_fields(kind: type[Any], message: dict[str, Any]) -> Any:
    """An object from the fields that it has; a newer run may tell more."""
    return kind(**{f.name: message[f.name] for f in fields(kind) if f.name in message})


def _one_line(text: str) -> str:
    return " ".join(text.split())
