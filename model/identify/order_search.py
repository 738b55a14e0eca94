"""Which orders a kinematic error has: input orders, output orders and sidebands that stand above the noise.

A harmonic drive's error has orders n, what turns with the output k/N, and sidebands n - k/N and
n + k/N of any input order n. Which of them a gear and its encoders have, the residual tells: its
projection on every order of that lattice, against the noise beside it.
"""

from __future__ import annotations

import math

import numpy as np

from model.identify.angle_fit import WHOLE_TURN, AngleFit, Spectrum, solve_angle
from model.identify.angle_regression import CELLS, LATTICE_TOLERANCE, Basis, Cells
from model.identify.checks import Array
from model.identify.counting import LockedRounding
from model.kinematic_error import lattice_label

SIDEBANDS = 12
"""Output orders to each side of an input order that are looked at, and half as many more about zero."""
FALSE_ALARM = 1e-4
"""Probability that noise alone adds an order to a basis."""
AT_ONCE = 0.1
"""Share of the strongest line that is left, from which on others are added with it: weaker ones may be its leakage."""
ROUNDS = 8
_MAXIMUM_ORDERS = 120
"""Orders of a basis; a gear has some dozens."""


def in_orders_of_all(
    fits: list[AngleFit], highest: int, rounding: list[LockedRounding | None]
) -> list[AngleFit]:
    """The fits in one basis, with every order of the lattice that stands above the noise in any of them."""
    own = [followed(fit, highest, locked) for fit, locked in zip(fits, rounding, strict=True)]
    basis = own[0].basis
    for fit in own[1:]:
        basis = basis.united(fit.basis)
    return [
        fit if fit.basis.orders == basis.orders else solve_angle(fit.cells, basis)[0] for fit in own
    ]


def followed(
    fit: AngleFit, highest: int, rounding: LockedRounding | None, slowest: float = 0.0
) -> AngleFit:
    """The fit with every order of the lattice from `slowest` on that stands above the noise."""
    ratio = fit.basis.ratio
    whole = abs(ratio - round(ratio)) <= LATTICE_TOLERANCE
    if not whole or fit.cells.revolutions < WHOLE_TURN * ratio:
        return fit
    turning = _turning(fit.cells, ratio)
    for _ in range(ROUNDS):
        found = _above_the_noise(fit, turning, highest, rounding, slowest)
        if not found:
            break
        labels = tuple(lattice_label(v, ratio) for v in found)
        fit, _ = solve_angle(fit.cells, fit.basis.united(Basis(ratio, found, labels)))
    return fit


def _above_the_noise(
    fit: AngleFit,
    turning: tuple[Array, Array],
    highest: int,
    rounding: LockedRounding | None,
    slowest: float,
) -> tuple[float, ...]:
    """Orders outside the basis whose line is too strong for the noise beside it; the strongest of them."""
    basis = fit.basis
    orders, power = _lattice_power(fit.cells, fit.residual, turning, basis.ratio, highest)
    taken = np.array(basis.orders)
    new = np.abs(orders[:, None] - taken[None, :]).min(axis=1) > 1e-9
    new &= orders >= slowest
    orders, power = orders[new], power[new]
    if not len(orders):
        return ()
    spectrum = Spectrum.of(fit.cells, fit.residual)
    noise = _median_noise(spectrum, orders)
    if rounding is not None:
        noise = noise + 2.0 * rounding.variance(orders)
    limit = math.log(len(orders) / FALSE_ALARM)
    room = _MAXIMUM_ORDERS - len(basis.orders)
    above = power > limit * noise
    above &= power > AT_ONCE**2 * power.max()
    strongest = np.argsort(np.where(above, -power, 0.0))[: min(int(above.sum()), room)]
    return tuple(float(v) for v in np.sort(orders[strongest]))


def _sidebands(ratio: float) -> int:
    return min(SIDEBANDS, math.ceil(ratio / 2.0) - 1)


def _turning(cells: Cells, ratio: float) -> tuple[Array, Array]:
    """e^(-j theta/N) at the cells (c,), and where it stands at the lowest sideband; the same for every residual."""
    step = np.exp((-1j / ratio) * cells.angle)
    return step, step.conj() ** _sidebands(ratio)


def _lattice_power(
    cells: Cells, residual: Array, turning: tuple[Array, Array], ratio: float, highest: int
) -> tuple[Array, Array]:
    """Orders n + m/N above zero, and the squared amplitude of the residual at each."""
    side = _sidebands(ratio)
    weighted = cells.count * residual * (2.0 / float(cells.count.sum()))
    sides = np.arange(-side, side + 1)
    folded = np.empty((len(sides), CELLS), dtype=np.complex128)
    step, lowest = turning
    turned = weighted * lowest
    for row in folded:
        row[:] = turned.reshape(cells.rows, CELLS).sum(axis=0)
        turned *= step
    # Cells are in the order of travel: against it the transform turns the other way.
    lines = np.fft.fft(folded) if cells.direction > 0.0 else CELLS * np.fft.ifft(folded)
    flat: Array = (np.arange(highest + 1) + sides[:, None] / ratio).ravel()
    strength: Array = (np.abs(lines[:, : highest + 1]) ** 2).ravel()
    positive = flat > 0.5 / ratio
    return flat[positive], strength[positive]


def _median_noise(spectrum: Spectrum, orders: Array) -> Array:
    """Mean square of noise beside each order, by the median of the lines about it: other orders do not raise it."""
    power = np.abs(spectrum.lines) ** 2
    half = max(round(0.25 / spectrum.spacing), 16)
    at = np.rint(orders / spectrum.spacing).astype(np.int64)
    window = np.arange(-half, half + 1)
    index = np.clip(np.abs(at[:, None] + window[None, :]), 1, len(power) - 1)
    median: Array = np.median(power[index], axis=1) / math.log(2.0)
    return median
