"""An analysis that lies in the store as the fit that it was: the recording, the set it leaned on, the result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from model.gear_file import gear_from_mapping, shipped_gear
from rig.analysis.fit import Fit
from rig.analysis.gear_set import GearSource
from rig.analysis.store import Analysis, unsealed_words
from rig.analysis.tare_search import FoundTare
from rig.runfile import read

if TYPE_CHECKING:
    from experiments.recording import Recording
    from rig.analysis.in_force import InForce


def stored_fit(path: Path, analysis: Analysis, recording: Recording | None = None) -> Fit:
    """A run with one of its stored analyses; nothing is fitted.

    Opens the run unless its recording is given. Raises `RunFileError` for an analysis that holds no
    result and for a run that cannot be read.
    """
    result = analysis.whole_result()
    if not analysis.seal.is_whole:
        result = replace(result, warnings=(*result.warnings, unsealed_words(analysis)))
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
    return replace(fit, stale=found.stale, renewed_by=found.renewed_by)


def _was_given(analysis: Analysis) -> bool:
    return (analysis.content.get("gear_source") or {}).get("source") in ("by hand", "card")
