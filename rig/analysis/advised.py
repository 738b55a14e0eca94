"""What to run next for a gear or a run: advice for every limit that is open or MARGINAL, and for what was asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.result import Result
from model.unit_text import scale_in
from rig.analysis.in_force import InForce, in_force, newest_analysed
from rig.analysis.judging import GearVerdict, judge_newest, judge_run, stored_result
from rig.analysis.next_run import Advice, Of, advice, wanted_by
from rig.analysis.passport.gather import runs_of
from rig.content.phrase import quoted
from rig.errors import ConfigurationError, RunFileError
from rig.gears.acceptance import Acceptance, Part, acceptance_for
from rig.library.folder import run_named
from rig.runfile.read import close_recording, glance, open_run


@dataclass(frozen=True)
class Analysed:
    """The analysis in force of one run, with the parameters that it was made with."""

    path: Path
    serial: str
    result: Result
    parameters: Mapping[str, Any]

    def advice(self, name: str, wanted: float) -> Advice:
        """What lowers U of one of its numbers."""
        of = Of(self.result.kind, self.result.run, self.parameters)
        return advice(self.result.estimates[name], self.result.quantity(name), of, wanted)


@dataclass(frozen=True, kw_only=True)
class Advised:
    """What there is to be advised: the verdict as it stands, advice, by the limits first, and what is `open`: limits
    that nothing is held against, each with the protocol whose run would be ("" where another run is no help).
    """

    subject: str
    serial: str
    verdict: GearVerdict
    advice: tuple[Advice, ...]
    open: tuple[tuple[str, str], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The object of `rig next --json`."""
        return {
            "subject": self.subject,
            **self.verdict.as_json(),
            "advice": [one.as_json() for one in self.advice],
            "open": [{"sentence": sentence, "protocol": kind} for sentence, kind in self.open],
        }


def advised(
    source: str,
    folder: Path,
    targets: Sequence[str] = (),
    acceptance: Acceptance | None = None,
) -> Advised:
    """Advice for a gear by its serial number, or for a run by its file, number or name.

    `targets` such as "running_torque_1000_rpm=3%" or "transmission_accuracy=0.1 arcmin" ask for a U. Raises
    `ConfigurationError` for a target that names nothing that was found, or no size; `RunFileError` for a source that is
    neither; `ChangedRunError` for what is not as it was sealed.
    """
    runs = runs_of(folder, source) if folder.is_dir() else ()
    if runs:
        newest = newest_analysed(runs)
        verdict = judge_newest(newest, acceptance or acceptance_for(folder, source))
        analysed = [_analysed(run.path, found) for run, found in newest.runs]
        serial = source
    else:
        path = run_named(folder, source)
        metadata, found = glance(path).metadata, in_force(path)
        serial = metadata.gear_serial
        if found.analysis is None:
            raise RunFileError(
                "has no analysis to advise from", where=str(path), remedy=f"rig fit {quoted(path)}"
            )
        stored = stored_result(
            found, metadata.origin, metadata.outcome, serial, part=Part.of(metadata), path=path
        )
        verdict = judge_run(stored, acceptance or acceptance_for(path.parent, serial))
        analysed = [_analysed(path, found)]
    made = [*_by_limits(verdict, analysed), *(_by_target(one, analysed) for one in targets)]
    return Advised(
        subject=source,
        serial=serial,
        verdict=verdict,
        advice=tuple(made),
        open=tuple(_open(verdict, analysed)),
    )


def _analysed(path: Path, found: InForce) -> Analysed:
    assert found.analysis is not None
    recording = open_run(path)
    try:
        metadata = recording.metadata
        return Analysed(path, metadata.gear_serial, found.analysis.result, metadata.parameters)
    finally:
        close_recording(recording)


def _open(verdict: GearVerdict, analysed: Sequence[Analysed]) -> Iterator[tuple[str, str]]:
    """The limits that nothing is held against, and why."""
    kinds = {one.result.kind for one in analysed}
    for line in verdict.lines:
        if line.outcome == "NOT JUDGED":
            yield f"{line.name}: {line.because}.", "" if line.kind in kinds else line.kind


def _by_limits(verdict: GearVerdict, analysed: Sequence[Analysed]) -> list[Advice]:
    by_run = {(one.result.run, one.result.kind): one for one in analysed}
    made = []
    for line in verdict.lines:
        one, wanted = by_run.get((line.run, line.kind)), wanted_by(line)
        if one is not None and wanted and line.estimate.name in one.result.estimates:
            made.append(one.advice(line.estimate.name, wanted))
    return made


def _by_target(text: str, analysed: Sequence[Analysed]) -> Advice:
    """Advice for one target. Raises `ConfigurationError`."""
    name, sign, size = text.partition("=")
    name, kinds = name.strip(), [one.result.kind for one in analysed]
    one = next((one for one in analysed if _named(name, one.result)), None)
    if one is None or not sign:
        known = [key for one in analysed for key in one.result.estimates]
        raise ConfigurationError(
            "names no number that was found",
            where="--target",
            value=repr(text),
            limit=f"QUANTITY=U of {', '.join(kinds) or 'an analysed run'}, such as {_example(known)}",
        )
    key = _named(name, one.result)
    estimate = one.result.estimates[key]
    if estimate.identifiable == "no" or not math.isfinite(estimate.expanded_uncertainty):
        raise ConfigurationError(
            "is not identifiable from this run: there is no budget to lower",
            where="--target",
            value=repr(text),
            limit=estimate.note or "a number with a finite U",
        )
    return one.advice(key, _size(size.strip(), one.result, key))


def _named(name: str, result: Result) -> str:
    """The estimate that a name means: itself, behind its kind, or the shortest that begins so; "" for none."""
    short = name.removeprefix(f"{result.kind}.")
    if short in result.estimates:
        return short
    found = [key for key in result.estimates if short and key.startswith(f"{short}_")]
    return min(found, key=len, default="")


def _example(known: Sequence[str]) -> str:
    return f"{(*known, 'running_torque_1000_rpm')[0]}=3%"


def _size(text: str, result: Result, key: str) -> float:
    """A wanted U in SI: a share of the value in percent, or a number with its unit."""
    estimate = result.estimates[key]
    shown = result.quantity(key).shown or estimate.unit
    number, unit = _split(text)
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    scale = abs(estimate.value) / 100.0 if unit == "%" else scale_in(unit or shown, estimate.unit)
    if scale is None or not 0.0 < value * scale < math.inf:
        raise ConfigurationError(
            "is no uncertainty that can be wanted",
            where="--target",
            value=repr(text),
            limit=f"above 0, in % of the value or in {shown}",
        )
    return value * scale


def _split(text: str) -> tuple[str, str]:
    if text.endswith("%"):
        return text[:-1], "%"
    number, _, unit = text.partition(" ")
    return number, unit.strip()
