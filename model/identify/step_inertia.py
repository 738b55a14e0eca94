"""The inertia at the output, from the torque port during steps whose mode has been identified.

    T + tau T' = J_i theta_i'' + J_o (1/N + ke'(theta_i)) theta_o'' + friction(theta_i') + T_0

The output's acceleration is that of the identified mode, free of counting noise; tau is the lag of the port. All
sides go through one smooth kernel b (a Gaussian) before they are compared: derivatives are taken of the kernel,
never of the data, so that what it leaves out is left out on both sides alike. Only the rise and the ring-down
count. All steps are one fit; the scatter between them is the error. Together with K/J_o the inertia gives the
stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from model.errors import IdentificationError
from model.gear import Harmonic
from model.identify.checks import Array
from model.identify.step_data import SPEED_SMOOTHING, StepData
from model.identify.step_fit import FALLING
from model.kinematic_error import series_slope

WIDTH = 1.2
"""Standard deviation of the kernel in samples: wide enough that sums stand for integrals."""
LIVELY = 0.25
"""s after the onset of a step in which the output rings and the rotor gains speed."""
LEAST_STEPS = 4
CLEAR = 5
"""Samples after the onset within which the kernel still reaches into the standstill."""
COLUMNS = ("lag", "input_inertia", "output_inertia")


@dataclass(frozen=True, kw_only=True)
class InertiaFit:
    """Inertias [kg m2] and the port's lag [s] from torque, with standard errors and their degrees of freedom."""

    values: dict[str, float]
    errors: dict[str, float]
    freedom: dict[str, float]
    residual: float


def fit_inertia(
    steps: Sequence[StepData],
    torques: Sequence[Array],
    accelerations: Sequence[Array],
    series: Sequence[Harmonic],
) -> InertiaFit:
    """J_i, J_o and the lag of the torque port from all steps (`torques` [N m], zero taken off, at the stamps).

    `accelerations`: the torque that the gear puts on the output, over J_o, at the stamps [rad/s2]; `series`: the
    kinematic error. Raises `IdentificationError` for fewer than four steps.
    """
    if len(steps) < LEAST_STEPS:
        raise IdentificationError(
            "too few steps for an inertia",
            where="torque",
            value=len(steps),
            limit=f">= {LEAST_STEPS}",
        )
    parts = [
        _equations(step, torque, acceleration, series)
        for step, torque, acceleration in zip(steps, torques, accelerations, strict=True)
    ]
    matrices = [design.T @ design for design, _ in parts]
    pulls = [design.T @ right for design, right in parts]
    whole, pull = sum(matrices[1:], matrices[0]), sum(pulls[1:], pulls[0])
    found = _solved(whole, pull)
    left = np.array([_solved(whole - m, pull - p) for m, p in zip(matrices, pulls, strict=True)])[
        :, : len(COLUMNS)
    ]
    centred = left - left.mean(axis=0)
    count = len(steps)
    variance = (count - 1) / count * (centred**2).sum(axis=0)
    effective = (centred**2).sum(axis=0) ** 2 / np.maximum((centred**4).sum(axis=0), 1e-300)
    square = sum(float(np.sum((right - design @ found) ** 2)) for design, right in parts)
    return InertiaFit(
        values=dict(zip(COLUMNS, found.tolist(), strict=False)),
        errors=dict(zip(COLUMNS, np.sqrt(variance).tolist(), strict=True)),
        freedom=dict(zip(COLUMNS, np.clip(effective, 3.0, count - 1.0).tolist(), strict=True)),
        residual=math.sqrt(square / sum(len(right) for _, right in parts)),
    )


def _solved(matrix: Array, pull: Array) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return scale * (np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-10) @ (pull * scale))


def _equations(
    step: StepData, torque: Array, acceleration: Array, series: Sequence[Harmonic]
) -> tuple[Array, Array]:
    """Columns and right-hand side of one step, its own offset taken out."""
    period = float(np.median(np.diff(step.time)))
    even = np.arange(step.time[0], step.time[-1], period)
    angle, effort, pulled = (
        scipy.interpolate.CubicSpline(step.time, values)(even)
        for values in (step.input_angle, torque, acceleration)
    )
    smooth, first, second = _kernels(period)

    def through(values: Array, kernel: Array) -> Array:
        return np.convolve(values, kernel, mode="same")

    speed = through(angle - angle[0], first)
    moving = np.tanh(speed / SPEED_SMOOTHING)
    slope = series_slope(series, angle) if series else np.zeros_like(angle)
    falling = moving * np.exp(-np.abs(speed) / FALLING)
    columns = np.column_stack(
        [
            -through(effort, first),
            through(angle - angle[0], second),
            through(pulled * (1.0 / step.ratio + slope), smooth),
            through(moving, smooth),
            speed,
            through(falling, smooth),
            through(moving * slope * step.ratio, smooth),
            *(through(wave(n * angle), smooth) for n in (1, 2, 4) for wave in (np.cos, np.sin)),
        ]
    )
    edge = len(smooth)
    inside = np.zeros(len(even), dtype=bool)
    inside[edge:-edge] = True
    inside &= even < LIVELY
    # Torque at standstill is whatever stiction holds: it says nothing of friction that slides, or of inertia.
    fast = np.abs(speed[edge:-edge])
    onset = edge + int(np.argmax(fast > 0.02 * float(np.max(fast))))
    inside &= np.arange(len(even)) > onset + CLEAR
    right = through(effort, smooth)[inside]
    columns = columns[inside]
    return columns - columns.mean(axis=0), right - right.mean()


def _kernels(period: float) -> tuple[Array, Array, Array]:
    """The Gaussian and its first and second derivative by time, as sums over samples."""
    width = WIDTH * period
    lag = np.arange(-math.ceil(6.0 * WIDTH), math.ceil(6.0 * WIDTH) + 1) * period
    bell = np.exp(-0.5 * (lag / width) ** 2)
    bell /= bell.sum()
    return bell, -lag / width**2 * bell, (lag**2 / width**4 - 1.0 / width**2) * bell
