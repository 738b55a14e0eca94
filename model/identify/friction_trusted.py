"""Which points of a friction table lie on one curve together: least trimmed squares (Rousseeuw 1984).

The fit starts from the curve that seven tenths of the points agree on. A point further from it than
3.5 times the scatter of the others is left out; where three quarters of the slowest points would be
(presliding), all of them are.
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import BoolArray
from model.identify.checks import Array
from model.identify.friction_points import PARAMETERS, CurvePoints, carries, law_design
from model.identify.least_squares import closest
from model.identify.stribeck import StribeckBounds

_TRUSTED = (0.7, 0.85)
"""Shares of the points that a start agrees with."""
GRID, SHAPES, STARTS = 12, (0.5, 1.0, 2.0), 6
"""Of the search for a start: v_s over its bounds, sigma, and how many starts are followed."""
_OUTLYING = 3.5
"""Scatters from the curve beyond which a point is left out: one in two thousand honest ones."""
_LEAST_SCATTER = 5e-3
"""Of the median friction: no table is so good that less could be called a wrong point."""
_OUTLIER_FREEDOM = 8
"""Points beyond the parameters from which on wrong ones can be told at all."""
ROUNDS = 12


def trusted_points(points: CurvePoints, law: str) -> tuple[BoolArray, float]:
    """Which points (n,) lie on a curve of this law together, and the speed below which none is taken.

    Of several starts the one is followed to which the points are likeliest, each either scattered
    about the curve or wrong and then anywhere.
    """
    everything = np.ones(len(points), dtype=bool)
    if len(points) - len(PARAMETERS[law]) - points.both_ways < _OUTLIER_FREEDOM:
        return everything, 0.0
    spread = float(np.ptp(points.friction * points.way) / np.median(points.error))
    best, used = math.inf, everything
    for start in _starts(points, law):
        agreeing, scatter = _agreeing(points, law, start)
        wrong = len(points) - int(agreeing.sum())
        cost = agreeing.sum() * math.log(scatter) + wrong * math.log(max(spread, scatter))
        if cost < best:
            best, used = cost, agreeing
    below = _presliding(points.speed, ~used)
    return used & (points.speed >= below), below


def _starts(points: CurvePoints, law: str) -> list[tuple[float, float]]:
    """Pairs of v_s and sigma that most points agree with, those of other v_s than the best among them."""
    if law != "stribeck":
        return [(1.0, 1.0)]
    velocities = np.geomspace(*StribeckBounds.of(points.speed).stribeck_velocity, GRID)
    found: list[tuple[float, float, float]] = []
    for share in _TRUSTED:
        count = math.ceil(share * len(points))
        for velocity in velocities.tolist():
            sizes: list[tuple[float, float, float]] = []
            for shape in SHAPES:
                left = _trimmed_residual(points, law, velocity, shape, count)
                sizes.append((float(np.sort(left**2)[:count].sum()) / share, velocity, shape))
            found.append(min(sizes))
    return [(velocity, shape) for _, velocity, shape in sorted(found)[:STARTS]]


def _agreeing(points: CurvePoints, law: str, start: tuple[float, float]) -> tuple[BoolArray, float]:
    """The points (n,) about the curve that follows from a start, and their scatter in errors."""
    count = math.ceil(min(_TRUSTED) * len(points))
    left = _trimmed_residual(points, law, *start, count)
    floor = _LEAST_SCATTER * float(np.median(np.abs(points.friction) / points.error))
    width = len(PARAMETERS[law]) + points.both_ways
    near = np.argsort(np.abs(left))[:count]
    used = np.zeros(len(points), dtype=bool)
    used[near] = True
    scatter = floor
    for _ in range(ROUNDS):
        before = used
        small = 1.0 + 5.0 / (len(points) - width)
        scatter = max(1.4826 * small * float(np.median(np.abs(left[used]))), floor)
        used = np.abs(left) <= _OUTLYING * scatter
        if np.array_equal(used, before) or not carries(points[used], law):
            break
        start = searched(points[used], law, start)
        left = _residual(points, used, law, *start)
    return used, scatter


def _presliding(speed: Array, wrong: BoolArray) -> float:
    """The speed up to which three quarters of the points are wrong, at least three of them; 0 for none."""
    order = np.argsort(speed)
    count = np.cumsum(wrong[order])
    most = np.flatnonzero((count >= 3) & (4 * count >= 3 + 3 * np.arange(len(order))))
    if not len(most):
        return 0.0
    last = int(most[-1])
    sorted_speed = speed[order]
    return float(sorted_speed[last + 1]) if last + 1 < len(order) else math.inf


def _trimmed_residual(
    points: CurvePoints, law: str, velocity: float, shape: float, count: int
) -> Array:
    """Residuals (n,) in errors about the curve that `count` of the points agree on, for given v_s and sigma.

    From a fit of least magnitudes, steps that each fit the points nearest to the last fit (least trimmed squares).
    """
    design = law_design(points, law, velocity, shape) / points.error[:, None]
    y = points.friction / points.error
    left = y - design @ closest(design, y)
    for _ in range(ROUNDS):
        least = 1e-3 * float(np.abs(left).max()) + 1e-300
        root = 1.0 / np.sqrt(np.maximum(np.abs(left), least))
        left = y - design @ closest(design * root[:, None], y * root)
    for _ in range(ROUNDS):
        near = np.argsort(np.abs(left))[:count]
        left = y - design @ closest(design[near], y[near])
    return left


def _residual(
    points: CurvePoints, used: BoolArray, law: str, velocity: float, shape: float
) -> Array:
    """Residuals (n,) in errors of all points about the least-squares curve of those used."""
    design = law_design(points, law, velocity, shape) / points.error[:, None]
    y = points.friction / points.error
    return y - design @ closest(design[used], y[used])


def searched(points: CurvePoints, law: str, start: tuple[float, float]) -> tuple[float, float]:
    """v_s and sigma of least squares, from a start."""
    if law != "stribeck":
        return start
    limits = StribeckBounds.of(points.speed).logarithms()
    everything = np.ones(len(points), dtype=bool)

    def cost(place: Array) -> Array:
        return _residual(points, everything, law, math.exp(place[0]), math.exp(place[1]))

    inner = np.stack([limits[:, 0] + 1e-9, limits[:, 1] - 1e-9])
    at = np.clip(np.log(start), *inner)
    found = scipy.optimize.least_squares(cost, at, bounds=limits.T, x_scale=1.0, max_nfev=40)
    return math.exp(found.x[0]), math.exp(found.x[1])
