"""The Stribeck curve from forces over speed: variable projection, profile likelihood, and the paper's genetic search.

    F(v) = F_c + (F_s - F_c) exp[-(v/v_s)^sigma] + c_v v        v = |theta_i'|        (equation 19)

For given (v_s, sigma) the curve is linear in F_c, F_s and c_v, so only two parameters are searched
(variable projection; Golub and Pereyra 1973): a coarse grid, then Levenberg-Marquardt on the
projected residual. F_s may lie below F_c: friction that rises from rest has no Stribeck dip, and
that is a result. Intervals are where the profile of chi-square has risen by the quantile of
F(1, n - 5), so that they are as skew as the likelihood is.

Points of one run share errors (heat, place on the output, literature values). Each is a column of
what one standard uncertainty of it does to the forces; the covariance of the forces is
diag(error^2) + sum of column column', and everything is solved in whitened coordinates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, channels
from model.identify.common_errors import whitening_of
from model.identify.least_squares import closest, student_quantile
from model.kernels import stribeck as kernels

NAMES = ("coulomb", "static", "stribeck_velocity", "shape", "viscous")
"""F_c, F_s, v_s, sigma, c_v: the order of every array of parameters here."""
LINEAR = (0, 1, 4)
"""Places of F_c, F_s and c_v among them, in which the curve is linear, and which are not negative."""


LOWEST_VELOCITY, HIGHEST_VELOCITY = 1.0 / 3.0, 1.0 / 4.0
"""Where v_s is searched, over the slowest and over the fastest speed: below, nothing is left of the Stribeck part at
the slowest speed (5 % for sigma = 1); above, it is not over at the fastest, and F_c is never seen alone."""


@dataclass(frozen=True)
class StribeckBounds:
    """Where v_s [rad/s] and sigma are searched."""

    stribeck_velocity: tuple[float, float]
    shape: tuple[float, float] = (0.3, 4.0)

    @classmethod
    def of(cls, speed: Array) -> StribeckBounds:
        """The bounds that measured speeds [rad/s] allow."""
        low = LOWEST_VELOCITY * float(speed.min())
        return cls((low, max(HIGHEST_VELOCITY * float(speed.max()), 10.0 * low)))

    def logarithms(self) -> Array:
        """Both bounds, (2, 2), as the search has them."""
        return np.log(np.array([self.stribeck_velocity, self.shape]))


@dataclass(frozen=True, kw_only=True)
class StribeckFit:
    """Best parameters (5,) in the order of `NAMES`, chi-square, degrees of freedom, linearised covariance (5, 5).

    `scale` multiplies the stated variances so that chi-square per degree of freedom is at least one
    (Birge ratio, squared). `gain` (5, n) is the change of the parameters per change of each force;
    `common` (m,) what the data say of each common error, in its standard uncertainty, and
    `common_gain` (m, n) its change per change of each force. at_bound: names of parameters that
    stopped at a bound. `chance` is the probability that points of a straight line F_c + c_v v would
    look as bent as these.
    """

    values: Array
    chi_square: float
    freedom: int
    scale: float
    covariance: Array
    fitted: Array
    gain: Array
    common: Array
    common_gain: Array
    at_bound: tuple[str, ...]
    chance: float


def stribeck_curve(speed: ArrayLike, values: ArrayLike) -> Array:
    """Equation 19 at speeds |theta_i'| [rad/s] for parameters (F_c, F_s, v_s, sigma, c_v)."""
    v = np.abs(np.asarray(speed, dtype=np.float64))
    coulomb, static, velocity, shape, viscous = np.asarray(values, dtype=np.float64)
    return coulomb + (static - coulomb) * np.exp(-((v / velocity) ** shape)) + viscous * v


def stribeck_jacobian(speed: Array, values: Array) -> Array:
    """Derivatives of the curve by its five parameters, shape (n, 5)."""
    coulomb, static, velocity, shape, _ = values
    ratio = np.maximum(speed / velocity, 1e-300)
    power = ratio**shape
    decay = np.exp(-power)
    drop = (static - coulomb) * decay * power
    return np.column_stack(
        [1.0 - decay, decay, drop * shape / velocity, -drop * np.log(ratio), speed]
    )


@dataclass(frozen=True)
class _Points:
    """Forces (n,) over speed (n,), whitened: `whitening` W (n, n), `white` (3, n) of W f, W 1, W v.

    `limits` (2, 2): between which logarithms of v_s and sigma are searched.
    """

    speed: Array
    force: Array
    whitening: Array
    white: Array
    limits: Array


def _points(
    speed: ArrayLike,
    force: ArrayLike,
    standard_error: ArrayLike,
    common: Array | None,
    bounds: StribeckBounds | None,
) -> _Points:
    v, f, u = channels(
        6,
        speed=np.abs(np.asarray(speed, dtype=np.float64)),
        force=force,
        standard_error=standard_error,
    )
    if v.min() <= 0.0:
        raise IdentificationError(
            "needs speeds other than zero", where="speed", value=float(v.min()), limit="> 0 rad/s"
        )
    if u.min() <= 0.0:
        raise IdentificationError(
            "must be above zero", where="standard_error", value=float(u.min()), limit="> 0"
        )
    if len(np.unique(np.round(v, 9))) < 6:
        raise IdentificationError(
            "has too few different speeds for five parameters",
            where="speed",
            value=len(np.unique(np.round(v, 9))),
            limit=">= 6",
            remedy="Measure at more speeds, dense at the low end.",
        )
    whitening = whitening_of(u, common)
    white = np.array([whitening @ x for x in (f, np.ones_like(f), v)])
    limits = (bounds or StribeckBounds.of(v)).logarithms()
    return _Points(v, f, whitening, white, limits)


def fit_stribeck(
    speed: ArrayLike,
    force: ArrayLike,
    standard_error: ArrayLike,
    *,
    common: Array | None = None,
    bounds: StribeckBounds | None = None,
) -> StribeckFit:
    """The five parameters of equation 19 from forces [N] at speeds [rad/s] with standard errors [N], all of shape (n,).

    Forces are magnitudes of one direction or of the half difference; `common` (n, m) is what one
    standard uncertainty of each error that they share does to them. F_c, F_s and c_v are kept
    non-negative.
    """
    points = _points(speed, force, standard_error, common, bounds)
    v, f, limits = points.speed, points.force, points.limits
    grid_v = np.linspace(float(limits[0][0]), float(limits[0][1]), 16)
    grid_s = np.clip(np.log([0.5, 0.8, 1.2, 2.0]), *limits[1])
    chi, best, linear = _search(points, grid_v, grid_s)
    values = np.array([linear[0], linear[1], math.exp(best[0]), math.exp(best[1]), linear[2]])
    jacobian = stribeck_jacobian(v, values)
    freedom = len(v) - 5
    scale = max(1.0, chi / max(freedom, 1))
    white = points.whitening @ jacobian
    size = np.sqrt(np.maximum(np.sum(white**2, axis=0), 1e-300))
    normal = (white / size).T @ (white / size)
    inverse: Array = np.asarray(np.linalg.pinv(normal, rcond=1e-12, hermitian=True), dtype=float)
    inverse = inverse / np.outer(size, size)
    fitted = stribeck_curve(v, values)
    gain = inverse @ white.T @ points.whitening
    shared = np.empty((len(v), 0)) if common is None else common
    common_gain = shared.T @ points.whitening.T @ points.whitening
    return StribeckFit(
        values=values,
        chi_square=float(chi),
        freedom=freedom,
        scale=float(scale),
        covariance=scale * inverse,
        fitted=fitted,
        gain=gain,
        common=common_gain @ (f - fitted),
        common_gain=common_gain - common_gain @ jacobian @ gain,
        at_bound=_at_bound(limits, best, linear),
        chance=_chance(points, float(chi), freedom, scale),
    )


def _at_bound(limits: Array, best: Array, linear: Array) -> tuple[str, ...]:
    """Names of the parameters that stopped at a bound: of the search, or zero."""
    searched = [
        name
        for name, k in (("stribeck_velocity", 0), ("shape", 1))
        if np.min(np.abs(limits[k] - best[k])) < 1e-6
    ]
    names = [NAMES[k] for k, value in zip(LINEAR, linear, strict=True) if value <= 0.0]
    return (*searched, *names)


def _chance(points: _Points, chi: float, freedom: int, scale: float) -> float:
    """The probability that a straight line would leave chi-square as much larger (F test, three parameters)."""
    white, line = points.white[0], points.white[1:].T
    left = white - line @ closest(line, white)
    gain = max(float(left @ left) - chi, 0.0) / 3.0
    return float(scipy.special.fdtrc(3.0, max(freedom, 1), gain / scale))


def _search(points: _Points, grid_v: Array, grid_s: Array) -> tuple[float, Array, Array]:
    """The best of a coarse grid of (log v_s, log sigma), then descent from its two best cells that
    are not neighbours.
    """
    v, white, whitening = points.speed, points.white, points.whitening
    residual, linear = np.empty_like(v), np.zeros(3)
    cells = [
        (
            kernels.stribeck_inner(
                v,
                white,
                whitening,
                math.exp(x),
                math.exp(s),
                kernels.FREE,
                0.0,
                linear,
                residual,
            ),
            x,
            s,
        )
        for x in grid_v.tolist()
        for s in grid_s.tolist()
    ]
    cells.sort()
    apart = [c for c in cells[1:] if abs(c[1] - cells[0][1]) + abs(c[2] - cells[0][2]) > 1.0]
    hold = np.zeros(2, dtype=np.int64)
    starts: list[tuple[float, Array, Array]] = []
    for _, x, s in (cells[0], *apart[:1]):
        start, linear = np.array([x, s]), np.zeros(3)
        chi = kernels.stribeck_descend(
            v, white, whitening, start, hold, kernels.FREE, 0.0, points.limits, 60, linear
        )
        starts.append((float(chi), start, linear))
    return min(starts, key=lambda item: item[0])


def profile_intervals(
    fit: StribeckFit,
    speed: ArrayLike,
    force: ArrayLike,
    standard_error: ArrayLike,
    *,
    common: Array | None = None,
    bounds: StribeckBounds | None = None,
    level: float = 0.95,
) -> Array:
    """Profile-likelihood intervals of the five parameters, shape (5, 2); NaN where the profile does not close.

    The data must be those of the fit. Holding one parameter, all others are at their best. F_c, F_s and c_v are never
    negative: where the profile has not closed at zero, zero is the low end, which is physics and no bound of a search.
    """
    points = _points(speed, force, standard_error, common, bounds)
    v, f, limits = points.speed, points.force, points.limits
    rise = fit.scale * student_quantile(fit.freedom, level) ** 2
    optimum = np.log(fit.values[2:4])
    errors = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    start = fit.values.copy()
    start[2:4] = optimum
    steps = errors.copy()
    steps[2:4] = np.minimum(errors[2:4] / fit.values[2:4], 1.0)
    steps = np.where(steps > 0.0, 1.8 * steps, 0.1 * np.maximum(np.abs(start), 1e-3))
    ceiling = 20.0 * max(float(np.max(np.abs(f))), 1e-12)
    ends = np.array(
        [
            [0.0, ceiling],
            [0.0, ceiling],
            limits[0],
            limits[1],
            [0.0, ceiling / max(float(v.min()), 1e-6)],
        ]
    )
    profile = _Profile(points, optimum, fit.chi_square)
    intervals = np.array(
        [
            [
                profile.end(k, float(start[k]), sign * float(steps[k]), float(ends[k, i]), rise)
                for i, sign in enumerate((-1.0, 1.0))
            ]
            for k in range(5)
        ]
    )
    intervals[2:4] = np.exp(intervals[2:4])
    intervals[LINEAR, 0] = np.nan_to_num(intervals[LINEAR, 0], nan=0.0)
    return intervals


@dataclass(frozen=True)
class _Profile:
    """The profile of chi-square along one parameter, the others at their best."""

    points: _Points
    optimum: Array
    lowest: float

    def root(self, which: int, place: float, start: Array) -> float:
        """Square root of the rise of chi-square with parameter `which` held; `start` follows the
        optimum of the others.
        """
        hold = np.zeros(2, dtype=np.int64)
        mode = {0: kernels.FIXED_COULOMB, 1: kernels.FIXED_STATIC, 4: kernels.FIXED_VISCOUS}.get(
            which, kernels.FREE
        )
        if which in (2, 3):
            start[which - 2], hold[which - 2] = place, 1
        chi = kernels.stribeck_descend(
            self.points.speed,
            self.points.white,
            self.points.whitening,
            start,
            hold,
            mode,
            place,
            self.points.limits,
            20,
            np.zeros(3),
        )
        return math.sqrt(max(float(chi) - self.lowest, 0.0))

    def end(self, which: int, value: float, step: float, limit: float, rise: float) -> float:
        """Where chi-square has risen by `rise`, searched from `value` in steps; NaN if it does not before `limit`."""
        target = math.sqrt(rise)
        start = self.optimum.copy()
        inside, root_inside = value, 0.0
        outside, root_outside = math.nan, math.nan
        for _ in range(30):
            place = inside + step
            last = (place - limit) * step >= 0.0
            if last:
                place = limit
            root = self.root(which, place, start)
            if root >= target:
                outside, root_outside = place, root
                break
            if last:
                return math.nan
            grown = 2.0 * abs(step)
            if root > 0.2 * target:
                grown = min(abs(1.15 * (place - value) * (target / root - 1.0)) + 1e-12, grown)
            step, inside, root_inside = math.copysign(grown, step), place, root
        if math.isnan(outside):
            return math.nan
        for _ in range(15):
            share = (target - root_inside) / max(root_outside - root_inside, 1e-12)
            place = inside + min(max(share, 0.05), 0.95) * (outside - inside)
            root = self.root(which, place, start)
            if abs(root - target) < 0.004 * target:
                return place
            if root < target:
                inside, root_inside = place, root
            else:
                outside, root_outside = place, root
        return 0.5 * (inside + outside)


POPULATION, GENERATIONS, CONVERGED = 100, 400, 1e-6
"""Of the genetic search: its size, where it ends, and the relative scatter of chi-square at which it has ended."""
MUTATION, CROSSOVER = (0.5, 1.0), 0.7
"""Factor of the differences, drawn per generation, and the share of parameters that a mutant hands on."""


@dataclass(frozen=True)
class GeneticFit:
    """The paper's way: a genetic search over all five parameters; best values, chi-square and evaluations."""

    values: Array
    chi_square: float
    evaluations: int


def fit_stribeck_genetic(
    speed: ArrayLike,
    force: ArrayLike,
    standard_error: ArrayLike,
    *,
    common: Array | None = None,
    seed: int = 0,
    bounds: StribeckBounds | None = None,
    generations: int = GENERATIONS,
) -> GeneticFit:
    """Equation 19 by differential evolution, as in the paper, for comparison with `fit_stribeck`;
    same data, same bounds.
    """
    points = _points(speed, force, standard_error, common, bounds)
    v, f = points.speed, points.force
    top = 3.0 * float(np.max(np.abs(f)))
    slope = 3.0 * float(np.max(np.abs(f)) / v.max())
    ranges: Array = np.array([(0.0, top), (0.0, top), *points.limits, (0.0, slope)])

    def chi_square(population: Array) -> Array:
        coulomb, static, velocity, shape, viscous = population.T
        decay = np.exp(-((v[:, None] / np.exp(velocity)) ** np.exp(shape)))
        curve = coulomb + (static - coulomb) * decay + viscous * v[:, None]
        return np.sum((points.whitening @ (f[:, None] - curve)) ** 2, axis=0)

    random = np.random.default_rng(seed)
    low, high = ranges.T
    population = random.uniform(low, high, (POPULATION, len(low)))
    cost, done = chi_square(population), 0
    while done < generations and cost.std() > CONVERGED * cost.mean():
        done += 1
        order = random.permutation(POPULATION)
        differences = population[order] - population[np.roll(order, 1)]
        mutant: Array = population[np.argmin(cost)] + random.uniform(*MUTATION) * differences
        mixed = np.where(random.random(mutant.shape) < CROSSOVER, mutant, population)
        # What leaves the box is drawn anew.
        drawn = random.uniform(low, high, mixed.shape)
        mixed = np.where((mixed >= low) & (mixed <= high), mixed, drawn)
        trial = chi_square(mixed)
        population[trial < cost] = mixed[trial < cost]
        cost = np.minimum(cost, trial)
    coulomb, static, velocity, shape, viscous = population[np.argmin(cost)]
    values = np.array([coulomb, static, math.exp(velocity), math.exp(shape), viscous])
    return GeneticFit(values, float(cost.min()), (done + 1) * POPULATION)
