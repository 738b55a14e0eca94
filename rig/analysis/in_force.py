"""The analysis in force: of all that were ever made of a run, the one that everybody reads.

Order of strength: kept by hand (`rig fit RUN --keep NUMBER --by NAME`); then what is not stale before
what is; then with a tare before without; then the newest. Terminal, library, passport, report,
difference and window read through here, and none of them fits anew.

An analysis is stale when something that it rests on is not what it was: the run, the tare, the
parameter set of the gear, the settings under which its tare was found, the version of its kind.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from model.errors import WordedError
from rig.analysis import format_1
from rig.analysis.gear_set import card_set, mapping_sha256, names_of_set, set_sha256
from rig.analysis.learnt import learnt_name, learnt_paths
from rig.analysis.store import Analysis, analysis_folder, json_ready, json_text, read_analyses
from rig.analysis.tare import tare_days_of, tare_kind
from rig.content.phrase import phrase, quoted
from rig.errors import ChangedRunError, ConfigurationError, RunFileError, UnsealedError
from rig.library.listed import COUNTED_OUTCOMES, IndexedRun
from rig.runfile.seal import (
    check_seal,
    file_sha256,
    is_unsealed_allowed,
    recorded_sha256,
    sealed_sha256,
    unsealed,
)
from rig.runfile.sealed import read_sealed, replace_sealed

if TYPE_CHECKING:
    from experiments.recording import RunMetadata
    from model.gear import HarmonicDrive

KEPT_NAME = "kept.json"
_UNSEALED = "not sealed"
"""Stands for the hash of a run whose note is missing."""
_LEARNT = (
    (("kinematic-error", "compensated-error"), "output_angle", "certificates", "output encoder"),
    ((), "torque", "torque_scale", "torque scale"),
)
"""What a bench learns: the kinds of analysis that take it (none: all), the channel, the option in which they say which
they took, and what it is called.
"""
_KEPT_FORMAT = "harmonic-rig-kept-2"
"""Sealed from birth, as analyses are."""
_KEPT_FORMAT_1 = "harmonic-rig-kept-1"
"""The same without a seal: what version 0.2.0 wrote."""


@dataclass(frozen=True)
class ManualChoice:
    """A choice by hand: analysis `number` of a kind is in force (0: none is, the choice is taken back)."""

    kind: str
    number: int
    by: str
    at: str


@dataclass(frozen=True, kw_only=True)
class InForce:
    """What everybody reads of a run and a kind of analysis.

    `analysis` is None where there is none. `stale` says in words what changed since it was made,
    empty where nothing did. `why_this` says why it, and not another one, is in force. `renewed_by`
    is the command that makes it anew, "" where nothing is stale. `of_this_run` is False for an
    analysis of other bytes than those of the run file that lies there now: nothing may be read from it.
    """

    kind: str
    analysis: Analysis | None = None
    stale: tuple[str, ...] = ()
    why_this: str = ""
    renewed_by: str = ""
    of_this_run: bool = True

    @property
    def number(self) -> int:
        """The number of the analysis; 0 where there is none."""
        return 0 if self.analysis is None else self.analysis.number

    def words_for_another(self, number: int) -> str:
        """What is to be said of analysis `number`, which is not the one in force."""
        return f"analysis {self.number} is in force ({self.why_this}), not analysis {number}"

    def as_json(self) -> dict[str, Any]:
        """As `rig runs --json` and `rig show --json` tell it."""
        file = tare = ""
        if self.analysis is not None:
            file, tare = self.analysis.name, str(self.analysis.tare.get("run", ""))
        return {
            "kind": self.kind,
            "number": self.number or None,
            "file": file,
            "tare": tare,
            "stale": list(self.stale),
            "why": self.why_this,
            "renewed_by": self.renewed_by,
        }


def in_force(run: str | Path, kind: str = "") -> InForce:
    """The analysis of a run that everybody reads: of one kind, without `kind` of the run's protocol.

    A recording of another rig, and a run that was never analysed as what it is, give the kind that
    was analysed last. Raises `RunFileError` for a store that cannot be read.
    """
    run = Path(run)
    of_kind = in_force_by_kind(run)
    if kind:
        return of_kind.get(kind, InForce(kind=kind))
    if len(of_kind) <= 1:
        return next(iter(of_kind.values()), InForce(kind=""))
    protocol = _metadata(run).experiment
    last = max(of_kind.values(), key=lambda one: one.number)
    return of_kind.get(protocol, last)


def in_force_by_kind(run: str | Path) -> dict[str, InForce]:
    """The analyses of a run in force, by their kind, in the order of their numbers."""
    run = Path(run)
    stored = read_analyses(run)
    kept = {choice.kind: choice for choice in kept_by_hand(run)} if stored else {}
    things = _Things(run)
    chosen: dict[str, InForce] = {}
    for kind in dict.fromkeys(analysis.kind for analysis in stored):
        of_kind = [analysis for analysis in stored if analysis.kind == kind]
        chosen[kind] = _strongest(run, kind, of_kind, kept.get(kind), things)
    return dict(sorted(chosen.items(), key=lambda pair: pair[1].number))


@dataclass(frozen=True)
class Newest:
    """The newest analysed run of every kind, in the order of the catalogue, each with its analysis in force.

    By these, and by no others, a gear is judged: certificate, report of the gear and passport speak of the same runs.
    `passed_over` says of which newer runs nothing is told, and why.
    """

    runs: tuple[tuple[IndexedRun, InForce], ...]
    passed_over: tuple[str, ...] = ()


def newest_analysed(runs: Sequence[IndexedRun]) -> Newest:
    """The newest of these runs, which are in order of time, by kind.

    Raises `ChangedRunError` for a run or an analysis that is not as it was sealed.
    """
    passed_over: list[str] = []
    chosen = [_newest(kind, runs, passed_over) for kind in catalogue.names()]
    return Newest(tuple(one for one in chosen if one is not None), tuple(passed_over))


def _newest(
    kind: str, runs: Sequence[IndexedRun], passed_over: list[str]
) -> tuple[IndexedRun, InForce] | None:
    """The newest run of a kind that was brought to its end and has an analysis; newer ones are noted."""
    for run in reversed([run for run in runs if run.protocol in (kind, "")]):
        try:
            found = in_force(run.path, kind)
        except ChangedRunError:
            # Nobody may go on without it: what was changed would make room for an older run.
            raise
        except RunFileError as error:
            passed_over.append(f"Run {run.run_id} ({kind}) cannot be read: {error}")
            continue
        if found.analysis is not None and not found.of_this_run:
            # A run that was changed since it was sealed is refused by name, for the same reason.
            check_seal(run.path)
        is_analysed = found.analysis is not None and found.of_this_run
        if is_analysed and run.outcome in COUNTED_OUTCOMES:
            return run, found
        if run.protocol != kind:
            continue
        why = f"ended {run.outcome} and does not stand here."
        if run.outcome in COUNTED_OUTCOMES:
            why = f"is not analysed: rig fit {quoted(run.path)}"
        passed_over.append(f"Run {run.run_id} ({kind}) {why}")
    return None


def _strongest(
    run: Path, kind: str, analyses: list[Analysis], kept: ManualChoice | None, things: _Things
) -> InForce:
    stale = {analysis.number: tuple(things.changed(analysis)) for analysis in analyses}
    by_hand = next((a for a in analyses if kept is not None and a.number == kept.number), None)

    def strength(analysis: Analysis) -> tuple[bool, bool, bool, int]:
        fresh = not stale[analysis.number]
        return analysis is by_hand, fresh, bool(analysis.tare), analysis.number

    best = max(analyses, key=strength)
    renewed_by = ""
    if stale[best.number]:
        renewed_by = _renewing(run, best, kept_by_hand=best is by_hand, things=things)
    return InForce(
        kind=kind,
        analysis=best,
        stale=stale[best.number],
        why_this=_why(best, analyses, kept if best is by_hand else None, stale),
        renewed_by=renewed_by,
        of_this_run=things.is_of_this_run(best),
    )


def _why(
    best: Analysis,
    analyses: list[Analysis],
    kept: ManualChoice | None,
    stale: Mapping[int, tuple[str, ...]],
) -> str:
    if kept is not None:
        return f"kept by {kept.by}, {kept.at}"
    if len(analyses) == 1:
        return "the only analysis"
    rivals = [a for a in analyses if bool(stale[a.number]) == bool(stale[best.number])]
    with_tare = [a for a in rivals if bool(a.tare) == bool(best.tare)]
    reasons = {
        "not stale": len(rivals) < len(analyses),
        "with a tare": len(with_tare) < len(rivals),
        "the newest": len(with_tare) > 1,
    }
    words = ", ".join(reason for reason, tells in reasons.items() if tells)
    return f"{words} of {len(analyses)} analyses"


def _renewing(run: Path, analysis: Analysis, *, kept_by_hand: bool, things: _Things) -> str:
    """The command that makes an analysis anew, with what was chosen by hand when it was made."""
    kind = phrase("{} ", analysis.kind != things.protocol and analysis.kind)
    words = [f"rig fit {kind}{quoted(run)}"]
    if analysis.tare.get("chosen") == "by hand":
        words.append(f"--tare {quoted(things.tare_path(analysis))}")
    chosen = phrase(", then rig fit RUN --keep NUMBER --by NAME", kept_by_hand)
    return " ".join(words) + chosen


class _Things:
    """What the analyses of one run rest on, as it is now; each looked at once, and only when asked for."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self._sha256: str | None = None
        self._known: RunMetadata | None = None
        self._sets: dict[str, frozenset[str]] = {}

    @property
    def protocol(self) -> str:
        """The protocol of the run; "" for a file that cannot be read."""
        try:
            return self._metadata.experiment
        except WordedError:
            return ""

    @property
    def _metadata(self) -> RunMetadata:
        if self._known is None:
            self._known = _metadata(self._run)
        return self._known

    def is_of_this_run(self, analysis: Analysis) -> bool:
        """Whether an analysis is of the bytes that lie there now; a file that is gone contradicts nobody."""
        if self._sha256 is None:
            self._sha256 = _hash_now(self._run)
        return self._sha256 in ("", str(analysis.content.get("run_sha256", "")))

    @property
    def _of_another_run(self) -> str:
        if self._sha256 == _UNSEALED:
            return "the run file is not sealed: its note is missing"
        return "the run file is not the one that was analysed"

    def changed(self, analysis: Analysis) -> Iterator[str]:
        """What of that on which an analysis rests is not what it was, in words."""
        if not self.is_of_this_run(analysis):
            yield self._of_another_run
        yield from self._tare_changed(analysis)
        yield from self._gear_changed(analysis)
        yield from self._bench_learnt(analysis)
        yield from _version_changed(analysis)

    def tare_path(self, analysis: Analysis) -> Path:
        """The file of the tare, where it was or by its run's name beside this run."""
        tare = analysis.tare
        return self._run.parent / str(tare.get("file") or f"{tare.get('run', '')}.h5")

    def _tare_changed(self, analysis: Analysis) -> Iterator[str]:
        tare = analysis.tare
        if not tare:
            return
        path = self.tare_path(analysis)
        if not path.is_file():
            return
        if _hash_now(path) != str(tare.get("sha256", "")):
            yield f"the tare {tare.get('run', '')} is not the one that was subtracted"
        named = path.parent / str(tare.get("analysis") or "")
        if tare.get("analysis") and _stored_hash(named) != tare.get("analysis_sha256"):
            yield f"the analysis {tare['analysis']} of its tare is not the one that was subtracted"
        yield from _tare_of_another_version(tare)
        yield from _tare_too_old(tare, self._run.parent)

    def _gear_changed(self, analysis: Analysis) -> Iterator[str]:
        source: Mapping[str, Any] = analysis.content.get("gear_source") or {}
        if source.get("source") == "by hand":
            return
        try:
            now = self._set_now(source)
            before = str(source.get("sha256", "")) if source else self._own_before(analysis)
        except WordedError as error:
            yield f"the parameter set of the gear cannot be read: {error}"
            return
        if now and before and before not in now:
            yield "the parameter set of the gear is another one now"
        yield from self._built_on_another(source.get("builds_on") or {})

    def _set_now(self, source: Mapping[str, Any]) -> frozenset[str]:
        """The hashes of the gear's set as its card, else the run, has it now; none where there is no set."""
        serial = str(source["serial"]) if source else self._serial
        if serial not in self._sets:
            self._sets[serial] = names_of_set(card_set(self._run.parent, serial, self._own_set))
        if self._sets[serial]:
            return self._sets[serial]
        # Without a card it is the run's own, which cannot change without the run.
        if source.get("source") == "run":
            return frozenset((str(source.get("sha256", "")),))
        return names_of_set(self._own_set())

    @property
    def _serial(self) -> str:
        return self._metadata.gear_serial if self._run.exists() else ""

    def _own_set(self) -> HarmonicDrive | None:
        """The set that the run carries; None for a run that is gone."""
        return self._metadata.gear if self._run.exists() else None

    def _own_before(self, analysis: Analysis) -> str:
        """Of an analysis that does not say where its set came from: the run's own set, if that is what it was.

        One that was given by hand, or into which something identified was written, is not held against anything.
        """
        own = self._own_set()
        used = mapping_sha256(analysis.content.get("gear") or {})
        return used if own is not None and set_sha256(own) == used else ""

    def _bench_learnt(self, analysis: Analysis) -> Iterator[str]:
        """Whether its bench has learnt something of its instruments since, or learnt it anew."""
        if not learnt_paths(self._run.parent) or not self._run.exists():
            return
        options = (analysis.content.get("result") or {}).get("options") or {}
        for kinds, channel, option, what in _LEARNT:
            before = str(options.get(option, ""))
            if kinds and analysis.kind not in kinds:
                continue
            now = learnt_name(self._run, channel)
            if now and now not in before:
                yield f"the {what} has been learnt since, or learnt anew"

    def _built_on_another(self, built_on: Mapping[str, Any]) -> Iterator[str]:
        if not built_on:
            return
        path = self._run.parent / str(built_on["file"])
        if not path.is_file():
            return
        found = in_force(path, str(built_on["kind"]))
        before = built_on.get("analysis_sha256", "")
        if before and found.analysis is not None and found.number == built_on["number"]:
            if found.analysis.seal.sha256 != before:
                yield f"analysis {found.number} of {built_on['run']}, on which it builds, is another one now"
        elif found.number != built_on["number"]:
            yield (
                f"it builds on analysis {built_on['number']} of {built_on['run']}, of which analysis "
                f"{found.number} is in force now"
            )


def _tare_of_another_version(tare: Mapping[str, Any]) -> Iterator[str]:
    before, now = tare.get("analysis_version"), catalogue.load(tare_kind()).version
    if before is not None and before != now:
        yield f"its tare was analysed by version {before} of {tare_kind()}, which is at {now}"


def _tare_too_old(tare: Mapping[str, Any], folder: Path) -> Iterator[str]:
    """Whether a tare that was found by itself would not be found any more under the settings of today."""
    age = tare.get("age_days")
    if tare.get("chosen") != "found" or not isinstance(age, (int, float)):
        return
    limit = tare_days_of(folder)
    if age > limit:
        yield f"its tare is {age:.1f} days old, and the setting tare_days is {limit:g} now"


def _version_changed(analysis: Analysis) -> Iterator[str]:
    if analysis.content.get("format") == format_1.FORMAT:
        yield "it was made before analyses were checked for evidence"
    experiment = catalogue.declared(analysis.kind)
    before = analysis.content.get("analysis_version", 1)
    if experiment is not None and before != experiment.version:
        yield f"it was made by version {before} of the {analysis.kind} analysis, which is at {experiment.version}"


def _hash_now(path: Path) -> str:
    """The hash of a run file; "" where it is gone, and "changed" where it is not the one that was sealed."""
    if not path.exists():
        return ""
    try:
        return sealed_sha256(path)
    except UnsealedError:
        return _UNSEALED
    except RunFileError:
        return "changed"


def _stored_hash(analysis: Path) -> str:
    """The hash of a stored analysis: as it was noted, of one that was never sealed as it is; "" where it is gone."""
    return recorded_sha256(analysis) or (file_sha256(analysis) if analysis.is_file() else "")


def _metadata(run: Path) -> RunMetadata:
    from rig.runfile.read import glance

    return glance(run).metadata


def kept_by_hand(run: str | Path) -> tuple[ManualChoice, ...]:
    """The choices by hand for a run, oldest first; the last of a kind counts. Raises `RunFileError`."""
    path = analysis_folder(run) / KEPT_NAME
    try:
        if not path.exists():
            return ()
        data, seal = read_sealed(path, is_sealed_from_birth=False)
        content = json.loads(data)
        if content["format"] not in (_KEPT_FORMAT, _KEPT_FORMAT_1):
            raise ValueError(content["format"])
        if content["format"] == _KEPT_FORMAT and not (seal.is_whole or is_unsealed_allowed()):
            raise unsealed(path)
        return tuple(
            ManualChoice(str(c["kind"]), int(c["number"]), str(c["by"]), str(c["at"]))
            for c in content["kept"]
        )
    except (ValueError, KeyError, TypeError) as error:
        raise RunFileError(
            "the choices by hand cannot be read",
            where=str(path),
            value=str(error),
            remedy="Move the file away and choose again with `rig fit RUN --keep NUMBER --by NAME`.",
        ) from None


def keep(run: str | Path, number: int, by: str, at: str, kind: str = "") -> InForce:
    """Put an analysis in force by hand, by name; 0 takes the choice for `kind` back.

    `at` is the calendar time (ISO 8601). Returns what is in force now. Raises `RunFileError` for a
    number that there is not, `ConfigurationError` where nobody is named.
    """
    run = Path(run)
    if not by.strip():
        raise ConfigurationError(
            "nobody is named who keeps the analysis", where="--by", remedy="Give your name."
        )
    stored = read_analyses(run)
    kind = kind or (in_force(run).kind if number == 0 else "")
    numbers = [a.number for a in stored if kind in ("", a.kind)]
    if number and number not in numbers:
        raise RunFileError(
            "there is no analysis of this number",
            where=str(analysis_folder(run)),
            value=number,
            limit=_listed(numbers),
            remedy="Look with `rig show RUN`.",
        )
    kind = kind or next(a.kind for a in stored if a.number == number)
    _write_kept(run, (*kept_by_hand(run), ManualChoice(kind, number, by.strip(), at)))
    return in_force(run, kind)


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(str(number) for number in numbers) or "none: the run has no analysis"


def _write_kept(run: Path, choices: tuple[ManualChoice, ...]) -> None:
    folder = analysis_folder(run)
    content = {"format": _KEPT_FORMAT, "kept": [vars(choice) for choice in choices]}
    try:
        folder.mkdir(exist_ok=True)
        replace_sealed(folder / KEPT_NAME, (json_text(json_ready(content)) + "\n").encode())
    except OSError as error:
        raise RunFileError(
            "the choice cannot be written beside its run",
            where=str(folder),
            value=error.strerror or str(error),
            remedy="Make the folder writable, or copy the run to one that is.",
        ) from None
