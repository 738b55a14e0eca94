"""Streaming least squares of any value over the input angle: trend, input orders, sidebands and output orders.

    y(theta) = a_0 + s theta + sum_v (a_v cos v theta + b_v sin v theta)          (equation 16 with orders v = n + m/N)

Samples that follow each other inside one narrow cell of angle are summed before they enter the
normal equations. The sums of the regressors are exact (power sums about the centre of the cell), so
nothing is biased; only the contrast inside a cell is not used, which costs the highest order 5 % of
its information and order 2 none. Normal equations are kept per block of whole input revolutions;
when the table of blocks is full, neighbours merge, so that a day of data needs the memory of a
minute. The blocks carry the autocorrelation into the intervals (cluster sandwich) and show where a
count slipped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, channels, positive
from model.identify.least_squares import CONDITION_LIMIT, student_quantile
from model.kernels import regression as kernels
from model.kinematic_error import basis_orders

CELLS_PER_PERIOD = 8
"""Cells per period of the highest order."""
MAXIMUM_BLOCKS = 128
"""Blocks kept before neighbours merge."""
LATTICE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Basis:
    """The regressors over the input angle: constant, trend and orders v (cycles per input revolution), ratio N.

    input_order, output_order: v = n + m/N; n = -1 marks an order off that lattice, which is evaluated directly.
    """

    ratio: float
    orders: tuple[float, ...]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        positive("ratio", self.ratio)
        orders = np.array(self.orders, dtype=np.float64)
        if orders.size == 0 or not np.isfinite(orders).all() or orders.min() <= 0.0:
            raise IdentificationError(
                "needs at least one order, all finite and above zero",
                where="orders",
                value=self.orders,
            )
        if orders.size > 1 and np.diff(np.sort(orders)).min() < 1e-9:
            raise IdentificationError("has an order twice", where="orders", value=self.orders)
        if not self.labels:
            object.__setattr__(self, "labels", tuple(f"{order:g}" for order in self.orders))

    def index(self, order: float) -> int:
        """Where the cosine of this order stands among the parameters; raises if the basis lacks it."""
        gaps = np.abs(np.array(self.orders) - order)
        at = int(np.argmin(gaps))
        if gaps[at] > 1e-9:
            raise IdentificationError(
                "is not in the basis of this fit",
                where="order",
                value=order,
                limit=str(self.orders),
            )
        return 2 + 2 * at

    @property
    def parameters(self) -> int:
        return 2 + 2 * len(self.orders)

    def decomposed(self) -> tuple[np.ndarray, np.ndarray]:
        """n and m of v = n + m/N for each order."""
        orders = np.array(self.orders)
        n = np.rint(orders).astype(np.int64)
        m = (orders - n) * self.ratio
        on_lattice = np.abs(m - np.rint(m)) < LATTICE_TOLERANCE
        return np.where(on_lattice, n, -1), np.where(on_lattice, np.rint(m), 0).astype(np.int64)


def standard_basis(ratio: float, highest: int = 12) -> Basis:
    """The basis for a kinematic error: input orders 1..highest, output orders k/N (k = 1..4) and the sidebands."""
    positive("ratio", ratio)
    orders = basis_orders(ratio, range(1, highest + 1))
    return Basis(
        ratio, tuple(order.order for order in orders), tuple(order.label for order in orders)
    )


NEIGHBOURS = 2
"""Blocks to each side whose correlation counts."""


@dataclass(frozen=True, kw_only=True)
class Sums:
    """What a stream of samples leaves behind: normal equations per block, bins over one input revolution, totals.

    normal (b, p, p), right (b, p); bin_basis (cells, p), bin_value (cells,); value sums are about
    `reference`. angle of block k runs from `first_angle + direction k length`; `length` in rad is a
    whole number of input revolutions.
    """

    basis: Basis
    normal: Array
    right: Array
    square: Array
    bin_basis: Array
    bin_value: Array
    count: int
    sum_square: float
    between_square: float
    lowest: float
    highest: float
    reference: float
    first_angle: float
    last_angle: float
    direction: float
    length: float
    trend_scale: float

    @property
    def revolutions(self) -> float:
        """Input revolutions covered."""
        return abs(self.last_angle - self.first_angle) / (2.0 * math.pi)


class AngleRegression:
    """Accumulates (angle, value) blocks of one steady stretch in one direction; `sums()` at any time.

    Constant memory, whatever the length. The way in which the samples are cut into blocks changes nothing.
    """

    def __init__(self, basis: Basis) -> None:
        self.basis = basis
        p = basis.parameters
        orders = np.array(basis.orders)
        self.cells = max(CELLS_PER_PERIOD * math.ceil(float(orders.max())), 96)
        n, m = basis.decomposed()
        self._orders = (n, m, orders, kernels.taylor_table(orders))
        self._scale = 2.0 * math.pi * basis.ratio
        self._normal = np.zeros((MAXIMUM_BLOCKS, p, p))
        self._right = np.zeros((MAXIMUM_BLOCKS, p))
        self._square = np.zeros(MAXIMUM_BLOCKS)
        self._rows = np.zeros((4, p))
        self._group = np.zeros(kernels.GROUP_SIZE)
        self._bin_basis = np.zeros((self.cells, p))
        self._bin_value = np.zeros(self.cells)
        self._totals = np.zeros(8)
        self._block = 0
        self._length = 1
        self._first_cell: float | None = None
        self._first = self._last = 0.0
        self._pending: tuple[list[Array], list[Array]] | None = ([], [])

    def add(self, angle: ArrayLike, value: ArrayLike) -> None:
        """Add samples: angle [rad] and value, shape (n,), in order of time. An empty block is allowed."""
        if np.size(angle) == 0 and np.size(value) == 0:
            return
        x, y = channels(1, angle=angle, value=value)
        if self._first_cell is None:
            x, y = self._begin(x, y)
            if not len(x):
                return
        self._last = float(x[-1])
        self._take(x, y)

    def _begin(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Hold the first samples back until the direction of travel is seen (a tenth of a revolution)."""
        assert self._pending is not None
        self._pending[0].append(x)
        self._pending[1].append(y)
        travel = float(x[-1]) - float(self._pending[0][0][0])
        if abs(travel) < 0.2 * math.pi:
            return x[:0], y[:0]
        x, y = np.concatenate(self._pending[0]), np.concatenate(self._pending[1])
        self._pending = None
        self._first = float(x[0])
        self._totals[3:7] = (math.inf, -math.inf, math.copysign(1.0, travel), float(y[0]))
        self._first_cell = math.floor(self._first * (self.cells / (2.0 * math.pi)))
        return x, y

    def _take(self, x: Array, y: Array) -> None:
        assert self._first_cell is not None
        n, m, orders, taylor = self._orders
        basis = (self._first, self._scale, n, m, orders, taylor, self.basis.ratio)
        direction = self._totals[5]
        at = 0
        while True:
            end = self._first_cell + direction * self.cells * self._length * (self._block + 1)
            before = self._totals[2]
            at = kernels.accumulate(
                x,
                y,
                at,
                self._group,
                self._rows,
                self._normal[self._block],
                self._right[self._block],
                self._bin_basis,
                self._bin_value,
                self._totals,
                self.cells,
                end,
                basis,
            )
            self._square[self._block] += self._totals[2] - before
            if at >= len(x):
                return
            cell = math.floor(
                x[at] * (self.cells / (2.0 * math.pi))
            )  # the kernel's own expression: rounding must agree
            while direction * (cell - end) >= 0.0:
                self._block += 1
                if self._block == MAXIMUM_BLOCKS:
                    self._merge()
                end = self._first_cell + direction * self.cells * self._length * (self._block + 1)

    def _merge(self) -> None:
        half = MAXIMUM_BLOCKS // 2
        for table in (self._normal, self._right, self._square):
            for k in range(half):
                table[k] = table[2 * k] + table[2 * k + 1]
            table[half:] = 0.0
        self._block = half
        self._length *= 2

    def sums(self) -> Sums:
        """The sums so far; the accumulator can go on afterwards. Raises `IdentificationError` for too little data."""
        if self._first_cell is None:
            held = sum(len(part) for part in self._pending[0]) if self._pending else 0
            raise IdentificationError(
                "holds no motion",
                where="angle",
                value=f"{held} samples",
                limit="at least a tenth of an input revolution",
            )
        normal, right, square = (
            self._normal[: self._block + 1].copy(),
            self._right[: self._block + 1].copy(),
            self._square,
        )
        square = square[: self._block + 1].copy()
        bins, values, totals, group = (
            self._bin_basis.copy(),
            self._bin_value.copy(),
            self._totals.copy(),
            self._group.copy(),
        )
        n, m, orders, taylor = self._orders
        basis = (self._first, self._scale, n, m, orders, taylor, self.basis.ratio)
        rows = np.zeros_like(self._rows)
        before = totals[2]
        used = kernels.close_group(
            group, rows, 0, normal[-1], right[-1], bins, values, totals, self.cells, basis
        )
        kernels.rank_update(normal[-1], rows, used)
        square[-1] += totals[2] - before
        for part in normal:  # one by one: a copy of the whole table would double the memory
            part += np.triu(part, 1).T
        return Sums(
            basis=self.basis,
            normal=normal,
            right=right,
            square=square,
            bin_basis=bins,
            bin_value=values,
            count=int(totals[0]),
            sum_square=float(totals[1]),
            between_square=float(totals[2]),
            lowest=float(totals[3]),
            highest=float(totals[4]),
            reference=float(totals[6]),
            first_angle=self._first,
            last_angle=self._last,
            direction=float(totals[5]),
            length=2.0 * math.pi * self._length,
            trend_scale=self._scale,
        )


@dataclass(frozen=True, kw_only=True)
class AngleFit:
    """The solved regression: which columns were kept, values and covariance over all columns (zero where left out).

    values (p,), covariance (p, p) of the type A part; freedom of its variance; residual_variance of single samples;
    block_residual (b,): mean residual of each block; scores (b, p) of the blocks.
    """

    sums: Sums
    used: np.ndarray
    values: Array
    covariance: Array
    freedom: float
    condition: float
    residual_variance: float
    block_count: Array
    block_residual: Array
    scores: Array
    inverse: Array

    def quantile(self) -> float:
        return student_quantile(self.freedom)

    def complex_amplitude(self, order: float) -> tuple[complex, Array]:
        """a - ib of one order, so that y = Re[(a - ib) e^{i v theta}], and the covariance of (a, b)."""
        at = self.sums.basis.index(order)
        return complex(self.values[at], -self.values[at + 1]), self.covariance[
            at : at + 2, at : at + 2
        ]


def _choose_columns(sums: Sums, total: Array) -> tuple[np.ndarray, list[str]]:
    """Leave out what a short stretch cannot separate: output orders and sidebands below one output revolution."""
    basis = sums.basis
    orders = np.array(basis.orders)
    used = np.ones(basis.parameters, dtype=bool)
    notes: list[str] = []
    turns = sums.revolutions
    if turns < 0.98 * basis.ratio:
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
    samples = sums.count / max(turns, 1.0)
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
    if sums.count <= used.sum() + 2:
        raise IdentificationError(
            "too few samples for this basis",
            where="samples",
            value=sums.count,
            limit=f"> {used.sum() + 2}",
        )
    return used, notes


def _block_covariance(
    sums: Sums, scores: Array, inverse: Array, used: np.ndarray
) -> tuple[Array, float]:
    """Cluster sandwich with Bartlett weights for neighbouring blocks (Newey and West 1987).

    The rounding of two counters that turn together is anticorrelated from revolution to revolution:
    blocks taken as independent give intervals a third too wide. Each order is corrected for how
    many orders share its neighbourhood with it.
    """
    blocks = len(scores)
    meat = scores.T @ scores
    for lag in range(1, min(NEIGHBOURS, blocks // 8) + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        meat += (1.0 - lag / (NEIGHBOURS + 1.0)) * (shifted + shifted.T)
    raw = inverse @ meat @ inverse
    centres = np.concatenate([[0.0, 0.0], np.repeat(sums.basis.orders, 2)])[used]
    near = np.array([np.sum(np.abs(centres - c) <= 0.5) for c in centres], dtype=np.float64)
    share = np.where(centres < 0.5, near, 0.5 * near)
    factor = np.sqrt(blocks / np.maximum(blocks - np.minimum(share, 0.7 * blocks), 1.0))
    freedom = max(float(blocks - np.median(share)), 1.0)
    return raw * np.outer(factor, factor), freedom


def solve_angle(sums: Sums, *, columns: np.ndarray | None = None) -> tuple[AngleFit, list[str]]:
    """Solve the accumulated regression and give its covariance by blocks; the list holds what had to be left out."""
    total = sums.normal.sum(axis=0)
    right = sums.right.sum(axis=0)
    used, notes = _choose_columns(sums, total)
    if columns is not None:
        used &= columns
    part = np.ix_(used, used)
    scale = np.sqrt(np.maximum(np.diag(total)[used], np.finfo(float).tiny))
    eigen, vectors = np.linalg.eigh(total[part] / np.outer(scale, scale))
    condition = math.sqrt(float(eigen[-1] / max(eigen[0], np.finfo(float).tiny)))
    if eigen[0] <= 0.0 or condition**2 > CONDITION_LIMIT:
        raise IdentificationError(
            "the samples cannot separate the orders of this basis",
            where="basis",
            value=f"condition number {condition:.3g}",
            limit=f"<= {math.sqrt(CONDITION_LIMIT):g}",
            remedy="Record whole revolutions at a speed that is incommensurate with the "
            "sampling, or ask for fewer orders.",
        )
    inverse = (vectors / eigen) @ vectors.T / np.outer(scale, scale)
    solution = inverse @ right[used]
    squares = max(sums.sum_square - float(solution @ right[used]), 0.0)
    variance = squares / max(sums.count - int(used.sum()), 1)
    scores = np.array(
        [
            right_b[used] - normal_b[part] @ solution
            for right_b, normal_b in zip(sums.right, sums.normal, strict=True)
        ]
    )
    counts = sums.normal[:, 0, 0]
    full = counts > 0.5 * np.median(counts)
    if full.sum() >= 6:
        covariance, freedom = _block_covariance(sums, scores, inverse, used)
    else:
        covariance, freedom = inverse * variance, float(sums.count - used.sum())
        notes.append(
            f"Only {int(full.sum())} blocks of whole revolutions: the intervals assume white noise."
        )
    p = sums.basis.parameters
    values, everything = np.zeros(p), np.zeros((p, p))
    values[used] = solution
    everything[part] = covariance
    inverse_all, scores_all = np.zeros((p, p)), np.zeros((len(scores), p))
    inverse_all[part] = inverse
    scores_all[:, used] = scores
    values[0] += sums.reference
    fit = AngleFit(
        sums=sums,
        used=used,
        values=values,
        covariance=everything,
        freedom=freedom,
        condition=condition,
        residual_variance=variance,
        block_count=counts,
        block_residual=np.where(counts > 0, scores[:, 0] / np.maximum(counts, 1.0), 0.0),
        scores=scores_all,
        inverse=inverse_all,
    )
    return fit, notes
