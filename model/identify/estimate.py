"""What every fit returns: numbers with intervals, a budget, and the verdict whether the data can
identify them at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from model.identify.cause import Cause

Identifiable = Literal["yes", "weakly", "no"]

COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainty U = k u that verdicts use."""


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
