"""The ladder of a motion: mean effort, friction, inertia, friction each way apart, Stribeck's fall, load over position.

Samples and filter are those of the analysis (`motion`), the rungs are fitted by plain least squares: the noise of a
position takes a little off the inertia there, which the analysis does not let it do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from experiments.contract import Evidence
from experiments.ladder import Ladder, Rung, Sample
from experiments.recording import Recording
from experiments.recordings.motion.analysis import channels_of, choice_of, load_turn
from experiments.recordings.motion_channels import RecordedMotion
from model.arrays import FloatArray
from model.identify.motion import MotionChoice, identify_motion
from model.identify.motion_columns import Basis, samples

MOST_ROWS = 20_000
"""Values of one run; of more, evenly spread ones are taken."""
_LOAD_ORDERS = (1, 2, 3)
"""Orders of the load over a turn of the output; the first is gravity."""
SLOW, FAST = 0.02, 0.5
"""Shares of the moving samples that are slower than the slowest and the fastest critical speed that is looked for."""
ALIKE = ("acceleration", "speed", "sign", "one")
APART = ("acceleration", "speed", "speed_size", "sign", "one")


@dataclass(frozen=True)
class Moving:
    """Columns (n,) of one run by name: acceleration, speed, sign, load over position. `has_load`: whether one is."""

    columns: dict[str, FloatArray]
    has_load: bool

    def design(self, names: Sequence[str], critical: float = math.nan) -> FloatArray:
        """The columns (n, p) of these names; with a Stribeck fall of this critical speed."""
        chosen = [self.columns[name] for name in names]
        if math.isfinite(critical):
            chosen.append(self.columns["sign"] * np.exp(-((self.columns["speed"] / critical) ** 2)))
        return np.column_stack(chosen)


@dataclass(frozen=True)
class FittedMotion:
    """Coefficients of the columns of `names`, and the critical speed of a fall (NaN: none)."""

    names: tuple[str, ...]
    values: FloatArray
    critical: float = math.nan


def sample(recording: Recording, evidence: Evidence) -> Sample:
    """The effort over acceleration, speed and position of one run, wherever it moves."""
    motion, _ = channels_of(recording, evidence.settings, evidence.maximum_missed_share)
    choice = choice_of(motion, evidence.settings)
    fit = identify_motion(motion, choice, rotary=motion.position_unit == "rad")
    basis = _basis(motion, choice, fit.basis.lag)
    names = basis.names(with_instrument=bool(motion.instrument))
    parts = [part.columns[~part.standing] for part in samples(motion, fit.recipe, basis)]
    table = np.concatenate(parts)
    table = table[:: max(1, math.ceil(len(table) / MOST_ROWS))]
    columns = {name: table[:, place] for place, name in enumerate(names)}
    return Sample(
        run=recording.metadata.run_id,
        origin=recording.metadata.origin,
        measured=columns["effort"],
        part=np.zeros(len(table), dtype=np.int64),
        at=Moving(columns, bool(basis.load_orders)),
        gear=evidence.gear,
        unit=motion.effort_unit,
    )


def _basis(motion: RecordedMotion, choice: MotionChoice, lag: float) -> Basis:
    """The columns of the richest rung: a load over position only where the position is an angle of the output."""
    turn = math.nan
    if motion.position_unit == "rad" and motion.is_position:
        ratio = motion.recording.metadata.ratio
        is_known = motion.place != "input_angle" or (math.isfinite(ratio) and ratio > 0.0)
        turn = load_turn(motion) if is_known else math.nan
    if not math.isfinite(turn):
        return Basis(lag=lag)
    return Basis(load_orders=_LOAD_ORDERS, load_turn=turn, lag=lag)


def _together(names: Sequence[str], samples: Sequence[Sample], critical: float) -> FloatArray:
    return np.concatenate([one.at.design(names, critical) for one in samples])


def _linear(names: tuple[str, ...]) -> Callable[[Sequence[Sample]], FittedMotion]:
    def fit(samples: Sequence[Sample]) -> FittedMotion:
        return _solved(names, samples, math.nan)[0]

    return fit


def _solved(
    names: tuple[str, ...], samples: Sequence[Sample], critical: float
) -> tuple[FittedMotion, float]:
    """The least squares, and the sum of squares that they leave."""
    design = _together(names, samples, critical)
    measured = np.concatenate([one.measured for one in samples])
    values = np.asarray(np.linalg.lstsq(design, measured, rcond=None)[0], dtype=np.float64)
    left = measured - design @ values
    return FittedMotion(names, values, critical), float(left @ left)


def _falling(samples: Sequence[Sample]) -> FittedMotion:
    """The critical speed that leaves least, among speeds that the samples have on both sides of it."""
    speeds = np.abs(np.concatenate([one.at.columns["speed"] for one in samples]))
    low, high = np.quantile(speeds[speeds > 0.0], (SLOW, FAST))

    def left(logarithm: float) -> float:
        return _solved(ALIKE, samples, math.exp(logarithm))[1]

    span = math.log(low), math.log(high)
    found = scipy.optimize.minimize_scalar(left, bounds=span, method="bounded")
    return _solved(ALIKE, samples, math.exp(float(found.x)))[0]


def _predict(fitted: FittedMotion, sample: Sample) -> FloatArray:
    moving: Moving = sample.at
    return np.asarray(
        moving.design(fitted.names, fitted.critical) @ fitted.values, dtype=np.float64
    )


def _load(orders: Sequence[int]) -> tuple[str, ...]:
    return (*ALIKE, *Basis(load_orders=tuple(orders)).load_names)


def _has_load(sample: Sample) -> bool:
    moving: Moving = sample.at
    return moving.has_load


LADDER = Ladder(
    quantity="effort of a motion",
    unit="N m",
    shown="mN m",
    sample=sample,
    rungs=(
        Rung(name="mean effort (null)", parameters=1, fit=_linear(("one",)), predict=_predict),
        Rung(
            name="Coulomb and viscous",
            parameters=3,
            fit=_linear(("speed", "sign", "one")),
            predict=_predict,
        ),
        Rung(name="and inertia", parameters=4, fit=_linear(ALIKE), predict=_predict),
        Rung(name="each way apart", parameters=5, fit=_linear(APART), predict=_predict),
        Rung(name="Stribeck", parameters=6, fit=_falling, predict=_predict),
        Rung(
            name="gravity",
            parameters=6,
            fit=_linear(_load(_LOAD_ORDERS[:1])),
            predict=_predict,
            applies=_has_load,
        ),
        Rung(
            name="load of orders 1 to 3",
            parameters=10,
            fit=_linear(_load(_LOAD_ORDERS)),
            predict=_predict,
            applies=_has_load,
        ),
    ),
)
