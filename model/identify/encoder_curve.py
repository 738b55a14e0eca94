"""An output encoder's own curve out of the kinematic errors of gears that were mounted at stated angles on it.

    Z_jk = E_k + S_k e^(i k alpha_j) + D_gk e^(i k alpha_j) + c_jk        order k of the encoder's revolution

Z: what a run shows at order k, over the encoder's own angle from its index mark (error = Re Z e^(-i k phi)); E: the
encoder; S: what all gears share, which turns with them; D: what a gear differs by; c: what a mounting adds (an
eccentric seat, mostly k = 1). alpha: the stated angle of the gear on the flange. Several gears at spread angles, or
one at three or more, part E from S (of one gear: from the gear) by least squares; of several gears at several angles
each the two variances are found by restricted maximum likelihood. The complex error of E lies with 95 % inside

    U_k = sqrt(2 F_0.95(2, nu)) u_k        u_k: of one component; nu: degrees of freedom

Where the angles turn an order into itself (45 degrees apart: order 8; 0 and 180 degrees: 2, 4, ...) encoder and gear
are one: then E is the mean, with a line for what gears share, as large as at the orders that are parted and no less
than what they differ by.
"""

from __future__ import annotations

import cmath
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.special  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from model.angle_certificate import CERTIFIED_ORDERS, COVERAGE_FACTOR, AngleCertificate, curve_of
from model.arrays import FloatArray

ComplexArray = NDArray[np.complex128]
SINGULAR = 0.9
"""Length of the mean of e^(i k alpha) from which on an order is not parted: its variance would be fivefold."""
LEAST_VALUES, LEAST_GEARS = 3, 5
MOUNTINGS_OF_A_SEAT = 6
"""Mountings from which on their own scatter says how eccentric a seat is."""
ASSUMED_FREEDOM = 1e6
"""Degrees of freedom of what is assumed and not estimated."""
_NORMAL_RADIUS = math.sqrt(-2.0 * math.log(0.05))
"""Radius of the 95 % circle of two normal components, in standard deviations of one."""
Way = Literal["parted", "mean"]
Basis = Literal["circle closure", "population mean", "encoder and what the gears share"]


@dataclass(frozen=True, kw_only=True)
class Mounted:
    """What one mounting of a gear shows: orders 1 to 8 of the encoder's revolution (8,) [rad], and the stated angle of
    the gear on the flange [rad], None where nobody stated one. `unseen` (8,) [rad]: how large an order may be that did
    not stand out of the noise and is told as 0.
    """

    gear: str
    angle: float | None
    waves: ComplexArray
    unseen: tuple[float, ...] = (0.0,) * len(CERTIFIED_ORDERS)


@dataclass(frozen=True, kw_only=True)
class LearntOrder:
    """One order of the encoder: its complex amplitude [rad], the standard uncertainty of one component, its degrees of
    freedom, and whether gear and encoder were parted; `gears` is what gears (of one: mountings) differ by.
    """

    order: int
    wave: complex
    standard_uncertainty: float
    degrees_of_freedom: float
    way: Way
    gears: float

    @property
    def radius(self) -> float:
        """U of the complex amplitude [rad]: 95 % of its errors are no longer."""
        factor = 2.0 * float(scipy.special.fdtri(2.0, self.degrees_of_freedom, 0.95))
        return math.sqrt(factor) * self.standard_uncertainty


@dataclass(frozen=True, kw_only=True)
class LearntCurve:
    """The orders 1 to 8 of an encoder, by so many gears in so many mountings."""

    orders: tuple[LearntOrder, ...]
    gears: tuple[str, ...]
    mountings: int

    @property
    def is_parted(self) -> bool:
        """Whether the orders that matter, 1 to 4, are the encoder's alone."""
        return all(one.way == "parted" for one in self.orders[:4])

    @property
    def basis(self) -> Basis:
        """What it rests on, in the words that a certificate bears."""
        if not self.is_parted:
            return "encoder and what the gears share"
        return "circle closure" if len(self.gears) == 1 else "population mean"

    @property
    def expanded_uncertainty(self) -> float:
        """Of the curve at any angle [rad], k = 2: the orders' own, each brought to a normal one of the same circle."""
        u = math.sqrt(sum((one.radius / _NORMAL_RADIUS) ** 2 for one in self.orders))
        return COVERAGE_FACTOR * u

    def certificate(self) -> AngleCertificate:
        """The curve as points of a certificate, from the index mark on."""
        return curve_of(self.waves, self.expanded_uncertainty)

    @property
    def waves(self) -> FloatArray:
        """Cosines and sines of the orders (8, 2) [rad]."""
        return np.array([(one.wave.real, one.wave.imag) for one in self.orders])


def learnt_curve(mounted: Sequence[Mounted], seat: float = 0.0) -> LearntCurve | str:
    """The encoder by these mountings, or in words why they do not tell it.

    `seat` [rad] is the assumed standard uncertainty that an eccentric seat gives a component of order 1: of one gear in
    fewer than six mountings it stands where their own scatter is smaller.
    """
    gears = tuple(dict.fromkeys(one.gear for one in mounted))
    stated = [one for one in mounted if one.angle is not None]
    if len(gears) == 1 and len(stated) < LEAST_VALUES:
        return (
            f"one gear at {len(stated)} stated angles; at least {LEAST_VALUES} are needed, "
            "such as 0, 30, 150 degrees"
        )
    if 1 < len(gears) < LEAST_GEARS and len(stated) < LEAST_VALUES:
        return f"{len(gears)} gears; at least {LEAST_GEARS} are needed, eight are better, at spread stated angles"
    # Where some angles are not stated, only those that are part anything; with too few the mean of all is taken.
    used = stated if len(stated) >= max(LEAST_VALUES, len(mounted) // 2) else list(mounted)
    gears = tuple(dict.fromkeys(one.gear for one in used))
    orders = _orders(used, seat if len(gears) == 1 and len(used) < MOUNTINGS_OF_A_SEAT else 0.0)
    if len(gears) == 1 and not all(one.way == "parted" for one in orders[:4]):
        named = ", ".join(str(one.order) for one in orders if one.way == "mean")
        return f"one gear at these angles leaves the orders {named} singular; 0, 30 and 150 degrees part all of 1 to 8"
    return LearntCurve(orders=orders, gears=gears, mountings=len(used))


def is_parted(order: int, mounted: Sequence[Mounted]) -> bool:
    """Whether stated angles part an order of the encoder from what the gears share."""
    angles = [one.angle for one in mounted if one.angle is not None]
    return len(angles) == len(mounted) and _resultant(order, angles) <= SINGULAR


def _resultant(order: int, angles: Sequence[float]) -> float:
    return abs(sum(cmath.exp(1j * order * angle) for angle in angles)) / len(angles)


def _orders(mounted: Sequence[Mounted], seat: float) -> tuple[LearntOrder, ...]:
    """All orders, those that are not parted with a line for what gears share."""
    found = [_order(k, mounted, seat if k == 1 else 0.0) for k in CERTIFIED_ORDERS]
    sizes = [abs(shared) for one, shared in found if one.way == "parted"]
    share = float(np.median(sizes)) / math.sqrt(2.0) if sizes else 0.0

    def alone(one: LearntOrder) -> LearntOrder:
        if one.way == "parted":
            return one
        u = math.hypot(one.standard_uncertainty, share, one.gears)
        return replace(one, standard_uncertainty=u)

    return tuple(alone(one) for one, _ in found)


def _order(order: int, mounted: Sequence[Mounted], seat: float) -> tuple[LearntOrder, complex]:
    """One order, and what the gears share of it (of one gear: its own)."""
    values = np.array([one.waves[order - 1] for one in mounted])
    angles = [one.angle for one in mounted if one.angle is not None]
    parted = is_parted(order, mounted)
    ones = np.ones(len(values))
    turned = np.exp(1j * order * np.array(angles)) if len(angles) == len(mounted) else ones
    design = np.column_stack([ones, turned] if parted else [ones])
    kernel, gears = _same_gear(mounted, turned), len({one.gear for one in mounted})
    fit = _fitted(values, design.astype(np.complex128), kernel, gears)
    # What no run shows may be the encoder's in all of them: the mean does not make it smaller.
    unseen = 0.5 * sum(one.unseen[order - 1] for one in mounted) / len(mounted)
    u, freedom = fit.standard_uncertainty, fit.freedom
    if seat > fit.between:
        u, freedom = seat * fit.share, ASSUMED_FREEDOM
    learnt = LearntOrder(
        order=order,
        wave=fit.value,
        standard_uncertainty=math.hypot(u, unseen),
        degrees_of_freedom=freedom,
        way="parted" if parted else "mean",
        gears=fit.between,
    )
    return learnt, fit.shared


def _same_gear(mounted: Sequence[Mounted], turned: NDArray[np.generic]) -> ComplexArray | None:
    """What mountings of one gear have in common (n, n), turned with them; None where each is of a gear of its own, or
    all are of one.
    """
    places: dict[str, list[int]] = defaultdict(list)
    for place, one in enumerate(mounted):
        places[one.gear].append(place)
    if len(places) == 1 or len(places) == len(mounted):
        return None
    phase = turned.astype(np.complex128)
    kernel = np.zeros((len(mounted), len(mounted)), dtype=np.complex128)
    for rows in places.values():
        kernel[np.ix_(rows, rows)] = np.outer(phase[rows], phase[rows].conj())
    return kernel


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """The encoder's amplitude and what the gears share, the standard uncertainty of a component of the first, degrees
    of freedom, and the deviation of one component between gears (of one gear: between its mountings); `share` is what
    the encoder has of the latter.
    """

    value: complex
    shared: complex
    standard_uncertainty: float
    freedom: float
    between: float
    share: float = 1.0


def _fitted(
    values: ComplexArray, design: ComplexArray, kernel: ComplexArray | None, gears: int
) -> _Fit:
    """Least squares of independent values; generalised ones where mountings share a gear."""
    count, unknowns = design.shape
    identity = np.eye(count, dtype=np.complex128)
    if kernel is None:
        _, weights, rest = _weighed(values, design, identity)
        variance = rest / max(2 * (count - unknowns), 1)
        own = float((weights[0] @ weights[0].conj()).real)
        return _Fit(
            value=complex(weights[0] @ values),
            shared=complex(weights[-1] @ values),
            standard_uncertainty=math.sqrt(variance * own),
            freedom=float(max(2 * (count - unknowns), 1)),
            between=math.sqrt(variance),
            share=math.sqrt(own),
        )

    def criterion(logarithm: float) -> float:
        whole = identity + math.exp(logarithm) * kernel
        logdet, _, rest = _weighed(values, design, whole)
        return logdet + (count - unknowns) * math.log(max(rest, 1e-300))

    share = math.exp(_least(criterion, -8.0, 14.0))
    _, weights, rest = _weighed(values, design, identity + share * kernel)
    mounting = rest / (2 * (count - unknowns))
    of_mountings = mounting * float((weights[0] @ weights[0].conj()).real)
    of_gears = share * mounting * float((weights[0] @ kernel @ weights[0].conj()).real)
    return _Fit(
        value=complex(weights[0] @ values),
        shared=complex(weights[-1] @ values),
        standard_uncertainty=math.sqrt(of_mountings + of_gears),
        freedom=_satterthwaite(
            (of_mountings, 2.0 * max(count - gears - 1, 1)),
            (of_gears, 2.0 * max(gears - unknowns, 1)),
        ),
        between=math.sqrt(mounting * (1.0 + share)),
    )


def _least(criterion: Callable[[float], float], low: float, high: float) -> float:
    """Where a criterion is least between two ends: the best of a coarse walk, halved until it stands."""
    step = 0.5
    best = min(np.arange(low, high, step).tolist(), key=criterion)
    while step > 1e-3:
        step *= 0.5
        best = min((best - step, best, best + step), key=criterion)
    return float(best)


def _satterthwaite(*parts: tuple[float, float]) -> float:
    """Degrees of freedom of a sum of variances, each with its own (Welch and Satterthwaite)."""
    whole = sum(variance for variance, _ in parts)
    if not whole > 0.0:
        # An order that no run shows: nothing was estimated of it.
        return ASSUMED_FREEDOM
    return whole**2 / sum(variance**2 / freedom for variance, freedom in parts)


def _weighed(
    values: ComplexArray, design: ComplexArray, whole: ComplexArray
) -> tuple[float, ComplexArray, float]:
    """log|V| + log|X' V^-1 X|, the weights (unknowns, n) that give the unknowns, the weighed sum of squares left."""
    inverse = np.linalg.inv(whole)
    normal = design.conj().T @ inverse @ design
    weights = np.linalg.solve(normal, design.conj().T @ inverse)
    left = values - design @ (weights @ values)
    rest = float((left.conj() @ inverse @ left).real)
    logdet = float(np.linalg.slogdet(whole)[1]) + float(np.linalg.slogdet(normal)[1])
    return logdet, weights.astype(np.complex128), rest


def left_out(mounted: Sequence[Mounted], gear: str) -> LearntCurve | str:
    """The encoder by all other gears, for a run of one that taught it; in words where they do not tell it."""
    others = [one for one in mounted if one.gear != gear]
    if len({one.gear for one in others}) < LEAST_GEARS - 1:
        return "too few other gears taught it"
    found = learnt_curve(others)
    if not isinstance(found, str) and not found.is_parted:
        return "the angles of the other gears do not part it from what they share"
    return found
