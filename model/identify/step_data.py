"""One velocity step as arrays, the motion that its input prescribes, and the scores of a prediction.

Scored is x = theta_o - theta_i/N - ke, never the raw angle (a rigid gear is almost perfect there),
and the output's speed, against the null models rigid (theta_i/N) and rigid with kinematic error (x
= 0). Speeds are slopes of local polynomials; the prediction goes through the same window as the
measurement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import quotient
from model.errors import IdentificationError
from model.gear import Harmonic
from model.identify.checks import Array, channels, increasing, positive
from model.identify.differentiation import speed_from_counts
from model.kinematic_error import normalised_mse, series_value
from model.units import ARCSEC

SPEED_SMOOTHING = 0.5
"""rad/s at the input; the sign of the friction is smoothed over this speed."""


@dataclass(frozen=True, kw_only=True)
class StepData:
    """One step: stamps [s], input and output angle [rad] (n,), quanta of both counts [rad], ratio, kinematic error."""

    time: Array
    input_angle: Array
    output_angle: Array
    ratio: float
    output_quantum: float
    input_quantum: float
    kinematic_error: tuple[Harmonic, ...] = ()

    @property
    def target(self) -> float:
        """Input speed of the last quarter [rad/s]."""
        last = slice(3 * len(self.time) // 4, None)
        return float(np.polyfit(self.time[last], self.input_angle[last], 1)[0])


def step_data(
    time: ArrayLike,
    input_angle: ArrayLike,
    output_angle: ArrayLike,
    ratio: float,
    *,
    output_quantum: float,
    input_quantum: float,
    kinematic_error: Sequence[Harmonic] = (),
) -> StepData:
    """Check and bundle the channels of one step, which begins at rest; time are the stamps of the samples [s]."""
    clock = increasing("time", time, minimum=64)
    clock, theta_i, theta_o = channels(
        64, time=clock, input_angle=input_angle, output_angle=output_angle
    )
    for name, value in (
        ("ratio", ratio),
        ("output_quantum", output_quantum),
        ("input_quantum", input_quantum),
    ):
        positive(name, value)
    travel_in, travel_out = theta_i[-1] - theta_i[0], theta_o[-1] - theta_o[0]
    if abs(travel_in) < math.pi:
        raise IdentificationError(
            "hardly moves", where="input_angle", value=f"{travel_in:.3g} rad", limit="> pi rad"
        )
    slack = 4.0 * output_quantum + 0.02 * abs(travel_in) / ratio + 60.0 * ARCSEC
    if abs(travel_out - travel_in / ratio) > slack:
        seen = travel_in / travel_out if travel_out else math.inf
        raise IdentificationError(
            "the encoders show another ratio than the one stated",
            where="ratio",
            value=f"stated {ratio:g}, seen {seen:.5g}",
            remedy="Check ratio, mounting, signs, lines and multiplication of both encoders.",
        )
    return StepData(
        time=clock,
        input_angle=theta_i,
        output_angle=theta_o,
        ratio=ratio,
        output_quantum=output_quantum,
        input_quantum=input_quantum,
        kinematic_error=tuple(kinematic_error),
    )


@dataclass(frozen=True, kw_only=True)
class StepScore:
    """How a prediction of the output does against rigid gears, on one step. Speeds [rad/s], deviations x [rad].

    skill: 1 - SSE/SSE(rigid with kinematic error) on x; skill_rigid: against the rigid gear;
    skill_speed: on the output speed; mse_speed: normalised (form of equation 22); rms [rad],
    rms_speed [rad/s]; overshoot and ripple (p-p) relative to the steady output speed, measured and
    predicted.
    """

    metrics: dict[str, float]
    time: Array
    measured_speed: Array
    predicted_speed: Array
    rigid_speed: Array
    measured_deviation: Array


def score_step(data: StepData, predicted: ArrayLike, *, ideal: Array | None = None) -> StepScore:
    """Score a predicted output angle (n,) [rad] of one step against the null models; offsets are free.

    Speeds are slopes of local polynomials; the prediction goes through the same window as the measurement.
    """
    (output,) = channels(64, predicted=predicted)
    if ideal is None:
        angle = data.input_angle
        ideal = angle / data.ratio + series_value(data.kinematic_error, angle)
    quantum = data.output_quantum
    window = speed_from_counts(data.time, data.output_angle, quantum, longest=0.06).window

    def slope(angle: Array) -> Array:
        return speed_from_counts(data.time, angle, quantum, window=window).speed

    rigid = data.input_angle / data.ratio
    x, x_hat = data.output_angle - ideal, output - ideal
    x, x_hat = x - x.mean(), x_hat - x_hat.mean()
    rigid_x = (rigid - ideal) - np.mean(rigid - ideal)
    speeds = {
        "measured": slope(data.output_angle),
        "predicted": slope(output),
        "ideal": slope(ideal),
        "rigid": slope(rigid),
    }
    sse = {name: float(np.sum((speeds["measured"] - s) ** 2)) for name, s in speeds.items()}
    left, steady = float(np.sum((x - x_hat) ** 2)), data.target / data.ratio
    metrics = {
        "skill": _skill(left, float(x @ x)),
        "skill_rigid": _skill(left, float(np.sum((x - rigid_x) ** 2))),
        "skill_speed": _skill(sse["predicted"], sse["ideal"]),
        "skill_speed_rigid": _skill(sse["predicted"], sse["rigid"]),
        "mse_speed": normalised_mse(speeds["measured"], speeds["predicted"]),
        "rms": math.sqrt(left / len(x)),
        "rms_speed": math.sqrt(sse["predicted"] / len(x)),
        "window": window,
    }
    for name in ("measured", "predicted"):
        curve = speeds[name] / steady
        metrics[f"overshoot_{name}"] = float(curve.max()) - 1.0
        metrics[f"ripple_{name}"] = float(np.ptp(curve[len(x) // 2 :]))
    return StepScore(
        metrics=metrics,
        time=data.time,
        measured_speed=speeds["measured"],
        predicted_speed=speeds["predicted"],
        rigid_speed=speeds["rigid"],
        measured_deviation=x,
    )


def _skill(sse: float, null: float) -> float:
    return 1.0 - quotient(sse, null)
