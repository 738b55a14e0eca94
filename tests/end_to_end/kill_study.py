"""Kills at random moments: a run in real time is killed (SIGKILL), and what it leaves is held against the truth.

    python -m tests.end_to_end.kill_study --kills 300 --seed 9

Each run turns the simulated rig, is stopped at the same cycle, ramps down and seals: about three
seconds. So a kill may meet its beginning, its motion, its ramp, its sealing, or come too late. Its
process tells, on a pipe, how many rows each flush has brought to the system, and whether the plant
turns. Afterwards

- no flushed row is lost, and every row is that of a run that nobody killed,
- nothing is left unreadable: a run is recovered or sealed and verified, a header without rows taken away,
- a plant that was turning is latched by its marker, and the next run refused.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import select
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig, RigRequest
from rig.bench.backends.registry import BACKENDS
from rig.errors import RigError
from rig.run.latch import CUT_OFF, TripLatch
from rig.run.start import RunRequest, run_request
from rig.run.stop import StopRequest
from rig.runfile.read import FileSource, close_recording, open_run
from rig.runfile.recover import recover_run
from rig.runfile.verify import verify_run
from tests.rig.paced import flushes_told, paced_rig

AT_ONCE = 3
"""Runs that are alive at the same time, each with a folder of its own."""
LATEST = 3.2
"""s after its rig was opened at which a run is killed at the latest; it has sealed its file by then,
on a quiet computer.
"""
STOP_ROW = 1800
"""Row at which the operator's STOP comes: the same run every time, whatever the computer does."""


@dataclass
class Victim:
    """A run in a process of its own, the moment of its end, and what it told until then."""

    folder: Path
    moment: float
    process: int
    pipe: int
    told: list[str] = field(default_factory=list)
    rest: bytes = b""
    due: float = math.inf
    """When it is killed, by the monotonic clock: its moment after the first line that it tells."""

    def hear(self) -> bool:
        """Take what has been told; False at the end of the pipe."""
        data = os.read(self.pipe, 65536)
        *whole, self.rest = (self.rest + data).split(b"\n")
        self.told += [line.decode() for line in whole]
        if not data:
            self.due = min(self.due, time.monotonic())
        elif self.due == math.inf:
            self.due = time.monotonic() + self.moment
        return bool(data)

    @property
    def flushed(self) -> int:
        """Rows of the last flush that was told."""
        return max((int(t.split()[1]) for t in self.told if t.startswith("flushed")), default=0)

    @property
    def was_moving(self) -> bool:
        """Whether the plant was turning when it was last heard of."""
        motion = [t for t in self.told if t in ("moving", "stands")]
        return bool(motion) and motion[-1] == "moving"


def run_here(folder: Path, pipe: int) -> None:
    """One run in this process, telling on `pipe`."""
    stop = StopRequest()

    def tell(line: str) -> None:
        os.write(pipe, f"{line}\n".encode())

    def rig(request: RigRequest) -> AssembledRig:
        assembled = paced_rig(request, tell)
        port: Any = assembled.port
        exchange, rows = port.exchange, [0]

        def stopped(*arguments: Any) -> Any:
            if not rows[0]:
                tell("open")
            block = exchange(*arguments)
            rows[0] += len(block)
            if rows[0] >= STOP_ROW:
                stop.stop()
            return block

        port.exchange = stopped
        return assembled

    request = RunRequest(
        protocol="warm-up",
        gear=shipped_gear(),
        motor=shipped_motor(),
        output=folder,
        values={"zero_time": 0.5},
        backend="paced",
        gear_serial="SN-1",
        block_cycles=20,
    )
    with flushes_told(tell), patch.dict(BACKENDS, paced=rig):
        run_request(request, stop=stop)


def begun(folder: Path, moment: float) -> Victim:
    """A victim that has just been started."""
    reading, writing = os.pipe()
    process = os.fork()
    if not process:
        os.close(reading)
        with contextlib.suppress(BaseException):
            run_here(folder, writing)
        os._exit(0)
    os.close(writing)
    return Victim(folder, moment, process, reading)


def kill_all(victims: Sequence[Victim]) -> None:
    """Listen to all of them, and kill each at its moment; what a pipe still holds is heard after that."""
    alive, pipes = list(victims), {victim.pipe: victim for victim in victims}
    while alive:
        now = time.monotonic()
        wait = max(min(victim.due for victim in alive) - now, 0.0)
        for ready in select.select(list(pipes), [], [], min(wait, LATEST))[0]:
            if not pipes[ready].hear():
                del pipes[ready]
        for victim in [v for v in alive if v.due <= time.monotonic()]:
            os.kill(victim.process, signal.SIGKILL)
            alive.remove(victim)
    for victim in victims:
        os.waitpid(victim.process, 0)
        while victim.hear():
            pass
        os.close(victim.pipe)


def counts_in(path: Path) -> NDArray[Any]:
    """All stored counts of a run (rows, channels)."""
    recording = open_run(path, verify=True)
    try:
        assert isinstance(recording.source, FileSource)
        return np.stack([recording.stored(c.name) for c in recording.source.columns], axis=1)
    finally:
        close_recording(recording)


def judged(victim: Victim, reference: NDArray[Any]) -> tuple[str, list[str]]:
    """Where the kill met the run and what it left, and everything that is wrong with that."""
    wrong: list[str] = []
    trip = TripLatch(victim.folder).read()
    if victim.was_moving and (trip is None or trip.cause != CUT_OFF):
        wrong.append("in motion without a marker")
    runs = list(victim.folder.glob("*.h5"))
    left = "a sealed run" if runs else "no file"
    try:
        for part in victim.folder.glob("*.part"):
            recovered = recover_run(part)
            left = "a header" if recovered.is_removed else "rows"
            if not recovered.is_removed:
                runs = [recovered.path]
        rows = 0
        for path in runs:
            counts = counts_in(path)
            rows = len(counts)
            if not np.array_equal(counts, reference[:rows]):
                wrong.append("rows differ from those of the run that was not killed")
            wrong += [f.text for f in verify_run(path) if f.level == "error"]
        if rows < victim.flushed:
            wrong.append(f"{victim.flushed - rows} flushed rows lost")
    except RigError as error:
        wrong.append(f"unreadable: {error}")
    motion = "in motion" if victim.was_moving else "standing"
    return f"{motion}, left {left}{', latched' if trip is not None else ''}", wrong


def study(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kill so many runs at moments drawn with this seed; what was met, and everything that went wrong."""
    # In this process, so that its children find everything imported and compiled.
    with open(os.devnull, "wb") as nowhere:
        run_here(folder / "whole", nowhere.fileno())
    (path,) = (folder / "whole").glob("*.h5")
    reference = counts_in(path)
    draw, met, wrong = random.Random(seed), Counter[str](), list[str]()
    moments = [draw.uniform(0.0, LATEST) for _ in range(kills)]
    rows = 0
    for first in range(0, kills, AT_ONCE):
        batch = moments[first : first + AT_ONCE]
        victims = [begun(folder / str(first + k), moment) for k, moment in enumerate(batch)]
        kill_all(victims)
        for victim in victims:
            where, problems = judged(victim, reference)
            met[where] += 1
            rows += victim.flushed
            wrong += [f"kill {victim.folder.name} at {victim.moment:.3f} s: {p}" for p in problems]
    return {"kills": kills, "seed": seed, "flushed_rows": rows, "met": dict(met), "wrong": wrong}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=9)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kill-study-") as folder:
        outcome = study(asked.kills, asked.seed, Path(folder))
    print(json.dumps(outcome, indent=2))
    raise SystemExit(1 if outcome["wrong"] else 0)


if __name__ == "__main__":
    main()
