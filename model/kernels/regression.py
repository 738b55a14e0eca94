"""Compiled accumulation of normal equations over angle, and the chi-square of the friction curve."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TERMS = 12
"""Powers of the offset inside a cell that are summed: (n delta)^12/12! < 1e-15 for n delta <= pi/12."""
GROUP_SIZE = TERMS + 6
"""Length of the group state: count, cell, sum of value, sum of value squared, two spare, then the power sums."""


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def rank_update(normal, rows, used):
    """normal += rows[:used]' rows[:used], upper triangle only."""
    p = normal.shape[0]
    if used == 4:
        for i in range(p):
            a, b, c, d = rows[0, i], rows[1, i], rows[2, i], rows[3, i]
            for j in range(i, p):
                normal[i, j] += a * rows[0, j] + b * rows[1, j] + c * rows[2, j] + d * rows[3, j]
    else:
        for k in range(used):
            for i in range(p):
                a = rows[k, i]
                for j in range(i, p):
                    normal[i, j] += a * rows[k, j]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def basis_sums(row, group, centre, origin, scale, input_order, output_order, order, taylor, ratio):
    """row = sum over the samples of a cell of (1, trend, cos, sin, ...), by power sums about the centre of the cell."""
    count = group[0]
    row[0] = count
    row[1] = (count * (centre - origin) + group[7]) / scale
    highest_input = 0
    highest_output = 0
    for k in range(len(input_order)):
        highest_input = max(highest_input, abs(input_order[k]))
        highest_output = max(highest_output, abs(output_order[k]))
    c1, s1 = math.cos(centre), math.sin(centre)
    c2, s2 = math.cos(centre / ratio), math.sin(centre / ratio)
    ci = np.empty(highest_input + 1)
    si = np.empty(highest_input + 1)
    co = np.empty(highest_output + 1)
    so = np.empty(highest_output + 1)
    ci[0], si[0], co[0], so[0] = 1.0, 0.0, 1.0, 0.0
    for k in range(highest_input):
        ci[k + 1] = ci[k] * c1 - si[k] * s1
        si[k + 1] = si[k] * c1 + ci[k] * s1
    for k in range(highest_output):
        co[k + 1] = co[k] * c2 - so[k] * s2
        so[k + 1] = so[k] * c2 + co[k] * s2
    orders = len(order)
    even = np.zeros(orders)
    odd = np.zeros(orders)
    for j in range(0, TERMS, 2):
        p0, p1 = group[6 + j], group[7 + j]
        for k in range(orders):
            even[k] += taylor[j, k] * p0
            odd[k] += taylor[j + 1, k] * p1
    for k in range(orders):
        n, m = input_order[k], output_order[k]
        if n < 0:
            cosine, sine = math.cos(order[k] * centre), math.sin(order[k] * centre)
        else:
            cb = co[abs(m)]
            sb = so[abs(m)] if m >= 0 else -so[abs(m)]
            cosine = ci[n] * cb - si[n] * sb
            sine = si[n] * cb + ci[n] * sb
        row[2 + 2 * k] = cosine * even[k] - sine * odd[k]
        row[3 + 2 * k] = sine * even[k] + cosine * odd[k]


@njit(cache=True, nogil=True)
def taylor_table(order):
    """Signed v^j/j! for each power j and order v: cos from the even rows, sin from the odd ones."""
    table = np.empty((TERMS, len(order)))
    for k in range(len(order)):
        factor = 1.0
        for j in range(TERMS):
            table[j, k] = factor if (j // 2) % 2 == 0 else -factor
            factor *= order[k] / (j + 1.0)
    return table


@njit(cache=True, nogil=True)
def close_group(group, rows, used, normal, right, bin_basis, bin_value, totals, cells, basis):
    """Add the finished cell to the normal equations of the current block; returns how many buffered rows are in use."""
    origin, scale, input_order, output_order, order, taylor, ratio = basis
    count = group[0]
    if count == 0.0:
        return used
    cell = int(group[1])
    row = rows[used]
    centre = (cell + 0.5) * 2.0 * math.pi / cells
    basis_sums(row, group, centre, origin, scale, input_order, output_order, order, taylor, ratio)
    place = cell % cells
    mean = group[2] / count
    weight = 1.0 / math.sqrt(count)
    for i in range(len(row)):
        bin_basis[place, i] += row[i]
        right[i] += row[i] * mean
        row[i] *= weight
    bin_value[place] += group[2]
    totals[0] += count
    totals[1] += group[3]
    totals[2] += group[2] * mean
    group[0] = 0.0
    used += 1
    if used == 4:
        rank_update(normal, rows, used)
        used = 0
    return used


@njit(cache=True, nogil=True)
def accumulate(
    angle,
    value,
    start,
    group,
    rows,
    normal,
    right,
    bin_basis,
    bin_value,
    totals,
    cells,
    last_cell,
    basis,
):
    """Add samples from `start` on until the block ends; returns the index of the first sample that was not taken.

    The block covers cells below `last_cell` in the direction of travel that `totals[5]` (+1 or -1) names.
    """
    used = 0
    per_angle = cells / (2.0 * math.pi)
    width = 1.0 / per_angle
    offset_value = totals[6]
    direction = totals[5]
    n = len(angle)
    stop = n
    for k in range(start, n):
        x = angle[k]
        cell = math.floor(x * per_angle)
        if cell != group[1] or group[0] == 0.0:
            used = close_group(
                group, rows, used, normal, right, bin_basis, bin_value, totals, cells, basis
            )
            if direction * (cell - last_cell) >= 0.0:
                stop = k
                break
            group[1] = cell
            for j in range(2, 6 + TERMS):
                group[j] = 0.0
        y = value[k] - offset_value
        delta = x - (cell + 0.5) * width
        group[0] += 1.0
        group[2] += y
        group[3] += y * y
        power = 1.0
        for j in range(TERMS):
            group[6 + j] += power
            power *= delta
        if y < totals[3]:
            totals[3] = y
        if y > totals[4]:
            totals[4] = y
    rank_update(normal, rows, used)
    return stop


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
def solve_masked(g00, g01, g02, g11, g12, g22, r0, r1, r2, u0, u1, u2):
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
        x0, x1, x2 = solve_masked(g00, g01, g02, g11, g12, g22, r0, r1, r2, u0, u1, u2)
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
def copy_into(target, source):
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
    copy_into(trial, start)
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
            copy_into(residual, moved)
            copy_into(parameters, trial_parameters)
        elif phase <= 2:
            for i in range(n):
                slopes[phase - 1, i] = (moved[i] - residual[i]) / h
        else:
            gain = chi - trial_chi
            if gain > 0.0:
                chi = trial_chi
                copy_into(start, trial)
                copy_into(residual, moved)
                copy_into(parameters, trial_parameters)
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
        copy_into(trial, start)
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
