"""What an analysis returns: estimates, metrics, warnings, verdicts, and plots and tables as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from experiments.errors import AnalysisError
from experiments.quantity import Quantity, quantity_of
from model.arrays import FloatArray
from model.gear import Provenance
from model.identify.estimate import Estimate

SeriesStyle = Literal["line", "points", "band", "steps", "bars"]
VerdictOutcome = Literal["PASS", "MARGINAL", "FAIL", "no verified limit"]

VERIFIED_PROVENANCES: frozenset[Provenance] = frozenset(
    {"catalogue", "measured", "identified", "published"}
)
"""A limit of any other provenance gives "no verified limit", never PASS or FAIL."""


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
    """One measured quantity against its limit, with U (k = 2): MARGINAL when the limit lies inside the interval."""

    name: str
    definition: str
    estimate: Estimate
    limit: float
    limit_source: str
    limit_provenance: Provenance
    outcome: VerdictOutcome


def judge_upper(
    name: str,
    definition: str,
    estimate: Estimate,
    limit: float,
    provenance: Provenance,
    source: str,
) -> Verdict:
    """The verdict on a quantity that must not exceed `limit`."""
    if provenance not in VERIFIED_PROVENANCES:
        outcome: VerdictOutcome = "no verified limit"
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
    )


@dataclass(frozen=True)
class Covariance:
    """Covariance (p, p) of the statistical part (type A) of a fit's parameters, in SI; `names` are in its order."""

    names: tuple[str, ...]
    matrix: FloatArray

    def as_json(self) -> dict[str, Any]:
        """Names and matrix, row by row."""
        return {"names": list(self.names), "matrix": self.matrix.tolist()}


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
                }
                for v in self.verdicts
            ],
            "options": dict(self.options),
        }
