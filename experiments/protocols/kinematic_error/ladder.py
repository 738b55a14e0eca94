"""The ladder of the kinematic error: none, the parameter set's own series, whole orders of the input, sidebands too.

(15) ke = theta_o - theta_i/N over the input angle from the index marks, so that phases carry from run to run; as
means of short stretches, of which each traverse has its own constant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from experiments.angle.phase_reference import phase_reference
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import rotary_ratio, usable
from experiments.ladder import Ladder, Rung, Sample, centred, nothing_fitted
from experiments.recording import Recording
from model.arrays import FloatArray, IntArray
from model.kinematic_error import design_matrix, series_value
from model.units import REVOLUTION

CELLS = 128
"""Stretches of an input revolution whose means are one value each; order 12 loses 1.4 % by that."""
_WHOLE_ORDERS = 12
_WITH_SIDEBANDS = (1, 2, 4)


def sample(recording: Recording, evidence: Evidence) -> Sample:
    """The kinematic error [rad] over the input angle [rad] of every traverse of one run, without its constant."""
    recording.require("the kinematic error", "input_angle", "output_angle")
    reference = phase_reference(recording)
    if not reference.carries:
        raise AnalysisError(
            "without an index mark the kinematic error of one run cannot be laid on that of another",
            where=recording.metadata.run_id,
            remedy="Run `home` first, or record the index marks.",
        )
    ratio = rotary_ratio(recording, evidence.gear.mounted_ratio(recording.metadata.mounting))
    angles: list[FloatArray] = []
    errors: list[FloatArray] = []
    parts: list[IntArray] = []
    for place, segment in enumerate(recording.labelled("traverse")):
        good = usable(recording, slice(segment.start, segment.stop))
        angle = recording.si("input_angle", segment)[good] - reference.input_angle
        cells = np.floor(angle * (CELLS / REVOLUTION)).astype(np.int64)
        numbers = cells - cells.min()
        counts = np.bincount(numbers)
        filled = counts > 0
        error = recording.output_angle(segment)[good] - angle / ratio
        angles.append(np.bincount(numbers, weights=angle)[filled] / counts[filled])
        errors.append(np.bincount(numbers, weights=error)[filled] / counts[filled])
        parts.append(np.full(int(filled.sum()), place, dtype=np.int64))
    if not parts:
        raise AnalysisError("there is no traverse", where=recording.metadata.run_id)
    part = np.concatenate(parts)
    return Sample(
        run=recording.metadata.run_id,
        origin=recording.metadata.origin,
        measured=centred(np.concatenate(errors), part),
        part=part,
        at=np.concatenate(angles),
        gear=evidence.gear,
    )


Orders = Callable[[Sample], Sequence[float]]


def _design(sample: Sample, orders: Orders) -> FloatArray:
    columns = design_matrix(sample.at, orders(sample), constant=False, trend=False)
    return np.column_stack([centred(column, sample.part) for column in columns.T])


def _rung(name: str, orders: Orders, count: int) -> Rung:
    """A series of these orders, cosine and sine of each."""

    def fit(samples: Sequence[Sample]) -> FloatArray:
        designs = np.concatenate([_design(one, orders) for one in samples])
        measured = np.concatenate([one.measured for one in samples])
        return np.asarray(np.linalg.lstsq(designs, measured, rcond=None)[0], dtype=np.float64)

    def predict(coefficients: FloatArray, sample: Sample) -> FloatArray:
        return _design(sample, orders) @ coefficients

    return Rung(name=name, parameters=2 * count, fit=fit, predict=predict)


def _whole(highest: int) -> Orders:
    return lambda sample: [float(n) for n in range(1, highest + 1)]


def _with_sidebands(sample: Sample) -> Sequence[float]:
    """Whole orders of the input, the first two of the output, and two sidebands to each side of orders 1, 2 and 4."""
    turn = 1.0 / sample.gear.ratio
    beside = [n + k * turn for n in _WITH_SIDEBANDS for k in (-2, -1, 1, 2)]
    return [*_whole(_WHOLE_ORDERS)(sample), turn, 2.0 * turn, *beside]


def _as_stated(_: None, sample: Sample) -> FloatArray:
    return series_value(sample.gear.kinematic_error, sample.at)


def _none(_: None, sample: Sample) -> FloatArray:
    return np.zeros_like(sample.at)


SIDEBANDS = 2 + 4 * len(_WITH_SIDEBANDS)
"""Orders beside the whole ones: see `_with_sidebands`."""

LADDER = Ladder(
    quantity="kinematic error",
    unit="rad",
    shown="arcsec",
    sample=sample,
    is_centred=True,
    rungs=(
        Rung(name="no error (null)", parameters=0, fit=nothing_fitted, predict=_none),
        Rung(name="series (16), as stated", parameters=0, fit=nothing_fitted, predict=_as_stated),
        _rung("order 2", lambda sample: [2.0], 1),
        _rung("orders 2 and 4", lambda sample: [2.0, 4.0], 2),
        _rung("orders 1 to 4", _whole(4), 4),
        _rung("orders 1 to 12", _whole(_WHOLE_ORDERS), _WHOLE_ORDERS),
        _rung("and sidebands", _with_sidebands, _WHOLE_ORDERS + SIDEBANDS),
    ),
)
