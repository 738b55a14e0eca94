"""Gain of a torque reading from ramps with known inertias on a bare shaft.

Over whole revolutions of a ramp the mean torque shown, by angle, is

    T = g (J_r + J_k) a + T_0 + sign(w) T_c + c w,    a = (w_2^2 - w_1^2)/(2 (theta_2 - theta_1)),

g the gain, J_r the rotor's inertia, J_k the disc's; what repeats every revolution (cogging) does no work over it, and
friction is the same on a ramp up and the ramp down through the same speeds. One run gives S_k = g (J_r + J_k); two
inertias give g as the slope of S_k over J_k, whatever J_r is. A port that lags by t shows S_k less by c t, which is the
same for every disc: J_r takes it, g does not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model.arrays import FloatArray
from model.errors import IdentificationError
from model.identify.least_squares import LinearFit, solve
from model.units import REVOLUTION

SPEED_ROWS = 8
"""Rows to either side over which a speed is taken, so that counts do not show."""


@dataclass(frozen=True, kw_only=True)
class RampMean:
    """Means over whole revolutions of one ramp: acceleration [rad/s2], speed [rad/s], its duration [s], and the mean
    torque of each channel [N m] by angle."""

    acceleration: float
    speed: float
    duration: float
    torques: tuple[float, ...]


def speed_at(time: FloatArray, angle: FloatArray, row: int) -> float:
    """Speed [rad/s] at a row, by a parabola through the rows about it."""
    part = slice(row - SPEED_ROWS, row + SPEED_ROWS + 1)
    away, turned = time[part] - float(time[row]), angle[part] - float(angle[row])
    return float(np.polynomial.Polynomial.fit(away, turned, 2).deriv()(0.0))


def whole_turns(time: FloatArray, angle: FloatArray, edge: float) -> int:
    """How many whole revolutions lie `edge` [s] within both ends of a ramp; 0 where it has too few rows."""
    first, last = _inside(time, edge)
    if last - first < 2 * SPEED_ROWS:
        return 0
    return math.floor(abs(float(angle[last] - angle[first])) / REVOLUTION)


def _inside(time: FloatArray, edge: float) -> tuple[int, int]:
    """The first and the last row `edge` [s] within both ends at which a speed can be told."""
    first = int(np.searchsorted(time, float(time[0]) + edge))
    last = int(np.searchsorted(time, float(time[-1]) - edge)) - 1
    return max(first, SPEED_ROWS), min(last, len(time) - SPEED_ROWS - 1)


def mean_of_ramp(
    time: FloatArray, angle: FloatArray, torques: Sequence[FloatArray], edge: float, turns: int
) -> RampMean:
    """Means over so many whole revolutions `edge` [s] within both ends of a ramp, from its slow end on: ramps up and
    down with as many of them go through the same speeds.
    """
    first, last = _inside(time, edge)
    turned = (angle - angle[first]) * math.copysign(1.0, angle[last] - angle[first])
    if speed_at(time, angle, first) ** 2 < speed_at(time, angle, last) ** 2:
        last = int(np.argmin(np.abs(turned - turns * REVOLUTION)))
    else:
        first = int(np.argmin(np.abs(turned - turned[last] + turns * REVOLUTION)))
    rows = slice(first, last + 1)
    travel = float(angle[last] - angle[first])
    begin, end = speed_at(time, angle, first), speed_at(time, angle, last)
    return RampMean(
        acceleration=(end**2 - begin**2) / (2.0 * travel),
        speed=travel / float(time[last] - time[first]),
        duration=float(time[last] - time[first]),
        torques=tuple(float(np.trapezoid(t[rows], angle[rows])) / travel for t in torques),
    )


def shown_inertia(pairs: Sequence[tuple[RampMean, RampMean]], channel: int) -> LinearFit:
    """S = g J [kg m2] from pairs of ramps of opposite sense.

    Each pair goes through the same speeds the one way round, one right after the other: friction, zero and what drifts
    fall out of its difference.
    """
    design = np.array([[a.acceleration - b.acceleration] for a, b in pairs])
    torque = np.array([a.torques[channel] - b.torques[channel] for a, b in pairs])
    return solve(design, torque, block_starts=np.arange(float(len(pairs))), where="ramps")


def lag_of(time: FloatArray, angle: FloatArray, torque: FloatArray, ramp: slice) -> float:
    """By how much a torque (n,) is later than the acceleration that it makes [s], over the rows `ramp` of a ramp
    between two holds, which tell the friction at its ends.

    A linear channel of any form moves the centroid of what passes it by its mean delay:
    int t (T - T_f) dt/int (T - T_f) dt - int t dw/int dw.
    """
    speed = np.gradient(angle, time)
    first, last = ramp.start - SPEED_ROWS, (ramp.stop + len(time)) // 2
    before, after = slice(ramp.start // 2, first), slice(last, len(time))
    if before.stop - before.start < SPEED_ROWS or after.stop - after.start < SPEED_ROWS:
        return math.nan
    speed = np.gradient(angle, time)
    slow, fast = float(speed[before].mean()), float(speed[after].mean())
    low, high = float(torque[before].mean()), float(torque[after].mean())
    friction = low + (high - low) * (speed - slow) / (fast - slow)
    t, effort = time[first:] - time[first], (torque - friction)[first:]
    # Over all ends within the second hold, so that no error of the encoder's turn passes for a speed.
    end = slice(last - first, len(t))
    moved = (speed[first:] * t - (angle[first:] - angle[first]))[end]
    pushed = _integral(t * effort, t)[end]
    push = _integral(effort, t)[end]
    return float(pushed.mean() / push.mean() - moved.mean() / (fast - slow))


def _integral(values: FloatArray, time: FloatArray) -> FloatArray:
    """The integral from the first row to each (n,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])


@dataclass(frozen=True, kw_only=True)
class ShownInertia:
    """What one run shows: S [kg m2], its standard error and degrees of freedom, S at each level of acceleration (m,),
    and the inertia of its disc [kg m2]. Runs of one `disc` share its error.
    """

    disc: str
    inertia: float
    inertia_uncertainty: float
    shown: float
    standard_error: float
    degrees_of_freedom: float
    levels: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Gain:
    """The slope of what is shown over the inertia, the rotor's own inertia [kg m2], and what is not known of the slope:
    scatter with its degrees of freedom, the inertia of each disc by its name, linearity.
    """

    gain: float
    rotor_inertia: float
    scatter: float
    degrees_of_freedom: float
    inertias: Mapping[str, float]
    linearity: float


def gain_of(runs: Sequence[ShownInertia]) -> Gain:
    """The gain by runs with at least two inertias. Raises `IdentificationError` where they are one."""
    inertia = np.array([run.inertia for run in runs])
    if len(runs) < 2 or not np.ptp(inertia) > 0.0:
        raise IdentificationError(
            "the gain needs two inertias",
            where="runs",
            value=", ".join(f"{one:.4g} kg m2" for one in sorted(set(inertia.tolist()))),
            limit="two different ones",
            remedy="Run once with the disc and once without.",
        )
    error = np.array([run.standard_error for run in runs])
    away = inertia - np.average(inertia, weights=error**-2)
    share = away / error**2
    share = share / float(share @ inertia)
    shown = np.array([run.shown for run in runs])
    gain = float(share @ shown)
    parts = (share * error) ** 2
    freedom = np.array([run.degrees_of_freedom for run in runs])
    scatter = math.sqrt(float(parts.sum()))
    counted = scatter**4 / float((parts**2 / freedom).sum())
    if len(runs) > 2:
        rotor = float(np.average(shown - gain * inertia, weights=error**-2))
        missed = float((((shown - gain * inertia - rotor) / error) ** 2).sum()) / (len(runs) - 2)
        if missed > 1.0:
            scatter, counted = scatter * math.sqrt(missed), len(runs) - 2.0
    of_disc: dict[str, float] = {}
    for k, run in enumerate(runs):
        of_disc[run.disc] = of_disc.get(run.disc, 0.0) + share[k] * run.inertia_uncertainty
    levels = share @ np.array([run.levels for run in runs])
    own = math.nan
    if gain > 0.0:  # else the disc shows nothing, and neither does the rotor
        own = float(np.average(shown / gain - inertia, weights=error**-2))
    return Gain(
        gain=gain,
        rotor_inertia=own,
        scatter=scatter,
        degrees_of_freedom=counted,
        inertias={disc: abs(gain * moved) for disc, moved in of_disc.items()},
        linearity=float(np.ptp(levels)) / (2.0 * math.sqrt(3.0)),
    )
