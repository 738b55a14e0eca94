"""One quantity over the gears of a lot: its rows, its limits, and the capability that follows from both."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.quantity import Quantity
from rig.content.wording import laboratory_unit
from rig.fleet.capability import Capability, capability
from rig.fleet.lot_rows import LotRow, declared_quantity
from rig.gears.acceptance import Acceptance, Limit

SAME = 1e-9
"""Relative difference below which two limits are one."""


@dataclass(frozen=True, kw_only=True)
class _LotLimits:
    """What a quantity must keep: SI values of its two sides, None where one is free; `note` what is doubtful of it."""

    lower: float | None = None
    upper: float | None = None
    source: str = ""
    note: str = ""
    conflict: str = ""
    """Why they are no one limit of the whole lot; empty where they are."""


@dataclass(frozen=True, kw_only=True)
class LotQuantity:
    """One quantity over the gears of a lot: a row per gear."""

    kind: str
    name: str
    quantity: Quantity
    unit: str
    rows: tuple[LotRow, ...]
    limits: _LotLimits | None
    capability: Capability | str
    """Or why there is none."""

    @property
    def title(self) -> str:
        """What people call it."""
        return self.quantity.titled(self.name)

    @functools.cached_property
    def measured(self) -> tuple[LotRow, ...]:
        """The gears for which there is a number."""
        return tuple(row for row in self.rows if row.is_measured)

    @functools.cached_property
    def shown_in(self) -> tuple[float, str]:
        """Factor and unit in which it is read: SI = factor * shown."""
        values = [abs(row.value) for row in self.measured if row.value is not None]
        limit = self.limits and (self.limits.upper or self.limits.lower)
        size = float(np.median(values)) if values else abs(limit or 1.0)
        return laboratory_unit(self.unit, size, self.quantity.shown)

    @property
    def verdicts(self) -> Mapping[str, int]:
        """How many gears have which verdict on it."""
        return Counter(row.verdict for row in self.rows if row.verdict)


def lot_quantity(rows: Sequence[LotRow], accepted: Mapping[str, Acceptance | None]) -> LotQuantity:
    first, limits = rows[0], _limits_of(rows, accepted)
    judged = [row.value for row in rows if row.is_judged and row.value is not None]
    if limits is None:
        found: Capability | str = "no limit is on it"
    elif limits.conflict:
        found = limits.conflict
    elif not judged:
        reasons = Counter(row.reason for row in rows if row.reason)
        found = f"no gear is judged: {reasons.most_common(1)[0][0] if reasons else 'no verdict'}"
    else:
        found = capability(judged, lower=limits.lower, upper=limits.upper)
    return LotQuantity(
        kind=first.kind,
        name=first.quantity,
        quantity=declared_quantity(first),
        unit=next((row.unit for row in rows if row.is_measured), first.unit),
        rows=tuple(rows),
        limits=limits,
        capability=found,
    )


def _limits_of(
    rows: Sequence[LotRow], accepted: Mapping[str, Acceptance | None]
) -> _LotLimits | None:
    """The limits by which these rows were judged, and whether their acceptance file still has them."""
    limited = [row for row in rows if row.limit_value is not None]
    if not limited:
        return None
    source = limited[0].limit_source
    lower, upper = limited[0].lower_limit, limited[0].upper_limit
    for row in limited:
        for side, here, there in (
            ("lower", row.lower_limit, lower),
            ("upper", row.upper_limit, upper),
        ):
            if not _is_same(here, there):
                conflict = f"gears were judged by different {side} limits"
                return _LotLimits(source=source, conflict=conflict)
    files = {row.acceptance for row in limited}
    named = [limit for name in files for limit in _limits_on(rows[0], accepted.get(name))]
    lowest = max((one.lower for one in named if one.lower is not None), default=None)
    highest = min((one.upper for one in named if one.upper is not None), default=None)
    note = ""
    if named and not (_is_same(lower, lowest) and _is_same(upper, highest)):
        note = "the acceptance file has changed since the runs were fitted: rig fleet fit judges them anew"
    return _LotLimits(lower=lower, upper=upper, source=source, note=note)


def _is_same(one: float | None, other: float | None) -> bool:
    """Whether one side of two limits is the same: both free, or the same value."""
    if one is None or other is None:
        return one is other
    return math.isclose(one, other, rel_tol=SAME)


def _limits_on(row: LotRow, acceptance: Acceptance | None) -> list[Limit]:
    """The limits of an acceptance file on the quantity of a row."""
    if acceptance is None:
        return []
    return [limit for limit in acceptance.limits if is_on(limit, row)]


def is_on(limit: Limit, row: LotRow) -> bool:
    """Whether a limit is on the quantity of a row: on itself, on its family, or on both directions of it."""
    named = (row.quantity, row.family)
    return limit.kind == row.kind and (limit.name in named or row.family == f"{limit.name}_{{way}}")


def quantity_as_json(one: LotQuantity) -> dict[str, object]:
    """One quantity as `rig fleet report --json` tells it."""
    found, limits = one.capability, one.limits
    told: dict[str, object] = {
        "kind": one.kind,
        "quantity": one.name,
        "unit": one.unit,
        "gears": len(one.measured),
        "lower": limits and limits.lower,
        "upper": limits and limits.upper,
        "verdicts": dict(one.verdicts),
    }
    if isinstance(found, str):
        return {**told, "capability": None, "why_no_capability": found}
    return {
        **told,
        "capability": {
            "gears": found.gears,
            "mean": found.mean,
            "standard_deviation": found.standard_deviation,
            "cp": found.potential,
            "cp_interval": found.potential_interval,
            "cpk": found.actual,
            "cpk_interval": found.actual_interval,
            "is_normal": found.is_normal,
        },
        "why_no_capability": "",
    }
