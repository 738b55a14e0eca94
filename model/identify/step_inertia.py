"""The inertia at the output, from the torque port during a step whose mode has been identified.

    T = J_i theta_i'' + J_o (1/N + ke'(theta_i)) theta_o'' + friction

The output's acceleration is that of the identified mode, free of counting noise. Torque and
regressors get the average that local polynomials put on the input's acceleration (parallel filter).
Together with K/J_o the inertia gives the stiffness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from model.identify.checks import Array, channels
from model.identify.differentiation import DEGREE, speed_from_counts
from model.identify.dynamics import StepFit
from model.identify.estimate import Estimate, Identifiable
from model.identify.least_squares import LinearFit, solve
from model.identify.step_data import SPEED_SMOOTHING, StepData
from model.kinematic_error import series_slope

TIMING = 0.1
"""Share of a sample by which torque and angle may disagree in time; steep torque counts for less accordingly."""
INPUT_WIDTH = 9
"""Samples under the polynomials of the input: narrower than the rise of a drive."""


@dataclass(frozen=True)
class InertiaFit:
    """Inertias from the torque of a step: estimates output_inertia and input_inertia [kg m2], coulomb [N m], viscous.

    With K/J_o it gives output_stiffness [N m/rad] (dynamic, small-signal).
    """

    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    time: Array
    measured: Array
    predicted: Array


def _averaged(values: Array, width: int) -> Array:
    """The average that the second derivative of a local polynomial contains, along the samples of (n,) or (n, k).

    Slope of slope over a window is a weighted mean of the true acceleration; torque and regressors
    get the same weights.
    """
    second = scipy.signal.savgol_coeffs(width, DEGREE, deriv=2, use="dot")
    kernel = np.cumsum(np.cumsum(second))[:-2]
    shaped = kernel if values.ndim == 1 else kernel[:, None]
    return scipy.signal.fftconvolve(values, shaped, mode="same", axes=0)


def fit_step_inertia(
    data: StepData,
    fit: StepFit,
    torque: ArrayLike,
    *,
    stribeck_velocity: float = 6.0,
    lags: ArrayLike = (0.0, 0.0005, 0.001, 0.0015, 0.002, 0.003, 0.004),
) -> InertiaFit:
    """J_o (and the inertia on the input shaft) from the torque port during a step whose mode has been identified.

        T = J_i theta_i'' + J_o (1/N + ke'(theta_i)) theta_o''
            + {F_c + F_1 exp(-|theta_i'|/v_s) + F_2 ke'(theta_i)} sgn theta_i' + F_v theta_i' + T_0

    Torque and regressors get the average that the local polynomials put on the acceleration.
    theta_o'' (and with it the torque in the gear) is that of the identified mode. The lag of the
    torque port [s] is a nuisance, taken from `lags`. J_o shows only where the output rings: its
    interval says how well.
    """
    (effort,) = channels(64, torque=torque)
    period = float(np.median(np.diff(data.time)))
    motion = speed_from_counts(
        data.time, data.input_angle, data.input_quantum, window=INPUT_WIDTH * period
    )
    moving = np.tanh(motion.speed / SPEED_SMOOTHING)
    lever = 1.0 / data.ratio + series_slope(data.kinematic_error, motion.angle)
    slope = np.sign(data.target) * moving * (lever - 1.0 / data.ratio) * data.ratio
    falling = moving * np.exp(-np.abs(motion.speed) / stribeck_velocity)
    width = 2 * int(0.5 * motion.window / period) + 1
    smooth = _averaged(effort, width)
    noise = 1.05 * float(np.median(np.abs(np.diff(effort)))) + 1e-12
    weight = noise / np.hypot(noise, TIMING * period * np.gradient(smooth, data.time))
    best: tuple[float, float, LinearFit] | None = None
    for lag in np.asarray(lags, dtype=np.float64):
        alpha = np.interp(data.time - lag, data.time, motion.acceleration)
        output = np.interp(data.time - lag, data.time, fit.predicted_acceleration * lever)
        design = np.column_stack(
            [output, alpha, moving, motion.speed, np.ones_like(alpha), falling, slope]
        )
        others = [0, 2, 3, 5, 6]
        design[:, others] = _averaged(design[:, others], width)
        inner = slice(width, -width)
        solution = solve(
            design[inner] * weight[inner, None],
            smooth[inner] * weight[inner],
            where="torque of the step",
        )
        if best is None or solution.relative_error < best[0]:
            best = (solution.relative_error, float(lag), solution)
    assert best is not None
    error, lag, solution = best
    units = {
        "output_inertia": "kg m2",
        "input_inertia": "kg m2",
        "coulomb": "N m",
        "viscous": "N m s/rad",
        "offset": "N m",
    }
    estimates: dict[str, Estimate] = {}
    for index, (name, unit) in enumerate(units.items()):
        low, high = solution.interval(index)
        value = float(solution.values[index])
        if name == "output_inertia":
            half = math.hypot(0.5 * (high - low), 2.0 * abs(value) * _ring_error(data, fit))
            low, high = value - half, value + half
        verdict: Identifiable = (
            "yes" if high - low < abs(value) else "weakly" if high - low < 4 * abs(value) else "no"
        )
        verdict = "no" if name == "output_inertia" and not fit.resolvable else verdict
        estimates[name] = Estimate(
            name=name,
            value=value,
            unit=unit,
            low=low,
            high=high,
            identifiable=verdict,
            note="" if verdict == "yes" else "the output hardly rings",
        )
    ratio, inertia = fit.estimates["stiffness_over_inertia"], estimates["output_inertia"]
    relative = 0.5 * math.hypot(
        (inertia.high - inertia.low) / inertia.value, (ratio.high - ratio.low) / ratio.value
    )
    stiffness = ratio.value * inertia.value
    half = abs(stiffness) * relative
    estimates["output_stiffness"] = Estimate(
        name="output_stiffness",
        value=stiffness,
        unit="N m/rad",
        low=stiffness - half,
        high=stiffness + half,
        identifiable=inertia.identifiable,
        note="dynamic, small-signal: from the resonance, not from a loaded output",
    )
    warnings = (
        ()
        if inertia.identifiable == "yes"
        else ("The torque of this step does not identify the output's inertia.",)
    )
    return InertiaFit(
        estimates,
        {
            "relative_error_percent": 100.0 * error,
            "torque_lag": lag,
            "condition": solution.condition,
        },
        warnings,
        data.time,
        effort,
        _padded(
            smooth[width:-width] - solution.residual / weight[width:-width], len(effort), width
        ),
    )


def _ring_error(data: StepData, fit: StepFit) -> float:
    """Relative standard error of the amplitude of the identified ringing, from counting noise and its duration."""
    period = float(np.median(np.diff(data.time)))
    decay = fit.estimates["damping_ratio"].value * 2.0 * math.pi * fit.estimates["frequency"].value
    samples = min(0.5 / max(decay * period, 1e-9), float(len(data.time)))
    amplitude = fit.metrics["transient_counts"] * data.output_quantum
    return fit.metrics["residual_rms"] * math.sqrt(2.0 / max(samples, 2.0)) / max(amplitude, 1e-15)


def _padded(values: Array, count: int, edge: int) -> Array:
    """Values of the inner samples with NaN at the edges, so that curves keep their axis."""
    whole = np.full(count, math.nan)
    whole[edge : edge + len(values)] = values
    return whole
