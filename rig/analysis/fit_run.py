"""A run file analysed with all that its folder knows: the gear's card, the tare that belongs to it, what it builds on.

What is chosen by hand is taken as it is; what is left open is found, and the fit says what was found and why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from experiments.errors import AnalysisError
from experiments.evidence.tare import AGE_LIMIT
from model.gear_file import shipped_gear
from rig.analysis.adopt import adopt
from rig.analysis.fit import LEFT_AWAY, Fit, evidence_of, fit_recording, kind_of
from rig.analysis.gear_set import GearSource, SourceWord, card_set, set_sha256
from rig.analysis.in_force import in_force
from rig.analysis.stored_fit import stored_fit
from rig.analysis.tare import takes_tare, tare_kind
from rig.analysis.tare_search import (
    FoundTare,
    find_tare,
    nearness,
    tare_days_of,
)
from rig.library.index import IndexedRun, LibraryIndex
from rig.runfile import read

if TYPE_CHECKING:
    from experiments.contract import Evidence
    from experiments.recording import Recording
    from experiments.result import Result
    from model.gear import HarmonicDrive

TARE_AGE_SETTING = "tare_age_limit"
"""The setting of the checks that says from which age [days] on a tare is widened (`experiments.evidence.tare`)."""


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What is chosen by hand for an analysis. What is left open is found: set, tare, what it builds on.

    `gear` is a parameter set, `tare` a motor-tare run, `no_tare` leaves one away that would be found;
    `settings` are the analysis' own, `largest_missed_share` is the share of missed cycles above
    which a run is refused (None: the analyses' own).
    """

    gear: HarmonicDrive | None = None
    tare: Path | None = None
    no_tare: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    largest_missed_share: float | None = None


@dataclass(frozen=True)
class Tared:
    """The tare of a fit with what is to be said of it."""

    fit: Fit | None = None
    found: FoundTare = field(default_factory=FoundTare)
    settings: Mapping[str, Any] = field(default_factory=dict)


def fit_run(path: Path, kind: str = "", choices: Choices | None = None) -> Fit:
    """Analyse one run file. Raises the errors of the analysis, of the file, of the card and of a tare given by hand."""
    choices = choices or Choices()
    recording = read.open_run(path)
    kind = kind_of(recording, kind)
    tared = _tare_for(recording, path, kind, choices)
    gear, source = gear_for(recording, path, kind, choices.gear)
    fit = fit_recording(
        recording,
        kind,
        gear=gear,
        tare=tared.fit,
        settings={
            **tared.settings,
            **_learnt(recording, path, kind, choices.settings),
            **choices.settings,
        },
        path=path,
        largest_missed_share=choices.largest_missed_share,
    )
    return replace(fit, gear_source=source, found_tare=tared.found)


def evidence_for(
    path: Path, kind: str, choices: Choices | None = None
) -> tuple[Recording, Evidence]:
    """A run file with all that an analysis of it would lean on: set, tare and settings as `fit_run` takes them."""
    choices = choices or Choices()
    recording = read.open_run(path)
    tared = _tare_for(recording, path, kind, choices)
    gear, _ = gear_for(recording, path, kind, choices.gear)
    evidence = evidence_of(
        gear or shipped_gear(),
        tared.fit,
        {
            **tared.settings,
            **_learnt(recording, path, kind, choices.settings),
            **choices.settings,
        },
        choices.largest_missed_share,
    )
    return recording, evidence


def gear_for(
    recording: Recording, path: Path, kind: str, by_hand: HarmonicDrive | None = None
) -> tuple[HarmonicDrive | None, GearSource]:
    """The parameter set for an analysis and where it came from: by hand, else by the gear's card, else the run's own.

    What runs of the same gear identified, and this kind builds on, is written into it, unless it is
    given by hand. None: the run carries none, and the analysis takes the shipped one.
    """
    metadata = recording.metadata
    by_card = card_set(path.parent, metadata.gear_serial, lambda: metadata.gear)
    sets: tuple[tuple[SourceWord, HarmonicDrive | None], ...] = (
        ("by hand", by_hand),
        ("card", by_card),
        ("run", metadata.gear),
    )
    for source, gear in sets:
        if gear is not None:
            told = GearSource(source, metadata.gear_serial, set_sha256(gear))
            # A set given by hand is taken as it is: whoever gives one wants to see what it says.
            if source == "by hand":
                return gear, told
            return _built_on(recording, path, kind, gear, told)
    return None, GearSource("shipped", metadata.gear_serial)


def _built_on(
    recording: Recording, path: Path, kind: str, gear: HarmonicDrive, source: GearSource
) -> tuple[HarmonicDrive, GearSource]:
    basis = _basis_of(recording, path, kind)
    if basis is None:
        return gear, source
    result, builds_on = basis
    return adopt(gear, [result]).gear, replace(source, builds_on=builds_on)


def _basis_of(recording: Recording, path: Path, kind: str) -> tuple[Result, dict[str, Any]] | None:
    """The result that an analysis builds on, and what it is called: of the nearest such run of the same gear.

    Runs before this one come first, as with tares. An analysis that is stale builds nothing.
    """
    experiment = catalogue.declared(kind)
    if experiment is None or not experiment.builds_on or not recording.metadata.gear_serial:
        return None
    for run in _runs_before(recording, path.parent, experiment.builds_on):
        found = in_force(run.path, run.protocol)
        if found.analysis is None or found.stale:
            continue
        named = {"run": run.run_id, "file": run.path.name}
        named |= {"kind": run.protocol, "number": found.number}
        return found.analysis.whole_result(), named
    return None


def _learnt(
    recording: Recording, path: Path, kind: str, by_hand: Mapping[str, Any]
) -> Mapping[str, Any]:
    """Settings that the gear's other runs of this kind give, by their analyses in force; none where one is by hand."""
    experiment = catalogue.declared(kind)
    if experiment is None or experiment.learns is None or not recording.metadata.gear_serial:
        return {}
    results: list[Result] = []
    for run in _runs_before(recording, path.parent, (kind,)):
        if run.run_id == recording.metadata.run_id:
            continue
        found = in_force(run.path, kind)
        if found.analysis is not None and not found.stale:
            results.append(found.analysis.whole_result())
    learnt = experiment.learns(results)
    return {} if any(name in by_hand for name in learnt) else learnt


def _runs_before(recording: Recording, folder: Path, protocols: Sequence[str]) -> list[IndexedRun]:
    """The runs of the same gear, mounted as it is, by these protocols: the nearest in time first."""
    metadata = recording.metadata
    runs = [
        run
        for run in LibraryIndex(folder).search(gear=metadata.gear_serial, origin=metadata.origin)
        if run.protocol in protocols and run.is_complete and run.mounting == metadata.mounting
    ]
    return sorted(runs, key=lambda run: nearness(run.start, metadata.start_time))


def _tare_for(recording: Recording, path: Path, kind: str, choices: Choices) -> Tared:
    """The tare of a run: by hand, else the one that is found, analysed as it lies in its store or anew."""
    if choices.tare is not None:
        return Tared(_tare_fit(choices.tare, choices), FoundTare(choices.tare, by_hand=True))
    if not takes_tare(kind):
        return Tared()
    if choices.no_tare:
        return Tared(found=FoundTare(None, (LEFT_AWAY,)))
    days = tare_days_of(path.parent)
    found = find_tare(recording, LibraryIndex(path.parent), tare_days=days)
    if found.path is None:
        return Tared(found=found)
    try:
        fit = _tare_fit(found.path, choices)
    except AnalysisError as error:
        return Tared(found=FoundTare(None, (f"{found.path.stem} gives no tare: {error}",)))
    # A tare that is young enough to be found is not too old to be believed.
    return Tared(fit, found, {} if days <= AGE_LIMIT else {TARE_AGE_SETTING: days})


def _tare_fit(path: Path, choices: Choices) -> Fit:
    """The analysis of a tare: the one in force, and where there is none that may be used, one made now."""
    recording = read.open_run(path)
    stored = in_force(path, tare_kind()) if choices.largest_missed_share is None else None
    usable = stored is not None and stored.analysis is not None and not stored.stale
    if not usable or recording.metadata.experiment != tare_kind():
        share = choices.largest_missed_share
        return fit_recording(
            recording, tare_kind(), gear=choices.gear, path=path, largest_missed_share=share
        )
    assert stored is not None
    assert stored.analysis is not None
    return stored_fit(path, stored.analysis, recording)


def fit_files(
    paths: Sequence[str | Path],
    kind: str = "",
    *,
    gear: HarmonicDrive | None = None,
    tare: str | Path | None = None,
    settings: Mapping[str, Any] | None = None,
    largest_missed_share: float | None = None,
) -> tuple[Fit, ...]:
    """Analyse several run files with the same choices by hand."""
    choices = Choices(
        gear=gear,
        tare=None if tare is None else Path(tare),
        settings=settings or {},
        largest_missed_share=largest_missed_share,
    )
    return tuple(fit_run(Path(path), kind, choices) for path in paths)
