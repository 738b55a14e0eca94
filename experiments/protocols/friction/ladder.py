"""The ladder of the no-load running torque: mean, straight line, Stribeck curves, the paper's model.

Every point is the half difference of the directions at one speed, the tare subtracted, as in the analysis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.ladder import Ladder, Rung, Sample, nothing_fitted
from experiments.protocols.friction.points import measure_friction
from experiments.recording import Recording
from model.arrays import FloatArray
from model.friction import friction_torque, mesh_lever
from model.identify.friction import nominal_bearing_torque
from model.identify.running_torque import pair_directions
from model.identify.stribeck import StribeckBounds, fit_stribeck, stribeck_curve

_EXPONENTIAL = (1.0 - 1e-6, 1.0 + 1e-6)
"""Shapes of a Stribeck curve that is an exponential."""


def sample(recording: Recording, evidence: Evidence) -> Sample:
    """The friction torque at the input [N m] over the input speed [rad/s] of one run."""
    measured = measure_friction(recording, evidence)
    if measured.unit != "N m":
        raise AnalysisError(
            "the paper's model gives torques; this recording has none",
            where=recording.metadata.run_id,
            value=f"{measured.channel} in {measured.unit}",
            limit="N m",
        )
    points = pair_directions([h.torque for h in measured.holds])
    tare = measured.motor_torque(points.speed)
    return Sample(
        run=recording.metadata.run_id,
        origin=recording.metadata.origin,
        measured=points.friction - tare,
        part=np.zeros(len(points.speed), dtype=np.int64),
        at=points.speed,
        gear=evidence.gear,
    )


def _together(samples: Sequence[Sample]) -> tuple[FloatArray, FloatArray]:
    """Speeds and torques of all samples."""
    speeds: list[FloatArray] = [s.at for s in samples]
    return np.concatenate(speeds), np.concatenate([s.measured for s in samples])


def _line(degree: int) -> Callable[[Sequence[Sample]], FloatArray]:
    return lambda samples: np.polyfit(*_together(samples), degree)


def _on_line(coefficients: FloatArray, sample: Sample) -> FloatArray:
    return np.vander(sample.at, len(coefficients)) @ coefficients


def _stribeck(speed: FloatArray, values: FloatArray, shape: tuple[float, float]) -> FloatArray:
    bounds = StribeckBounds(StribeckBounds.of(speed).stribeck_velocity, shape)
    return fit_stribeck(speed, values, np.ones(len(speed)), bounds=bounds).values


def _curve(shape: tuple[float, float]) -> Callable[[Sequence[Sample]], FloatArray]:
    return lambda samples: _stribeck(*_together(samples), shape)


def _on_curve(values: FloatArray, sample: Sample) -> FloatArray:
    return stribeck_curve(sample.at, values)


def _paper(samples: Sequence[Sample]) -> FloatArray:
    """F_c, F_s, v_s, sigma, c_v of the mesh (19), beside the bearing's torque of the parameter set (18)."""
    speed, _ = _together(samples)
    forces = np.concatenate([(s.measured - _bearing(s)) / mesh_lever(s.gear) for s in samples])
    return _stribeck(speed, forces, StribeckBounds.of(speed).shape)


def _bearing(sample: Sample) -> FloatArray:
    gear = sample.gear
    return nominal_bearing_torque(gear, sample.at, gear.options.torque_balance)


def _as_fitted(values: FloatArray, sample: Sample) -> FloatArray:
    return _bearing(sample) + mesh_lever(sample.gear) * stribeck_curve(sample.at, values)


def _as_stated(_: None, sample: Sample) -> FloatArray:
    return friction_torque(sample.gear, sample.at)


LADDER = Ladder(
    quantity="no-load running torque",
    unit="N m",
    shown="mN m",
    sample=sample,
    rungs=(
        Rung(name="mean torque (null)", parameters=1, fit=_line(0), predict=_on_line),
        Rung(name="Coulomb and viscous", parameters=2, fit=_line(1), predict=_on_line),
        Rung(
            name="Stribeck, exponential", parameters=4, fit=_curve(_EXPONENTIAL), predict=_on_curve
        ),
        Rung(
            name="Stribeck, free shape",
            parameters=5,
            fit=_curve(StribeckBounds((1.0, 1.0)).shape),
            predict=_on_curve,
        ),
        Rung(
            name="paper (18)-(20), as stated",
            parameters=0,
            fit=nothing_fitted,
            predict=_as_stated,
        ),
        Rung(name="paper (18)-(20), fitted", parameters=5, fit=_paper, predict=_as_fitted),
    ),
)
