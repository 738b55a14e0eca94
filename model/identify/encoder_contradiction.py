"""Whether the mountings from which an encoder is learnt contradict each other: another encoder, another mark.

Into the regression of `encoder_curve` (the encoder, what the gears share) goes one column more:

    [0 ... 0 1 ... 1]   an encoder that was exchanged, or a mark that slipped, between two mountings
    [0 .. 1 .. 0]       one mounting that is not as it is stated

Whether it is needed says F with 2 and 2 nu degrees of freedom for every order; Fisher's method puts the orders
together, and the least of so many columns is held against so small a chance. One gear under two names is not seen: it
would have to be known what is the encoder's before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from model.angle_certificate import CERTIFIED_ORDERS
from model.arrays import FloatArray
from model.identify.encoder_curve import ComplexArray, Mounted, is_parted

LEAST_MOUNTINGS = 5
"""Below it a column more leaves nothing to judge it by."""
CHANCE = 1e-4
"""Of a contradiction that is none, over all columns."""
_LEAST_P = 1e-300
What = Literal["exchanged", "beside"]


@dataclass(frozen=True)
class Contradiction:
    """What does not fit: the mounting `place`, from which on the encoder is another, or which is beside all others."""

    what: What
    place: int
    chance: float


def contradiction(mounted: Sequence[Mounted]) -> Contradiction | None:
    """The strongest one among mountings in order of time; None where they agree, or are too few to say."""
    count = len(mounted)
    if count < LEAST_MOUNTINGS or len({one.gear for one in mounted}) < count:
        return None
    found = [*_split(mounted), *_beside(mounted)]
    worst = min(found, key=lambda one: one.chance)
    return worst if worst.chance < CHANCE else None


def _split(mounted: Sequence[Mounted]) -> list[Contradiction]:
    """Another encoder from the mounting `first` on; at least two stand on either side."""
    places = range(2, len(mounted) - 1)
    steps = [np.arange(len(mounted)) >= place for place in places]
    return [
        Contradiction("exchanged", place, len(steps) * _needed(mounted, step.astype(float)))
        for place, step in zip(places, steps, strict=True)
    ]


def _beside(mounted: Sequence[Mounted]) -> list[Contradiction]:
    """One mounting that is not as stated."""
    every = np.eye(len(mounted))
    return [
        Contradiction("beside", place, len(every) * _needed(mounted, column))
        for place, column in enumerate(every)
    ]


def _needed(mounted: Sequence[Mounted], column: FloatArray) -> float:
    """The chance that a column is needed so much by all orders together, though it is not."""
    log_p = 0.0
    # What some runs do not show is told as 0 of them, and is no measurement.
    orders = [k for k in CERTIFIED_ORDERS if not any(one.unseen[k - 1] for one in mounted)]
    for order in orders:
        values, design = _regression(order, mounted)
        wider = np.column_stack([design, column.astype(np.complex128)])
        freedom = len(values) - wider.shape[1]
        before, after = _squares(values, design), _squares(values, wider)
        ratio = (before - after) / max(after / freedom, 1e-300)
        # F with 2 and 2 nu: (1 + F/nu)^-nu.
        log_p += max(-freedom * math.log1p(ratio / freedom), math.log(_LEAST_P))
    return _fisher(log_p, len(orders))


def _regression(order: int, mounted: Sequence[Mounted]) -> tuple[ComplexArray, ComplexArray]:
    """Values (n,) of an order, and the columns that explain it."""
    values = np.array([one.waves[order - 1] for one in mounted])
    columns = [np.ones(len(values), dtype=np.complex128)]
    if is_parted(order, mounted):
        columns.append(np.exp(1j * order * np.array([float(one.angle or 0.0) for one in mounted])))
    return values, np.column_stack(columns)


def _squares(values: ComplexArray, design: ComplexArray) -> float:
    left = values - design @ np.linalg.lstsq(design, values)[0]
    return float(np.sum(np.abs(left) ** 2))


def _fisher(log_p: float, count: int) -> float:
    """The chance of so small a product of `count` chances: e^-x (1 + x + ... + x^(count - 1)/(count - 1)!)."""
    if not count:
        return 1.0
    terms = [k * math.log(max(-log_p, 1e-300)) - math.lgamma(k + 1.0) for k in range(count)]
    return min(sum(math.exp(log_p + term) for term in terms), 1.0)
