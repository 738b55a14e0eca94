"""Numbers of a lot in words: one unit and one number of decimals for each quantity."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.analysis.judging import LIMIT_SIGNS
from rig.content.wording import decimals_of, fixed, number

if TYPE_CHECKING:
    from rig.fleet.capability import Interval
    from rig.fleet.lot_quantity import LotQuantity
    from rig.fleet.lot_rows import LotRow


def value_words(row: LotRow, one: LotQuantity) -> str:
    """Value ± U with its unit."""
    factor, unit = one.shown_in
    if row.value is None:
        return "–"
    decimals = decimals_of((row.expanded_uncertainty or 0.0) / factor)
    if decimals is None:
        return f"{number(row.value / factor)} {unit}".rstrip()
    assert row.expanded_uncertainty is not None
    value, doubt = (
        fixed(row.value / factor, decimals),
        fixed(row.expanded_uncertainty / factor, decimals),
    )
    return f"{value} ± {doubt} {unit}".rstrip()


def limit_words(row: LotRow, one: LotQuantity) -> str:
    """The limit of a row with its unit."""
    factor, unit = one.shown_in
    if row.limit_value is None:
        return "–"
    return f"{LIMIT_SIGNS[row.limit_is]} {number(row.limit_value / factor)} {unit}".rstrip()


def limits_words(one: LotQuantity) -> str:
    """Both sides of a quantity's limits in the unit in which it is read, without it; "" without limits."""
    if one.limits is None:
        return ""
    factor, _ = one.shown_in
    lower, upper = one.limits.lower, one.limits.upper
    if lower is not None and upper is not None:
        return f"{number(lower / factor)} … {number(upper / factor)}"
    if upper is not None:
        return f"≤ {number(upper / factor)}"
    if lower is not None:
        return f"≥ {number(lower / factor)}"
    return ""


def with_interval(value: float | None, interval: Interval | None) -> str:
    """An index of capability with its 95 % interval."""
    if value is None or interval is None:
        return "–"
    return f"{fixed(value, 2)} ({fixed(interval[0], 2)} … {fixed(interval[1], 2)})"
