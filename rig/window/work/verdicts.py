"""The verdicts of the listed runs, worked out beside the window: those in view first, then the others, a few at a time.

What a run is worth follows from its analysis in force and the acceptance file as it is now: it is
read anew whenever the library is, and kept nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from experiments.result import Result
from rig.analysis.judging import GearVerdict, JudgedRun, judge_listed
from rig.library.index import IndexedRun, LibraryIndex
from rig.window.work.background import LatestTask

BATCH = 10
"""Runs that are judged before the next ones in view are asked for: a tenth of a second."""
SIGNS = {"PASS": "✔", "MARGINAL": "≈", "FAIL": "✘", "NOT JUDGED": "○"}
"""The sign before a verdict: a colour never carries a meaning alone."""
COLOURS = {"PASS": "good", "MARGINAL": "warning", "FAIL": "bad", "NOT JUDGED": "muted"}
"""Colours of the palette by verdict; a neutral one where nothing was judged."""


@dataclass(frozen=True)
class ListedVerdict:
    """What a run is worth, and what has changed since the analysis was made that says so."""

    judged: GearVerdict
    stale: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The verdict in a word or two."""
        word = self.judged.verdict
        return f"{SIGNS[word]} {word}" + (", stale" if self.stale else "")

    @property
    def reasons(self) -> str:
        """Why it is not a better one, and what is stale, line by line."""
        words = [f"{self.judged.verdict}: {why}" for why in self.judged.because]
        words += [f"next: {step}" for step in self.judged.next_steps]
        words += [f"stale: {what}" for what in self.stale]
        return "\n".join(words)


def verdict_text(listed: ListedVerdict | None) -> str:
    """A verdict in a word or two; nothing where there is none."""
    return listed.text if listed is not None else ""


def verdict_reasons(listed: ListedVerdict | None) -> str:
    """The reasons of a verdict, line by line; nothing where there is none."""
    return listed.reasons if listed is not None else ""


def listed_verdict(run: IndexedRun) -> ListedVerdict | None:
    """The verdict on what a run measured; None for one that is not sealed."""
    return _listed(judge_listed([run]).get(run.path))


def _listed(judged: JudgedRun | None) -> ListedVerdict | None:
    return judged and ListedVerdict(judged.verdict, judged.found.stale)


@dataclass(frozen=True)
class ReadRun:
    """What a run file says by the analysis in force: its verdict, and the result where there is one."""

    verdict: ListedVerdict | None
    result: Result | None = None


def read_run(path: Path) -> ReadRun:
    """What a run says, as everybody reads it; nothing is fitted. Raises `RigError` for a store that cannot be read."""
    run = next((run for run in LibraryIndex(path.parent).search() if run.path == path), None)
    if run is None:
        return ReadRun(None)
    judged = judge_listed([run]).get(path)
    analysis = judged.found.analysis if judged and judged.found.of_this_run else None
    return ReadRun(_listed(judged), analysis and analysis.whole_result())


class VerdictDesk(QObject):
    """Works out verdicts. `judged` carries some of them, by the path of their run."""

    judged = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._waiting: list[IndexedRun] = []
        self._task = LatestTask(self, self._take)

    @property
    def is_running(self) -> bool:
        """Whether verdicts are awaited."""
        return bool(self._waiting) or self._task.is_running

    def look(self, runs: Sequence[IndexedRun]) -> None:
        """Work these out, in this order; what was asked for before is forgotten."""
        self._waiting = [run for run in runs if run.state == "sealed"]
        self._task.forget()
        self._next()

    def stop(self) -> None:
        """Work no more out."""
        self._waiting = []
        self._task.forget()

    def _next(self) -> None:
        batch, self._waiting = self._waiting[:BATCH], self._waiting[BATCH:]
        if batch:
            self._task.start(lambda: {run.path: listed_verdict(run) for run in batch})

    def _take(self, found: dict[Path, ListedVerdict | None]) -> None:
        self.judged.emit(found)
        self._next()
