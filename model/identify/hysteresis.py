"""Loops of torque over torsion angle: stiffness, loss, lost motion, each loop by itself and over all of them.

    loss               W = closed integral of T d(phi) [J]
    hysteresis loss    width of the loop at T = 0 [rad]
    lost motion        phi_m(+T) - phi_m(-T) at a stated torque T, phi_m the middle between the branches [rad]
    secant stiffness   (T_max - T_min) / (phi(T_max) - phi(T_min)) [N m/rad]
    branch stiffness   slope dT/d(phi) of the loading branches beyond half the amplitude [N m/rad]

A branch goes from one reversal of the torque to the next; a loop is a branch up with the branch down
after it. Branches that do not cover most of the range (the first loading, a swing that was cut off)
are no part of a loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.errors import IdentificationError
from model.identify.checks import Array, channels
from model.identify.estimate import BudgetLine, Estimate
from model.identify.least_squares import student_quantile
from model.identify.orders.turning import DeadZone, runs_of

_WHOLE_BRANCH = 0.8
"""Of the range of the torque that a branch must cover."""
_LOADING = 0.5
"""Of the amplitude, beyond which the slope of a loading branch is taken."""
NEAR = 0.1
"""Of the amplitude to each side of a torque, over which the angle there is fitted."""
_TIP = 0.06
"""Of a branch, to each side of where it turns, over which the tip is fitted."""
LEAST_ROWS = 40
NAMES = ("branch_stiffness", "secant_stiffness", "loss", "hysteresis_loss", "lost_motion")
UNITS = ("N m/rad", "N m/rad", "J", "rad", "rad")


@dataclass(frozen=True)
class Loop:
    """One loop: its rows of the branch up and of the branch down, and its numbers by `NAMES`."""

    up: slice
    down: slice
    numbers: tuple[float, ...]


@dataclass(frozen=True)
class HysteresisFit:
    """The loops, the estimates over them, the torque of the lost motion [N m] and the amplitude of the loops [N m]."""

    loops: tuple[Loop, ...]
    estimates: dict[str, Estimate]
    torque: float
    amplitude: float


def fit_hysteresis(angle: Array, torque: Array, at_torque: float | None = None) -> HysteresisFit:
    """Stiffness, loss and lost motion from torsion angle [rad] and torque [N m] (n,), in the order recorded.

    `at_torque` [N m] is that of the lost motion; 4 % of the amplitude where none is given. Raises
    `IdentificationError` where the torque makes no loop.
    """
    phi, tau = channels(LEAST_ROWS, angle=angle, torque=torque)
    up, down = _branches(tau)
    amplitude = 0.5 * float(np.percentile(tau, 99.5) - np.percentile(tau, 0.5))
    middle = 0.5 * float(np.percentile(tau, 99.5) + np.percentile(tau, 0.5))
    level = 0.04 * amplitude if at_torque is None else at_torque
    if not 0.0 < level < 0.9 * (amplitude - abs(middle)):
        raise IdentificationError(
            "lies outside the loops",
            where="at_torque",
            value=f"{level:.4g} N m",
            limit=f"above 0 and below {0.9 * (amplitude - abs(middle)):.4g} N m",
            remedy="Swing the torque to both sides of zero, beyond the torque of the lost motion.",
        )
    loops = [Loop(a, b, _numbers(phi, tau, a, b, level, amplitude)) for a, b in _pairs(up, down)]
    if not loops:
        raise IdentificationError(
            "makes no whole loop",
            where="torque",
            value=f"{len(up)} branches up, {len(down)} down over {_WHOLE_BRANCH:.0%} of the range",
            limit="a branch up with a branch down after it",
            remedy="Swing the torque slowly between two equal limits, several times.",
        )
    table = np.array([loop.numbers for loop in loops])
    if table[:, 1].mean() <= 0.0:
        raise IdentificationError(
            "falls as the torsion grows: one of the two has the wrong sign",
            where="torque",
            value=f"{table[:, 1].mean():.4g} N m/rad between the tips",
            limit="above zero",
            remedy="Import the torque or the angle with the other sign.",
        )
    estimates = {
        name: _estimate(name, unit, table[:, k])
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
    }
    return HysteresisFit(tuple(loops), estimates, level, amplitude)


def _branches(torque: Array) -> tuple[list[slice], list[slice]]:
    """Rows of the branches up and down that cover most of the range."""
    zone = DeadZone.of([torque])
    runs = _joined(runs_of([zone.ways(torque)]))
    lowest, highest = np.percentile(torque, [0.5, 99.5])
    least = _WHOLE_BRANCH * float(highest - lowest)
    whole = [(a, b, way) for a, b, way in runs if abs(torque[b - 1] - torque[a]) >= least]
    up = [slice(a, b) for a, b, way in whole if way > 0]
    down = [slice(a, b) for a, b, way in whole if way < 0]
    return up, down


def _joined(runs: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Runs of one way that follow each other are one: noise had stopped them for a moment."""
    joined: list[tuple[int, int, int]] = []
    for start, stop, way in runs:
        if joined and joined[-1][2] == way:
            joined[-1] = (joined[-1][0], stop, way)
        else:
            joined.append((start, stop, way))
    return joined


def _pairs(up: list[slice], down: list[slice]) -> list[tuple[slice, slice]]:
    """Each branch up with the branch down right after it."""
    pairs: list[tuple[slice, slice]] = []
    for one in up:
        after = [other for other in down if other.start >= one.stop - 1]
        following = [other for other in up if other.start > one.start]
        if after and (not following or after[0].start < following[0].start):
            pairs.append((one, after[0]))
    return pairs


def _numbers(
    angle: Array, torque: Array, up: slice, down: slice, level: float, amplitude: float
) -> tuple[float, ...]:
    """The numbers of one loop by `NAMES`."""
    # What turns round moves too little to be of a branch: half of it belongs to each side.
    turning = max(down.start - up.stop, 0) // 2
    first, last = max(up.start - turning, 0), min(down.stop + turning, len(angle))
    # The loop begins and ends where the angle is least, however long it rested there.
    first += int(np.argmin(angle[first : up.start + 1]))
    last = down.stop - 1 + int(np.argmin(angle[down.stop - 1 : last]))
    phi = np.append(angle[first : last + 1], angle[first])
    tau = np.append(torque[first : last + 1], torque[first])
    loss = abs(float(np.sum(0.5 * (tau[1:] + tau[:-1]) * np.diff(phi))))
    top = _tip(angle, torque, up, up.stop + turning)
    bottom = _tip(angle, torque, down, down.stop + turning)
    secant = (top[1] - bottom[1]) / (top[0] - bottom[0])
    centre = 0.5 * float(torque[up].max() + torque[down].min())
    slopes = [
        _slope(angle[rows], torque[rows], way * (torque[rows] - centre) > _LOADING * amplitude)
        for rows, way in ((up, 1.0), (down, -1.0))
    ]
    width = abs(
        _angle_at(angle[down], torque[down], 0.0, amplitude)
        - _angle_at(angle[up], torque[up], 0.0, amplitude)
    )
    middles = [
        0.5
        * (
            _angle_at(angle[up], torque[up], at, amplitude)
            + _angle_at(angle[down], torque[down], at, amplitude)
        )
        for at in (level, -level)
    ]
    return 0.5 * sum(slopes), secant, loss, width, middles[0] - middles[1]


def _tip(angle: Array, torque: Array, branch: slice, row: int) -> tuple[float, float]:
    """Angle and torque of the tip that a branch ends in, about a row: no extreme of noise.

    The angle turns smoothly, by a parabola; the torque is that of the branch there, which unloading leaves at once.
    """
    begin, stop = int(branch.start), int(branch.stop)
    half = max(round(_TIP * (stop - begin)), 4)
    first, last = max(row - half, 0), min(row + half, len(angle) - 1)
    x: Array = (np.arange(first, last + 1, dtype=np.float64) - row) / half
    fitted = _parabola(x, angle[first : last + 1])
    middle = float(np.clip(-0.5 * fitted[1] / fitted[2], float(x[0]), float(x[-1])))
    place = float(np.polynomial.polynomial.polyval(middle, fitted))
    end = slice(max(stop - 4 * half, begin), stop)
    off = angle[end] - place
    line = np.polynomial.polynomial.polyfit(off, torque[end], 1)
    return place, float(line[0])


def _parabola(x: Array, y: Array) -> Array:
    """Coefficients (3,) of a parabola, the constant first."""
    return np.asarray(np.polynomial.polynomial.polyfit(x, y, 2), dtype=float)


def _angle_at(angle: Array, torque: Array, at: float, amplitude: float) -> float:
    """The angle of a branch at a torque, by a parabola through what is near."""
    near = np.abs(torque - at) <= NEAR * amplitude
    if near.sum() < 4:
        near = np.argsort(np.abs(torque - at))[:4]
    x = (torque[near] - at) / amplitude
    degree = 2 if len(x) >= 8 else 1
    return float(np.polynomial.polynomial.polyfit(x, angle[near], degree)[0])


def _slope(angle: Array, torque: Array, chosen: np.ndarray) -> float:
    """dT/d(phi) over some rows of a branch: torque by least squares over angle."""
    phi, tau = angle[chosen], torque[chosen]
    phi = phi - phi.mean()
    return float(phi @ (tau - tau.mean()) / (phi @ phi))


def _estimate(name: str, unit: str, values: Array) -> Estimate:
    """The mean over the loops with their scatter; one loop has none and is told so."""
    mean, n = float(values.mean()), len(values)
    if n < 2:
        note = "one loop: no scatter, and so no uncertainty"
        return Estimate.about(name, mean, math.nan, unit, identifiable="no", note=note)
    error = float(values.std(ddof=1)) / math.sqrt(n)
    half = student_quantile(n - 1.0) * error
    line = BudgetLine("scatter between loops", "A", error, degrees_of_freedom=n - 1.0)
    return Estimate.about(name, mean, half, unit, (line,))
