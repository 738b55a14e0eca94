"""A fleet fitted: the runs that are meant, what of them is to be done, who does it, and the table that grows of it."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from experiments import catalogue
from rig.analysis.tare import tare_kind
from rig.extras import require
from rig.fleet.dataset import FOLDER_NAME, DataSet, Identity
from rig.fleet.engine import BatchTask, Workforce, at_work
from rig.fleet.neighbours import forget_neighbours
from rig.fleet.progress import Progress
from rig.fleet.survey import survey
from rig.fleet.task import Done, Job, RunTask, fit_runs, lost
from rig.fleet.work import PathMap, Work, first_folder, runs_named, work_for


@dataclass(frozen=True, kw_only=True)
class FleetOrder:
    """What is asked for: the runs by folders, patterns, lists and files; by whom they are fitted; where the table goes.

    `crew` is who works; `mapped` under which other path it sees the runs. `stored`: each analysis is kept beside its
    run too, as `rig fit` does.
    """

    names: Sequence[str | Path]
    kind: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    no_tare: bool = False
    acceptance: str = ""
    crew: Workforce = field(default_factory=Workforce)
    output: Path | None = None
    mapped: PathMap = field(default_factory=PathMap)
    stored: bool = False


@dataclass(frozen=True, kw_only=True)
class FleetReport:
    """What came of a job. `seconds` of work on the workers, of which `fit_seconds` in the analyses themselves."""

    output: Path
    runs: int
    fitted: int
    reused: int
    failed: tuple[tuple[str, str], ...]
    changed: tuple[str, ...]
    """Of those that failed: runs refused because a file is not as it was sealed."""
    seconds: float
    fit_seconds: float

    def as_json(self) -> dict[str, Any]:
        """The object that `rig fleet fit --json` prints."""
        return {
            "runs": self.runs,
            "fitted": self.fitted,
            "reused": self.reused,
            "failed": [{"run": run, "reason": reason} for run, reason in self.failed],
            "changed": list(self.changed),
            "output": str(self.output),
        }


class _Tally:
    """What is done so far."""

    def __init__(self, work: Work, now: Callable[[], float]) -> None:
        self._work, self._now, self._began = work, now, now()
        self.fitted = 0
        self.reused = len(work.reused)
        self.failed = list(work.failed)
        self.changed: list[str] = []
        self.restamped: dict[Identity, str] = {}
        self.seconds = self.fit_seconds = 0.0

    def count(self, batch: Sequence[RunTask], done: Done) -> None:
        self.fitted += len(done.fitted)
        self.reused += len(done.reused)
        self.failed += done.failed
        self.changed += done.changed
        self.seconds += done.seconds
        self.fit_seconds += done.fit_seconds
        still = set(done.reused)
        self.restamped |= {
            (task.run_file, task.kind): task.surroundings
            for task in batch
            if task.run_file in still
        }

    @property
    def progress(self) -> Progress:
        return Progress(
            runs=self._work.runs,
            done=self.fitted + self.reused + len(self.failed),
            reused=len(self._work.reused) + len(self._work.failed),
            failed=len(self.failed),
            seconds=self._now() - self._began,
        )


def fit_fleet(
    order: FleetOrder,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    now: Callable[[], float] = time.monotonic,
) -> FleetReport:
    """Fit what is not fitted yet, and keep every result as soon as it is there.

    Whatever ends it early, Ctrl-C included, leaves all that was done, and the same order goes on from there. Raises
    `ConfigurationError` for an order that names nothing, `RigError` where the results cannot be written, where no
    scheduler answers or where a package is not installed.
    """
    require("a fleet of runs", "fleet", *order.crew.packages)
    if order.kind:
        catalogue.entry(order.kind)
    runs = runs_named(order.names)
    output = order.output or first_folder(order.names) / FOLDER_NAME
    job = Job(
        name=uuid.uuid4().hex,
        created=datetime.now().astimezone().isoformat(timespec="seconds"),
        kind=order.kind,
        settings=order.settings,
        no_tare=order.no_tare,
        acceptance=order.acceptance,
        stored=order.stored,
    )
    with DataSet(output).writing() as data, at_work(order.crew) as hands:
        survey(hands, sorted({run.parent for run in runs}), order.mapped.path, on_progress)
        work = work_for(runs, job, data.known(), base=output.parent, there=order.mapped)
        tally = _Tally(work, now)
        on_progress(tally.progress)
        errand = BatchTask(partial(fit_runs, job), lost)
        with _merging(data, tally):
            for tasks in _waves(work.tasks, job):
                for batch, done in hands.outcomes(errand, tasks):
                    if done.rows:
                        data.append(done.rows)
                    tally.count(batch, done)
                    on_progress(tally.progress)
    return FleetReport(
        output=output,
        runs=work.runs,
        fitted=tally.fitted,
        reused=tally.reused,
        failed=tuple(sorted(tally.failed)),
        changed=tuple(sorted(tally.changed)),
        seconds=tally.seconds,
        fit_seconds=tally.fit_seconds,
    )


def _waves(tasks: Sequence[RunTask], job: Job) -> list[Sequence[RunTask]]:
    """Tasks in waves: where analyses are kept beside their runs, those of a later wave may rest on an earlier one's."""
    if not job.stored:
        return [tasks]
    waves: list[list[RunTask]] = [[], [], []]
    for task in tasks:
        experiment = catalogue.declared(task.kind)
        builds = experiment is not None and bool(experiment.builds_on)
        # Tares first, what builds on others last.
        first = int(task.kind != tare_kind())
        waves[2 if builds else first].append(task)
    return list(waves)


@contextmanager
def _merging(data: DataSet, tally: _Tally) -> Iterator[None]:
    """Put the files together at the end, however it comes."""
    try:
        yield
    finally:
        forget_neighbours()
        data.put_together(tally.restamped)
