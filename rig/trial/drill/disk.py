"""Disks that fail: a run file whose writer has no room any more, and one whose disk takes nothing for a while."""

from __future__ import annotations

import errno
import threading
from dataclasses import dataclass, field
from pathlib import Path

from drivers.port import RigDescription
from drivers.samples import SampleBlock
from rig.library.folder import claim_run
from rig.run.opening import BegunRun, begin_inline_run, header_of
from rig.run.parts import OpenRun, SessionParts
from rig.run.recorder import InlineRecorder, ThreadedRecorder
from rig.runfile.write import RunWriter

_SMALL_SPACE = 1_000_000
"""Bytes that are left on a disk that is nearly full."""


class _FullDiskWriter(RunWriter):
    """A writer whose disk has no room left once `full_at` rows have been taken; what was flushed before stays."""

    full_at = 2**62
    refused = 0
    """Writes that the disk did not take."""

    def append(self, block: SampleBlock) -> None:
        """Take rows; flush at every block, so that it is the disk that refuses and not the end of the run."""
        super().append(block)
        self.flush()

    def _store_rows(self) -> None:
        if self.rows > self.full_at:
            self.refused += 1
            with self._disk("cannot be written"):
                raise OSError(errno.ENOSPC, "No space left on device")
        super()._store_rows()


class StalledWriter(RunWriter):
    """A writer whose disk takes nothing until `released`."""

    refused = 0
    """Blocks that had to wait for the disk."""

    def __init__(self, *arguments: object, **more: object) -> None:
        self.released = threading.Event()
        super().__init__(*arguments, **more)  # type: ignore[arg-type]

    def append(self, block: SampleBlock) -> None:
        """Wait, then take rows. The wait has an end, so that no drill can hang."""
        self.refused += not self.released.is_set()
        self.released.wait(30.0)
        super().append(block)


class _DrilledRun(BegunRun):
    """An open run on a disk that fails."""

    def flush(self) -> None:
        """Past the recorder, whose thread may be waiting for this very disk."""
        self.writer.flush()


@dataclass
class FailingDisk:
    """Begins runs on a disk that fails in one way, at a row."""

    how: str
    row: int
    writer: _FullDiskWriter | StalledWriter | None = None
    small: int = 0
    """How often too little space was said to be free."""
    complaints: list[str] = field(default_factory=list[str])
    """What the process beside the run said that it could not do."""

    def status(self, folder: Path) -> Path | None:
        """Where the status page of the run is to lie: in a folder that is not there; None for every other disk."""
        return folder / "gone" / "status.html" if self.how == "no status page" else None

    def evidence(self) -> str:
        """What shows that the disk failed; empty where nothing does."""
        refused = self.writer.refused if self.writer is not None else 0
        counted = (
            (refused, "blocks that the disk did not take"),
            (self.small, f"looks that found {_SMALL_SPACE} bytes free"),
        )
        words = [f"{what}: {count}" for count, what in counted if count]
        return ", ".join(words + self.complaints)

    def begin(
        self, parts: SessionParts, description: RigDescription, epoch_ns: int, start_time: str
    ) -> OpenRun:
        """As `begin_inline_run`, on this disk."""
        if self.how not in ("disk full", "writer stalled"):
            return begin_inline_run(parts, description, epoch_ns, start_time)
        place = claim_run(parts.order.folder, parts.planned.experiment.name, parts.order.serial)
        header = header_of(parts, description, place.run_id, epoch_ns, start_time)
        if self.how == "disk full":
            full = _FullDiskWriter(place.path, header, compress=False, chunk_rows=1024)
            full.full_at = self.row
            self.writer = full
            return _DrilledRun(place.run_id, full, InlineRecorder(full))
        stalled = StalledWriter(place.path, header, compress=False)
        self.writer = stalled
        rate = 1e9 / parts.rig.port.cycle_ns
        recorder = ThreadedRecorder(stalled, rate, ring_seconds=self.row / rate, smallest_ring=1)
        return _DrilledRun(place.run_id, stalled, recorder)

    def release(self) -> None:
        """The disk works again."""
        if isinstance(self.writer, StalledWriter):
            self.writer.released.set()

    def free_space(self, rows: int) -> int:
        """Bytes that are said to be free."""
        is_small = self.how == "disk nearly full" and rows > self.row
        self.small += is_small
        return _SMALL_SPACE if is_small else 10**12
