"""A table of friction over speed: Coulomb, Coulomb and viscous, or Stribeck, chosen by the points.

    coulomb            F = F_c sgn v + F_0
    coulomb-viscous    F = (F_c + c_v |v|) sgn v + F_0
    stribeck           F = {F_c + (F_s - F_c) exp[-(|v|/v_s)^sigma] + c_v |v|} sgn v + F_0

F_0 belongs to tables with both directions only. All bounds are those of the table's own speeds
(`model.identify.stribeck`), so that rad/s at a motor, mm/s at a slider and any unit of force are alike.

Tables have wrong points, and points that are no friction over speed at all: at rest, and while the
force still builds up after a reversal (presliding). The fit starts from the curve that seven
tenths of the points agree on (least trimmed squares; Rousseeuw 1984). A point further from it than
3.5 times the scatter of the others is left out; where three quarters of the slowest points would be, all of
them are.

A richer law is taken where Bayes' information criterion asks for it and the points that it has not
seen are predicted no worse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from model.arrays import BoolArray
from model.errors import IdentificationError
from model.identify.checks import Array, channels
from model.identify.least_squares import student_quantile
from model.identify.stribeck import (
    StribeckBounds,
    StribeckFit,
    fit_stribeck,
    profile_intervals,
    stribeck_curve,
)

Law = Literal["auto", "coulomb", "coulomb-viscous", "stribeck"]
LAWS: tuple[Law, ...] = ("auto", "coulomb", "coulomb-viscous", "stribeck")
PARAMETERS = {
    "coulomb": ("coulomb",),
    "coulomb-viscous": ("coulomb", "viscous"),
    "stribeck": ("coulomb", "static", "stribeck_velocity", "shape", "viscous"),
}
LEAST_POINTS = 4
STRIBECK_POINTS, STRIBECK_SPEEDS = 8, 6
"""Points and different speeds that five parameters need."""
MOST_POINTS = 500
"""More are averaged in groups of neighbouring speeds."""
TRUSTED = (0.7, 0.85)
"""Shares of the points that a start agrees with."""
GRID, SHAPES, STARTS = 12, (0.5, 1.0, 2.0), 6
"""Of the search for a start: v_s over its bounds, sigma, and how many starts are followed."""
OUTLYING = 3.5
"""Scatters from the curve beyond which a point is left out: one in two thousand honest ones."""
LEAST_SCATTER = 5e-3
"""Of the median friction: no table is so good that less could be called a wrong point."""
OUTLIER_FREEDOM = 8
"""Points beyond the parameters from which on wrong ones can be told at all."""
ROUNDS = 12
FOLDS = 5
EVIDENCE = 2.0
"""By which Bayes' information criterion must be smaller for a richer law."""
WIDE_OFFSET = 10.0
"""Of the largest friction: the standard deviation before the data of an offset that may be anything."""


@dataclass(frozen=True)
class CurvePoints:
    """Points of a table: |v| > 0, friction along the motion, its standard error, the direction (+1, -1), all (n,)."""

    speed: Array
    friction: Array
    error: Array
    way: Array

    def __getitem__(self, rows: BoolArray) -> CurvePoints:
        return CurvePoints(self.speed[rows], self.friction[rows], self.error[rows], self.way[rows])

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def both_ways(self) -> bool:
        """Whether an offset can be told."""
        return bool(self.way.min() < 0.0 < self.way.max())

    @property
    def speeds(self) -> int:
        """How many different speeds there are."""
        return len(np.unique(np.round(self.speed / self.speed.max(), 9)))


@dataclass(frozen=True, kw_only=True)
class LawFit:
    """One law on these points: parameters (p,) in the order of `names`, their 95 % ends (p, 2; NaN where not closed).

    covariance (p, p); chi_square with the errors as they are, freedom; bic; hold_out, root mean
    square of the errors of points that were not seen; at_bound: names that stopped at a bound;
    chance that a straight line would look as bent (Stribeck).
    """

    law: str
    names: tuple[str, ...]
    values: Array
    ends: Array
    covariance: Array
    chi_square: float
    freedom: int
    hold_out: float
    bic: float = math.nan
    at_bound: tuple[str, ...] = ()
    chance: float = math.nan

    def value(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def curve(self, speed: ArrayLike, way: ArrayLike = 0.0) -> Array:
        """Friction along the motion at speeds |v| in directions +1 and -1; 0 leaves the offset out."""
        v = np.abs(np.asarray(speed, dtype=np.float64))
        named = dict(zip(self.names, self.values.tolist(), strict=True))
        offset = named.get("offset", 0.0) * np.asarray(way, dtype=np.float64)
        if self.law == "stribeck":
            return stribeck_curve(v, [named[n] for n in PARAMETERS["stribeck"]]) + offset
        return named["coulomb"] + named.get("viscous", 0.0) * v + offset


@dataclass(frozen=True, kw_only=True)
class CurveFit:
    """The law that the points ask for, the others beside it, and which points were used (n,) and why not."""

    chosen: LawFit
    laws: tuple[LawFit, ...]
    points: CurvePoints
    used: BoolArray
    wrong: int
    """Points left out as wrong."""
    presliding_below: float
    """Speed below which all were left out; 0 for none."""
    at_rest: int
    scatter: float
    """Standard deviation of the points used, beside the curve, in units of their errors."""


def curve_points(
    speed: ArrayLike, effort: ArrayLike, error: ArrayLike | None = None, least_speed: float = 0.0
) -> tuple[CurvePoints, int]:
    """The points of a table with signed speeds and efforts (n,), those at rest taken out and counted.

    Without `error` all points have the same unknown one. Raises `IdentificationError` for efforts
    that drive where friction brakes.
    """
    v, f = channels(LEAST_POINTS, speed=speed, effort=effort)
    u = np.ones_like(f)
    if error is not None:
        v, f, u = channels(LEAST_POINTS, speed=v, effort=f, uncertainty=error)
        if u.min() <= 0.0:
            raise IdentificationError(
                "must be above zero", where="uncertainty", value=float(u.min()), limit="> 0"
            )
    moves = (v != 0.0) & (np.abs(v) >= least_speed)
    if moves.sum() < LEAST_POINTS:
        raise IdentificationError(
            "has too few points with motion",
            where="speed",
            value=int(moves.sum()),
            limit=f">= {LEAST_POINTS}",
            remedy="Measure more points, or lower least_speed.",
        )
    v, f, u = v[moves], f[moves], u[moves]
    way = np.sign(v)
    for sign, word in ((1.0, "forward"), (-1.0, "reverse")):
        along = sign * f[way == sign]
        if len(along) and np.median(along) < 0.0:
            raise IdentificationError(
                f"drives where friction brakes: the {word} points lie on the other side of zero",
                where="effort",
                value=float(np.median(along)),
                limit=">= 0 along the motion",
                remedy="Give effort the sign of its speed (magnitudes with magnitudes of the speed), or correct its "
                "sign at the import.",
            )
    points = CurvePoints(np.abs(v), way * f, u, way)
    return _grouped(points), int((~moves).sum())


def fit_curve(
    points: CurvePoints, *, has_errors: bool, law: Law = "auto", at_rest: int = 0
) -> CurveFit:
    """The friction law of a table of points, robust against wrong ones.

    `has_errors`: whether the errors of the points are known; otherwise their scatter about the
    curve is their error. Raises `IdentificationError` where the points cannot carry the law.
    """
    possible = _possible(points, law)
    # Wrong is what no law makes fit, even where a poorer one was asked for.
    used, below = _trusted(points, _possible(points, "auto")[-1])
    kept = points[used]
    possible = tuple(name for name in possible if law != "auto" or _carries(kept, name))
    fits = _with_evidence([_law(kept, name, has_errors) for name in possible], kept, has_errors)
    best = fits[0]
    for richer in fits[1:]:
        asks = richer.bic < best.bic - EVIDENCE
        if asks and not richer.hold_out > best.hold_out:
            best = richer
    left_out = ~used & (points.speed >= below)
    return CurveFit(
        chosen=best,
        laws=fits,
        points=points,
        used=used,
        wrong=int(left_out.sum()),
        presliding_below=below,
        at_rest=at_rest,
        scatter=math.sqrt(best.chi_square / max(best.freedom, 1)),
    )


def _with_evidence(fits: list[LawFit], points: CurvePoints, has_errors: bool) -> tuple[LawFit, ...]:
    """The laws with Bayes' information criterion, the scatter about the richest law counting as that of the points."""
    n, richest = len(points), fits[-1]
    scale = max(richest.chi_square / richest.freedom, 1.0)
    return tuple(
        replace(
            fit,
            bic=len(fit.names) * math.log(n)
            + (
                fit.chi_square / scale
                if has_errors
                else n * math.log(max(fit.chi_square, 1e-300) / n)
            ),
        )
        for fit in fits
    )


def _grouped(points: CurvePoints) -> CurvePoints:
    """At most `MOST_POINTS` points: means over neighbouring speeds of one direction where there are more."""
    size = -(-len(points) // MOST_POINTS)
    if size == 1:
        return points
    order = np.lexsort((points.speed, points.way))
    groups = [
        part
        for way in (-1.0, 1.0)
        if len(one := order[points.way[order] == way])
        for part in np.array_split(one, -(-len(one) // size))
    ]
    means = [[float(c[g].mean()) for g in groups] for c in (points.speed, points.friction)]
    error = [math.sqrt(float((points.error[g] ** 2).sum())) / len(g) for g in groups]
    way = [float(points.way[g[0]]) for g in groups]
    return CurvePoints(*(np.array(c) for c in (*means, error, way)))


def _carries(points: CurvePoints, law: str) -> bool:
    """Whether there are points and speeds enough for a law."""
    if law == "stribeck":
        return len(points) >= STRIBECK_POINTS and points.speeds >= STRIBECK_SPEEDS
    return law == "coulomb" or points.speeds >= 2


def _possible(points: CurvePoints, law: Law) -> tuple[str, ...]:
    """The laws to fit, the poorest first."""
    if law != "auto":
        if not _carries(points, law):
            raise IdentificationError(
                f"has too few points for the law {law}",
                where="friction-curve",
                value=f"{len(points)} points at {points.speeds} speeds",
                limit=f">= {STRIBECK_POINTS} points at {STRIBECK_SPEEDS} speeds",
                remedy="Measure at more speeds, or take a poorer law.",
            )
        return (law,)
    return tuple(name for name in PARAMETERS if _carries(points, name))


def _design(points: CurvePoints, law: str, velocity: float, shape: float) -> Array:
    """The linear columns (n, p) of a law, for given v_s and sigma."""
    columns = [np.ones(len(points))]
    if law != "coulomb":
        columns.append(points.speed)
    if law == "stribeck":
        columns.append(np.exp(-((points.speed / velocity) ** shape)))
    if points.both_ways:
        columns.append(points.way)
    return np.stack(columns, axis=1)


def _trusted(points: CurvePoints, law: str) -> tuple[BoolArray, float]:
    """Which points (n,) lie on a curve of this law together, and the speed below which none is taken.

    Of several starts the one is followed to which the points are likeliest, each either scattered
    about the curve or wrong and then anywhere.
    """
    everything = np.ones(len(points), dtype=bool)
    if len(points) - len(PARAMETERS[law]) - points.both_ways < OUTLIER_FREEDOM:
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
    for share in TRUSTED:
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
    count = math.ceil(min(TRUSTED) * len(points))
    left = _trimmed_residual(points, law, *start, count)
    floor = LEAST_SCATTER * float(np.median(np.abs(points.friction) / points.error))
    width = len(PARAMETERS[law]) + points.both_ways
    near = np.argsort(np.abs(left))[:count]
    used = np.zeros(len(points), dtype=bool)
    used[near] = True
    scatter = floor
    for _ in range(ROUNDS):
        before = used
        small = 1.0 + 5.0 / (len(points) - width)
        scatter = max(1.4826 * small * float(np.median(np.abs(left[used]))), floor)
        used = np.abs(left) <= OUTLYING * scatter
        if np.array_equal(used, before) or not _carries(points[used], law):
            break
        start = _searched(points[used], law, start)
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
    design = _design(points, law, velocity, shape) / points.error[:, None]
    y = points.friction / points.error
    left = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    for _ in range(ROUNDS):
        least = 1e-3 * float(np.abs(left).max()) + 1e-300
        root = 1.0 / np.sqrt(np.maximum(np.abs(left), least))
        left = y - design @ np.linalg.lstsq(design * root[:, None], y * root, rcond=None)[0]
    for _ in range(ROUNDS):
        near = np.argsort(np.abs(left))[:count]
        left = y - design @ np.linalg.lstsq(design[near], y[near], rcond=None)[0]
    return left


def _residual(
    points: CurvePoints, used: BoolArray, law: str, velocity: float, shape: float
) -> Array:
    """Residuals (n,) in errors of all points about the least-squares curve of those used."""
    design = _design(points, law, velocity, shape) / points.error[:, None]
    y = points.friction / points.error
    return y - design @ np.linalg.lstsq(design[used], y[used], rcond=None)[0]


def _searched(points: CurvePoints, law: str, start: tuple[float, float]) -> tuple[float, float]:
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


def _offset_column(points: CurvePoints) -> Array | None:
    """An offset as an error that all points share, so wide that the data alone decide; None for one direction."""
    if not points.both_ways:
        return None
    return (WIDE_OFFSET * float(np.abs(points.friction).max()) * points.way)[:, None]


def _stribeck(points: CurvePoints, error: Array) -> StribeckFit:
    return fit_stribeck(points.speed, points.friction, error, common=_offset_column(points))


def _law(points: CurvePoints, law: str, has_errors: bool) -> LawFit:
    """One law on points that are all trusted, with its error on points that it has not seen."""
    fit = _stribeck_law(points, has_errors) if law == "stribeck" else _line(points, law, has_errors)
    start = (1.0, 1.0) if law != "stribeck" else (float(fit.values[2]), float(fit.values[3]))
    errors = np.full(len(points), math.nan)
    fold = np.argsort(np.argsort(points.speed, kind="stable"), kind="stable") % FOLDS
    for k in range(FOLDS):
        rest, out = points[fold != k], fold == k
        if not _carries(rest, law) or len(rest) <= len(fit.names):
            continue
        other = _predicted(rest, points[out], law, start)
        errors[out] = (points.friction[out] - other) / points.error[out]
    unseen = math.sqrt(float(np.mean(errors**2)))
    freedom = max(fit.freedom, 1)
    return LawFit(
        law=law,
        names=fit.names,
        values=fit.values,
        ends=fit.ends,
        covariance=fit.covariance,
        chi_square=fit.chi_square,
        freedom=freedom,
        hold_out=unseen,
        at_bound=fit.at_bound,
        chance=fit.chance,
    )


@dataclass(frozen=True)
class _Solved:
    """Parameters of a law, before it is compared with others."""

    names: tuple[str, ...]
    values: Array
    ends: Array
    covariance: Array
    chi_square: float
    freedom: int
    at_bound: tuple[str, ...] = ()
    chance: float = math.nan


def _predicted(points: CurvePoints, at: CurvePoints, law: str, start: tuple[float, float]) -> Array:
    """What a law that was fitted to some points says at others."""
    velocity, shape = _searched(points, law, start)
    design = _design(points, law, velocity, shape) / points.error[:, None]
    values = np.linalg.lstsq(design, points.friction / points.error, rcond=None)[0]
    columns = _design(at, law, velocity, shape)
    if points.both_ways != at.both_ways:
        columns = np.column_stack([columns, at.way]) if points.both_ways else columns[:, :-1]
    return columns @ values


def _scale(chi_square: float, freedom: int, has_errors: bool) -> float:
    """What the variances of the points are multiplied with: the scatter, not less than what was stated."""
    reduced = chi_square / max(freedom, 1)
    return max(reduced, 1.0) if has_errors else reduced


def _line(points: CurvePoints, law: str, has_errors: bool) -> _Solved:
    """A law that is linear in its parameters."""
    design = _design(points, law, 1.0, 1.0) / points.error[:, None]
    y = points.friction / points.error
    names = (*PARAMETERS[law], *(("offset",) if points.both_ways else ()))
    freedom = len(y) - design.shape[1]
    if freedom < 1:
        raise IdentificationError(
            "has as many parameters as points", where=law, value=len(y), limit=f"> {len(names)}"
        )
    inverse = np.linalg.inv(design.T @ design)
    values = inverse @ design.T @ y
    chi = float(np.sum((y - design @ values) ** 2))
    covariance = np.asarray(inverse * _scale(chi, freedom, has_errors), dtype=np.float64)
    half = student_quantile(freedom) * np.sqrt(np.diag(covariance))
    ends = np.stack([values - half, values + half], axis=1)
    return _Solved(names, values, ends, covariance, chi, freedom)


def _stribeck_law(points: CurvePoints, has_errors: bool) -> _Solved:
    """The Stribeck law with the intervals of its profile likelihood, and the offset beside it."""
    both = points.both_ways
    error, offset = points.error, _offset_column(points)
    fit = _stribeck(points, error)
    freedom = max(len(points) - 5 - both, 1)
    if not has_errors:
        # Twice: the search is relative to the errors, which the first one finds.
        for _ in range(2):
            error = error * math.sqrt(max(fit.chi_square, 1e-300) / freedom)
            fit = _stribeck(points, error)
    ends = profile_intervals(fit, points.speed, points.friction, error, common=offset)
    names, values = PARAMETERS["stribeck"], fit.values
    covariance = fit.covariance
    chi = float(np.sum(((points.friction - _fitted(points, fit)) / points.error) ** 2))
    if both:
        residual = points.friction - stribeck_curve(points.speed, fit.values)
        weight = 1.0 / error**2
        place = float((weight * points.way) @ residual / weight.sum())
        u = math.sqrt(fit.scale / float(weight.sum()))
        names, values = (*names, "offset"), np.append(values, place)
        half = student_quantile(freedom) * u
        ends = np.vstack([ends, [place - half, place + half]])
        whole: Array = np.zeros((len(names), len(names)), dtype=np.float64)
        whole[:-1, :-1], whole[-1, -1] = covariance, u**2
        covariance = whole
    return _Solved(names, values, ends, covariance, chi, freedom, fit.at_bound, fit.chance)


def _fitted(points: CurvePoints, fit: StribeckFit) -> Array:
    """The curve at the points, with the offset that the data say."""
    offset = _offset_column(points)
    curve = fit.fitted
    return curve if offset is None else curve + offset @ fit.common
