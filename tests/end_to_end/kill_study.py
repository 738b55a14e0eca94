"""Kills at random moments: runs are killed (SIGKILL), and what each leaves is held against the truth.

    python -m tests.end_to_end.kill_study --kills 300 --seed 9

In turn a run in real time, one in virtual time, and one of the drivers in virtual time. Each turns the
simulated rig, is stopped at the same row, ramps down and seals: about three seconds. So a kill may meet
its beginning, its motion, its ramp, its sealing, or come too late. Its process tells, on a pipe, how
long its header is, how many rows each flush has brought to the system, and (in real time) whether the
plant turns. Afterwards

- no flushed row is lost, and every row is that of a run that nobody killed,
- no byte is deleted: each `.part` lies beside its run with the SHA-256 that it had, but for a run that
  had been completed, and for what is no longer than a header,
- nothing is left unreadable: a run is recovered or sealed and verified,
- a plant that was turning is latched by its marker, and the next run refused.

The last line (on standard error) says all of that at once.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import select
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from experiments.finding import Severity
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.bench.backends.registry import BACKENDS
from rig.errors import RigError
from rig.run.latch import CUT_OFF, TripLatch
from rig.run.start import run_order
from rig.run.stop import StopRequest
from rig.runfile.empty import part_bytes
from rig.runfile.read import FileSource, close_recording, open_run
from rig.runfile.recover import recover_run
from rig.runfile.seal import file_sha256
from rig.runfile.verify import verify_run
from rig.runfile.write import RunWriter
from tests.rig.paced import flushes_told, paced_rig

LATEST = 3.2
"""s after its rig was opened at which a run is killed at the latest; it has sealed its file by then,
on a quiet computer.
"""


LONG = {"at_most": 3600.0, "tolerance": 1e-9, "window": 60.0}
"""A warm-up that ends only by the operator's STOP."""


@dataclass(frozen=True)
class Kind:
    """A kind of run: its backend, the cycles of a block, and the row at which the operator's STOP comes,
    so that it is the same run every time, whatever the computer does."""

    backend: str
    block_cycles: int
    stop_row: int


KINDS = {
    "real time": Kind("paced", 20, 1800),
    "virtual time": Kind("sim", 100, 100_000),
    "drivers": Kind("wire", 100, 12_000),
}
"""One of each is alive at the same time, each with a folder of its own."""


@dataclass
class Victim:
    """A run in a process of its own, the moment of its end, and what it told until then."""

    folder: Path
    kind: str
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
    def header(self) -> int:
        """Bytes of its file before the first row, 0 where it did not come to tell them."""
        return max((int(t.split()[1]) for t in self.told if t.startswith("header")), default=0)

    @property
    def was_moving(self) -> bool:
        """Whether the plant was turning when it was last heard of."""
        motion = [t for t in self.told if t in ("moving", "stands")]
        return bool(motion) and motion[-1] == "moving"


@contextlib.contextmanager
def header_told(tell: Callable[[str], None]) -> Iterator[None]:
    """`tell` hears how long a file is when its header is complete and no row is taken."""
    begin = RunWriter.__init__

    def told(writer: RunWriter, *arguments: Any, **options: Any) -> None:
        begin(writer, *arguments, **options)
        tell(f"header {writer.part.stat().st_size}")

    with patch.object(RunWriter, "__init__", told):
        yield


def run_here(folder: Path, pipe: int, name: str) -> None:
    """One run of this kind in this process, telling on `pipe`."""
    stop, kind = StopRequest(), KINDS[name]
    make = BACKENDS.get(kind.backend)

    def tell(line: str) -> None:
        os.write(pipe, f"{line}\n".encode())

    def rig(order: Order, setup: Setup) -> AssembledRig:
        assembled = paced_rig(order, setup, tell) if make is None else make(order, setup)
        port: Any = assembled.port
        exchange, rows = port.exchange, [0]

        def stopped(*arguments: Any) -> Any:
            if not rows[0]:
                tell("open")
            block = exchange(*arguments)
            rows[0] += len(block)
            if rows[0] >= kind.stop_row:
                stop.stop()
            return block

        port.exchange = stopped
        return assembled

    request = Order(
        protocol="warm-up",
        gear=shipped_gear(),
        motor=shipped_motor(),
        folder=folder,
        values={"zero_time": 0.5, **LONG},
        backend=kind.backend,
        serial="SN-1",
        block_cycles=kind.block_cycles,
    )
    with flushes_told(tell), header_told(tell), patch.dict(BACKENDS, {kind.backend: rig}):
        run_order(request, stop=stop)


def begun(folder: Path, kind: str, moment: float) -> Victim:
    """A victim that has just been started."""
    reading, writing = os.pipe()
    process = os.fork()
    if not process:
        os.close(reading)
        with contextlib.suppress(BaseException):
            run_here(folder, writing, kind)
        os._exit(0)
    os.close(writing)
    return Victim(folder, kind, moment, process, reading)


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


def recovered(victim: Victim, part: Path, wrong: list[str]) -> tuple[str, list[Path], int]:
    """What was left in a part, the run that came of it, and how many bytes of it were kept.

    Appends to `wrong` every byte that is gone and was not proved to be nothing.
    """
    before, size = file_sha256(part), part.stat().st_size
    if part_bytes(part).may_have_no_header and not victim.header:
        # Killed while the header was written: refused, and not touched.
        with contextlib.suppress(RigError):
            recover_run(part)
        if file_sha256(part) != before:
            wrong.append(f"{size} bytes are not what they were")
        return "an unfinished header", [], size
    run = recover_run(part)
    if run.is_removed:
        if size > victim.header and victim.header:
            wrong.append(f"{size - victim.header} bytes behind the header deleted")
        return "a header", [], 0
    if run.kept is not None:
        if file_sha256(run.kept) != before:
            wrong.append(f"{size} bytes are not what they were")
        return "rows" if run.rows else "no row that can be found", [run.path], size
    if run.outcome == "INTERRUPTED":
        wrong.append(f"{size} bytes deleted of a run that was not complete")
    return "a complete run", [run.path], 0


def judged(victim: Victim, reference: NDArray[Any]) -> tuple[str, list[str], int]:
    """Where the kill met the run and what it left, everything that is wrong with that, and the bytes kept."""
    wrong: list[str] = []
    kept = 0
    trip = TripLatch(victim.folder).read()
    if victim.was_moving and (trip is None or trip.cause != CUT_OFF):
        wrong.append("in motion without a marker")
    runs = list(victim.folder.glob("*.h5"))
    left = "a sealed run" if runs else "no file"
    try:
        for part in victim.folder.glob("*.part"):
            left, runs, kept = recovered(victim, part, wrong)
        rows = 0
        for path in runs:
            counts = counts_in(path)
            rows = len(counts)
            if not np.array_equal(counts, reference[:rows]):
                wrong.append("rows differ from those of the run that was not killed")
            wrong += [f.found for f in verify_run(path) if f.severity is Severity.BLOCKS]
        if rows < victim.flushed:
            wrong.append(f"{victim.flushed - rows} flushed rows lost")
    except RigError as error:
        wrong.append(f"unreadable: {error}")
    motion = ", in motion" if victim.was_moving else ""
    latched = ", latched" if trip is not None else ""
    return f"{victim.kind}{motion}, left {left}{latched}", wrong, kept


def references(folder: Path) -> dict[str, NDArray[Any]]:
    """The counts of a run of each kind that nobody kills.

    Made in this process, so that its children find everything imported and compiled.
    """
    found = {}
    for kind in KINDS:
        with open(os.devnull, "wb") as nowhere:
            run_here(folder / kind, nowhere.fileno(), kind)
        (path,) = (folder / kind).glob("*.h5")
        found[kind] = counts_in(path)
    return found


def study(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kill so many runs at moments drawn with this seed; what was met, and everything that went wrong."""
    reference = references(folder / "whole")
    draw, met, wrong = random.Random(seed), Counter[str](), list[str]()
    moments = [draw.uniform(0.0, LATEST) for _ in range(kills)]
    rows = kept = 0
    for first in range(0, kills, len(KINDS)):
        batch = zip(KINDS, moments[first : first + len(KINDS)], strict=False)
        victims = [
            begun(folder / str(first + k), kind, moment) for k, (kind, moment) in enumerate(batch)
        ]
        kill_all(victims)
        for victim in victims:
            where, problems, stays = judged(victim, reference[victim.kind])
            met[where] += 1
            rows, kept = rows + victim.flushed, kept + stays
            wrong += [f"kill {victim.folder.name} at {victim.moment:.3f} s: {p}" for p in problems]
            shutil.rmtree(victim.folder, ignore_errors=True)
    return {
        "kills": kills,
        "seed": seed,
        "flushed_rows": rows,
        "bytes_kept": kept,
        "met": dict(met),
        "wrong": wrong,
    }


def in_a_line(outcome: dict[str, Any]) -> str:
    """The result of the study in one line."""
    met: dict[str, int] = outcome["met"]
    cut = sum(count for where, count in met.items() if "left rows" in where)
    moving = sum(count for where, count in met.items() if "in motion" in where)
    return (
        f"{outcome['kills']} kills (seed {outcome['seed']}): {outcome['flushed_rows']} flushed rows; "
        f"{cut} runs recovered, {outcome['bytes_kept']} bytes kept; {moving} in motion; "
        f"{len(outcome['wrong'])} wrong (rows lost, rows that differ, bytes deleted, unreadable, no marker)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=9)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kill-study-") as folder:
        outcome = study(asked.kills, asked.seed, Path(folder))
    print(json.dumps(outcome, indent=2))
    print(in_a_line(outcome), file=sys.stderr)
    raise SystemExit(1 if outcome["wrong"] else 0)


if __name__ == "__main__":
    main()
