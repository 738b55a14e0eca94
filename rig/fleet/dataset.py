"""The folder of results: one Parquet data set of many files, each written whole or not at all.

    fleet-results/
      part-00000001.parquet      rows of some runs, the newest file has the highest number
      .lock                      held by the one program that writes

For one run and one kind the rows in the highest-numbered file count. While a job runs, rows that it renews may stand
in an older file too; at its end the files are put together, and each run stands there once. A program that was killed
leaves nothing half: what was written stays, and the next job goes on from there.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import RigError, RunFileError
from rig.fleet.results import SCHEMA_KEY, SCHEMA_VERSION, arrow_schema
from rig.fleet.table import parquet_bytes, sorted_table

if TYPE_CHECKING:
    import pyarrow

FOLDER_NAME = "fleet-results"
_ROWS_PER_FILE = 50_000
"""Rows that a file has at least once the files have been put together."""
_PART = re.compile(r"part-(\d{8})\.parquet\Z")
Identity = tuple[str, str]
"""Run file and kind: of what rows there is one set."""


@dataclass(frozen=True)
class Known:
    """What the data set knows of one run and kind: in which file, under which key, and whether it failed."""

    part: int
    key: str
    surroundings: str
    failure: str
    failure_kind: str


class DataSet:
    """The results of a fleet in one folder."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._last = 0

    @contextmanager
    def writing(self) -> Iterator[DataSet]:
        """The data set for the one program that writes it. Raises `RigError` where another one does already."""
        from filelock import FileLock, Timeout

        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.folder / ".lock")
            lock.acquire(timeout=0)
        except Timeout:
            raise RigError(
                "another program is writing these results",
                where=str(self.folder),
                remedy="Wait for it, or name another folder with --output.",
            ) from None
        except OSError as error:
            raise RunFileError(
                f"no results can be written here: {error.strerror or error}",
                where=str(self.folder),
                remedy="Name a folder that can be written with --output.",
            ) from None
        try:
            for scratch in self.folder.glob(".part-*.tmp"):
                scratch.unlink(missing_ok=True)
            self._last = max((number for number, _ in self.parts()), default=0)
            yield self
        finally:
            lock.release()

    def parts(self) -> list[tuple[int, Path]]:
        """The files with their numbers, oldest first."""
        if not self.folder.is_dir():
            return []
        found = ((_PART.match(path.name), path) for path in self.folder.iterdir())
        return sorted((int(match[1]), path) for match, path in found if match)

    def known(self) -> dict[Identity, Known]:
        """What there is, by run file and kind. Raises `RunFileError` for a file that is none of this data set."""

        names = ["run_file", "kind", "key", "surroundings", "failure", "failure_kind"]
        known: dict[Identity, Known] = {}
        for number, path in self.parts():
            table = _read(path, names).group_by(names).aggregate([])
            columns = [table.column(name).to_pylist() for name in names]
            for run_file, kind, key, surroundings, failure, failure_kind in zip(
                *columns, strict=True
            ):
                known[run_file, kind] = Known(
                    number, key, surroundings, failure or "", failure_kind or ""
                )
        return _without_superseded(known)

    def append(self, rows: bytes) -> None:
        """Keep the rows of some runs, given as the bytes of a Parquet file."""
        self._last += 1
        self._write(self._last, rows)

    def put_together(self, restamped: Mapping[Identity, str]) -> None:
        """Make few large files of many small ones, in each of which a run stands once.

        `restamped` are new `surroundings` of runs whose rows are still what they were.
        """
        known = self.known()
        owners = {identity: one.part for identity, one in known.items()}
        for group in self._groups(owners, restamped):
            table = self._merged(group, owners, restamped)
            # The highest number of a group has the last word: until the others are gone they say the same.
            self._write(group[-1][0], parquet_bytes(table))
            for _, path in group[:-1]:
                path.unlink(missing_ok=True)

    def table(self) -> pyarrow.Table:
        """All rows that count, in their order."""
        import pyarrow as pa

        owners = {identity: one.part for identity, one in self.known().items()}
        parts = self.parts()
        if not parts:
            return arrow_schema().empty_table()
        return sorted_table(pa.concat_tables([_counting_rows(*part, owners) for part in parts]))

    def has_renewed_rows(self) -> bool:
        """Whether rows of one run stand in two files, of which the older one no longer counts."""

        seen: set[Identity] = set()
        for _, path in self.parts():
            table = _read(path, ["run_file", "kind"])
            table = table.group_by(["run_file", "kind"]).aggregate([])
            here = set(
                zip(*(table.column(n).to_pylist() for n in ("run_file", "kind")), strict=True)
            )
            if seen & here:
                return True
            seen |= here
        return False

    def _groups(
        self, owners: Mapping[Identity, int], restamped: Mapping[Identity, str]
    ) -> Iterator[list[tuple[int, Path]]]:
        """Neighbouring files that are to become one: small ones, and those with rows that no longer count."""
        import pyarrow.parquet as pq

        touched = {owners[identity] for identity in restamped if identity in owners}
        group: list[tuple[int, Path]] = []
        rows, due = 0, False
        for number, path in self.parts():
            here = pq.read_metadata(path).num_rows
            group.append((number, path))
            rows += here
            due = (
                due
                or len(group) > 1
                or number in touched
                or self._has_foreign(path, number, owners)
            )
            if rows >= _ROWS_PER_FILE:
                if due:
                    yield group
                group, rows, due = [], 0, False
        if group and due:
            yield group

    def _has_foreign(self, path: Path, number: int, owners: Mapping[Identity, int]) -> bool:

        table = _read(path, ["run_file", "kind"])
        table = table.group_by(["run_file", "kind"]).aggregate([])
        pairs = zip(*(table.column(n).to_pylist() for n in ("run_file", "kind")), strict=True)
        return any(owners.get(pair) != number for pair in pairs)

    def _merged(
        self,
        group: Sequence[tuple[int, Path]],
        owners: Mapping[Identity, int],
        restamped: Mapping[Identity, str],
    ) -> pyarrow.Table:
        import pyarrow as pa

        table = pa.concat_tables([_counting_rows(number, path, owners) for number, path in group])
        if not restamped:
            return table
        pairs = zip(table["run_file"].to_pylist(), table["kind"].to_pylist(), strict=True)
        old = table["surroundings"].to_pylist()
        new = [restamped.get(pair, before) for pair, before in zip(pairs, old, strict=True)]
        place = table.schema.get_field_index("surroundings")
        return table.set_column(place, table.schema.field(place), pa.array(new, pa.string()))

    def _write(self, number: int, content: bytes) -> None:
        path = self.folder / f"part-{number:08d}.parquet"
        scratch = self.folder / f".{path.stem}.{os.getpid()}.tmp"
        try:
            with scratch.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            scratch.replace(path)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise RunFileError(
                f"the results cannot be written: {error.strerror or error}",
                where=str(path),
                remedy="Make room; what is there is kept, and the same command goes on from it.",
            ) from None


def _without_superseded(known: dict[Identity, Known]) -> dict[Identity, Known]:
    """Without what is said of a run whose kind could not be read, where its kind was read later."""
    newest: dict[str, int] = {}
    for (run_file, kind), one in known.items():
        if kind:
            newest[run_file] = max(one.part, newest.get(run_file, 0))
    return {
        (run_file, kind): one
        for (run_file, kind), one in known.items()
        if kind or newest.get(run_file, 0) < one.part
    }


def _counting_rows(number: int, path: Path, owners: Mapping[Identity, int]) -> pyarrow.Table:
    """The rows of a file that count."""
    import pyarrow as pa

    table = _read(path)
    pairs = zip(table["run_file"].to_pylist(), table["kind"].to_pylist(), strict=True)
    return table.filter(pa.array([owners.get(pair) == number for pair in pairs], pa.bool_()))


def _read(path: Path, columns: list[str] | None = None) -> pyarrow.Table:
    """A file of the data set, or some of its columns. Raises `RunFileError` for one that is damaged or of another."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # Opened once, and without a data set around it: a job has hundreds of small files.
        with pq.ParquetFile(path) as file:
            metadata = file.schema_arrow.metadata or {}
            _require_schema(path, metadata.get(SCHEMA_KEY.encode(), b"").decode())
            table = file.read(columns=columns)
        own = arrow_schema()
        return table.cast(own if columns is None else pa.schema([own.field(n) for n in columns]))
    except (pa.ArrowException, OSError) as error:
        raise RunFileError(
            "is no Parquet file that can be read",
            where=str(path),
            value=str(error),
            remedy="Take it away, and fit again: what is missing is fitted anew.",
        ) from None


def _require_schema(path: Path, version: str) -> None:
    if version != str(SCHEMA_VERSION):
        raise RunFileError(
            "is not of this data set's schema",
            where=str(path),
            value=f"version {version or 'unknown'}",
            limit=f"version {SCHEMA_VERSION}",
            remedy="Name another folder with --output, or take these files away and fit again.",
        )
