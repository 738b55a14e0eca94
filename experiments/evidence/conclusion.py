"""What a result may claim after its recording has passed the table of checks.

*Identifiable* says that the data decided: not a bound, not the start of a search, not the sampling.
A number whose U is larger than what its quantity declares as useful, or than half of itself where
nothing is declared, is at most "weakly"; one that cannot be told from zero, signed or not, says
below which value it lies.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace

from experiments.assumed import rests_on
from experiments.budget import timed
from experiments.contract import Evidence, Experiment
from experiments.evidence import inertia, rotary_ratio
from experiments.evidence.channel_lines import analysed_with_lines
from experiments.evidence.holds import Recorded
from experiments.evidence.orders import sampled, sampled_angle
from experiments.evidence.table import checks_of
from experiments.finding import Finding, Severity
from experiments.ladder import Sample
from experiments.load import carrying
from experiments.quantity import Quantity
from experiments.recording import Recording
from experiments.result import Result, Table, checks_to_mapping
from experiments.setting import EVERY_KIND, check_values
from model.arrays import quotient
from model.identify.estimate import NOT_FROM_ZERO, Estimate
from model.identify.orders.aliases import SamplingWindow
from model.unit_text import amount_in_words

LARGEST_CORRELATION = 0.1
"""Correlation with a parameter on its bound above which a number is not called identified.

Nobody knows how far beyond the bound that parameter would have gone, and near the bound its own uncertainty looks
small. Of curves of friction that were drawn with a shape out of reach, Coulomb friction at a correlation of 0.27 to
0.44 was up to eight U off.
"""
LARGEST_SHARE = 0.5
"""U as a share of the value above which a number is not called identified, where no target is declared."""
REFERENCE = "_at_20_degrees"
"""Ending of the names of values that were brought to 20 degC: they hang on what they were made of."""
ORDER = "order"
"""The placeholder of quantities that are a family of orders."""


def checked_analysis(experiment: Experiment) -> Callable[[Recording, Evidence], Result]:
    """The analysis of a protocol after the checks, with their outcome in its result."""
    analyse = experiment.analyse

    @functools.wraps(analyse)
    def checked(recording: Recording, evidence: Evidence) -> Result:
        recorded = _recorded(experiment, recording, evidence)
        passed = checks_of(recorded)
        recorded = inertia.widened(recorded)
        result = analysed_with_lines(analyse, recorded, passed)
        return concluded(result, passed.checks, recorded)

    return checked


def checked_sample(
    experiment: Experiment, sample: Callable[[Recording, Evidence], Sample]
) -> Callable[[Recording, Evidence], Sample]:
    """What a run shows to a ladder of models, after the checks of its protocol."""

    def checked(recording: Recording, evidence: Evidence) -> Sample:
        return sample(recording, checks_of(_recorded(experiment, recording, evidence)))

    return checked


def _recorded(experiment: Experiment, recording: Recording, evidence: Evidence) -> Recorded:
    """What is to be analysed; its gear carries what was stated with the recording.

    Raises `SettingError` for a value that its setting can't have.
    """
    check_values(evidence.settings, (*experiment.settings, *EVERY_KIND), experiment.name)
    gear = carrying(recording, evidence.gear)
    return Recorded(recording, experiment, replace(evidence, gear=gear))


def concluded(result: Result, checks: tuple[Finding, ...], recorded: Recorded) -> Result:
    """A result with the checks of its recording, its covariance whole, nothing called more than it is."""
    covariance = result.covariance
    angle = functools.cache(lambda: sampled_angle(recorded))
    ratio = rotary_ratio(recorded.recording, math.nan)
    estimates = {
        name: _called(
            result.quantity(name), timed(estimate, recorded.recording), name, angle, ratio
        )
        for name, estimate in result.estimates.items()
    }
    estimates = _beside_bounds(estimates, result)
    return replace(
        result,
        estimates=estimates,
        checks=checks,
        tables=(*result.tables, _table(checks)) if checks else result.tables,
        warnings=(*result.warnings, *(c.follows for c in checks if c.severity is Severity.NOTES)),
        covariance=covariance and covariance.with_shared(result.estimates),
    )


def _beside_bounds(estimates: dict[str, Estimate], result: Result) -> dict[str, Estimate]:
    """The estimates, none of them called identified that hangs on a parameter at its bound."""
    notes = _notes_of_bounds(result)
    return estimates | {
        name: _weakly(estimate, notes[stem])
        for name, estimate in estimates.items()
        if (stem := name.partition(REFERENCE)[0]) in notes and estimate.identifiable == "yes"
    }


def _notes_of_bounds(result: Result) -> dict[str, str]:
    """By parameter, why it is not identified: it stopped at its bound, or it hangs on one that did."""
    covariance = result.covariance
    notes: dict[str, str] = {}
    if covariance is None:
        return notes
    for bound in covariance.at_bound:
        for name in covariance.names:
            r = covariance.correlation(name, bound)
            if name != bound and abs(r) > LARGEST_CORRELATION:
                title = result.quantity(bound).titled(bound)
                notes.setdefault(
                    name, f"correlated {r:.2f} with {title}, which stopped at its bound"
                )
        notes[bound] = "stopped at its bound"
    return notes


def _table(checks: tuple[Finding, ...]) -> Table:
    """The checks as people read them."""
    keys = ("name", "outcome", "found", "allowed", "words")
    rows = tuple(tuple(check[key] for key in keys) for check in checks_to_mapping(checks))
    columns = ("check", "outcome", "found", "allowed", "remark")
    return Table("checks", "What was checked before anything was computed", columns, rows)


def _called(
    quantity: Quantity,
    estimate: Estimate,
    name: str,
    angle: Callable[[], SamplingWindow],
    ratio: float,
) -> Estimate:
    """The estimate, called identified only where sampling and the data decided."""
    order = _order(quantity.member(name)) if quantity.placeholder == ORDER else None
    if order is not None:
        estimate = sampled(estimate, order, angle(), ratio)
    if estimate.identifiable == "yes":
        return judged(quantity, estimate)
    if estimate.note.startswith(NOT_FROM_ZERO) and not quantity.is_circular:
        # What the fit said of it was before the lines that came after it.
        return replace(estimate, note=_below_words(quantity, estimate))
    return estimate


def _words(quantity: Quantity, estimate: Estimate, amount: float) -> str:
    size = max(abs(estimate.value), estimate.expanded_uncertainty)
    return amount_in_words(amount, estimate.unit, size, quantity.shown)


def _below_words(quantity: Quantity, estimate: Estimate) -> str:
    largest = abs(estimate.value) + estimate.expanded_uncertainty
    return f"{NOT_FROM_ZERO}, below {_words(quantity, estimate, largest)}"


def judged(quantity: Quantity, estimate: Estimate) -> Estimate:
    """What a number may be called by its U alone: one rule for every quantity of every kind.

    An interval that holds zero says only below which size the number lies. That is "yes" where a target is declared in
    its own unit and U keeps it. On a circle zero is a place like any other.
    """
    u = estimate.expanded_uncertainty
    if not (math.isfinite(estimate.value) and math.isfinite(u)):
        return replace(estimate, identifiable="no", note="no value with an uncertainty")

    target = quantity.target_for(estimate.value, estimate.unit)
    is_within_target = target is not None and u <= target
    if abs(estimate.value) <= u and quantity.is_above_zero:
        note = (
            f"must be above zero, and U of {_words(quantity, estimate, u)} reaches it: not measured"
        )
        return replace(estimate, identifiable="no", note=note)
    if abs(estimate.value) <= u and not quantity.is_circular:
        note = _below_words(quantity, estimate)
        estimate = replace(estimate, note=note)
        return _not_on_assumed(estimate) if is_within_target else _weakly(estimate, note)
    if target is not None and not is_within_target:
        return _weakly(estimate, f"U is above {_words(quantity, estimate, target)}")
    share = quotient(u, abs(estimate.value), 0.0)
    if target is None and share > LARGEST_SHARE and not quantity.is_circular:
        return _weakly(estimate, f"U is {100.0 * share:.0f} % of the value")
    return _not_on_assumed(estimate)


def _not_on_assumed(estimate: Estimate) -> Estimate:
    """The estimate, "weakly" where most of its U is of values that nobody stated."""
    unsaid = rests_on(estimate)
    if not unsaid:
        return estimate
    return _weakly(estimate, "; ".join(n for n in (estimate.note, unsaid) if n))


def _order(member: str) -> float | None:
    """The order that a name of a family speaks of."""
    try:
        return float(member.replace("_", "."))
    except ValueError:
        return None


def _weakly(estimate: Estimate, note: str) -> Estimate:
    return replace(estimate, identifiable="weakly", note=note)
