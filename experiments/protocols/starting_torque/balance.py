"""What all ramps say together: friction, asymmetry, their scatter; and whether they are of one thing at all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.errors import AnalysisError
from experiments.protocols.starting_torque.breakaway import Breakaway
from model.arrays import FloatArray
from model.units import DEGREE

LARGEST_CONDITION = 3.0
"""Of the patterns beside the mean: above it an error of the one would become one of the other."""
HIGHEST_ORDER = 6
"""Orders of the input that are told from scatter, where there are positions enough."""
_FAR = 6.0
"""Standard deviations of the others by which a ramp may be away from them."""
NEAR_SHARE, FAR_SHARE = 0.15, 0.35
"""Shares of the middle torque within which a ramp is never refused, and beyond which it always is: friction over the
angle differs by less, and a motor's cogging is not in the half-difference of the directions."""
_LARGEST_ASYMMETRY = 0.25
"""Half-sum of the directions over their half-difference from which on they are not of one gear."""
_AGAIN = "Look at that ramp for stray rows, a slipping coupling or something that rubs; then run it again."


@dataclass(frozen=True, kw_only=True)
class Balance:
    """What all ramps say together [N m]: friction, which has the sign of the direction, and
    asymmetry, which has not; the standard error of both, its degrees of freedom, the scatter of one ramp.

    `direction` is 0; where only one direction is there, it is that one, and the asymmetry is in the friction.
    """

    friction: float
    asymmetry: float
    error: float
    freedom: float
    scatter: float
    direction: int = 0


def balanced(ramps: list[Breakaway], run: str) -> Balance:
    """Friction and asymmetry: half-difference and half-sum of the directions, in the mean over the positions.

    A pattern over the angle is no scatter: over evenly spread positions it cancels in the mean. That
    of the friction stands in the half-differences, so scatter is taken from the half-sums, in which
    the low orders of the cogging are fitted.
    """
    pairs = pairs_of(ramps)
    if not pairs:
        return _one_direction(ramps, run)
    friction, asymmetry = (
        np.array([0.5 * (a.torque + sign * b.torque) for a, b in pairs]) for sign in (-1.0, 1.0)
    )
    _refuse_disagreeing([a for a, _ in pairs], friction, run)
    design = _waves(np.array([a.angle for a, _ in pairs]))
    freedom = _freedom(len(pairs), design.shape[1], run)
    values, _, _, _ = np.linalg.lstsq(design, asymmetry)
    residual = asymmetry - design @ values
    variance = float(residual @ residual) / freedom
    whole, half_sum = float(friction.mean()), float(asymmetry.mean())
    _refuse_asymmetric(whole, half_sum, run)
    return Balance(
        friction=whole,
        asymmetry=half_sum,
        error=math.sqrt(variance / len(pairs)),
        freedom=float(freedom),
        scatter=math.sqrt(2.0 * variance),
    )


def _one_direction(ramps: list[Breakaway], run: str) -> Balance:
    """The mean of what moved in one direction alone: there a pattern and scatter are not told apart."""
    direction = ramps[0].direction
    own = [b for b in ramps if b.direction == direction]
    torque = np.array([direction * b.torque for b in own])
    _refuse_disagreeing(own, torque, run)
    freedom = _freedom(len(torque), 1, run)
    scatter = float(torque.std(ddof=1))
    return Balance(
        friction=float(torque.mean()),
        asymmetry=0.0,
        error=scatter / math.sqrt(len(torque)),
        freedom=float(freedom),
        scatter=scatter,
        direction=direction,
    )


def pairs_of(ramps: list[Breakaway]) -> list[tuple[Breakaway, Breakaway]]:
    """Ramps of both directions at one position."""
    reverse = {(b.position, b.repeat): b for b in ramps if b.direction < 0}
    return [
        (b, reverse[b.position, b.repeat])
        for b in ramps
        if b.direction > 0 and (b.position, b.repeat) in reverse
    ]


def _refuse_disagreeing(places: list[Breakaway], torque: FloatArray, run: str) -> None:
    """Refuse ramps of which one is away from the others by more than their scatter: it did not measure what they did.

    `torque`: by place, along the motion [N m].
    """
    middle = float(np.median(torque))
    away = np.abs(torque - middle)
    spread = _FAR * 1.4826 * float(np.median(away))
    allowed = min(max(spread, NEAR_SHARE * abs(middle)), FAR_SHARE * abs(middle))
    worst = int(np.argmax(away))
    if middle > 0.0 and away[worst] <= allowed:
        return
    raise AnalysisError(
        "the ramps disagree by more than their scatter",
        where=f"{run}, position {places[worst].position / DEGREE:.0f} deg",
        value=f"{1e3 * float(torque[worst]):.3g} mN m",
        limit=f"{1e3 * middle:.3g} ± {1e3 * allowed:.2g} mN m, as the others",
        remedy=_AGAIN,
    )


def _refuse_asymmetric(friction: float, asymmetry: float, run: str) -> None:
    """Refuse directions that are too far apart to be of one gear and one zero."""
    if abs(asymmetry) <= _LARGEST_ASYMMETRY * abs(friction):
        return
    raise AnalysisError(
        "the directions disagree: the half-sum of their torques is no small part of the half-difference",
        where=run,
        value=f"{1e3 * asymmetry:.3g} mN m beside {1e3 * friction:.3g} mN m",
        limit=f"<= {100.0 * _LARGEST_ASYMMETRY:g} %",
        remedy="Read the torque zero with the servo off, look at the scale of both signs; then run it again.",
    )


def _freedom(count: int, parameters: int, run: str) -> int:
    if count <= parameters:
        raise AnalysisError(
            "too few ramps moved the input to tell their scatter",
            where=run,
            value=f"{count} positions",
            limit=f">= {parameters + 1}",
            remedy="Raise the limit of the ramp, or take more positions.",
        )
    return count - parameters


def _waves(angle: FloatArray) -> FloatArray:
    """Columns 1, cos n x, sin n x (n, p) of as many orders as the positions tell from the mean."""
    highest = min(HIGHEST_ORDER, max(0, (len(angle) - 5) // 3))
    one = np.ones((len(angle), 1))
    orders = np.arange(1, highest + 1)
    phase = angle[:, None] * orders
    design = np.hstack([one, math.sqrt(2.0) * np.cos(phase), math.sqrt(2.0) * np.sin(phase)])
    return design if np.linalg.cond(design) <= LARGEST_CONDITION else one
