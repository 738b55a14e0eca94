"""What a passport follows: the table of quantities, each with its definition, its unit, and what
makes runs comparable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from model.units import ARCMIN, ARCSEC

REFERENCE_SPEEDS_RPM = (500, 1000, 2000, 3500)
"""Input speeds at which catalogues give the no-load running torque, and at which it is followed."""
FOLLOWED_ORDERS = 6
"""Orders of the kinematic error that get a chart of their own: the largest ones."""
MILLI = 1e-3
NOMINAL_RATIO = 100.0
"""Ratio by which labels such as 2+2/N are put in order, whatever the gear."""

Facts = Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One followed quantity: its key among the estimates of a kind of analysis, title, definition, unit for people.

    `compared_by` names the facts of a run (see `gather.py`) that must be equal within one series.
    """

    key: str
    kind: str
    title: str
    definition: str
    factor: float
    display_unit: str
    compared_by: tuple[str, ...]
    step: str
    """What is to be run where there is nothing of it."""
    axis: str
    """What stands at the axis of its chart, before the unit."""


_COMPARED_ERROR = ("part", "mounting", "speed", "orders")
_COMPARED_TORQUE = ("part", "mounting", "torque of", "channel")
_ACCURACY = (
    "sum of the largest positive and the largest negative deviation of the output from the "
    "ideal over one complete output "
    "revolution, one direction; of the fitted curve"
)


def _accuracy(key: str, way: str) -> Quantity:
    title = f"Transmission accuracy, {way}"
    return Quantity(
        key=key,
        kind="kinematic-error",
        title=title,
        definition=_ACCURACY,
        factor=ARCMIN,
        display_unit="arcmin",
        compared_by=_COMPARED_ERROR,
        step="rig run kinematic-error",
        axis="transmission accuracy",
    )


def _running(rpm: int) -> Quantity:
    return Quantity(
        key=f"running_torque_{rpm}_rpm",
        kind="friction",
        title=f"No-load running torque at {rpm} r/min",
        definition="torque that keeps the input turning at this speed, nothing on the output",
        factor=MILLI,
        display_unit="mN m",
        compared_by=_COMPARED_TORQUE,
        step="rig run friction",
        axis="running torque",
    )


def _starting(key: str, way: str) -> Quantity:
    return Quantity(
        key=key,
        kind="starting-torque",
        title=f"No-load starting torque, {way}",
        definition="quasi-static torque at which the input begins to turn, nothing on the output; mean "
        "over wave-generator positions",
        factor=MILLI,
        display_unit="mN m",
        compared_by=(*_COMPARED_TORQUE, "ramp"),
        step="rig run starting-torque",
        axis="starting torque",
    )


def order_quantity(label: str) -> Quantity:
    """The amplitude of one order of the kinematic error."""
    return Quantity(
        key=f"amplitude_{label}",
        kind="kinematic-error",
        title=f"Kinematic error, amplitude of order {label}",
        definition="amplitude of this order of the kinematic error, cycles per input revolution; "
        "mean of both directions",
        factor=ARCSEC,
        display_unit="arcsec",
        compared_by=_COMPARED_ERROR,
        step="rig run kinematic-error",
        axis="amplitude",
    )


QUANTITIES: tuple[Quantity, ...] = (
    _accuracy("transmission_accuracy_forward", "forward"),
    _accuracy("transmission_accuracy_reverse", "reverse"),
    *(_running(rpm) for rpm in REFERENCE_SPEEDS_RPM),
    _starting("starting_torque", "mean of both directions"),
)
"""Followed by every passport, in this order; the largest orders of the kinematic error come after
the transmission accuracy.
"""

KINDS = tuple(dict.fromkeys(quantity.kind for quantity in QUANTITIES))
"""The kinds of analysis that a passport is drawn from."""


def order_labels(
    amplitudes: Sequence[Mapping[str, float]], most: int = FOLLOWED_ORDERS
) -> tuple[str, ...]:
    """The labels of the largest orders over several runs (amplitude by label), by their order."""
    sizes: dict[str, list[float]] = {}
    for one in amplitudes:
        for label, amplitude in one.items():
            sizes.setdefault(label, []).append(amplitude)
    largest = sorted(sizes, key=lambda label: (-max(sizes[label]), label))[:most]
    return tuple(sorted(largest, key=lambda label: (order_of(label, NOMINAL_RATIO), label)))


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
    return {name: facts[name] for name in quantity.compared_by if facts.get(name)}


SettingReader = Callable[[Mapping[str, Any], Mapping[str, Any], Mapping[str, Any]], str]
"""(parameters of the run, options of the analysis, settings of the analysis) -> one fact."""


def _speed(
    parameters: Mapping[str, Any], options: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    found = parameters.get("speed_rpm")
    return f"{found:g} r/min" if isinstance(found, (int, float)) else ""


def _orders(
    parameters: Mapping[str, Any], options: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    found = settings.get("accuracy_order") or options.get("highest_order")
    return f"orders up to {found:g}" if isinstance(found, (int, float)) else ""


def _ramp(
    parameters: Mapping[str, Any], options: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    found = parameters.get("rate")
    return f"{found:g} N m/s" if isinstance(found, (int, float)) else ""


def _option(name: str) -> SettingReader:
    return lambda parameters, options, settings: str(options.get(name, ""))


FACTS: Mapping[str, SettingReader] = {
    "speed": _speed,
    "orders": _orders,
    "ramp": _ramp,
    "torque of": _option("torque_is_of"),
    "channel": _option("channel"),
}
"""Facts that come from how a run was made and analysed; part and mounting come from its gear."""
