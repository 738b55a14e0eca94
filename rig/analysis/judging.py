"""The verdict on a gear: what its analyses found, held against what its acceptance file asks. Nothing else judges.

A verdict is worked out whenever it is read, and stored nowhere: it follows from the analyses in force
and the acceptance file as it is now. It is the worst over the limits of that file: FAIL, then NOT
JUDGED (a limit that nobody confirmed, a quantity without number or without evidence, an analysis
that is stale), MARGINAL, PASS. What the file does not list never counts.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from experiments.finding import Severity
from experiments.quantity import Quantity, quantity_of
from experiments.result import (
    DECISION_RULE,
    WORST_FIRST,
    Result,
    Verdict,
    VerdictOutcome,
    lacks_number,
    outcome_against,
)
from model.errors import WordedError
from model.identify.estimate import Estimate
from rig.analysis.in_force import InForce, Newest, in_force
from rig.analysis.next_run import next_step_of
from rig.analysis.store import Analysis
from rig.analysis.tare import takes_tare
from rig.content.phrase import phrase, quoted
from rig.gears.acceptance import Acceptance, Limit, Part, Subject, acceptance_for
from rig.gears.card import UNNAMED
from rig.library.listed import IndexedRun

if TYPE_CHECKING:
    from experiments.recording import RunMetadata
    from rig.analysis.fit.recorded import Fit

NO_GEAR = "the recording names no gear, so there is no limit to hold it against"
"""What is missing where no gear is named."""
_BROUGHT_TO_THE_END = ("COMPLETED", "")
"""Outcomes of runs whose recording is whole; "" is that of an imported one."""


Side = Literal["upper", "lower"]
LIMIT_SIGNS: Mapping[str, str] = {"upper": "≤", "lower": "≥"}
"""How a limit is printed, by the side that it closes."""

Accepted = Callable[[Path, str], Acceptance | None]
"""What a gear must show, by folder of runs and serial number."""


@dataclass(frozen=True)
class StoredResult:
    """A stored analysis with what its run file says of the run, and what changed since it was made."""

    result: Result
    origin: str
    outcome: str
    serial: str = ""
    part: Part = field(default_factory=Part)
    stale: tuple[str, ...] = ()
    renewed_by: str = ""
    not_in_force: str = ""
    path: Path | None = None


if TYPE_CHECKING:
    Analysed = Fit | StoredResult
    """One analysed run as it is judged."""


def stored_result(
    found: InForce,
    origin: str,
    outcome: str,
    serial: str = "",
    *,
    part: Part | None = None,
    other: Analysis | None = None,
    path: Path | None = None,
) -> StoredResult:
    """The analysis in force of a run, ready to be judged; or another one of its analyses, which is told to be aside."""
    analysis = other or found.analysis
    assert analysis is not None
    stored = StoredResult(analysis.result, origin, outcome, serial, part or Part(), path=path)
    if analysis.number != found.number:
        return replace(stored, not_in_force=found.words_for_another(analysis.number))
    return replace(stored, stale=found.stale, renewed_by=found.renewed_by)


@dataclass(frozen=True, kw_only=True)
class GearVerdict:
    """What a gear, or one run of it, is worth: the verdict, why it is not a better one, and every limit with its own.

    `source` names the acceptance file with the SHA-256 that it had, empty where there is none. `stale` says of every
    stale analysis among those that were looked at what changed, and what renews it; a limit or not.
    """

    verdict: VerdictOutcome
    because: tuple[str, ...] = ()
    lines: tuple[Verdict, ...] = ()
    source: str = ""
    stale: tuple[str, ...] = ()
    acceptance_sha256: str = ""
    remark: str = ""
    """What to know of the acceptance file, whatever the verdict: that it names no part."""

    @property
    def next_steps(self) -> tuple[str, ...]:
        """What decides each limit that is MARGINAL. Worked out when it is asked for: a list of runs only counts."""
        return tuple(step for step in map(next_step_of, self.lines) if step)

    def of(self, result: Result) -> tuple[Verdict, ...]:
        """The lines that one result had a part in."""
        return tuple(v for v in self.lines if (v.run, v.kind) == (result.run, result.kind))

    def as_json(self) -> dict[str, Any]:
        """`verdict`, `because`, `stale`, and what was judged, as every `--json` tells it."""
        return {
            "verdict": self.verdict,
            "because": list(self.because),
            "stale": list(self.stale),
            "acceptance": self.source,
            "acceptance_sha256": self.acceptance_sha256,
            "remark": self.remark,
            "decision_rule": DECISION_RULE,
            "limits": [{**line.as_json(), "next_step": next_step_of(line)} for line in self.lines],
        }


@dataclass(frozen=True)
class JudgedRun:
    """One run as everybody reads it: the analysis of it that counts, and the verdict on what it measured."""

    found: InForce
    verdict: GearVerdict


def verdict_as_json(verdict: GearVerdict | None) -> dict[str, Any]:
    """Verdict, reasons and what is stale of one run of several; null for a file that cannot be read."""
    if verdict is None:
        return {"verdict": None, "because": [], "stale": []}
    whole = verdict.as_json()
    return {key: whole[key] for key in ("verdict", "because", "stale")}


def judge(found: Sequence[Analysed], acceptance: Acceptance | None) -> GearVerdict:
    """The verdict on a gear by all that its acceptance file lists; `found` are its analyses in force."""
    if acceptance is None or not acceptance.limits:
        return _without_limits(found, acceptance)
    return _worst(acceptance.limits, found, acceptance)


def judge_run(one: Analysed, acceptance: Acceptance | None) -> GearVerdict:
    """The verdict on what one run measures: only the limits on quantities of its kind count."""
    if acceptance is None or not acceptance.limits:
        return _without_limits([one], acceptance)
    of_kind = [limit for limit in acceptance.limits if limit.kind == one.result.kind]
    if not of_kind:
        nothing = f"no limit of {acceptance.name} applies to what this run measures"
        return replace(
            not_judged(nothing),
            source=acceptance.path,
            acceptance_sha256=acceptance.sha256,
            stale=_stale([one]),
        )
    return _worst(of_kind, [one], acceptance)


def judge_stored(
    run: Path,
    kind: str,
    origin: str,
    outcome: str,
    serial: str,
    *,
    part: Part,
    accepted: Accepted = acceptance_for,
) -> JudgedRun:
    """The analysis of a run that counts, and the verdict by it; NOT JUDGED, and why, where nothing can be read.

    `origin`, `outcome`, `serial` and `part` are those of the run file; `accepted` says what the gear must show.
    """
    found = InForce(kind=kind)
    try:
        found = in_force(run, kind)
        if outcome not in _BROUGHT_TO_THE_END:
            because = f"the run ended as {outcome}"
        elif found.analysis is None or not found.of_this_run:
            because = f"the run is not analysed: rig fit {quoted(run)}"
        else:
            stored = stored_result(found, origin, outcome, serial, part=part, path=run)
            return JudgedRun(found, judge_run(stored, accepted(run.parent, serial)))
    except (WordedError, KeyError, TypeError, ValueError) as error:
        because = f"analysis or acceptance file cannot be read: {error}"
    return JudgedRun(found, not_judged(because))


def judge_listed(listed: Sequence[IndexedRun]) -> dict[Path, JudgedRun]:
    """Every sealed run of a list; the acceptance file of each gear is read once."""
    accepted = functools.cache(acceptance_for)
    return {
        run.path: judge_stored(
            run.path,
            run.protocol,
            run.origin,
            run.outcome,
            run.gear_serial,
            part=Part(run.gear, run.ratio),
            accepted=accepted,
        )
        for run in listed
        if run.state == "sealed"
    }


def judge_file(run: Path, metadata: RunMetadata) -> GearVerdict | None:
    """The verdict on what one run measured; None for a file that is not sealed yet."""
    if run.name.endswith(".part"):
        return None
    of = (metadata.experiment, metadata.origin, metadata.outcome, metadata.gear_serial)
    return judge_stored(run, *of, part=Part.of(metadata)).verdict


def judge_newest(newest: Newest, acceptance: Acceptance | None) -> GearVerdict:
    """The verdict on the gear whose newest analysed runs these are."""
    found = [
        stored_result(
            analysis,
            run.origin,
            run.outcome,
            run.gear_serial,
            part=Part(run.gear, run.ratio),
            path=run.path,
        )
        for run, analysis in newest.runs
    ]
    return judge(found, acceptance)


def judge_runs(found: Sequence[Analysed], acceptance: Acceptance | None) -> GearVerdict:
    """The verdict on what these runs show together; one run alone owes only what it measures."""
    return judge_run(found[0], acceptance) if len(found) == 1 else judge(found, acceptance)


def not_judged(*because: str) -> GearVerdict:
    """The verdict where nothing can be held against anything, with its reasons."""
    return GearVerdict(verdict="NOT JUDGED", because=because)


def no_acceptance(serial: str, run: Path | None = None) -> str:
    """That nobody has said what a gear must show, and the command that says it of a gear with such a run."""
    folder = "" if run is None or run.parent == Path("runs") else quoted(run.parent)
    command = f"rig gear set {quoted(serial)} --by NAME --acceptance FILE"
    return f"no acceptance file is named for this gear: {command}{phrase(' --runs {}', folder)}"


def worst_of(verdicts: Sequence[VerdictOutcome]) -> VerdictOutcome:
    """The worst of several verdicts; NOT JUDGED for none."""
    for word in WORST_FIRST:
        if word in verdicts:
            return word
    return "NOT JUDGED"


def _without_limits(found: Sequence[Analysed], acceptance: Acceptance | None) -> GearVerdict:
    serial = next((one.serial for one in found if one.serial), "")
    if acceptance is not None:
        nothing = f"{acceptance.path} lists no limit"
    else:
        run = next((one.path for one in found if one.path), None)
        nothing = NO_GEAR if serial in UNNAMED else no_acceptance(serial, run)
    return replace(not_judged(nothing), stale=_stale(found))


def doubts_of(one: Analysed) -> tuple[str, ...]:
    """Why an analysis judges nothing although its numbers stand: warnings for a page that shows them."""
    doubts = [
        f"This analysis is stale: {reason}. Renew it: {one.renewed_by}." for reason in one.stale
    ]
    if one.not_in_force:
        doubts.insert(0, f"This analysis is not what everybody reads: {one.not_in_force}.")
    return tuple(doubts)


def _stale(found: Sequence[Analysed]) -> tuple[str, ...]:
    """What is stale of what was found, run by run."""
    return tuple(
        f"run {one.result.run}, {one.result.kind}: {_stale_words(one)}"
        for one in found
        if one.stale
    )


def _stale_words(one: Analysed | InForce) -> str:
    """That an analysis is stale: what changed, and the command that makes it anew."""
    return f"the analysis is stale: {'; '.join(one.stale)}. Renew it: {one.renewed_by}"


def _worst(
    limits: Sequence[Limit], found: Sequence[Analysed], acceptance: Acceptance
) -> GearVerdict:
    """The worst over these limits, with the reasons of all that are not PASS, the worst first."""
    lines = [line for limit in limits for line in _lines(limit, found, acceptance)]
    verdict = worst_of([line.outcome for line in lines])
    ranked = sorted(lines, key=lambda line: WORST_FIRST.index(line.outcome))
    because = dict.fromkeys(_reason(line) for line in ranked if line.outcome != "PASS")
    return GearVerdict(
        verdict=verdict,
        because=tuple(because),
        lines=tuple(lines),
        source=acceptance.path,
        acceptance_sha256=acceptance.sha256,
        stale=_stale(found),
        remark=acceptance.remark,
    )


def _reason(line: Verdict) -> str:
    """Why a line is not PASS: quantity, value ± U, limit and whose limit it is, or what is missing."""
    run = phrase(" (run {})", line.run)
    if line.because:
        return f"{line.name}{run}: {line.because}"
    value, limit = held_against(line)
    unsaid = phrase("; {}", line.rests_on)
    return f"{line.name}{run}: {line.outcome}, {value}, limit {limit} ({whose_limit(line)}){unsaid}"


def room_left(
    value: float, limit: float, expanded_uncertainty: float, *, is_upper: bool = True
) -> float:
    """What a value leaves of its limit, in U: below 1 its interval reaches the limit, below 0 the value breaks it."""
    return (limit - value) * (1.0 if is_upper else -1.0) / max(expanded_uncertainty, 1e-300)


def held_against(line: Verdict) -> tuple[str, str]:
    """Value ± U and limit of a line in words, both in the unit of its quantity."""
    from rig.content.wording import laboratory_unit, number, show

    estimate = line.estimate
    size = estimate.value if math.isfinite(estimate.value) else line.limit
    factor, unit = laboratory_unit(estimate.unit, size, line.quantity.shown)
    limit = f"{LIMIT_SIGNS[side_of(line)]} {number(line.limit / factor)} {unit}".rstrip()
    if not math.isfinite(estimate.value):
        return "–", limit
    return show(estimate, line.quantity).with_uncertainty, limit


def side_of(line: Verdict) -> Side:
    """Which side of a quantity a line closes."""
    return "upper" if line.is_upper else "lower"


def whose_limit(line: Verdict) -> str:
    """Whose limit it is, and the document in which it stands."""
    standing, source = line.limit_standing, line.limit_source
    return source if source.startswith(standing) else f"{standing}: {source}"


def _lines(limit: Limit, found: Sequence[Analysed], acceptance: Acceptance) -> Iterator[Verdict]:
    """A limit against everything that was found of its quantity; one line that says so where that is nothing."""
    measured = [
        (one, name) for one in found if one.result.kind == limit.kind for name in _named(limit, one)
    ]
    for one, name in measured:
        doubt = acceptance.doubt(limit, one.part, is_simulated=one.origin == "simulated")
        estimate, quantity = one.result.estimates[name], one.result.quantity(name)
        because = doubt or _lacks(one, limit, estimate, quantity)
        yield from _sides(limit, quantity, estimate, because, one.result)
    if not measured:
        quantity = limit.declared()
        because = _why_nothing(limit, found)
        ran = next((one.result for one in found if one.result.kind == limit.kind), None)
        yield from _sides(limit, quantity, _no_number(limit, quantity), because, ran)


def _named(limit: Limit, one: Analysed) -> list[str]:
    """The estimates of a result that a limit is about.

    The one of that name; every member where the limit names a family; both directions where it names
    what was found of each of them.
    """
    estimates = one.result.estimates
    if limit.name in estimates:
        return [limit.name]
    quantities = one.result.quantities
    families = {limit.name, f"{limit.name}_{{way}}"}
    return [
        name
        for name in estimates
        if (quantity := quantity_of(quantities, name)) is not None and quantity.name in families
    ]


def _lacks(one: Analysed, limit: Limit, estimate: Estimate, quantity: Quantity) -> str:
    """What an estimate lacks to be judged by a limit: a whole run, an analysis that holds, evidence, a torque of what
    the limit is about, a number; "" for nothing.
    """
    if one.outcome not in _BROUGHT_TO_THE_END:
        return f"the run ended as {one.outcome}"
    if one.stale:
        return _stale_words(one)
    checks = one.result.checks
    missing = [c.what for c in checks if c.is_evidence and c.severity is Severity.NOT_LOOKED_AT]
    if missing:
        return f"not checked: {', '.join(missing)}"
    another = _of_another_subject(one.result, limit, quantity) or one.not_in_force
    if another:
        return another
    if quantity.unit and estimate.unit != quantity.unit:
        return f"it was found in {estimate.unit}, not in {quantity.unit}"
    return lacks_number(estimate)


def _of_another_subject(result: Result, limit: Limit, quantity: Quantity) -> str:
    """That a torque, or what was fitted to torques, is not that of what the limit is about; "" where it is."""
    subject = str(result.options.get("torque_is_of", ""))
    is_of_torque = takes_tare(result.kind) or quantity.unit == "N m"
    if not is_of_torque or subject in ("", limit.subject) or subject not in get_args(Subject):
        return ""
    if subject == "gear":
        return f"the torque is that of the gear alone, the limit is on that of {limit.subject}"
    lost = ": no tare was subtracted" if takes_tare(result.kind) else ""
    return f"the torque is that of {subject}, not of the gear alone{lost}"


def _why_nothing(limit: Limit, found: Sequence[Analysed]) -> str:
    """Why there is nothing to hold against a limit."""
    if any(one.result.kind == limit.kind for one in found):
        return f"the {limit.kind} run did not find it"
    return f"no {limit.kind} run of this gear is analysed"


def _no_number(limit: Limit, quantity: Quantity) -> Estimate:
    return Estimate(
        name=limit.name,
        value=math.nan,
        unit=quantity.unit,
        low=math.nan,
        high=math.nan,
        identifiable="no",
    )


def _sides(
    limit: Limit, quantity: Quantity, estimate: Estimate, because: str, result: Result | None
) -> Iterator[Verdict]:
    """A line for each side that the limit closes."""
    for value, is_upper in ((limit.upper, True), (limit.lower, False)):
        if value is None:
            continue
        judged = outcome_against(estimate, value, is_upper=is_upper)
        yield Verdict(
            quantity=quantity,
            estimate=estimate,
            limit=value,
            limit_source=limit.source,
            limit_standing=limit.standing,
            outcome="NOT JUDGED" if because else judged,
            is_upper=is_upper,
            because=because,
            run=result.run if result is not None else "",
            kind=limit.kind,
        )
