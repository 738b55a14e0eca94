"""What is to be done: which runs are meant, and which of them are not done yet.

A run is done where the data set has its rows and nothing around the run has changed since: its bytes, the tares and
trips of its folder, its gear's card, acceptance file, settings and versions. Of these a hash stands in the rows. Where
it is another one the run becomes a task; the worker then finds out whether that changes anything for this run.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from experiments import catalogue
from model.errors import WordedError
from rig.analysis.learnt import learnt_paths
from rig.analysis.store import analysis_folder
from rig.analysis.tare import takes_tare, tare_days_of, tare_kind
from rig.errors import ConfigurationError, RunFileError
from rig.fleet.dataset import FOLDER_NAME, Identity, Known
from rig.fleet.neighbours import digest
from rig.fleet.results import SCHEMA_VERSION
from rig.fleet.task import Job, RunTask
from rig.gears.acceptance import acceptance_for, acceptance_text
from rig.gears.card import card_path
from rig.library.folder import run_files
from rig.library.index import IndexedRun, LibraryIndex, fingerprint_of
from rig.runfile.layout import HASH_SUFFIX
from rig.runfile.seal import sealed_sha256

if TYPE_CHECKING:
    from experiments.contract import Experiment

_LIST_SUFFIX = ".txt"
"""A file of this suffix is a list of runs and folders, one a line."""
_KEPT_FAILURES = frozenset({"AnalysisError"})
"""Failures that speak of the recording: they are kept like results. All others (a file, a worker) are tried again."""


@dataclass(frozen=True)
class Work:
    """Everything that was asked for: the tasks to do, what is done already, and what is known to have failed."""

    tasks: tuple[RunTask, ...]
    reused: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]

    @property
    def runs(self) -> int:
        """How many runs are meant."""
        return len(self.tasks) + len(self.reused) + len(self.failed)


def runs_named(names: Sequence[str | Path]) -> list[Path]:
    """The run files that folders, patterns, lists and files name, each once, sorted.

    Folders are searched to their ground. Raises `ConfigurationError` for a name that names nothing.
    """
    found: dict[Path, None] = {}
    for name in names:
        runs = list(_named(str(name)))
        if not runs:
            raise ConfigurationError(
                "names no run",
                where=str(name),
                limit="a folder of runs, a pattern, a list (.txt), or run files",
                remedy="Look with `rig runs DIR`.",
            )
        found.update(dict.fromkeys(runs))
    return sorted(found)


def first_folder(names: Sequence[str | Path]) -> Path:
    """The first folder that is meant: where the results go unless somebody says otherwise."""
    first = Path(names[0])
    return first if first.is_dir() else runs_named(names[:1])[0].parent


def _named(name: str) -> Iterable[Path]:
    path = Path(name)
    if path.is_dir():
        yield from _in_folder(path)
    elif path.suffix == _LIST_SUFFIX and path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.strip():
                yield from _named(line.strip())
    elif path.is_file():
        yield path
    else:
        for match in sorted(glob.glob(name, recursive=True)):
            if Path(match).is_dir():
                yield from _in_folder(Path(match))
            elif match.endswith(".h5"):
                yield Path(match)


def _in_folder(folder: Path) -> Iterable[Path]:
    for place, folders, _ in os.walk(folder):
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".") and not name.endswith(".analysis") and name != FOLDER_NAME
        )
        yield from (run for run in run_files(place) if run.suffix == ".h5")


def work_for(
    runs: Sequence[Path], job: Job, known: Mapping[Identity, Known], *, base: Path, there: PathMap
) -> Work:
    """What of these runs is to be done. `base` is the folder from which the table names them."""
    tasks: list[RunTask] = []
    reused: list[str] = []
    failed: list[tuple[str, str]] = []
    places: dict[Path, _Place] = {}
    whole_base = base.resolve()
    for run in runs:
        if run.parent not in places:
            places[run.parent] = _Place(run.parent, job)
        place = places[run.parent]
        whole = place.whole(run)
        kind = job.kind or place.protocol(run)
        run_file = _name(whole_base, whole)
        before = known.get((run_file, kind))
        now = place.surroundings(run, kind)
        if before is None or before.surroundings != now or _is_tried_again(before):
            key = before.key if before is not None and not before.failure else ""
            tasks.append(RunTask(run_file, there.seen(whole), kind, now, key))
        elif before.failure:
            failed.append((run_file, before.failure))
        else:
            reused.append(run_file)
    return Work(tuple(tasks), tuple(reused), tuple(failed))


def _is_tried_again(known: Known) -> bool:
    return bool(known.failure) and known.failure_kind not in _KEPT_FAILURES


def _name(base: Path, whole: Path) -> str:
    """How the table names a run: relative to the folder that holds the results where it lies within, else whole."""
    return (whole.relative_to(base) if whole.is_relative_to(base) else whole).as_posix()


@dataclass(frozen=True)
class PathMap:
    """Under which other path the workers see the runs; as here where nothing is said."""

    here: str = ""
    there: str = ""

    @classmethod
    def of(cls, text: str) -> PathMap:
        """Out of `from=to`. Raises `ConfigurationError` for anything else."""
        here, equals, there = text.partition("=")
        if not (here and equals and there):
            raise ConfigurationError(
                "is no pair of paths",
                where="--map",
                value=repr(text),
                limit="from=to",
                remedy="For instance: --map /data/runs=/mnt/rig/runs.",
            )
        return cls(str(Path(here).resolve()), there)

    def path(self, run: Path) -> str:
        """A run as the workers find it. Raises `ConfigurationError` for one that lies elsewhere."""
        return self.seen(run.resolve())

    def seen(self, whole: Path) -> str:
        """The same for a path without links and dots."""
        if not self.here:
            return str(whole)
        if not whole.is_relative_to(self.here):
            raise ConfigurationError(
                "lies outside of what the workers see under another path",
                where="--map",
                value=str(whole),
                limit=self.here,
                remedy="Name a folder that holds all runs.",
            )
        return f"{self.there.rstrip('/')}/{whole.relative_to(self.here).as_posix()}"


class _Place:
    """One folder of runs, as far as it decides on the analyses of its runs."""

    def __init__(self, folder: Path, job: Job) -> None:
        self._folder, self._job = folder, job
        self._whole = folder.resolve()
        listed = LibraryIndex(folder, once=True).search()
        self._runs: dict[str, IndexedRun] = {one.path.name: one for one in listed}
        self._common = digest(
            [
                SCHEMA_VERSION,
                dict(job.settings),
                job.no_tare,
                _days_in(folder),
                [f"{path}:{fingerprint_of(path)}" for path in learnt_paths(folder)],
                [_traits(one) for one in listed if one.outcome == "TRIPPED"],
            ]
        )
        kind = tare_kind()
        tares = [one for one in listed if one.protocol == kind]
        self._tares = digest(
            [[*_traits(one), _hash_of(one.path), _stored(one.path)] for one in tares]
        )
        self._listed = listed
        self._gears: dict[str, str] = {}

    def whole(self, run: Path) -> Path:
        """The path of a run without links and dots."""
        return run.resolve() if run.is_symlink() else self._whole / run.name

    def protocol(self, run: Path) -> str:
        """The protocol by which a run was made; "" where it cannot be read."""
        one = self._runs.get(run.name)
        return "" if one is None else one.protocol

    def surroundings(self, run: Path, kind: str) -> str:
        """A hash of all around a run that can decide on its rows."""
        one = self._runs.get(run.name)
        serial = "" if one is None else one.gear_serial
        experiment = catalogue.declared(kind)
        content = [
            self._common,
            kind,
            0 if experiment is None else experiment.version,
            _hash_of(run),
            self._of_gear(serial),
            self._tares if experiment is not None and takes_tare(kind) else "",
        ]
        leans_on = _leans_on(experiment)
        if leans_on:
            content += [
                [other.path.name, _stored(other.path)]
                for other in self._listed
                if other.gear_serial == serial and other.protocol in leans_on
            ]
        return digest(content)[:32]

    def _of_gear(self, serial: str) -> str:
        if serial not in self._gears:
            self._gears[serial] = digest([self._card(serial), self._acceptance(serial)])
        return self._gears[serial]

    def _card(self, serial: str) -> str:
        if not serial:
            return ""
        try:
            return card_path(self._folder, serial).read_text(encoding="utf-8")
        except OSError:
            return ""

    def _acceptance(self, serial: str) -> str:
        try:
            found = acceptance_for(self._folder, serial, self._job.acceptance)
            return "" if found is None else acceptance_text(found)
        except WordedError as error:
            return str(error)


def _leans_on(experiment: Experiment | None) -> tuple[str, ...]:
    """The protocols of the same gear whose stored analyses decide on those of this kind."""
    if experiment is None:
        return ()
    if experiment.learns is None:
        return tuple(experiment.builds_on)
    return (*experiment.builds_on, experiment.name)


def _traits(run: IndexedRun) -> list[str]:
    return [run.path.name, run.start, run.outcome, run.state, run.origin, run.bench]


def _hash_of(run: Path) -> str:
    """The hash under which a run was sealed, at a glance; of one that is not as it was sealed its size and times."""
    try:
        return sealed_sha256(run)
    except (RunFileError, OSError):
        return fingerprint_of(run)


def _stored(run: Path) -> list[str]:
    """The analyses beside a run, their notes and the choices among them: by name, size and time."""
    try:
        with os.scandir(analysis_folder(run)) as entries:
            return sorted(
                f"{entry.name}:{entry.stat().st_size}:{entry.stat().st_mtime_ns}"
                for entry in entries
                if entry.name.endswith((".json", HASH_SUFFIX))
            )
    except OSError:
        return []


def _days_in(folder: Path) -> float | str:
    try:
        return tare_days_of(folder)
    except WordedError as error:
        return str(error)
