"""A journal: a file that grows line by line, each line with the SHA-256 of the line before under `before`.

A journal has no note beside it, because it grows. A line that was changed, taken out or put in is found when it is
read. Whole lines taken away at its end are not: nothing after them tells. A last line that a power cut left unfinished
is not counted, and is taken away when the next one is written.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.errors import ChangedRunError, RunFileError

BEFORE = "before"
"""The key under which a line holds the SHA-256 of the line before, "" in the first one."""


@dataclass(frozen=True)
class Chain:
    """A kind of journal, in the words of its errors: what it is called, and what to do about one that is damaged."""

    what: str
    remedy: str
    """Where it was changed or is damaged."""
    where_it_lies: str
    """Where it cannot be written."""

    def read(
        self, path: Path, is_chained: Callable[[Mapping[str, Any]], bool] = lambda first: True
    ) -> list[dict[str, Any]]:
        """Its lines; `is_chained` of the first one: whether they hold hashes at all.

        Raises `RunFileError` for one that cannot be read, `ChangedRunError` for a line that is not as it was written.
        """
        try:
            lines = path.read_bytes().split(b"\n")
        except OSError as error:
            raise RunFileError(
                f"{self.what} cannot be read", where=str(path), value=str(error)
            ) from None
        rows: list[dict[str, Any]] = []
        # What stands behind the last newline was being written when the power went.
        for number, line in enumerate(lines[:-1], 1):
            try:
                row = json.loads(line)
            except ValueError:
                row = None
            if not isinstance(row, dict):
                raise RunFileError(
                    f"{self.what} is damaged", where=f"{path}: line {number}", remedy=self.remedy
                )
            if rows and is_chained(rows[0]):
                self._check(path, number, row, lines[number - 2])
            rows.append(row)
        return rows

    def append(self, path: Path, row: Mapping[str, Any]) -> None:
        """Write one more line, to the disk. Raises `RunFileError`."""
        try:
            with path.open("a+b") as file:
                file.seek(0)
                kept = file.read()
                whole = kept[: kept.rfind(b"\n") + 1]
                lines = whole.split(b"\n")[:-1]
                before = "".join(hashlib.sha256(line).hexdigest() for line in lines[-1:])
                # A line that was cut off is taken away: the next one would be glued to it.
                file.truncate(len(whole))
                file.write(json.dumps({**row, BEFORE: before}, ensure_ascii=False).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise self.not_written(path, error) from None

    def not_written(self, path: Path, error: OSError) -> RunFileError:
        """What is raised where it cannot be written."""
        return RunFileError(
            f"{self.what} cannot be written",
            where=str(path),
            value=error.strerror or str(error),
            remedy=self.where_it_lies,
        )

    def _check(self, path: Path, number: int, row: Mapping[str, Any], before: bytes) -> None:
        """Refuse a line that does not follow upon the one before it."""
        digest = hashlib.sha256(before).hexdigest()
        if row.get(BEFORE) != digest:
            raise ChangedRunError(
                f"{self.what} was changed since it was written",
                where=f"{path}: line {number - 1}",
                value=f"SHA-256 {digest}",
                limit=f"{row.get(BEFORE) or 'none'} (as line {number} says)",
                remedy=self.remedy,
            )
