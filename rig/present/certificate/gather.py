"""What a certificate rests on: the newest analysed run of every kind, the verdict on them, and what is missing.

Nothing is fitted and nothing judged here: analyses are those in force (`rig.analysis.in_force`), the
verdict is what `rig.analysis.judging` says.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from model.errors import WordedError
from rig.analysis.fit.recorded import Fit, fit_in_force
from rig.analysis.in_force import InForce, newest_analysed
from rig.analysis.judging import GearVerdict, judge
from rig.analysis.passport.gather import counted_origin, runs_of
from rig.analysis.recompute import recompute
from rig.analysis.store import unsealed_words
from rig.content.phrase import quoted
from rig.errors import RigError
from rig.gears.acceptance import Acceptance, acceptance_for
from rig.library.index import IndexedRun
from rig.runfile.read import close_recording

_CHARTED_FROM = 3
"""Runs of a kind from which on a chart over the runs tells anything."""


@dataclass(frozen=True, kw_only=True)
class Certified:
    """A gear with what was found of it, as its certificate tells it.

    `fits` are the newest analysed run of every kind with its analysis in force, in the order of the
    catalogue, `analyses` the same as the store has them. `missing` are protocols that were asked for
    and have no such run; `passed_over` says of which newer runs nothing stands in the certificate.
    """

    serial: str
    folder: Path
    runs: tuple[IndexedRun, ...]
    fits: tuple[Fit, ...]
    analyses: tuple[InForce, ...]
    acceptance: Acceptance | None
    verdict: GearVerdict
    missing: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()
    unsealed: tuple[str, ...] = ()
    """Of each analysis that was never sealed, or lost its seal: that, and what came of making it again."""

    @property
    def is_complete(self) -> bool:
        """Whether every protocol that was asked for has an analysed run."""
        return not self.missing

    @property
    def has_charts(self) -> bool:
        """Whether any kind has as many runs as make a chart over them."""
        counts = [sum(run.protocol == fit.result.kind for run in self.runs) for fit in self.fits]
        return max(counts, default=0) >= _CHARTED_FROM

    def fit_of(self, kind: str) -> Fit | None:
        """The newest analysed run of a kind."""
        return next((fit for fit in self.fits if fit.result.kind == kind), None)


@contextmanager
def certified(
    folder: Path,
    serial: str,
    *,
    acceptance: Acceptance | None = None,
    protocols: Sequence[str] = (),
) -> Iterator[Certified]:
    """Gather what the certificate of a gear rests on; its run files are closed when it is left.

    `acceptance` is what the gear must show, that of its card without one; `protocols` are those that
    were asked for besides what the acceptance lists (the plan of a campaign). Raises `RigError` where
    the folder has no analysed run of this gear.
    """
    runs = runs_of(folder, serial)
    counted = _counted(runs)
    newest = newest_analysed(counted)
    fits: list[Fit] = []
    try:
        for run, analysis in newest.runs:
            fits.append(fit_in_force(run.path, analysis))
        if not fits:
            raise _nothing(folder, serial, runs)
        acceptance = acceptance or acceptance_for(folder, serial)
        yield Certified(
            serial=serial,
            folder=folder,
            runs=tuple(counted),
            fits=tuple(fits),
            analyses=tuple(analysis for _, analysis in newest.runs),
            acceptance=acceptance,
            verdict=judge(fits, acceptance),
            missing=_missing(acceptance, protocols, fits),
            passed_over=newest.passed_over,
            unsealed=tuple(_unsealed(newest.runs)),
        )
    finally:
        for fit in fits:
            close_recording(fit.recording)


def _unsealed(runs: Sequence[tuple[IndexedRun, InForce]]) -> Iterator[str]:
    """Analyses that nothing vouches for are made again: a number that cannot be made again must not look like one that
    can.
    """
    for run, found in runs:
        if found.analysis is None or found.analysis.seal.is_whole:
            continue
        try:
            words = recompute(run.path, found.analysis).words
        except WordedError as error:
            words = f"not made again: {error}"
        yield f"{unsealed_words(found.analysis)} It was {words}"


def _counted(runs: Sequence[IndexedRun]) -> list[IndexedRun]:
    """Sealed runs of one origin (hardware where there is any), the unfinished among them too, in order of time."""
    origin = counted_origin(runs)
    return [run for run in runs if run.state == "sealed" and origin in ("", run.origin)]


def _missing(
    acceptance: Acceptance | None, protocols: Sequence[str], fits: Sequence[Fit]
) -> tuple[str, ...]:
    listed = [limit.kind for limit in acceptance.limits] if acceptance is not None else []
    analysed = {fit.result.kind for fit in fits}
    return tuple(kind for kind in dict.fromkeys((*protocols, *listed)) if kind not in analysed)


def _nothing(folder: Path, serial: str, runs: Sequence[IndexedRun]) -> RigError:
    if not runs:
        return RigError(
            "there is no run of this gear",
            where=str(folder),
            value=repr(serial),
            remedy="Serial numbers are compared letter for letter; `rig runs` lists what is there.",
        )
    return RigError(
        "no run of this gear is analysed",
        where=str(folder),
        value=f"{len(runs)} runs of {serial}",
        remedy=f"Analyse them: rig fit {quoted(runs[-1].path)}",
    )


def acceptance_sha256(acceptance: Acceptance) -> str:
    """The SHA-256 of an acceptance file as it lies there, or of the shipped one of that name."""
    path = Path(acceptance.path)
    if path.suffix.lower() == ".toml":
        return hashlib.sha256(path.read_bytes()).hexdigest()
    shipped = resources.files("rig.gears") / "shipped" / f"{acceptance.path}.toml"
    return hashlib.sha256(shipped.read_bytes()).hexdigest()
