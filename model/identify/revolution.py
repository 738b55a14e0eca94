"""Fourier series of any channel over one revolution, with the orders chosen by the data and the directions apart.

    y(theta) = c_± + sum_n (a_n± cos n theta + b_n± sin n theta)

+ and - are the two directions of travel. Their mean is a function of the angle alone (cogging,
eccentricity); half the difference of the constants is what opposes motion (friction). An order
counts when its amplitude rises above the local noise floor: around each order the squared
amplitudes of noise are exponentially distributed, so their median gives the floor and the chance of
each amplitude; among the orders chosen 5 % are expected to be false. An order that stands out only
in the difference of the directions (friction that varies over angle) counts too. The floor gives
the intervals as well, whatever the colour of the noise. No FFT over time: the series is fitted at
the angles where the samples are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import ComplexArray
from model.errors import IdentificationError
from model.identify.checks import Array, channels, positive
from model.identify.estimate import Estimate
from model.identify.least_squares import correlation_length, student_quantile
from model.kinematic_error import order_spectrum
from model.units import DEGREE, REVOLUTION

HIGHEST_ORDER = 200
TURNING = 3.0 * DEGREE
"""Travel back that counts as a reversal."""
FALSE_ALARM = 0.01
FALSE_SHARE = 0.05
NEIGHBOURS = 20
MEDIAN_EFFICIENCY = 0.48
"""Of the median of exponentially distributed numbers against their mean."""
CHUNK = 4096
Solved = tuple[float, ComplexArray, Array]
"""Constant, complex amplitudes a - ib of the orders (ascending), residual."""


@dataclass(frozen=True)
class DirectionSeries:
    """The series of one direction: constant, a_n and b_n of the chosen orders, and what it leaves (rms, samples)."""

    constant: float
    cosine: Array
    sine: Array
    residual_rms: float
    samples: int


@dataclass(frozen=True, kw_only=True)
class RevolutionFit:
    """A channel over one revolution: orders chosen by significance, strongest first.

    orders (k,); amplitude (k,) of the mean of both directions; estimates: amplitude_n, phase_n of a cos + b sin =
    amplitude cos(n theta - phase), mean, and with both directions friction (half difference) and direction_shift [rad].
    metrics: residual_rms (worst direction), samples, candidates, revolutions. spectrum_order, spectrum_amplitude,
    noise_floor: all candidates for plots; angle, forward_curve, reverse_curve, mean_curve over one revolution.
    """

    orders: np.ndarray
    amplitude: Array
    estimates: dict[str, Estimate]
    metrics: dict[str, float]
    warnings: tuple[str, ...]
    forward: DirectionSeries | None
    reverse: DirectionSeries | None
    spectrum_order: np.ndarray
    spectrum_amplitude: Array
    noise_floor: Array
    angle: Array
    forward_curve: Array | None
    reverse_curve: Array | None
    mean_curve: Array


def directions_of_travel(angle: ArrayLike, *, turning: float = TURNING) -> Array:
    """+1 or -1 for each sample, by reversals larger than `turning` [rad]; jitter below it changes nothing."""
    (theta,) = channels(2, angle=angle)
    sign = np.zeros(len(theta))
    pivot, extreme, heading = 0, 0, 0.0
    for k, value in enumerate(theta.tolist()):
        ahead = value - theta[extreme]
        if heading == 0.0:
            if abs(value - theta[0]) > turning:
                heading, extreme = math.copysign(1.0, value - theta[0]), k
        elif heading * ahead >= 0.0:
            extreme = k
        elif -heading * ahead > turning:
            sign[pivot : extreme + 1] = heading
            pivot, extreme, heading = extreme + 1, k, -heading
    if heading == 0.0:
        raise IdentificationError(
            "does not move",
            where="angle",
            value=f"{np.ptp(theta) / DEGREE:.3g} degrees",
            limit=f"> {turning / DEGREE:g} degrees",
        )
    sign[pivot:] = heading
    return sign


def _usable_order(angle: Array, wanted: int) -> int:
    """The highest order that the samples of one direction can carry: by their number and by their largest gap."""
    place = np.sort(np.mod(angle, REVOLUTION))
    gap = max(float(np.diff(place).max()), float(place[0] + REVOLUTION - place[-1]))
    return min(wanted, math.floor(0.9 * math.pi / max(gap, 1e-12)), len(angle) // 6)


def _coefficients(angle: Array, value: Array, orders: np.ndarray) -> Solved:
    """Constant and complex amplitudes a - ib of the orders (ascending) by least squares, in chunks;
    and the residual.
    """
    p = 1 + 2 * len(orders)
    normal, right = np.zeros((p, p)), np.zeros(p)
    parts = range(0, len(angle), CHUNK)
    for at in parts:
        design = _design(angle[at : at + CHUNK], orders)
        normal += design.T @ design
        right += design.T @ value[at : at + CHUNK]
    eigen, vectors = np.linalg.eigh(normal)
    if eigen[0] <= 1e-9 * eigen[-1]:
        raise IdentificationError(
            "the samples do not cover the revolution evenly enough for these orders",
            where="angle",
            value=f"condition number {math.sqrt(eigen[-1] / max(eigen[0], 1e-300)):.3g}",
            limit="<= 3e4",
            remedy="Cover one whole revolution, or ask for fewer orders.",
        )
    solution = vectors @ ((vectors.T @ right) / eigen)
    residual = np.concatenate(
        [
            value[at : at + CHUNK] - _design(angle[at : at + CHUNK], orders) @ solution
            for at in parts
        ]
    )
    return float(solution[0]), solution[1::2] - 1j * solution[2::2], residual


def _design(angle: Array, orders: np.ndarray) -> Array:
    design = np.empty((len(angle), 1 + 2 * len(orders)))
    design[:, 0] = 1.0
    turn: ComplexArray = np.exp(1j * angle)
    power: ComplexArray = np.ones_like(turn)
    reached = 0
    for k, order in enumerate(orders.tolist()):
        power = power * (turn if order == reached + 1 else turn ** (order - reached))
        reached = order
        design[:, 1 + 2 * k], design[:, 2 + 2 * k] = power.real, power.imag
    return design


def noise_floor(power: Array, *, neighbours: int = NEIGHBOURS) -> Array:
    """Mean noise power around each order from the median of its neighbours (itself left out), peaks
    removed in two rounds.
    """
    n = len(power)
    floor = np.empty(n)
    peak = np.zeros(n, dtype=bool)
    for _ in range(3):
        for k in range(n):
            low = max(min(k - neighbours, n - 2 * neighbours - 1), 0)
            near = np.arange(low, min(low + 2 * neighbours + 1, n))
            quiet = near[(near != k) & ~peak[near]]
            chosen = quiet if len(quiet) >= 4 else near[near != k]
            floor[k] = float(np.median(power[chosen])) / math.log(2.0) if len(chosen) else 0.0
        peak = power > floor * math.log(max(n, 2) / FALSE_ALARM)
    return np.maximum(floor, 1e-300)


def significant(power: Array, floor: Array) -> np.ndarray:
    """Which orders rise above the noise: the share of false ones among them is kept at 5 %
    (Benjamini and Hochberg 1995).

    The floor is itself an estimate from few neighbours, so the ratio follows F(2, 2k) and not an exponential.
    """
    freedom = MEDIAN_EFFICIENCY * min(2 * NEIGHBOURS, max(len(power) - 1, 1))
    chance = (1.0 + power / (floor * freedom)) ** -freedom
    ranked = np.sort(chance)
    passes = np.flatnonzero(ranked <= FALSE_SHARE * np.arange(1, len(ranked) + 1) / len(ranked))
    return chance <= ranked[passes[-1]] if len(passes) else np.zeros(len(chance), dtype=bool)


def fit_revolution(
    angle: ArrayLike, value: ArrayLike, *, highest_order: int = HIGHEST_ORDER, unit: str = "1"
) -> RevolutionFit:
    """The Fourier series of `value` (n,) over one revolution of `angle` [rad], orders chosen automatically.

    Each direction of travel must cover a whole revolution. `unit` names the unit of the value in the estimates.
    """
    theta, y = channels(60, angle=angle, value=value)
    positive("highest_order", float(highest_order))
    sign = directions_of_travel(theta)
    parts = {s: sign == s for s in (1.0, -1.0)}
    warnings: list[str] = []
    covered = {}
    for s, mask in parts.items():
        if mask.sum() >= 60 and np.ptp(theta[mask]) >= 0.98 * REVOLUTION:
            covered[s] = mask
        elif mask.any():
            turned = np.ptp(theta[mask]) / REVOLUTION
            name = "Forward" if s > 0 else "Reverse"
            warnings.append(f"{name} travel covers only {turned:.2f} revolutions and is left out.")
    if not covered:
        raise IdentificationError(
            "covers no whole revolution in any direction",
            where="angle",
            value=f"{np.ptp(theta) / REVOLUTION:.2f} revolutions",
            limit=">= 1",
        )
    highest = min(_usable_order(theta[mask], highest_order) for mask in covered.values())
    if highest < 1:
        raise IdentificationError(
            "leaves gaps in the revolution too wide for any order", where="angle"
        )
    if highest < highest_order:
        warnings.append(f"The samples carry orders up to {highest} only.")
    candidates = np.arange(1, highest + 1)
    every = {s: _coefficients(theta[m], y[m], candidates) for s, m in covered.items()}
    mean = np.mean([solved[1] for solved in every.values()], axis=0)
    floor = _floor(mean, every)
    power = np.abs(mean) ** 2
    stands_out = significant(power, floor)
    if len(every) == 2:
        apart = 0.5 * (every[1.0][1] - every[-1.0][1])
        stands_out |= significant(np.abs(apart) ** 2, _floor(apart, every))
    chosen = candidates[stands_out]
    chosen = chosen[np.argsort(-power[chosen - 1])]
    final = {s: _coefficients(theta[m], y[m], np.sort(chosen)) for s, m in covered.items()}
    series = {s: _series(solved, np.sort(chosen), chosen) for s, solved in final.items()}
    return _revolution_fit(
        chosen,
        series,
        final=final,
        spectrum=mean,
        floor=floor,
        candidates=candidates,
        warnings=warnings,
        unit=unit,
        revolutions=np.ptp(theta) / REVOLUTION,
    )


def _floor(mean: np.ndarray, every: dict[float, Solved]) -> Array:
    """Noise floor of |mean|^2: local where there are enough orders, else white noise of the residual."""
    if len(mean) >= 2 * NEIGHBOURS:
        return noise_floor(np.abs(mean) ** 2)
    variance = 0.0
    for _, _, residual in every.values():
        variance += 4.0 * float(np.var(residual)) * correlation_length(residual) / len(residual)
    return np.full(len(mean), max(variance / len(every) ** 2, 1e-300))


def _series(solved: Solved, sorted_orders: np.ndarray, orders: np.ndarray) -> DirectionSeries:
    constant, amplitude, residual = solved
    ordered = amplitude[np.searchsorted(sorted_orders, orders)]
    rms = float(np.sqrt(np.mean(residual**2)))
    return DirectionSeries(constant, np.real(ordered), -np.imag(ordered), rms, len(residual))


def _revolution_fit(
    orders: np.ndarray,
    series: dict[float, DirectionSeries],
    final: dict[float, Solved],
    spectrum: np.ndarray,
    floor: Array,
    candidates: np.ndarray,
    warnings: list[str],
    unit: str,
    revolutions: float,
) -> RevolutionFit:
    cosine = np.mean([s.cosine for s in series.values()], axis=0)
    sine = np.mean([s.sine for s in series.values()], axis=0)
    amplitude = np.hypot(cosine, sine)
    estimates = _order_estimates(orders, amplitude, np.arctan2(sine, cosine), floor, unit)
    estimates.update(_direction_estimates(orders, series, final, unit))
    angle = np.linspace(0.0, REVOLUTION, 3600, endpoint=False)
    curves = {s: f.constant + _evaluate(angle, orders, f.cosine, f.sine) for s, f in series.items()}
    if not len(orders):
        warnings.append("No order rises above the noise.")
    return RevolutionFit(
        orders=orders,
        amplitude=amplitude,
        estimates=estimates,
        metrics={
            "residual_rms": max(s.residual_rms for s in series.values()),
            "samples": float(sum(s.samples for s in series.values())),
            "candidates": float(len(candidates)),
            "revolutions": float(revolutions),
        },
        warnings=tuple(warnings),
        forward=series.get(1.0),
        reverse=series.get(-1.0),
        spectrum_order=candidates,
        spectrum_amplitude=np.abs(spectrum),
        noise_floor=np.sqrt(floor),
        angle=angle,
        forward_curve=curves.get(1.0),
        reverse_curve=curves.get(-1.0),
        mean_curve=np.mean(list(curves.values()), axis=0),
    )


def _evaluate(angle: Array, orders: np.ndarray, cosine: Array, sine: Array) -> Array:
    phase = angle[:, None] * orders
    return np.cos(phase) @ cosine + np.sin(phase) @ sine


def _order_estimates(
    orders: np.ndarray, amplitude: Array, phase: Array, floor: Array, unit: str
) -> dict[str, Estimate]:
    estimates: dict[str, Estimate] = {}
    t = student_quantile(4.0 * MEDIAN_EFFICIENCY * NEIGHBOURS)
    for n, size, turn in zip(orders.tolist(), amplitude.tolist(), phase.tolist(), strict=True):
        half = t * math.sqrt(0.5 * float(floor[n - 1]))
        angle = min(half / max(size, 1e-300), math.pi)
        estimates[f"amplitude_{n}"] = Estimate(
            name=f"amplitude_{n}",
            value=size,
            unit=unit,
            low=max(size - half, 0.0),
            high=size + half,
        )
        estimates[f"phase_{n}"] = Estimate(
            name=f"phase_{n}", value=turn, unit="rad", low=turn - angle, high=turn + angle
        )
    return estimates


def _direction_estimates(
    orders: np.ndarray, series: dict[float, DirectionSeries], final: dict[float, Solved], unit: str
) -> dict[str, Estimate]:
    """Mean (half sum), friction (half difference), and the angle by which the series of the directions are shifted."""
    errors = {
        s: math.sqrt(float(np.var(r)) * correlation_length(r) / len(r))
        for s, (_, _, r) in final.items()
    }
    if len(series) == 1:
        (only,) = series
        half = 1.96 * errors[only]
        value = series[only].constant
        note = "one direction only: friction and offset cannot be separated"
        return {
            "mean": Estimate(
                name="mean",
                value=value,
                unit=unit,
                low=value - half,
                high=value + half,
                identifiable="weakly",
                note=note,
            )
        }
    ahead, back = series[1.0], series[-1.0]
    half = 0.5 * 1.96 * math.hypot(errors[1.0], errors[-1.0])
    total, apart = 0.5 * (ahead.constant + back.constant), 0.5 * (ahead.constant - back.constant)
    estimates = {
        "mean": Estimate(name="mean", value=total, unit=unit, low=total - half, high=total + half),
        "friction": Estimate(
            name="friction", value=apart, unit=unit, low=apart - half, high=apart + half
        ),
    }
    if len(orders):
        phases = np.arctan2(ahead.sine, ahead.cosine) - np.arctan2(back.sine, back.cosine)
        wrapped = np.angle(np.exp(1j * phases))
        weight = (orders * np.hypot(ahead.cosine, ahead.sine)) ** 2
        shifts = wrapped / orders
        shift = float(weight @ shifts / weight.sum())
        spread = 2.0 * math.sqrt(float(weight @ (shifts - shift) ** 2 / weight.sum()) / len(orders))
        estimates["direction_shift"] = Estimate(
            name="direction_shift", value=shift, unit="rad", low=shift - spread, high=shift + spread
        )
    return estimates


@dataclass(frozen=True)
class OrderPeaks:
    """The order spectrum of a channel with its local noise floor, and which orders stand out (strongest first).

    orders are cycles per revolution of the angle given, or per output revolution where a ratio was given.
    """

    orders: Array
    amplitude: Array
    phase: Array
    noise_floor: Array
    peaks: Array
    revolutions: int


def order_peaks(
    angle: ArrayLike, value: ArrayLike, *, ratio: float = 1.0, highest_order: float = 64.0
) -> OrderPeaks:
    """The spectrum of any channel over the input angle, or over the output angle with `ratio`
    (orders k per output turn).

    Uses the largest whole number of revolutions, resampled over angle. Peaks rise above the local
    noise floor (1 % false alarm).
    """
    theta, y = channels(32, angle=angle, value=value)
    positive("ratio", ratio)
    spectrum = order_spectrum(theta / ratio, y, highest_order)
    floor = noise_floor(spectrum.amplitude[1:] ** 2)
    power = spectrum.amplitude[1:] ** 2
    above = power > floor * math.log(max(len(power), 2) / FALSE_ALARM)
    top = (
        above
        & (power >= np.concatenate([power[1:], [0.0]]))
        & (power >= np.concatenate([[0.0], power[:-1]]))
    )
    index = np.flatnonzero(top)
    index = index[np.argsort(-power[index])]
    return OrderPeaks(
        spectrum.orders[1:],
        spectrum.amplitude[1:],
        spectrum.phase[1:],
        np.sqrt(floor),
        spectrum.orders[1:][index],
        spectrum.revolutions,
    )
