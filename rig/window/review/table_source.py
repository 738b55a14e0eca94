"""The runs of the window's folder, kept up to date: a watcher of the folder, a pause, and the index
read beside the window.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QFileSystemWatcher, QObject, Signal

from rig.errors import RigError
from rig.library.index import IndexedRun, LibraryIndex
from rig.window.work.background import single_shot

_PAUSE_MS = 250
"""ms that must pass without a further change before the folder is read."""
GROWING_MS = 2000
"""ms between two looks while a run is being written: its file grows without the folder changing."""

_MOST_WATCHED = 200
"""Folders that are watched: some computers give a program no more."""

PROGRESS_INTERVAL = 0.2
"""s between two words about how far the reading is."""

_LONGEST_STOP = 5.0
"""s that the end of the window waits for the file that is being read."""


class _StoppedError(Exception):
    """The window is going: the rest of the folder is not read any more."""


class LibrarySource(QObject):
    """The runs of one folder. `changed` carries them whenever one came, went, grew or was sealed."""

    changed = Signal(object)
    """Carries a list of `IndexedRun` in the order of their numbers."""
    failed = Signal(str)
    """Why the folder cannot be read."""
    progressed = Signal(int, int)
    """Files read so far, and how many have to be: none when all were read and nothing has changed."""
    looked = Signal()
    """The folder was read, whether or not anything has changed: what lies beside the runs may have."""
    _read = Signal(object)

    def __init__(self, folder: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.folder = folder
        self.runs: tuple[IndexedRun, ...] | None = None
        """The latest runs; None until they were read once."""
        self._index = LibraryIndex(folder, self._tell, nested=True)
        self._last_progress = -PROGRESS_INTERVAL
        self._reading = self._again = self._stopped = False
        self._thread: threading.Thread | None = None
        self._watcher = QFileSystemWatcher(self)
        self._watcher.directoryChanged.connect(lambda _: self._pause.start())
        self._pause = single_shot(self, _PAUSE_MS, self.look)
        self._growing = single_shot(self, GROWING_MS, self.look)
        self._read.connect(self._take)
        program = QCoreApplication.instance()
        if program is not None:
            program.aboutToQuit.connect(self.stop)

    def look(self) -> None:
        """Read the folder now; at once again if it changes meanwhile."""
        if self._reading:
            self._again = True
            return
        self._pause.stop()
        self._watch()
        self._reading = True
        self._thread = threading.Thread(target=self._work, name="library", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Read no further, and wait for the file that is being read: a program must not end within the HDF5 library."""
        self._stopped = True
        if self._thread is not None:
            self._thread.join(_LONGEST_STOP)

    def _watch(self) -> None:
        """Watch the folder and those of the folders in it that hold runs."""
        folders = {str(folder) for folder in self._index.folders[:_MOST_WATCHED]}
        if self.folder.is_dir():
            folders.add(str(self.folder))
        fresh = sorted(folders - set(self._watcher.directories()))
        if fresh:
            self._watcher.addPaths(fresh)

    def _work(self) -> None:
        """In a thread of its own: reading a folder for the first time takes milliseconds per run."""
        answer: Sequence[IndexedRun] | str
        try:
            answer = self._index.search() if self.folder.is_dir() else []
        except RigError as error:
            answer = str(error)
        except _StoppedError:
            return
        # The window may be gone by now, and its signals with it.
        with contextlib.suppress(RuntimeError):
            self._read.emit(answer)

    def _tell(self, done: int, of: int) -> None:
        if self._stopped:
            raise _StoppedError
        now = time.monotonic()
        if now - self._last_progress >= PROGRESS_INTERVAL:
            self._last_progress = now
            with contextlib.suppress(RuntimeError):
                self.progressed.emit(done, of)

    def _take(self, answer: Sequence[IndexedRun] | str) -> None:
        self._reading = False
        self._watch()
        if isinstance(answer, str):
            self.failed.emit(answer)
        elif self.runs is None or tuple(answer) != self.runs:
            self.runs = tuple(answer)
            self.changed.emit(self.runs)
        else:
            self.progressed.emit(0, 0)
        self.looked.emit()
        if self._again:
            self._again = False
            self._pause.start()
        elif (
            any(run.state == "being written" for run in self.runs or ()) or not self.folder.is_dir()
        ):
            self._growing.start()
