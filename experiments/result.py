"""What an analysis returns: estimates, metrics, warnings, checks, verdicts, and plots and tables as data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from experiments.errors import AnalysisError
from experiments.quantity import Quantity, quantity_of
from model.arrays import FloatArray
from model.gear import Provenance
from model.identify.estimate import Cause, Estimate

SeriesStyle = Literal["line", "points", "band", "steps", "bars"]
SeriesRole = Literal["data", "null", "limit"]
VerdictOutcome = Literal["PASS", "MARGINAL", "FAIL", "NOT JUDGED"]
CheckOutcome = Literal["ok", "widened", "refused", "not checked"]

VERIFIED_PROVENANCES: frozenset[Provenance] = frozenset(
    {"catalogue", "measured", "identified", "published"}
)
"""A limit of any other provenance is none to judge by: NOT JUDGED, never PASS or FAIL."""
WORST_FIRST: tuple[VerdictOutcome, ...] = ("FAIL", "MARGINAL", "NOT JUDGED", "PASS")


@dataclass(frozen=True, kw_only=True)
class Series:
    """One curve: x and y (n,) in the units of the plot's axes; `low`, `high` (n,) draw error bars or a band."""

    label: str
    x: FloatArray
    y: FloatArray
    style: SeriesStyle = "line"
    low: FloatArray | None = None
    high: FloatArray | None = None
    group: int = 0
    """Series of one group share a colour."""
    role: SeriesRole = "data"
    """A null model, or what was commanded, lies thin, grey and behind; a limit is a line of its own colour."""
    panel: int = 0
    """In which panel of the figure it lies; 0 is the first."""


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
                    label=way_of(sign), x=x[rows], y=y[rows], style="points", group=group, **ends
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
class Check:
    """One thing that a recording must be before anything is computed from it, and what was found of it.

    `found` and `allowed` are values with their units in words; `words` say what follows. An outcome
    of "refused" never reaches a result: it is raised. "not checked" says that the recording lacks
    what the check needs. `is_evidence`: whether a verdict needs it.
    """

    name: str
    outcome: CheckOutcome
    found: str = ""
    allowed: str = ""
    words: str = ""
    is_evidence: bool = True

    def as_json(self) -> dict[str, str | bool]:
        """Name, outcome, what was found, what is allowed, what follows, and whether a verdict needs it."""
        return {
            "name": self.name,
            "outcome": self.outcome,
            "found": self.found,
            "allowed": self.allowed,
            "words": self.words,
            "is_evidence": self.is_evidence,
        }


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One measured quantity against its limit, with U: MARGINAL when the limit lies inside value ± U (JCGM 106).

    `because` says what is missing where it is NOT JUDGED.
    """

    name: str
    definition: str
    estimate: Estimate
    limit: float
    limit_source: str
    limit_provenance: Provenance
    outcome: VerdictOutcome
    because: str = ""


def judge_upper(
    name: str,
    definition: str,
    estimate: Estimate,
    limit: float,
    provenance: Provenance,
    source: str,
) -> Verdict:
    """The verdict on a quantity that must not exceed `limit`."""
    because = _nothing_to_judge(estimate, limit, provenance)
    if because:
        outcome: VerdictOutcome = "NOT JUDGED"
    elif estimate.value + estimate.expanded_uncertainty <= limit:
        outcome = "PASS"
    elif estimate.value - estimate.expanded_uncertainty > limit:
        outcome = "FAIL"
    else:
        outcome = "MARGINAL"
    return Verdict(
        name=name,
        definition=definition,
        estimate=estimate,
        limit=limit,
        limit_source=source,
        limit_provenance=provenance,
        outcome=outcome,
        because=because,
    )


def _nothing_to_judge(estimate: Estimate, limit: float, provenance: Provenance) -> str:
    """What is missing of limit or number; "" where both are there. A U that is large is no reason."""
    if provenance not in VERIFIED_PROVENANCES or not math.isfinite(limit):
        return f"no verified limit: the limit is {provenance}"
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
    for all of them. The whole is matrix + sum of the vectors' outer products.
    """

    names: tuple[str, ...]
    matrix: FloatArray
    shared: Mapping[Cause, FloatArray] = field(default_factory=dict)

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


@dataclass(frozen=True, kw_only=True)
class Result:
    """All that one analysis found of one run; every number of it is declared by its protocol (else `AnalysisError`)."""

    run: str
    kind: str
    estimates: Mapping[str, Estimate]
    metrics: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    plots: tuple[Plot, ...] = ()
    tables: tuple[Table, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    """The conventions used: torque balance, mounting, tare or not, orders."""
    quantities: tuple[Quantity, ...] = ()
    """What its protocol declares: every estimate and every metric is one of them."""
    covariance: Covariance | None = None
    """Of the parameters that were fitted together, where they were."""
    checks: tuple[Check, ...] = ()
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

    @property
    def outcome(self) -> Literal["PASS", "MARGINAL", "FAIL"]:
        """The worst verdict; PASS where nothing was judged."""
        outcomes = {v.outcome for v in self.verdicts}
        return "FAIL" if "FAIL" in outcomes else "MARGINAL" if "MARGINAL" in outcomes else "PASS"

    @property
    def verdict(self) -> VerdictOutcome:
        """The worst of all verdicts; NOT JUDGED where there is none, or where one is missing and none is bad."""
        outcomes = {v.outcome for v in self.verdicts} or {"NOT JUDGED"}
        return next(word for word in WORST_FIRST if word in outcomes)

    @property
    def because(self) -> str:
        """Why something was not judged; "" where everything was."""
        if not self.verdicts:
            return "no limit applies to what was measured"
        reasons = dict.fromkeys(v.because for v in self.verdicts if v.because)
        return "; ".join(reasons)

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints and the analysis store keeps."""
        return {
            "run": self.run,
            "kind": self.kind,
            "parameters": {name: e.as_json() for name, e in self.estimates.items()},
            "metrics": {name: float(value) for name, value in self.metrics.items()},
            "warnings": list(self.warnings),
            "verdicts": [
                {
                    "name": v.name,
                    "definition": v.definition,
                    "value": v.estimate.value,
                    "unit": v.estimate.unit,
                    "expanded_uncertainty": v.estimate.expanded_uncertainty,
                    "limit": v.limit,
                    "limit_source": v.limit_source,
                    "limit_provenance": v.limit_provenance,
                    "outcome": v.outcome,
                    "because": v.because,
                }
                for v in self.verdicts
            ],
            "verdict": self.verdict,
            "because": self.because,
            "checks": [check.as_json() for check in self.checks],
            "options": dict(self.options),
        }
