"""The velocity steps of a run as one least-squares problem: their arrays, their response, their normal equations.

What belongs to one step alone (offset, a start that was not at rest, the wind-up by friction) is projected out of
it; the mode's numbers, the skew between the channels and the kinematic error (orders n + k/N of the input, with
k = 0 and sidebands, and orders k/N of the output) are the same in all steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from model.identify.checks import Array
from model.identify.step_data import SPEED_SMOOTHING, StepData
from model.identify.torsional_mode import TorsionModel
from model.kinematic_error import series_value
from model.units import REVOLUTION

LARGEST_SKEW = 2.5e-3
"""s by which the output may be latched beside the input."""
LONGEST = 3.0
"""s of a step that are fitted: its ring-down and a few revolutions."""
_SMOOTH = 11
"""Degree of the spline between the input's samples. The input rings with the output, by a quarter of it and more: a
cubic spline takes 6 % off an oscillation of a third of the sampling rate (11 % at 0.37), and the mode comes out 2 %
too high; this one takes less than 1 % off up to 0.4 of it.
"""
FALLING = 6.0
"""rad/s over which the wind-up by friction falls from rest (the Stribeck velocity, roughly)."""
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

    `rigid`: theta_i/N with the kinematic error that is taken as given; `own` (3, m): what friction winds up; `seen`
    (m,): the measured speed of the output by its stamps.
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
    seen: Array


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
    angle = between_samples(data.time, data.input_angle, fine)
    # Friction winds the gear up from the first count on, its viscous part as the speed grows: by a smoothed speed it
    # would begin before the step does.
    speed = np.interp(fine, data.time, np.gradient(data.input_angle, data.time))
    rigid = angle / data.ratio + series_value(data.kinematic_error, angle)
    inside = (data.time >= fine[0] + LARGEST_SKEW) & (data.time <= fine[-1] - LARGEST_SKEW)
    moving = np.tanh(speed / SPEED_SMOOTHING)
    falling = moving * np.exp(-np.abs(speed) / FALLING)
    return StepArrays(
        data=data,
        fine=fine,
        interval=interval,
        rigid=np.asarray(rigid - rigid[0]),
        whole=_waves(angle, max(n for n, _ in basis)),
        slow=_waves(angle / data.ratio, max(abs(k) for _, k in basis)),
        stamps=data.time[inside],
        measured=data.output_angle[inside] - rigid[0],
        own=np.array([moving, falling, speed]),
        seen=between_samples(data.time, data.output_angle, fine, derivative=1),
    )


def between_samples(time: Array, values: Array, fine: Array, *, derivative: int = 0) -> Array:
    """Values (m,) at fine times or their derivative, by a spline of degree `_SMOOTH` through the samples (n,), turned
    about the first and the last of them: at an end of its own such a spline makes sixty of one count.
    """
    first, last = slice(_SMOOTH, 0, -1), slice(-2, -_SMOOTH - 2, -1)

    def longer(row: Array) -> Array:
        return np.concatenate([2.0 * row[0] - row[first], row, 2.0 * row[-1] - row[last]])

    spline = scipy.interpolate.make_interp_spline(longer(time), longer(values), k=_SMOOTH)
    return np.asarray(spline(fine, derivative), dtype=float)


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


@dataclass(frozen=True)
class _Moved:
    """A number of the shape, what it is moved `by` in all, and all numbers and the model's tables at both ends; None
    where it is not moved to the other side.
    """

    name: str
    by: float
    behind: tuple[dict[str, float], Array] | None
    ahead: tuple[dict[str, float], Array]


@dataclass(frozen=True, kw_only=True)
class Problem:
    """All steps, the basis of the kinematic error and how wide its coefficients are believed to lie [rad].

    `swing`: torque amplitude over J_o at which the mode is stated [rad/s2]; `observer`: gain [1/s] with which the
    response follows the measured speed of the output, 0 where it runs alone.
    """

    steps: tuple[StepArrays, ...]
    basis: tuple[tuple[int, int], ...]
    error_width: float
    model: Callable[[Mapping[str, float]], TorsionModel]
    swing: float = 0.0
    observer: float = 0.0

    @property
    def alone(self) -> Problem:
        """The same without an observer."""
        return replace(self, observer=0.0)

    def tables(self, values: Mapping[str, float]) -> Array:
        """The step matrices of these numbers (pieces, 3, 6)."""
        return self.model(values).step(self.interval, self.observer)

    @property
    def interval(self) -> float:
        return self.steps[0].interval

    def by_speed(self) -> list[list[int]]:
        """The places of the steps of each speed, whatever their direction."""
        groups: dict[float, list[int]] = {}
        for index, step in enumerate(self.steps):
            groups.setdefault(round(abs(step.data.target), 3), []).append(index)
        return list(groups.values())

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
            step.seen,
            self.observer,
            values.get("skew", 0.0) / step.interval,
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
        tables = self.tables(values)
        moved = self._moved(shape, values) if gradient else []
        again = near or (None,) * len(self.steps)
        rings = self._rings(tables)
        return [
            self._normal(step, values, error, tables, rings, moved, near=old)
            for step, old in zip(self.steps, again, strict=True)
        ]

    def _moved(self, shape: Shape, values: Mapping[str, float]) -> list[_Moved]:
        """Each number of the shape moved by its step of differentiation."""
        moved: list[_Moved] = []
        for name in shape.names:
            h = STEPS[name]
            if name == "bearing" and name in shape.prior:
                h = _BEARING_STEP * shape.prior[name][1]
            here = values[name]
            # A bearing drives nothing.
            back = min(h, here) if name == "bearing" else h
            behind = self._at({**values, name: here - back}) if back else None
            moved.append(_Moved(name, h + back, behind, self._at({**values, name: here + h})))
        return moved

    def _at(self, values: dict[str, float]) -> tuple[dict[str, float], Array]:
        return values, self.tables(values)

    def _normal(
        self,
        step: StepArrays,
        values: Mapping[str, float],
        error: Array,
        tables: Array,
        rings: list[tuple[Array, Array]],
        moved: list[_Moved],
        *,
        near: Normal | None,
    ) -> Normal:
        from model.kernels import products

        ideal = self.ideal(step, error)
        angle, speed, piece, yielding = self.response(step, values, ideal, tables)
        predicted, place, share = self.at_samples(step, values["skew"], angle, speed)
        residual = (step.measured - predicted)[:, np.newaxis]
        columns = np.empty((len(place), len(moved)))
        for j, one in enumerate(moved):
            columns[:, j] = self._change(step, ideal, predicted, one)
        own = products.orthonormal(self._own(step, rings, place, share))
        products.take_out(own, residual)
        products.take_out(own, columns)
        size = len(moved)
        waves, block = np.empty((len(place), 0)), np.empty((0, 0))
        if moved and near is not None:
            waves, block = near.waves, near.matrix[size:, size:]
        elif moved:
            waves = self._error_columns(step, tables, piece, yielding, (place, share))
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

    def _change(self, step: StepArrays, ideal: Array, predicted: Array, moved: _Moved) -> Array:
        """What a number that is moved changes of the response at the samples (n,), per unit of it."""

        def there(values: dict[str, float], tables: Array) -> Array:
            angle, speed, _, _ = self.response(step, values, ideal, tables)
            return self.at_samples(step, values["skew"], angle, speed)[0]

        before = predicted if moved.behind is None else there(*moved.behind)
        return (there(*moved.ahead) - before) / moved.by

    def _error_columns(
        self,
        step: StepArrays,
        tables: Array,
        piece: NDArray[np.int64],
        yielding: Array,
        samples: tuple[NDArray[np.int64], Array],
    ) -> Array:
        """Derivatives of the response at the samples by the coefficients of the kinematic error, (n, 2 orders)."""
        from model.kernels import steps as kernel

        orders, bands = self._orders()
        place, share = samples
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
        return waves

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
                still,
                0.0,
                0.0,
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

        # Wound up as the output is latched, which is later than the stamps.
        at = step.fine[place] + share * step.interval
        own: list[Array] = [
            np.ones(len(at)),
            *(np.interp(at, step.fine, wound) for wound in step.own),
        ]
        for angle, speed in rings:
            values = np.empty(len(place))
            kernel.sampled(angle, speed, step.interval, place, share, values)
            own.append(values)
        return np.column_stack(own)


STEPS: Mapping[str, float] = {
    "stiffness": 2e-3,
    "damping": 4e-2,
    "bearing": 1e-2,
    "skew": 1e-6,
    "second": 5e-3,
    "third": 5e-3,
    "kink": 5e-3,
    "soft": 4e-2,
    "limit": 4e-2,
}
"""Steps of differentiation to either side, about as far as a run tells each. A spring that bends, an element that
slides and an output that sticks do so a sample earlier or later: the squares are jagged, and a search that met a small
step of them stopped 10 % beside the damping.
"""
_BEARING_STEP = 0.02
"""The same of the bearing's friction, as a share of how large it is believed to be."""
