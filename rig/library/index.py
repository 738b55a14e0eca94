"""The index of a folder of runs and of the folders in it: a cache in the user's own place, made by scanning; the
files stay the truth.

A file is read again when its path in the folder, its size, time of change or file number has
changed. Deleting the database costs one scan; so does finding it damaged or made by another
version. Where it cannot be kept (no place that can be written, a disk that is full, another process
that writes for long) the index lives in memory for as long as its object.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from rig.library.database import IndexDatabase, Row, Stored
from rig.library.folder import GONE, fingerprint_of, run_level, run_number, run_tree
from rig.library.listed import IndexedRun, State
from rig.library.place import index_path
from rig.library.reading import read_many
from rig.library.search import Day, bound_of, fits, within
from rig.library.writer_alive import is_being_written

WRITTEN_AT_ONCE = 250
"""Files that are read between two writes to the database: other processes find what is there already."""
_NUMBERS = ("duration", "ratio")
"""What is NaN where it is not known."""
_COLUMNS = tuple(f.name for f in fields(IndexedRun) if f.name not in ("path", "state"))


class LibraryIndex:
    """The runs of one folder; with `nested` also those of all folders in it. `refresh` looks at the files, `search`
    at what they said. May be used from several threads.

    `on_progress` is told how many files have been read of how many that must be, in the thread that reads. With `once`
    the files are looked at when something is first asked, and not again: for whoever asks of thousands of runs that
    nobody changes meanwhile.
    """

    def __init__(
        self,
        folder: str | Path,
        on_progress: Callable[[int, int], None] = lambda done, of: None,
        *,
        nested: bool = False,
        once: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self.refused: tuple[str, ...] = ()
        """The folders in it that could not be looked into, with the reason."""
        self.folders: tuple[Path, ...] = ()
        """The folders that hold its runs, and those on the way to them."""
        self._nested, self._once = nested, once
        self._all: list[IndexedRun] | None = None
        self._on_progress = on_progress
        self._database: IndexDatabase | None = None
        self._rows: Stored = {}
        self._stamp: object = None
        self._made: dict[str, tuple[str, IndexedRun]] = {}
        self._lock = threading.Lock()

    @property
    def rebuilt(self) -> str:
        """Why the index was made anew, or is kept in memory; empty where it was not."""
        return "" if self._database is None else self._database.remark

    def refresh(self) -> int:
        """Bring the index up to date; how many files had to be read. Raises `RunFileError` for what is no folder."""
        with self._lock:
            return self._refresh()

    def outdated(self) -> int:
        """How many files a refresh would read. Raises `RunFileError` for what is no folder."""
        with self._lock:
            return len(_outdated(self._listed(), self._known()))

    def search(
        self,
        text: str = "",
        *,
        gear: str = "",
        protocol: str = "",
        outcome: str = "",
        since: Day = None,
        until: Day = None,
        origin: str = "",
    ) -> list[IndexedRun]:
        """The runs that fit, after a refresh: folder by folder, in each in the order of their numbers.

        `text` finds every one of its words anywhere; `gear` is the whole serial number, `outcome`
        also one of the states ("being written"); all without regard to case. `since` and `until`
        are days or times, both included: a day is the one that the run's own clock showed. Raises
        `ValueError` for what is neither.
        """
        bounds = bound_of(since), bound_of(until)
        with self._lock:
            runs = self._all
            if runs is None:
                self._refresh()
                runs = self._runs()
            if self._once:
                self._all = runs
        exact = {"gear_serial": gear, "protocol": protocol, "origin": origin}
        words = text.casefold().split()
        if not (words or outcome or any(exact.values()) or any(bounds)):
            return list(runs)
        return [
            run for run in runs if fits(run, words, exact, outcome) and within(run.start, *bounds)
        ]

    def _listed(self) -> dict[str, str]:
        """The fingerprints of the files that are there, by their path within the folder."""
        if self._nested:
            listed, refused = run_tree(self.folder)
        else:
            listed, refused = run_level(self.folder), []
        self.refused = tuple(refused)
        return dict(listed)

    def _refresh(self) -> int:
        files = self._listed()
        rows = self._known()
        gone = [name for name in rows if name not in files]
        for name in gone:
            del rows[name]
        changed = _outdated(files, rows)
        database = self._kept_in()
        if gone:
            database.keep(gone, [])
        if changed:
            self._read(changed, files, rows)
        self._rows = rows
        self._stamp = None if database.was_busy else database.stamp()
        return len(changed)

    def _read(self, changed: Sequence[str], files: dict[str, str], rows: Stored) -> None:
        """Read these files; whatever ends the reading, what has been read is kept."""
        unwritten: list[str] = []
        self._on_progress(0, len(changed))
        paths = [self.folder / name for name in changed]
        try:
            with contextlib.closing(read_many(paths)) as answers:
                for done, (place, said, problem) in enumerate(answers, 1):
                    name = changed[place]
                    if problem and fingerprint_of(paths[place]) == GONE:
                        rows.pop(name, None)
                    else:
                        rows[name] = files[name], _row_of(name, said, problem)
                        unwritten.append(name)
                    if len(unwritten) == WRITTEN_AT_ONCE:
                        self._write(unwritten, rows)
                    if done < len(changed):
                        self._on_progress(done, len(changed))
        finally:
            self._write(unwritten, rows)

    def _write(self, names: list[str], rows: Stored) -> None:
        if names:
            self._kept_in().keep([], [(name, *rows[name]) for name in names])
            names.clear()

    def _kept_in(self) -> IndexDatabase:
        if self._database is None:
            self._database = IndexDatabase(index_path(self.folder), _COLUMNS)
        return self._database

    def _known(self) -> Stored:
        """What is known already: from the database where anybody has changed it, otherwise from memory."""
        database = self._kept_in()
        database.was_busy = False
        if self._stamp is not None and (not database.is_stored or database.stamp() == self._stamp):
            return self._rows
        stored = database.load()
        if stored is None:
            return self._rows
        # Of folders in the folder this index says nothing, and leaves what others know of them.
        return stored if self._nested else {n: row for n, row in stored.items() if "/" not in n}

    def _runs(self) -> list[IndexedRun]:
        """Every run in its order; those of files that have not changed are the same objects as before."""
        made: dict[str, tuple[str, IndexedRun]] = {}
        for name, (fingerprint, row) in self._rows.items():
            before = self._made.get(name)
            if before is None or before[0] != fingerprint:
                before = fingerprint, _run_of(self.folder / name, row)
            elif before[1].unfinished:
                before = fingerprint, _looked_at(before[1])
            made[name] = before
        self._made = made
        inside = {Path(folder) for folder in {name.rpartition("/")[0] for name in made}}
        self.folders = tuple(
            sorted({self.folder / way for place in inside for way in (place, *place.parents)})
        )
        ordered = sorted(
            made.items(), key=lambda item: (item[0].rpartition("/")[0], item[1][1].number, item[0])
        )
        return [run for _, (_, run) in ordered]


def _row_of(name: str, said: dict[str, Any], problem: str) -> Row:
    """What a file says of itself, by column."""
    file = name.rpartition("/")[2]
    row: dict[str, Any] = (
        dict.fromkeys(_COLUMNS, "") | {"rows": 0, **dict.fromkeys(_NUMBERS, math.nan)} | said
    )
    row |= {
        "run_id": row["run_id"] or file.split(".h5")[0],
        "number": run_number(file),
        "problem": problem,
    }
    for name in _NUMBERS:
        # A database knows no NaN.
        if math.isnan(row[name]):
            row[name] = None
    return tuple(row[column] for column in _COLUMNS)


def _run_of(path: Path, row: Row) -> IndexedRun:
    values = dict(zip(_COLUMNS, row, strict=True))
    for name in _NUMBERS:
        if values[name] is None:
            values[name] = math.nan
    return IndexedRun(path=path, state=_state_of(path, values["problem"]), **values)


def _looked_at(run: IndexedRun) -> IndexedRun:
    """The same run with its state of now."""
    state = _state_of(run.path, run.problem)
    return run if state == run.state else replace(run, state=state)


def _state_of(path: Path, problem: str) -> State:
    unfinished = path.name.endswith(".part")
    if unfinished and is_being_written(path):
        return "being written"
    if problem:
        return "unreadable"
    return "left behind" if unfinished else "sealed"


def _outdated(files: dict[str, str], rows: Stored) -> list[str]:
    """The files that must be read, sorted: new ones, and those that have changed."""
    return sorted(
        name
        for name, fingerprint in files.items()
        if name not in rows or rows[name][0] != fingerprint
    )
