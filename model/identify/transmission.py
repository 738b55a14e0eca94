"""Curves and single numbers from a fitted kinematic error: transmission accuracy, averaged curve, repeatability."""

from __future__ import annotations

import math

import numpy as np

from model.identify.angle_regression import AngleFit
from model.identify.checks import Array
from model.identify.estimate import Estimate
from model.kernels import regression as kernels
from model.units import REVOLUTION

POINTS_PER_PERIOD = 16


def curve_over_output(fit: AngleFit, highest_order: float) -> tuple[Array, Array]:
    """The fitted curve without constant and trend over one output revolution: input angles [rad] and values."""
    ratio = fit.sums.basis.ratio
    orders = np.array(fit.sums.basis.orders)
    cosine, sine = fit.values[2::2].copy(), fit.values[3::2].copy()
    left_out = orders > highest_order + 1e-9
    cosine[left_out], sine[left_out] = 0.0, 0.0
    points = max(POINTS_PER_PERIOD * math.ceil(float(orders.max()) * ratio), 1024)
    angle: Array = np.arange(points, dtype=np.float64) * (REVOLUTION * ratio / points)
    multiples = orders * ratio
    whole = np.rint(multiples).astype(np.int64)
    if np.abs(multiples - whole).max() < 1e-6:
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
        np.add.at(spectrum, whole, 0.5 * points * (cosine - 1j * sine))
        return angle, np.fft.irfft(spectrum, points)
    return angle, kernels.series_on_grid(angle, orders, cosine, sine)


def transmission_accuracy(fit: AngleFit, highest_order: float) -> tuple[Estimate, Array, Array]:
    """Largest positive plus largest negative deviation of the fitted curve over one output
    revolution, with 95 % interval.

    Returns the estimate, and the curve with its input angles. The interval is that of the
    difference of the fitted curve at its two extremes; extremes of a noisy curve lie too far apart
    by less than that.
    """
    angle, curve = curve_over_output(fit, highest_order)
    top, bottom = int(np.argmax(curve)), int(np.argmin(curve))
    value = float(curve[top] - curve[bottom])
    orders = np.array(fit.sums.basis.orders)
    use = orders <= highest_order + 1e-9
    gradient = np.zeros(fit.sums.basis.parameters)
    gradient[2::2] = use * (np.cos(orders * angle[top]) - np.cos(orders * angle[bottom]))
    gradient[3::2] = use * (np.sin(orders * angle[top]) - np.sin(orders * angle[bottom]))
    half = fit.quantile() * math.sqrt(max(float(gradient @ fit.covariance @ gradient), 0.0))
    return (
        Estimate(
            name="transmission_accuracy",
            value=value,
            unit="rad",
            low=max(value - half, 0.0),
            high=value + half,
        ),
        angle,
        curve,
    )


def measured_curve(fit: AngleFit) -> tuple[Array, Array, Array]:
    """The kinematic error averaged per cell of input angle, and the fit averaged over the same samples.

    Constant and trend are taken out of both. Returns input angles in [0, 2 pi), measured and
    fitted, shape (cells filled,).
    """
    sums = fit.sums
    counts = sums.bin_basis[:, 0]
    filled = counts > 0
    cells = len(counts)
    values = fit.values.copy()
    values[0] -= sums.reference
    common = sums.bin_basis[filled][:, :2] @ values[:2]
    fitted = (sums.bin_basis[filled][:, 2:] @ values[2:]) / counts[filled]
    measured = (sums.bin_value[filled] - common) / counts[filled]
    angle: Array = (np.arange(cells, dtype=np.float64)[filled] + 0.5) * (REVOLUTION / cells)
    return angle, measured, fitted


def repeatability(fit: AngleFit) -> float:
    """Scatter of the curve from one block of whole input revolutions to the next: rms over angle [unit of the value].

    Each block's own deviation in the whole input orders follows from its scores; noise of the samples is part of it.
    """
    sums = fit.sums
    orders = np.array(sums.basis.orders)
    whole = np.flatnonzero((np.abs(orders - np.rint(orders)) < 1e-9) & fit.used[2::2])
    counts = fit.block_count
    full = counts > 0.5 * np.median(counts)
    if whole.size == 0 or full.sum() < 3:
        return math.nan
    columns = np.sort(np.concatenate([2 + 2 * whole, 3 + 2 * whole]))
    deviation = 2.0 * fit.scores[full][:, columns] / counts[full][:, None]
    return math.sqrt(float(np.mean(np.sum(0.5 * deviation**2, axis=1))))
