"""Fitting the runs of a gear that have no analysis yet, so that its passport can be drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from model.errors import WordedError
from rig.analysis.fit.run import Choices
from rig.analysis.passport.followed import watched_kinds
from rig.analysis.passport.gather import counted_origin, runs_of
from rig.analysis.store import read_analyses
from rig.analysis.tare import takes_tare
from rig.errors import ChangedRunError
from rig.library.listed import COUNTED_OUTCOMES, IndexedRun


@dataclass(frozen=True)
class Analysed:
    """What became of one run: the name of its analysis in the store, or why there is none."""

    run: IndexedRun
    stored: str = ""
    problem: str = ""


def analyse_runs(
    where: str | Path | Iterable[str | Path],
    serial: str,
    created: str,
    *,
    tare: Path | None = None,
    origin: str = "",
    tell: Callable[[IndexedRun], None] | None = None,
) -> tuple[Analysed, ...]:
    """Fit every run of a gear that a passport follows and that was never fitted, and keep the results beside the runs.

    `created` the calendar time (ISO 8601) of the analyses; `tare` a motor-tare run, subtracted from
    runs that take one, in the place of the one that is found; `origin` as in `passport`; `tell` is
    called before each run. A run that cannot be analysed is told with its reason, and the others are
    analysed all the same.
    """
    runs = runs_of(where, serial)
    only = counted_origin(runs, origin)
    return tuple(
        _analyse(run, created, tare if takes_tare(run.protocol) else None, tell)
        for run in runs
        if _lacks_analysis(run) and only in ("", run.origin)
    )


def _lacks_analysis(run: IndexedRun) -> bool:
    if (
        run.state != "sealed"
        or run.protocol not in watched_kinds()
        or run.outcome not in COUNTED_OUTCOMES
    ):
        return False
    try:
        return all(analysis.kind != run.protocol for analysis in read_analyses(run.path))
    except ChangedRunError:
        raise
    except WordedError:
        return False


def _analyse(
    run: IndexedRun, created: str, tare: Path | None, tell: Callable[[IndexedRun], None] | None
) -> Analysed:
    from rig.analysis.fit.digest import digest
    from rig.runfile.read import close_recording

    if tell is not None:
        tell(run)
    try:
        made = digest(run.path, created, choices=Choices(tare=tare))
    except ChangedRunError:
        raise
    except WordedError as error:
        return Analysed(run, problem=str(error))
    if made.fit is None:
        return Analysed(run, problem="; ".join(made.because))
    close_recording(made.fit.recording)
    if made.fit.tare is not None:
        close_recording(made.fit.tare.recording)
    return Analysed(run, stored=made.fit.stored, problem=made.not_stored)
