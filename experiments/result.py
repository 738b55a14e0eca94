"""What an analysis returns: estimates, metrics, warnings, checks, plots and tables as data; and one number against one
limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from experiments.assumed import rests_on
from experiments.errors import AnalysisError
from experiments.finding import Finding, Severity
from experiments.quantity import Quantity, quantity_of
from model.arrays import FloatArray, quotient
from model.identify.estimate import NOT_FROM_ZERO, Cause, Estimate

_SeriesStyle = Literal["line", "points", "band", "steps", "bars"]
SeriesRole = Literal["data", "null", "limit"]
VerdictOutcome = Literal["PASS", "MARGINAL", "FAIL", "NOT JUDGED"]
_CHECK_OUTCOMES = {
    Severity.PASSED: "ok",
    Severity.NOT_LOOKED_AT: "not checked",
    Severity.NOTES: "widened",
    Severity.WARNS: "widened",
    Severity.BLOCKS: "refused",
}
"""The words of a stored result for how a check of its recording came out."""

WORST_FIRST: tuple[VerdictOutcome, ...] = ("FAIL", "NOT JUDGED", "MARGINAL", "PASS")
DECISION_RULE = (
    "PASS: the whole of value ± U keeps the limit. FAIL: the whole of it breaks the limit. "
    "MARGINAL: the limit lies inside (JCGM 106, guard band U), or it is a lower one of a number that may be zero."
)


@dataclass(frozen=True, kw_only=True)
class Series:
    """One curve: x and y (n,) in the units of the plot's axes; `low`, `high` (n,) draw error bars or a band."""

    label: str
    x: FloatArray
    y: FloatArray
    style: _SeriesStyle = "line"
    low: FloatArray | None = None
    high: FloatArray | None = None
    group: int = 0
    """Series of one group share a colour."""
    role: SeriesRole = "data"
    """A null model, or what was commanded, lies thin, grey and behind; a limit is a line of its own colour."""
    panel: int = 0
    """In which panel of the figure it lies; 0 is the first."""

    def with_bars(self, half: FloatArray) -> Series:
        """The same with error bars of these half lengths (n,)."""
        return replace(self, low=self.y - half, high=self.y + half)


def way_of(direction: float) -> str:
    """The word for a direction of turning, by its sign."""
    return "forward" if direction > 0 else "reverse"


def both_ways(
    direction: FloatArray,
    x: FloatArray,
    y: FloatArray,
    **bars: FloatArray,
) -> list[Series]:
    """Points (n,) as a series for each direction (n,) that has any, forward first; `bars`: their `low` and `high`."""
    series: list[Series] = []
    for group, sign in enumerate((1.0, -1.0)):
        rows = direction * sign > 0.0
        if rows.any():
            ends = {name: values[rows] for name, values in bars.items()}
            series.append(
                Series(
                    label=way_of(sign),
                    x=x[rows],
                    y=y[rows],
                    style="points",
                    group=group,
                    low=ends.get("low"),
                    high=ends.get("high"),
                )
            )
    return series


@dataclass(frozen=True)
class Panel:
    """A further panel under the first one of a figure, over the same x: its axis with unit, its share of the height."""

    y_label: str
    share: float = 0.5
    """Height over that of the first panel."""


def residual_panel(unit: str) -> Panel:
    """The low panel under a figure that shows what a fit leaves."""
    return Panel(f"residual [{unit}]", 0.4)


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A figure as data: the report and the window draw it. Axis labels carry their unit. `figure` names the paper's."""

    name: str
    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    x_scale: Literal["linear", "log"] = "linear"
    y_scale: Literal["linear", "log"] = "linear"
    figure: str = ""
    note: str = ""
    panels: tuple[Panel, ...] = ()
    """Panels under the first one, in which the series of `panel` 1, 2, ... lie."""
    enlarged: tuple[float, float] | None = None
    """Range of x that paper shows once more beside the first panel, enlarged."""

    def of_panel(self, panel: int) -> tuple[Series, ...]:
        """The series of one panel."""
        return tuple(series for series in self.series if series.panel == panel)


@dataclass(frozen=True)
class Table:
    """A table as data: columns with their unit in the heading, rows of numbers or words."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[float | int | str, ...], ...]
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One measured quantity of one run against one limit, with U (JCGM 106).

    `estimate` is NaN where the run lacks the quantity; `limit_source` is the document, `limit_standing`
    says whose limit it is; `because` says what is missing where it is NOT JUDGED. `run` and `kind`
    name the analysis, empty where there is none.
    """

    quantity: Quantity
    estimate: Estimate
    limit: float
    limit_source: str
    limit_standing: str
    outcome: VerdictOutcome
    is_upper: bool = True
    because: str = ""
    run: str = ""
    kind: str = ""

    @property
    def rests_on(self) -> str:
        """What nobody stated of that on which the number rests, in words; "" where it rests on what is known."""
        return rests_on(self.estimate)

    @property
    def name(self) -> str:
        """What the quantity is called."""
        return self.quantity.titled(self.estimate.name)

    def as_json(self) -> dict[str, Any]:
        """Quantity, value with U, limit, whose limit, outcome, and what is missing."""
        return {
            "name": self.name,
            "quantity": f"{self.kind}.{self.estimate.name}",
            "run": self.run,
            "definition": self.quantity.definition,
            "value": self.estimate.value,
            "unit": self.estimate.unit,
            "expanded_uncertainty": self.estimate.expanded_uncertainty,
            "limit": self.limit,
            "limit_is": "upper" if self.is_upper else "lower",
            "limit_source": self.limit_source,
            "limit_standing": self.limit_standing,
            "outcome": self.outcome,
            "because": self.because,
            "rests_on": self.rests_on,
        }


def outcome_against(estimate: Estimate, limit: float, *, is_upper: bool = True) -> VerdictOutcome:
    """What value ± U says of a limit: kept for certain, broken for certain, or neither; see `DECISION_RULE`."""
    sign = 1.0 if is_upper else -1.0
    beyond, u = sign * (estimate.value - limit), estimate.expanded_uncertainty
    if lacks_number(estimate) or not math.isfinite(limit):
        return "NOT JUDGED"
    if beyond + u <= 0.0:
        # The length of a vector of noise is above zero: its interval is not symmetrical, and says so at its low end.
        may_be_none = estimate.low <= 0.0 or estimate.note.startswith(NOT_FROM_ZERO)
        return "MARGINAL" if may_be_none and not is_upper and limit > 0.0 else "PASS"
    return "FAIL" if beyond - u > 0.0 else "MARGINAL"


def lacks_number(estimate: Estimate) -> str:
    """Why a quantity cannot be held against anything; "" where it can. A U that is large is no reason."""
    if not (math.isfinite(estimate.value) and math.isfinite(estimate.expanded_uncertainty)):
        return "the quantity has no value with an uncertainty"
    if estimate.identifiable == "no":
        return "the data do not determine the quantity" + (estimate.note and f": {estimate.note}")
    return ""


@dataclass(frozen=True)
class Covariance:
    """Covariance of a fit's parameters, in SI; `names` are in the order of matrix and vectors.

    `matrix` (p, p) is the statistical part (type A). `shared` is type B: for each cause the change
    (p,) of the parameters by one standard deviation of its error, which is one and the same error
    for all of them. The whole is matrix + sum of the vectors' outer products. `at_bound` names the parameters that
    stopped at a bound of their search.
    """

    names: tuple[str, ...]
    matrix: FloatArray
    shared: Mapping[Cause, FloatArray] = field(default_factory=dict[Cause, FloatArray])
    at_bound: tuple[str, ...] = ()

    def correlation(self, name: str, other: str) -> float:
        """Coefficient of correlation of two parameters, statistical part; 0 where one has no variance."""
        i, j = self.names.index(name), self.names.index(other)
        size = math.sqrt(max(self.matrix[i, i] * self.matrix[j, j], 0.0))
        return quotient(float(self.matrix[i, j]), size, 0.0)

    def with_shared(self, estimates: Mapping[str, Estimate]) -> Covariance:
        """With the vectors of every cause that the budgets of these estimates name, magnitudes as they stand there."""
        shared: dict[Cause, FloatArray] = {}
        for place, name in enumerate(self.names):
            for line in estimates[name].budget if name in estimates else ():
                if line.cause is not None:
                    vector = shared.setdefault(line.cause, np.zeros(len(self.names)))
                    vector[place] = math.hypot(vector[place], line.standard_uncertainty)
        return replace(self, shared={**shared, **self.shared})

    def whole(self) -> FloatArray:
        """The covariance (p, p) with both parts."""
        parts = [np.outer(vector, vector) for vector in self.shared.values()]
        return np.asarray(sum(parts, self.matrix), dtype=np.float64)

    def as_json(self) -> dict[str, Any]:
        """Names, matrix row by row, and the shared causes."""
        return {
            "names": list(self.names),
            "matrix": self.matrix.tolist(),
            "shared": {str(cause): vector.tolist() for cause, vector in self.shared.items()},
        }


def checks_to_mapping(checks: Iterable[Finding]) -> list[dict[str, str | bool]]:
    """The checks of a recording as a stored result has kept them since 0.1.0: an analysis that is made again says the
    same to the letter.
    """
    return [_check_to_mapping(check) for check in checks]


def _check_to_mapping(check: Finding) -> dict[str, str | bool]:
    found, words = check.found, check.follows
    if check.severity is Severity.NOT_LOOKED_AT:
        found, words = "", check.found
    return {
        "name": check.what,
        "outcome": _CHECK_OUTCOMES[check.severity],
        "found": found,
        "allowed": check.allowed,
        "words": words,
        "is_evidence": check.is_evidence,
    }


def checks_from_mapping(stored: Iterable[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """The checks of a stored result. Raises `KeyError` or `ValueError` for what is none."""
    return tuple(_check_from_mapping(check) for check in stored)


def _check_from_mapping(stored: Mapping[str, Any]) -> Finding:
    severities = [s for s, word in _CHECK_OUTCOMES.items() if word == stored["outcome"]]
    if not severities:
        raise ValueError(f"outcome {stored['outcome']!r} of a check")
    severity = severities[0]
    found, words = str(stored.get("found", "")), str(stored.get("words", ""))
    if severity is Severity.NOT_LOOKED_AT:
        found, words = words, ""
    return Finding(
        str(stored["name"]),
        severity,
        found,
        allowed=str(stored.get("allowed", "")),
        follows=words,
        is_evidence=bool(stored.get("is_evidence", True)),
    )


@dataclass(frozen=True, kw_only=True)
class Result:
    """All that one analysis found of one run; every number of it is declared by its protocol (else `AnalysisError`)."""

    run: str
    kind: str
    estimates: Mapping[str, Estimate]
    metrics: Mapping[str, float] = field(default_factory=dict[str, float])
    warnings: tuple[str, ...] = ()
    plots: tuple[Plot, ...] = ()
    tables: tuple[Table, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """The conventions used: torque balance, mounting, tare or not, orders."""
    quantities: tuple[Quantity, ...] = ()
    """What its protocol declares: every estimate and every metric is one of them."""
    covariance: Covariance | None = None
    """Of the parameters that were fitted together, where they were."""
    checks: tuple[Finding, ...] = ()
    """What was looked at of the recording before anything was computed from it."""

    def __post_init__(self) -> None:
        for name in (*self.estimates, *self.metrics):
            self.quantity(name)

    def quantity(self, name: str) -> Quantity:
        """What is known of an estimate or a metric. Raises `AnalysisError` for one that is not declared."""
        quantity = quantity_of(self.quantities, name)
        if quantity is None:
            raise AnalysisError(
                "is an estimate or a metric that its protocol does not declare",
                where=f"{self.kind}.{name}",
                remedy="Add it to the protocol's quantities.",
            )
        return quantity

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints and the analysis store keeps."""
        return {
            "run": self.run,
            "kind": self.kind,
            "parameters": {name: e.as_json() for name, e in self.estimates.items()},
            "metrics": {name: float(value) for name, value in self.metrics.items()},
            "warnings": list(self.warnings),
            "checks": checks_to_mapping(self.checks),
            "options": dict(self.options),
        }
