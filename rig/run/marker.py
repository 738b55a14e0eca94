"""The marker of a run: a file that says "this run may be in motion", from before it arms until standstill is verified.

It is held locked by the process of the run. A marker whose lock is held is a running run. One whose
lock is not held is an orphan: its process was killed, or the power went, while the rig may have been
turning. An orphan refuses the next run as the latch of a trip does (`rig.run.latch`).
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from rig.bench.held import HeldFile, is_held, read_held
from rig.errors import RigError

PREFIX, SUFFIX = ".running-", ".json"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
"""Where Linux tells one start of the computer from the next."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkedRun:
    """What a marker says: run, protocol, bench, when it was begun (ISO 8601), its process and the
    start of the computer that this belongs to, and the file that it writes.
    """

    run: str
    protocol: str
    bench: str
    time: str
    process: int
    boot: str
    part: str


@dataclass(frozen=True, slots=True)
class Orphan:
    """A marker that nobody holds: where it lies, and what it says (None: it cannot be read)."""

    path: Path
    run: MarkedRun | None


class RunMarker:
    """The marker of one run on one bench, kept in the bench's state folder."""

    def __init__(self, folder: Path, bench: str) -> None:
        self._folder, self._bench = folder, bench
        self._file: HeldFile | None = None

    def leave(self, run: str, protocol: str, time: str, part: Path) -> None:
        """Mark the run, on the disk, before it is armed. Raises `RigError` where that cannot be done."""
        marked = MarkedRun(
            run=run,
            protocol=protocol,
            bench=self._bench,
            time=time,
            process=os.getpid(),
            boot=boot_id(),
            part=str(part.resolve()),
        )
        # Two folders of runs may count alike on one bench, and a process may run twice.
        path = self._folder / f"{PREFIX}{run}-{os.getpid()}-{os.urandom(3).hex()}{SUFFIX}"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._file = HeldFile.hold(path, new=True)
            assert self._file is not None
            self._file.write(asdict(marked))
        except OSError as error:
            self.remove()
            raise RigError(
                f"the run cannot be marked as running: {error.strerror or error}",
                where=str(self._folder),
                remedy="Nothing has moved. The folder has to be writable and its disk must know locks.",
            ) from error

    def remove(self) -> None:
        """The rig stands, verified: nothing is left to be found. An error leaves an orphan, which asks for a look."""
        if self._file is not None:
            try:
                self._file.remove()
            except OSError:
                self._file.close()

    def let_go(self) -> None:
        """The run is over. A marker that is still there is an orphan from here on."""
        if self._file is not None:
            self._file.close()


def orphans(folder: Path, *, alone: bool = False) -> Iterator[Orphan]:
    """The markers in a folder that nobody holds.

    `alone`: this process has the bench for itself, so that whatever is marked there is an orphan.
    """
    for path in _markers(folder):
        try:
            if not alone and is_held(path):
                continue
            content = read_held(path)
        except FileNotFoundError:
            # Its run has just come to its end.
            continue
        except (OSError, ValueError):
            yield Orphan(path, None)
            continue
        # One that was never written was never armed.
        if content:
            yield Orphan(path, _marked(content))


def live_runs(folder: Path) -> Iterator[MarkedRun]:
    """The runs that are marked in a folder and whose processes hold their markers."""
    for path in _markers(folder):
        with contextlib.suppress(OSError, ValueError):
            marked = _marked(read_held(path))
            if marked is not None and is_held(path):
                yield marked


def _markers(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{PREFIX}*{SUFFIX}"))


def boot_id() -> str:
    """Which start of the computer this is; "" where the system does not tell."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def _marked(content: dict[str, object]) -> MarkedRun | None:
    names = [field.name for field in fields(MarkedRun)]
    if not all(name in content for name in names) or not isinstance(content["process"], int):
        return None
    texts = {name: str(content[name]) for name in names if name != "process"}
    return MarkedRun(process=content["process"], **texts)
