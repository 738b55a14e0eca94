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
def accumulate(angle, value, start, group, rows, normal, right, bin_basis, bin_value, totals, cells, last_cell, basis):
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
            used = close_group(group, rows, used, normal, right, bin_basis, bin_value, totals, cells, basis)
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
def solve_subset(gram, right, use, solution):
    """Solve the chosen rows of a symmetric 3 x 3 system; returns False if singular or a chosen value is negative."""
    a = np.zeros((3, 4))
    index = np.zeros(3, dtype=np.int64)
    size = 0
    for i in range(3):
        solution[i] = 0.0
        if use[i]:
            index[size] = i
            size += 1
    for i in range(size):
        for j in range(size):
            a[i, j] = gram[index[i], index[j]]
        a[i, size] = right[index[i]]
    for i in range(size):
        pivot = a[i, i]
        if pivot <= 1e-13 * gram[index[i], index[i]] or pivot <= 0.0:
            return False
        for r in range(i + 1, size):
            factor = a[r, i] / pivot
            for c in range(i, size + 1):
                a[r, c] -= factor * a[i, c]
    for i in range(size - 1, -1, -1):
        value = a[i, size]
        for c in range(i + 1, size):
            value -= a[i, c] * solution[index[c]]
        solution[index[i]] = value / a[i, i]
    for i in range(size):
        if solution[index[i]] < 0.0:
            return False
    return True


@njit(cache=True, nogil=True)
def stribeck_inner(speed, force, weight, velocity, shape, mode, fixed, parameters, residual):
    """Chi-square of the Stribeck curve (equation 19) with its linear parameters at their best non-negative values.

    parameters receives F_c, F_s - F_c, c_v; residual the weighted residuals. In the profile of F_s the fixed value enters as
    F_s exp(...) and the free column is 1 - exp(...).
    """
    n = len(speed)
    gram = np.zeros((3, 3))
    right = np.zeros(3)
    columns = np.empty((3, n))
    target = np.empty(n)
    for i in range(n):
        decay = math.exp(-((speed[i] / velocity) ** shape))
        w = weight[i]
        c0, c1, c2, y = w, w * decay, w * speed[i], w * force[i]
        if mode == FIXED_COULOMB:
            y -= fixed * c0
            c0 = 0.0
        elif mode == FIXED_STATIC:
            y -= fixed * c1
            c0, c1 = c0 - c1, 0.0
        elif mode == FIXED_VISCOUS:
            y -= fixed * c2
            c2 = 0.0
        columns[0, i], columns[1, i], columns[2, i], target[i] = c0, c1, c2, y
        gram[0, 0] += c0 * c0
        gram[0, 1] += c0 * c1
        gram[0, 2] += c0 * c2
        gram[1, 1] += c1 * c1
        gram[1, 2] += c1 * c2
        gram[2, 2] += c2 * c2
        right[0] += c0 * y
        right[1] += c1 * y
        right[2] += c2 * y
    gram[1, 0], gram[2, 0], gram[2, 1] = gram[0, 1], gram[0, 2], gram[1, 2]
    use = np.ones(3, dtype=np.bool_)
    if mode == FIXED_COULOMB:
        use[0] = False
    elif mode == FIXED_STATIC:
        use[1] = False
    elif mode == FIXED_VISCOUS:
        use[2] = False
    solution = np.zeros(3)
    best = np.zeros(3)
    if solve_subset(gram, right, use, solution):
        best[:] = solution
    else:
        lowest = 0.0
        for code in range(1, 8):
            subset = np.zeros(3, dtype=np.bool_)
            allowed = True
            for i in range(3):
                subset[i] = (code >> i) & 1 == 1
                if subset[i] and not use[i]:
                    allowed = False
            if allowed and solve_subset(gram, right, subset, solution):
                gain = 0.0
                for i in range(3):
                    gain += solution[i] * right[i]
                if gain > lowest:
                    lowest = gain
                    best[:] = solution
    total = 0.0
    for i in range(n):
        r = target[i] - best[0] * columns[0, i] - best[1] * columns[1, i] - best[2] * columns[2, i]
        residual[i] = r
        total += r * r
    parameters[:] = best
    if mode == FIXED_COULOMB:
        parameters[0] = fixed
    elif mode == FIXED_STATIC:
        parameters[1] = fixed - best[0]
    elif mode == FIXED_VISCOUS:
        parameters[2] = fixed
    return total


@njit(cache=True, nogil=True)
def stribeck_descend(speed, force, weight, start, hold, mode, fixed, bounds, iterations, parameters):
    """Levenberg-Marquardt in (log v_s, log sigma) on the projected residual; `hold` fixes one of them.

    start (2,) is changed in place to the optimum; bounds (2, 2) in log. Returns chi-square.
    """
    n = len(speed)
    residual = np.empty(n)
    moved = np.empty(n)
    slopes = np.zeros((2, n))
    trial_parameters = np.zeros(3)
    trial = np.zeros(2)
    chi = stribeck_inner(
        speed, force, weight, math.exp(start[0]), math.exp(start[1]), mode, fixed, parameters, residual
    )
    damping = 1e-3
    for _ in range(iterations):
        h = 1e-5
        for k in range(2):
            if hold[k]:
                slopes[k, :] = 0.0
                continue
            trial[:] = start
            step = h if start[k] + h <= bounds[k, 1] else -h
            trial[k] += step
            stribeck_inner(
                speed, force, weight, math.exp(trial[0]), math.exp(trial[1]), mode, fixed, trial_parameters, moved
            )
            for i in range(n):
                slopes[k, i] = (moved[i] - residual[i]) / step
        a, b, c, g0, g1 = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            a += slopes[0, i] * slopes[0, i]
            b += slopes[0, i] * slopes[1, i]
            c += slopes[1, i] * slopes[1, i]
            g0 += slopes[0, i] * residual[i]
            g1 += slopes[1, i] * residual[i]
        improved = False
        gain = 0.0
        for _ in range(12):
            p = a * (1.0 + damping) + 1e-12
            q = c * (1.0 + damping) + 1e-12
            determinant = p * q - b * b
            d0 = -(q * g0 - b * g1) / determinant
            d1 = -(p * g1 - b * g0) / determinant
            trial[0] = min(max(start[0] + min(max(d0, -1.0), 1.0), bounds[0, 0]), bounds[0, 1])
            trial[1] = min(max(start[1] + min(max(d1, -0.7), 0.7), bounds[1, 0]), bounds[1, 1])
            if hold[0]:
                trial[0] = start[0]
            if hold[1]:
                trial[1] = start[1]
            found = stribeck_inner(
                speed, force, weight, math.exp(trial[0]), math.exp(trial[1]), mode, fixed, trial_parameters, moved
            )
            if found < chi:
                gain = chi - found
                chi = found
                start[:] = trial
                residual[:] = moved
                parameters[:] = trial_parameters
                damping = max(damping * 0.2, 1e-9)
                improved = True
                break
            damping *= 8.0
        if not improved or gain < 1e-9 * (chi + 1e-12) + 1e-9:
            break
    return chi


@njit(cache=True, nogil=True)
def stribeck_search(speed, force, weight, bounds, grid_velocity, grid_shape, best, parameters):
    """The best of a coarse grid, then descent from its two best cells; best (2,) receives log v_s and log sigma."""
    residual = np.empty(len(speed))
    trial_parameters = np.zeros(3)
    starts = np.zeros((2, 2))
    values = np.full(2, np.inf)
    for v in grid_velocity:
        for s in grid_shape:
            chi = stribeck_inner(speed, force, weight, math.exp(v), math.exp(s), FREE, 0.0, trial_parameters, residual)
            if chi < values[0]:
                if abs(v - starts[0, 0]) + abs(s - starts[0, 1]) > 1.0:
                    values[1] = values[0]
                    starts[1, :] = starts[0, :]
                values[0] = chi
                starts[0, 0], starts[0, 1] = v, s
            elif chi < values[1] and abs(v - starts[0, 0]) + abs(s - starts[0, 1]) > 1.0:
                values[1] = chi
                starts[1, 0], starts[1, 1] = v, s
    hold = np.zeros(2, dtype=np.bool_)
    lowest = np.inf
    for k in range(2):
        if not np.isfinite(values[k]):
            continue
        chi = stribeck_descend(speed, force, weight, starts[k], hold, FREE, 0.0, bounds, 60, trial_parameters)
        if chi < lowest:
            lowest = chi
            best[:] = starts[k]
            parameters[:] = trial_parameters
    return lowest


@njit(cache=True, nogil=True)
def stribeck_profile(speed, force, weight, optimum, which, value, bounds, chi_best, rise, step, limit):
    """The value at which the profile of one parameter has risen by `rise`, searched from `value` in steps of `step`.

    which: 0 F_c, 1 F_s, 2 log v_s, 3 log sigma, 4 c_v. Returns NaN if the profile does not rise that far before `limit`.
    """
    start = optimum.copy()
    parameters = np.zeros(3)
    hold = np.zeros(2, dtype=np.bool_)
    mode = FREE
    if which == 0:
        mode = FIXED_COULOMB
    elif which == 1:
        mode = FIXED_STATIC
    elif which == 4:
        mode = FIXED_VISCOUS
    else:
        hold[which - 2] = True
    inside, root_inside = value, 0.0
    outside, root_outside = value, 0.0
    target = math.sqrt(rise)
    found = False
    for _ in range(40):
        outside = inside + step
        at_limit = (step > 0.0 and outside >= limit) or (step < 0.0 and outside <= limit)
        if at_limit:
            outside = limit
        if which == 2 or which == 3:
            start[which - 2] = outside
        chi = stribeck_descend(speed, force, weight, start, hold, mode, outside, bounds, 20, parameters)
        root_outside = math.sqrt(max(chi - chi_best, 0.0))
        if root_outside >= target:
            found = True
            break
        if at_limit:
            break
        if root_outside > 0.2 * target:
            step = math.copysign(
                min(abs(1.15 * (outside - value) * (target / root_outside - 1.0)) + 1e-12, 2.0 * abs(step)), step
            )
        else:
            step *= 2.0
        inside, root_inside = outside, root_outside
    if not found:
        return np.nan
    for _ in range(12):
        share = (target - root_inside) / max(root_outside - root_inside, 1e-12)
        middle = inside + min(max(share, 0.05), 0.95) * (outside - inside)
        if which == 2 or which == 3:
            start[which - 2] = middle
        chi = stribeck_descend(speed, force, weight, start, hold, mode, middle, bounds, 20, parameters)
        root = math.sqrt(max(chi - chi_best, 0.0))
        if abs(root - target) < 0.004 * target:
            return middle
        if root < target:
            inside, root_inside = middle, root
        else:
            outside, root_outside = middle, root
    return inside + (target - root_inside) / max(root_outside - root_inside, 1e-12) * (outside - inside)
