"""Speed and acceleration from counted angles: local polynomials whose width follows from the size of a count.

Differencing an 18-arcsecond count at 1 kHz is noise. A polynomial of third degree fitted around
each sample (Savitzky and Golay 1964) has the noise of a slope over its whole window instead. The
window is the widest one over which the polynomial still describes the motion to within the noise of
counting (discrepancy principle: the residual may not exceed q/sqrt(12) by more than a tenth), so
that it is wide at slow steady speed and narrow in a transient that is worth many counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import ArrayLike

from model.errors import IdentificationError
from model.identify.checks import Array, channels, increasing, positive

DEGREE = 3
SHORTEST, LONGEST = 7, 401
_EXCESS = 1.1
_EDGE_DENSITY = 0.25
"""Counts per sample below which only the instants of a changing count are used."""


@dataclass(frozen=True, kw_only=True)
class CountedMotion:
    """A counted angle, smoothed and differentiated on its own time stamps: arrays of shape (n,), SI.

    window: width of the polynomials [s]; from_edges: whether only the instants at which the count changed were used.
    """

    time: Array
    angle: Array
    speed: Array
    acceleration: Array
    window: float
    from_edges: bool


def _count_edges(time: ArrayLike, angle: ArrayLike, quantum: float) -> tuple[Array, Array]:
    """Instants and angles at which the count changed: midpoints in time and angle, where the angle is known best.

    Runs of samples without a change are left out, except the first and the last sample.
    """
    clock, theta = channels(2, time=increasing("time", time), angle=angle)
    positive("quantum", quantum)
    at = np.flatnonzero(np.abs(np.diff(theta)) > 0.5 * quantum)
    if at.size < 2:
        raise IdentificationError(
            "has fewer than two changes of its count", where="angle", value=at.size, limit=">= 2"
        )
    return 0.5 * (clock[at] + clock[at + 1]), 0.5 * (theta[at] + theta[at + 1])


def speed_from_counts(
    time: ArrayLike,
    angle: ArrayLike,
    quantum: float,
    *,
    window: float | None = None,
    longest: float = 0.2,
) -> CountedMotion:
    """Angle, speed and acceleration of a counted angle [rad] at its time stamps [s], shape (n,).

    `quantum`: one count [rad]. `window` [s] fixes the width of the polynomials; by default it is
    chosen, up to `longest`. Slow motion (less than a quarter count per sample throughout) is taken
    from the instants at which the count changed. Time must be the stamps of the samples, not index
    times period; they may be uneven.
    """
    clock, theta = channels(
        SHORTEST + 2, time=increasing("time", time, minimum=SHORTEST + 2), angle=angle
    )
    positive("quantum", quantum)
    period = float(np.median(np.diff(clock)))
    even, values, sigma, from_edges = _evened(clock, theta, quantum, period)
    if window is None:
        width = _chosen_width(values, sigma, period, longest)
    else:
        width = _odd(window / period)
    samples = len(even)
    width = min(width, _odd(samples - 1))
    if width <= DEGREE + 1:
        raise IdentificationError(
            "is shorter than one window", where="time", value=samples, limit=f">= {SHORTEST}"
        )
    smooth: list[Array] = [
        scipy.signal.savgol_filter(values, width, DEGREE, deriv=order, delta=period, mode="interp")
        for order in (0, 1, 2)
    ]
    back = [np.interp(clock, even, part) for part in smooth]
    return CountedMotion(
        time=clock,
        angle=back[0],
        speed=back[1],
        acceleration=back[2],
        window=width * period,
        from_edges=from_edges,
    )


def _evened(
    clock: Array, theta: Array, quantum: float, period: float
) -> tuple[Array, Array, float, bool]:
    """An even time axis, the angle on it, the noise of counting in that, and whether it is by the counts' edges."""
    even: Array = np.arange(clock[0], clock[-1] + 0.5 * period, period)
    steps = np.abs(np.diff(theta))
    changes = steps > 0.5 * quantum
    slow = float(steps.max()) <= 1.5 * quantum and float(np.mean(changes)) < _EDGE_DENSITY
    if not slow or np.count_nonzero(changes) < 8:
        return even, np.interp(even, clock, theta), quantum / math.sqrt(12.0), False
    stamps, edges = _count_edges(clock, theta, quantum)
    return even, np.interp(even, stamps, edges), quantum / math.sqrt(24.0), True


def _odd(samples: float) -> int:
    return max(2 * int(samples // 2) + 1, SHORTEST)


def _chosen_width(values: Array, noise: float, period: float, longest: float) -> int:
    """The widest window whose polynomial leaves no more than the noise of counting, anywhere."""
    top = min(LONGEST, _odd(longest / period), _odd(len(values) // 2))
    chosen = SHORTEST
    width = SHORTEST
    while width <= top:
        left: Array = values - scipy.signal.savgol_filter(values, width, DEGREE, mode="interp")
        local = np.sqrt(np.convolve(left**2, np.full(width, 1.0 / width), mode="valid"))
        if (
            np.max(local) > _EXCESS * noise * math.sqrt(2.0)
            or np.sqrt(np.mean(left**2)) > _EXCESS * noise
        ):
            break
        chosen = width
        width = _odd(width * 1.25 + 1)
    return chosen
