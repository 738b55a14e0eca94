"""Compiled sums of samples over cells of angle, and what is solved of them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from model.arrays import FloatArray as Array
from model.arrays import IntArray

_summed = njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
"""For sums over samples: their order is free, so that several are added at a time."""

LANES = 5
"""Columns of a cell before its values: number of samples, sums of their offsets from its centre to the fourth power."""
Layout = tuple[float, int, float, int, int]
"""Cells per radian, first cell, direction of travel, cells per turn of the output, halvings of the turns."""
_STRIP = 256
"""Cells that are worked on at a time: what belongs to them stays in the processor's cache."""


@_summed
def bin_samples(
    angle: Array, values: Array, start: int, grid: Array, totals: Array, layout: Layout
) -> int:
    """Add samples from `start` on to their cells of angle; returns the index of the first that found no room.

    grid (cells, LANES + m): of each cell the LANES columns and the sums of its m values about their
    reference; totals (m, 4): reference, sum of squares about it, lowest, highest.
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


@_summed
def wave_means(
    angle: Array, moments: Array, ratio: float, lattice: IntArray, order: Array, out: Array
) -> None:
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


@_summed
def weighted_products(design: Array, weight: Array, first: int, normal: Array) -> None:
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


@_summed
def row_products(design: Array, vector: Array, out: Array) -> None:
    """out (p,) += X y of a design (p, c)."""
    for i in range(design.shape[0]):
        total = 0.0
        for k in range(design.shape[1]):
            total += design[i, k] * vector[k]
        out[i] += total


@_summed
def row_combination(design: Array, factor: Array, out: Array) -> None:
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


@_summed
def stretch_products(design: Array, weight: Array, out: Array) -> None:
    """out (p, s) = sums of X w over s equal stretches of the cells."""
    width = design.shape[1] // out.shape[1]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = 0.0
            for k in range(j * width, (j + 1) * width):
                total += design[i, k] * weight[k]
            out[i, j] = total


@_summed
def times_transposed(left: Array, right: Array) -> Array:
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


@_summed
def square_root(matrix: Array) -> Array:
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


@_summed
def inverse_of(lower: Array) -> Array:
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


@_summed
def largest_eigenvalue(matrix: Array) -> float:
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
def series_on_grid(angle: Array, order: Array, cosine: Array, sine: Array) -> Array:
    """sum of a cos(n theta) + b sin(n theta) at each angle."""
    out = np.zeros(len(angle))
    for i in range(len(angle)):
        total = 0.0
        for k in range(len(order)):
            phase = order[k] * angle[i]
            total += cosine[k] * math.cos(phase) + sine[k] * math.sin(phase)
        out[i] = total
    return out
