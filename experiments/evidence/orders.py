"""What sampling allows to be said of orders: how high they may be, and which others they cannot be told from.

At S samples per revolution an order m stands in the samples as k S - m as well. With time and angle
known the two part as the speed changes; where it did not change enough they are one, and the pair
is given.
"""

from __future__ import annotations

import math
from dataclasses import replace

from experiments.evidence import usable
from experiments.evidence.holds import Recorded, part_of
from model.identify.estimate import Estimate
from model.identify.orders.aliases import HIGHEST_SHARE, SamplingSums, SamplingWindow

ANGLES = ("input_angle", "position", "output_angle")
_NAMED = 1e-5
"""Orders to which the name of one tells it."""
WHOLE_TURN = 0.99
"""Of its own period that must have been recorded: a part of a wave is as well an offset, a slope or another order."""
BLOCK = 1 << 16
"""Rows that are read at a time."""


def sampled_angle(recorded: Recorded) -> SamplingWindow:
    """The angle over which orders are counted, at the samples of a recording that turn."""
    recording = recorded.recording
    wanted = str(recorded.evidence.settings.get("angle", "input_angle"))
    name = next((n for n in (wanted, *ANGLES) if recording.has(n)), "")
    sums = SamplingSums()
    if name and recording.signals[name].unit == "rad":
        parts = [part_of(h.segment, recording.rows) for h in recorded.turning]
        for part in parts or [slice(0, recording.rows)]:
            for rows in recording.blocks(part, size=BLOCK):
                angle = recording.si(name, rows)[usable(recording, rows)]
                if len(angle):
                    sums.take(angle)
    return sums.window()


def sampled(
    estimate: Estimate, order: float, angle: SamplingWindow, ratio: float = math.nan
) -> Estimate:
    """The estimate of an order as the sampling allows it to be called.

    A whole order, or n + k/N of a gear of `ratio` N, is one that a gear has; any other may as well be the image of
    one that is no whole order either.
    """
    highest = HIGHEST_SHARE * angle.per_revolution
    if order > highest:
        note = f"above {HIGHEST_SHARE:g} of the {angle.per_revolution:.3g} samples per revolution"
        return replace(estimate, identifiable="no", note=_with(estimate, note))
    if order * angle.revolutions < WHOLE_TURN:
        note = f"{order * angle.revolutions:.2g} of one turn of its own was recorded"
        return replace(estimate, identifiable="no", note=_with(estimate, note))
    other: float | None = angle.alias_of(order)
    if other is None and not _is_of_gear(order, ratio):
        other = angle.image_of(order)
    if other is None or estimate.identifiable == "no":
        return estimate
    note = f"order {order:.6g}, or its alias {other:.6g}: the samples cannot tell them apart"
    return replace(estimate, identifiable="weakly", note=_with(estimate, note))


def _is_of_gear(order: float, ratio: float) -> bool:
    """Whether an order, as it is named, is a whole one or of the lattice of a gear."""
    places = (1.0, ratio) if math.isfinite(ratio) else (1.0,)
    return any(abs(order * place - round(order * place)) < _NAMED * place for place in places)


def _with(estimate: Estimate, note: str) -> str:
    return "; ".join(part for part in (estimate.note, note) if part)
