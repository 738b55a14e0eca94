"""What every fit returns: numbers with intervals, a budget, and the verdict whether the data can
identify them at all.

A line of a budget may name what its error comes from. An error that is the same in two results
cancels in their difference (correlation one; GUM, F.1.2.3). Scatter of the data never does; it has
no cause.

    u^2 = sum u_i^2,   nu = u^4 / sum(u_i^4 / nu_i),   U = k u   with k = t_95(nu)

nu are the degrees of freedom by Welch and Satterthwaite, t_95 is the two-sided quantile of
Student's t at 95 % (GUM, annex G; JCGM 100:2008): 2.57 at five degrees of freedom, 1.96 without end.
Where one line has more than 0.8 of u the sum has the shape of that line, and k is that of its
distribution with the rest (`model/identify/convolution.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

from model.identify.distribution import Distribution

Identifiable = Literal["yes", "weakly", "no"]

NORMAL_COVERAGE_FACTOR = 1.959963984540054
"""k of U = k u at 95 % where the degrees of freedom have no end."""
NOT_FROM_ZERO = "not distinguishable from zero"
"""How the note begins of a number whose interval holds zero; below which size it lies follows."""
DOMINANT = 0.8
"""Share of the combined standard uncertainty from which on one line alone gives the sum its shape."""


class Ground(StrEnum):
    """Something that a result rests on and that another result may rest on too."""

    TORQUE_CHANNEL = "torque channel"
    TARE = "tare"
    PARAMETER_SET = "parameter set"
    OUTPUT_ENCODER = "output encoder as mounted"
    MOTOR_ENCODER = "motor encoder as mounted"


class Cause(StrEnum):
    """Where an error comes from that two results may share."""

    TORQUE_SCALE = "torque scale"
    TARE = "tare"
    BEARING_TORQUE = "bearing torque"
    OUTPUT_ENCODER = "output encoder"
    MOTOR_ENCODER = "motor encoder"
    BOTH_ENCODERS = "both encoders"

    @property
    def grounds(self) -> frozenset[Ground]:
        """What must be the same for the error to be the same."""
        return _GROUNDS[self]


_GROUNDS: Mapping[Cause, frozenset[Ground]] = {
    Cause.TORQUE_SCALE: frozenset({Ground.TORQUE_CHANNEL}),
    Cause.TARE: frozenset({Ground.TORQUE_CHANNEL, Ground.TARE}),
    Cause.BEARING_TORQUE: frozenset({Ground.PARAMETER_SET}),
    Cause.OUTPUT_ENCODER: frozenset({Ground.OUTPUT_ENCODER}),
    Cause.MOTOR_ENCODER: frozenset({Ground.MOTOR_ENCODER}),
    Cause.BOTH_ENCODERS: frozenset({Ground.OUTPUT_ENCODER, Ground.MOTOR_ENCODER}),
}


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """One contribution to an uncertainty budget: its kind (A from the data, B from elsewhere), u in
    the estimate's unit.

    `source` says in words what it is; `cause` names an error that other results may share, None one
    that is this estimate's alone. `degrees_of_freedom` of u: of the data it was computed from for
    type A; without end where u is taken for exact, as type B lines are unless somebody says how
    well they are known. `assumed` names the kind of value that nobody gave, whose line it is
    (`experiments.assumed`); "" for what somebody stated or the data say. `distribution`: what is
    known of the error's shape; it counts where the line has most of the uncertainty.
    """

    source: str
    kind: Literal["A", "B"]
    standard_uncertainty: float
    note: str = ""
    cause: Cause | None = None
    degrees_of_freedom: float = math.inf
    assumed: str = ""
    distribution: Distribution = Distribution.NORMAL


def effective_degrees_of_freedom(lines: Iterable[BudgetLine]) -> float:
    """Degrees of freedom of the root sum of squares of these lines (Welch, Satterthwaite); infinite for none.

    A line whose u is infinite, or that has no degree of freedom, decides alone: beside it the others are nothing.
    """
    counted = [line for line in lines if line.standard_uncertainty != 0.0]
    alone = [
        line.degrees_of_freedom
        for line in counted
        if math.isinf(line.standard_uncertainty) or line.degrees_of_freedom <= 0.0
    ]
    if alone:
        return min(alone)
    square = fourth = 0.0
    for line in counted:
        square += line.standard_uncertainty**2
        fourth += line.standard_uncertainty**4 / line.degrees_of_freedom
    return square**2 / fourth if fourth > 0.0 else math.inf


def open_ends(low: float, high: float) -> tuple[float, float]:
    """The ends of a profile's interval of what is above zero: one that the data do not bound is 0 or infinite."""
    return (low if math.isfinite(low) else 0.0), (high if math.isfinite(high) else math.inf)


def coverage_factor(degrees_of_freedom: float) -> float:
    """k of U = k u at 95 %, from Student's t; infinite without a degree of freedom: then u says nothing."""
    if degrees_of_freedom <= 0.0:
        return math.inf
    # A list of runs reads estimates and computes none: it does not pay for SciPy.
    from model.identify.least_squares import student_quantile

    # NaN is of a line that could not be computed: then U is NaN by its u, whatever k is.
    finite = degrees_of_freedom < math.inf
    return student_quantile(degrees_of_freedom) if finite else NORMAL_COVERAGE_FACTOR


def coverage_factor_of(lines: Sequence[BudgetLine]) -> float:
    """k of U = k u at 95 % of a sum of these contributions: by their degrees of freedom, or by the shape of the one
    that has more than `DOMINANT` of u.
    """
    largest = max(lines, key=lambda line: line.standard_uncertainty, default=None)
    whole = math.sqrt(sum(line.standard_uncertainty**2 for line in lines))
    freedom = effective_degrees_of_freedom(lines)
    # NaN fails the comparison: what could not be computed has no shape.
    if largest is None or freedom <= 0.0 or not 0.0 < whole < math.inf:
        return coverage_factor(freedom)
    share = largest.standard_uncertainty / whole
    rest = effective_degrees_of_freedom([line for line in lines if line is not largest])
    own = largest.degrees_of_freedom
    is_normal = largest.distribution is Distribution.NORMAL
    # For a normal error whose u is known the formula of Welch and Satterthwaite is right: 95.0 % of drawn sums.
    if share <= DOMINANT or (is_normal and math.isinf(own)):
        return coverage_factor(freedom)
    from model.identify.convolution import dominated_factor

    # Rounded, so that numbers of one kind share what was computed.
    return dominated_factor(
        largest.distribution,
        max(own, 1.0) if is_normal else math.inf,
        round(share, 3),
        max(round(rest, 1), 1.0),
    )


def _countable(degrees_of_freedom: float) -> float | None:
    """Degrees of freedom as JSON can hold them: null where they have no end."""
    return degrees_of_freedom if degrees_of_freedom < math.inf else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One identified number.

    `value` in `unit` (SI); `low`, `high` the 95 % interval of the statistical part (type A; profile or autocorrelation-
    respecting); `budget` all contributions, type B included; `identifiable` the verdict, `note` why it is not "yes".
    `stated_coverage_factor` is the k that a stored result was stated with; None: from its budget.
    """

    name: str
    value: float
    unit: str
    low: float
    high: float
    identifiable: Identifiable = "yes"
    note: str = ""
    budget: tuple[BudgetLine, ...] = ()
    stated_coverage_factor: float | None = field(default=None, compare=False)

    @classmethod
    def about(
        cls,
        name: str,
        value: float,
        half: float,
        unit: str,
        budget: tuple[BudgetLine, ...] = (),
        *,
        identifiable: Identifiable = "yes",
        note: str = "",
    ) -> Estimate:
        """A value in the middle of its interval, with half the width of that."""
        return cls(
            name=name,
            value=value,
            unit=unit,
            low=value - half,
            high=value + half,
            identifiable=identifiable,
            note=note,
            budget=budget,
        )

    @property
    def standard_uncertainty(self) -> float:
        """Combined standard uncertainty: root sum of squares of the budget; that of the interval without one."""
        if self.budget:
            return math.sqrt(sum(line.standard_uncertainty**2 for line in self.budget))
        return 0.5 * (self.high - self.low) / self.coverage_factor

    @property
    def degrees_of_freedom(self) -> float:
        """Effective degrees of freedom of the combined standard uncertainty (Welch, Satterthwaite)."""
        return effective_degrees_of_freedom(self.budget)

    @property
    def coverage_factor(self) -> float:
        """k of U = k u at 95 %: by the effective degrees of freedom, or by the shape of a dominant line."""
        if self.stated_coverage_factor is not None:
            return self.stated_coverage_factor
        return coverage_factor_of(self.budget)

    @property
    def expanded_uncertainty(self) -> float:
        """U = k u: the interval value ± U holds the measurand with 95 %."""
        return self.coverage_factor * self.standard_uncertainty

    def with_budget(self, lines: Iterable[BudgetLine]) -> Estimate:
        """The same estimate with further budget lines, which decide on k anew."""
        return replace(self, budget=(*self.budget, *lines), stated_coverage_factor=None)

    def as_json(self) -> dict[str, object]:
        """value, unit, low, high, identifiable: the form of `--json`; plus expanded uncertainty, note and budget."""
        return {
            "value": self.value,
            "unit": self.unit,
            "low": self.low,
            "high": self.high,
            "identifiable": self.identifiable == "yes",
            "identifiability": self.identifiable,
            "expanded_uncertainty": self.expanded_uncertainty,
            "coverage_factor": self.coverage_factor,
            "degrees_of_freedom": _countable(self.degrees_of_freedom),
            "note": self.note,
            "budget": [
                {
                    "source": b.source,
                    "kind": b.kind,
                    "standard_uncertainty": b.standard_uncertainty,
                    "note": b.note,
                    "cause": b.cause,
                    "degrees_of_freedom": _countable(b.degrees_of_freedom),
                    **({"assumed": b.assumed} if b.assumed else {}),
                    "distribution": b.distribution,
                }
                for b in self.budget
            ],
        }
