"""The database of an index: one table in SQLite, made anew where it is damaged or of another version."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

SCHEMA = 5
"""The version of the tables; another one is rebuilt."""
WAITING_TIME = 2.0
"""s that one process waits for another one's write."""
_NUMERIC = {"number": "INTEGER", "rows": "INTEGER", "duration": "REAL", "ratio": "REAL"}
Answer = TypeVar("Answer")
Row = tuple[Any, ...]
"""What one file says of itself, in the order of the columns; a duration that is not known is None."""
Stored = dict[str, tuple[str, Row]]
"""Fingerprint and row by the file's path within the folder."""


class IndexDatabase:
    """What an index keeps. Where it cannot be kept `remark` says why, and `is_stored` is False."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.path = path
        self.is_stored = True
        self.remark = ""
        """Why the database was made anew, or is not kept; empty where neither is so."""
        self.was_busy = False
        """Whether something was left undone because another process was writing."""
        self._columns = tuple(columns)

    def load(self) -> Stored | None:
        """Everything that is stored; None where that cannot be read."""

        def read(database: sqlite3.Connection) -> Stored:
            columns = ", ".join(self._columns)
            lines = database.execute(f"SELECT file, fingerprint, {columns} FROM runs")
            return {row[0]: (row[1], row[2:]) for row in lines}

        return self._with(read)

    def keep(self, gone: Iterable[str], rows: Iterable[tuple[str, str, Row]]) -> None:
        """Write what has changed, all of it or nothing."""
        names = ", ".join(("file", "fingerprint", *self._columns))
        marks = ", ".join("?" * (2 + len(self._columns)))

        def write(database: sqlite3.Connection) -> None:
            with database:
                database.executemany("DELETE FROM runs WHERE file = ?", [(name,) for name in gone])
                database.executemany(
                    f"INSERT OR REPLACE INTO runs ({names}) VALUES ({marks})",
                    [(name, fingerprint, *row) for name, fingerprint, row in rows],
                )

        if self.is_stored:
            self._with(write)

    def stamp(self) -> tuple[int, int, int]:
        """What changes when anybody writes to the database."""
        try:
            status = self.path.stat()
        except OSError:
            return 0, 0, 0
        return status.st_ino, status.st_size, status.st_mtime_ns

    def _with(self, action: Callable[[sqlite3.Connection], Answer]) -> Answer | None:
        """Do something with the database, which is made anew where it is damaged or of another version.

        Whatever goes wrong is said in `remark` and None returned: what a cache cannot give is read from the files.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            connection, remark = _opened(self.path, self._columns)
            self.remark = remark or self.remark
            with contextlib.closing(connection):
                return action(connection)
        except OSError as error:
            self._give_up(f"{self.path.parent}: {error.strerror or error}")
        except sqlite3.OperationalError as error:
            self.was_busy = self.is_stored = _is_busy(error)
            self.remark = f"kept in memory: {error}"
        except sqlite3.DatabaseError as error:
            # Damage that shows only where the rows are: nothing of this file is believed.
            if _deleted(self.path):
                self.remark = f"made anew: {error}"
            else:
                self._give_up(str(error))
        return None

    def _give_up(self, why: str) -> None:
        self.is_stored = False
        self.remark = f"kept in memory: {why}"


def _opened(path: Path, columns: Sequence[str]) -> tuple[sqlite3.Connection, str]:
    """The database with its table, and why it had to be made anew ("" if not). Raises
    `sqlite3.Error` where that cannot be.
    """
    try:
        return _prepared(path, columns)
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError as error:
        if not _deleted(path):
            raise
        return _prepared(path, columns)[0], f"made anew: {error}"


def _prepared(path: Path, columns: Sequence[str]) -> tuple[sqlite3.Connection, str]:
    connection = sqlite3.connect(path, timeout=WAITING_TIME)
    try:
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version == SCHEMA:
            return connection, ""
        declared = ", ".join(f"{name} {_NUMERIC.get(name, 'TEXT')}" for name in columns)
        # Of two processes that find an old version the second one waits here, and finds the new one.
        connection.execute("BEGIN IMMEDIATE")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version != SCHEMA:
            connection.execute("DROP TABLE IF EXISTS runs")
            connection.execute(
                f"CREATE TABLE runs (file TEXT PRIMARY KEY, fingerprint TEXT, {declared})"
            )
            connection.execute(f"PRAGMA user_version = {SCHEMA}")
        connection.commit()
    except BaseException:
        connection.close()
        raise
    is_old = version not in (0, SCHEMA)
    return connection, f"made anew: it was of version {version}" if is_old else ""


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
