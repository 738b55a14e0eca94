"""The ladder of the velocity steps: rigid gear, the paper's equation 2, a fitted spring, hardening, hysteresis.

Judged is x = theta_o - theta_i/N of every step with the measured input prescribed, never the raw angle; the rest
before a step and the motion have a constant each, because the output of a step does not test friction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from experiments.angle.certified import certified_angles
from experiments.angle.phase_reference import phase_reference
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import require_time_base, rotary_ratio
from experiments.ladder import Ladder, Rung, Sample, nothing_fitted
from experiments.planning.speeds import first_resonances
from experiments.protocols.velocity_steps.analysis import expected_of
from experiments.protocols.velocity_steps.data import (
    RecordedStep,
    recorded_steps,
    simulated_output,
)
from experiments.recording import Recording
from model.arrays import FloatArray
from model.identify.dynamics import FittedRung, fit_rung, predict_steps
from model.identify.step_problem import BASIS
from model.identify.step_rungs import FITTED


def sample(recording: Recording, evidence: Evidence) -> Sample:
    """The steps of one run, and what of their output angle a rigid gear leaves [rad]."""
    recording.require("velocity steps", "input_angle", "output_angle")
    require_time_base(recording, "a velocity step")
    gear = evidence.gear
    reference = phase_reference(recording)
    ratio = rotary_ratio(recording, gear.mounted_ratio(recording.metadata.mounting))
    if not reference.carries:
        raise AnalysisError(
            "without an index mark the kinematic error of one run cannot be laid on that of another",
            where=recording.metadata.run_id,
            remedy="Run `home` first, or record the index marks.",
        )
    certified, _ = certified_angles(recording)
    recorded, _, _ = recorded_steps(
        recording,
        ratio=ratio,
        reference=reference,
        zero=None,
        source=gear,
        resonance=first_resonances(gear)[-1],
        certified=certified,
    )
    # Every fitted rung has the error as numbers of its own.
    steps = [replace(one, data=replace(one.data, kinematic_error=())) for one in recorded]
    deviations = [s.data.output_angle - s.data.input_angle / ratio for s in steps]
    # Friction winds the gear up as it begins to turn, which no rung of a spring says: rest and motion are two parts.
    parts = [2 * place + (one.data.time > 0.0) for place, one in enumerate(steps)]
    return Sample(
        run=recording.metadata.run_id,
        origin=recording.metadata.origin,
        measured=np.concatenate([d - d.mean() for d in deviations]),
        part=np.concatenate(parts),
        at=steps,
        gear=gear,
    )


def _beyond_rigid(steps: Sequence[RecordedStep], angles: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate(
        [
            angle - step.data.input_angle / step.data.ratio
            for step, angle in zip(steps, angles, strict=True)
        ]
    )


def _rigid(_: None, sample: Sample) -> FloatArray:
    return np.zeros_like(sample.measured)


def _as_stated(_: None, sample: Sample) -> FloatArray:
    return _beyond_rigid(sample.at, [simulated_output(step, sample.gear) for step in sample.at])


def _fitted(rung: str) -> Callable[[Sequence[Sample]], FittedRung]:
    def fit(samples: Sequence[Sample]) -> FittedRung:
        steps = [step.data for one in samples for step in one.at]
        return fit_rung(steps, expected_of(samples[0].gear), rung)

    return fit


def _predicted(fitted: FittedRung, sample: Sample) -> FloatArray:
    return _beyond_rigid(sample.at, predict_steps(fitted, [step.data for step in sample.at]))


_SPRINGS = {"linear": 4, "hardening": 7, "hysteresis": 9}
"""Numbers of the spring of each fitted rung, beside those of the kinematic error."""
ERROR = 2 * len(BASIS)
"""Coefficients of the kinematic error that are fitted with a spring."""

LADDER = Ladder(
    quantity="output angle of the steps",
    unit="rad",
    shown="arcsec",
    sample=sample,
    is_centred=True,
    rungs=(
        Rung(name="rigid gear (null)", parameters=0, fit=nothing_fitted, predict=_rigid),
        Rung(
            name="paper, equation 2, as stated",
            parameters=0,
            fit=nothing_fitted,
            predict=_as_stated,
        ),
        *(
            Rung(
                name=f"{name} spring" if name == "linear" else f"and {name}",
                parameters=_SPRINGS[name] + ERROR,
                fit=_fitted(name),
                predict=_predicted,
            )
            for name in FITTED
        ),
    ),
)
