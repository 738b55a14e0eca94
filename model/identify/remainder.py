"""What a table leaves of the kinematic error, against what was predicted of it.

    seen^2      = sum over v of |r_v|^2/2                          r_v: order v of theta_o - phi/N, as it is seen
    predicted^2 = sum over v of (|m_v|^2 + t_v + b_v + c_v)/2 + rest^2

m_v = H(v w) d_v/N: the motor's own deviation from where the table sends it (tracking, and the servo's answer to the
table), by the motor encoder, as the gear's spring H passes it on; t_v: trace of the table's covariance (type A); c_v:
trace of that of r_v itself (counts, noise); b_v: type B, what nobody knows of the spring, what friction winds up from
run to run (a share of half the difference of the directions), and what an order is another one in another run; rest:
orders that the gear shows and the table leaves. Nothing in it is the output's, so that a table of wrong sign, phase or
gear is predicted as well as a right one, and seen to leave more.

The ratio of both squares follows F: of the numerator the degrees of freedom by its variance, |m|^2 being no chance,
2 E^2/Var with Var = sum of (2 |m|^2 s + s^2), s = t + b + c; of the denominator by those of t, b and c
(Welch-Satterthwaite).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.special  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import ComplexArray, FloatArray, quotient
from model.errors import IdentificationError

REFUSED = 1.3
"""Remainder over prediction that the whole interval must exceed before a table is called wrong."""
HYSTERESIS = 0.1
"""Of half the difference of the directions: standard uncertainty of what friction, as warm as it is, winds up anew."""
REPRODUCED = 0.01
"""Of an order, standard uncertainty: what it is another one in another run of the same mounting."""
_OF_TYPE_B = 8.0
"""Degrees of freedom of what is known to a quarter of itself (GUM G.3)."""
_COVERED = 0.95
_LARGE = 1e6
ProofVerdict = Literal["PASS", "MARGINAL", "FAIL"]


@dataclass(frozen=True, kw_only=True)
class OrdersLeft:
    """One direction at one speed, per order (v,): the remainder [rad] with its variance, what the motor's deviation
    makes at the output [rad], the variances of the table and of the bench (traces, rad2); degrees of freedom; `rest`
    [rad].
    """

    remainder: ComplexArray
    variance: FloatArray
    freedom: float
    motor: ComplexArray
    table: FloatArray
    table_freedom: float
    bench: FloatArray
    rest: float

    @property
    def seen(self) -> float:
        """Mean square [rad2]."""
        return 0.5 * float(np.sum(np.abs(self.remainder) ** 2))

    @property
    def predicted(self) -> float:
        """Mean square [rad2]."""
        return 0.5 * float(np.sum(np.abs(self.motor) ** 2 + self._chance)) + self.rest**2

    @property
    def _chance(self) -> FloatArray:
        return self.table + self.variance + self.bench

    @property
    def scatter(self) -> float:
        """Variance of the seen mean square, if the prediction is right [rad4]."""
        s, d = self._chance, np.abs(self.motor) ** 2
        return 0.25 * float(np.sum(2.0 * d * s + s**2)) + self.rest**4

    @property
    def doubt(self) -> float:
        """Variance of the predicted mean square [rad4]."""
        parts = (
            (self.table, self.table_freedom),
            (self.variance, self.freedom),
            (self.bench, _OF_TYPE_B),
        )
        return sum(0.25 * float(np.sum(2.0 * v**2 / max(f, 1.0))) for v, f in parts)


@dataclass(frozen=True, kw_only=True)
class Remainder:
    """Seen and predicted r.m.s. [rad], their ratio with its 95 % interval, and what it says of the table.

    `chance`, `doubt`: standard uncertainties of the ratio, by what the seen one scatters where the prediction is right,
    and by what the prediction is not known.
    """

    seen: float
    predicted: float
    ratio: float
    low: float
    high: float
    chance: float
    doubt: float
    freedom: float
    verdict: ProofVerdict


def remainder_of(ways: Sequence[OrdersLeft]) -> Remainder:
    """The remainder of all directions together. Raises `IdentificationError` for none."""
    if not ways:
        raise IdentificationError("holds no traverse along a table", where="compensated")
    count = len(ways)
    seen = sum(one.seen for one in ways) / count
    predicted = sum(one.predicted for one in ways) / count
    scatter = sum(one.scatter for one in ways) / count**2
    doubt = sum(one.doubt for one in ways) / count**2
    first, second = _freedom(predicted, scatter), _freedom(predicted, doubt)
    ratio = math.sqrt(seen / predicted)
    half = 0.5 * (1.0 - _COVERED)
    low = ratio / math.sqrt(float(scipy.special.fdtri(first, second, 1.0 - half)))
    high = ratio / math.sqrt(float(scipy.special.fdtri(first, second, half)))
    verdict: ProofVerdict = "MARGINAL"
    if low <= 1.0 <= high:
        verdict = "PASS"
    elif low > REFUSED:
        verdict = "FAIL"
    return Remainder(
        seen=math.sqrt(seen),
        predicted=math.sqrt(predicted),
        ratio=ratio,
        low=low,
        high=high,
        chance=0.5 * ratio * math.sqrt(scatter) / predicted,
        doubt=0.5 * ratio * math.sqrt(doubt) / predicted,
        freedom=first,
        verdict=verdict,
    )


def _freedom(square: float, variance: float) -> float:
    """2 E^2/Var, within what F can be asked for."""
    return min(quotient(2.0 * square**2, variance, _LARGE), _LARGE)


def bracket(
    speeds: Sequence[float], without: Sequence[float], beside: Sequence[float]
) -> tuple[float | None, float | None]:
    """Between which input speeds a table begins to harm: the fastest below which it helped everywhere, and the slowest
    at which it left more than there was without it. `without`, `beside`: r.m.s. without and with the table, by speed.
    """
    helped: float | None = None
    for speed, before, after in sorted(zip(speeds, without, beside, strict=True)):
        if after >= before:
            return helped, speed
        helped = speed
    return helped, None
