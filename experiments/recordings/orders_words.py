"""Estimates of the orders of a channel, and the sentences that belong to them: one form for all analyses of orders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from experiments.budget import scale_line
from experiments.need import EFFORTS
from experiments.recording import Recording
from experiments.result import way_of
from model.identify.estimate import Estimate
from model.identify.orders.by_speed import ChangingOrder
from model.identify.orders.fit import OrdersFit, Wave
from model.identify.orders.samples import HELD
from model.identify.polar import polar

_MENTIONED = 0.01
"""Share of rows that stand still or belong to no stretch above which it is said."""


BY_STATED_SPEED = (
    "The angle is the stated speed times the time: where the speed was another, the orders are at its share of theirs, "
    "and where it wandered they are smeared over their neighbours and too small."
)
BESIDE_TREND = (
    "What follows the speed (viscous friction) was taken off before the orders were looked for: it would be lines of "
    "orders far below one."
)


def by_stated_speed(estimate: Estimate) -> Estimate:
    """An order over an angle that nobody measured: at most "weakly", since nothing in the log tells the wandering."""
    if estimate.identifiable != "yes":
        return estimate
    note = "over a stated speed, at which nobody looked"
    return replace(
        estimate,
        identifiable="weakly",
        note="; ".join(n for n in (estimate.note, note) if n),
    )


def by_speed(
    estimates: dict[str, Estimate], changing: Mapping[int, tuple[ChangingOrder, ...]], unit: str
) -> tuple[dict[str, Estimate], list[str]]:
    """The estimates with how the amplitude of an order changes with the speed, and a sentence for each."""
    said: list[str] = []
    found = dict(estimates)
    for direction, orders in changing.items():
        for one in orders:
            slow, fast = one.amplitude(np.array([one.slow, one.fast])).tolist()
            words = (
                f"{way_of(direction)} {slow:.3g} {unit} at {one.slow:.3g} rad/s "
                f"to {fast:.3g} {unit} at {one.fast:.3g} rad/s"
            )
            said.append(
                f"The amplitude of order {one.order:.6g} changes with speed: {words}; the line is that at "
                f"{one.middle:.3g} rad/s, and what the change lays beside it is no line."
            )
            name = f"amplitude_{one.order:.6g}"
            if (estimate := found.get(name)) is not None:
                note = "; ".join(n for n in (estimate.note, f"changes with speed, {words}") if n)
                found[name] = replace(estimate, note=note)
    return found, said


def order_estimates(
    fit: OrdersFit, recording: Recording, channel: str, unit: str
) -> dict[str, Estimate]:
    """amplitude_v and phase_v of each order; forward_ and reverse_amplitude_v where the directions differ."""
    estimates: dict[str, Estimate] = {}
    for order in fit.orders:
        for estimate in _estimates(order.name, order.mean, unit):
            estimates[estimate.name] = estimate
        if order.mean.amplitude < fit.rounded(order):
            mean = f"amplitude_{order.name}"
            note = "may be the rounding of the angle under a stronger order"
            estimates[mean] = replace(estimates[mean], identifiable="weakly", note=note)
        if not order.differ:
            continue
        mean = f"amplitude_{order.name}"
        note = "mean of directions that differ"
        estimates[mean] = replace(
            estimates[mean], note="; ".join(n for n in (estimates[mean].note, note) if n)
        )
        for direction, wave in order.waves.items():
            amplitude, _ = _estimates(order.name, wave, unit)
            name = f"{way_of(direction)}_{amplitude.name}"
            estimates[name] = replace(amplitude, name=name)
    scaled = channel in EFFORTS or (
        recording.has(channel)
        and (recording.signals[channel].calibration.scale_relative_uncertainty or 0.0) > 0.0
    )
    if not scaled:
        return estimates
    return {
        name: e.with_budget((scale_line(recording, e.value, channel),)) if e.unit == unit else e
        for name, e in estimates.items()
    }


def _estimates(label: str, wave: Wave, unit: str) -> tuple[Estimate, Estimate]:
    found = polar(label, wave.vector, wave.covariance, wave.freedom, unit)
    return found.amplitude, found.phase


def said_of(fit: OrdersFit, left_out: float) -> list[str]:
    """What has to be said of how the orders were found."""
    said: list[str] = []
    samples = fit.samples
    if left_out > _MENTIONED:
        said.append(
            f"{100.0 * left_out:.0f} % of the rows stand still, or belong to no stretch in one direction, "
            "and were left out."
        )
    if not samples.is_whole:
        said.append(
            f"Orders were looked for in {samples.held_samples} of {samples.samples} samples ({HELD} groups of them), "
            "and fitted to all."
        )
    differ = [order.name for order in fit.orders if order.differ]
    if differ:
        said.append(f"The directions differ in order {', '.join(differ)}: each is listed.")
    if not fit.orders:
        said.append("No order rises above the noise.")
    return said
