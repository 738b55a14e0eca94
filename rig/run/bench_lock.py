"""One master per bench: whoever opens a rig of hardware or a hub has it for itself until it lets go or dies.

In-process simulations (`sim`, `wire`, `replay`) are made anew for every run and take no lock.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator
from datetime import UTC, datetime

from rig.bench.held import HeldFile, read_held
from rig.bench.identity import Bench
from rig.errors import BenchInUseError, RigError
from rig.run.marker import live_runs

LOCK_NAME = ".in-use.json"


@contextlib.contextmanager
def bench_lock(bench: Bench, purpose: str) -> Generator[None, None, None]:
    """Have a bench for the time of the block. `purpose` is what a second process is told, such as "rig run friction".

    Raises `BenchInUseError` while another process has it.
    """
    if not bench.has_one_master:
        yield
        return
    path = bench.state / LOCK_NAME
    try:
        held = HeldFile.hold(path)
        if held is not None:
            now = datetime.now(UTC).isoformat(timespec="seconds")
            held.write({"process": os.getpid(), "purpose": purpose, "time": now})
    except OSError as error:
        raise RigError(
            f"this bench cannot be locked against a second master: {error.strerror or error}",
            where=str(path),
            remedy="Nothing was connected. The folder has to be writable and its disk must know locks.",
        ) from error
    if held is None:
        raise BenchInUseError(
            "another process has it; two masters would take the nodes away from each other",
            where=f"bench {bench.id}",
            value=_holder(bench),
            remedy="Nothing was connected. Wait for its end, or stop it there.",
        )
    try:
        yield
    finally:
        held.close()


def _holder(bench: Bench) -> str:
    """Process, purpose and run of whoever has the bench."""
    try:
        note = read_held(bench.state / LOCK_NAME)
    except (OSError, ValueError):
        note = {}
    process = note.get("process", "unknown")
    words = (
        f"process {process}, {note.get('purpose', 'unknown')} since {note.get('time', 'unknown')}"
    )
    runs = [marked.run for marked in live_runs(bench.state) if marked.process == process]
    return f"{words}, run {runs[0]}" if runs else words
