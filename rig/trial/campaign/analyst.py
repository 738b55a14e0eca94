"""Who analyses the runs of a campaign: in line, or beside it in a process of its own.

In line is the rule of hardware: nothing is fitted on a computer that leads a rig at the same time.
On a simulated rig the next protocol runs while the last one is fitted.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from experiments.errors import AnalysisError
from model.errors import WordedError
from rig.exits import defect_in_words


@dataclass(frozen=True, kw_only=True)
class Analysed:
    """What came of the analysis of one run.

    `refused` says why the recording carries no result; `crashed` is what went wrong with the file or
    the program; `without_tare` why a tare that the analysis takes was not found.
    """

    run: Path
    refused: str = ""
    crashed: str = ""
    without_tare: tuple[str, ...] = ()
    took: float = 0.0
    """How long the analysis took [s], 0 where nobody knows."""


@dataclass(frozen=True, kw_only=True)
class Analysing:
    """What is being analysed, how many runs wait behind it, and how long all of them take [s]; NaN where no run was
    analysed before by which that could be told.
    """

    run: Path
    waiting: int
    left: float


class Analyst:
    """Analyses runs in the order in which they come; each analysis bears the time `now` at which its run was taken.

    `told` hears of every analysis that is waited for.
    """

    def __init__(
        self,
        now: Callable[[], str],
        pool: ProcessPoolExecutor | None,
        told: Callable[[Analysing], None] = lambda one: None,
    ) -> None:
        self._now, self._told = now, told
        self._pool = pool
        self._waiting: list[tuple[Path, Future[Analysed]]] = []
        self._done: list[Analysed] = []
        self._bytes, self._seconds = 0, 0.0

    def take(self, run: Path) -> None:
        """Analyse a run: now, or as soon as the process beside is free."""
        if self._pool is None:
            self._tell((run,))
            self._keep(analyse(run, self._now()))
        else:
            self._waiting.append((run, self._pool.submit(analyse, run, self._now())))

    def all(self) -> tuple[Analysed, ...]:
        """What came of every run that was taken since the last call, once it is there."""
        while self._waiting:
            run, future = self._waiting[0]
            if not future.done():
                self._tell([path for path, _ in self._waiting])
            self._waiting.pop(0)
            self._keep(_awaited(run, future))
        done, self._done = self._done, []
        return tuple(done)

    def _keep(self, one: Analysed) -> None:
        self._done.append(one)
        if one.took > 0.0:
            self._bytes, self._seconds = self._bytes + _size(one.run), self._seconds + one.took

    def _tell(self, runs: Sequence[Path]) -> None:
        """Which run is being analysed, and how long these take if they take as long per byte as those before."""
        pace = self._seconds / self._bytes if self._bytes else math.nan
        left = pace * sum(map(_size, runs))
        self._told(Analysing(run=runs[0], waiting=len(runs) - 1, left=left))


def _size(run: Path) -> int:
    """Bytes of a run, 0 of one that is gone."""
    try:
        return run.stat().st_size
    except OSError:
        return 0


def _awaited(run: Path, future: Future[Analysed]) -> Analysed:
    """What came of one run in the process beside; a process that died costs the analysis, not the run."""
    try:
        return future.result()
    except BrokenExecutor as error:
        return Analysed(run=run, crashed=f"the process that analyses ended: {error}")


@contextlib.contextmanager
def analyst(
    now: Callable[[], str],
    *,
    beside: bool,
    told: Callable[[Analysing], None] = lambda one: None,
) -> Iterator[Analyst]:
    """An analyst, whose process (where it has one) ends with it."""
    if not beside:
        yield Analyst(now, None, told)
        return
    context = multiprocessing.get_context("spawn")
    with (
        _one_thread_each(),
        ProcessPoolExecutor(1, mp_context=context, initializer=_leave_signals_alone) as pool,
    ):
        # While the first run compiles what leads a rig, this one compiles what fits.
        pool.submit(_compile_ahead)
        yield Analyst(now, pool, told)


def analyse(run: Path, created: str) -> Analysed:
    """Analyse one run with what its folder knows, and keep what was found beside it."""
    from rig.analysis.fit.recorded import store
    from rig.analysis.fit.run import fit_run

    began = time.monotonic()
    try:
        fit = fit_run(run)
        store(fit, created)
    except AnalysisError as error:
        return Analysed(run=run, refused=str(error))
    except (WordedError, OSError) as error:
        return Analysed(run=run, crashed=str(error))
    except Exception as error:  # noqa: BLE001  whatever it was, the run stays and the campaign must hear of it
        return Analysed(run=run, crashed=defect_in_words(error))
    lacks = fit.found_tare is not None and fit.found_tare.path is None
    return Analysed(
        run=run,
        without_tare=fit.found_tare.because if fit.found_tare and lacks else (),
        took=time.monotonic() - began,
    )


def _compile_ahead() -> None:
    """Compile the kernels of the analyses."""
    import numpy as np

    from model.identify.angle_regression import AngleRegression

    angle = np.linspace(0.0, 60.0, 6000)
    AngleRegression(120.0).add(angle, np.cos(2.0 * angle))


def _leave_signals_alone() -> None:
    """The process that leads the rig decides what Ctrl-C or a closed terminal means."""
    for name in ("SIGINT", "SIGQUIT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started in here do their linear algebra in one thread: with more they would wait for each other."""
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update({name: "1" for name in names if before[name] is None})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
