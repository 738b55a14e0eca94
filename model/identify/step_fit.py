"""One least-squares fit over all velocity steps of a run: the mode, and the kinematic error that rings it.

Gauss-Newton on the output angle itself. What belongs to one step alone (offset, a start that was not at rest,
the wind-up by friction) is projected out of it; the mode's numbers, the skew between the channels and the
kinematic error (orders n + k/N of the input, with k = 0 and sidebands, and orders k/N of the output) are the
same in all steps. Each step leaves its normal equations behind, so that predicting a step that was left out, and
the scatter that a step brings into a number, cost next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from model.errors import IdentificationError
from model.identify.checks import Array
from model.identify.step_data import SPEED_SMOOTHING, StepData
from model.identify.torsional_mode import TorsionModel
from model.kinematic_error import series_value
from model.units import REVOLUTION

LARGEST_SKEW = 2.5e-3
"""s by which the output may be latched beside the input."""
LONGEST = 3.0
"""s of a step that are fitted: its ring-down and a few revolutions."""
FALLING = 6.0
"""rad/s over which the wind-up by friction falls from rest (the Stribeck velocity, roughly)."""
ROUNDS = 24
_NEARBY = 0.05
"""Share of the largest change of a number within which derivatives by the kinematic error are used again."""
TRIALS, LEAST_DAMPED, STIFFER = 6, 1e-3, 8.0
"""Steps that are tried in a round, least damping of one (Marquardt's, as a share of the diagonal), and its factor."""
BAD_STEP = 1.5
"""How many times the median residual of the steps makes one count less."""
CONVERGED = 3e-5
"""Relative gain of the sum of squares below which a fit has converged."""
BASIS: tuple[tuple[int, int], ...] = (
    *((n, k) for n in range(1, 7) for k in (0, -1, 1)),
    (2, -2),
    (2, 2),
    (4, 4),
    (8, 0),
    *((0, k) for k in range(1, 9)),
)
"""Orders n + k/N of the kinematic error that are fitted; (0, k) takes up the output encoder's own as well."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """The numbers that all steps share, beside the kinematic error; logarithms where a number is positive.

    `prior`: mean and standard deviation of those that a run may not tell.
    """

    names: tuple[str, ...]
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])


@dataclass(frozen=True, kw_only=True)
class StepArrays:
    """One step on a fine even grid (m,), and the samples (n,) that are fitted.

    `rigid`: theta_i/N with the kinematic error that is taken as given; `own`: what friction winds up.
    """

    data: StepData
    fine: Array
    interval: float
    rigid: Array
    whole: Array
    slow: Array
    stamps: Array
    measured: Array
    own: Array


def step_arrays(
    data: StepData,
    interval: float,
    basis: Sequence[tuple[int, int]],
    *,
    longest: float = LONGEST,
) -> StepArrays:
    """A step made ready for the fit, on a fine grid of this interval [s], which is that of all steps.

    What comes after `longest` [s] is not fitted; a step that is predicted is taken to its end.
    """
    last = min(float(data.time[-1]), longest)
    fine = np.arange(data.time[0], last + 0.5 * interval, interval)
    fine = fine[fine <= data.time[-1]]
    angle = scipy.interpolate.CubicSpline(data.time, data.input_angle)(fine)
    # Friction winds the gear up from the first count on, its viscous part as the speed grows: by a smoothed speed it
    # would begin before the step does.
    speed = np.interp(fine, data.time, np.gradient(data.input_angle, data.time))
    rigid = angle / data.ratio + series_value(data.kinematic_error, angle)
    inside = (data.time >= fine[0] + LARGEST_SKEW) & (data.time <= fine[-1] - LARGEST_SKEW)
    moving = np.tanh(speed / SPEED_SMOOTHING)
    falling = moving * np.exp(-np.abs(speed) / FALLING)
    stamps = data.time[inside]
    own = np.column_stack([np.interp(stamps, fine, wound) for wound in (moving, falling, speed)])
    return StepArrays(
        data=data,
        fine=fine,
        interval=interval,
        rigid=np.asarray(rigid - rigid[0]),
        whole=_waves(angle, max(n for n, _ in basis)),
        slow=_waves(angle / data.ratio, max(abs(k) for _, k in basis)),
        stamps=stamps,
        measured=data.output_angle[inside] - rigid[0],
        own=own,
    )


def _waves(angle: Array, highest: int) -> Array:
    """Cosine and sine of 0 .. highest times an angle (highest + 1, 2, m)."""
    orders = np.arange(highest + 1)[:, None] * np.remainder(angle, REVOLUTION)
    return np.ascontiguousarray(np.stack([np.cos(orders), np.sin(orders)], axis=1))


@dataclass(frozen=True, kw_only=True)
class Normal:
    """Normal equations of one step after what is its own was projected out: J'J, J'r, r'r, and how many samples.

    `columns` and `waves` (n, ...) are J, by the shape's numbers and by the kinematic error, `residual` (n,) is r.
    """

    matrix: Array
    gradient: Array
    square: float
    count: int
    columns: Array
    waves: Array
    residual: Array

    @property
    def rms(self) -> float:
        return math.sqrt(self.square / self.count)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """All steps, the basis of the kinematic error and how wide its coefficients are believed to lie [rad].

    `input_density`: power density of the error of the input's counts, at the output [rad2 s]; `swing`: torque
    amplitude over J_o at which the mode is stated [rad/s2].
    """

    steps: tuple[StepArrays, ...]
    basis: tuple[tuple[int, int], ...]
    error_width: float
    model: Callable[[Mapping[str, float]], TorsionModel]
    input_density: float = 0.0
    swing: float = 0.0

    @property
    def interval(self) -> float:
        return self.steps[0].interval

    def ideal(self, step: StepArrays, error: Array) -> Array:
        """theta_i/N + ke on the fine grid, from its first value."""
        from model.kernels import steps as kernel

        ideal = step.rigid.copy()
        orders, bands = self._orders()
        kernel.error_signal(
            step.whole, step.slow, orders, bands, error[0::2].copy(), error[1::2].copy(), ideal
        )
        # Straight lines between samples cut the corners: this puts back what they lose on the mean.
        ideal[1:-1] -= np.diff(ideal, 2) / 12.0
        return ideal

    def _orders(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        pairs = np.array(self.basis, dtype=np.int64)
        return np.ascontiguousarray(pairs[:, 0]), np.ascontiguousarray(pairs[:, 1])

    def response(
        self, step: StepArrays, values: Mapping[str, float], ideal: Array, tables: Array
    ) -> tuple[Array, Array, NDArray[np.int64], Array]:
        """Output angle, speed and piece of the spring on the fine grid; how a Dahl element yields, (0, 2) for none."""
        from model.kernels import steps as kernel

        model = self.model(values)
        angle, speed = np.empty_like(ideal), np.empty_like(ideal)
        piece = np.zeros(len(ideal), dtype=np.int64)
        yielding = np.zeros((len(ideal) if model.hysteresis[1] > 0.0 else 0, 2))
        kernel.respond(
            ideal,
            values.get("bearing", 0.0),
            step.interval,
            tables,
            model.kinks,
            model.offsets,
            np.array(model.hysteresis),
            np.array([ideal[0], 0.0]),
            angle,
            speed,
            piece,
            yielding,
        )
        return angle, speed, piece, yielding

    def at_samples(
        self, step: StepArrays, skew: float, angle: Array, speed: Array
    ) -> tuple[Array, NDArray[np.int64], Array]:
        """The response at the samples, `skew` later than their stamps, with their places on the fine grid."""
        from model.kernels import steps as kernel

        where = (step.stamps + skew - step.fine[0]) / step.interval
        place = np.clip(where.astype(np.int64), 0, len(step.fine) - 2)
        share = where - place
        values = np.empty(len(place))
        kernel.sampled(angle, speed, step.interval, place, share, values)
        return values, place, share

    def normals(
        self,
        shape: Shape,
        values: Mapping[str, float],
        error: Array,
        *,
        gradient: bool = True,
        near: Sequence[Normal] = (),
    ) -> list[Normal]:
        """The normal equations of every step about these numbers.

        `near`: those of numbers nearby, whose derivatives by the kinematic error are used again; without `gradient`
        only the sums of squares.
        """
        tables = self.model(values).step(self.interval)
        moved = self._moved(shape, values) if gradient else []
        again = near or (None,) * len(self.steps)
        rings = self._rings(tables)
        return [
            self._normal(step, values, error, tables, rings, moved, old)
            for step, old in zip(self.steps, again, strict=True)
        ]

    def _moved(
        self, shape: Shape, values: Mapping[str, float]
    ) -> list[tuple[str, float, dict[str, float], Array]]:
        """For each number of the shape: its step of differentiation, and the model's tables there."""
        moved: list[tuple[str, float, dict[str, float], Array]] = []
        for name in shape.names:
            h = STEPS.get(name, 1e-3)
            there = {**values, name: values[name] + h}
            moved.append((name, h, there, self.model(there).step(self.interval)))
        return moved

    def _normal(
        self,
        step: StepArrays,
        values: Mapping[str, float],
        error: Array,
        tables: Array,
        rings: list[tuple[Array, Array]],
        moved: list[tuple[str, float, dict[str, float], Array]],
        near: Normal | None,
    ) -> Normal:
        from model.kernels import products
        from model.kernels import steps as kernel

        ideal = self.ideal(step, error)
        angle, speed, piece, yielding = self.response(step, values, ideal, tables)
        predicted, place, share = self.at_samples(step, values["skew"], angle, speed)
        residual = (step.measured - predicted)[:, np.newaxis]
        columns = np.empty((len(place), len(moved)))
        for j, (name, h, there, table) in enumerate(moved):
            if name == "skew":
                columns[:, j] = np.interp(step.stamps + values["skew"], step.fine, speed)
                continue
            other = self.response(step, there, ideal, table)
            columns[:, j] = (
                self.at_samples(step, values["skew"], other[0], other[1])[0] - predicted
            ) / h
        own = products.orthonormal(self._own(step, rings, place, share))
        products.take_out(own, residual)
        products.take_out(own, columns)
        size = len(moved)
        waves, block = np.empty((len(place), 0)), np.empty((0, 0))
        if moved and near is not None:
            waves, block = near.waves, near.matrix[size:, size:]
        elif moved:
            orders, bands = self._orders()
            waves = np.empty((len(place), 2 * len(self.basis)))
            kernel.sensitivities(
                step.whole,
                step.slow,
                orders,
                bands,
                step.interval,
                tables,
                piece,
                place,
                share,
                yielding,
                waves,
            )
            products.take_out(own, waves)
            block = products.inner(waves, waves)
        matrix = np.empty((size + len(block), size + len(block)))
        matrix[:size, :size] = products.inner(columns, columns)
        matrix[:size, size:] = products.inner(columns, waves)
        matrix[size:, :size] = matrix[:size, size:].T
        matrix[size:, size:] = block
        return Normal(
            matrix=matrix,
            gradient=np.concatenate(
                [products.inner(residual, columns)[0], products.inner(residual, waves)[0]]
            ),
            square=float(products.inner(residual, residual)[0, 0]),
            count=len(residual),
            columns=columns,
            waves=waves,
            residual=residual[:, 0],
        )

    def _rings(self, tables: Array) -> list[tuple[Array, Array]]:
        """How the mode rings down from an angle and from a speed, on the grid of the longest step; all others are its
        beginning.
        """
        from model.kernels import steps as kernel

        still = np.zeros(max(len(step.fine) for step in self.steps))
        linear = np.repeat(tables[:1], 3, axis=0)
        none, piece = np.zeros(0), np.zeros(len(still), dtype=np.int64)
        rings: list[tuple[Array, Array]] = []
        for start in ([1.0, 0.0], [0.0, 100.0]):
            angle, speed = np.empty_like(still), np.empty_like(still)
            kernel.respond(
                still,
                0.0,
                self.interval,
                linear,
                none,
                np.zeros(1),
                np.zeros(2),
                np.array(start),
                angle,
                speed,
                piece,
                np.zeros((0, 2)),
            )
            rings.append((angle, speed))
        return rings

    def _own(
        self,
        step: StepArrays,
        rings: list[tuple[Array, Array]],
        place: NDArray[np.int64],
        share: Array,
    ) -> Array:
        """What belongs to one step alone: offset, wind-up, and a ring-down from before it began."""
        from model.kernels import steps as kernel

        own = [np.ones(len(place)), *step.own.T]
        for angle, speed in rings:
            values = np.empty(len(place))
            kernel.sampled(angle, speed, step.interval, place, share, values)
            own.append(values)
        return np.column_stack(own)


STEPS: Mapping[str, float] = {
    "stiffness": 1e-4,
    "damping": 1e-2,
    "bearing": 1e-2,
    "skew": 1e-6,
    "second": 1e-4,
    "kink": 1e-4,
    "soft": 1e-4,
}
"""Steps of differentiation; 1e-3 for the rest."""


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
        return np.asarray(np.linalg.inv(_regular(total)), dtype=float)

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

    def covariance(self) -> Array:
        """Covariance (p, p) of the numbers for the noise that the fit leaves, independent from sample to sample."""
        count = sum(w * n.count for w, n in zip(self.weights, self.normals, strict=True))
        return self.inverse() * self.square / count

    @property
    def samples(self) -> int:
        return sum(n.count for n in self.normals)

    def robust_cost(self) -> float:
        """Squares over the noise's, a bad step as its weight has it, and the prior's pull."""
        squares = np.array([n.square / n.count for n in self.normals])
        counts = np.array([n.count for n in self.normals])
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


def _normal_equations(
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
) -> Solution:
    """Levenberg-Marquardt from a start; numbers with a prior are drawn to it."""
    names, size = shape.names, len(shape.names)
    weights = np.ones(len(problem.steps)) if weights is None else weights
    centre, penalty = _prior(shape, len(error), problem.error_width)
    values = dict(start)

    def cost(vector: Array, normals: Sequence[Normal]) -> float:
        fitted = sum(w * n.square for w, n in zip(weights, normals, strict=True))
        return float(fitted) / noise**2 + float(penalty @ (vector - centre) ** 2)

    vector = np.concatenate([[values[n] for n in names], error])
    is_converged = True
    normals = problem.normals(shape, values, error)
    best, wandered, damped = cost(vector, normals), 0.0, 0.0
    for _ in range(rounds):
        total, pull = _normal_equations(weights, normals, penalty * noise**2, vector - centre)
        for _ in range(TRIALS):
            held = total + np.diag(damped * np.diag(total))
            change = _not_below(names, vector, held, pull)
            change *= min(1.0, 1.0 / max(_excess(names, change[:size]), 1e-9))
            trial: Array = np.asarray(vector + change, dtype=float)
            if not np.all(np.isfinite(trial)):
                raise IdentificationError("the fit of the steps diverged", where="velocity steps")
            there = {**values, **dict(zip(names, trial[:size].tolist(), strict=True))}
            there["skew"] = min(max(there["skew"], -LARGEST_SKEW), LARGEST_SKEW)
            # A spring that is nothing, or everything, is no answer: the step was too long.
            is_spring = all(abs(there[name]) < _RUNAWAY for name in names if name != "skew")
            found = (
                cost(trial, problem.normals(shape, there, trial[size:], gradient=False))
                if is_spring
                else math.inf
            )
            if found <= best:
                break
            damped = max(STIFFER * damped, LEAST_DAMPED)
        else:
            break
        damped = damped / STIFFER if damped > LEAST_DAMPED else 0.0
        gained, best = best - found, found
        vector, values = trial, there
        wandered += _excess(names, change[:size])
        near = normals if wandered < _NEARBY else ()
        normals = problem.normals(shape, values, vector[size:], near=near)
        wandered *= bool(near)
        if gained < CONVERGED * best:
            break
    else:
        is_converged = False
    if wandered:
        normals = problem.normals(shape, values, vector[size:])
    if not math.isfinite(best):
        raise IdentificationError("the fit of the steps diverged", where="velocity steps")
    return Solution(
        shape=shape,
        values=values,
        error=vector[size:],
        normals=tuple(normals),
        weights=weights,
        noise=noise,
        penalty=penalty,
        centre=centre,
        is_converged=is_converged,
    )


def _not_below(names: Sequence[str], vector: Array, matrix: Array, pull: Array) -> Array:
    """The change (p,) that solves the normal equations and leaves friction of the output's bearing at nothing or more.

    Where it would go below, it is held at nothing and the others are solved beside it: a step that crosses the bound
    promises what no model gives, and the search stops at it far from its answer.
    """
    change: Array = np.asarray(np.linalg.solve(matrix, pull), dtype=float)
    for place, name in enumerate(names):
        if name == "bearing" and vector[place] + change[place] < 0.0:
            others = np.arange(len(vector)) != place
            down = -float(vector[place])
            rest = pull[others] - matrix[others, place] * down
            change[others] = np.linalg.solve(matrix[np.ix_(others, others)], rest)
            change[place] = down
    return change


_RUNAWAY = 200.0
"""Logarithm of a number of the spring, in SI, beyond which it is none."""
_LARGEST: Mapping[str, float] = {"stiffness": 0.1, "damping": 1.0, "skew": 5e-4, "second": 0.2}


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
