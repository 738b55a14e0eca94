"""What the channels leave open of a number: the lines of its budget that no scatter shows.

A protocol declares of each quantity how it depends on each channel (`Quantity.rests_on`). What it does not declare is
found out: the recording is analysed again with scale, zero, curve and delay of each channel that was read moved by its
standard uncertainty, and the change of the number is the line. What the analysis has in its budget already, by cause
or by name, is not added twice.

A number whose budget holds its scatter alone, of which nothing is declared and nothing could be found out, is at most
"weakly": all its readings may be wrong together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from experiments.contract import Evidence
from experiments.evidence.channel_doubt import Doubt, Part, doubts_of
from experiments.evidence.holds import Recorded
from experiments.evidence.moved import Noting, moved
from experiments.quantity import Dependence
from experiments.recording import Recording
from experiments.result import Covariance, Result
from model.errors import WordedError
from model.identify.estimate import NORMAL_COVERAGE_FACTOR, BudgetLine, Cause, Estimate

Analyse = Callable[[Recording, Evidence], Result]

_STATISTICAL = "statistical part"
"""The line of an estimate that came with an interval and no budget."""
_ROUNDING = 1e-12
"""Share of a number by which it changes where it does not hang on a channel: the digits of the computer."""
_SCATTER_ALONE = "U holds the scatter alone"
_ZERO_LINES = ("torque zero", "zero of the effort")
"""Lines of budgets that say how well a zero is known."""
ENCODERS = {
    "input_angle": (Cause.MOTOR_ENCODER, Cause.BOTH_ENCODERS),
    "output_angle": (Cause.OUTPUT_ENCODER, Cause.BOTH_ENCODERS),
}
"""Causes of lines that say what an encoder adds."""


def analysed_with_lines(analyse: Analyse, recorded: Recorded, evidence: Evidence) -> Result:
    """The result of an analysis, every budget with what the channels leave open."""
    noting = Noting(recorded.recording.source)
    result = analyse(replace(recorded.recording, source=noting), evidence)
    estimates = {name: _declared(result, name, recorded) for name in result.estimates}
    found = _FoundOut(analyse, recorded, evidence, result, tuple(noting.names))
    for name in estimates:
        if result.quantity(name).rests_on is None:
            estimates[name] = found.with_lines(estimates[name])
    return replace(result, estimates=estimates, covariance=found.signed(result.covariance))


def changes_of(
    analyse: Analyse, recorded: Recorded, evidence: Evidence, doubt: Doubt, result: Result
) -> Mapping[str, float]:
    """By how much each number changes where a channel is wrong by one standard uncertainty, signed where it has a sign.

    Raises what the analysis raises of such a recording.
    """
    phases = (0.0, 0.5 * math.pi) if doubt.part is Part.CURVE else (0.0,)
    parts: list[dict[str, float]] = []
    for phase in phases:
        other = moved(recorded.recording, doubt.channel, doubt.part, doubt.size, phase)
        again = analyse(other.recording, evidence).estimates
        parts.append(
            {
                name: _apart(result, name, again[name].value, estimate.value) / other.by
                for name, estimate in result.estimates.items()
                if name in again
            }
        )
    if len(parts) == 1:
        return parts[0]
    # A wave of any phase: the mean square over all of them.
    return {
        n: math.hypot(parts[0][n], parts[1][n]) / math.sqrt(2.0) for n in parts[0].keys() & parts[1]
    }


def _apart(result: Result, name: str, value: float, other: float) -> float:
    """The difference of two values, on the circle by the shorter way."""
    change = value - other
    return math.remainder(change, math.tau) if result.quantity(name).is_circular else change


def lines_that_speak_of(estimate: Estimate, doubt: Doubt) -> list[BudgetLine]:
    """What the analysis itself has in its budget of what this doubt does to the number."""
    return [line for line in estimate.budget if _speaks_of(line, doubt)]


def _speaks_of(line: BudgetLine, doubt: Doubt) -> bool:
    if line.source == doubt.line.source:
        return True
    if doubt.part is Part.CURVE:
        return line.cause in ENCODERS.get(doubt.channel, ())
    if doubt.part is Part.SCALE:
        return line.cause is not None and line.cause is doubt.line.cause
    return doubt.part in (Part.OFFSET, Part.ZERO) and line.source in _ZERO_LINES


def declared_change(how: Dependence, value: float, doubt: Doubt, *, is_alike: bool) -> float:
    """By how much a number changes by its declaration; `is_alike`: it has the unit of the channel."""
    if not isinstance(how, str):
        return how(value, doubt.part, doubt.size)
    if how == "none" or doubt.part is Part.DELAY:
        return 0.0
    if doubt.part is Part.SCALE:
        return doubt.size * abs(value)
    if doubt.part is Part.CURVE:
        # A reading is off by a wave of any phase, a difference by two of them.
        return is_alike * doubt.size * (1.0 if how == "difference" else math.sqrt(0.5))
    return is_alike * doubt.size if how == "proportional" else 0.0


def _declared(result: Result, name: str, recorded: Recorded) -> Estimate:
    """An estimate with the lines that its quantity declares."""
    estimate = result.estimates[name]
    lines: list[BudgetLine] = []
    for channel, how in channels_of(result, name, recorded.recording):
        is_alike = recorded.recording.signals[channel].unit == estimate.unit
        for doubt in doubts_of(recorded, channel):
            if not lines_that_speak_of(estimate, doubt):
                lines.append(
                    doubt.of(declared_change(how, estimate.value, doubt, is_alike=is_alike))
                )
    return _with(estimate, lines)


def channels_of(
    result: Result, name: str, recording: Recording
) -> Iterator[tuple[str, Dependence]]:
    """The channels of a recording that a quantity is declared to rest on, and how."""
    for said, how in (result.quantity(name).rests_on or {}).items():
        channel = str(result.options.get(said, said))
        if recording.has(channel):
            yield channel, how


def _with(estimate: Estimate, lines: list[BudgetLine]) -> Estimate:
    """With the lines that say something; the interval of one without a budget becomes its first line."""
    nothing = _ROUNDING * abs(estimate.value)
    lines = [line for line in lines if line.standard_uncertainty > nothing]
    if lines and not estimate.budget:
        own = 0.5 * (estimate.high - estimate.low) / NORMAL_COVERAGE_FACTOR
        lines.insert(0, BudgetLine(_STATISTICAL, "A", own))
    return estimate.with_budget(lines) if lines else estimate


@dataclass
class _FoundOut:
    """What analysing again says of numbers of which nobody declared how they depend on the channels."""

    analyse: Analyse
    recorded: Recorded
    evidence: Evidence
    result: Result
    channels: tuple[str, ...]
    changes: dict[Doubt, Mapping[str, float]] = field(
        default_factory=dict[Doubt, Mapping[str, float]]
    )
    failed: dict[Doubt, str] = field(default_factory=dict[Doubt, str])

    @property
    def doubts(self) -> Iterator[Doubt]:
        """Of each channel that was read. A delay is one beside the channel that was read first."""
        first = True
        for channel in self.channels:
            doubts = doubts_of(self.recorded, channel)
            yield from (d for d in doubts if not (first and d.part is Part.DELAY))
            first = first and not doubts

    def with_lines(self, estimate: Estimate) -> Estimate:
        """The estimate with the change by each doubt that its budget does not speak of."""
        lines: list[BudgetLine] = []
        unknown = "" if self.channels else "its analysis reads no channel"
        for doubt in self.doubts:
            if lines_that_speak_of(estimate, doubt):
                continue
            change = self._change(doubt).get(estimate.name, math.nan)
            if math.isfinite(change):
                lines.append(doubt.of(change))
            else:
                why = self.failed.get(doubt, "it is no longer told")
                unknown = unknown or f"{doubt.line.source}: {why}"
        found = _with(estimate, lines)
        has_other = any(line.kind == "B" for line in found.budget)
        if found.identifiable == "yes" and unknown and not has_other:
            note = f"{_SCATTER_ALONE}; what the channels add could not be found out ({unknown})"
            return replace(found, identifiable="weakly", note=note)
        return found

    def _change(self, doubt: Doubt) -> Mapping[str, float]:
        if doubt not in self.changes:
            try:
                changes = changes_of(self.analyse, self.recorded, self.evidence, doubt, self.result)
            except (WordedError, ArithmeticError, LookupError, ValueError) as error:
                changes, self.failed[doubt] = {}, str(error).splitlines()[0]
            self.changes[doubt] = changes
        return self.changes[doubt]

    def signed(self, covariance: Covariance | None) -> Covariance | None:
        """With the vector of each scale, whose changes have signs, where all parameters were found out."""
        if covariance is None:
            return None
        scales = [d for d in self.changes if d.part is Part.SCALE and d.line.cause is not None]
        causes = [d.line.cause for d in scales]
        shared = dict(covariance.shared)
        for doubt in scales:
            cause, changes = doubt.line.cause, self.changes[doubt]
            told = all(name in changes for name in covariance.names)
            if cause is not None and told and causes.count(cause) == 1 and cause not in shared:
                shared[cause] = np.array([changes[name] for name in covariance.names])
        return replace(covariance, shared=shared)
