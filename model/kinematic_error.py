"""The kinematic error: definition, series, basis of orders, spectrum, goodness of fit, and the error as a wedge lift.

(15)  ke(theta_i) = theta_o - theta_i/N        theta_o counted positive opposite to theta_i, circular spline fixed;
                                               with the flexspline fixed both turn alike and the ratio is N + 1
(16)  ke_sim(theta_i) = a_0 + sum over n of a_n cos(n theta_i) + b_n sin(n theta_i)
(17)  e = ke_sim r_g/tan(alpha_t)              1 arcmin is 15.6 micrometre at a neutral radius of 31 mm and 30 degrees
(22)  MSE = 100/(N_0 sigma^2) sum (ke_sim - ke)^2        sigma^2 = population variance of ke over the N_0 points

Positive means that the output leads its ideal position when the input turns in the positive sense.
Orders are cycles per input revolution and need not be whole: the flexspline meets the wave
generator n(1 + 1/N) times per input revolution, and what turns with the output has orders k/N.
Equations 17 and 22 as printed in Zou et al. 2015, 15 after Ghorbel 2001, 16 from the paper's
notation.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import irfft, next_fast_len  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from model.arrays import ComplexArray, FloatArray
from model.errors import ModelError
from model.gear import Harmonic, HarmonicDrive, Mounting, as_mounted
from model.geometry import radial_lever

_OrderKind = Literal["input", "output", "wave-sideband", "output-sideband"]


@dataclass(frozen=True, slots=True)
class Order:
    """One frequency of the basis: cycles per input revolution, what makes it, and its name ("2", "1/N", "2+2/N")."""

    order: float
    kind: _OrderKind
    label: str


def kinematic_error(
    input_angle: ArrayLike,
    output_angle: ArrayLike,
    ratio: float,
    mounting: Mounting = "circular-spline-fixed",
    *,
    encoders_alike: bool = True,
) -> FloatArray:
    """ke = theta_o - theta_i/N from two encoder angles (equation 15) [rad].

    `ratio` is N of the unit (teeth only); with the flexspline fixed N + 1 is used. `encoders_alike` says that both
    encoders count up for the same sense of rotation; then a gear with its circular spline fixed needs the output's sign
    turned. The angles' offsets remain in ke.
    """
    sign = output_sign(mounting, encoders_alike=encoders_alike)
    return sign * _floats(output_angle) - _floats(input_angle) / as_mounted(ratio, mounting)


def _floats(values: ArrayLike) -> FloatArray:
    """Numbers of any kind as an array, which is a copy only where it has to be."""
    return np.asarray(values, dtype=np.float64)


def output_sign(mounting: Mounting, *, encoders_alike: bool = True) -> float:
    """The factor that makes a raw output angle theta_o of the model: it grows when the input angle grows."""
    opposite = mounting == "circular-spline-fixed"
    return -1.0 if opposite == encoders_alike else 1.0


def series_value(series: Iterable[Harmonic], angle: ArrayLike) -> FloatArray:
    """ke_sim(theta) of equation 16 without its constant, for angles of any shape [rad]."""
    theta = _floats(angle)
    total = np.zeros_like(theta)
    for h in series:
        phase = h.order * theta
        total += h.cosine * np.cos(phase) + h.sine * np.sin(phase)
    return total


def series_slope(series: Iterable[Harmonic], angle: ArrayLike) -> FloatArray:
    """d ke_sim/d theta_i, of the same shape as the angles [rad/rad]."""
    theta = _floats(angle)
    total = np.zeros_like(theta)
    for h in series:
        phase = h.order * theta
        total += h.order * (h.sine * np.cos(phase) - h.cosine * np.sin(phase))
    return total


def peak_to_peak(series: Sequence[Harmonic], ratio: float | None = None, points: int = 64) -> float:
    """Largest minus smallest value of the series [rad] over one input revolution, or one output
    revolution with `ratio`.

    `points` per period of the highest order; the extremes between them are found by a parabola.
    """
    if not series:
        return 0.0
    whole = ratio is None or all(float(h.order).is_integer() for h in series)
    revolutions = 1.0 if whole or ratio is None else ratio
    count = math.ceil(points * max(4.0, *(h.order for h in series)) * revolutions)
    value = _over_revolutions(series, revolutions, next_fast_len(count, real=True) or count)
    return _extreme(value) + _extreme(-value)


def _over_revolutions(series: Sequence[Harmonic], revolutions: float, count: int) -> FloatArray:
    """The series (count,) at equal steps over so many input revolutions."""
    cycles = np.array([h.order * revolutions for h in series])
    whole = np.rint(cycles)
    if np.abs(cycles - whole).max() > 1e-9 * count:
        angle = np.linspace(0.0, 2.0 * math.pi * revolutions, count, endpoint=False)
        return series_value(series, angle)
    # Orders that close over the revolutions are lines of one spectrum: fifty times faster.
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    amplitudes = [0.5 * count * complex(h.cosine, -h.sine) for h in series]
    np.add.at(spectrum, whole.astype(np.int64), amplitudes)
    return np.asarray(irfft(spectrum, count), dtype=np.float64)


def _extreme(value: FloatArray) -> float:
    """Largest value of a periodic, densely sampled curve, refined by a parabola through its neighbours."""
    top = int(np.argmax(value))
    before, at, after = value[top - 1], value[top], value[(top + 1) % value.size]
    curvature = before - 2.0 * at + after
    return float(at if curvature >= 0.0 else at - 0.125 * (after - before) ** 2 / curvature)


def equivalent_eccentric_error(gear: HarmonicDrive, error: ArrayLike) -> FloatArray:
    """e = ke r_g/tan(alpha_t), the radial error of the wedge that makes this kinematic error (equation 17) [m]."""
    return _floats(error) * radial_lever(gear.geometry)


def speed_ripple(gear: HarmonicDrive, points: int = 7200) -> float:
    """N max|d ke/d theta_i|: largest relative deviation of the output speed from theta_i'/N that the error makes."""
    angle = np.linspace(0.0, 2.0 * math.pi, points, endpoint=False)
    return gear.ratio * float(np.max(np.abs(series_slope(gear.kinematic_error, angle))))


def basis_orders(
    ratio: float,
    input_orders: Iterable[int] = range(1, 13),
    output_orders: Iterable[int] = range(1, 5),
    wave_sidebands: Iterable[int] = (1, 2, 4),
    output_sidebands: Iterable[tuple[int, int]] = ((2, 1), (2, 2)),
) -> list[Order]:
    """The orders of the basis, in cycles per input revolution, each once.

    `input_orders` n; `output_orders` k as k/N; `wave_sidebands` n as n(1 + 1/N), what turns with
    the flexspline past the wave generator; `output_sidebands` (n, k) as n - k/N and n + k/N. An
    order that two of these name (2 + 2/N is 2(1 + 1/N)) appears once, under the first name.
    """
    if ratio <= 0.0 or not math.isfinite(ratio):
        raise ModelError("needs the ratio of the gear", where="ratio", value=ratio, limit="> 0")
    orders = [Order(float(n), "input", str(n)) for n in input_orders]
    orders += [Order(k / ratio, "output", f"{k}/N") for k in output_orders]
    orders += [
        Order(n * (1.0 + 1.0 / ratio), "wave-sideband", f"{n}+{n}/N") for n in wave_sidebands
    ]
    for n, k in output_sidebands:
        orders.append(Order(n - k / ratio, "output-sideband", f"{n}-{k}/N"))
        orders.append(Order(n + k / ratio, "output-sideband", f"{n}+{k}/N"))
    unique: dict[int, Order] = {}
    for order in orders:
        if order.order <= 0.0:
            raise ModelError(
                "an order must be positive",
                where=f"order {order.label}",
                value=order.order,
                limit="> 0",
            )
        unique.setdefault(round(order.order * 1e9), order)
    return sorted(unique.values(), key=lambda order: order.order)


def lattice_label(order: float, ratio: float) -> str:
    """The name of an order v = n + k/N: "2", "1/N", "2-1/N"; one off that lattice is its number."""
    whole = round(order)
    part = (order - whole) * ratio
    side = round(part)
    if abs(part - side) > 1e-6 or whole < 0:
        return f"{order:g}"
    if side == 0:
        return str(whole)
    if whole == 0:
        return f"{side}/N"
    return f"{whole}{side:+d}/N"


def order_of_label(label: str, ratio: float) -> float:
    """The order that `lattice_label` or a basis calls so; raises `ModelError` for a name that is none."""
    match = re.fullmatch(r"(\d+)(?:([+-])(\d+)/N)?|(\d+)/N", label)
    if match is not None:
        side = int(match[3] or match[4] or 0) * (-1 if match[2] == "-" else 1)
        return int(match[1] or 0) + side / ratio
    try:
        return float(label)
    except ValueError:
        raise ModelError("is not the name of an order", where="order", value=label) from None


def design_matrix(
    input_angle: ArrayLike,
    orders: Iterable[Order | float],
    *,
    constant: bool = True,
    trend: bool = True,
) -> FloatArray:
    """The regressors of ke at these input angles: 1, theta_i, then cos and sin of each order; shape (n, columns)."""
    theta = _floats(input_angle).ravel()
    numbers = [order.order if isinstance(order, Order) else float(order) for order in orders]
    first = int(constant) + int(trend)
    matrix = np.empty((theta.size, first + 2 * len(numbers)))
    if constant:
        matrix[:, 0] = 1.0
    if trend:
        matrix[:, first - 1] = theta
    for index, order in enumerate(numbers):
        phase = order * theta
        np.cos(phase, out=matrix[:, first + 2 * index])
        np.sin(phase, out=matrix[:, first + 2 * index + 1])
    return matrix


def normalised_mse(measured: ArrayLike, fitted: ArrayLike) -> float:
    """MSE of equation 22: 100 x mean squared deviation over the population variance of the measured error.

    100 is no better than the mean, below 5 is a good fit, below 1 an excellent one. Raises `ModelError` for arrays of
    different length, without data, or where the measured error does not vary.
    """
    truth, model = _floats(measured).ravel(), _floats(fitted).ravel()
    if truth.size != model.size or truth.size < 2:
        sizes = f"{truth.size} and {model.size} points"
        raise ModelError(
            "needs two curves of the same length",
            where="MSE",
            value=sizes,
            limit="at least 2 points",
        )
    variance = float(np.var(truth))
    if not variance > 0.0 or not math.isfinite(variance):
        raise ModelError(
            "the measured error does not vary", where="MSE", value=variance, limit="a variance > 0"
        )
    return 100.0 * float(np.mean((model - truth) ** 2)) / variance


@dataclass(frozen=True, slots=True)
class OrderSpectrum:
    """Amplitude and phase of a channel over an angle.

    `orders` [cycles per revolution of the angle], `amplitude` [unit of the channel], `phase` [rad] of
    amplitude x cos(order theta - phase), `revolutions` used (whole).
    """

    orders: FloatArray
    amplitude: FloatArray
    phase: FloatArray
    revolutions: int


def order_spectrum(
    angle: ArrayLike, values: ArrayLike, highest_order: float = 64.0
) -> OrderSpectrum:
    """The order spectrum of a channel over an angle [rad], from the largest whole number of revolutions.

    The channel is averaged in bins of equal angle (at least eight per period of the highest order) and transformed; a
    straight line through the bins is taken out first and the averaging of the bins is undone. The angle must be
    monotonic apart from jitter smaller than a bin. Raises `ModelError` with less than one revolution or other faults.
    """
    theta, channel = _floats(angle).ravel(), _floats(values).ravel()
    if theta.size != channel.size or theta.size < 16:
        sizes = f"{theta.size} angles, {channel.size} values"
        raise ModelError(
            "needs an angle for every value",
            where="order spectrum",
            value=sizes,
            limit="at least 16",
        )
    if not (np.isfinite(theta).all() and np.isfinite(channel).all()):
        raise ModelError(
            "holds numbers that are not finite",
            where="order spectrum",
            remedy="Cut the holes out first.",
        )
    sign = math.copysign(1.0, theta[-1] - theta[0])
    travelled = sign * (theta - theta[0])
    revolutions = math.floor(travelled[-1] / (2.0 * math.pi) + 1e-9)
    if revolutions < 1:
        turned = f"{travelled[-1] / (2.0 * math.pi):.3g} revolutions"
        raise ModelError(
            "needs a whole revolution", where="order spectrum", value=turned, limit=">= 1"
        )
    per_revolution = 2 ** math.ceil(math.log2(8.0 * max(highest_order, 1.0)))
    binned = _bin_means(travelled, channel, revolutions, per_revolution)
    position = np.arange(binned.size) - 0.5 * (binned.size - 1)
    binned = binned - binned.mean() - position * (position @ binned) / (position @ position)
    coefficients: ComplexArray = 2.0 * np.fft.rfft(binned) / binned.size
    orders = np.arange(coefficients.size) / revolutions
    keep = orders <= highest_order
    orders, coefficients = orders[keep], coefficients[keep]
    amplitude = np.abs(coefficients) / np.sinc(orders / per_revolution)
    middle_of_bin = orders * math.pi / per_revolution
    phase = sign * (middle_of_bin - np.angle(coefficients)) + orders * theta[0]
    return OrderSpectrum(orders, amplitude, np.angle(np.exp(1j * phase)), revolutions)


def _bin_means(
    travelled: FloatArray, channel: FloatArray, revolutions: int, per_revolution: int
) -> FloatArray:
    """Means of the channel over bins of equal angle; bins without a sample are interpolated between
    their neighbours.
    """
    count = revolutions * per_revolution
    bins = np.floor(travelled * (per_revolution / (2.0 * math.pi))).astype(np.int64)
    inside = (bins >= 0) & (bins < count)
    hits = np.bincount(bins[inside], minlength=count)
    sums = np.bincount(bins[inside], weights=channel[inside], minlength=count)
    filled = np.flatnonzero(hits)
    if filled.size < 0.5 * count:
        order = np.argsort(travelled, kind="stable")
        centre = (np.arange(count) + 0.5) * (2.0 * math.pi / per_revolution)
        return np.interp(centre, travelled[order], channel[order])
    means = sums[filled] / hits[filled]
    return means if filled.size == count else np.interp(np.arange(count), filled, means)
