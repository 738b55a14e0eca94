"""The process beside a run: it writes the status page and calls the laboratory's command, and can hold nothing up.

`rig.run.bystander` starts it before the rig is armed and tells it lines of JSON; what fails here goes back as lines of
text. When the lines end without the run's end, the process that turned the rig is gone, and that is what is told.

    python -m rig.present.bystander '{"status": "FILE.html", "command": ["notify-send"], "title": "friction SN-1"}'
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from rig.present.status_page import EVERY, painted

CALLED_AT = ("waiting for you", "finished", "tripped", "lost", "refused")
"""States at which the command is called."""
PATIENCE = 5.0
"""s after which a command is ended."""
_POINTS = 600
"""Of the picture: half of them are dropped when there are twice as many."""
LOST = {
    "state": "lost",
    "what": "The process that turned the rig is gone.",
    "remedy": "Nobody knows whether the rig stands: press the emergency stop and look at it.",
    "over": True,
}


@dataclass
class Bystander:
    """What is known of the run, and what is done with it. `complain` takes a sentence of what failed."""

    status: Path | None
    command: tuple[str, ...]
    title: str
    complain: Callable[[str], None]
    latest: dict[str, Any] = field(default_factory=lambda: {"state": "armed"})
    course: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    calls: list[tuple[subprocess.Popen[bytes], float]] = field(
        default_factory=list[tuple[subprocess.Popen[bytes], float]]
    )
    complained: set[str] = field(default_factory=set[str])
    written: float = -EVERY

    def take(self, told: dict[str, Any], now: float) -> None:
        """What the run tells: another state is shown and called at once."""
        before, self.latest = self.latest["state"], {**self.latest, **told}
        if "point" in told:
            self.course.append((float(told["point"][0]), float(told["point"][1])))
            if len(self.course) >= 2 * _POINTS:
                del self.course[1::2]
        if self.latest["state"] == before:
            return
        self.written = now - EVERY
        if self.command and self.latest["state"] in CALLED_AT:
            self._call(now)

    def tend(self, now: float) -> None:
        """Write the page where it is due, and end commands that take too long."""
        if self.status is not None and now - self.written >= EVERY:
            self.written = now
            try:
                self._write(self.status)
            except OSError as error:
                self._complain_once(f"the status page is not written: {error.strerror or error}")
        for call in tuple(self.calls):
            process, begun = call
            code = process.poll()
            if code is None and now - begun < PATIENCE:
                continue
            self.calls.remove(call)
            if code is None:
                process.kill()
                process.wait()
                self.complain(f"the notification was ended after {PATIENCE:g} s")
            elif code:
                self.complain(f"the notification ended with {code}")

    def _call(self, now: float) -> None:
        state, run = str(self.latest["state"]), str(self.latest.get("run", ""))
        facts = {"STATE": state, "RUN": run, "WHAT": str(self.latest.get("what", ""))}
        # Names of their own: HARMONIC_RIG_STATE is the place of the latch, also for a `rig` that the command calls.
        environment = {
            **os.environ,
            **{f"HARMONIC_RIG_NOTIFY_{name}": text for name, text in facts.items()},
        }
        try:
            process = subprocess.Popen(
                [*self.command, state, run],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            self.complain(f"the notification cannot be called: {error.strerror or error}")
        else:
            self.calls.append((process, now))

    def _write(self, status: Path) -> None:
        """Replace the page as a whole: nobody reads half of one."""
        at = time.time()
        text = painted(
            {"title": self.title, **self.latest},
            self.course,
            at,
            time.strftime("%Y-%m-%d %H:%M:%S"),
        )
        scratch = status.with_name(f".{status.name}.{os.getpid()}.tmp")
        try:
            scratch.write_text(text, encoding="utf-8")
            scratch.replace(status)
        finally:
            with contextlib.suppress(OSError):
                scratch.unlink(missing_ok=True)

    def _complain_once(self, text: str) -> None:
        if text not in self.complained:
            self.complained.add(text)
            self.complain(text)


def stand_by(bystander: Bystander, lines: queue.Queue[str | None]) -> None:
    """Until the lines have ended and every command has. The clock is real: nothing is simulated here."""
    is_told = True
    while is_told or bystander.calls:
        try:
            line = lines.get(timeout=0.2)
        except queue.Empty:
            line = ""
        now = time.monotonic()
        if line is None:
            is_told = False
            if not bystander.latest.get("over"):
                bystander.take(dict(LOST), now)
            bystander.written = now - EVERY
        elif line:
            with contextlib.suppress(ValueError):
                bystander.take(json.loads(line), now)
        bystander.tend(now)


def _read(stream: TextIO, lines: queue.Queue[str | None]) -> None:
    for line in stream:
        lines.put(line)
    lines.put(None)


def _spoken(stream: TextIO) -> Callable[[str], None]:
    def complain(text: str) -> None:
        # Whoever listened may be gone.
        with contextlib.suppress(OSError, ValueError):
            stream.write(text + "\n")
            stream.flush()

    return complain


def _leave_signals_to_the_run() -> None:
    """Ctrl-C and a closed terminal reach all its processes: they are the run's, which tells what comes of them."""
    for name in ("SIGINT", "SIGHUP"):
        if number := getattr(signal, name, None):
            signal.signal(number, signal.SIG_IGN)


def main() -> None:
    """Stand by until standard input ends."""
    asked = json.loads(sys.argv[1])
    status = Path(asked["status"]) if asked["status"] else None
    lines: queue.Queue[str | None] = queue.Queue()
    _leave_signals_to_the_run()
    threading.Thread(target=_read, args=(sys.stdin, lines), daemon=True).start()
    stand_by(Bystander(status, tuple(asked["command"]), asked["title"], _spoken(sys.stdout)), lines)


if __name__ == "__main__":
    main()
