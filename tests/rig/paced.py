"""`rig` as a process of its own with one more rig, `paced`: the simulated one that waits as long as its cycles last.

Its clock counts only these waits: however long the computer did something else, no cycle is late.

What the plant really does is told on a pipe of its own (the descriptor in the environment), one
line each: `moving` once its input turns, `stands` once it has come to rest; and `flushed N`, the rows
that a flush has brought to the system.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from drivers.clock import VirtualClock
from drivers.samples import SampleBlock
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.registry import BACKENDS
from rig.bench.backends.simulated import assembled, parts_of
from rig.run.stop import ESCALATING, SAID_TWICE
from rig.runfile.write import RunWriter
from sim_backend.direct import SimulatedRig

VARIABLE = "RIG_TELLS_ON"
TURNING = 0.5
"""rad/s of the input above which the plant is called moving."""
DEADLINE = 600.0
"""s that a test waits for a line before it fails; on a quiet computer none takes a hundredth of it."""
LONG = ("run", "warm-up", "--backend", "paced", "--sample-rate", "200", "--block", "4")
LONG += ("--at-most", "3600", "--tolerance", "1e-9", "--window", "60", "--zero-time", "0.5")
"""A protocol that nobody's computer finishes."""


class PacedClock(VirtualClock):
    """Virtual time that takes as long as it lasts, at least: nobody's computer runs through an hour of it."""

    def wait_until_ns(self, instant_ns: int) -> None:
        time.sleep(max(instant_ns - self.monotonic_ns(), 0) * 1e-9)
        super().wait_until_ns(instant_ns)


def paced_rig(order: Order, setup: Setup, tell: Callable[[str], None]) -> AssembledRig:
    """The simulated rig at its own pace; `tell` hears what its plant does."""
    clock = PacedClock(time.time_ns())
    port: Any = SimulatedRig(**parts_of(order, setup), clock=clock)
    exchange, plant, moving = port.exchange, port._plant, [False]

    def told(*arguments: Any) -> SampleBlock:
        block: SampleBlock = exchange(*arguments)
        if (abs(plant.input_speed) > TURNING) != moving[0]:
            moving[0] = not moving[0]
            tell("moving" if moving[0] else "stands")
        return block

    port.exchange = told
    return assembled("sim", port, clock, port, order)


@contextmanager
def flushes_told(tell: Callable[[str], None]) -> Iterator[None]:
    """`tell` hears how many rows each flush has brought to the system."""
    flush = RunWriter.flush

    def told_flush(writer: RunWriter) -> None:
        flush(writer)
        tell(f"flushed {writer.rows}")

    with patch.object(RunWriter, "flush", told_flush):
        yield


def _teller() -> Callable[[str], None]:
    descriptor = int(os.environ[VARIABLE])

    def tell(line: str) -> None:
        os.write(descriptor, f"{line}\n".encode())

    return tell


@dataclass
class PacedProcess:
    """A `rig` that runs, and what its plant tells."""

    process: subprocess.Popen[str]
    pipe: int
    heard: list[str] = field(default_factory=list)
    _rest: bytes = b""

    def until(self, line: str, times: int = 1) -> None:
        """Wait for a line that begins so, or for as many."""
        end = time.monotonic() + DEADLINE
        while sum(heard.startswith(line) for heard in self.heard) < times:
            ready = select.select([self.pipe], [], [], max(end - time.monotonic(), 0.0))[0]
            assert ready, f"{line} was not told within {DEADLINE:g} s, only {self.heard}"
            data = os.read(self.pipe, 4096)
            assert data, f"ended before {line}: {self.process.communicate()}"
            *whole, self._rest = (self._rest + data).split(b"\n")
            self.heard += [text.decode() for text in whole]


def hear_every_signal() -> None:
    """In a process that begins: no signal is ignored because the tests were started by `nohup` or in the background."""
    for name in (*ESCALATING, *SAID_TWICE):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)


@contextmanager
def paced_process(
    arguments: Sequence[str], *, begin: Callable[[], None] = lambda: None, **options: Any
) -> Iterator[PacedProcess]:
    """Start `rig ARGUMENTS` with the paced rigs, after `begin` in its process; it is killed at the end of the block
    if it still runs.
    """

    def prepare() -> None:
        hear_every_signal()
        begin()

    reading, writing = os.pipe()
    command = [sys.executable, "-m", "tests.rig.paced", *arguments]
    usual: dict[str, Any] = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "text": True,
    }
    process = subprocess.Popen(
        command,
        cwd=Path(__file__).parents[2],
        env={**os.environ, VARIABLE: str(writing)},
        pass_fds=[writing],
        preexec_fn=prepare,
        **{**usual, **options},
    )
    os.close(writing)
    try:
        yield PacedProcess(process, reading)
    finally:
        process.kill()
        process.communicate()
        os.close(reading)


def at_once(times: int) -> None:
    """Return in as many processes; this one waits for them, and ends with their worst exit code."""
    import rig.run.start  # noqa: F401  before there are several, what all of them need

    for _ in range(times):
        if not os.fork():
            return
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(max(os.waitstatus_to_exitcode(os.wait()[1]) for _ in range(times)))


if __name__ == "__main__":
    from rig.main import run

    teller = _teller()
    BACKENDS["paced"] = lambda order, setup: paced_rig(order, setup, teller)
    if sys.argv[1].startswith("--times="):
        at_once(int(sys.argv.pop(1).removeprefix("--times=")))
    with flushes_told(teller):
        run()
