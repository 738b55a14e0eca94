"""What sampling allows to be said of orders: how high they may be, and which others they cannot be told from.

At S samples per revolution an order m stands in the samples as k S - m as well. With time and angle
known the two part as the speed changes; where it did not change enough they are one, and the pair
is given.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from experiments.evidence import usable
from experiments.evidence.holds import Recorded, part_of
from experiments.evidence.sampling import HIGHEST_SHARE
from model.arrays import FloatArray
from model.identify.estimate import Estimate
from model.units import REVOLUTION

HIGHEST_ALIAS = 200
"""Orders up to which a gear or motor has ripple of its own: teeth, slots, and their harmonics."""
ONE_AND_THE_SAME = 0.95
"""Correlation of two orders over the samples above which they are given as a pair."""
IMAGE = 0.3
"""The same for one that is no whole order: a speed that drifts smears the image of a whole one."""
WHOLE = 1e-3
"""Orders apart up to which one counts as whole."""
SAMPLES = 20_000
"""Samples at which orders are compared, drawn from all that turn."""


class SampledAngle:
    """The angle over which orders are counted, at the samples of a recording that turn."""

    def __init__(self, recorded: Recorded) -> None:
        recording = recorded.recording
        wanted = str(recorded.evidence.settings.get("angle", "input_angle"))
        name = next((n for n in (wanted, "input_angle", "position") if recording.has(n)), "")
        parts = [part_of(h.segment, recording.rows) for h in recorded.turning]
        angles: list[FloatArray] = []
        steps: list[FloatArray] = []
        for rows in parts or [slice(0, recording.rows)]:
            if not name or recording.signals[name].unit != "rad":
                continue
            angle = recording.si(name, rows)[usable(recording, rows)]
            angles.append(angle)
            steps.append(np.abs(np.diff(angle)))
        every = np.concatenate(angles) if angles else np.empty(0)
        self._drawn = every[
            np.random.default_rng(0).integers(0, max(len(every), 1), SAMPLES)[: len(every)]
        ]
        step = np.concatenate(steps) if steps else np.empty(0)
        moving = step[step > 0.0]
        typical = float(np.median(step[step > 0.1 * moving.mean()])) if len(moving) else 0.0
        self.per_revolution = REVOLUTION / typical if typical > 0.0 else math.inf
        """Samples per revolution in the middle of all that turns."""

    def alias_of(self, order: float) -> int | None:
        """The whole order that these samples cannot tell from this one; None where there is none."""
        if not math.isfinite(self.per_revolution):
            return None
        least = ONE_AND_THE_SAME if abs(order - round(order)) < WHOLE else IMAGE
        folds = range(1, math.ceil(2.0 * HIGHEST_ALIAS / self.per_revolution) + 1)
        for fold in folds:
            for sign in (-1.0, 1.0):
                other = round(fold * self.per_revolution + sign * order)
                if not order < other <= HIGHEST_ALIAS:
                    continue
                together = np.exp(1j * (other - sign * order) * self._drawn).mean()
                if abs(together) > least:
                    return other
        return None


def sampled(estimate: Estimate, order: float, angle: SampledAngle) -> Estimate:
    """The estimate of an order as the sampling allows it to be called."""
    highest = HIGHEST_SHARE * angle.per_revolution
    if order > highest:
        note = f"above {HIGHEST_SHARE:g} of the {angle.per_revolution:.3g} samples per revolution"
        return replace(estimate, identifiable="no", note=_with(estimate, note))
    other = angle.alias_of(order)
    if other is None or estimate.identifiable == "no":
        return estimate
    note = f"order {order:.6g}, or its alias {other}: the samples cannot tell them apart"
    return replace(estimate, identifiable="weakly", note=_with(estimate, note))


def _with(estimate: Estimate, note: str) -> str:
    return "; ".join(part for part in (estimate.note, note) if part)
