"""The inertia at the output, from the torque port during steps whose mode has been identified.

    T = L(J_i theta_i'' + J_o (1/N + ke'(theta_i)) theta_o'' + friction(theta_i')) + T_0,  tau L(x)' + L(x) = x

The output's acceleration is that of the identified mode, free of counting noise; tau is the lag of the port, laid
on the motion: a derivative of the torque among the columns would be read too small by its noise, and the inertia
with it. All sides go through one smooth kernel b (a Gaussian) before they are compared: derivatives are taken of
the kernel, never of the data, so that what it leaves out is left out on both sides alike. Only the rise and the
ring-down count. All steps are one fit; the scatter between them is the error. Together with K/J_o the inertia gives
the stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from model.errors import IdentificationError
from model.gear import Harmonic
from model.identify.checks import Array
from model.identify.step_data import SPEED_SMOOTHING, StepData
from model.identify.step_problem import FALLING
from model.kinematic_error import series_slope

WIDTH = 1.2
"""Standard deviation of the kernel in samples: wide enough that sums stand for integrals."""
_LIVELY = 0.25
"""s after the onset of a step in which the output rings and the rotor gains speed."""
LEAST_STEPS = 4
SKEW = 0.5
"""Periods within which the torque was latched beside the angles: more would have been seen.

A lag of first order, which is fitted, takes up only a part of it: it lessens the ringing as it turns it.
"""
_LAG_STEP = 1e-6
"""s by which the lag is moved for its derivative."""
CLEAR = 5
"""Samples after the onset within which the kernel still reaches into the standstill."""
COLUMNS = ("lag", "input_inertia", "output_inertia")
_LARGEST_LAG = 5e-3
"""s of the torque port that are looked for."""
_MEMORY = 0.02
"""s over which what a fit leaves of the torque still hangs together: about a period of the ringing."""
ORDERS = range(1, 7)
"""Of the input, by which friction changes with the depth of the mesh."""


@dataclass(frozen=True, kw_only=True)
class InertiaFit:
    """Inertias [kg m2] and the port's lag [s] from torque, with standard errors and their degrees of freedom.

    `smoothing`: what changes where all sides are smoothed twice as wide; the model of the rise is not exact.
    `skew`: what changes where the torque was latched half a period later than the angles.
    """

    values: dict[str, float]
    errors: dict[str, float]
    freedom: dict[str, float]
    smoothing: dict[str, float]
    skew: dict[str, float]
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
    late = SKEW * float(np.median(np.diff(steps[0].time)))
    fit, wider, later = (
        _fitted(
            [
                _sides(step, torque, acceleration, series, width, skew)
                for step, torque, acceleration in zip(steps, torques, accelerations, strict=True)
            ]
        )
        for width, skew in ((WIDTH, 0.0), (2.0 * WIDTH, 0.0), (WIDTH, late))
    )

    def away(other: InertiaFit) -> dict[str, float]:
        return {name: abs(other.values[name] - fit.values[name]) for name in COLUMNS}

    return replace(fit, smoothing=away(wider), skew=away(later))


def _fitted(sides: Sequence[_Sides]) -> InertiaFit:
    """All steps in one least-squares fit."""

    def away(lag: float) -> float:
        return _least(_equations(sides, lag))[1]

    lag = float(
        scipy.optimize.minimize_scalar(
            away, bounds=(0.0, _LARGEST_LAG), method="bounded", options={"xatol": 1e-6}
        ).x
    )
    # The lag is one more column from here on: what it changes of the torque that was found.
    numbers = _least(_equations(sides, lag))[0]
    turned = [
        (there - here) @ numbers / _LAG_STEP
        for (here, _), (there, _) in zip(
            _equations(sides, lag), _equations(sides, lag + _LAG_STEP), strict=True
        )
    ]
    parts = [
        (np.column_stack([change, design]), right)
        for change, (design, right) in zip(turned, _equations(sides, lag), strict=True)
    ]
    matrices = [design.T @ design for design, _ in parts]
    pulls = [design.T @ right for design, right in parts]
    whole, pull = sum(matrices[1:], matrices[0]), sum(pulls[1:], pulls[0])
    found = _solved(whole, pull)
    left = np.array([_solved(whole - m, pull - p) for m, p in zip(matrices, pulls, strict=True)])[
        :, : len(COLUMNS)
    ]
    centred = left - left.mean(axis=0)
    count = len(sides)
    variance = (count - 1) / count * (centred**2).sum(axis=0)
    variance = variance + _shared(parts, found, whole, round(_MEMORY / sides[0].period))
    effective = (centred**2).sum(axis=0) ** 2 / np.maximum((centred**4).sum(axis=0), 1e-300)
    square = sum(float(np.sum((right - design @ found) ** 2)) for design, right in parts)
    return InertiaFit(
        values=dict(zip(COLUMNS, [lag + found[0], *found[1:].tolist()], strict=False)),
        errors=dict(zip(COLUMNS, np.sqrt(variance).tolist(), strict=True)),
        freedom=dict(zip(COLUMNS, np.clip(effective, 3.0, count - 1.0).tolist(), strict=True)),
        smoothing={},
        skew={},
        residual=math.sqrt(square / sum(len(right) for _, right in parts)),
    )


def _solved(matrix: Array, pull: Array) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    both = np.outer(scale, scale)
    return (both * np.linalg.pinv(matrix * both, rcond=1e-10)) @ pull


def _shared(parts: Sequence[tuple[Array, Array]], found: Array, whole: Array, memory: int) -> Array:
    """Variances of `COLUMNS` from what the steps leave together, at the same time after their onsets.

    What one sample pulls the numbers by is summed over the steps; what the sums vary by beyond the steps each for
    itself, which the scatter between them holds already, is shared (clusters in two ways: Cameron, Gelbach and Miller
    2011).
    """
    scores = np.zeros((len(parts), max(len(right) for _, right in parts), len(found)))
    for score, (design, right) in zip(scores, parts, strict=True):
        score[: len(right)] = design * (right - design @ found)[:, np.newaxis]
    pulls = np.array([_solved(whole, score.T).T[:, : len(COLUMNS)] for score in scores])
    together = _varied(pulls.sum(axis=0), memory)
    return np.maximum(together - sum(_varied(pull, memory) for pull in pulls), 0.0)


def _varied(pulls: Array, memory: int) -> Array:
    """Variances of the sum of a series (n, p) whose neighbours within `memory` samples hang together, by weights of
    Bartlett, which leave no variance negative.
    """
    variance = (pulls**2).sum(axis=0)
    for lag in range(1, min(memory, len(pulls) - 1) + 1):
        variance += 2.0 * (1.0 - lag / (memory + 1.0)) * (pulls[lag:] * pulls[:-lag]).sum(axis=0)
    return variance


def _least(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, float]:
    """The numbers that explain all steps best, and the sum of squares that they leave."""
    matrix = sum((design.T @ design for design, _ in parts), np.zeros((1, 1)))
    pull = sum((design.T @ right for design, right in parts), np.zeros(1))
    numbers = _solved(matrix, pull)
    return numbers, sum(float(np.sum((right - design @ numbers) ** 2)) for design, right in parts)


@dataclass(frozen=True)
class _Sides:
    """One step: what the motion does by a number each (n, c), the torque (n,), which rows count, time between them."""

    columns: Array
    torque: Array
    inside: NDArray[np.bool_]
    period: float


def _equations(sides: Sequence[_Sides], lag: float) -> list[tuple[Array, Array]]:
    """Columns as a port of this lag [s] shows them, and right-hand side of each step, its own offset taken out."""
    parts: list[tuple[Array, Array]] = []
    for side in sides:
        # Exact for straight lines between the samples.
        r = side.period / max(lag, 1e-3 * side.period)
        kept = math.exp(-r)
        mean = (1.0 - kept) / r
        columns = np.asarray(
            scipy.signal.lfilter([1.0 - mean, mean - kept], [1.0, -kept], side.columns, axis=0)
        )[side.inside]
        right = side.torque[side.inside]
        parts.append((columns - columns.mean(axis=0), right - right.mean()))
    return parts


def _sides(
    step: StepData,
    torque: Array,
    acceleration: Array,
    series: Sequence[Harmonic],
    width: float,
    late: float,
) -> _Sides:
    """One step, its torque read `late` [s] after its stamps."""
    period = float(np.median(np.diff(step.time)))
    even = np.arange(step.time[0], step.time[-1], period)
    angle, effort, pulled = (
        scipy.interpolate.CubicSpline(step.time, values)(even - skew)
        for values, skew in ((step.input_angle, 0.0), (torque, late), (acceleration, 0.0))
    )
    smooth, first, second = _kernels(period, width)

    def through(values: Array, kernel: Array) -> Array:
        return np.convolve(values, kernel, mode="same")

    speed = through(angle - angle[0], first)
    moving = np.tanh(speed / SPEED_SMOOTHING)
    slope = series_slope(series, angle) if series else np.zeros_like(angle)
    falling = moving * np.exp(-np.abs(speed) / FALLING)
    columns = np.column_stack(
        [
            through(angle - angle[0], second),
            through(pulled * (1.0 / step.ratio + slope), smooth),
            through(moving, smooth),
            speed,
            through(falling, smooth),
            through(moving * slope * step.ratio, smooth),
            *(through(wave(n * angle), smooth) for n in ORDERS for wave in (np.cos, np.sin)),
        ]
    )
    edge = len(smooth)
    inside = np.zeros(len(even), dtype=bool)
    inside[edge:-edge] = True
    inside &= even < _LIVELY
    # Torque at standstill is whatever stiction holds: it says nothing of friction that slides, or of inertia.
    fast = np.abs(speed[edge:-edge])
    onset = edge + int(np.argmax(fast > 0.02 * float(np.max(fast))))
    inside &= np.arange(len(even)) > onset + CLEAR
    return _Sides(columns, through(effort, smooth), inside, period)


def _kernels(period: float, samples: float) -> tuple[Array, Array, Array]:
    """The Gaussian and its first and second derivative by time, as sums over samples."""
    width = samples * period
    lag = np.arange(-math.ceil(6.0 * samples), math.ceil(6.0 * samples) + 1) * period
    bell = np.exp(-0.5 * (lag / width) ** 2)
    bell /= bell.sum()
    return bell, -lag / width**2 * bell, (lag**2 / width**4 - 1.0 / width**2) * bell
