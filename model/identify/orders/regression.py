"""Least squares of trend and orders together, streamed: one direction's orders, the trend of each stretch its own.

    minimise  sum_i n_i (y_i - z_s(theta_i) - sum_v (a_v cos v theta_i + b_v sin v theta_i))^2

z_s is a polynomial over the angle of stretch s. Its columns are taken out of the normal equations
stretch by stretch (Frisch and Waugh 1933), which gives the same numbers as one system with all of
them: thousands of stretches cost no more than one. Where orders are to be refined, each has a third
column, the change of its wave with its order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np

from model.arrays import ComplexArray, IntArray
from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.least_squares import CONDITION_LIMIT
from model.identify.orders.comb import Weighted
from model.identify.orders.samples import OrderSamples, Piece
from model.units import REVOLUTION

ROWS = 8192
"""Samples whose waves are held in memory at a time."""
_SINGLE = 100_000
"""Samples from which on the waves are single precision: 1e-7 of an amplitude, at a fifth of the time."""


@dataclass(frozen=True)
class Moving:
    """Which orders are refined: places (m,) among the orders, amplitudes (m,), and about which angle [rad].

    held (m,): information that each has before, for a noise of one; it keeps those in place that the data leave open.
    """

    places: IntArray
    amplitudes: ComplexArray
    middle: float
    held: Array


@dataclass(frozen=True, kw_only=True)
class Solved:
    """The orders of one direction: amplitudes a - ib (k,), (X'X)^-1 (2k, 2k), trend of each stretch, and turns.

    trends: by stretch, coefficients over the stretch's angle from -1 to 1. shift (m,),
    shift_variance (m,): change of each moving order that the data ask for, and its variance per unit of noise.
    """

    orders: Array
    amplitudes: ComplexArray
    inverse: Array
    trends: dict[int, Array]
    shift: Array
    shift_variance: Array

    @property
    def vector(self) -> Array:
        """a, b of each order (2k,)."""
        return np.stack([self.amplitudes.real, -self.amplitudes.imag], axis=1).ravel()


def solve(
    samples: OrderSamples,
    pieces: Iterable[Piece],
    direction: int,
    orders: Array,
    moving: Moving | None = None,
) -> Solved:
    """Trend and orders of one direction; those that are `moving` are refined too."""
    ways = (piece for piece in pieces if piece.direction == direction)
    normal, right, tables = _summed(samples, ways, orders, moving)
    gains: dict[int, tuple[Array, Array]] = {}
    for number, (own, cross, slow) in tables.items():
        inverse = np.linalg.pinv(own, rcond=1e-12, hermitian=True)
        gains[number] = inverse @ cross, inverse @ slow
        normal -= cross.T @ gains[number][0]
        right -= cross.T @ gains[number][1]
    if moving is not None:
        places = 2 * len(orders) + np.arange(len(moving.places))
        normal[places, places] += moving.held
    inverse = _inverse(normal)
    solution = inverse @ right
    trends = {
        number: slow - cross @ solution + samples.mean * np.eye(1, len(slow))[0]
        for number, (cross, slow) in gains.items()
    }
    k = 2 * len(orders)
    return Solved(
        orders=orders,
        amplitudes=solution[:k:2] - 1j * solution[1:k:2],
        inverse=inverse[:k, :k],
        trends=trends,
        shift=solution[k:],
        shift_variance=np.diag(inverse)[k:].copy(),
    )


def _moving_orders(moving: Moving | None) -> int:
    return 0 if moving is None else len(moving.places)


def _summed(
    samples: OrderSamples, pieces: Iterable[Piece], orders: Array, moving: Moving | None
) -> tuple[Array, Array, dict[int, tuple[Array, Array, Array]]]:
    """X'X and X'y of the waves; and of each stretch the trend's own products, those with the waves and with y."""
    single = samples.samples > _SINGLE
    columns = 2 * len(orders) + _moving_orders(moving)
    normal, right = np.zeros((columns, columns)), np.zeros(columns)
    tables: dict[int, tuple[Array, Array, Array]] = {}
    for piece in pieces:
        degree = samples.stretches[piece.stretch].degree + 1
        if piece.stretch not in tables:
            tables[piece.stretch] = (
                np.zeros((degree, degree)),
                np.zeros((degree, columns)),
                np.zeros(degree),
            )
        own, cross, slow = tables[piece.stretch]
        for rows in _chunks(piece):
            waves = _waves(piece, rows, orders, moving, single=single)
            trend = _trend(samples, piece, rows)
            count = piece.count[rows]
            value = count * (piece.value[rows] - samples.mean)
            weighted = waves * count.astype(waves.dtype)
            normal += weighted @ waves.T
            right += waves @ value.astype(waves.dtype)
            own += (trend * count) @ trend.T
            cross += (trend @ weighted.T).astype(np.float64)
            slow += trend @ value
    return normal, right, tables


def residuals(
    samples: OrderSamples, pieces: Iterable[Piece], solved: Solved, direction: int
) -> Iterator[Weighted]:
    """Angle, residual and count of one direction, piece by piece."""
    single = samples.samples > _SINGLE
    for piece in pieces:
        if piece.direction != direction:
            continue
        left = np.empty(len(piece.angle))
        for rows in _chunks(piece):
            waves = _waves(piece, rows, solved.orders, None, single=single)
            trend = _trend(samples, piece, rows)
            fitted = solved.trends[piece.stretch] @ trend + solved.vector @ waves
            left[rows] = piece.value[rows] - fitted
        yield piece.angle, left, piece.count


def between_stretches(
    samples: OrderSamples, solved: Solved, direction: int
) -> tuple[Array | None, int]:
    """Covariance (2k, 2k) of the orders from the scatter of the stretches, and how many are held."""
    scores: dict[int, Array] = {}
    kept = [piece for piece in samples.held if piece.direction == direction]
    for piece, (_, left, count) in zip(
        kept, residuals(samples, kept, solved, direction), strict=True
    ):
        score = scores.setdefault(piece.stretch, np.zeros(2 * len(solved.orders)))
        for rows in _chunks(piece):
            waves = _waves(piece, rows, solved.orders, None, single=False)
            score += waves @ (count[rows] * left[rows])
    number = len(scores)
    if number < 2 or not samples.is_whole:
        return None, number
    every = np.array(list(scores.values()))
    middle = every.T @ every * (number / (number - 1.0))
    return solved.inverse @ middle @ solved.inverse, number


def _chunks(piece: Piece) -> Iterator[slice]:
    for at in range(0, len(piece.angle), ROWS):
        yield slice(at, at + ROWS)


def _waves(
    piece: Piece, rows: slice, orders: Array, moving: Moving | None, *, single: bool
) -> Array:
    """Means of cos and sin of each order over the samples of each group, (2k, n); one more of each that moves."""
    turns = np.outer(orders, piece.angle[rows] / REVOLUTION)
    phase: Array = (turns - np.rint(turns)) * REVOLUTION
    if single:
        phase = cast("Array", phase.astype(np.float32))
    spread = piece.spread[rows]
    k = len(orders)
    more = _moving_orders(moving)
    out: Array = np.empty((2 * k + more, phase.shape[1]), dtype=phase.dtype)
    np.cos(phase, out=out[: 2 * k : 2])
    np.sin(phase, out=out[1 : 2 * k : 2])
    if spread.any():
        # Single samples of an angle that counts have one spread: a number per order does.
        widths = spread if spread.min() < spread.max() else spread[:1]
        kept = np.exp(-0.5 * np.outer(orders**2, widths)).astype(out.dtype)
        out[: 2 * k : 2] *= kept
        out[1 : 2 * k : 2] *= kept
    if moving is not None:
        a = moving.amplitudes.real[:, None].astype(out.dtype)
        b = -moving.amplitudes.imag[:, None].astype(out.dtype)
        swing = b * out[2 * moving.places] - a * out[2 * moving.places + 1]
        # About the middle of the way, where amplitude and order do not depend on each other.
        out[2 * k :] = swing * (piece.angle[rows] - moving.middle).astype(out.dtype)
    return out


def _trend(samples: OrderSamples, piece: Piece, rows: slice) -> Array:
    """Legendre polynomials over the angle of the piece's stretch from -1 to 1, (degree + 1, n)."""
    stretch = samples.stretches[piece.stretch]
    half = max(0.5 * (stretch.high - stretch.low), 1e-12)
    place = (piece.angle[rows] - 0.5 * (stretch.high + stretch.low)) / half
    columns: Array = np.asarray(np.polynomial.legendre.legvander(place, stretch.degree), np.float64)
    return columns.T


def _inverse(normal: Array) -> Array:
    """(X'X)^-1 by its eigenvalues, columns scaled to one; refused where the samples cannot separate the orders."""
    if not len(normal):
        return normal
    scale = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    if values[0] * CONDITION_LIMIT <= values[-1]:
        raise IdentificationError(
            "the samples cannot separate the orders",
            where="angle",
            value=f"condition number {np.sqrt(values[-1] / max(values[0], 1e-300)):.3g}",
            limit=f"<= {np.sqrt(CONDITION_LIMIT):g}",
            remedy="Cover more of the revolution, or ask for fewer orders.",
        )
    return (vectors / values) @ vectors.T / np.outer(scale, scale)
