"""The orders of a value over the input angle, solved from its sums in cells, with their covariance.

Intervals come from the residual itself: its spectrum beside an order is the noise at that order.
Encoders that count lay their rounding on lines, not evenly, so that a mean over a wide band would
be too large at most orders and too small at a few.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.errors import IdentificationError
from model.identify.angle_regression import CELLS, Basis, Cells
from model.identify.checks import Array
from model.identify.least_squares import CONDITION_LIMIT, student_quantile
from model.kernels import regression as kernels

WHOLE_TURN = 0.98
"""Output revolutions from which output orders and slope can be told apart."""
NEIGHBOURS = 24
"""Lines of the residual's spectrum beside an order that tell its noise."""
LEAST_TURNS = 6
"""Input revolutions below which the residual has no spectrum worth the name."""


@dataclass(frozen=True, kw_only=True)
class AngleFit:
    """The solved regression: which columns were kept, values and covariance over all columns (zero where left out).

    values (p,), covariance (p, p) of the type A part; freedom of its variance; residual_variance of single samples;
    residual (c,) of the cells; noise (orders,): standard uncertainty of a cosine or sine by the residual beside it.
    """

    cells: Cells
    basis: Basis
    used: np.ndarray
    values: Array
    covariance: Array
    freedom: float
    condition: float
    residual_variance: float
    residual: Array
    inverse: Array
    doubt: Array | None = None
    """Change of the values (p,) by one standard uncertainty of what was corrected (type B); None: nothing was."""

    def quantile(self) -> float:
        return student_quantile(self.freedom)

    def complex_amplitude(self, order: float) -> tuple[complex, Array]:
        """a - ib of one order, so that y = Re[(a - ib) e^{i v theta}], and the covariance of (a, b)."""
        at = self.basis.index(order)
        return complex(self.values[at], -self.values[at + 1]), self.covariance[
            at : at + 2, at : at + 2
        ]

    @cached_property
    def row_count(self) -> Array:
        """Samples of each input revolution, (rows,)."""
        return self.cells.row_sums(self.cells.count)

    @cached_property
    def row_residual(self) -> Array:
        """Mean residual of each input revolution, (rows,)."""
        total = self.cells.row_sums(self.cells.count * self.residual)
        return total / np.maximum(self.row_count, 1.0)


def _choose_columns(cells: Cells, basis: Basis) -> tuple[np.ndarray, list[str]]:
    """Leave out what a short stretch cannot separate: output orders and sidebands below one output revolution."""
    orders = np.array(basis.orders)
    used = np.ones(basis.parameters, dtype=bool)
    notes: list[str] = []
    turns = cells.revolutions
    if turns < WHOLE_TURN * basis.ratio:
        n, m = basis.decomposed()
        whole = (n >= 1) & (m == 0)
        used[2:] = np.repeat(whole | (n < 0), 2)
        notes.append(
            f"Only {turns / basis.ratio:.2f} output revolutions: output orders and sidebands cannot be separated "
            "and are left out."
        )
    if turns < 1.0:
        raise IdentificationError(
            "covers less than one input revolution",
            where="angle",
            value=f"{turns:.2f} revolutions",
            limit=">= 1",
        )
    samples = cells.samples / max(turns, 1.0)
    too_high = 2.0 * orders >= samples
    used[2:] &= ~np.repeat(too_high, 2)
    if too_high[(orders >= 0.5)].any() and not used[2::2][orders >= 0.5].any():
        raise IdentificationError(
            "too few samples per input revolution for any order",
            where="samples",
            value=f"{samples:.3g} per revolution",
            limit=f"> {2.0 * orders[orders >= 0.5].min():.3g}",
            remedy="Record slower or sample faster.",
        )
    if too_high.any():
        notes.append(
            f"{samples:.3g} samples per revolution cannot carry orders from {orders[too_high].min():g} on."
        )
    if cells.samples <= used.sum() + 2:
        raise IdentificationError(
            "too few samples for this basis",
            where="samples",
            value=cells.samples,
            limit=f"> {used.sum() + 2}",
        )
    return used, notes


@dataclass(frozen=True)
class Spectrum:
    """Lines of a residual over the input angle: orders k x spacing, complex amplitude 2/n sum w r e^{-i v theta}."""

    spacing: float
    lines: np.ndarray

    @classmethod
    def of(cls, cells: Cells, residual: Array) -> Spectrum:
        """The spectrum over all revolutions of the cells."""
        filled = int(np.flatnonzero(cells.count)[-1]) + 1
        rows = max(round(filled / CELLS), 1)
        weighted = (cells.count * residual)[: rows * CELLS]
        lines = np.fft.rfft(weighted) * (2.0 / max(float(cells.count.sum()), 1.0))
        return cls(1.0 / rows, lines)

    def noise(self, orders: Array, taken: Array) -> tuple[Array, int]:
        """Mean square of the `NEIGHBOURS` nearest lines that none of the `taken` orders of the basis
        has emptied, at each order; and how many these are.
        """
        free = np.ones(len(self.lines), dtype=bool)
        free[0] = False
        at = np.concatenate([taken, [0.0]]) / self.spacing
        for low in (np.floor(at), np.floor(at) + 1.0):
            index = low[np.abs(low - at) < 0.6].astype(np.int64)
            free[index[index < len(free)]] = False
        places = np.flatnonzero(free)
        power = np.concatenate([[0.0], np.cumsum(np.abs(self.lines[places]) ** 2)])
        wanted = min(NEIGHBOURS, len(places))
        middle = np.searchsorted(places, np.asarray(orders) / self.spacing)
        low = np.clip(middle - wanted // 2, 0, len(places) - wanted)
        # Differences of a running sum: rounding may leave them a hair below zero.
        return np.maximum(power[low + wanted] - power[low], 0.0) / max(wanted, 1), wanted


def solve_angle(
    cells: Cells, basis: Basis, *, value: int = 0, columns: np.ndarray | None = None
) -> tuple[AngleFit, list[str]]:
    """Fit one value of the cells in a basis, with its covariance; the list holds what had to be left out."""
    used, notes = _choose_columns(cells, basis)
    if columns is not None:
        used &= columns
    mean = cells.mean[value]
    normal = cells.regressors.normal(basis, used[2::2])
    right = cells.regressors.products(basis, used[2::2], cells.count * mean)
    inverse, condition = _inverse(normal)
    solution = (inverse * right).sum(axis=1)
    p = basis.parameters
    values = np.zeros(p)
    values[used] = solution
    fitted = values[0] + values[1] * cells.trend + cells.series(basis, values)
    residual = np.where(cells.count > 0.0, mean - fitted, 0.0)
    within = max(float(cells.square[value] - (cells.count * mean**2).sum()), 0.0)
    left = float((cells.count * residual**2).sum()) + within
    variance = left / max(cells.samples - len(solution), 1)
    if cells.revolutions >= LEAST_TURNS:
        level, freedom = _noise_level(cells, residual, np.array(basis.orders)[used[2::2]])
        covariance = inverse * np.outer(level, level)
    else:
        covariance, freedom = inverse * variance, float(cells.samples - len(solution))
        notes.append(
            f"Only {cells.revolutions:.3g} input revolutions: the intervals assume white noise."
        )
    part = np.ix_(used, used)
    everything, inverse_all = np.zeros((p, p)), np.zeros((p, p))
    everything[part], inverse_all[part] = covariance, inverse
    values[0] += cells.reference[value]
    fit = AngleFit(
        cells=cells,
        basis=basis,
        used=used,
        values=values,
        covariance=everything,
        freedom=freedom,
        condition=condition,
        residual_variance=variance,
        residual=residual,
        inverse=inverse_all,
    )
    return fit, notes


def _inverse(normal: Array) -> tuple[Array, float]:
    """The inverse of normal equations and the condition number of the regressors scaled to unit length.

    Raises `IdentificationError` where the samples cannot separate the orders.
    """
    scale = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    # Compiled here: a library's threads wait for each other beside other work, at every small matrix.
    root = kernels.square_root(normal / np.outer(scale, scale))
    inverse, condition = np.zeros_like(normal), math.inf
    if np.diag(root).min() > 0.0:
        inverse = kernels.inverse_of(root)
        squared = kernels.largest_eigenvalue(inverse) * kernels.largest_eigenvalue(
            kernels.times_transposed(root, root)
        )
        condition = math.sqrt(squared)
    if condition**2 > CONDITION_LIMIT:
        raise IdentificationError(
            "the samples cannot separate the orders of this basis",
            where="basis",
            value=f"condition number {condition:.3g}",
            limit=f"<= {math.sqrt(CONDITION_LIMIT):g}",
            remedy="Record whole revolutions at a speed that is incommensurate with the "
            "sampling, or ask for fewer orders.",
        )
    return inverse / np.outer(scale, scale), condition


def _noise_level(cells: Cells, residual: Array, orders: Array) -> tuple[Array, float]:
    """The noise of one sample at constant, trend and each order's pair (p,), with its degrees of freedom."""
    at = np.concatenate([[0.0, 0.0], np.repeat(orders, 2)])
    density, lines = Spectrum.of(cells, residual).noise(at, orders)
    # A line of mean square s2 is a cosine and a sine of variance s2/2 each; white noise has s2 = 4 variance/n.
    return np.sqrt(density * float(cells.count.sum()) / 4.0), float(2 * lines)
