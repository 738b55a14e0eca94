"""A stored analysis made again, from the same run, settings, set and tare, and compared number by number.

On the machine and with the program that made it the same analysis gives the same digits. On another
processor, or with other libraries of linear algebra, the last digits of a fit differ: `_TOLERANCE` is
what is let pass, and the worst difference is told whatever it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from experiments.finding import Finding, Severity
from experiments.result import checks_to_mapping
from model.gear_file import gear_from_mapping
from rig.analysis.fit.recorded import Fit, OtherTare, fit_recording, stored_fit
from rig.analysis.learnt import as_analysed, with_learnt_scale
from rig.analysis.result_data import table_to_mapping
from rig.analysis.store import Analysis, json_ready, read_analyses
from rig.analysis.tare import tare_kind
from rig.content.phrase import phrase
from rig.errors import RunFileError
from rig.runfile.checks import LEVELS
from rig.runfile.read import close_recording, open_run

if TYPE_CHECKING:
    from experiments.recording import Recording

_TOLERANCE = 0.0
"""Relative difference of a number that is let pass: none, digits are equal."""


@dataclass(frozen=True)
class Recomputed:
    """One analysis made again: how many numbers were compared, and where they differ.

    `worst` is the largest difference relative to the larger of the two numbers, at `worst_at`
    ("" where all are equal); `differing` are the places that hold something else, words among them.
    `because` says why it was not made again, "" where it was. It blocks
    where it says something else than what is stored, and warns where it was not made again.
    """

    analysis: Analysis
    numbers: int = 0
    worst: float = 0.0
    worst_at: str = ""
    differing: tuple[str, ...] = ()
    because: str = ""
    severity: Severity = Severity.PASSED

    def as_json(self) -> dict[str, Any]:
        """As `rig verify --recompute --json` tells it."""
        return self.finding.as_json() | {
            "analysis": str(self.analysis.path),
            "level": LEVELS[self.severity],
            "numbers": self.numbers,
            "worst": self.worst,
            "worst_at": self.worst_at,
            "differing": list(self.differing),
            "text": self.words,
        }

    @property
    def finding(self) -> Finding:
        """The same as a finding."""
        return Finding("recomputed", self.severity, self.words, where=str(self.analysis.path))

    @property
    def words(self) -> str:
        """What was found, in one sentence."""
        if self.because:
            return f"not made again: {self.because}"
        if not self.differing:
            return f"made again, all {self.numbers} numbers are equal to the digit"
        first = "; ".join(self.differing[:3])
        more = phrase("; and {} more", max(len(self.differing) - 3, 0))
        return (
            f"made again, it says something else ({self.numbers} numbers compared): {first}{more}"
        )


def recompute(run: Path, analysis: Analysis, *, tolerance: float = _TOLERANCE) -> Recomputed:
    """Make a stored analysis again and compare it with what is stored.

    One of another version of its kind is not made again, and says so. Raises the errors of the run
    file, of its tare and of the analysis.
    """
    experiment = catalogue.declared(analysis.kind)
    version = analysis.content.get("analysis_version", 1)
    if experiment is None:
        return Recomputed(
            analysis,
            because=f"this program has no analysis {analysis.kind}",
            severity=Severity.WARNS,
        )
    if version != experiment.version:
        text = (
            f"it is by version {version} of {analysis.kind}, which is at {experiment.version} here"
        )
        return Recomputed(analysis, because=text, severity=Severity.WARNS)
    recording = open_run(run)
    tare = None
    try:
        recording = as_analysed(recording, run.parent, analysis.result.options)
        tare = _tare_of(run, analysis)
        again = _again(run, recording, analysis, tare, _other_tares(run, analysis))
    finally:
        close_recording(recording)
        if tare is not None:
            close_recording(tare.recording)
    return _compared(analysis, again, tolerance)


def _again(
    run: Path,
    recording: Recording,
    analysis: Analysis,
    tare: Fit | None,
    others: Sequence[OtherTare],
) -> Fit:
    content = analysis.content
    source = (content.get("gear_source") or {}).get("source", "")
    # Where nobody stated a set, the analysis took the shipped one for itself, and does so again.
    is_shipped = source == "shipped" or not content.get("gear")
    gear = None if is_shipped else gear_from_mapping(content["gear"], str(analysis.path))
    return fit_recording(
        recording,
        analysis.kind,
        gear=gear,
        tare=tare,
        settings=dict(content.get("settings") or {}),
        path=run,
        largest_missed_share=analysis.result.options.get("largest_missed_share"),
        other_tares=others,
    )


def _tare_of(run: Path, analysis: Analysis) -> Fit | None:
    """The tare that was subtracted; None where there was none."""
    return _named_tare(run, analysis.tare, analysis) if analysis.tare else None


def _other_tares(run: Path, analysis: Analysis) -> list[OtherTare]:
    """The tares that were witnesses of the one that was subtracted."""
    others: list[OtherTare] = []
    for named in analysis.content.get("other_tares") or ():
        fit = _named_tare(run, named, analysis)
        close_recording(fit.recording)
        others.append(OtherTare(fit.result, named))
    return others


def _named_tare(run: Path, named: Mapping[str, Any], analysis: Analysis) -> Fit:
    """A tare as an analysis names it: by its stored analysis, where it had one, else analysed again; with the torque
    scale of that which it was subtracted from.
    """
    path = run.parent / str(named.get("file") or f"{named.get('run', '')}.h5")
    recording = open_run(path)
    if recording.metadata.sha256 != named.get("sha256"):
        close_recording(recording)
        raise RunFileError(
            "is not the tare that was subtracted",
            where=str(path),
            value=recording.metadata.sha256,
            limit=str(named.get("sha256")),
        )
    scale = str(analysis.result.options.get("torque_scale", ""))
    recording = with_learnt_scale(recording, path.parent, scale)
    if named.get("analysis") or "analysis" not in named:
        for stored in reversed(read_analyses(path)):
            if stored.kind == tare_kind() and _is_named(stored, named):
                return stored_fit(path, stored, recording)
    return fit_recording(recording, tare_kind(), path=path)


def _is_named(stored: Analysis, named: Mapping[str, Any]) -> bool:
    """Whether it is the analysis that is named; where none is (0.2.0) the newest of the same version is taken."""
    if "analysis" in named:
        return stored.seal.sha256 == named.get("analysis_sha256")
    return stored.content.get("analysis_version", 1) == named.get("analysis_version", 1)


def _compared(analysis: Analysis, again: Fit, tolerance: float) -> Recomputed:
    content, result = analysis.content, again.result
    pairs = {
        "result": (content.get("result"), result.as_json()),
        "tables": (content.get("tables"), [table_to_mapping(table) for table in result.tables]),
        "covariance": (content.get("covariance"), result.covariance),
        "checks": (content.get("checks"), checks_to_mapping(result.checks)),
    }
    numbers, worst, worst_at, differing = 0, 0.0, "", []
    for name, (stored, now) in pairs.items():
        for where, one, other in _leaves(stored, json_ready(now), name):
            if not (_is_number(one) and _is_number(other)):
                if one != other:
                    differing.append(f"{where}: {_short(one)} stored, {_short(other)} now")
                continue
            numbers += 1
            apart = _apart(one, other)
            if apart > worst:
                worst, worst_at = apart, where
            if apart > tolerance:
                differing.append(f"{where}: {one!r} stored, {other!r} now")
    severity = Severity.BLOCKS if differing else Severity.PASSED
    return Recomputed(analysis, numbers, worst, worst_at, tuple(differing), severity=severity)


def _leaves(one: Any, other: Any, where: str) -> Iterator[tuple[str, Any, Any]]:
    """The numbers and words of two objects side by side; where their shapes differ, the objects themselves."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys((*one, *other)):
            yield from _leaves(one.get(key), other.get(key), f"{where}.{key}")
    elif _is_list(one) and _is_list(other) and len(one) == len(other):
        for place, (left, right) in enumerate(zip(one, other, strict=True)):
            yield from _leaves(left, right, f"{where}[{place}]")
    else:
        yield where, one, other


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _apart(one: float, other: float) -> float:
    """The difference of two numbers relative to the larger of them."""
    if one == other:
        return 0.0
    return abs(one - other) / max(abs(one), abs(other), math.ulp(0.0))


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
