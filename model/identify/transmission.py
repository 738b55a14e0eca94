"""Curves and single numbers from a fitted kinematic error: transmission accuracy, averaged curve, goodness of fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from model.identify.angle_fit import LEAST_TURNS, WHOLE_TURN, AngleFit, Spectrum
from model.identify.angle_regression import CELLS
from model.identify.checks import Array
from model.identify.estimate import BudgetLine, Estimate
from model.kernels import regression as kernels
from model.kinematic_error import normalised_mse
from model.units import REVOLUTION

_POINTS_PER_PERIOD = 48
"""Of the highest order; the extremes of one of half of it are missed by 5e-4 of its amplitude."""
_DRAWS = 2000
_EXTREMES = 200
"""Local extremes of the curve on either side that may become its largest when it is drawn anew."""
REACH = 5.0
"""Standard uncertainties of the whole curve by which no draw moves a place further."""
FLOOR_BAND = 0.25
"""Orders over which the noise floor of a spectrum is taken as level."""


def curve_over_output(fit: AngleFit, highest_order: float) -> tuple[Array, Array]:
    """The fitted curve without constant and trend over one output revolution: input angles [rad] and values."""
    ratio = fit.basis.ratio
    orders = np.array(fit.basis.orders)
    cosine, sine = fit.values[2::2].copy(), fit.values[3::2].copy()
    left_out = orders > highest_order + 1e-9
    cosine[left_out], sine[left_out] = 0.0, 0.0
    points = max(_POINTS_PER_PERIOD * math.ceil(float(orders.max()) * ratio), 1024)
    angle: Array = np.arange(points, dtype=np.float64) * (REVOLUTION * ratio / points)
    multiples = orders * ratio
    whole = np.rint(multiples).astype(np.int64)
    if np.abs(multiples - whole).max() < 1e-6:
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
        np.add.at(spectrum, whole, 0.5 * points * (cosine - 1j * sine))
        return angle, np.fft.irfft(spectrum, points)
    return angle, kernels.series_on_grid(angle, orders, cosine, sine)


def transmission_accuracy(
    fit: AngleFit, highest_order: float, torsion: BudgetLine
) -> tuple[Estimate, Array, Array]:
    """Largest positive plus largest negative deviation of the fitted curve over one output
    revolution, with 95 % interval. `torsion` is the line of what the first mode leaves open.

    Returns the estimate, and the curve with its input angles. The orders are drawn anew from their
    distribution (Monte Carlo, JCGM 101), each curve has its own extremes: their mean distance is
    larger than that of the curve itself. By as much the curve's own is larger than the true one;
    it is taken off, and the interval reflected.
    """
    angle, curve = curve_over_output(fit, highest_order)
    orders = np.array(fit.basis.orders)
    use = np.repeat(orders <= highest_order + 1e-9, 2)
    value = float(np.ptp(curve))
    spread, freedom = fit.covariance[2:, 2:], fit.freedom
    doubt = np.zeros(len(spread)) if fit.doubt is None else fit.doubt[2:]
    reach = REACH * (math.sqrt(max(float(np.trace(spread)), 0.0)) + float(np.abs(doubt).sum()))
    places = [_extremes(sign * curve, reach) for sign in (1.0, -1.0)]
    columns = [_waves(orders, angle[at]) * use for at in places]
    random = np.random.default_rng(1)
    draws = random.standard_normal((_DRAWS, len(spread)))
    draws *= np.sqrt(freedom / random.chisquare(freedom, _DRAWS))[:, None]
    shaped = np.ascontiguousarray(kernels.square_root(spread).T)
    noise = [
        kernels.times_transposed(draws, kernels.times_transposed(waves, shaped))
        for waves in columns
    ]
    data = _peak_to_peak(curve, places, noise)
    whole = data
    lines = [
        BudgetLine("residual, Monte Carlo", "A", float(data.std()), degrees_of_freedom=freedom)
    ]
    if doubt.any():
        sizes = random.standard_normal(_DRAWS)
        shaken = [np.outer(sizes, waves @ doubt) for waves in columns]
        both = [one + other for one, other in zip(noise, shaken, strict=True)]
        whole = _peak_to_peak(curve, places, both)
        only = _peak_to_peak(curve, places, shaken)
        lines.append(replace(torsion, standard_uncertainty=float(only.std())))
    low, high = np.quantile(whole, [0.025, 0.975])
    estimate = Estimate(
        name="transmission_accuracy",
        value=max(2.0 * value - float(data.mean()), 0.0),
        unit="rad",
        low=max(2.0 * value - float(high), 0.0),
        high=max(2.0 * value - float(low), 0.0),
        budget=tuple(lines),
    )
    return estimate, angle, curve


def _extremes(curve: Array, reach: float = math.inf) -> np.ndarray:
    """Places of the largest local maxima of a periodic curve that changes by up to `reach` anywhere."""
    highest = np.max(curve)
    near = (curve >= np.roll(curve, 1)) & (curve > np.roll(curve, -1))
    tops = np.flatnonzero(near & (curve >= highest - 2.0 * reach))
    if not len(tops):
        return np.array([int(np.argmax(curve))])
    largest: np.ndarray = tops[np.argsort(curve[tops])[-_EXTREMES:]]
    return largest


def _waves(orders: Array, angle: Array) -> Array:
    """Cosines and sines of the orders at these angles, (angles, 2 orders)."""
    phase = angle[:, None] * orders[None, :]
    waves = np.empty((len(angle), 2 * len(orders)))
    waves[:, 0::2], waves[:, 1::2] = np.cos(phase), np.sin(phase)
    return waves


def _peak_to_peak(curve: Array, places: list[np.ndarray], changes: list[Array]) -> Array:
    """Peak-to-peak of the curve with each change (draws, places) at the places that may be its extremes."""
    top = (curve[places[0]] + changes[0]).max(axis=1)
    bottom = (curve[places[1]] + changes[1]).min(axis=1)
    distance: Array = top - bottom
    return distance


def raised_by(angle: Array, curve: Array, waves: Mapping[float, float]) -> float:
    """How much larger the peak-to-peak of a curve becomes on average by waves of these orders, whose cosines and
    sines have these standard uncertainties (Monte Carlo, JCGM 101) [unit of the curve].
    """
    sizes = np.repeat(np.array(list(waves.values())), 2)
    if not sizes.any():
        return 0.0
    places = [_extremes(sign * curve) for sign in (1.0, -1.0)]
    columns = [_waves(np.array(list(waves)), angle[at]) for at in places]
    draws = np.random.default_rng(2).standard_normal((_DRAWS // 4, len(sizes))) * sizes
    raised = _peak_to_peak(
        curve, places, [kernels.times_transposed(draws, waves) for waves in columns]
    )
    return float(raised.mean() - np.ptp(curve))


def left_over(fit: AngleFit, highest_order: float) -> float:
    """R.m.s. of what the residual holds above its noise up to an order: orders that the fit has not [rad]."""
    spectrum = Spectrum.of(fit.cells, fit.residual)
    last = math.floor((highest_order + 0.5) / spectrum.spacing)
    power = np.abs(spectrum.lines[1 : last + 1]) ** 2
    band = max(round(FLOOR_BAND / spectrum.spacing), 8)
    pieces = [power[k : k + band] for k in range(0, len(power), band)]
    # The median of the squares of noise is ln 2 of their mean.
    excess = sum(
        float(piece.sum()) - len(piece) * float(np.median(piece)) / math.log(2.0)
        for piece in pieces
    )
    return math.sqrt(max(0.5 * excess, 0.0))


def measured_curve(fit: AngleFit) -> tuple[Array, Array, Array]:
    """The kinematic error averaged per cell of input angle, and the fit averaged over the same samples.

    Constant and trend are taken out of both. Returns input angles in [0, 2 pi), measured and
    fitted, shape (cells filled,).
    """
    series = fit.cells.series(fit.basis, fit.values)
    filled, (fitted, rest) = fit.cells.per_place(series, fit.residual)
    angle: Array = (np.arange(CELLS, dtype=np.float64)[filled] + 0.5) * (REVOLUTION / CELLS)
    return angle, fitted + rest, fitted


def left_out_mse(fit: AngleFit) -> float:
    """MSE (22) on revolutions that were left out: every second one is predicted from the others,
    and those from it; NaN where there are too few.

    The curves are averaged per cell of input angle, as for the MSE of the fit.
    """
    cells, used = fit.cells, fit.used
    if cells.revolutions < WHOLE_TURN * fit.basis.ratio or cells.rows < LEAST_TURNS:
        return math.nan
    mean = cells.mean[0]
    odd = cells.count * np.repeat(np.arange(cells.rows) % 2, CELLS)
    regressors, chosen = cells.regressors, used[2::2]
    whole = regressors.normal(fit.basis, chosen)
    of_odd = regressors.normal(fit.basis, chosen, odd)
    scores: list[float] = []
    for seen, half in ((of_odd, odd), (whole - of_odd, cells.count - odd)):
        new = cells.count - half
        values = np.zeros(len(used))
        values[used] = np.linalg.solve(seen, regressors.products(fit.basis, chosen, half * mean))
        series = cells.series(fit.basis, values)
        away = mean - values[0] - values[1] * cells.trend
        curves = cells.per_place(away, series, weight=new)[1]
        measured: Array = curves[0]
        predicted: Array = curves[1]
        scores.append(normalised_mse(measured, predicted + np.mean(measured - predicted)))
    return float(np.mean(scores))


def repeatability(fit: AngleFit) -> float:
    """Scatter of the curve from one input revolution to the next: rms over angle [unit of the value].

    Each revolution's own deviation in the whole input orders; noise of the samples is part of it.
    """
    cells = fit.cells
    orders = np.array(fit.basis.orders)
    whole = np.rint(orders[(np.abs(orders - np.rint(orders)) < 1e-9) & fit.used[2::2]])
    counts = fit.row_count
    full = counts > 0.5 * np.median(counts)
    if whole.size == 0 or full.sum() < 3:
        return math.nan
    rows = (cells.count * fit.residual).reshape(cells.rows, CELLS)[full]
    lines = 2.0 * np.fft.rfft(rows, axis=1)[:, whole.astype(np.int64)] / counts[full][:, None]
    square: Array = np.sum(0.5 * np.abs(lines) ** 2, axis=1)
    return math.sqrt(float(np.mean(square)))
