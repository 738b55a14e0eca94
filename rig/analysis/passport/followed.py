"""What a passport follows: the quantities that protocols declare as watched, and what makes runs comparable."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from experiments import catalogue
from experiments.quantity import Quantity

LARGEST = 6
"""Members of a family without members of its own that get a chart each: the largest ones."""
_ABOVE_RPM = 100.0
"""r/min by which a plan goes beyond a speed that is followed, for a resonance just there."""
_NOMINAL_RATIO = 100.0
"""Ratio by which labels such as 2+2/N are put in order, whatever the gear."""

Facts = Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class FollowedQuantity:
    """One followed quantity: its key among the estimates of a kind of analysis, and what is known of it."""

    key: str
    kind: str
    quantity: Quantity

    @property
    def title(self) -> str:
        """What stands above its chart."""
        return self.quantity.headed(self.key)

    @property
    def axis(self) -> str:
        """What stands at the axis of its chart, before the unit."""
        return self.quantity.axis or self.quantity.family_title

    @property
    def step(self) -> str:
        """What is to be run where there is nothing of it: up to its own speed where the plan ends below that."""
        highest = getattr(catalogue.load(self.kind).parameters, "highest_rpm", math.inf)
        member = self.quantity.member(self.key)
        if not member.isdigit() or float(member) <= highest:
            return f"rig run {self.kind}"
        return f"rig run {self.kind} --highest-rpm {float(member) + _ABOVE_RPM:g}"


def watched() -> tuple[tuple[str, Quantity], ...]:
    """Every watched quantity with its kind of analysis, in the order of the catalogue."""
    return tuple(
        (one.name, quantity)
        for one in catalogue.every()
        for quantity in one.quantities
        if quantity.is_watched
    )


def watched_kinds() -> frozenset[str]:
    """The kinds of analysis that a passport is drawn from."""
    return frozenset(kind for kind, _ in watched())


def followed(kind: str, quantity: Quantity) -> tuple[FollowedQuantity, ...]:
    """What every gear should have of a watched quantity; nothing of a family whose members its runs decide."""
    names = [quantity.named(member) for member in quantity.watched_members]
    if not quantity.placeholder:
        names = [quantity.name]
    return tuple(FollowedQuantity(key=name, kind=kind, quantity=quantity) for name in names)


def largest_followed(
    kind: str, quantity: Quantity, sizes: Sequence[Mapping[str, float]]
) -> tuple[FollowedQuantity, ...]:
    """The largest members of a watched family over several runs (size by member)."""
    return tuple(
        FollowedQuantity(key=quantity.named(member), kind=kind, quantity=quantity)
        for member in largest_members(sizes)
    )


def largest_members(sizes: Sequence[Mapping[str, float]], most: int = LARGEST) -> tuple[str, ...]:
    """The members that were largest in any run (size by member), by their order."""
    largest: dict[str, float] = {}
    for one in sizes:
        for member, size in one.items():
            largest[member] = max(size, largest.get(member, size))
    chosen = sorted(largest, key=lambda member: (-largest[member], member))[:most]
    return tuple(sorted(chosen, key=lambda member: (order_of(member, _NOMINAL_RATIO), member)))


def order_of(label: str, ratio: float | None) -> float:
    """The order of a label such as 2, 2+2/N or 1/N; NaN for one that is none."""
    whole, sign, part = label.partition("+") if "+" in label else label.rpartition("-")
    if not sign:
        whole, part = ("", label) if "/N" in label else (label, "")
    try:
        order = float(whole) if whole else 0.0
        if part:
            if not part.endswith("/N") or not ratio:
                return math.nan
            order += (-1.0 if sign == "-" else 1.0) * float(part.removesuffix("/N")) / float(ratio)
    except ValueError:
        return math.nan
    return order


def comparable(facts: Facts, quantity: Quantity) -> dict[str, str]:
    """What must be equal for runs to stand in one series of a quantity."""
    return {name: facts[name] for name in quantity.conditions if facts.get(name)}


_SettingReader = Callable[[Mapping[str, Any], Mapping[str, Any], Mapping[str, Any]], str]
"""(parameters of the run, options of the analysis, settings of the analysis) -> one fact."""


def facts_of(
    names: Iterable[str],
    parameters: Mapping[str, Any],
    options: Mapping[str, Any],
    settings: Mapping[str, Any],
) -> Facts:
    """How a run was made and analysed; a name that is no fact of its own is an option of the analysis."""
    facts = {name: str(options.get(name, "")) for name in names}
    own = {name: FACTS[name](parameters, options, settings) for name in facts if name in FACTS}
    return facts | own


def _with_number(text: str, value: object) -> str:
    """A condition with its number in it; nothing where none is stated."""
    return text.format(value) if isinstance(value, (int, float)) else ""


def _speed(
    parameters: Mapping[str, Any], options: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    return _with_number("{:g} r/min", parameters.get("speed_rpm"))


def _orders(
    parameters: Mapping[str, Any], options: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    highest = settings.get("accuracy_order") or options.get("highest_order")
    return _with_number("orders up to {:g}", highest)


def _ramp(
    parameters: Mapping[str, Any], options: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    return _with_number("{:g} N m/s", parameters.get("rate"))


FACTS: Mapping[str, _SettingReader] = {
    "speed": _speed,
    "orders": _orders,
    "ramp": _ramp,
    "torque of": lambda parameters, options, settings: str(options.get("torque_is_of", "")),
}
"""Facts that come from how a run was made and analysed; part and mounting come from its gear."""
