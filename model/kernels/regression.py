# pyright: standard
"""Compiled sums of samples over cells of angle, and the chi-square of the friction curve."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LANES = 5
"""Columns of a cell before its values: number of samples, sums of their offsets from its centre to the fourth power."""
_STRIP = 256
"""Cells that are worked on at a time: what belongs to them stays in the processor's cache."""


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def bin_samples(angle, values, start, grid, totals, layout):
    """Add samples from `start` on to their cells of angle; returns the index of the first that found no room.

    grid (cells, LANES + m): of each cell the LANES columns and the sums of its m values about their
    reference; totals (m, 4): reference, sum of squares about it, lowest, highest. layout: cells per
    radian, first cell, direction of travel, cells per turn of the output, halvings of the turns.
    """
    per_angle, first, direction, turn, halvings = layout
    width, end = 1.0 / per_angle, angle.shape[0]
    k = start
    while k < end:
        # Samples that follow each other in one cell are summed before the cell is touched.
        cell = math.floor(angle[k] * per_angle)
        place = max(int(direction * (cell - first)), 0)
        if halvings > 0:
            place = ((place // turn) >> halvings) * turn + place % turn
        if place >= grid.shape[0]:
            return k
        begin, centre = k, (cell + 0.5) * width
        one, two, three, four = 0.0, 0.0, 0.0, 0.0
        while k < end and math.floor(angle[k] * per_angle) == cell:
            delta = angle[k] - centre
            square = delta * delta
            one += delta
            two += square
            three += square * delta
            four += square * square
            k += 1
        lanes = grid[place]
        lanes[0] += k - begin
        lanes[1] += one
        lanes[2] += two
        lanes[3] += three
        lanes[4] += four
        for j in range(values.shape[0]):
            reference, squares = totals[j, 0], 0.0
            total, lowest, highest = 0.0, totals[j, 2], totals[j, 3]
            for i in range(begin, k):
                y = values[j, i] - reference
                total += y
                squares += y * y
                lowest = min(lowest, y)
                highest = max(highest, y)
            lanes[LANES + j] += total
            totals[j, 1] += squares
            totals[j, 2], totals[j, 3] = lowest, highest
    return end


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def wave_means(angle, moments, ratio, lattice, order, out):
    """out (2 orders, c) receives the means of cos v theta and sin v theta over the samples of each cell.

    angle (c,) of their centroids; moments (3, c): second, third and fourth about it. lattice (2, orders):
    n and m of v = n + m/ratio, whose waves are products of powers of two; n < 0: off it, evaluated directly.
    """
    cells, orders = angle.shape[0], order.shape[0]
    turns, sides = 1, 1
    for i in range(orders):
        turns = max(turns, lattice[0, i])
        sides = max(sides, abs(lattice[1, i]))
    turn = np.empty((turns + 1, 2, _STRIP))
    side, wave = np.empty((sides + 1, 2, _STRIP)), np.empty((2, _STRIP))
    turn[0, 0], turn[0, 1], side[0, 0], side[0, 1] = 1.0, 0.0, 1.0, 0.0
    for start in range(0, cells, _STRIP):
        size = min(_STRIP, cells - start)
        for powers, slow in ((turn, 1.0), (side, ratio)):
            for k in range(size):
                powers[1, 0, k] = math.cos(angle[start + k] / slow)
                powers[1, 1, k] = math.sin(angle[start + k] / slow)
            for n in range(2, powers.shape[0]):
                for k in range(size):
                    c, s = powers[n - 1, 0, k], powers[n - 1, 1, k]
                    powers[n, 0, k] = c * powers[1, 0, k] - s * powers[1, 1, k]
                    powers[n, 1, k] = s * powers[1, 0, k] + c * powers[1, 1, k]
        for i in range(orders):
            v, n, m = order[i], lattice[0, i], abs(lattice[1, i])
            sense = 1.0 if lattice[1, i] >= 0 else -1.0
            second, third, fourth = v**2 / 2.0, v**3 / 6.0, v**4 / 24.0
            if n < 0:
                for k in range(size):
                    wave[0, k] = math.cos(v * angle[start + k])
                    wave[1, k] = math.sin(v * angle[start + k])
            else:
                p, q, x, y = turn[n, 0], turn[n, 1], side[m, 0], side[m, 1]
                for k in range(size):
                    wave[0, k] = p[k] * x[k] - sense * q[k] * y[k]
                    wave[1, k] = q[k] * x[k] + sense * p[k] * y[k]
            re, im = wave[0], wave[1]
            cosine, sine = out[2 * i, start : start + size], out[2 * i + 1, start : start + size]
            spread, skew, tail = moments[0, start:], moments[1, start:], moments[2, start:]
            for k in range(size):
                even = 1.0 - second * spread[k] + fourth * tail[k]
                odd = third * skew[k]
                cosine[k] = re[k] * even + im[k] * odd
                sine[k] = im[k] * even - re[k] * odd


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def weighted_products(design, weight, first, normal):
    """normal (p, p) += X W X' of a design (p, c): the columns from `first` on, their rows down to the diagonal.

    In one thread, whatever else the machine does; eight products at a time, from the cache.
    """
    p, c = design.shape
    whole, new = (p + 3) // 4 * 4, (p - first + 1) // 2 * 2
    left, right = np.zeros((whole, _STRIP)), np.zeros((new, _STRIP))
    total = np.zeros((whole, new))
    for start in range(0, c, _STRIP):
        size = min(_STRIP, c - start)
        for i in range(p):
            for k in range(size):
                left[i, k] = design[i, start + k]
        for j in range(p - first):
            for k in range(size):
                right[j, k] = left[first + j, k] * weight[start + k]
            right[j, size:] = 0.0
        for j in range(0, new, 2):
            u, w = right[j], right[j + 1]
            for i in range(0, first + j + 2, 4):
                s0, s1, s2, s3, t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                a, b, d, e = left[i], left[i + 1], left[i + 2], left[i + 3]
                for k in range(_STRIP):
                    s0 += a[k] * u[k]
                    s1 += b[k] * u[k]
                    s2 += d[k] * u[k]
                    s3 += e[k] * u[k]
                    t0 += a[k] * w[k]
                    t1 += b[k] * w[k]
                    t2 += d[k] * w[k]
                    t3 += e[k] * w[k]
                total[i, j] += s0
                total[i + 1, j] += s1
                total[i + 2, j] += s2
                total[i + 3, j] += s3
                total[i, j + 1] += t0
                total[i + 1, j + 1] += t1
                total[i + 2, j + 1] += t2
                total[i + 3, j + 1] += t3
    for j in range(first, p):
        for i in range(j + 1):
            normal[i, j] += total[i, j - first]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def row_products(design, vector, out):
    """out (p,) += X y of a design (p, c)."""
    for i in range(design.shape[0]):
        total = 0.0
        for k in range(design.shape[1]):
            total += design[i, k] * vector[k]
        out[i] += total


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def row_combination(design, factor, out):
    """out (c,) += X' a of a design (p, c)."""
    p, c = design.shape
    for start in range(0, c, _STRIP):
        part = out[start : start + _STRIP]
        for i in range(0, p - 3, 4):
            f, g, h, m = factor[i], factor[i + 1], factor[i + 2], factor[i + 3]
            x, y = design[i, start : start + _STRIP], design[i + 1, start : start + _STRIP]
            z, w = design[i + 2, start : start + _STRIP], design[i + 3, start : start + _STRIP]
            for k in range(len(part)):
                part[k] += (f * x[k] + g * y[k]) + (h * z[k] + m * w[k])
        for i in range(p - p % 4, p):
            for k in range(len(part)):
                part[k] += factor[i] * design[i, start + k]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def stretch_products(design, weight, out):
    """out (p, s) = sums of X w over s equal stretches of the cells."""
    width = design.shape[1] // out.shape[1]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = 0.0
            for k in range(j * width, (j + 1) * width):
                total += design[i, k] * weight[k]
            out[i, j] = total


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def times_transposed(left, right):
    """A B' of matrices (m, p) and (n, p), in one thread."""
    out = np.empty((left.shape[0], right.shape[0]))
    for i in range(left.shape[0]):
        row, n = left[i], right.shape[0]
        for j in range(0, n - 3, 4):
            a, b, c, d = right[j], right[j + 1], right[j + 2], right[j + 3]
            s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
            for k in range(len(row)):
                s0 += row[k] * a[k]
                s1 += row[k] * b[k]
                s2 += row[k] * c[k]
                s3 += row[k] * d[k]
            out[i, j], out[i, j + 1], out[i, j + 2], out[i, j + 3] = s0, s1, s2, s3
        for j in range(n - n % 4, n):
            other, total = right[j], 0.0
            for k in range(len(row)):
                total += row[k] * other[k]
            out[i, j] = total
    return out


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def square_root(matrix):
    """Lower L with L L' = A for a symmetric A that is positive or has nothing in some rows; those stay zero."""
    p = matrix.shape[0]
    lower = np.zeros((p, p))
    for i in range(p):
        mine = lower[i]
        for j in range(i + 1):
            other, total = lower[j], matrix[i, j]
            for k in range(j):
                total -= mine[k] * other[k]
            if i == j:
                mine[i] = math.sqrt(total) if total > 1e-14 * matrix[i, i] else 0.0
            elif other[j] > 0.0:
                mine[j] = total / other[j]
    return lower


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def inverse_of(lower):
    """(L L')^-1 of a lower L without zeros on its diagonal."""
    p = lower.shape[0]
    solved, out = np.zeros((p, p)), np.zeros((p, p))
    for i in range(p):
        mine = solved[i]
        mine[i] = 1.0
        for k in range(i):
            above, factor = solved[k], lower[i, k]
            for j in range(k + 1):
                mine[j] -= factor * above[j]
        for j in range(i + 1):
            mine[j] /= lower[i, i]
    for k in range(p):
        row = solved[k]
        for i in range(k + 1):
            target, factor = out[i], row[i]
            for j in range(k + 1):
                target[j] += factor * row[j]
    return out


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def largest_eigenvalue(matrix):
    """Of a symmetric positive matrix, by sixty rounds of the power method: from below, to a few per cent."""
    p = matrix.shape[0]
    vector, image = np.empty(p), np.empty(p)
    for i in range(p):
        vector[i] = 1.0 + 0.5 * math.sin(3.7 * i + 1.0)
    size = 0.0
    for _ in range(60):
        square = 0.0
        for i in range(p):
            square += vector[i] * vector[i]
        for i in range(p):
            row, total = matrix[i], 0.0
            for k in range(p):
                total += row[k] * vector[k]
            image[i] = total
        size = 0.0
        for i in range(p):
            size += image[i] * image[i]
        size = math.sqrt(size / square)
        for i in range(p):
            vector[i] = image[i] / size
    return size


@njit(cache=True, nogil=True)
def series_on_grid(angle, order, cosine, sine):
    """sum of a cos(n theta) + b sin(n theta) at each angle."""
    out = np.zeros(len(angle))
    for i in range(len(angle)):
        total = 0.0
        for k in range(len(order)):
            phase = order[k] * angle[i]
            total += cosine[k] * math.cos(phase) + sine[k] * math.sin(phase)
        out[i] = total
    return out


FREE, FIXED_COULOMB, FIXED_STATIC, FIXED_VISCOUS = 0, 1, 2, 3
"""Which linear parameter of the Stribeck curve a profile holds."""


@njit(cache=True, nogil=True)
def _solve_masked(g00, g01, g02, g11, g12, g22, r0, r1, r2, u0, u1, u2):
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


@njit(cache=True, nogil=True)
def stribeck_inner(speed, white, whitening, velocity, shape, mode, fixed, parameters, residual):
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


@njit(cache=True, nogil=True)
def _copy_into(target, source):
    """target[:] = source, which compiles twenty times faster when it is written as a loop."""
    for i in range(len(target)):
        target[i] = source[i]


@njit(cache=True, nogil=True)
def stribeck_descend(
    speed, white, whitening, start, hold, mode, fixed, bounds, iterations, parameters
):
    """Levenberg-Marquardt in (log v_s, log sigma) on the projected residual; `hold` fixes one of them.

    start (2,) is changed in place to the optimum; bounds (2, 2) in log. Returns chi-square.
    """
    n = len(speed)
    residual = np.empty(n)
    moved = np.empty(n)
    slopes = np.zeros((2, n))
    trial_parameters = np.zeros(3)
    trial = np.empty(2)
    _copy_into(trial, start)
    a, b, c, g, e = 0.0, 0.0, 0.0, 0.0, 0.0
    chi, damping, h = np.inf, 1e-3, 1e-5
    phase, rounds, tries = 0, 0, 0
    while rounds < iterations:
        trial_chi = stribeck_inner(
            speed,
            white,
            whitening,
            math.exp(trial[0]),
            math.exp(trial[1]),
            mode,
            fixed,
            trial_parameters,
            moved,
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
