"""One least-squares fit over all velocity steps of a run: the mode, and the kinematic error that rings it.

Gauss-Newton on the output angle itself, of a `model.identify.step_problem.Problem`. Each step leaves its normal
equations behind, so that predicting a step that was left out, and the scatter that a step brings into a number,
cost next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.least_squares import inverse_of, solution_of
from model.identify.step_problem import LARGEST_SKEW, Normal, Problem, Shape

ROUNDS = 24
_NEARBY = 0.05
"""Share of the largest change of a number within which derivatives by the kinematic error are used again."""
TRIALS, LEAST_DAMPED, STIFFER = 6, 1e-3, 8.0
"""Steps that are tried in a round, least damping of one (Marquardt's, as a share of the diagonal), and its factor."""
BAD_STEP = 1.5
"""How many times the median residual of the steps makes one count less."""
CONVERGED, ROUGHLY = 3e-6, 3e-5
"""Relative gain of the sum of squares below which a fit has converged, and below which one of several starts has."""
_RUNAWAY = 200.0
"""Logarithm of a number of the spring, in SI, beyond which it is none."""
_LARGEST: Mapping[str, float] = {"stiffness": 0.1, "damping": 1.0, "skew": 5e-4, "second": 0.2}


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A fit: the shape's values, the coefficients of the kinematic error, and the normal equations left behind."""

    shape: Shape
    values: dict[str, float]
    error: Array
    normals: tuple[Normal, ...]
    weights: Array
    noise: float
    penalty: Array
    centre: Array
    is_converged: bool = True

    @property
    def vector(self) -> Array:
        return np.concatenate([[self.values[n] for n in self.shape.names], self.error])

    @property
    def square(self) -> float:
        """Weighted sum of squares of all steps [rad2]."""
        return float(sum(w * n.square for w, n in zip(self.weights, self.normals, strict=True)))

    def inverse(self, without: Sequence[int] = ()) -> Array:
        """Inverse of the normal equations (p, p), of all steps or without some."""
        total = np.diag(self.penalty * self.noise**2)
        for index, (weight, normal) in enumerate(zip(self.weights, self.normals, strict=True)):
            if index not in without:
                total = total + weight * normal.matrix
        return inverse_of(_regular(total))

    def left_out(self, group: Sequence[int]) -> Array:
        """How the numbers change where these steps are left out (p,), to first order."""
        pull = sum(
            (self.weights[i] * self.normals[i].gradient for i in group), np.zeros(len(self.vector))
        )
        return -self.inverse(group) @ pull

    def predicted_square(self, index: int) -> float:
        """Sum of squares of a step where the fit has not seen it, to second order [rad2]."""
        change, normal = self.left_out((index,)), self.normals[index]
        bend = float(change @ normal.matrix @ change)
        return normal.square - 2.0 * float(change @ normal.gradient) + bend

    def influence(self) -> Array:
        """What each step pulls every number by (steps, p): sums to nothing but the pull of the prior."""
        inverse = self.inverse()
        pulls = [w * n.gradient for w, n in zip(self.weights, self.normals, strict=True)]
        return np.array(pulls) @ inverse

    def covariance(self, without: Sequence[int] = ()) -> Array:
        """Covariance (p, p) of the numbers for the noise that the fit leaves, independent from sample to sample; of all
        steps or without some.
        """
        count = sum(w * n.count for w, n in zip(self.weights, self.normals, strict=True))
        return self.inverse(without) * self.square / count

    @property
    def samples(self) -> int:
        return sum(normal.count for normal in self.normals)

    def robust_cost(self) -> float:
        """Squares over the noise's, a bad step as its weight has it, and the prior's pull."""
        squares = np.array([normal.square / normal.count for normal in self.normals])
        counts = np.array([normal.count for normal in self.normals])
        return float(counts @ bounded(squares)) / self.noise**2 + self.pull

    @property
    def pull(self) -> float:
        """What the prior adds to the cost."""
        return float(self.penalty @ (self.vector - self.centre) ** 2)


def bounded(squares: Array) -> Array:
    """Mean squares of the steps (n,) as the weights of `reweighted` count them, which fall beyond c = 1.5 medians.

    With the weight (c/r)^4 of a root mean square r, the cost whose slope by r^2 that is: r^2 up to c^2, then
    2 c^2 - c^4/r^2. So a step that no model explains does not choose the answer.
    """
    knee = BAD_STEP**2 * float(np.median(squares))
    return np.where(squares > knee, 2.0 * knee - knee**2 / np.maximum(squares, 1e-300), squares)


def _regular(matrix: Array) -> Array:
    """A matrix with a hair on its diagonal, for columns that a run does not show at all."""
    return matrix + np.diag(1e-12 * np.maximum(np.diag(matrix), 1e-30))


def _prior(shape: Shape, errors: int, error_width: float) -> tuple[Array, Array]:
    """What the numbers of a fit are drawn to, and how strongly (p,); the kinematic error's to nothing."""
    size = len(shape.names)
    centre = np.zeros(size + errors)
    penalty = np.concatenate([np.zeros(size), np.full(errors, error_width**-2.0)])
    for index, name in enumerate(shape.names):
        if name in shape.prior:
            centre[index], width = shape.prior[name]
            penalty[index] = width**-2.0
    return centre, penalty


def normal_equations(
    weights: Array, normals: Sequence[Normal], penalty: Array, beyond: Array
) -> tuple[Array, Array]:
    """Matrix (p, p) and right-hand side (p,) of all steps and of the prior, from which the numbers are `beyond`."""
    total: Array = np.diag(penalty)
    pull: Array = -penalty * beyond
    for weight, normal in zip(weights, normals, strict=True):
        total = total + weight * normal.matrix
        pull = pull + weight * normal.gradient
    return _regular(total), pull


def fit_all(
    problem: Problem,
    shape: Shape,
    start: Mapping[str, float],
    error: Array,
    *,
    noise: float,
    weights: Array | None = None,
    rounds: int = ROUNDS,
    converged: float = CONVERGED,
    known: Sequence[Normal] = (),
) -> Solution:
    """Levenberg-Marquardt from a start; numbers with a prior are drawn to it. `known`: the normal equations there."""
    size = len(shape.names)
    weights = np.ones(len(problem.steps)) if weights is None else weights
    centre, penalty = _prior(shape, len(error), problem.error_width)
    goal = _Goal(problem, shape, noise, weights, centre, penalty)
    is_converged = True
    normals = known or problem.normals(shape, start, error)
    vector: Array = np.concatenate([[start[n] for n in shape.names], error])
    here = _Place(vector, dict(start), goal.cost(vector, normals))
    wandered = damped = 0.0
    for _ in range(rounds):
        there, change, damped = goal.lower(here, normals, damped)
        if there is None:
            break
        damped = damped / STIFFER if damped > LEAST_DAMPED else 0.0
        gained, here = here.cost - there.cost, there
        wandered += change
        near = normals if wandered < _NEARBY else ()
        normals = problem.normals(shape, here.values, here.vector[size:], near=near)
        wandered *= bool(near)
        if gained < converged * here.cost:
            break
    else:
        is_converged = False
    if wandered:
        normals = problem.normals(shape, here.values, here.vector[size:])
    if not math.isfinite(here.cost):
        raise IdentificationError("the fit of the steps diverged", where="velocity steps")
    return Solution(
        shape=shape,
        values=here.values,
        error=here.vector[size:],
        normals=tuple(normals),
        weights=weights,
        noise=noise,
        penalty=penalty,
        centre=centre,
        is_converged=is_converged,
    )


@dataclass(frozen=True)
class _Place:
    """Where a search stands: the numbers (p,) in one row, those of the shape by name, and their cost."""

    vector: Array
    values: dict[str, float]
    cost: float


@dataclass(frozen=True)
class _Goal:
    """What a search lowers: the steps' squares by their weights over the noise's, and the pull of the prior."""

    problem: Problem
    shape: Shape
    noise: float
    weights: Array
    centre: Array
    penalty: Array

    def cost(self, vector: Array, normals: Sequence[Normal]) -> float:
        fitted = sum(w * n.square for w, n in zip(self.weights, normals, strict=True))
        return float(fitted) / self.noise**2 + float(self.penalty @ (vector - self.centre) ** 2)

    def lower(
        self, here: _Place, normals: Sequence[Normal], damped: float
    ) -> tuple[_Place | None, float, float]:
        """The first place that costs no more, None without one; how large the step to it is, and its damping."""
        names, size = self.shape.names, len(self.shape.names)
        total, pull = normal_equations(
            self.weights, normals, self.penalty * self.noise**2, here.vector - self.centre
        )
        for _ in range(TRIALS):
            held = total + np.diag(damped * np.diag(total))
            change = _not_below(names, here.vector, held, pull)
            change *= min(1.0, 1.0 / max(_excess(names, change[:size]), 1e-9))
            there = self._place(here, np.asarray(here.vector + change, dtype=float))
            if there.cost <= here.cost:
                return there, _excess(names, change[:size]), damped
            damped = max(STIFFER * damped, LEAST_DAMPED)
        return None, 0.0, damped

    def _place(self, here: _Place, vector: Array) -> _Place:
        """The numbers of a trial with their cost."""
        names, size = self.shape.names, len(self.shape.names)
        if not np.all(np.isfinite(vector)):
            raise IdentificationError("the fit of the steps diverged", where="velocity steps")
        values = {**here.values, **dict(zip(names, vector[:size].tolist(), strict=True))}
        values["skew"] = min(max(values["skew"], -LARGEST_SKEW), LARGEST_SKEW)
        # The prior pulls at the numbers that are looked at, not at those beyond the bound.
        vector[:size] = [values[name] for name in names]
        # A spring that is nothing, or everything, is no answer: the step was too long.
        if not all(abs(values[name]) < _RUNAWAY for name in names if name != "skew"):
            return _Place(vector, values, math.inf)
        normals = self.problem.normals(self.shape, values, vector[size:], gradient=False)
        return _Place(vector, values, self.cost(vector, normals))


def _not_below(names: Sequence[str], vector: Array, matrix: Array, pull: Array) -> Array:
    """The change (p,) that solves the normal equations and leaves friction of the output's bearing at nothing or more.

    Where it would go below, it is held at nothing and the others are solved beside it: a step that crosses the bound
    promises what no model gives, and the search stops at it far from its answer.
    """
    change = solution_of(matrix, pull)
    for place, name in enumerate(names):
        if name == "bearing" and vector[place] + change[place] < 0.0:
            others = np.arange(len(vector)) != place
            down = -float(vector[place])
            rest = pull[others] - matrix[others, place] * down
            change[others] = np.linalg.solve(matrix[np.ix_(others, others)], rest)
            change[place] = down
    return change


def _excess(names: Sequence[str], change: Array) -> float:
    """How much larger a change is than one that Gauss-Newton is believed over."""
    sizes = [
        abs(c) / _LARGEST.get(n, 0.5) for n, c in zip(names, change, strict=True) if n != "bearing"
    ]
    return max(sizes, default=0.0)


def reweighted(solution: Solution) -> Array:
    """Weights of the steps: one, less where a step's residual is well above the others' (more than 1.5 times)."""
    rms = np.array([n.rms for n in solution.normals])
    return np.minimum(1.0, (BAD_STEP * np.median(rms) / rms) ** 4)
