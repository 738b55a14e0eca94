"""What every fit returns: numbers with intervals, a budget, and the verdict whether the data can
identify them at all.

A line of a budget may name what its error comes from. An error that is the same in two results
cancels in their difference (correlation one; GUM, F.1.2.3). Scatter of the data never does; it has
no cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal

Identifiable = Literal["yes", "weakly", "no"]

COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainty U = k u that verdicts use."""


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
    that is this estimate's alone.
    """

    source: str
    kind: Literal["A", "B"]
    standard_uncertainty: float
    note: str = ""
    cause: Cause | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One identified number.

    `value` in `unit` (SI); `low`, `high` the 95 % interval of the statistical part (type A; profile or autocorrelation-
    respecting); `budget` all contributions, type B included; `identifiable` the verdict, `note` why it is not "yes".
    """

    name: str
    value: float
    unit: str
    low: float
    high: float
    identifiable: Identifiable = "yes"
    note: str = ""
    budget: tuple[BudgetLine, ...] = ()

    @property
    def standard_uncertainty(self) -> float:
        """Combined standard uncertainty: root sum of squares of the budget, or a quarter of the
        interval without one.
        """
        if self.budget:
            return math.sqrt(sum(line.standard_uncertainty**2 for line in self.budget))
        return 0.25 * (self.high - self.low)

    @property
    def expanded_uncertainty(self) -> float:
        """U = k u with k = 2."""
        return COVERAGE_FACTOR * self.standard_uncertainty

    def with_budget(self, lines: Iterable[BudgetLine]) -> Estimate:
        """The same estimate with further budget lines."""
        return replace(self, budget=(*self.budget, *lines))

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
            "note": self.note,
            "budget": [
                {
                    "source": b.source,
                    "kind": b.kind,
                    "standard_uncertainty": b.standard_uncertainty,
                    "note": b.note,
                    "cause": b.cause,
                }
                for b in self.budget
            ],
        }
