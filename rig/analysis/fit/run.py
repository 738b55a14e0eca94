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
from experiments.tares.same_rig import AGE_LIMIT
from model.gear_file import shipped_gear
from rig.analysis.adopt import adopt
from rig.analysis.fit.recorded import (
    TARE_DECLINED,
    Fit,
    OtherTare,
    evidence_of,
    fit_recording,
    kind_of,
    other_tare,
    stored_fit,
)
from rig.analysis.gear_set import GearSource, SourceWord, card_set, set_sha256
from rig.analysis.in_force import in_force
from rig.analysis.learnt import with_learnt, with_learnt_scale
from rig.analysis.tare import (
    FoundTare,
    find_tare,
    nearness,
    takes_tare,
    tare_days_of,
    tare_kind,
    tares_beside,
)
from rig.library.index import IndexedRun, LibraryIndex
from rig.runfile import read

if TYPE_CHECKING:
    from experiments.contract import Evidence
    from experiments.recording import Recording
    from experiments.result import Result
    from model.gear import HarmonicDrive
    from rig.analysis.store import Analysis

_MOST_OTHERS = 4
"""Other tares of the bench, the nearest in time, that one is held against."""
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


class Surroundings:
    """What lies around a run as an analysis of it looks there: the runs of its folder, and the analysis of a tare.

    This one looks anew every time. Whoever analyses thousands of runs of one folder remembers.
    """

    def library(self, folder: Path) -> LibraryIndex:
        """The runs of a folder."""
        return LibraryIndex(folder)

    def tare_fit(self, path: Path, choices: Choices) -> Fit:
        """The analysis of a tare: the one in force, and where there is none that may be used, one made now."""
        return _tare_fit(path, choices)

    def other_tare(self, path: Path, choices: Choices, run: Path) -> OtherTare:
        """A tare that bears witness of the one of a run."""
        fit = self.tare_fit(path, choices)
        try:
            return other_tare(fit, run)
        finally:
            self.let_go(fit)

    def let_go(self, fit: Fit) -> None:
        """Close the file of a tare that is not read any further."""
        read.close_recording(fit.recording)

    def learns_from(self, analysis: Analysis) -> bool:
        """Whether what another run of the gear says may be learnt from."""
        return True


@dataclass(frozen=True, kw_only=True)
class FitInputs:
    """All that an analysis of one run file rests on, found and not yet analysed."""

    recording: Recording
    path: Path
    kind: str
    gear: HarmonicDrive | None
    source: GearSource
    tared: Tared
    learnt: Mapping[str, Any]
    choices: Choices
    other_tares: tuple[OtherTare, ...] = ()

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the analysis: of its tare, of the gear's other runs, and those that were chosen."""
        return {**self.tared.settings, **self.learnt, **self.choices.settings}

    def evidence(self) -> Evidence:
        """The same as the analysis gets it."""
        share = self.choices.largest_missed_share
        gear, tare = self.gear or shipped_gear(), self.tared.fit
        return evidence_of(gear, tare, self.settings, share, self.other_tares)

    def fit(self) -> Fit:
        """The analysis. Raises its errors."""
        fit = fit_recording(
            self.recording,
            self.kind,
            gear=self.gear,
            tare=self.tared.fit,
            settings=self.settings,
            path=self.path,
            largest_missed_share=self.choices.largest_missed_share,
            other_tares=self.other_tares,
        )
        return replace(fit, gear_source=self.source, found_tare=self.tared.found)


def inputs_of(
    path: Path,
    kind: str = "",
    choices: Choices | None = None,
    surroundings: Surroundings | None = None,
) -> FitInputs:
    """What an analysis of a run file rests on: the kind, the tare that belongs to it, the set of the gear.

    Raises the errors of the file, of the card and of a tare given by hand.
    """
    choices, surroundings = choices or Choices(), surroundings or Surroundings()
    recording = with_learnt(read.open_run(path), path.parent)
    kind = kind_of(recording, kind)
    tared = _tare_for(recording, path, kind, choices, surroundings)
    gear, source = _gear_for(recording, path, kind, choices.gear, surroundings)
    return FitInputs(
        recording=recording,
        learnt=_learnt(recording, path, kind, choices.settings, surroundings),
        path=path,
        kind=kind,
        gear=gear,
        source=source,
        tared=tared,
        choices=choices,
        other_tares=_other_tares(recording, path, kind, tared, choices, surroundings),
    )


def fit_run(path: Path, kind: str = "", choices: Choices | None = None) -> Fit:
    """Analyse one run file. Raises the errors of the analysis, of the file, of the card and of a tare given by hand."""
    return inputs_of(path, kind, choices).fit()


def evidence_for(
    path: Path, kind: str, choices: Choices | None = None
) -> tuple[Recording, Evidence]:
    """A run file with all that an analysis of it would lean on: set, tare and settings as `fit_run` takes them."""
    inputs = inputs_of(path, kind, choices)
    return inputs.recording, inputs.evidence()


def _gear_for(
    recording: Recording,
    path: Path,
    kind: str,
    by_hand: HarmonicDrive | None = None,
    surroundings: Surroundings | None = None,
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
            basis = _basis_of(recording, path, kind, surroundings or Surroundings())
            return (gear, told) if basis is None else _built_on(gear, told, *basis)
    return None, GearSource("shipped", metadata.gear_serial)


def _built_on(
    gear: HarmonicDrive, source: GearSource, result: Result, builds_on: Mapping[str, Any]
) -> tuple[HarmonicDrive, GearSource]:
    return adopt(gear, [result]).gear, replace(source, builds_on=builds_on)


def _basis_of(
    recording: Recording, path: Path, kind: str, surroundings: Surroundings
) -> tuple[Result, dict[str, Any]] | None:
    """The result that an analysis builds on, and what it is called: of the nearest such run of the same gear.

    Runs before this one come first, as with tares. An analysis that is stale builds nothing.
    """
    experiment = catalogue.declared(kind)
    if experiment is None or not experiment.builds_on or not recording.metadata.gear_serial:
        return None
    library = surroundings.library(path.parent)
    for run in _runs_before(recording, library, experiment.builds_on):
        found = in_force(run.path, run.protocol)
        if found.analysis is None or found.stale:
            continue
        named = {"run": run.run_id, "file": run.path.name}
        named |= {"kind": run.protocol, "number": found.number}
        named |= {"analysis_sha256": found.analysis.seal.sha256}
        return found.analysis.whole_result(), named
    return None


def _learnt(
    recording: Recording,
    path: Path,
    kind: str,
    by_hand: Mapping[str, Any],
    surroundings: Surroundings,
) -> Mapping[str, Any]:
    """Settings that the gear's other runs of this kind give, by their analyses in force; none where one is by hand."""
    experiment = catalogue.declared(kind)
    if experiment is None or experiment.learns is None or not recording.metadata.gear_serial:
        return {}
    results: list[Result] = []
    for run in _runs_before(recording, surroundings.library(path.parent), (kind,)):
        if run.run_id == recording.metadata.run_id:
            continue
        found = in_force(run.path, kind)
        if found.analysis is None or found.stale:
            continue
        if surroundings.learns_from(found.analysis):
            results.append(found.analysis.whole_result())
    learnt = experiment.learns(results)
    return {} if any(name in by_hand for name in learnt) else learnt


def _runs_before(
    recording: Recording, library: LibraryIndex, protocols: Sequence[str]
) -> list[IndexedRun]:
    """The runs of the same gear, mounted as it is, by these protocols: the nearest in time first."""
    metadata = recording.metadata
    runs = [
        run
        for run in library.search(gear=metadata.gear_serial, origin=metadata.origin)
        if run.protocol in protocols and run.is_complete and run.mounting == metadata.mounting
    ]
    return sorted(runs, key=lambda run: nearness(run.start, metadata.start_time))


def _tare_for(
    recording: Recording,
    path: Path,
    kind: str,
    choices: Choices,
    surroundings: Surroundings | None = None,
) -> Tared:
    """The tare of a run: by hand, else the one that is found, analysed as it lies in its store or anew."""
    surroundings = surroundings or Surroundings()
    if choices.tare is not None:
        tare = surroundings.tare_fit(choices.tare, choices)
        return Tared(tare, FoundTare(choices.tare, by_hand=True))
    if not takes_tare(kind):
        return Tared()
    if choices.no_tare:
        return Tared(found=FoundTare(None, (TARE_DECLINED,)))
    days = tare_days_of(path.parent)
    found = find_tare(recording, surroundings.library(path.parent), tare_days=days)
    if found.path is None:
        return Tared(found=found)
    try:
        fit = surroundings.tare_fit(found.path, choices)
    except AnalysisError as error:
        return Tared(found=FoundTare(None, (f"{found.path.stem} gives no tare: {error}",)))
    # A tare that is young enough to be found is not too old to be believed.
    return Tared(fit, found, {} if days <= AGE_LIMIT else {TARE_AGE_SETTING: days})


def _other_tares(
    recording: Recording,
    path: Path,
    kind: str,
    tared: Tared,
    choices: Choices,
    surroundings: Surroundings,
) -> tuple[OtherTare, ...]:
    """The bench's other tares: beside the one that is subtracted, or beside the run where that is a tare itself."""
    one = tared.fit.path if tared.fit is not None else None
    if one is None:
        if kind != tare_kind():
            return ()
        one = path
    found: list[OtherTare] = []
    for other in tares_beside(recording, surroundings.library(path.parent), one):
        try:
            found.append(surroundings.other_tare(other, choices, path))
        except AnalysisError:
            # What gives no tare bears no witness of one.
            continue
        if len(found) == _MOST_OTHERS:
            break
    return tuple(found)


def _tare_fit(path: Path, choices: Choices) -> Fit:
    """The analysis of a tare: the one in force, and where there is none that may be used, one made now."""
    recording = with_learnt_scale(read.open_run(path), path.parent)
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
