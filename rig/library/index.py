"""The index of a folder of runs: a cache in SQLite beside them, rebuilt by scanning; the files stay the truth.

A file is read again when its name, size, time of change or file number has changed. Deleting the
database costs one scan; so does finding it damaged or made by another version. Where it cannot be
kept (a folder that may not be written, a disk that is full, another process that writes for long)
the index lives in memory for as long as its object.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from datetime import date, datetime
from pathlib import Path
from typing import Any, Literal, TypeVar

from rig.library.folder import ListedRun, read_listed, run_files, run_number
from rig.library.living import is_being_written

INDEX_NAME = ".library.sqlite"
SCHEMA = 3
"""The version of the tables; another one is rebuilt."""
WAITING_TIME = 2.0
"""s that one process waits for another one's write."""
WRITTEN_AT_ONCE = 50
"""Files that are read between two writes to the database: other processes find what is there already."""
COUNTED_OUTCOMES = ("COMPLETED", "")
"""Outcomes of runs that were brought to their end ("" is an imported recording's)."""
Answer = TypeVar("Answer")
State = Literal["sealed", "being written", "left behind", "unreadable"]
Day = str | date | None
"""A day or a time: ISO 8601 text, or a `date` or `datetime`."""


@dataclass(frozen=True, kw_only=True)
class IndexedRun:
    """One run as the index knows it.

    `state`: sealed; being written by a living process; left behind by a dead one (see `rig
    recover`); or unreadable, with the reason in `problem`. `duration` in s, NaN where it is not
    known; `notes` are the operator's, in one text.
    """

    path: Path
    run_id: str
    number: int
    state: State
    protocol: str
    gear_serial: str
    gear: str
    operator: str
    start: str
    duration: float
    outcome: str
    origin: str
    backend: str
    rows: int
    problem: str
    notes: str
    bench: str
    """The bench that it was made on; "" where its file does not say it."""
    mounting: str

    @property
    def is_complete(self) -> bool:
        """Whether it is sealed and was brought to its end: what was broken off lacks speeds."""
        return self.state == "sealed" and self.outcome in COUNTED_OUTCOMES

    def as_json(self) -> dict[str, Any]:
        """One line of `rig runs --json`."""
        return {
            "file": str(self.path),
            "run": self.run_id,
            "number": self.number,
            "state": self.state,
            "unfinished": self.path.name.endswith(".part"),
            "protocol": self.protocol,
            "origin": self.origin,
            "backend": self.backend,
            "outcome": self.outcome,
            "started": self.start,
            "operator": self.operator,
            "gear": self.gear,
            "gear_serial": self.gear_serial,
            "rows": self.rows,
            "duration_s": self.duration,
            "notes": self.notes,
            "problem": self.problem,
            "bench": self.bench,
            "mounting": self.mounting,
        }


_COLUMNS = tuple(f.name for f in fields(IndexedRun) if f.name not in ("path", "state"))
_NUMERIC = {"number": "INTEGER", "rows": "INTEGER", "duration": "REAL"}
_SEARCHED = (
    "run_id",
    "protocol",
    "gear_serial",
    "gear",
    "operator",
    "outcome",
    "notes",
    "problem",
    "start",
)

Row = tuple[Any, ...]
"""What one file says of itself, in the order of `_COLUMNS`; a duration that is not known is None."""


class LibraryIndex:
    """The runs of one folder. `refresh` looks at the files, `search` at what they said. May be used
    from several threads.

    `on_progress` is told how many files have been read of how many that must be, in the thread that reads. With `once`
    the files are looked at when something is first asked, and not again: for whoever asks of thousands of runs that
    nobody changes meanwhile.
    """

    def __init__(
        self,
        folder: str | Path,
        on_progress: Callable[[int, int], None] = lambda done, of: None,
        *,
        once: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self._on_progress = on_progress
        self._once = once
        self._all: list[IndexedRun] | None = None
        self.rebuilt = ""
        """Why the index was made anew, or is kept in memory; empty where it was not."""
        self._rows: dict[str, tuple[str, Row]] | None = None
        self._is_stored = True
        self._lock = threading.Lock()

    def refresh(self) -> int:
        """Bring the index up to date; how many files had to be read. Raises `RunFileError` for what is no folder."""
        with self._lock:
            return self._refresh()

    def outdated(self) -> int:
        """How many files a refresh would read. Raises `RunFileError` for what is no folder."""
        with self._lock:
            rows = self._load()
            return sum(
                path.name not in rows or rows[path.name][0] != fingerprint_of(path)
                for path in run_files(self.folder)
            )

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
        """The runs that fit, in the order of their numbers, after a refresh.

        `text` finds every one of its words anywhere; `gear` is the whole serial number, `outcome`
        also one of the states ("being written"); all without regard to case. `since` and `until`
        are days or times, both included: a day is the one that the run's own clock showed. Raises
        `ValueError` for what is neither.
        """
        bounds = _bound(since), _bound(until)
        runs = self._runs()
        if not any((text, gear, protocol, outcome, since, until, origin)):
            return runs
        exact = {"gear_serial": gear, "protocol": protocol, "origin": origin}
        words = text.casefold().split()
        return [
            run for run in runs if _fits(run, words, exact, outcome) and _within(run.start, *bounds)
        ]

    def _runs(self) -> list[IndexedRun]:
        """All runs in the order of their numbers, after a look at the files where one is due."""
        with self._lock:
            if self._all is not None:
                return list(self._all)
            self._refresh()
            runs = [self._run(name, row) for name, (_, row) in (self._rows or {}).items()]
            runs.sort(key=lambda run: (run.number, run.path.name))
            if self._once:
                self._all = runs
            return list(runs)

    def _refresh(self) -> int:
        files = {path.name: (path, fingerprint_of(path)) for path in run_files(self.folder)}
        rows = self._load()
        gone = [name for name in rows if name not in files]
        for name in gone:
            del rows[name]
        changed = [
            name
            for name, (_, fingerprint) in files.items()
            if name not in rows or rows[name][0] != fingerprint
        ]
        for first in range(0, max(len(changed), 1 if gone else 0), WRITTEN_AT_ONCE):
            batch = changed[first : first + WRITTEN_AT_ONCE]
            for place, name in enumerate(batch, first):
                self._on_progress(place, len(changed))
                path, fingerprint = files[name]
                rows[name] = fingerprint, _row_of(read_listed(path))
            self._keep([] if first else gone, [(name, *rows[name]) for name in batch])
        self._rows = rows
        return len(changed)

    def _load(self) -> dict[str, tuple[str, Row]]:
        """What is known already: from the database, or from memory where there is none."""
        rows = self._rows if self._rows is not None else {}
        if not self._is_stored and self._rows is not None:
            return rows

        def read(database: sqlite3.Connection) -> dict[str, tuple[str, Row]]:
            lines = database.execute(
                f"SELECT file, fingerprint, {', '.join(_COLUMNS)} FROM runs"
            ).fetchall()
            return {row[0]: (row[1], row[2:]) for row in lines}

        stored = self._with_database(read)
        return rows if stored is None else stored

    def _keep(self, gone: Sequence[str], rows: Sequence[tuple[str, str, Row]]) -> None:
        """Write what has changed to the database, all of it or nothing."""
        names = ", ".join(("file", "fingerprint", *_COLUMNS))
        marks = ", ".join("?" * (2 + len(_COLUMNS)))
        insert = f"INSERT OR REPLACE INTO runs ({names}) VALUES ({marks})"

        def write(database: sqlite3.Connection) -> None:
            with database:
                database.executemany("DELETE FROM runs WHERE file = ?", [(name,) for name in gone])
                database.executemany(
                    insert, [(name, fingerprint, *row) for name, fingerprint, row in rows]
                )

        if self._is_stored:
            self._with_database(write)

    def _run(self, name: str, row: Row) -> IndexedRun:
        path = self.folder / name
        values = dict(zip(_COLUMNS, row, strict=True))
        values["duration"] = float("nan") if values["duration"] is None else values["duration"]
        return IndexedRun(path=path, state=_state_of(path, values["problem"]), **values)

    def _with_database(self, action: Callable[[sqlite3.Connection], Answer]) -> Answer | None:
        """Do something with the database, which is made anew where it is damaged or of another version.

        Whatever goes wrong is said in `rebuilt` and None returned: what a cache cannot give is read from the files.
        """
        path = self.folder / INDEX_NAME
        try:
            connection, remark = _opened(path)
            self.rebuilt = remark or self.rebuilt
            with contextlib.closing(connection):
                return action(connection)
        except sqlite3.OperationalError as error:
            self._is_stored = _is_busy(error)
            self.rebuilt = f"kept in memory: {error}"
        except sqlite3.DatabaseError as error:
            # Damage that shows only where the rows are: nothing of this file is believed.
            self._is_stored = _deleted(path)
            self.rebuilt = f"made anew: {error}" if self._is_stored else f"kept in memory: {error}"
        return None


def fingerprint_of(path: Path) -> str:
    """What changes when a file does: size, time of change, file number."""
    try:
        status = os.stat(path)
    except OSError:
        return "gone"
    return f"{status.st_size}:{status.st_mtime_ns}:{status.st_ino}"


def _opened(path: Path) -> tuple[sqlite3.Connection, str]:
    """The database with its table, and why it had to be made anew ("" if not). Raises
    `sqlite3.Error` where that cannot be.
    """
    try:
        return _prepared(path)
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError as error:
        if not _deleted(path):
            raise
        return _prepared(path)[0], f"made anew: {error}"


def _prepared(path: Path) -> tuple[sqlite3.Connection, str]:
    connection = sqlite3.connect(path, timeout=WAITING_TIME)
    try:
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version == SCHEMA:
            return connection, ""
        columns = ", ".join(f"{name} {_NUMERIC.get(name, 'TEXT')}" for name in _COLUMNS)
        # Of two processes that find an old version the second one waits here, and finds the new one.
        connection.execute("BEGIN IMMEDIATE")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version != SCHEMA:
            connection.execute("DROP TABLE IF EXISTS runs")
            connection.execute(
                f"CREATE TABLE runs (file TEXT PRIMARY KEY, fingerprint TEXT, {columns})"
            )
            connection.execute(f"PRAGMA user_version = {SCHEMA}")
        connection.commit()
    except BaseException:
        connection.close()
        raise
    return connection, f"made anew: it was of version {version}" if version not in (
        0,
        SCHEMA,
    ) else ""


def _is_busy(error: sqlite3.OperationalError) -> bool:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in (
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_LOCKED,
    )


def _deleted(path: Path) -> bool:
    """Whether a damaged database could be taken away."""
    try:
        path.unlink(missing_ok=True)
        path.with_name(path.name + "-journal").unlink(missing_ok=True)
    except OSError:
        return False
    return True


def _row_of(run: ListedRun) -> Row:
    """What a file says of itself, by column."""
    m = run.metadata
    row: dict[str, Any] = dict.fromkeys(_COLUMNS, "") | {
        "run_id": run.path.name.split(".h5")[0],
        "number": run_number(run.path.name),
        "rows": run.rows,
        "duration": None if run.duration != run.duration else run.duration,
        "problem": run.problem,
    }
    if m is not None:
        row |= {
            "run_id": m.run_id or row["run_id"],
            "protocol": m.experiment,
            "gear_serial": m.gear_serial,
            "gear": m.gear.name if m.gear is not None else "",
            "operator": m.operator,
            "start": m.start_time,
            "outcome": m.outcome,
            "origin": m.origin,
            "backend": str(m.process.get("backend", "")),
            "notes": run.notes,
            "bench": str(m.process.get("bench", "")),
            "mounting": m.mounting,
        }
    return tuple(row.values())


def _state_of(path: Path, problem: str) -> State:
    unfinished = path.name.endswith(".part")
    if unfinished and is_being_written(path):
        return "being written"
    if problem:
        return "unreadable"
    return "left behind" if unfinished else "sealed"


def _fits(run: IndexedRun, words: Sequence[str], exact: dict[str, str], outcome: str) -> bool:
    if any(
        value and getattr(run, name).casefold() != value.casefold() for name, value in exact.items()
    ):
        return False
    if outcome and outcome.casefold() not in (run.outcome.casefold(), run.state):
        return False
    text = " ".join(getattr(run, name) for name in _SEARCHED).casefold() if words else ""
    return all(word in text for word in words)


def _bound(day: Day) -> str | datetime | None:
    """A day as text, a time as a time."""
    if day is None or day == "":
        return None
    if isinstance(day, str):
        moment = datetime.fromisoformat(day)
        return day if len(day) <= len("YYYY-MM-DD") else moment
    return day if isinstance(day, datetime) else day.isoformat()


def _within(start: str, since: str | datetime | None, until: str | datetime | None) -> bool:
    """Whether a run began between two days or times, both included; one that does not say when is in no interval."""
    if since is None and until is None:
        return True
    try:
        began = datetime.fromisoformat(start)
    except ValueError:
        return False
    return (since is None or _order(since, began) <= 0) and (
        until is None or _order(until, began) >= 0
    )


def _order(bound: str | datetime, began: datetime) -> int:
    """-1, 0 or 1: the bound lies before, at or after the moment. A time without a zone is read in the moment's own."""
    if isinstance(bound, str):
        day = date.fromisoformat(bound)
        return (day > began.date()) - (day < began.date())
    if bound.tzinfo is None:
        bound = bound.replace(tzinfo=began.tzinfo)
    elif began.tzinfo is None:
        began = began.replace(tzinfo=bound.tzinfo)
    return (bound > began) - (bound < began)
