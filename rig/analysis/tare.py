"""Tares: which protocol gives one, which analyses take one, and which one belongs to a run.

It is found by itself in the folder of runs, and what speaks against every other one is said: the same motor,
torque-channel calibration and bench; at most `tare_days` days between the two; the housing no more than 5 K apart (the
room, where one of the two has no temperature of the housing); the bench not tripped in between. Of those that fit the
newest before the run, and where there is none the first after it. What is the same, old and warm is said where every
analysis checks its tare (`experiments.evidence.tare`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from experiments.tares import same_rig
from model.errors import WordedError
from rig.analysis.learnt import with_learnt_scale
from rig.analysis.number_or_none import finite
from rig.errors import ChangedRunError, RigError

if TYPE_CHECKING:
    from experiments.recording import Recording
    from experiments.result import Result
    from rig.library.index import IndexedRun, LibraryIndex


def tare_kind() -> str:
    """The protocol whose result is subtracted as a tare: the first of the catalogue that gives one."""
    return next(one.name for one in catalogue.every() if one.gives_tare)


def takes_tare(kind: str) -> bool:
    """Whether an analysis of this kind subtracts a tare where it is given one; False for a kind that is none."""
    experiment = catalogue.declared(kind)
    return experiment is not None and experiment.takes_tare


def check_tare(recording: Recording, tare: Recording, result: Result) -> None:
    """Raise `RigError` unless the result of `tare` is one of the same kind of rig as the recording."""
    here, there = recording.metadata, tare.metadata
    if not catalogue.load(result.kind).gives_tare:
        protocol = tare_kind()
        raise RigError(
            f"only a {protocol} run (gear removed) can be subtracted as a tare",
            where=there.run_id,
            value=result.kind,
            limit=protocol,
            remedy=f"Run `rig run {protocol}` on this rig and give that run.",
        )
    if there.gear_mounted:
        raise RigError(
            "the tare was taken with a gear mounted, so that it holds the gear's own friction",
            where=there.run_id,
            remedy=f"Remove the gear and run {tare_kind()} again.",
        )
    if here.origin != there.origin:
        raise RigError(
            "tare and run do not come from the same kind of rig",
            where=there.run_id,
            value=there.origin,
            limit=here.origin,
            remedy="Take the tare on the rig on which the run was made.",
        )


@dataclass(frozen=True)
class FoundTare:
    """The tare that belongs to a run: its file, None where there is none; why, or why none, in words."""

    path: Path | None = None
    because: tuple[str, ...] = ()
    age_days: float = math.nan
    """Days between the two runs."""
    by_hand: bool = False

    def as_json(self) -> dict[str, Any]:
        """As `--json` tells it."""
        return {
            "file": self.path and str(self.path),
            "age_days": finite(self.age_days),
            "because": list(self.because),
        }


@dataclass(frozen=True)
class _Candidate:
    """A tare that may be the one: its line in the index, and how long before the run it was made [days]."""

    run: IndexedRun
    days_before: float


def find_tare(
    run: Recording, library: LibraryIndex, *, tare_days: float = same_rig.AGE_LIMIT
) -> FoundTare:
    """The tare that belongs to a run, among the runs of a folder.

    Where there is none, `because` says of every candidate what it failed by, the nearest in time first.
    Raises `ChangedRunError` for a candidate that is not as it was sealed: it may be the one.
    """
    listed = library.search()
    candidates = _candidates(run, listed)
    if not candidates:
        kind = run.metadata.origin
        return FoundTare(None, (f"there is no {kind} {tare_kind()} run in {library.folder}",))
    trips = _trips(run, listed)
    reasons = []
    start = run.metadata.start_time
    for candidate in sorted(candidates, key=lambda one: nearness(one.run.start, start)):
        reason, warmth = _speaks_against(run, candidate, trips, tare_days)
        if not reason:
            age = abs(candidate.days_before)
            same = f"same motor, bench and calibration, {warmth}"
            words = f"{candidate.run.run_id}: {_age_in_words(candidate)}, {same}"
            return FoundTare(candidate.run.path, (words,), age)
        reasons.append(f"{candidate.run.run_id}: {reason}")
    return FoundTare(None, tuple(reasons))


def tares_beside(run: Recording, library: LibraryIndex, tare: Path) -> Iterator[Path]:
    """The other tares of the rig of a run, the nearest to it in time first; `tare` is the one that they stand beside.

    Neither age nor temperature keeps one out: both are reckoned with where they are compared.
    """
    candidates = _candidates(run, library.search())
    start = run.metadata.start_time
    for candidate in sorted(candidates, key=lambda one: abs(nearness(one.run.start, start)[1])):
        if candidate.run.path.resolve() == tare.resolve() or not candidate.run.is_complete:
            continue
        if not _is_of_another_rig(run, candidate.run.path):
            yield candidate.run.path


def tares_wanted(kind: str, folder: Path) -> str:
    """What a plan of this kind is told where the folder of its runs holds too few tares to tell how well one comes out
    again; "" where there are enough, or where none is subtracted.
    """
    if not takes_tare(kind):
        return ""
    from experiments.tares.tare_witness import ENOUGH
    from rig.library.index import LibraryIndex

    tare = tare_kind()
    # A folder that is yet to be made has none.
    listed = LibraryIndex(folder).search() if folder.is_dir() else ()
    have = sum(one.protocol == tare and one.is_complete for one in listed)
    if have >= ENOUGH:
        return ""
    count = "no motor tare" if have == 0 else "one motor tare only"
    return (
        f"{folder} has {count}: with fewer than two of the bench nothing tells how well a tare comes out "
        f"again, and that is assumed. Take one before and one after: rig run {tare}."
    )


def _is_of_another_rig(run: Recording, path: Path) -> bool:
    """Whether motor, bench or torque channel of a tare are others than those of a run, or its file says nothing."""
    from rig.runfile.read import close_recording, open_run

    try:
        tare = with_learnt_scale(open_run(path, rows=False), path.parent)
    except ChangedRunError:
        raise
    except WordedError:
        return True
    try:
        return tare.metadata.gear_mounted or bool(same_rig.other_rig(run, tare))
    finally:
        close_recording(tare)


def tare_days_of(folder: Path) -> float:
    """The setting `tare_days` of the rig whose runs lie in this folder; 7 where no description of one is at hand.

    The description (`rig.toml`) is looked for in the present folder and beside the folder of runs, and
    counts where it names that folder. Raises `ConfigurationError` for one that cannot be accepted.
    """
    from rig.bench.config.load import load_configuration
    from rig.bench.config.place import DEFAULT_PATH

    for path in dict.fromkeys((DEFAULT_PATH.resolve(), (folder.parent / DEFAULT_PATH).resolve())):
        if path.is_file():
            rig = load_configuration(path).rig
            if (path.parent / rig.output).resolve() == folder.resolve():
                return rig.tare_days
    return same_rig.AGE_LIMIT


def _candidates(run: Recording, listed: Iterable[IndexedRun]) -> list[_Candidate]:
    kind = tare_kind()
    return [
        _Candidate(one, _days_before(one.start, run.metadata.start_time))
        for one in listed
        if one.protocol == kind
        and one.state == "sealed"
        and one.origin == run.metadata.origin
        and one.run_id != run.metadata.run_id
    ]


def nearness(other: str, start: str) -> tuple[bool, float]:
    """The order in which runs are looked at for one that began at `start`: those before it come first, and of
    each the nearest in time.
    """
    days = _days_before(other, start)
    return (not days >= 0.0, abs(days) if math.isfinite(days) else math.inf)


def _trips(run: Recording, listed: Iterable[IndexedRun]) -> list[IndexedRun]:
    """The runs of this bench that the supervisor stopped."""
    bench = str(run.metadata.process.get("bench", ""))
    return [one for one in listed if one.outcome == "TRIPPED" and one.bench == bench]


def _speaks_against(
    run: Recording, candidate: _Candidate, trips: Sequence[IndexedRun], tare_days: float
) -> tuple[str, str]:
    """Why a candidate is not the tare of this run, "" where it is, and how far apart in temperature the two are.

    What the index knows is asked first.
    """
    one = candidate.run
    between = [t for t in trips if _is_between(t.start, one.start, run.metadata.start_time)]
    reason = ""
    if not one.is_complete:
        reason = f"ended {one.outcome}"
    elif not math.isfinite(candidate.days_before):
        reason = "it does not say when it was made"
    elif abs(candidate.days_before) > tare_days:
        reason = f"{_age_in_words(candidate)}, limit {tare_days:g}"
    elif between:
        reason = f"{between[-1].run_id} tripped between it and this run"
    return (reason, "") if reason else _rests_on_another_rig(run, one.path)


def _rests_on_another_rig(run: Recording, path: Path) -> tuple[str, str]:
    """Motor, bench, torque channel and temperature, which only the file itself tells."""
    from rig.runfile.read import close_recording, open_run

    try:
        tare = with_learnt_scale(open_run(path, rows=False), path.parent)
    except ChangedRunError:
        raise
    except WordedError as error:
        return f"cannot be read: {error}", ""
    try:
        if tare.metadata.gear_mounted:
            return "was taken with a gear mounted", ""
        place, apart = same_rig.kelvin_apart(run, tare)
        warmth = f"{place} {apart:.1f} K apart" if place else "temperature not recorded"
        return same_rig.refusal_of(run, tare), warmth
    finally:
        close_recording(tare)


def _age_in_words(candidate: _Candidate) -> str:
    days = candidate.days_before
    return f"{days:.1f} days old" if days >= 0.0 else f"made {-days:.1f} days after this run"


def _days_before(tare: str, run: str) -> float:
    try:
        apart = datetime.fromisoformat(run) - datetime.fromisoformat(tare)
    except (ValueError, TypeError):
        return math.nan
    return apart.total_seconds() / 86400.0


def _is_between(moment: str, one: str, other: str) -> bool:
    before, after = _days_before(one, moment), _days_before(moment, other)
    return before * after > 0.0
