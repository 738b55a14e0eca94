"""What is made of a simulated day so far: a line for every run that is over, in the folder where the day is made.

    .day.jsonl      {"order": "<hash of what was ordered>"}
                    {"name": "G-00001 home", "file": "00001-home-G_00001.h5", "seconds": 74.2, "reason": ""}

A run counts once its line is there: then its file is sealed, and the bench is ready for the next one. A program that
is ended, by Ctrl-C or by force, leaves at most one run without a line, and the day goes on behind the last line.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from rig.library.folder import NUMBERS_FOLDER, run_number
from rig.run.latch import LATCH_NAME
from rig.run.marker import PREFIX

JOURNAL_NAME = ".day.jsonl"


@dataclass(frozen=True, kw_only=True)
class DayRun:
    """One run of a day that is over: its file, "" of one that could not begin; the bench's time that it took [s].

    `reason` says why it did not come to its end; empty for one that did.
    """

    name: str
    file: str = ""
    seconds: float = 0.0
    reason: str = ""


class DayJournal:
    """The journal of the day that is made in a folder, by an order of which `order` is the hash."""

    def __init__(self, folder: Path, order: str) -> None:
        self._folder, self._order = folder, order
        self._path = folder / JOURNAL_NAME

    def resume(self) -> tuple[DayRun, ...]:
        """The runs that are over, in their order; whatever else is left of the day, or is of another order, is removed.

        The folder is there afterwards.
        """
        runs = tuple(_lines(self._path, self._order))
        if runs:
            _remove_others(self._folder, runs)
        else:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder.mkdir(parents=True)
        # A line that was cut off goes: the next one needs a line of its own.
        scratch = self._path.with_suffix(".tmp")
        lines = [{"order": self._order}, *map(asdict, runs)]
        scratch.write_text("".join(map(_line, lines)), encoding="utf-8")
        scratch.replace(self._path)
        return runs

    def add(self, run: DayRun) -> None:
        """A run is over."""
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(_line(asdict(run)))


def runs_made(folder: Path) -> tuple[DayRun, ...]:
    """The runs of a day by its journal, whatever was ordered."""
    return tuple(_lines(folder / JOURNAL_NAME, None))


def _line(content: dict[str, object]) -> str:
    return json.dumps(content) + "\n"


def _lines(path: Path, order: str | None) -> Iterator[DayRun]:
    """The runs of a journal up to its first line that is not whole, or whose file is gone; none of another order."""
    try:
        first, *others = path.read_text(encoding="utf-8").splitlines()
        if order is not None and json.loads(first) != {"order": order}:
            return
        for line in others:
            run = DayRun(**json.loads(line))
            if run.file and not (path.parent / run.file).is_file():
                return
            yield run
    except (OSError, ValueError, TypeError):
        return


def _remove_others(folder: Path, runs: tuple[DayRun, ...]) -> None:
    """Files, numbers, marker and latch of runs that are not over: of a run that was cut off."""
    kept = {run_number(run.file) for run in runs if run.file}
    for path in folder.iterdir():
        number = run_number(path.name)
        is_latch = path.name == LATCH_NAME or path.name.startswith(PREFIX)
        if is_latch or (number and number not in kept):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    for claim in (folder / NUMBERS_FOLDER).glob("*"):
        if int(claim.name) not in kept:
            claim.unlink()
