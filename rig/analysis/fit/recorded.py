"""From a recording to a result: which analysis, which parameter set, which tare.

One way for every recording, whether simulated, recorded, replayed or imported: run file ->
`Recording` -> the analysis of the protocol -> `Result` -> analysis store.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from model.gear_file import gear_from_mapping, gear_to_mapping, shipped_gear
from rig.analysis.gear_set import GearSource
from rig.analysis.in_force import InForce, in_force
from rig.analysis.learnt import scale_of
from rig.analysis.store import Analysis, Basis, append_analysis, unsealed_words
from rig.analysis.tare import FoundTare, check_tare, takes_tare, tare_kind
from rig.errors import RigError
from rig.gears.acceptance import Part
from rig.runfile import read
from rig.runfile.seal import Seal

if TYPE_CHECKING:
    from experiments.contract import Evidence
    from experiments.recording import Recording
    from experiments.result import Result
    from model.gear import HarmonicDrive


@dataclass(frozen=True)
class OtherTare:
    """Another tare of the bench, a witness of the one that is subtracted: its result, and what it is called."""

    result: Result
    named: Mapping[str, Any]


TARE_DECLINED = "left away by hand"
"""Why an analysis has no tare where nobody wanted one."""
NOT_SEALED = "The run file is not sealed: nothing beside it says that it is what was recorded."
_SHIPPED_SET = (
    "The run carries no parameter set; the shipped {name} was used where the analysis "
    "needs one. Give yours with --parameters."
)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """One analysed run: the recording, the gear it was compared with, the tare that was subtracted, the result.

    `path` is the run file, `stored` the name of the analysis in its store ("" while there is none);
    `gear_known` is False where nobody said what gear it is and the shipped set stands in for it.
    """

    recording: Recording
    gear: HarmonicDrive
    result: Result
    path: Path | None = None
    tare: Fit | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    stored: str = ""
    stored_seal: Seal = field(default_factory=Seal)
    """Of a stored fit: the SHA-256 of the file of its analysis, and whether that is the one noted."""
    gear_known: bool = True
    largest_missed_share: float | None = None
    """Share of missed cycles that was allowed; None: the analyses' own limit."""
    gear_source: GearSource = field(default_factory=GearSource)
    found_tare: FoundTare = field(default_factory=FoundTare)
    """The tare that was found or chosen by hand, and where there is none, why."""
    other_tares: tuple[OtherTare, ...] = ()
    """The bench's other tares that its tare was held against."""
    named_tare: Mapping[str, Any] = field(default_factory=dict)
    """Of a stored fit: the tare that was subtracted, as its analysis names it."""
    stale: tuple[str, ...] = ()
    """Of a stored fit: what changed since it was made, in words."""
    renewed_by: str = ""
    """Of a stale fit: the command that makes it anew."""
    not_in_force: str = ""
    """Of a fit that was kept: which other analysis of the run everybody reads, and why; "" where it is this one."""

    @property
    def origin(self) -> str:
        """Where the recording is from: hardware, simulated, replay or imported."""
        return self.recording.metadata.origin

    @property
    def outcome(self) -> str:
        """How the run ended."""
        return self.recording.metadata.outcome

    @property
    def serial(self) -> str:
        """Serial number of the gear."""
        return self.recording.metadata.gear_serial

    @property
    def part(self) -> Part:
        """Which part the gear is, as its recording says."""
        return Part.of(self.recording.metadata)

    @property
    def leans_on_gear(self) -> bool:
        """Whether it had a parameter set to lean on; an analysis of recordings needs none."""
        analyses = {entry.name for entry in catalogue.entries() if not entry.has_plan}
        return self.gear_known or self.result.kind not in analyses

    @property
    def evidence(self) -> Evidence:
        """What its analysis leaned on."""
        return evidence_of(
            self.gear,
            self.tare,
            self.settings,
            self.largest_missed_share,
            self.other_tares,
        )

    @property
    def tare_words(self) -> tuple[str, ...]:
        """The tare that was subtracted, or why there is none and what is lost; nothing where none belongs."""
        tare = self.tare_as_json()
        if tare:
            age = tare.get("age_days")
            old = f", {age:.1f} days apart" if isinstance(age, (int, float)) and age == age else ""
            return (f"{tare['run']}{old}, {tare.get('chosen') or 'chosen by hand'}",)
        if not takes_tare(self.result.kind):
            return ()
        lost = f"without a {tare_kind()} the torque is that of motor and gear together"
        return (*self.found_tare.because, lost)

    @property
    def lacks_tare(self) -> bool:
        """Whether a tare would have been subtracted, had there been one; one left away by hand is not missed."""
        if self.tare_as_json() or not takes_tare(self.result.kind):
            return False
        return self.found_tare.because != (TARE_DECLINED,)

    def tare_as_json(self) -> dict[str, Any]:
        """The tare that was subtracted, as the analysis store names it; empty without one."""
        if self.tare is None:
            return dict(self.named_tare)
        metadata, path, found = self.tare.recording.metadata, self.tare.path, self.found_tare
        return {
            "run": metadata.run_id,
            "sha256": metadata.sha256,
            "file": _beside(self.path, path),
            "chosen": "by hand" if found.path is None or found.by_hand else "found",
            "age_days": found.age_days,
            "analysis_version": catalogue.load(self.tare.result.kind).version,
            "analysis": self.tare.stored,
            "analysis_sha256": self.tare.stored_seal.sha256,
        }


def _beside(run: Path | None, tare: Path | None) -> str:
    """The file of a tare as seen from its run: its name where both lie in one folder, else its whole path.

    "" for one that is no file.
    """
    if tare is None:
        return ""
    if run is not None and tare.resolve().parent == run.resolve().parent:
        return tare.name
    return str(tare.resolve())


def kind_of(recording: Recording, kind: str = "") -> str:
    """The kind of fit: the one asked for, else the protocol of the run. Raises `RigError` where neither names one."""
    if kind:
        catalogue.entry(kind)
        return kind
    protocol = recording.metadata.experiment
    if protocol in catalogue.kinds():
        return protocol
    raise RigError(
        "this recording was not made by a protocol of this program, so the kind of fit must be named",
        where=recording.metadata.run_id,
        value=repr(protocol) if protocol else None,
        limit=", ".join(catalogue.kinds()),
        remedy="For instance: rig fit motion RUN.",
    )


def _circumstances(
    recording: Recording, tare: Fit | None, largest_missed_share: float | None
) -> dict[str, Any]:
    """What a result keeps of scale, tare and bound that it was analysed with."""
    kept: dict[str, Any] = {}
    if scale := scale_of(recording):
        kept["torque_scale"] = scale
    kept["tare_run"] = tare.recording.metadata.run_id if tare else "none"
    if largest_missed_share is not None:
        kept["largest_missed_share"] = largest_missed_share
    return kept


def fit_recording(
    recording: Recording,
    kind: str = "",
    *,
    gear: HarmonicDrive | None = None,
    tare: Fit | None = None,
    settings: Mapping[str, Any] | None = None,
    path: Path | None = None,
    largest_missed_share: float | None = None,
    other_tares: Sequence[OtherTare] = (),
) -> Fit:
    """Analyse one recording.

    `gear` is the parameter set to compare with; without it the run's own, and the shipped one as the last resort, which
    the result then says. `largest_missed_share` is the share of missed cycles above which the run is refused (None: the
    analyses' own). Raises the errors of the analysis, and `RigError` for a tare that does not belong to this rig.
    """
    experiment = catalogue.load(kind_of(recording, kind))
    if gear is not None:
        _refuse_another_ratio(recording, gear)
    remarks: list[str] = []
    parameters = gear or recording.metadata.gear
    gear_known = parameters is not None
    if parameters is None:
        parameters = shipped_gear()
        if experiment.has_plan:
            remarks.append(_SHIPPED_SET.format(name=parameters.name))
    if path is not None and not recording.metadata.is_sealed:
        remarks.append(NOT_SEALED)
    if tare is not None:
        check_tare(recording, tare.recording, tare.result)
    evidence = evidence_of(parameters, tare, settings or {}, largest_missed_share, other_tares)
    result = experiment.analyse(recording, evidence)
    options = dict(result.options)
    if gear_known or experiment.has_plan:
        options.setdefault("parameter_set", parameters.name)
    options |= _circumstances(recording, tare, largest_missed_share)
    result = dataclasses.replace(result, warnings=(*result.warnings, *remarks), options=options)
    return Fit(
        recording=recording,
        gear=parameters,
        result=result,
        path=path,
        tare=tare,
        settings=dict(settings or {}),
        gear_known=gear_known,
        largest_missed_share=largest_missed_share,
        other_tares=tuple(other_tares),
    )


def _refuse_another_ratio(recording: Recording, gear: HarmonicDrive) -> None:
    """Raise `RigError` for a parameter set of a gear with another ratio than the one that was turned."""
    run = recording.metadata
    ratio = gear.mounted_ratio(run.mounting)
    if run.gear_mounted and math.isfinite(run.ratio) and not math.isclose(ratio, run.ratio):
        raise RigError(
            "the parameter set is of a gear with another ratio than the run's",
            where=f"{run.run_id}, parameter set {gear.name}",
            value=f"{ratio:g} ({run.mounting})",
            limit=f"{run.ratio:g}",
            remedy="Give the set of the gear that was turned, or none: the run carries its own.",
        )


def other_tare(fit: Fit, run: Path) -> OtherTare:
    """A fitted tare as a witness of the one of a run."""
    named = {
        "run": fit.recording.metadata.run_id,
        "sha256": fit.recording.metadata.sha256,
        "file": _beside(run, fit.path),
        "analysis": fit.stored,
        "analysis_sha256": fit.stored_seal.sha256,
    }
    return OtherTare(fit.result, named)


def evidence_of(
    gear: HarmonicDrive,
    tare: Fit | None,
    settings: Mapping[str, Any],
    largest_missed_share: float | None,
    other_tares: Sequence[OtherTare] = (),
) -> Evidence:
    """What an analysis leans on: parameter set, tares, settings, and the share of missed cycles that it lets pass."""
    from experiments.contract import Evidence

    evidence = Evidence(
        gear,
        settings=dict(settings),
        other_tares=tuple(other.result for other in other_tares),
    )
    if tare is not None:
        evidence = dataclasses.replace(evidence, tare=tare.result, tare_recording=tare.recording)
    if largest_missed_share is None:
        return evidence
    return dataclasses.replace(evidence, maximum_missed_share=largest_missed_share)


def stored_fit(path: Path, analysis: Analysis, recording: Recording | None = None) -> Fit:
    """A run with one of its stored analyses; nothing is fitted.

    Opens the run unless its recording is given. Raises `RunFileError` for an analysis that holds no
    result and for a run that cannot be read.
    """
    result = analysis.whole_result()
    if not analysis.seal.is_whole:
        result = dataclasses.replace(result, warnings=(*result.warnings, unsealed_words(analysis)))
    recording = recording or read.open_run(path)
    leaned_on = analysis.content.get("gear")
    own = recording.metadata.gear
    gear = gear_from_mapping(leaned_on, str(analysis.path)) if leaned_on else own
    return Fit(
        recording=recording,
        gear=gear or shipped_gear(),
        result=result,
        path=path,
        settings=dict(analysis.content.get("settings", {})),
        stored=analysis.name,
        stored_seal=analysis.seal,
        gear_known=own is not None or _was_given(analysis),
        gear_source=GearSource.from_json(analysis.content.get("gear_source") or {}),
        found_tare=FoundTare(None, tuple(analysis.content.get("no_tare", ()))),
        named_tare=analysis.tare,
    )


def fit_in_force(path: Path, found: InForce) -> Fit:
    """A run with the analysis in force that it has, and what changed since that was made."""
    assert found.analysis is not None
    fit = stored_fit(path, found.analysis)
    return dataclasses.replace(fit, stale=found.stale, renewed_by=found.renewed_by)


def _was_given(analysis: Analysis) -> bool:
    return (analysis.content.get("gear_source") or {}).get("source") in ("by hand", "card")


def with_gear(fit: Fit, gear: HarmonicDrive) -> Fit:
    """A fit beside another parameter set, to be scored and compared; the result stays as it was fitted.

    Raises `RigError` for the set of a gear with another ratio.
    """
    _refuse_another_ratio(fit.recording, gear)
    return dataclasses.replace(fit, gear=gear, gear_known=True)


def score(fit: Fit) -> Result:
    """How well the parameter set of a fit predicts its run, nothing fitted; the fit's own result
    where a kind has no score.
    """
    compare = catalogue.load(fit.result.kind).compare
    if compare is None:
        return fit.result
    return compare(fit.recording, fit.gear, fit.evidence)


def store(fit: Fit, created: str) -> Fit:
    """Append a fit to the store beside its run and say under which name, and whether everybody reads it from now on.

    A recording that is no file stays as it is.
    """
    if fit.path is None:
        return fit
    basis = Basis(
        fit.recording.metadata.sha256,
        created,
        gear=gear_to_mapping(fit.gear),
        tare=fit.tare_as_json(),
        settings=fit.settings,
        analysis_version=catalogue.load(fit.result.kind).version,
        gear_source=fit.gear_source.as_json(),
        no_tare=() if fit.tare is not None else fit.found_tare.because,
        other_tares=tuple(other.named for other in fit.other_tares),
    )
    kept = append_analysis(fit.path, fit.result, basis)
    found = in_force(fit.path, kept.kind)
    other = "" if found.number == kept.number else found.words_for_another(kept.number)
    return dataclasses.replace(fit, stored=kept.name, stored_seal=kept.seal, not_in_force=other)
