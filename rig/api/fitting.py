"""`rig.fit`: from runs to results, as `rig fit` does it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from rig.analysis.fit.recorded import TARE_DECLINED, Fit, fit_recording, kind_of
from rig.analysis.fit.run import Choices, fit_run
from rig.analysis.tare import FoundTare, takes_tare, tare_kind
from rig.api.reading import load
from rig.api.results import Result, Results
from rig.api.runs import Run, file_of

if TYPE_CHECKING:
    from model.gear import HarmonicDrive

    OneRun = Run | str | Path
    Tare = Run | str | Path | Literal["found"] | None


@overload
def fit(
    runs: OneRun,
    kind: str | None = None,
    *,
    tare: Tare = "found",
    gear: HarmonicDrive | None = None,
    largest_missed_share: float | None = None,
    **settings: Any,
) -> Result: ...
@overload
def fit(
    runs: Sequence[OneRun],
    kind: str | None = None,
    *,
    tare: Tare = "found",
    gear: HarmonicDrive | None = None,
    largest_missed_share: float | None = None,
    **settings: Any,
) -> Results: ...
def fit(
    runs: OneRun | Sequence[OneRun],
    kind: str | None = None,
    *,
    tare: Tare = "found",
    gear: HarmonicDrive | None = None,
    largest_missed_share: float | None = None,
    **settings: Any,
) -> Result | Results:
    """Identify a model from a run (`Run`, or the path of a run file), or from each of several.

    `kind` is the kind of fit; it follows from the run's protocol where it is None. `tare` is the motor-tare run
    that is subtracted: "found" takes the one that belongs to the run in its folder (a recording in memory has none),
    None leaves it away. `gear` is the parameter set to compare with instead of the run's own. `settings` are those of
    the analysis (`--set`). Nothing is stored: `Result.store()` does that.

    Raises `AnalysisError` for a recording that does not bear the analysis, `RigError` for a tare that is none of it.
    """
    if isinstance(runs, (Run, str, Path)):
        share = largest_missed_share
        return Result(_fit_one(runs, kind or "", tare, gear, settings, share))
    return Results(
        [
            Result(_fit_one(run, kind or "", tare, gear, settings, largest_missed_share))
            for run in runs
        ]
    )


def _fit_one(
    run: OneRun,
    kind: str,
    tare: Tare,
    gear: HarmonicDrive | None,
    settings: Mapping[str, Any],
    largest_missed_share: float | None,
) -> Fit:
    path = file_of(run)
    tare_in_memory = isinstance(tare, Run) and tare.path is None
    if path is not None and not tare_in_memory:
        choices = Choices(
            gear=gear,
            tare=_path_of(tare),
            no_tare=tare is None,
            settings=settings,
            largest_missed_share=largest_missed_share,
        )
        return fit_run(path, kind, choices)
    recording = _opened(run).recording
    kind = kind_of(recording, kind)
    made = fit_recording(
        recording,
        kind,
        gear=gear,
        tare=_tare_fit(tare, gear) if takes_tare(kind) else None,
        settings=settings,
        path=path,
        largest_missed_share=largest_missed_share,
    )
    if made.tare is not None:
        return made
    why_none = TARE_DECLINED if tare is None else _IN_MEMORY
    return replace(made, found_tare=FoundTare(None, (why_none,)))


_IN_MEMORY = "a recording in memory lies in no folder in which a tare could be found"


def _path_of(tare: Tare) -> Path | None:
    """The file of the tare that is named; None for none, for one that is to be found, and for one in memory."""
    if tare is None or tare == "found":
        return None
    return file_of(tare)


def _opened(run: OneRun) -> Run:
    return run if isinstance(run, Run) else load(run)


def _tare_fit(tare: Tare, gear: HarmonicDrive | None) -> Fit | None:
    """The analysed tare for a recording in memory: there is no folder in which one could be found."""
    if tare is None or tare == "found":
        return None
    run = _opened(tare)
    return fit_recording(run.recording, tare_kind(), gear=gear, path=run.path)
