"""The ladder of a channel over an angle: no order, the first whole orders, and those that the analysis finds.

As means of short stretches of the angle, of which every way through it has its own constant. Runs can judge each other
where their angles count from the same place: from an index mark, or by an encoder that is absolute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.contract import Evidence
from experiments.evidence import rotary_ratio
from experiments.ladder import Ladder, Rung, Sample, centred, nothing_fitted
from experiments.need import ANGLES
from experiments.recording import Recording
from experiments.recordings.channels import chosen_channel
from experiments.recordings.order_spectrum.analysis import HIGHEST, channel_of
from experiments.recordings.orders_source import order_source
from model.arrays import FloatArray, IntArray
from model.identify.orders.fit import fit_samples
from model.identify.orders.samples import OrderSamples, Piece
from model.identify.orders.search import Search
from model.kinematic_error import design_matrix
from model.units import REVOLUTION

CELLS_PER_PERIOD = 16
"""Of the highest order: a mean over a cell takes 0.6 % off it."""
ALIKE = 0.02
"""Orders nearer than this are one."""


@dataclass(frozen=True)
class Turning:
    """Angle (n,) [rad] and direction (n,) of the values of one run, and the orders that the analysis finds in it."""

    angle: FloatArray
    direction: IntArray
    found: tuple[float, ...]


@dataclass(frozen=True)
class FittedOrders:
    """Coefficients of the cosines and sines of `orders`; with `apart` those of each direction, forward first."""

    orders: tuple[float, ...]
    values: FloatArray
    apart: bool = False


def sample(recording: Recording, evidence: Evidence) -> Sample:
    """A channel over an angle of one run, each way through it without its constant."""
    settings = evidence.settings
    angle_name = chosen_channel(recording, settings, "angle", ANGLES, "an order spectrum")
    channel, unit = channel_of(recording, settings)
    ratio = evidence.gear.mounted_ratio(recording.metadata.mounting)
    source = order_source(recording, angle_name, channel, rotary_ratio(recording, ratio))
    highest = float(settings.get("highest_order", HIGHEST))
    stated = rotary_ratio(recording, math.nan) if angle_name == "input_angle" else math.nan
    samples = OrderSamples.gathered(source.pieces, highest, has_line=source.has_line)
    found = fit_samples(samples, Search(highest, stated))
    cells = _Cells(CELLS_PER_PERIOD * math.ceil(highest) / REVOLUTION)
    for piece in source.pieces():
        cells.add(piece)
    return cells.sample(recording, evidence, unit, tuple(order.order for order in found.orders))


class _Cells:
    """Means of a channel over short stretches of its angle, way by way."""

    def __init__(self, per_radian: float) -> None:
        self._per_radian = per_radian
        self._sums: dict[tuple[int, int, int], FloatArray] = {}

    def add(self, piece: Piece) -> None:
        """Take in some samples: how many, the sum of their angles and of their values, cell by cell."""
        numbers = np.floor(piece.angle * self._per_radian).astype(np.int64)
        first = int(numbers.min())
        counts = np.bincount(numbers - first)
        sums = np.column_stack(
            [
                counts,
                np.bincount(numbers - first, weights=piece.angle),
                np.bincount(numbers - first, weights=piece.value),
            ]
        )
        for place in np.flatnonzero(counts).tolist():
            key = piece.stretch, piece.direction, first + place
            before = self._sums.get(key)
            self._sums[key] = sums[place] if before is None else before + sums[place]

    def sample(
        self, recording: Recording, evidence: Evidence, unit: str, found: tuple[float, ...]
    ) -> Sample:
        """The means as a sample."""
        keys, sums = np.array([*self._sums]), np.array([*self._sums.values()])
        part = np.unique(keys[:, 0], return_inverse=True)[1].astype(np.int64)
        return Sample(
            run=recording.metadata.run_id,
            origin=recording.metadata.origin,
            measured=centred(sums[:, 2] / sums[:, 0], part),
            part=part,
            at=Turning(sums[:, 1] / sums[:, 0], keys[:, 1], found),
            gear=evidence.gear,
            unit=unit,
        )


def _design(sample: Sample, fitted: FittedOrders) -> FloatArray:
    turning: Turning = sample.at
    waves = design_matrix(turning.angle, fitted.orders, constant=False, trend=False)
    if fitted.apart:
        forward = (turning.direction > 0)[:, np.newaxis]
        waves = np.concatenate([waves * forward, waves * ~forward], axis=1)
    if not waves.shape[1]:
        return np.empty((len(turning.angle), 0))
    return np.column_stack([centred(column, sample.part) for column in waves.T])


def _fitted(orders: Sequence[float], samples: Sequence[Sample], *, apart: bool) -> FittedOrders:
    empty = FittedOrders(tuple(orders), np.empty(0), apart)
    design = np.concatenate([_design(one, empty) for one in samples])
    measured = np.concatenate([one.measured for one in samples])
    values = np.linalg.lstsq(design, measured, rcond=None)[0]
    return FittedOrders(tuple(orders), np.asarray(values, dtype=np.float64), apart)


def _first(highest: int) -> Callable[[Sequence[Sample]], FittedOrders]:
    return lambda samples: _fitted(range(1, highest + 1), samples, apart=False)


def _fitted_orders(*, apart: bool) -> Callable[[Sequence[Sample]], FittedOrders]:
    def fit(samples: Sequence[Sample]) -> FittedOrders:
        orders: list[float] = []
        for order in sorted(order for one in samples for order in one.at.found):
            if not orders or order - orders[-1] > ALIKE:
                orders.append(order)
        return _fitted(orders, samples, apart=apart)

    return fit


def _predict(fitted: FittedOrders, sample: Sample) -> FloatArray:
    return np.asarray(_design(sample, fitted) @ fitted.values, dtype=np.float64)


def _numbers(fitted: FittedOrders) -> int:
    return len(fitted.values)


def _both_ways(sample: Sample) -> bool:
    turning: Turning = sample.at
    return len(np.unique(turning.direction)) == 2


LADDER = Ladder(
    quantity="channel over the angle",
    unit="rad",
    shown="arcsec",
    sample=sample,
    is_centred=True,
    rungs=(
        Rung(
            name="no order (null)",
            parameters=0,
            fit=nothing_fitted,
            predict=lambda _, sample: np.zeros(len(sample.measured)),
        ),
        Rung(name="order 1", parameters=2, fit=_first(1), predict=_predict),
        Rung(name="orders 1 and 2", parameters=4, fit=_first(2), predict=_predict),
        Rung(name="orders 1 to 4", parameters=8, fit=_first(4), predict=_predict),
        Rung(name="orders 1 to 12", parameters=24, fit=_first(12), predict=_predict),
        Rung(
            name="orders that were found",
            parameters=0,
            fit=_fitted_orders(apart=False),
            predict=_predict,
            count=_numbers,
        ),
        Rung(
            name="found, each way apart",
            parameters=0,
            fit=_fitted_orders(apart=True),
            predict=_predict,
            count=_numbers,
            applies=_both_ways,
        ),
    ),
)
