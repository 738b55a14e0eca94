"""What an output that is carried by a spring makes of a kinematic error, and how it is taken out again.

Equation 2 with the input prescribed is linear: at the order v of an input that turns with w the
output is theta_o = H(j v w) (theta_i/N + ke), H about 1/(1 - r^2) with r = v w/w_1 below the first
mode. Input ripple is amplified like the error. An output that is read later than the input by a
time tau is turned by exp(j v w tau) beside. So per order, complex,

    ke = theta_o exp(-j v w tau)/H - theta_i/N

The time tau has opposite senses in the two directions of travel, H's amplitude the same: both
directions together tell tau from the data, never H.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.identify.angle_fit import AngleFit, solve_angle
from model.identify.checks import Array
from model.identify.estimate import BudgetLine
from model.identify.least_squares import student_quantile
from model.linear import (
    DynamicParameters,
    damping_matrix,
    mass_matrix,
    stiffness_matrix,
    undamped_frequencies,
)

HIGHEST_SHARE = 0.25
"""r^2 above which an order is too near the mode for a correction by stated parameters."""
_LEAST_ORDER = 0.5
"""Orders that turn with the output are too slow to tell a time."""
OTHER_SPEED = 1.2
"""Ratio of the speeds of a run from which on the growth of its orders tells something."""
BY_SET = BudgetLine("torsional amplification, corrected: resonance of the parameter set", "B", 0.0)
_BY_STATEMENT = BudgetLine("torsional amplification, corrected: resonance as stated", "B", 0.0)
_BY_GROWTH = BudgetLine(
    "torsional amplification, bounded by the growth of the orders with speed", "B", 0.0
)
"""The line of a mode in budgets; its size is that of each order."""


@dataclass(frozen=True, kw_only=True)
class Torsion:
    """The gear's spring and the inertia that it carries, and how well w_1^2 is known (relative, standard)."""

    parameters: DynamicParameters
    relative_uncertainty: float
    line: BudgetLine = BY_SET

    @property
    def first_mode(self) -> float:
        """w_1, undamped [rad/s]."""
        return float(undamped_frequencies(self.parameters)[0])

    def seen_in(self, traverses: Sequence[Traverse]) -> Torsion:
        """The same: what a parameter set states is not learnt from the run."""
        return self

    def response(self, frequency: Array) -> np.ndarray:
        """H(j w) of theta_i/N + ke -> theta_o at angular frequencies of either sign [rad/s]; 1 at w = 0."""
        p = self.parameters
        s = 1j * np.asarray(frequency, dtype=np.float64)[:, None, None]
        dynamic = stiffness_matrix(p) + s * damping_matrix(p) + s * s * mass_matrix(p)
        push = np.zeros((len(dynamic), 3, 1), dtype=np.complex128)
        push[:, 0, 0] = p.bearing_stiffness + s[:, 0, 0] * p.bearing_damping
        follows: np.ndarray = np.linalg.solve(dynamic, push)[:, 2, 0] / math.tan(p.tooth_angle)
        return follows


@dataclass(frozen=True, kw_only=True)
class UnstatedMode:
    """A first mode that nobody stated: 1/w_1^2 lies between nothing and `largest` [s2/rad2], rectangular.

    Half of what it may amplify is taken out, and as much is open on either side.
    """

    largest: float
    line: BudgetLine

    @property
    def relative_uncertainty(self) -> float:
        """Of the half that is taken out."""
        return 1.0 / math.sqrt(3.0)

    @property
    def first_mode(self) -> float:
        """The lowest that w_1 may be [rad/s]."""
        return 1.0 / math.sqrt(self.largest)

    def response(self, frequency: Array) -> np.ndarray:
        """The middle of H at angular frequencies [rad/s]; beyond `HIGHEST_SHARE` it is none that is used."""
        share = np.minimum(
            self.largest * np.asarray(frequency, dtype=np.float64) ** 2, HIGHEST_SHARE
        )
        middle: np.ndarray = 1.0 / (1.0 - 0.5 * share) + 0.0j
        return middle

    def seen_in(self, traverses: Sequence[Traverse]) -> UnstatedMode:
        """Bounded by how the orders grow with speed, where the traverses have several and that says more."""
        found = growth(traverses)
        if found is None:
            return self
        value, half = found
        largest = max(value, 0.0) + half
        return replace(self, largest=largest, line=_BY_GROWTH) if largest < self.largest else self


@dataclass(frozen=True, kw_only=True)
class StatedMode:
    """A first mode w_1 [rad/s] that somebody stated, and the relative standard uncertainty of 1/w_1^2."""

    first_mode: float
    relative_uncertainty: float
    line: BudgetLine = _BY_STATEMENT

    def response(self, frequency: Array) -> np.ndarray:
        """H at angular frequencies [rad/s]; beyond `HIGHEST_SHARE` it is none that is used."""
        share = (np.asarray(frequency, dtype=np.float64) / self.first_mode) ** 2
        whole: np.ndarray = 1.0 / (1.0 - np.minimum(share, HIGHEST_SHARE)) + 0.0j
        return whole

    def seen_in(self, traverses: Sequence[Traverse]) -> StatedMode:
        """The same: what somebody states is not learnt from the run."""
        return self


Spring = Torsion | UnstatedMode | StatedMode


@dataclass(frozen=True, kw_only=True)
class Traverse:
    """A fit of what the encoders show, with the input's mean speed [rad/s, signed] and its ripple.

    ripple (orders,): complex amplitude of theta_i less its mean motion [rad at the input], a - ib.
    """

    fit: AngleFit
    speed: float
    ripple: np.ndarray

    @property
    def output(self) -> np.ndarray:
        """Complex amplitude of the output angle at each order [rad], (orders,)."""
        return amplitudes(self.fit) + self.ripple / self.fit.basis.ratio


def amplitudes(fit: AngleFit) -> np.ndarray:
    """a - ib of every order, (orders,)."""
    complex_values: np.ndarray = fit.values[2::2] - 1j * fit.values[3::2]
    return complex_values


def traverse(fit: AngleFit, time: int | None, speed: float = 0.0) -> Traverse:
    """With speed and ripple from the time of the samples, which is value number `time` of the cells; else without."""
    ripple = np.zeros(len(fit.basis.orders), dtype=np.complex128)
    if time is None:
        return Traverse(fit=fit, speed=speed, ripple=ripple)
    timed, _ = solve_angle(fit.cells, fit.basis, value=time, columns=fit.used)
    speed = fit.cells.trend_scale / float(timed.values[1])
    return Traverse(fit=fit, speed=speed, ripple=-speed * amplitudes(timed))


def line_of(spring: Spring | None) -> BudgetLine:
    """The line of a mode in budgets; without one nothing is corrected, and the line is 0."""
    return BY_SET if spring is None else spring.line


def growth(traverses: Sequence[Traverse]) -> tuple[float, float] | None:
    """1/w_1^2 [s2/rad2] by how the orders grow with speed, and the half-width of its 95 % interval; None for one speed.

    |theta_o - theta_i/N| of an order v is its own size and (v w)^2/w_1^2 of the output's; its own size is free, and
    another one in either direction, as friction has a part in it.
    """
    pulls: list[Array] = []
    sizes: list[Array] = []
    weights: list[Array] = []
    for way in (1.0, -1.0):
        same = [one for one in traverses if one.speed * way > 0.0]
        speeds = [abs(one.speed) for one in same]
        if not same or max(speeds) < OTHER_SPEED * min(speeds):
            continue
        orders = np.array(same[0].fit.basis.orders)
        own = np.array([amplitudes(one.fit) for one in same])
        along = own.conj() / np.maximum(np.abs(own), 1e-30)
        pull = np.real(np.array([one.output for one in same]) * along)
        pull *= np.outer(speeds, orders) ** 2
        spread = np.array([np.diag(one.fit.covariance)[2:] for one in same])
        variance = 0.5 * (spread[:, 0::2] + spread[:, 1::2])
        seen = (np.abs(own) > 5.0 * np.sqrt(variance)).all(axis=0) & (orders > _LEAST_ORDER)
        weight = 1.0 / variance[:, seen]
        for values, into in ((pull, pulls), (np.abs(own), sizes)):
            mean = np.sum(weight * values[:, seen], axis=0) / weight.sum(axis=0)
            into.append((values[:, seen] - mean).ravel())
        weights.append(weight.ravel())
    if not sum(w.size for w in weights):
        return None
    pull, size, weight = np.concatenate(pulls), np.concatenate(sizes), np.concatenate(weights)
    information = float(np.sum(weight * pull**2))
    freedom = len(size) // 2
    value = float(np.sum(weight * pull * size)) / information
    left = float(np.sum(weight * (size - value * pull) ** 2)) / freedom
    return value, student_quantile(float(freedom)) * math.sqrt(max(left, 1.0) / information)


def corrected(one: Traverse, torsion: Spring | None, delay: float = 0.0) -> AngleFit:
    """The fit with torsion and delay taken out; `doubt` is its change by one standard uncertainty of w_1^2."""
    orders = np.array(one.fit.basis.orders)
    frequency = orders * one.speed
    turn = np.exp(-1j * frequency * delay)
    stretch = np.ones(len(orders), dtype=np.complex128)
    if torsion is not None and one.speed != 0.0:
        stretch = 1.0 / torsion.response(frequency)
    output = one.output * turn
    own = output * stretch - one.ripple / one.fit.basis.ratio
    used = one.fit.used[2::2]
    values = one.fit.values.copy()
    values[2::2], values[3::2] = np.where(used, own.real, 0.0), np.where(used, -own.imag, 0.0)
    if torsion is None:
        return replace(one.fit, values=values)
    away = output * (1.0 - stretch) * torsion.relative_uncertainty
    change = np.asarray(np.where(used, away, 0.0), dtype=np.complex128)
    doubt = np.zeros(len(values))
    doubt[2::2], doubt[3::2] = change.real, -change.imag
    return replace(one.fit, values=values, doubt=doubt)


def too_near(one: Traverse, torsion: Spring | None) -> np.ndarray:
    """Orders (mask) whose frequency is too near the first mode for a correction."""
    orders = np.array(one.fit.basis.orders)
    if torsion is None:
        return np.zeros(len(orders), dtype=bool)
    near: np.ndarray = (orders * one.speed / torsion.first_mode) ** 2 > HIGHEST_SHARE
    return near


def delay_between(
    forward: Traverse, reverse: Traverse, torsion: Spring | None = None
) -> tuple[float, float]:
    """How much later the output is read than the input [s], and its standard uncertainty, from both directions.

    An order of the error differs between the directions by j v tau (w theta_o) forward less reverse;
    what friction adds to an order is in phase with it, so that only what is across it counts. (0, 0)
    where no order stands above the noise.
    """
    orders = np.array(forward.fit.basis.orders)
    seen = [amplitudes(corrected(one, torsion)) for one in (forward, reverse)]
    middle = 0.5 * (seen[0] + seen[1])
    variance = np.zeros(len(orders))
    for one in (forward, reverse):
        spread = np.diag(one.fit.covariance)
        variance += 0.5 * (spread[2::2] + spread[3::2])
    size = np.abs(middle)
    use = (orders > _LEAST_ORDER) & (size > 5.0 * np.sqrt(variance)) & forward.fit.used[2::2]
    if not use.any() or forward.speed == reverse.speed:
        return 0.0, 0.0
    along = (middle.conj() / np.where(size > 0.0, size, 1.0))[use]
    outputs = [
        c + one.ripple / one.fit.basis.ratio
        for c, one in zip(seen, (forward, reverse), strict=True)
    ]
    later = orders * (forward.speed * outputs[0] - reverse.speed * outputs[1])
    across = np.imag((seen[0] - seen[1])[use] * along)
    lever = np.imag(1j * later[use] * along)
    weight = 1.0 / variance[use]
    information = float(np.sum(weight * lever**2))
    delay = float(np.sum(weight * lever * across)) / information
    left = float(np.sum(weight * (across - lever * delay) ** 2)) / max(int(use.sum()) - 1, 1)
    return delay, math.sqrt(max(left, 1.0) / information)
