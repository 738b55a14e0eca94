"""A table of friction over speed: Coulomb, Coulomb and viscous, or Stribeck, chosen by the points.

    coulomb            F = F_c sgn v + F_0
    coulomb-viscous    F = (F_c + c_v |v|) sgn v + F_0
    stribeck           F = {F_c + (F_s - F_c) exp[-(|v|/v_s)^sigma] + c_v |v|} sgn v + F_0

F_0 belongs to tables with both directions only. All bounds are those of the table's own speeds
(`model.identify.stribeck`), so that rad/s at a motor, mm/s at a slider and any unit of force are alike.

Tables have wrong points, and points that are no friction over speed at all: at rest, and while the
force still builds up after a reversal (presliding). `model.identify.friction_trusted` leaves both
out; `model.identify.friction_points` says what a point is.

A richer law is taken where Bayes' information criterion asks for it and the points that it has not
seen are predicted no worse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import BoolArray
from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.friction_points import (
    PARAMETERS,
    CurvePoints,
    Law,
    carries,
    law_design,
    possible_laws,
)
from model.identify.friction_trusted import searched, trusted_points
from model.identify.least_squares import closest, student_quantile
from model.identify.stribeck import (
    StribeckFit,
    fit_stribeck,
    profile_intervals,
    stribeck_curve,
)

FOLDS = 5
_EVIDENCE = 2.0
"""By which Bayes' information criterion must be smaller for a richer law."""
_WIDE_OFFSET = 10.0
"""Of the largest friction: the standard deviation before the data of an offset that may be anything."""


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


def fit_curve(
    points: CurvePoints, *, has_errors: bool, law: Law = "auto", at_rest: int = 0
) -> CurveFit:
    """The friction law of a table of points, robust against wrong ones.

    `has_errors`: whether the errors of the points are known; otherwise their scatter about the
    curve is their error. Raises `IdentificationError` where the points cannot carry the law.
    """
    possible = possible_laws(points, law)
    # Wrong is what no law makes fit, even where a poorer one was asked for.
    used, below = trusted_points(points, possible_laws(points, "auto")[-1])
    kept = points[used]
    possible = tuple(name for name in possible if law != "auto" or carries(kept, name))
    fits = _with_evidence([_law(kept, name, has_errors) for name in possible], kept, has_errors)
    best = fits[0]
    for richer in fits[1:]:
        asks = richer.bic < best.bic - _EVIDENCE
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

    def misfit(fit: LawFit) -> float:
        return (
            fit.chi_square / scale if has_errors else n * math.log(max(fit.chi_square, 1e-300) / n)
        )

    return tuple(replace(fit, bic=len(fit.names) * math.log(n) + misfit(fit)) for fit in fits)


def _offset_column(points: CurvePoints) -> Array | None:
    """An offset as an error that all points share, so wide that the data alone decide; None for one direction."""
    if not points.both_ways:
        return None
    return (_WIDE_OFFSET * float(np.abs(points.friction).max()) * points.way)[:, None]


def _stribeck(points: CurvePoints, error: Array) -> StribeckFit:
    return fit_stribeck(points.speed, points.friction, error, common=_offset_column(points))


def _law(points: CurvePoints, law: str, has_errors: bool) -> LawFit:
    """One law on points that are all trusted, with its error on points that it has not seen."""
    if law == "stribeck":
        fit = _stribeck_law(points, has_errors)
        start = float(fit.values[2]), float(fit.values[3])
    else:
        fit, start = _line(points, law, has_errors), (1.0, 1.0)
    errors = np.full(len(points), math.nan)
    fold = np.argsort(np.argsort(points.speed, kind="stable"), kind="stable") % FOLDS
    for k in range(FOLDS):
        rest, out = points[fold != k], fold == k
        if not carries(rest, law) or len(rest) <= len(fit.names):
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


_LEAST_ERROR = 1e-6
"""Of the largest friction: points that lie on a curve exactly leave nothing that the search could be relative to."""


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
    velocity, shape = searched(points, law, start)
    design = law_design(points, law, velocity, shape) / points.error[:, None]
    values = closest(design, points.friction / points.error)
    columns = law_design(at, law, velocity, shape)
    if points.both_ways != at.both_ways:
        columns = np.column_stack([columns, at.way]) if points.both_ways else columns[:, :-1]
    return columns @ values


def _scale(chi_square: float, freedom: int, has_errors: bool) -> float:
    """What the variances of the points are multiplied with: the scatter, not less than what was stated."""
    reduced = chi_square / max(freedom, 1)
    return max(reduced, 1.0) if has_errors else reduced


def _line(points: CurvePoints, law: str, has_errors: bool) -> _Solved:
    """A law that is linear in its parameters."""
    design = law_design(points, law, 1.0, 1.0) / points.error[:, None]
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
            error = np.maximum(error, _LEAST_ERROR * float(np.abs(points.friction).max()))
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
    return _Solved(
        names, values, ends, covariance, chi, freedom, at_bound=fit.at_bound, chance=fit.chance
    )


def _fitted(points: CurvePoints, fit: StribeckFit) -> Array:
    """The curve at the points, with the offset that the data say."""
    offset = _offset_column(points)
    curve = fit.fitted
    return curve if offset is None else curve + offset @ fit.common
