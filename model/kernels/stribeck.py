"""The compiled chi-square of the friction curve (equation 19), and its descent in Stribeck velocity and shape."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from model.arrays import FloatArray, IntArray

_compiled = njit(cache=True, nogil=True)

FREE, FIXED_COULOMB, FIXED_STATIC, FIXED_VISCOUS = 0, 1, 2, 3
"""Which linear parameter of the Stribeck curve a profile holds."""


@_compiled
def _solve_masked(
    g00: float,
    g01: float,
    g02: float,
    g11: float,
    g12: float,
    g22: float,
    r0: float,
    r1: float,
    r2: float,
    u0: float,
    u1: float,
    u2: float,
) -> tuple[float, float, float]:
    """Solve a symmetric 3 x 3 system in the unknowns whose mask is 1; the others are 0. NaN where it is singular."""
    a = u0 * g00 + 1.0 - u0
    b = u0 * u1 * g01 / a
    c = u0 * u2 * g02 / a
    d = u1 * g11 + 1.0 - u1 - b * b * a
    if d <= 1e-13 * g11:
        return np.nan, np.nan, np.nan
    e = (u1 * u2 * g12 - b * c * a) / d
    f = u2 * g22 + 1.0 - u2 - c * c * a - e * e * d
    if f <= 1e-13 * g22:
        return np.nan, np.nan, np.nan
    y0 = u0 * r0
    y1 = u1 * r1 - b * y0
    y2 = u2 * r2 - c * y0 - e * y1
    x2 = y2 / f
    x1 = y1 / d - e * x2
    return y0 / a - b * x1 - c * x2, x1, x2


@_compiled
def stribeck_inner(
    speed: FloatArray,
    white: FloatArray,
    whitening: FloatArray,
    velocity: float,
    shape: float,
    mode: int,
    fixed: float,
    parameters: FloatArray,
    residual: FloatArray,
) -> float:
    """Chi-square of the Stribeck curve (equation 19) with its linear parameters at their best non-negative values.

    `whitening` (n, n) is lower triangular, W with W' W the inverse covariance of the forces; `white`
    (3, n) holds W f, W 1 and W v. parameters receives F_c, F_s, c_v; residual the whitened residuals.
    """
    n = len(speed)
    g00, g01, g02, g11, g12, g22, r0, r1, r2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    held_0 = fixed if mode == FIXED_COULOMB else 0.0
    held_1 = fixed if mode == FIXED_STATIC else 0.0
    held_2 = fixed if mode == FIXED_VISCOUS else 0.0
    decay = np.empty(n)
    for i in range(n):
        decay[i] = math.exp(-((speed[i] / velocity) ** shape))
    for i in range(n):
        c1 = 0.0
        for j in range(i + 1):
            c1 += whitening[i, j] * decay[j]
        c0, c2 = white[1, i] - c1, white[2, i]
        y = white[0, i] - held_0 * c0 - held_1 * c1 - held_2 * c2
        residual[i] = c1
        g00 += c0 * c0
        g01 += c0 * c1
        g02 += c0 * c2
        g11 += c1 * c1
        g12 += c1 * c2
        g22 += c2 * c2
        r0 += c0 * y
        r1 += c1 * y
        r2 += c2 * y
    free = 7 - (1 << (mode - 1)) if mode > 0 else 7
    b0, b1, b2, lowest = 0.0, 0.0, 0.0, 0.0
    for code in range(7, 0, -1):
        if code & free != code:
            continue
        u0, u1, u2 = float(code & 1), float((code >> 1) & 1), float((code >> 2) & 1)
        x0, x1, x2 = _solve_masked(g00, g01, g02, g11, g12, g22, r0, r1, r2, u0, u1, u2)
        if x0 >= 0.0 and x1 >= 0.0 and x2 >= 0.0:
            gain = x0 * r0 + x1 * r1 + x2 * r2
            if gain > lowest:
                b0, b1, b2, lowest = x0, x1, x2, gain
            if code == free:
                break
    coulomb, static, viscous = b0 + held_0, b1 + held_1, b2 + held_2
    total = 0.0
    for i in range(n):
        r = white[0, i] - coulomb * (white[1, i] - residual[i]) - viscous * white[2, i]
        r -= static * residual[i]
        residual[i] = r
        total += r * r
    parameters[0], parameters[1], parameters[2] = coulomb, static, viscous
    return total


@_compiled
def _copy_into(target: FloatArray, source: FloatArray) -> None:
    """target[:] = source, which compiles twenty times faster when it is written as a loop."""
    for i in range(len(target)):
        target[i] = source[i]


@_compiled
def stribeck_descend(
    speed: FloatArray,
    white: FloatArray,
    whitening: FloatArray,
    start: FloatArray,
    hold: IntArray,
    mode: int,
    fixed: float,
    bounds: FloatArray,
    iterations: int,
    parameters: FloatArray,
) -> float:
    """Levenberg-Marquardt in (log v_s, log sigma) on the projected residual; `hold` fixes one of them.

    start (2,) is changed in place to the optimum; bounds (2, 2) in log. Returns chi-square.
    """
    n = len(speed)
    residual, moved, slopes = np.empty(n), np.empty(n), np.zeros((2, n))
    trial_parameters, trial = np.zeros(3), np.empty(2)
    _copy_into(trial, start)
    a, b, c, g, e = 0.0, 0.0, 0.0, 0.0, 0.0
    chi, damping, h = np.inf, 1e-3, 1e-5
    phase, rounds, tries = 0, 0, 0
    while rounds < iterations:
        velocity, shape = math.exp(trial[0]), math.exp(trial[1])
        trial_chi = stribeck_inner(
            speed, white, whitening, velocity, shape, mode, fixed, trial_parameters, moved
        )
        if phase == 0:
            chi = trial_chi
            _copy_into(residual, moved)
            _copy_into(parameters, trial_parameters)
        elif phase <= 2:
            for i in range(n):
                slopes[phase - 1, i] = (moved[i] - residual[i]) / h
        else:
            gain = chi - trial_chi
            if gain > 0.0:
                chi = trial_chi
                _copy_into(start, trial)
                _copy_into(residual, moved)
                _copy_into(parameters, trial_parameters)
                damping = max(damping * 0.2, 1e-9)
                rounds += 1
                if gain < 1e-9 * chi + 1e-9:
                    break
                phase = 0
            else:
                damping *= 8.0
                tries += 1
                if tries > 12:
                    break
        phase += 1
        while 1 <= phase <= 2 and hold[phase - 1] == 1:
            phase += 1
        _copy_into(trial, start)
        if phase <= 2:
            h = 1e-5 if start[phase - 1] + 1e-5 <= bounds[phase - 1, 1] else -1e-5
            trial[phase - 1] += h
            continue
        if phase == 3:
            a, b, c, g, e = 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(n):
                a += slopes[0, i] * slopes[0, i]
                b += slopes[0, i] * slopes[1, i]
                c += slopes[1, i] * slopes[1, i]
                g += slopes[0, i] * residual[i]
                e += slopes[1, i] * residual[i]
            tries = 0
        phase = 3
        p = a * (1.0 + damping) + 1e-12
        q = c * (1.0 + damping) + 1e-12
        determinant = p * q - b * b
        move_0 = -(q * g - b * e) / determinant
        move_1 = -(p * e - b * g) / determinant
        if hold[0] == 0:
            trial[0] = min(max(start[0] + min(max(move_0, -1.0), 1.0), bounds[0, 0]), bounds[0, 1])
        if hold[1] == 0:
            trial[1] = min(max(start[1] + min(max(move_1, -0.7), 0.7), bounds[1, 0]), bounds[1, 1])
    return chi
