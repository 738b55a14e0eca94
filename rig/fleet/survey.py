"""The indexes of many folders brought up to date by many hands: what a run is stands in its header, and to read one
takes as long as a quarter of a short fit.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.errors import RunFileError
from rig.fleet.engine import BatchTask, Hands
from rig.fleet.progress import Progress
from rig.library.index import LibraryIndex

FEW = 100
"""Headers that this process reads by itself: nobody is called for them."""


@dataclass(frozen=True)
class Folder:
    """A folder of runs whose index is not up to date, as the worker finds it; so many headers are to be read."""

    path: str
    headers: int
    kind: str = "folder"


@dataclass(frozen=True)
class _Surveyed:
    """Folders that were looked at."""

    headers: int
    seconds: float


def survey(
    hands: Hands,
    folders: Sequence[Path],
    there: Callable[[Path], str],
    on_progress: Callable[[Progress], None],
) -> None:
    """Bring the indexes of these folders up to date. A folder that a worker cannot index is read where it is needed."""
    late = [Folder(there(one), n) for one in folders if (n := LibraryIndex(one).outdated())]
    headers, done, began = sum(folder.headers for folder in late), 0, time.monotonic()
    if headers <= FEW:
        return
    for _, outcome in hands.outcomes(BatchTask(_look_over, _lost), late):
        done += outcome.headers
        seconds = time.monotonic() - began
        on_progress(
            Progress(
                runs=headers, done=done, reused=0, failed=0, seconds=seconds, what="headers read"
            )
        )


def _look_over(folders: Sequence[Folder]) -> _Surveyed:
    """Bring the indexes of some folders up to date, one after the other."""
    began = time.perf_counter()
    for folder in folders:
        # What cannot be indexed is told where a run of it is analysed.
        with contextlib.suppress(RunFileError, OSError):
            LibraryIndex(folder.path).refresh()
    return _Surveyed(sum(one.headers for one in folders), time.perf_counter() - began)


def _lost(folder: Folder, reason: str) -> _Surveyed:
    return _Surveyed(folder.headers, 0.0)
