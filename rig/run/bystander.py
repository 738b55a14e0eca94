"""A process beside a run that tells others of it: the status page, and the command of `[notify]`.

It is started before the rig is armed, so that the process that turns the motor never forks, and told through a pipe by
a thread of its own: the run waits for neither. What fails there is an event of the run and nothing more.
"""

from __future__ import annotations

import contextlib
import json
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from experiments.recording import Event
from experiments.steps.note import Prompt
from model.units import RPM
from rig.bench.backends.order import Order
from rig.bench.config.load import load_notify
from rig.run.engine import Ask
from rig.run.parts import Progress, RunReport
from rig.run.state import RunState

_WAITING_LINES = 20
"""Lines that may wait for a process that does not read; what comes then is left out."""
_FAREWELL = 1.0
"""s that a run which is over waits for its last line to be taken."""
_BETWEEN = 0.5
"""s of the run between two points of the picture."""
_CHILD = "rig.present.bystander"


class _Process:
    """The process, and the threads that write to it and read from it."""

    def __init__(
        self, asked: dict[str, Any], folder: Path, complain: Callable[[str], None]
    ) -> None:
        self._lines: queue.Queue[str | None] = queue.Queue(_WAITING_LINES)
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", _CHILD, json.dumps(asked)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            cwd=folder,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        self._writer = threading.Thread(
            target=_write, args=(process.stdin, self._lines), name="bystander", daemon=True
        )
        self._writer.start()
        # It also takes the process's end, so that no zombie is left.
        self._listener = threading.Thread(
            target=_listen, args=(process, process.stdout, complain), name="bystander", daemon=True
        )
        self._listener.start()

    def tell(self, told: dict[str, Any], *, must_arrive: bool) -> None:
        """Put a line, without waiting; one that must arrive takes the place of another."""
        line = json.dumps(told) + "\n"
        while True:
            try:
                self._lines.put_nowait(line)
            except queue.Full:
                if not must_arrive:
                    return
                with contextlib.suppress(queue.Empty):
                    self._lines.get_nowait()
            else:
                return

    def over(self) -> None:
        """No further line: the process ends when it has done what it has to."""
        with contextlib.suppress(queue.Full):
            self._lines.put(None, timeout=_FAREWELL)
        self._writer.join(_FAREWELL)

    def is_gone(self, patience: float) -> bool:
        """Whether the process has ended, all its complaints taken; waits so long [s]."""
        self._listener.join(patience)
        return not self._listener.is_alive()


def _write(stream: IO[str], lines: queue.Queue[str | None]) -> None:
    # A process that is gone takes nothing: the run goes on without it.
    with contextlib.suppress(OSError), stream:
        while (line := lines.get()) is not None:
            stream.write(line)
            stream.flush()


def _listen(
    process: subprocess.Popen[str], stream: IO[str], complain: Callable[[str], None]
) -> None:
    with contextlib.suppress(OSError), stream:
        for line in stream:
            complain(line.rstrip())
    process.wait()


@dataclass
class Bystander:
    """Follows one run by what it tells, and passes it on."""

    process: _Process
    state: RunState
    _asked: Prompt | None = None
    _at: float = -_BETWEEN

    def hears(
        self,
        ask: Ask,
        on_progress: Callable[[Progress], None] | None,
        on_event: Callable[[Event], None] | None,
    ) -> dict[str, Any]:
        """The callbacks of the run, heard before they are called."""

        def asked(prompt: Prompt) -> str | None:
            if prompt is not self._asked:
                self._asked = prompt
                self._change(self.state.asked(prompt.text))
            answer = ask(prompt)
            if answer is not None:
                self._change(self.state.answered())
            return answer

        def progressed(progress: Progress) -> None:
            self._go_on(progress)
            if on_progress is not None:
                on_progress(progress)

        def told(event: Event) -> None:
            self._change(self.state.after(event))
            if on_event is not None:
                on_event(event)

        return {"ask": asked, "on_progress": progressed, "on_event": told}

    def reported(self, report: RunReport) -> None:
        """The run is over."""
        self._change(self.state.reported(report.as_json()), over=True, run=str(report.path))

    def refused(self, error: BaseException) -> None:
        """The run has ended without a report."""
        self._change(self.state.gone(False, str(error)), over=True)

    def _go_on(self, progress: Progress) -> None:
        self._change(self.state.went_on(progress), run=progress.file)
        # A run may begin its time anew; a picture may not go back.
        if progress.elapsed - self._at < _BETWEEN:
            return
        self._at = progress.elapsed
        speed = progress.speed / RPM
        nearest = (
            f"{progress.nearest} {1.0 - progress.margin:.0%} used" if progress.nearest else "-"
        )
        numbers = {
            "input speed": f"{speed:.0f} r/min",
            "step": f"{progress.step} of {progress.steps}",
            "time left": f"{progress.left // 60:.0f}:{progress.left % 60:02.0f}",
            "nearest limit": nearest.replace("_", " "),
        }
        told = {"numbers": numbers, "point": [progress.elapsed, speed], "what": self.state.what}
        self.process.tell(told, must_arrive=False)

    def _change(self, state: RunState, **facts: Any) -> None:
        before, self.state = self.state, state
        if state.state is not before.state or facts.get("over"):
            what = ": ".join(filter(None, (state.outcome, state.what)))
            told = {"state": state.state.value, "what": what, "remedy": state.remedy}
            self.process.tell({**told, **facts}, must_arrive=True)


@contextlib.contextmanager
def standing_by(
    order: Order, complain: Callable[[str], None]
) -> Generator[Bystander | None, None, None]:
    """The process beside a run, for an order with a status page or a configuration with `[notify]`; None without.

    `complain` takes what fails there, from any thread.

    Raises `ConfigurationError` for a configuration that cannot be read.
    """
    command: Sequence[str] = ()
    if order.config is not None and (notify := load_notify(order.config)) is not None:
        command = notify.command
    if not command and order.status is None:
        yield None
        return
    asked = {
        "status": "" if order.status is None else str(order.status.resolve()),
        "command": list(command),
        "title": f"{order.protocol} {order.serial}".strip(),
    }
    folder = order.config.parent if order.config is not None else Path()
    try:
        process = _Process(asked, folder, complain)
    except OSError as error:
        complain(f"nobody stands by to tell of the run: {error.strerror or error}")
        yield None
        return
    bystander = Bystander(process, RunState().armed())
    try:
        yield bystander
    except BaseException as error:
        bystander.refused(error)
        raise
    finally:
        bystander.process.over()
