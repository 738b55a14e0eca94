"""A folder of runs: the next run number, which is never used twice, and the list of what is there."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from experiments.recording import RunMetadata
from rig.errors import RigError, RunFileError

NUMBERS_FOLDER = ".run-numbers"
"""One empty file per number that was ever given out in a folder; taking a number is creating its file."""

RUN_SUFFIXES = (".h5", ".h5.part")
_LEADING_NUMBER = re.compile(r"(\d{1,9})-")
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9._]+")


@dataclass(frozen=True)
class RunPlace:
    """A number that belongs to one run for good, and the file that it will be in."""

    number: int
    path: Path

    @property
    def run_id(self) -> str:
        """`<number>-<protocol>-<serial>`."""
        return self.path.name.removesuffix(".h5")

    def give_back(self) -> None:
        """Let go of the number if no run came of it; another run may then take it."""
        if not any(self.path.parent.glob(f"{self.run_id}.h5*")):
            (self.path.parent / NUMBERS_FOLDER / f"{self.number:05d}").unlink(missing_ok=True)


@dataclass(frozen=True)
class ListedRun:
    """One line of the list: what the file says of itself, or why it cannot be read."""

    path: Path
    metadata: RunMetadata | None
    rows: int = 0
    duration: float = float("nan")
    problem: str = ""
    notes: str = ""
    """What the operators noted, in one text."""

    @property
    def unfinished(self) -> bool:
        """Whether it is still being written or was cut off."""
        return self.path.name.endswith(".part")


def claim_run(folder: str | Path, protocol: str, serial: str) -> RunPlace:
    """Take the next run number of a folder, made if need be; safe against other processes that do the same."""
    folder = Path(folder)
    try:
        (folder / NUMBERS_FOLDER).mkdir(parents=True, exist_ok=True)
        number = _highest_number(folder) + 1
        while True:
            try:
                (folder / NUMBERS_FOLDER / f"{number:05d}").open("x").close()
                break
            except FileExistsError:
                number += 1
    except OSError as error:
        raise RunFileError(
            f"no run can be recorded here: {error.strerror or error}",
            where=str(folder),
            remedy="Name a folder that can be written.",
        ) from error
    return RunPlace(
        number,
        folder / f"{number:05d}-{_in_name(protocol, 'run')}-{_in_name(serial, 'unknown')}.h5",
    )


def run_files(folder: str | Path) -> tuple[Path, ...]:
    """The run files of a folder in the order of their numbers, unfinished ones included."""
    folder = Path(folder)
    try:
        paths = [
            path for path in folder.iterdir() if path.name.endswith(RUN_SUFFIXES) and path.is_file()
        ]
    except OSError as error:
        raise RunFileError(
            f"is no folder of runs: {error.strerror or error}",
            where=str(folder),
            remedy="Name the folder with --runs.",
        ) from error
    return tuple(sorted(paths, key=lambda path: (run_number(path.name), path.name)))


def sealed_runs(folder: str | Path, serial: str | None = None) -> tuple[Path, ...]:
    """The sealed run files of a folder in the order of their numbers; with `serial` those whose names bear it."""
    end = ".h5" if serial is None else f"-{_in_name(serial, 'unknown')}.h5"
    return tuple(path for path in run_files(folder) if path.name.endswith(end))


def run_named(folder: str | Path, name: str) -> Path:
    """The run file that a path, a run's number or its name in the folder means. Raises `RunFileError`."""
    folder, path = Path(folder), Path(name)
    if path.is_file():
        return path
    number = int(name) if name.isdecimal() else 0
    found = [
        run
        for run in (run_files(folder) if folder.is_dir() else ())
        if name == run.name.removesuffix(".h5") or (number and number == run_number(run.name))
    ]
    if len(found) != 1:
        raise RunFileError(
            "names several runs" if found else "names no run",
            where=str(folder),
            value=name,
            limit="a run file, or the number or name of a run in this folder",
            remedy="Look with `rig runs`.",
        )
    return found[0]


def read_listed(path: Path) -> ListedRun:
    """What one file says of itself; of one that cannot be read, the reason."""
    from rig.runfile.read import glance

    try:
        summary = glance(path)
    except RigError as error:
        return ListedRun(path, None, problem=str(error))
    notes = "; ".join(
        event.text
        for event in summary.events
        if event.source == "operator" and event.code == "note"
    )
    return ListedRun(path, summary.metadata, summary.rows, summary.duration, notes=notes)


def _highest_number(folder: Path) -> int:
    names = [path.name + "-" for path in (folder / NUMBERS_FOLDER).iterdir()]
    names += [path.name for path in folder.iterdir()]
    return max((run_number(name) for name in names), default=0)


def run_number(name: str) -> int:
    """The number that a file or folder of a run bears; 0 for one that bears none."""
    match = _LEADING_NUMBER.match(name)
    return int(match.group(1)) if match else 0


def _in_name(text: str, otherwise: str) -> str:
    return _NOT_IN_NAMES.sub("_", text.strip())[:60].strip("._") or otherwise
