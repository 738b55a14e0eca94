"""Least squares of any value over the input angle: trend, input orders, sidebands and output orders.

    y(theta) = a_0 + s theta + sum_v (a_v cos v theta + b_v sin v theta)          (equation 16 with orders v = n + m/N)

A stream of samples is summed into narrow cells of angle (`AngleRegression`, one pass, constant
memory); which orders are fitted is decided afterwards (`model.identify.angle_fit.solve_angle` on the
`Cells`), so that the basis can follow the data. The mean of a regressor over the samples of a cell
is taken about their centroid to fourth order: exact to 1e-6 of an amplitude at order 12, to 1e-9 at
order 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, channels, positive
from model.kernels import regression as kernels
from model.kinematic_error import basis_orders
from model.units import REVOLUTION

CELLS = 128
"""Cells of one input revolution."""
_MAXIMUM_TURNS = 1024
"""Input revolutions that are kept apart; beyond, whole output revolutions are laid on each other."""
PIECE = 256 * CELLS
"""Cells whose regressors are held in memory at a time."""
ROOM = 256
"""Regressors for which there is room at first."""
LATTICE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Basis:
    """The regressors over the input angle: constant, trend and orders v (cycles per input revolution), ratio N.

    `decomposed` gives v = n + m/N; n = -1 marks an order off that lattice, which is evaluated directly.
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

    def united(self, other: Basis) -> Basis:
        """The orders of both, each once, ascending."""
        pairs = dict(zip(other.orders, other.labels, strict=True))
        pairs |= dict(zip(self.orders, self.labels, strict=True))
        unique = {round(order * 1e9): (order, label) for order, label in pairs.items()}
        orders, labels = zip(*sorted(unique.values()), strict=True)
        return Basis(self.ratio, orders, labels)


def standard_basis(ratio: float, highest: int = 12) -> Basis:
    """What every kinematic error is fitted with: input orders 1..highest, output orders 1..8 and
    the sidebands of the wave.
    """
    positive("ratio", ratio)
    orders = basis_orders(ratio, range(1, highest + 1), output_orders=range(1, 9))
    return Basis(
        ratio, tuple(order.order for order in orders), tuple(order.label for order in orders)
    )


@dataclass(frozen=True, kw_only=True)
class Cells:
    """What a stream of samples leaves behind: sums over cells of angle along the way, and totals.

    count (c,) samples of each cell; offset (c,): mean offset from the cell's centre [rad]; moments
    (3, c): second to fourth central moment [rad2, rad3, rad4]; mean (m, c) of the values. Cell k is
    the k-th along the way, `CELLS` to an input revolution. reference, square, lowest, highest (m,):
    of the values.
    """

    ratio: float
    count: Array
    offset: Array
    moments: Array
    mean: Array
    reference: Array
    square: Array
    lowest: Array
    highest: Array
    samples: int
    first_cell: int
    first_angle: float
    last_angle: float
    direction: float
    layers: int

    @property
    def revolutions(self) -> float:
        """Input revolutions covered."""
        return abs(self.last_angle - self.first_angle) / REVOLUTION

    @property
    def trend_scale(self) -> float:
        """The angle over which the trend is stated: one output revolution [rad of the input]."""
        return REVOLUTION * self.ratio

    @property
    def rows(self) -> int:
        """Input revolutions that are kept apart, the last of them perhaps not whole."""
        return len(self.count) // CELLS

    @cached_property
    def angle(self) -> Array:
        """Mean input angle of each cell's samples [rad], (c,)."""
        cell = self.first_cell + self.direction * np.arange(len(self.count), dtype=np.float64)
        angle: Array = (cell + 0.5) * (REVOLUTION / CELLS) + self.offset
        return angle

    @cached_property
    def trend(self) -> Array:
        """The regressor of the trend, (c,); where output revolutions lie on each other it is their mean."""
        way = self.angle - self.first_angle
        if self.layers > 1:
            layer = np.arange(len(self.count)) // (CELLS * round(self.ratio))
            way = way + self.direction * self.trend_scale * (
                layer * (self.layers - 1) + 0.5 * (self.layers - 1)
            )
        return way / self.trend_scale

    @cached_property
    def place(self) -> np.ndarray:
        """Which cell of the input revolution each one is, 0..CELLS - 1."""
        steps = np.arange(len(self.count)) * int(self.direction)
        place: np.ndarray = (self.first_cell + steps) % CELLS
        return place

    def row_sums(self, values: Array) -> Array:
        """Sums over the cells of each row, (rows,)."""
        return values.reshape(self.rows, CELLS).sum(axis=1)

    def without_rows(self, rows: list[int]) -> Cells:
        """These revolutions left out."""
        count = self.count.copy().reshape(self.rows, CELLS)
        count[rows] = 0.0
        return replace(self, count=count.ravel())

    def shifted(self, row: int, size: float) -> Cells:
        """`size` taken off the first value from the start of a row on."""
        mean = self.mean.copy()
        mean[0, row * CELLS :] -= size
        return replace(self, mean=mean)

    @property
    def pieces(self) -> list[slice]:
        """The cells in pieces of whole revolutions whose regressors fit into memory."""
        return [slice(k, min(k + PIECE, len(self.count))) for k in range(0, len(self.count), PIECE)]

    @cached_property
    def regressors(self) -> Regressors:
        """The regressors that were asked for so far, and their products."""
        return Regressors(self)

    def series(self, basis: Basis, values: Array) -> Array:
        """The orders of `values` (p,) over the cells without constant and trend, (c,)."""
        chosen = np.any(values[2:].reshape(-1, 2) != 0.0, axis=1)
        some = np.concatenate([[0.0, 0.0], values[2:][np.repeat(chosen, 2)]])
        return self.regressors.combination(basis, chosen, some)

    def per_place(self, *curves: Array, weight: Array | None = None) -> tuple[np.ndarray, Array]:
        """Which cells of the input revolution hold samples, (CELLS,) mask, and the curves' means there."""
        counts = self.count if weight is None else weight
        total = np.bincount(self.place, counts, CELLS)
        filled = total > 0.0
        means = [np.bincount(self.place, counts * c, CELLS)[filled] / total[filled] for c in curves]
        return filled, np.array(means)


class Regressors:
    """The means of regressors over the samples of each cell, by order, and their products.

    Both grow with the orders that are asked for: a basis that follows the data pays only for what is
    new. The regressors stay in memory where they fit (`PIECE`); else they are made anew for each piece.
    """

    def __init__(self, cells: Cells) -> None:
        # The cells hold these: a reference back would keep both until the collector comes.
        self._ratio, self._pieces = cells.ratio, cells.pieces
        self._angle, self._trend, self._moments = cells.angle, cells.trend, cells.moments
        self._count = cells.count
        self._orders: list[float] = []
        self._lattice = np.empty((2, 0), dtype=np.int64)
        self._table = np.empty((ROOM if len(self._pieces) == 1 else 0, len(self._count)))
        self._filled = 0
        self._normal = np.empty((0, 0))

    def normal(self, basis: Basis, chosen: np.ndarray, weight: Array | None = None) -> Array:
        """X' W X of the chosen orders with constant and trend; the weight is the cells' count unless given."""
        places = self._places(basis, chosen)
        if weight is not None:
            normal = self._products(0, weight)
            return normal[np.ix_(places, places)]
        first = len(self._normal)
        if len(places) and first < self._parameters:
            normal = self._products(first, self._count)
            normal[:first, :first] = self._normal
            self._normal = normal
        return self._normal[np.ix_(places, places)]

    def products(self, basis: Basis, chosen: np.ndarray, weighted: Array) -> Array:
        """X' y of the chosen orders, (p,)."""
        places = self._places(basis, chosen)
        out = np.zeros(self._parameters)
        for piece in self._pieces:
            kernels.row_products(self._design(piece), weighted[piece], out)
        return out[places]

    def combination(self, basis: Basis, chosen: np.ndarray, values: Array) -> Array:
        """X a of the chosen orders, over the cells (c,)."""
        places = self._places(basis, chosen)
        factor, out = np.zeros(self._parameters), np.zeros(len(self._count))
        factor[places] = values
        for piece in self._pieces:
            kernels.row_combination(self._design(piece), factor, out[piece])
        return out

    def row_sums(self, basis: Basis, chosen: np.ndarray) -> Array:
        """Sums of count times regressor over each input revolution, (p, rows)."""
        places = self._places(basis, chosen)
        rows: list[Array] = []
        for piece in self._pieces:
            design = self._design(piece)
            sums = np.empty((len(design), design.shape[1] // CELLS))
            kernels.stretch_products(design, self._count[piece], sums)
            rows.append(sums[places])
        return np.hstack(rows)

    @property
    def _parameters(self) -> int:
        return 2 + 2 * len(self._orders)

    def _places(self, basis: Basis, chosen: np.ndarray) -> np.ndarray:
        """Where constant, trend and the chosen orders stand; orders that are new are added."""
        wanted = np.flatnonzero(chosen)
        place = {order: k for k, order in enumerate(self._orders)}
        new = [int(k) for k in wanted if basis.orders[k] not in place]
        if new:
            lattice = np.array(basis.decomposed())[:, new]
            self._lattice = np.concatenate([self._lattice, lattice], axis=1)
            place |= {basis.orders[k]: len(place) + j for j, k in enumerate(new)}
            self._orders = list(place)
        at = 2 + 2 * np.array([place[basis.orders[k]] for k in wanted], dtype=np.int64)
        return np.concatenate([[0, 1], np.stack([at, at + 1], axis=1).ravel()])

    def _products(self, first: int, weight: Array) -> Array:
        """X' W X of all that is held, zero where both are below `first`."""
        normal = np.zeros((self._parameters, self._parameters))
        for piece in self._pieces:
            kernels.weighted_products(self._design(piece), weight[piece], first, normal)
        return np.triu(normal) + np.triu(normal, 1).T

    def _design(self, piece: slice) -> Array:
        """The regressors over the cells of a piece, (parameters, cells)."""
        size = self._parameters
        if len(self._pieces) > 1:
            design = np.empty((size, piece.stop - piece.start))
            self._fill(design, 0, piece)
            return design
        if size > len(self._table):
            grown = np.empty((2 * size, len(self._count)))
            grown[: self._filled] = self._table[: self._filled]
            self._table = grown
        if size > self._filled:
            self._fill(self._table[:size], self._filled, piece)
            self._filled = size
        return self._table[:size]

    def _fill(self, design: Array, first: int, piece: slice) -> None:
        """Rows from `first` on."""
        if first == 0:
            design[0], design[1] = 1.0, self._trend[piece]
            first = 2
        new = slice((first - 2) // 2, None)
        kernels.wave_means(
            self._angle[piece],
            np.ascontiguousarray(self._moments[:, piece]),
            self._ratio,
            np.ascontiguousarray(self._lattice[:, new]),
            np.array(self._orders[new], dtype=np.float64),
            design[first:],
        )


class AngleRegression:
    """Accumulates (angle, values) blocks of one steady stretch in one direction; `cells()` at any time.

    `values` is how many values there are to an angle. Constant memory, whatever the length. The way
    in which the samples are cut into blocks changes nothing.
    """

    def __init__(self, ratio: float, values: int = 1) -> None:
        self.ratio = positive("ratio", ratio)
        self._turn = max(round(ratio), 1)
        self._turns = max(_MAXIMUM_TURNS // self._turn // 2 * 2, 2) * self._turn
        self._grid = np.zeros((self._turns * CELLS, kernels.LANES + values))
        self._totals = np.zeros((values, 4))
        self._totals[:, 2:] = (math.inf, -math.inf)
        self._halvings = 0
        self._samples = 0
        self._direction = 0.0
        self._first = self._last = 0.0
        self._first_cell = 0
        self._pending: list[tuple[Array, Array]] = []

    def add(self, angle: ArrayLike, *values: ArrayLike) -> None:
        """Add samples: angle [rad] and its values, shape (n,), in order of time. An empty block is allowed."""
        if np.size(angle) == 0 and all(np.size(value) == 0 for value in values):
            return
        named = {"angle": angle} | {f"value {k}": value for k, value in enumerate(values)}
        theta, *rows = channels(1, **named)
        self.take(theta, np.array(rows))

    def take(self, angle: Array, values: Array) -> None:
        """Add samples that are known to be sound: angle (n,), values (m, n)."""
        if self._direction == 0.0:
            angle, values = self._begin(angle, values)
            if not len(angle):
                return
        self._last = float(angle[-1])
        self._samples += len(angle)
        at = 0
        while at < len(angle):
            layout = (
                CELLS / REVOLUTION,
                self._first_cell,
                self._direction,
                self._turn * CELLS,
                self._halvings,
            )
            at = kernels.bin_samples(angle, values, at, self._grid, self._totals, layout)
            if at < len(angle):
                self._make_room()

    def _begin(self, angle: Array, values: Array) -> tuple[Array, Array]:
        """Hold the first samples back until the direction of travel is seen (a tenth of a revolution)."""
        self._pending.append((angle, values))
        travel = float(angle[-1]) - float(self._pending[0][0][0])
        if abs(travel) < 0.2 * math.pi:
            return angle[:0], values[:, :0]
        if len(self._pending) > 1:
            angle = np.concatenate([part[0] for part in self._pending])
            values = np.concatenate([part[1] for part in self._pending], axis=1)
        self._pending = []
        self._first, self._direction = float(angle[0]), math.copysign(1.0, travel)
        self._totals[:, 0] = values[:, 0]
        self._first_cell = math.floor(self._first * (CELLS / REVOLUTION))
        return angle, values

    def _make_room(self) -> None:
        """The table is full: output revolutions are laid on each other in pairs."""
        if abs(self.ratio - self._turn) > LATTICE_TOLERANCE:
            raise IdentificationError(
                "is too long for a ratio that is not whole: its output revolutions cannot be laid on each other",
                where="angle",
                value=f"more than {self._turns} input revolutions",
                limit=f"<= {self._turns}",
                remedy="Fit it in pieces.",
            )
        turns = self._grid.reshape(-1, self._turn * CELLS, self._grid.shape[1])
        half = len(turns) // 2
        for k in range(half):
            np.add(turns[2 * k], turns[2 * k + 1], out=turns[k])
        turns[half:] = 0.0
        self._halvings += 1

    def cells(self) -> Cells:
        """The sums so far; the accumulator can go on afterwards. Raises `IdentificationError` for too little data."""
        if self._direction == 0.0:
            held = sum(len(part[0]) for part in self._pending)
            raise IdentificationError(
                "holds no motion",
                where="angle",
                value=f"{held} samples",
                limit="at least a tenth of an input revolution",
            )
        used = -(-(int(np.flatnonzero(self._grid[:, 0])[-1]) + 1) // CELLS) * CELLS
        table = np.ascontiguousarray(self._grid[:used].T)
        count = table[0]
        share = 1.0 / np.maximum(count, 1.0)
        offset = table[1] * share
        second, third, fourth = table[2:5] * share
        return Cells(
            ratio=self.ratio,
            count=count,
            offset=offset,
            moments=np.array(
                [
                    np.maximum(second - offset**2, 0.0),
                    third - 3.0 * offset * second + 2.0 * offset**3,
                    fourth - 4.0 * offset * third + 6.0 * offset**2 * second - 3.0 * offset**4,
                ]
            ),
            mean=table[kernels.LANES :] * share,
            reference=self._totals[:, 0].copy(),
            square=self._totals[:, 1].copy(),
            lowest=self._totals[:, 2].copy(),
            highest=self._totals[:, 3].copy(),
            samples=self._samples,
            first_cell=self._first_cell,
            first_angle=self._first,
            last_angle=self._last,
            direction=self._direction,
            layers=2**self._halvings,
        )
