"""What a sealed run says: analysed with the tare that belongs to it, kept in the store, and what is to be done next.

After `rig run`, before the first report, and wherever an analysis has gone stale: one way from a run
file to an analysis that everybody reads (`in_force`). A recording that does not bear the analysis is
a result and not a failure: the digest then says why there is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from experiments.errors import AnalysisError
from experiments.quantity import key_names
from model.gear_file import gear_from_mapping
from rig.analysis.fit.recorded import TARE_DECLINED, Fit, fit_in_force, store
from rig.analysis.fit.run import TARE_AGE_SETTING, Choices, fit_run
from rig.analysis.in_force import InForce, in_force
from rig.analysis.tare import tare_kind
from rig.content.phrase import quoted
from rig.errors import ChangedRunError, RigError, RunFileError

if TYPE_CHECKING:
    from model.identify.estimate import Estimate

_NO_ANALYSIS = "there is no analysis of this protocol"


@dataclass(frozen=True, kw_only=True)
class Digest:
    """What a run says.

    `fit` is None where the recording does not bear its analysis, and `because` says why; `in_force` is
    the analysis that everybody reads from now on. `not_stored` says why the fit could not be kept.
    """

    path: Path
    fit: Fit | None = None
    in_force: InForce
    because: tuple[str, ...] = ()
    not_stored: str = ""

    @property
    def key_values(self) -> tuple[tuple[str, Estimate], ...]:
        """What a reader looks for first: titles and estimates, the most important first."""
        if self.fit is None:
            return ()
        result = self.fit.result
        names = key_names(result.quantities, result.estimates)
        return tuple((result.quantity(n).titled(n), result.estimates[n]) for n in names)

    @property
    def next_steps(self) -> tuple[str, ...]:
        """Commands, what is most wanting first."""
        if self.fit is None:
            return ()
        metadata, steps = self.fit.recording.metadata, []
        path = quoted(self.path)
        if self.fit.lacks_tare:
            steps.append(f"rig run {tare_kind()}, then rig fit {path}")
        experiment = catalogue.declared(metadata.experiment)
        if experiment is not None and experiment.goes_on:
            steps.append(experiment.goes_on.format(run=path))
        if metadata.gear_serial and metadata.gear_mounted:
            gear, folder = quoted(metadata.gear_serial), quoted(self.path.parent)
            steps.append(f"rig report --gear {gear} --runs {folder}")
        else:
            steps.append(f"rig report {path}")
        return tuple(steps)

    def as_json(self) -> dict[str, Any]:
        """The keys that `rig run --json` adds: which analysis, its tare, and the values that matter (SI)."""
        return {
            "analysis": self.in_force.as_json(),
            "tare": {} if self.fit is None else told_tare(self.fit),
            "quantities": {
                estimate.name: {
                    "title": title,
                    **_estimate_digest(estimate),
                    **_identified(estimate),
                }
                for title, estimate in self.key_values
            },
            # By title, as 0.2.0 had it, for one version more.
            "values": {
                title: _estimate_digest(estimate)
                for title, estimate in self.key_values
                if estimate.identifiable != "no"
            },
            "not_stored": self.not_stored,
            "next": list(self.next_steps),
        }


def _estimate_digest(estimate: Estimate) -> dict[str, Any]:
    return {
        "value": estimate.value,
        "expanded_uncertainty": estimate.expanded_uncertainty,
        "unit": estimate.unit,
    }


def _identified(estimate: Estimate) -> dict[str, str]:
    return {"identifiability": estimate.identifiable, "note": estimate.note}


def told_tare(fit: Fit) -> dict[str, Any]:
    """The tare of a fit as `--json` tells it: which, and why it, or why none."""
    return {"run": fit.tare_as_json().get("run", ""), "because": list(fit.tare_words)}


def digest(path: Path, created: str, kind: str = "", choices: Choices | None = None) -> Digest:
    """Analyse a sealed run and keep the analysis beside it.

    `created` is the calendar time (ISO 8601). A recording that does not bear its analysis gives a
    digest without a fit; a folder that cannot be written one whose fit is not stored. Raises what is
    wrong with the file, the gear's card, or a choice by hand.
    """
    kind = kind or protocol_of(path)
    if kind not in catalogue.kinds():
        return Digest(path=path, in_force=InForce(kind=kind), because=(_NO_ANALYSIS,))
    try:
        fit = fit_run(path, kind, choices)
    except AnalysisError as error:
        return Digest(path=path, in_force=in_force(path, kind), because=(str(error),))
    try:
        kept = store(fit, created)
    except ChangedRunError:
        raise
    except RunFileError as error:
        return Digest(path=path, fit=fit, in_force=in_force(path, kind), not_stored=str(error))
    return Digest(path=path, fit=kept, in_force=in_force(path, kind))


def read_or_digest(
    path: Path, created: str, kind: str = ""
) -> tuple[Fit | None, InForce, Digest | None]:
    """The fit in force of a run, as everybody reads it. A run that was never analysed is, once.

    The first analysis is no refit; a stale one is read as it is, and `InForce.stale` says so. No fit:
    the recording does not bear the analysis, and the digest says why.
    """
    found = in_force(path, kind or protocol_of(path))
    if found.analysis is None or not found.of_this_run:
        made = digest(path, created, kind)
        return made.fit, made.in_force, made
    return fit_in_force(path, found), found, None


def renew(path: Path, created: str, kind: str = "") -> Digest:
    """Make the analysis in force anew, with what was chosen by hand when it was made.

    Raises `RigError` where there is none, or where a tare chosen by hand is gone.
    """
    found = in_force(path, kind)
    if found.analysis is None:
        raise RigError(
            "there is no analysis that could be renewed",
            where=str(path),
            remedy=f"Make one: rig fit {quoted(path)}.",
        )
    return digest(path, created, found.kind, choices_of(path, found))


def choices_of(path: Path, found: InForce) -> Choices:
    """What was chosen by hand when the analysis in force was made."""
    assert found.analysis is not None
    content, tare = found.analysis.content, found.analysis.tare
    by_hand = (content.get("gear_source") or {}).get("source") == "by hand"
    settings = dict(content.get("settings", {}))
    tare_file = None
    if tare.get("chosen") == "by hand":
        tare_file = path.parent / str(tare["file"])
    elif tare.get("chosen") == "found":
        settings.pop(TARE_AGE_SETTING, None)
    share = found.analysis.result.options.get("largest_missed_share")
    return Choices(
        gear=gear_from_mapping(content["gear"], found.analysis.name) if by_hand else None,
        tare=tare_file,
        no_tare=content.get("no_tare") == [TARE_DECLINED],
        settings=settings,
        largest_missed_share=share,
    )


def protocol_of(path: Path) -> str:
    """The protocol of a run file; "" for a recording of another rig."""
    from rig.runfile import read

    recording = read.open_run(path, digest=False, rows=False)
    try:
        return recording.metadata.experiment
    finally:
        read.close_recording(recording)
