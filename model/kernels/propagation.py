"""Compiled propagation of equation 2 with a prescribed input: input signals, modal recurrence, outputs, batches.

Samples are handled in short chunks that stay in the cache, loop by loop, so that everything but the recurrence itself
runs several samples at a time. A sample's inputs are psi = theta_i/N + ke, psi', F_fm, M_0, T_L (rows of `signals`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from model.arrays import FloatArray

CHUNK = 248
SIGNALS = 5
_compiled = njit(
    cache=True, nogil=True, fastmath={"contract", "nsz", "nnan", "ninf"}, error_model="numpy"
)


@_compiled
def add_series(
    angle: FloatArray,
    orders: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    value: FloatArray,
    slope: FloatArray,
) -> None:
    """Add sum a cos(n theta) + b sin(n theta) and its derivative by theta; polynomials good to 3e-15 (SIMD)."""
    for j in range(orders.size):
        turns = orders[j] / (2.0 * np.pi)
        a, b = cosine[j], sine[j]
        na, nb = orders[j] * a, orders[j] * b
        for i in range(angle.size):
            u = angle[i] * turns
            u -= np.rint(u)
            t = u * u
            p = -2.1085143089294437e-05
            p = p * t + 4.6594394370913495e-04
            p = p * t - 7.370349325356074e-03
            p = p * t + 8.214587625298012e-02
            p = p * t - 0.5992645286066534
            p = p * t + 2.5501640398535868
            p = p * t - 5.167712780049687
            half_sine = (p * t + 3.1415926535897927) * u
            p = -1.0037422180175783e-04
            p = p * t + 1.927833072841167e-03
            p = p * t - 2.5806519319303334e-02
            p = p * t + 0.23533058619159428
            p = p * t - 1.3352627660044902
            p = p * t + 4.058712126326718
            p = p * t - 4.934802200543608
            half_cosine = p * t + 0.9999999999999978
            s = 2.0 * half_sine * half_cosine
            c = 1.0 - 2.0 * half_sine * half_sine
            value[i] += a * c + b * s
            slope[i] += nb * c - na * s


@_compiled
def friction_signals(
    speed: FloatArray,
    before: float,
    after: float,
    friction: FloatArray,
    mesh: FloatArray,
    bearing: FloatArray,
    jump: FloatArray,
) -> None:
    """F_fm and M_0 (equations 18, 19) just before each sample, and the change of sign at it.

    `friction` = (F_c, F_s - F_c, v_s, sigma, c_v, 0.1 f_0 d_m^3, nu n per rad/s, least nu n, smoothing speed). `before`
    and `after` are the speeds next to this block. At a sample of zero speed the friction keeps the sign of the motion
    that ends there, and `jump` is the step to the sign of the motion that begins.
    """
    coulomb, excess, stribeck, shape, viscous = (
        friction[0],
        friction[1],
        friction[2],
        friction[3],
        friction[4],
    )
    drag, product, least, smoothing = friction[5], friction[6], friction[7], friction[8]
    floor = drag * least ** (2.0 / 3.0) if least > 0.0 else 0.0
    n = speed.size
    for i in range(n):
        omega = abs(speed[i])
        x = omega / stribeck
        if shape != 1.0:
            x = x**shape
        force = coulomb + viscous * omega
        if x < 700.0:
            force += excess * np.exp(-x)
        viscosity = product * omega
        torque = drag * viscosity ** (2.0 / 3.0) if viscosity > least else floor
        sign = 1.0 if speed[i] > 0.0 else -1.0
        jump[i] = 0.0
        if smoothing > 0.0:
            sign = np.tanh(speed[i] / smoothing)
        elif speed[i] == 0.0:
            sign = np.sign(speed[i - 1] if i > 0 else before)
            jump[i] = np.sign(speed[i + 1] if i + 1 < n else after) - sign
        mesh[i] = force * sign
        bearing[i] = torque * sign


@_compiled
def _input_signals(
    angle: FloatArray,
    speed: FloatArray,
    before: float,
    after: float,
    load: FloatArray,
    ratio: float,
    series: FloatArray,
    friction: FloatArray,
    signals: FloatArray,
    slope: FloatArray,
    jump: FloatArray,
) -> None:
    """Fill the rows of `signals` (5, >= n), d psi/d theta in `slope` and the sign changes of friction in `jump`."""
    n = angle.size
    ideal, rate = signals[0, :n], signals[1, :n]
    for i in range(n):
        ideal[i] = angle[i] / ratio
        slope[i] = 1.0 / ratio
    add_series(angle, series[0], series[1], series[2], ideal, slope)
    for i in range(n):
        rate[i] = slope[i] * speed[i]
    friction_signals(speed, before, after, friction, signals[2], signals[3], jump)
    if load.size > 0:
        for i in range(n):
            signals[4, i] = load[i]


# The loops below take whole arrays and indices instead of slices: a slice costs two atomic reference counts.


@_compiled
def _drive(
    n: int, gain: FloatArray, k: int, m: int, signals: FloatArray, loaded: bool, track: FloatArray
) -> None:
    """Rows 2 m and 2 m + 1 of `track` = real and imaginary part of what the signals add to mode m of set k."""
    for part in range(2):
        r = 2 * m + part
        f0, f1, f2 = gain[k, part, m, 0], gain[k, part, m, 1], gain[k, part, m, 2]
        f3, f4 = gain[k, part, m, 3], gain[k, part, m, 4]
        for i in range(n):
            track[r, i] = (
                f0 * signals[0, i] + f1 * signals[1, i] + f2 * signals[2, i] + f3 * signals[3, i]
            )
        if loaded:
            for i in range(n):
                track[r, i] += f4 * signals[4, i]


@_compiled
def _observe(
    n: int,
    output: FloatArray,
    through: FloatArray,
    k: int,
    o: int,
    modes: int,
    signals: FloatArray,
    loaded: bool,
    track: FloatArray,
    row: FloatArray,
) -> None:
    """row = output o of set k: sum of through x signals + real part of sum of output[m] z[m]."""
    f0, f1, f2 = through[k, o, 0], through[k, o, 1], through[k, o, 2]
    f3, f4 = through[k, o, 3], through[k, o, 4]
    for i in range(n):
        row[i] = f0 * signals[0, i] + f1 * signals[1, i] + f2 * signals[2, i] + f3 * signals[3, i]
    if loaded:
        for i in range(n):
            row[i] += f4 * signals[4, i]
    for m in range(0, modes, 2):
        a, b, c, d = (
            output[k, o, 0, m],
            output[k, o, 1, m],
            output[k, o, 0, m + 1],
            output[k, o, 1, m + 1],
        )
        r = 2 * m
        for i in range(n):
            row[i] += (
                a * track[r, i] - b * track[r + 1, i] + c * track[r + 2, i] - d * track[r + 3, i]
            )


@_compiled
def _advance_modes(
    n: int,
    k: int,
    first: int,
    decay: FloatArray,
    jump: FloatArray,
    kick: FloatArray,
    state: FloatArray,
    track: FloatArray,
) -> None:
    """Four modes of set k over a chunk, z' = E z + g: `track` holds g (rows real, imaginary) and then the states z."""
    a, b, c, d = first, first + 1, first + 2, first + 3
    r0, r1, r2, r3, r4, r5, r6, r7 = (
        2 * a,
        2 * a + 1,
        2 * b,
        2 * b + 1,
        2 * c,
        2 * c + 1,
        2 * d,
        2 * d + 1,
    )
    ar, ai, br, bi = decay[k, 0, a], decay[k, 1, a], decay[k, 0, b], decay[k, 1, b]
    cr, ci, dr, di = decay[k, 0, c], decay[k, 1, c], decay[k, 0, d], decay[k, 1, d]
    xr, xi, yr, yi = state[k, 0, a], state[k, 1, a], state[k, 0, b], state[k, 1, b]
    vr, vi, wr, wi = state[k, 0, c], state[k, 1, c], state[k, 0, d], state[k, 1, d]
    for i in range(n):
        g0, g1, g2, g3 = track[r0, i], track[r1, i], track[r2, i], track[r3, i]
        g4, g5, g6, g7 = track[r4, i], track[r5, i], track[r6, i], track[r7, i]
        track[r0, i], track[r1, i], track[r2, i], track[r3, i] = xr, xi, yr, yi
        track[r4, i], track[r5, i], track[r6, i], track[r7, i] = vr, vi, wr, wi
        xr, xi = ar * xr - ai * xi + g0, ar * xi + ai * xr + g1
        yr, yi = br * yr - bi * yi + g2, br * yi + bi * yr + g3
        vr, vi = cr * vr - ci * vi + g4, cr * vi + ci * vr + g5
        wr, wi = dr * wr - di * wi + g6, dr * wi + di * wr + g7
        if jump[i] != 0.0:
            xr, xi = xr + jump[i] * kick[k, 0, a], xi + jump[i] * kick[k, 1, a]
            yr, yi = yr + jump[i] * kick[k, 0, b], yi + jump[i] * kick[k, 1, b]
            vr, vi = vr + jump[i] * kick[k, 0, c], vi + jump[i] * kick[k, 1, c]
            wr, wi = wr + jump[i] * kick[k, 0, d], wi + jump[i] * kick[k, 1, d]
    state[k, 0, a], state[k, 1, a], state[k, 0, b], state[k, 1, b] = xr, xi, yr, yi
    state[k, 0, c], state[k, 1, c], state[k, 0, d], state[k, 1, d] = vr, vi, wr, wi


@_compiled
def _advance_dense(
    n: int,
    k: int,
    transition: FloatArray,
    jump: FloatArray,
    kick: FloatArray,
    state: FloatArray,
    track: FloatArray,
) -> None:
    """All six real states of set k over a chunk with a full transition matrix; `track` as for the modes."""
    old = np.empty(6)
    for i in range(n):
        for r in range(6):
            old[r] = state[k, 0, r]
        for r in range(6):
            total = track[2 * r, i] + jump[i] * kick[k, 0, r]
            for c in range(6):
                total += transition[k, r, c] * old[c]
            state[k, 0, r] = total
            track[2 * r, i] = old[r]


@_compiled
def propagate(
    angle: FloatArray,
    speed: FloatArray,
    before: float,
    after: float,
    load: FloatArray,
    ratio: float,
    series: FloatArray,
    friction: FloatArray,
    lever: FloatArray,
    dense: bool,
    decay: FloatArray,
    transition: FloatArray,
    gain: FloatArray,
    kick: FloatArray,
    output: FloatArray,
    through: FloatArray,
    state: FloatArray,
    stride: int,
    offset: int,
    result: FloatArray,
) -> None:
    """Propagate a block for every parameter set and keep the outputs of every `stride`-th sample.

    Per set (first axis): `decay` (2, m) or `transition` (6, 6); `gain` (2, m, 5) and `kick` (2, m) drive the modes;
    `output` (outputs, 2, m) and `through` (outputs, 5) make the outputs from modes and signals; `state` (2, m) is
    carried; `result` (outputs, ..) is filled from `offset` on. A fourth output is turned from the bearing force into
    the wave-generator torque by the `lever` of the set. m is a multiple of four.
    """
    sets, modes, outputs = state.shape[0], state.shape[2], output.shape[1]
    loaded = load.size > 0
    signals, slope, jump = np.empty((SIGNALS, CHUNK)), np.empty(CHUNK), np.empty(CHUNK)
    track, row = np.empty((2 * modes, CHUNK)), np.empty(CHUNK)
    written = offset
    for start in range(0, angle.size, CHUNK):
        n = min(CHUNK, angle.size - start)
        stop = start + n
        left = speed[start - 1] if start > 0 else before
        right = speed[stop] if stop < angle.size else after
        _input_signals(
            angle[start:stop],
            speed[start:stop],
            left,
            right,
            load[start:stop],
            ratio,
            series,
            friction,
            signals,
            slope,
            jump,
        )
        begin = -start % stride
        samples = (n - begin + stride - 1) // stride if n > begin else 0
        for k in range(sets):
            for m in range(modes):
                _drive(n, gain, k, m, signals, loaded, track)
            if dense:
                _advance_dense(n, k, transition, jump, kick, state, track)
            else:
                for m in range(0, modes, 4):
                    _advance_modes(n, k, m, decay, jump, kick, state, track)
            for o in range(outputs):
                _observe(n, output, through, k, o, modes, signals, loaded, track, row)
                if o == 3:
                    for i in range(n):
                        row[i] = row[i] * lever[k] * slope[i] + signals[3, i]
                target = result[k, o, written : written + samples]
                for i in range(samples):
                    target[i] = row[begin + i * stride]
        written += samples


@_compiled
def refine(
    angle: FloatArray,
    speed: FloatArray,
    interval: float,
    load: FloatArray,
    steps: int,
    fine_angle: FloatArray,
    fine_speed: FloatArray,
    fine_load: FloatArray,
) -> None:
    """Cubic Hermite interpolation of angle and speed, linear of load, at `steps` points per interval."""
    for j in range(steps):
        s = j / steps
        rise = s * s * (3.0 - 2.0 * s)
        leave = s * (1.0 - s) * (1.0 - s) * interval
        arrive = s * s * (s - 1.0) * interval
        rise_rate = 6.0 * s * (1.0 - s) / interval
        leave_rate = (1.0 - s) * (1.0 - 3.0 * s)
        arrive_rate = s * (3.0 * s - 2.0)
        for k in range(angle.size - 1):
            change = angle[k + 1] - angle[k]
            fine_angle[k * steps + j] = (
                angle[k] + rise * change + leave * speed[k] + arrive * speed[k + 1]
            )
            fine_speed[k * steps + j] = (
                rise_rate * change + leave_rate * speed[k] + arrive_rate * speed[k + 1]
            )
        if load.size > 0:
            for k in range(angle.size - 1):
                fine_load[k * steps + j] = load[k] + s * (load[k + 1] - load[k])
