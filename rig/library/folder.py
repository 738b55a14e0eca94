"""A folder of runs: the next run number, which is never used twice, and the list of what is there."""

from __future__ import annotations

import os
import re
import stat
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from rig.errors import RunFileError
from rig.runfile.file_names import too_long

NUMBERS_FOLDER = ".run-numbers"
"""One empty file per number that was ever given out in a folder; taking a number is creating its file."""

RUN_SUFFIXES = (".h5", ".h5.part")
ANALYSES_SUFFIX = ".analysis"
"""How the folders end that hold the analyses of a run."""
GONE = "gone"
"""The fingerprint of a file that is not there."""
_FoundFile = tuple[str, str]
"""A run file by its path within the folder, with slashes, and its fingerprint."""
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


def claim_run(folder: str | Path, protocol: str, serial: str) -> RunPlace:
    """Take the next run number of a folder, made if need be; safe against other processes that do the same."""
    folder = Path(folder)
    named = f"{_in_name(protocol, 'run')}-{_in_name(serial, 'unknown')}.h5"
    if why := too_long(folder / f"00000-{named}"):
        # Before anything turns: the system would refuse it in words that name no length.
        raise RunFileError(
            f"no run can be recorded here: {why}",
            where=str(folder),
            remedy="Name a folder nearer to the root with --runs.",
        )
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
    return RunPlace(number, folder / f"{number:05d}-{named}")


def run_files(folder: str | Path) -> tuple[Path, ...]:
    """The run files of a folder in the order of their numbers, unfinished ones included."""
    folder = Path(folder)
    try:
        paths = [
            path for path in folder.iterdir() if path.name.endswith(RUN_SUFFIXES) and path.is_file()
        ]
    except OSError as error:
        raise _no_folder(folder, error) from error
    return tuple(sorted(paths, key=lambda path: (run_number(path.name), path.name)))


def run_tree(folder: str | Path) -> tuple[list[_FoundFile], list[str]]:
    """The run files of a folder and of all folders in it, in no order; and the folders that cannot be looked into.

    Folders of analyses, hidden ones, and links to folders are not entered. Raises `RunFileError` for what is no folder.
    """
    found: list[_FoundFile] = []
    refused: list[str] = []
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        try:
            found += _runs_within(folder, inside, waiting)
        except OSError as error:
            if not inside:
                raise _no_folder(folder, error) from error
            refused.append(f"{Path(folder, inside)}: {error.strerror or error}")
    return found, sorted(refused)


def run_level(folder: str | Path) -> list[_FoundFile]:
    """The run files of a folder alone, in no order. Raises `RunFileError` for what is no folder."""
    try:
        return _runs_within(folder, "", [])
    except OSError as error:
        raise _no_folder(folder, error) from error


def _runs_within(folder: str | Path, inside: str, waiting: list[str]) -> list[_FoundFile]:
    """The run files of one folder; the folders in it that may hold runs are added to those that wait."""
    found = []
    with os.scandir(Path(folder, inside)) as entries:
        for entry in entries:
            name = f"{inside}/{entry.name}" if inside else entry.name
            if entry.name.endswith(RUN_SUFFIXES):
                fingerprint = fingerprint_of(entry)
                if fingerprint != GONE:
                    found.append((name, fingerprint))
            elif entry.name.startswith(".") or entry.name.endswith(ANALYSES_SUFFIX):
                continue
            elif entry.is_dir(follow_symlinks=False):
                waiting.append(name)
    return found


def fingerprint_of(file: os.DirEntry[str] | Path) -> str:
    """What changes when a file does: size, time of change, file number; `GONE` for what is no file, or not any more."""
    try:
        status = file.stat()
    except OSError:
        return GONE
    if not stat.S_ISREG(status.st_mode):
        return GONE
    return f"{status.st_size}:{status.st_mtime_ns}:{status.st_ino}"


def _no_folder(folder: str | Path, error: OSError) -> RunFileError:
    return RunFileError(
        f"is no folder of runs: {error.strerror or error}",
        where=str(folder),
        remedy="Name the folder with --runs.",
    )


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

    def is_meant(file: str) -> bool:
        return name == file.removesuffix(".h5") or bool(number and number == run_number(file))

    found: list[Path] = []
    if folder.is_dir():
        found = [run for run in run_files(folder) if is_meant(run.name)]
        # A number is one run's within its own folder: that of the folder itself comes before those within.
        found = found or [
            folder / file for file, _ in run_tree(folder)[0] if is_meant(file.rpartition("/")[2])
        ]
    if len(found) != 1:
        raise RunFileError(
            "names several runs" if found else "names no run",
            where=str(folder),
            value=name,
            limit="a run file, or the number or name of one run in this folder or the folders in it",
            remedy="Look with `rig runs`.",
        )
    return found[0]


def _highest_number(folder: Path) -> int:
    names = [path.name + "-" for path in (folder / NUMBERS_FOLDER).iterdir()]
    names += [path.name for path in folder.iterdir()]
    return max((run_number(name) for name in names), default=0)


def run_number(name: str) -> int:
    """The number that a file or folder of a run bears; 0 for one that bears none."""
    match = _LEADING_NUMBER.match(name)
    return int(match.group(1)) if match else 0


def _in_name(text: str, otherwise: str) -> str:
    # Full-width letters are letters.
    plain = unicodedata.normalize("NFKC", text).strip()
    return _NOT_IN_NAMES.sub("_", plain)[:60].strip("._") or otherwise
