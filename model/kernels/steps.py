"""Compiled response of the torsional mode to a prescribed input, for the fit of velocity steps.

    theta_o'' = k_s (u - theta_o - b) + stiffening(phi) + g phi' - d + h + k_o (omega_m - theta_o')
    u = theta_i/N + ke
    b' = (p (u - theta_o) - q b) ,   h' = s (1 - h sgn(phi')/H) phi' ,   phi = u - theta_o

b is the torsion of the wave-generator bearing, the only element with damping; stiffening is piecewise
linear in the torsion phi (K1, K2, K3), so that within a piece the step is a matrix exponential with
first-order hold on u. Rows of a step matrix are the states (theta_o, theta_o', b); its columns the states,
u at the start and the end of the step, and a constant acceleration. d is the dry friction of the output's
bearing, which holds an output at rest. h is a Dahl element, taken in the middle of the step. k_o is the gain of
an observer that follows the measured speed omega_m; without it the response runs alone.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from model.arrays import FloatArray, IntArray
from model.kernels.loop_tables import slid

_exact = njit(cache=True, nogil=True, error_model="numpy")
_fast = njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "nnan", "ninf"}
)
_TERMS = 14
"""Of the exponential series at a norm of at most a quarter: what is left out lies below 1e-20."""
_CHUNK = 128
"""Samples whose unit waves are made at once, so that they stay in the cache and all orders advance side by side."""


@_exact
def exponential(matrix: FloatArray) -> FloatArray:
    """exp of a small matrix by its series, halved until that converges and squared again.

    A library's exponential is made for large matrices: its threads wait for each other a hundred times longer than
    the six columns of a step take.
    """
    size = matrix.shape[0]
    norm = 0.0
    for i in range(size):
        norm = max(norm, np.sum(np.abs(matrix[i])))
    halvings = 0
    while norm > 0.25:
        norm *= 0.5
        halvings += 1
    small = matrix * 0.5**halvings
    whole = np.eye(size)
    term, work = np.eye(size), np.empty((size, size))
    for k in range(1, _TERMS):
        _product(term, small, work)
        term[:] = work / k
        whole += term
    for _ in range(halvings):
        _product(whole, whole, work)
        whole[:] = work
    return whole


@_exact
def _product(left: FloatArray, right: FloatArray, out: FloatArray) -> None:
    for i in range(left.shape[0]):
        for j in range(right.shape[1]):
            total = 0.0
            for k in range(left.shape[1]):
                total += left[i, k] * right[k, j]
            out[i, j] = total


@_fast
def error_signal(
    whole: FloatArray,
    slow: FloatArray,
    orders: IntArray,
    bands: IntArray,
    cosine: FloatArray,
    sine: FloatArray,
    ideal: FloatArray,
) -> None:
    """Add sum a cos((n + k/N) theta) + b sin(..) to `ideal` (m,).

    `whole` (n_max + 1, 2, m) and `slow` (k_max + 1, 2, m) are cosine and sine of n theta and k theta/N.
    """
    for j in range(orders.size):
        n, k = orders[j], abs(bands[j])
        turn = 1.0 if bands[j] >= 0 else -1.0
        a, b = cosine[j], sine[j]
        for i in range(ideal.size):
            c, s, d, t = whole[n, 0, i], whole[n, 1, i], slow[k, 0, i], turn * slow[k, 1, i]
            ideal[i] += a * (c * d - s * t) + b * (s * d + c * t)


@_fast
def _forced(
    m: FloatArray, row: int, state: tuple[float, float, float], drive: tuple[float, float, float]
) -> float:
    """A state after a step: by its row of the step matrix from the states, u at both ends, and an acceleration."""
    return (m[row, 0] * state[0] + m[row, 1] * state[1] + m[row, 2] * state[2]) + (
        m[row, 3] * drive[0] + m[row, 4] * drive[1] + m[row, 5] * drive[2]
    )


@_fast
def respond(
    ideal: FloatArray,
    drag: float,
    interval: float,
    step: FloatArray,
    kinks: FloatArray,
    offsets: FloatArray,
    dahl: FloatArray,
    start: FloatArray,
    angle: FloatArray,
    speed: FloatArray,
    piece: IntArray,
    yielding: FloatArray,
    seen: FloatArray,
    observer: float,
    late: float,
) -> None:
    """Output angle and speed on the fine grid (m,), and the piece of the spring in each step.

    `step` (pieces, 3, 6), `kinks` (pieces - 1) torsions at which the next piece begins, `offsets` (pieces) its
    acceleration at zero torsion; `drag`: most that the output's bearing takes, over the inertia; `dahl` (2):
    stiffness over inertia and limit over inertia, 0 for none; `start` theta_o and theta_o' at the first sample.
    `yielding` (m, 2) gets what the Dahl element's force changes by in each step per torsion moved, and what share is
    kept of a force before it. An `observer` above 0 pulls the speed to the measured one, `seen` (m,), which belongs to
    a place `late` steps before: the step matrices know it as well.
    """
    theta, omega, bearing = start[0], start[1], 0.0
    last_kink = kinks.size
    memory, torsion = 0.0, ideal[0] - theta
    for i in range(ideal.size - 1):
        angle[i], speed[i] = theta, omega
        before, after = ideal[i], ideal[i + 1]
        middle = 0.5 * (before + after) - theta - 0.5 * interval * omega
        size = abs(middle)
        r = 0
        while r < last_kink and size > kinks[r]:
            r += 1
        piece[i] = r
        force = offsets[r] if middle > 0.0 else -offsets[r]
        if observer > 0.0:
            place = min(max(i + 0.5 - late, 0.0), ideal.size - 1.001)
            j = int(place)
            force += observer * (seen[j] + (place - j) * (seen[j + 1] - seen[j]))
        if dahl[1] > 0.0:
            moved = middle - torsion
            end = math.copysign(dahl[1], moved)
            kept = slid(dahl[0] * abs(moved) / dahl[1])
            yielding[i, 0] = dahl[0] * kept * math.copysign(1.0, moved) * (end - memory) / dahl[1]
            yielding[i, 1] = kept
            memory = end + (memory - end) * kept
            torsion = middle
            force += memory
        m = step[r]
        state, drive = (theta, omega, bearing), (before, after, force)
        new = _forced(m, 0, state, drive)
        new_omega = _forced(m, 1, state, drive)
        bearing = _forced(m, 2, state, drive)
        if drag > 0.0:
            # The bearing holds an output that it can stop within the step, and drags at one that it can't.
            holding = min(max(new_omega / m[1, 5], -drag), drag)
            new -= holding * m[0, 5]
            new_omega -= holding * m[1, 5]
            bearing -= holding * m[2, 5]
        theta, omega = new, new_omega
    angle[ideal.size - 1], speed[ideal.size - 1] = theta, omega
    piece[ideal.size - 1] = 0


@_fast
def sensitivities(
    whole: FloatArray,
    slow: FloatArray,
    orders: IntArray,
    bands: IntArray,
    interval: float,
    step: FloatArray,
    piece: IntArray,
    place: IntArray,
    share: FloatArray,
    yielding: FloatArray,
    columns: FloatArray,
) -> None:
    """What unit cosines and sines of the kinematic error add to the output at the samples.

    The tangent of `respond` along its own pieces and its Dahl element (`yielding` (m, 2); empty for none): `columns`
    (n, 2 j) gets cosine and sine of each order beside each other. Sample n lies at `share` (0..1) of the fine step
    `place`.
    """
    count, width = piece.size, 2 * orders.size
    has_dahl = yielding.shape[0] > 0
    waves = np.empty((_CHUNK + 1, width))
    theta, omega, bearing = np.empty(width), np.zeros(width), np.zeros(width)
    new, fast = np.empty(width), np.empty(width)
    pull, torsion = np.zeros(width), np.zeros(width)
    sample = 0
    for first in range(0, count - 1, _CHUNK):
        last = min(first + _CHUNK, count - 1)
        _unit_waves(whole, slow, orders, bands, first, last + 1, waves)
        if first == 0:
            theta[:] = waves[0]
        for i in range(first, last):
            before, after, m = waves[i - first], waves[i - first + 1], step[piece[i]]
            for j in range(width):
                new[j] = (m[0, 0] * theta[j] + m[0, 1] * omega[j] + m[0, 2] * bearing[j]) + (
                    m[0, 3] * before[j] + m[0, 4] * after[j]
                )
                fast[j] = (m[1, 0] * theta[j] + m[1, 1] * omega[j] + m[1, 2] * bearing[j]) + (
                    m[1, 3] * before[j] + m[1, 4] * after[j]
                )
                bearing[j] = (m[2, 0] * theta[j] + m[2, 1] * omega[j] + m[2, 2] * bearing[j]) + (
                    m[2, 3] * before[j] + m[2, 4] * after[j]
                )
            if has_dahl:
                for j in range(width):
                    middle = 0.5 * (before[j] + after[j]) - theta[j] - 0.5 * interval * omega[j]
                    pull[j] = yielding[i, 1] * pull[j] + yielding[i, 0] * (middle - torsion[j])
                    torsion[j] = middle
                    new[j] += m[0, 5] * pull[j]
                    fast[j] += m[1, 5] * pull[j]
                    bearing[j] += m[2, 5] * pull[j]
            while sample < place.size and place[sample] == i:
                f = share[sample]
                rise = f * f * (3.0 - 2.0 * f)
                leave = f * (1.0 - f) * (1.0 - f) * interval
                arrive = f * f * (f - 1.0) * interval
                for j in range(width):
                    columns[sample, j] = (
                        theta[j] + rise * (new[j] - theta[j]) + leave * omega[j] + arrive * fast[j]
                    )
                sample += 1
            theta, new = new, theta
            omega, fast = fast, omega


@_fast
def _unit_waves(
    whole: FloatArray,
    slow: FloatArray,
    orders: IntArray,
    bands: IntArray,
    first: int,
    end: int,
    waves: FloatArray,
) -> None:
    """Cosine and sine of each order beside each other in the first rows of `waves` (.., 2 j), of samples first..end."""
    for j in range(orders.size):
        n, k = orders[j], abs(bands[j])
        turn = 1.0 if bands[j] >= 0 else -1.0
        for i in range(first, end):
            c, s, d, t = whole[n, 0, i], whole[n, 1, i], slow[k, 0, i], turn * slow[k, 1, i]
            waves[i - first, 2 * j] = c * d - s * t
            waves[i - first, 2 * j + 1] = s * d + c * t


@_fast
def sampled(
    angle: FloatArray,
    speed: FloatArray,
    interval: float,
    place: IntArray,
    share: FloatArray,
    values: FloatArray,
) -> None:
    """Cubic Hermite interpolation of a response at the samples (n,)."""
    for k in range(place.size):
        i, f = place[k], share[k]
        values[k] = (
            angle[i]
            + f * f * (3.0 - 2.0 * f) * (angle[i + 1] - angle[i])
            + f * (1.0 - f) * (1.0 - f) * interval * speed[i]
            + f * f * (f - 1.0) * interval * speed[i + 1]
        )
