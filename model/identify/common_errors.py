"""Errors that the points of one run share, and how far points differ that are measured again.

Heat, the place on the output, a literature value in the model: each moves all points of a run
together. A `CommonError` says what one standard uncertainty of it does to each hold. A fit that is
told of them weighs its points accordingly, learns of each what the data can say, and carries what
is left as a line of its budget (generalised least squares; Gauss-Markov with priors).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.identify.checks import Array
from model.identify.estimate import Cause, Distribution
from model.identify.repeated import LARGEST, SMALLEST


@dataclass(frozen=True, kw_only=True)
class CommonError:
    """`effect` (n,): change of each hold's friction [N m, positive where it brakes] for one standard uncertainty;
    (n, p) where the error has several independent parts, waves for instance.

    `source` is its name in budgets; `kind`, `cause`, `degrees_of_freedom`, `assumed`, `distribution` as there.
    `is_fitted` False keeps it out of the weights and of the statistical interval: an error that no data could tell
    (a torque scale), added as type B alone.
    """

    source: str
    effect: Array
    kind: Literal["A", "B"] = "B"
    cause: Cause | None = None
    note: str = ""
    is_fitted: bool = True
    assumed: str = ""
    degrees_of_freedom: float = math.inf
    distribution: Distribution = Distribution.NORMAL

    @property
    def columns(self) -> Array:
        """The effect as (n, p)."""
        return self.effect.reshape(len(self.effect), -1)


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a common error is taken for, whatever the fit makes of it: value and standard uncertainty, both in the
    standard uncertainty of the error as it was given, and where they come from.
    """

    value: float = 0.0
    uncertainty: float = 1.0
    source: str = ""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Relative standard deviations: `point` of a point that is measured again, `place` of each wave over the output.

    `freedom`: how many repetitions stand behind them.
    """

    point: float
    place: float
    freedom: int


UNREPEATED = Spread(point=0.005, place=0.0, freedom=0)
"""Assumed where no speed was visited twice."""


def means_by(level: Array) -> Array:
    """A free mean for each level: (n, levels) of zeros and ones from numbers (n,) of the levels."""
    levels, index = np.unique(level, return_inverse=True)
    return np.eye(len(levels))[index]


def spread_beyond(
    free: Array, relative: Array, error: Array, common: Array, place: Array
) -> tuple[float, float]:
    """Scatter of points and size of waves over the output beyond their errors, by restricted maximum likelihood.

    free (n, q): what may be fitted first, the means of speeds or a curve with its tangents, so that what it explains
    does not pass for scatter; relative (n,): friction over its curve; error (n,) its relative standard error; common
    (n, m) relative effects of common errors; place (n, p) the waves. Both are relative standard deviations; the waves
    are 0 where chance explains them.
    """
    contrasts: Array = scipy.linalg.null_space(free.T)
    y = contrasts.T @ relative
    fixed = contrasts.T @ (np.diag(error**2) + common @ common.T) @ contrasts
    waves = contrasts.T @ place
    by_place, unit = waves @ waves.T, np.eye(len(y))

    def cost(logarithms: Array) -> float:
        """Minus twice the restricted likelihood, for the logarithm of the scatter alone or of scatter and waves."""
        variance = np.exp(2.0 * np.clip(logarithms, math.log(SMALLEST), math.log(LARGEST)))
        whole: Array = fixed + variance[0] * unit
        if len(variance) > 1:
            whole = whole + variance[1] * by_place
        root = np.asarray(np.linalg.cholesky(whole), dtype=np.float64)
        white: Array = scipy.linalg.solve_triangular(root, y, lower=True)
        return float(white @ white) + 2.0 * float(np.log(np.diag(root)).sum())

    grid = np.log([5e-4, 1e-3, 4e-3, 1.5e-2])
    best = still = _lowest(cost, [np.array([p]) for p in grid])
    if place.shape[1]:
        best = _lowest(cost, [np.array([p, w]) for p in grid for w in grid])
    # Twice the gain of the likelihood against its 95 % quantile: waves that chance explains are none.
    varies = cost(still) - cost(best) > scipy.special.chdtri(1.0, 0.05)
    found = np.exp(np.clip(best if varies else still, math.log(SMALLEST), math.log(LARGEST)))
    return float(found[0]), float(found[-1]) if varies else 0.0


def _lowest(cost: Callable[[Array], float], starts: list[Array]) -> Array:
    """Where a cost is lowest, searched from the best of some starts."""
    best = scipy.optimize.minimize(
        cost,
        min(starts, key=cost),
        method="Nelder-Mead",
        options={"xatol": 0.05, "fatol": 0.01, "maxiter": 80},
    )
    return np.asarray(best.x, dtype=np.float64)


def whitening_of(standard_error: Array, common: Array | None = None) -> Array:
    """Lower triangular W (n, n) with W'W the inverse of diag(standard_error^2) + common common'; common (n, m)."""
    if common is None or common.shape[1] == 0:
        return np.diag(1.0 / standard_error)
    # Scaled to unit errors first, so that forces of any unit are equally well conditioned.
    relative = common / standard_error[:, None]
    root = np.linalg.cholesky(np.eye(len(standard_error)) + relative @ relative.T)
    inverse = scipy.linalg.solve_triangular(root, np.diag(1.0 / standard_error), lower=True)
    return np.ascontiguousarray(inverse)
