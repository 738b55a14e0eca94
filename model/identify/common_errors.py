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
import scipy

from model.identify.checks import Array
from model.identify.estimate import Cause


@dataclass(frozen=True, kw_only=True)
class CommonError:
    """`effect` (n,): change of each hold's friction [N m, positive where it brakes] for one standard uncertainty;
    (n, p) where the error has several independent parts, waves for instance.

    `source` is its name in budgets, `kind` and `cause` as there. `is_fitted` False keeps it out of the weights and of
    the statistical interval: an error that no data could tell (a torque scale), added as type B alone.
    """

    source: str
    effect: Array
    kind: Literal["A", "B"] = "B"
    cause: Cause | None = None
    note: str = ""
    is_fitted: bool = True

    @property
    def columns(self) -> Array:
        """The effect as (n, p)."""
        return self.effect.reshape(len(self.effect), -1)


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
_SMALLEST, _LARGEST = 1e-4, 0.2


def spread_between_visits(
    relative: Array, error: Array, level: Array, place: Array, common: Array
) -> Spread:
    """How visits to the same speed differ, by restricted maximum likelihood.

    relative (n,): friction over its curve; error (n,) its relative standard error; level (n,) numbers the speeds, each
    of which has a free mean, so that a curve that misses its points does not pass for scatter; place (n, p) the waves
    over the output; common (n, m) relative effects of further common errors.
    """
    levels, index = np.unique(level, return_inverse=True)
    freedom = len(relative) - len(levels)
    if freedom < 3:
        return UNREPEATED
    means = np.zeros((len(relative), len(levels)))
    means[np.arange(len(relative)), index] = 1.0
    # Contrasts within speeds: what no free mean can touch.
    contrasts = scipy.linalg.null_space(means.T)
    y = contrasts.T @ relative
    fixed = contrasts.T @ (np.diag(error**2) + common @ common.T) @ contrasts
    waves = contrasts.T @ place
    by_place, unit = waves @ waves.T, np.eye(freedom)

    def cost(logarithms: Array) -> float:
        """Minus twice the restricted likelihood, for the logarithm of the scatter alone or of scatter and waves."""
        variance = np.exp(2.0 * np.clip(logarithms, math.log(_SMALLEST), math.log(_LARGEST)))
        whole = fixed + variance[0] * unit
        if len(variance) > 1:
            whole = whole + variance[1] * by_place
        root = np.linalg.cholesky(whole)
        white = scipy.linalg.solve_triangular(root, y, lower=True)
        return float(white @ white) + 2.0 * float(np.log(np.diag(root)).sum())

    grid = np.log([2e-4, 1e-3, 4e-3, 1.5e-2])
    best = still = _lowest(cost, [np.array([p]) for p in grid])
    if place.shape[1]:
        best = _lowest(cost, [np.array([p, w]) for p in grid for w in grid])
    # Twice the gain of the likelihood against its 95 % quantile: waves that chance explains are none.
    varies = cost(still) - cost(best) > scipy.special.chdtri(1.0, 0.05)
    found = np.exp(np.clip(best if varies else still, math.log(_SMALLEST), math.log(_LARGEST)))
    return Spread(point=float(found[0]), place=float(found[-1]) if varies else 0.0, freedom=freedom)


def _lowest(cost: Callable[[Array], float], starts: list[Array]) -> Array:
    """Where a cost is lowest, searched from the best of some starts."""
    best = scipy.optimize.minimize(
        cost,
        min(starts, key=cost),
        method="Nelder-Mead",
        options={"xatol": 0.05, "fatol": 0.01, "maxiter": 80},
    )
    return np.asarray(best.x, dtype=np.float64)
