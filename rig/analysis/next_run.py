"""What to run next: which line of a budget keeps a number from its verdict, who can lower it, and what U becomes.

    V = sum of u_i^2 ,   F = sum of f_i u_i^2 ,   U(n) = k_n sqrt(F/n + V - F)

for n times the visits, with k_n by n times the degrees of freedom; f is the share of a line's u^2 that falls with the
visits: all of what scatters within the run and nothing of type B, but for what `FALLING` names. What a line that does
not fall would have to be for the wanted U is

    u_needed = sqrt((U_wanted/k)^2 - (V - u_line^2))

Where the largest line is of type B, and scatter has not half of V, no run helps, and the calibration that does is named
with the size it must have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from experiments import catalogue
from experiments.parameters import parameter_fields
from experiments.quantity import Quantity
from experiments.result import Verdict
from model.identify.estimate import BudgetLine, Cause, Estimate, coverage_factor_of
from rig.analysis.number_or_none import finite
from rig.content.wording import decimals_of, fixed, laboratory_unit, number

_Helps = Literal["nothing needed", "visits", "other days", "calibration", "nothing"]

_HALF = 0.5
_MOST_VISITS = 50
"""Times as many visits from which on more of them are no advice."""
_ENOUGH = 1.0001
"""By how much U may miss what is wanted and still be it: rounding."""
_TOLD_FROM_ZERO = 0.45
"""U over a number from which on it is told from zero: 4.3 standard uncertainties, which noise exceeds once in ten
thousand orders."""
_REPEATS = "repeats"
FALLING: Mapping[str, float] = {
    "scatter between revolutions and points": 0.86,
    "vibration near resonances": 1.0,
}
"""Of u^2 of a line of the friction run, what falls with the visits where that is not all of scatter, nothing of type B.

The scatter between the speeds of a run stays. Where the visits are many, the speeds near a resonance weigh less. Found
on 24 simulated gears (seeds 33304 to 33327) at three to seven times the visits; by it what comes is 0.99 of what is
said in the median, from 0.82 to 1.08."""


_BY_CAUSE: dict[Cause, str] = {
    Cause.TORQUE_SCALE: "calibrate the torque channel (scale_relative_uncertainty in rig.toml)",
    Cause.TARE: "make a longer motor tare",
    Cause.BEARING_TORQUE: "measure the no-load torque of the bench's bearing ([output_bearing] in rig.toml)",
    Cause.OUTPUT_ENCODER: "have the output encoder certified (its curve in [counter.calibration])",
    Cause.MOTOR_ENCODER: "have the motor encoder certified (its curve in [motor_encoder.calibration])",
    Cause.BOTH_ENCODERS: "have both encoders certified (their curves in rig.toml)",
}
NOT_REPEATED = "tare, not repeated"
_BY_SOURCE: Mapping[str, str] = {
    NOT_REPEATED: "take two more motor tares of this bench (rig run motor-tare), and fit again"
}
"""Of a line that one thing alone lowers, whatever its cause."""
_BY_WORD: tuple[tuple[str, str], ...] = (
    ("torque scale", _BY_CAUSE[Cause.TORQUE_SCALE]),
    ("output encoder", _BY_CAUSE[Cause.OUTPUT_ENCODER]),
    ("motor encoder", _BY_CAUSE[Cause.MOTOR_ENCODER]),
    ("output bearing", _BY_CAUSE[Cause.BEARING_TORQUE]),
    ("bearing", _BY_CAUSE[Cause.BEARING_TORQUE]),
    ("thermometer", "calibrate the thermometer of the housing"),
    ("temperature", "fit the temperature coefficients of this gear from runs at two temperatures"),
    ("warmth", "record the temperature of motor and housing, and warm up longer"),
    ("eccentricity", "measure in three mountings or more"),
    ("lag", "state the lag of the channel with its uncertainty (rig.toml, or --lag)"),
    ("delay", "state the delay of the torque port with its uncertainty"),
    ("inertia", "weigh and measure the load, or have its inertia certified"),
)
"""Words of a line of type B, and what lowers it; the first that fits."""
_OTHER_DAYS = "from run to run"
_MORE: Mapping[_Helps, str] = {
    "visits": "as many visits",
    "other days": "runs on other days, and their mean,",
}
"""Of what more helps, in words."""


@dataclass(frozen=True, kw_only=True)
class Advice:
    """What lowers U of one number. `line` is the largest of its budget with its `share` of U^2; `wanted` is the U that
    would decide, `becomes` the U that the advice leads to (None where nothing does), all in `unit` (SI).

    `times` is how many times the visits, or other days, are needed; `needed` what u of the line must become.
    """

    quantity: str
    title: str
    kind: str
    run: str
    value: float
    expanded_uncertainty: float
    unit: str
    wanted: float
    line: str
    share: float
    type_b_share: float
    helps: _Helps
    becomes: float | None
    times: int | None
    needed: float | None
    sentence: str
    parameters: dict[str, int]
    """Of the run that helps."""

    def as_json(self) -> dict[str, Any]:
        """One line of `rig next --json`."""
        return dict(vars(self))


def wanted_by(verdict: Verdict) -> float | None:
    """U below which a limit would be decided: the distance to it, or where that is large enough, what tells the number
    from zero; None where it is decided or not judged.
    """
    estimate = verdict.estimate
    if verdict.outcome != "MARGINAL" or not math.isfinite(estimate.expanded_uncertainty):
        return None
    away = abs(estimate.value - verdict.limit)
    if away >= estimate.expanded_uncertainty:
        away = min(away, _TOLD_FROM_ZERO * abs(estimate.value))
    return finite(away)


def next_step_of(verdict: Verdict) -> str:
    """What decides a limit that is MARGINAL, in a sentence; "" for every other one."""
    wanted = wanted_by(verdict)
    if not wanted:
        return ""
    return advice(
        verdict.estimate, verdict.quantity, Of(verdict.kind, verdict.run), wanted
    ).sentence


@dataclass(frozen=True)
class Of:
    """Of which analysis a number is, and the parameters of its run."""

    kind: str
    run: str
    parameters: Mapping[str, Any] = field(default_factory=dict)


def advice(estimate: Estimate, quantity: Quantity, of: Of, wanted: float) -> Advice:
    """What lowers U of one number to `wanted` (its SI unit)."""
    lines = merged(estimate)
    whole = sum(line.standard_uncertainty**2 for line in lines)
    largest = lines[0]
    scatter = sum(line.standard_uncertainty**2 for line in lines if line.kind == "A")
    found = _remedy_for(lines, wanted)
    times, needed = found.times, found.needed
    repeats = _repeats(of.kind, of.parameters)
    is_enough = found.becomes is not None and found.becomes <= wanted * _ENOUGH
    is_run = found.helps == "visits" and is_enough
    changed = {_REPEATS: repeats * times} if is_run and repeats and times else {}
    made = Advice(
        quantity=f"{of.kind}.{estimate.name}",
        title=quantity.titled(estimate.name),
        kind=of.kind,
        run=of.run,
        value=estimate.value,
        expanded_uncertainty=estimate.expanded_uncertainty,
        unit=estimate.unit,
        wanted=wanted,
        line=largest.source,
        share=largest.standard_uncertainty**2 / whole,
        type_b_share=1.0 - scatter / whole,
        helps=found.helps,
        becomes=found.becomes,
        times=times,
        needed=needed,
        sentence="",
        parameters=changed,
    )
    shown = laboratory_unit(estimate.unit, abs(estimate.value), quantity.shown)
    return replace(made, sentence=_sentence(made, largest, shown))


def merged(estimate: Estimate) -> list[BudgetLine]:
    """The lines of a budget, the largest first; what has no budget has its interval as one."""
    lines = [line for line in estimate.budget if line.standard_uncertainty > 0.0]
    if not lines:
        lines = [BudgetLine("interval of the fit", "A", estimate.expanded_uncertainty / 2.0)]
    return sorted(lines, key=lambda line: -line.standard_uncertainty)


@dataclass(frozen=True)
class _Remedy:
    """What helps: how many times, what u the line must become, and U of the whole after it."""

    helps: _Helps
    times: int | None = None
    needed: float | None = None
    becomes: float | None = None


def _remedy_for(lines: list[BudgetLine], wanted: float) -> _Remedy:
    """What brings U of these lines, the largest first, to `wanted`."""
    now = _expanded(lines)
    if wanted >= now:
        return _Remedy("nothing needed", becomes=now)
    largest = lines[0]
    squares = [line.standard_uncertainty**2 for line in lines]
    scatter = sum(u2 for u2, line in zip(squares, lines, strict=True) if line.kind == "A")
    if largest.kind == "A" or scatter > _HALF * sum(squares):
        return _by_repeating("visits", [_falling(line) for line in lines], lines, wanted)
    if largest.source.startswith(_OTHER_DAYS):
        return _by_repeating(
            "other days", [float(line is largest) for line in lines], lines, wanted
        )
    if _remedy_of(largest) is None:
        return _Remedy("nothing")
    needed = _needed(lines, wanted)
    after = [replace(largest, standard_uncertainty=needed), *lines[1:]]
    return _Remedy("calibration", needed=needed, becomes=_expanded(after))


def _expanded(lines: Sequence[BudgetLine]) -> float:
    """U of these lines."""
    return coverage_factor_of(lines) * math.sqrt(sum(x.standard_uncertainty**2 for x in lines))


def _falling(line: BudgetLine) -> float:
    """The share of a line's u^2 that falls with the visits."""
    return FALLING.get(line.source, float(line.kind == "A"))


def _repeated(line: BudgetLine, share: float, times: int) -> BudgetLine:
    """A line of which `share` of u^2 falls, after so many times as many visits."""
    if not share:
        return line
    return replace(
        line,
        standard_uncertainty=line.standard_uncertainty * math.sqrt(share / times + 1.0 - share),
        degrees_of_freedom=times * line.degrees_of_freedom,
    )


def _by_repeating(
    helps: _Helps, falling: Sequence[float], lines: Sequence[BudgetLine], wanted: float
) -> _Remedy:
    """The fewest times at which U is small enough; what is seen n times as often is known n times as well.

    `falling` is for each line the share of its u^2 that falls.
    """
    becomes = math.inf
    for times in range(2, _MOST_VISITS + 1):
        after = [_repeated(line, share, times) for line, share in zip(lines, falling, strict=True)]
        becomes = _expanded(after)
        if becomes <= wanted:
            return _Remedy(helps, times=times, becomes=becomes)
    return _Remedy(helps, times=_MOST_VISITS, becomes=becomes)


def _needed(lines: Sequence[BudgetLine], wanted: float) -> float:
    """u of the largest line at which U is as wanted, by halving, as k depends on it; 0 where U is larger without it."""
    largest, *rest = lines

    def too_large(u: float) -> bool:
        return _expanded([replace(largest, standard_uncertainty=u), *rest]) > wanted

    if rest and too_large(0.0):
        return 0.0
    low, high = 0.0, largest.standard_uncertainty
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if too_large(middle) else (middle, high)
    return low


def _remedy_of(line: BudgetLine) -> str | None:
    """Who can lower a line of type B; None where nobody can: it is the method's own."""
    if line.assumed:
        # What nobody gave has its remedy where it is assumed.
        return f"state what is assumed ({line.note.partition('Give it: ')[2]})"
    if line.source in _BY_SOURCE:
        return _BY_SOURCE[line.source]
    if line.cause is not None:
        return _BY_CAUSE[line.cause]
    return next((remedy for word, remedy in _BY_WORD if word in line.source), None)


def _repeats(kind: str, parameters: Mapping[str, Any]) -> int | None:
    """How often the whole measurement was repeated; None for a protocol that cannot."""
    fields = {field.name: field for field in parameter_fields(catalogue.load(kind).parameters)}
    if _REPEATS not in fields:
        return None
    return int(parameters.get(_REPEATS, fields[_REPEATS].default))


def _sentence(one: Advice, largest: BudgetLine, shown: tuple[float, str]) -> str:
    """The advice in a sentence."""
    factor, unit = shown

    def text(value: float) -> str:
        decimals = decimals_of(value / factor)
        digits = number(value / factor) if decimals is None else fixed(value / factor, decimals)
        return f"{digits} {unit}".rstrip()

    now = f"{one.title}: U {text(one.expanded_uncertainty)}, wanted {text(one.wanted)}"
    if one.helps == "nothing needed":
        return f"{now}. Nothing is needed."
    named = f"{100.0 * one.share:.0f} % of U² is {one.line}"
    if what := _MORE.get(one.helps, ""):
        assert one.becomes is not None
        enough = "" if one.becomes <= one.wanted * _ENOUGH else ", which is not enough"
        return (
            f"{now}. {named}: {one.times} times {what} make U {text(one.becomes)}{enough}.".replace(
                "times runs", "runs"
            )
        )
    if one.helps == "nothing":
        return f"{now}. {named}, which belongs to the method: no run helps, and no calibration."
    remedy = _remedy_of(largest)
    none = "no run with the gear on" if largest.source in _BY_SOURCE else "no run"
    assert one.becomes is not None
    if not one.needed:
        best = f"which alone makes U {text(one.becomes)} at best, and is not enough"
        return f"{now}. {named}: {none} helps; {remedy}, {best}."
    now_u, then = largest.standard_uncertainty, one.needed
    return (
        f"{now}. {named}: {none} helps; {remedy}. Its u must fall to {100.0 * then / now_u:.0f} % of what it is; "
        f"then U is {text(one.becomes)}."
    )
