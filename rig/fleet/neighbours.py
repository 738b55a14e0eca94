"""What lies around a run, remembered: thousands of runs of a few folders share their index, tares and acceptance files.

A worker remembers for as long as one job lasts, so that what changed between two jobs is seen.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from datetime import datetime
from pathlib import Path

from rig.analysis.fit.recorded import Fit
from rig.analysis.fit.run import Choices, Surroundings
from rig.analysis.result_data import table_to_mapping
from rig.analysis.store import Analysis, json_text
from rig.gears.acceptance import Acceptance, acceptance_for, acceptance_text
from rig.library.index import LibraryIndex
from rig.runfile.read import close_recording

TARES = 8
"""Analysed tares that are kept at hand; each holds an open file."""
GEARS = 256
"""Gears whose acceptance file is kept at hand."""
_FOLDERS = 16
"""Folders whose index is kept at hand."""


class Neighbours(Surroundings):
    """The surroundings of runs, each part looked at once.

    `began` is when the job began (ISO 8601): what it keeps itself is nothing to learn from, else the order of its runs
    would decide on their numbers.
    """

    def __init__(self, began: str) -> None:
        self._began = datetime.fromisoformat(began)
        self._libraries: OrderedDict[Path, LibraryIndex] = OrderedDict()
        self._tares: OrderedDict[Path, Fit] = OrderedDict()
        self._digests: OrderedDict[tuple[str, int], str] = OrderedDict()
        self._accepted: dict[tuple[str, Path, str], tuple[Acceptance | None, str]] = {}

    def library(self, folder: Path) -> LibraryIndex:
        """The runs of a folder, as they were when it was first asked for."""
        library = self._libraries.get(folder)
        if library is None:
            library = self._libraries[folder] = LibraryIndex(folder, once=True)
        self._libraries.move_to_end(folder)
        if len(self._libraries) > _FOLDERS:
            self._libraries.popitem(last=False)
        return library

    def tare_fit(self, path: Path, choices: Choices) -> Fit:
        """The analysis of a tare, made or read once; `choices` are the same for all runs of a job."""
        fit = self._tares.get(path)
        if fit is None:
            fit = self._tares[path] = super().tare_fit(path, choices)
            if len(self._tares) > TARES:
                close_recording(self._tares.popitem(last=False)[1].recording)
        self._tares.move_to_end(path)
        return fit

    def let_go(self, fit: Fit) -> None:
        """Nothing: its file is closed with the others."""

    def learns_from(self, analysis: Analysis) -> bool:
        """Whether an analysis was kept before the job began."""
        return datetime.fromisoformat(str(analysis.content["created"])) < self._began

    def close(self) -> None:
        """Close the files of the tares."""
        while self._tares:
            close_recording(self._tares.popitem()[1].recording)

    def tare_digest(self, fit: Fit) -> str:
        """A hash of what an analysed tare says: another analysis of the same run is another tare."""
        key = (fit.recording.metadata.sha256, id(fit))
        if key not in self._digests:
            tables = [table_to_mapping(table) for table in fit.result.tables]
            self._digests[key] = digest([fit.result.as_json(), tables])
            if len(self._digests) > TARES:
                self._digests.popitem(last=False)
        return self._digests[key]

    def acceptance(self, named: str, folder: Path, serial: str) -> tuple[Acceptance | None, str]:
        """By what a gear is judged: the file that was named, else that of its card; and a hash of what it says."""
        key = (named, folder, serial)
        if key not in self._accepted:
            if len(self._accepted) >= GEARS:
                self._accepted.clear()
            found = acceptance_for(folder, serial, named)
            self._accepted[key] = (found, "" if found is None else digest(acceptance_text(found)))
        return self._accepted[key]


def digest(content: object) -> str:
    """A hash of what can be told as JSON."""
    return hashlib.sha256(json_text(content).encode()).hexdigest()


_local = threading.local()


def neighbours_of(job: str, began: str) -> Neighbours:
    """What this thread remembers of a job; another job begins with nothing."""
    if getattr(_local, "job", None) != job:
        forget_neighbours()
        _local.job, _local.neighbours = job, Neighbours(began)
    return _local.neighbours


def forget_neighbours() -> None:
    """Let go of what this thread remembers, and of the files that it holds open."""
    if getattr(_local, "job", None) is not None:
        _local.neighbours.close()
        _local.job = _local.neighbours = None
