"""Compiled products of tall, narrow matrices: sums over the samples of a recording, one column times another.

A library's products are made for large matrices: its threads wait for each other, and that costs more processor
time than the few dozen columns of a fit take. These keep to one thread.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from model.arrays import FloatArray

_compiled = njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"}
)


@_compiled
def inner(left: FloatArray, right: FloatArray) -> FloatArray:
    """left' right (q, p) of `left` (n, q) and `right` (n, p)."""
    rows, wide = left.shape[0], right.shape[1]
    out = np.zeros((left.shape[1], wide))
    # Four samples at a time, so that a sum is fetched and put back once for all of them.
    even = rows - rows % 4
    for i in range(0, even, 4):
        for j in range(left.shape[1]):
            a, b, c, d = left[i, j], left[i + 1, j], left[i + 2, j], left[i + 3, j]
            for k in range(wide):
                out[j, k] += (a * right[i, k] + b * right[i + 1, k]) + (
                    c * right[i + 2, k] + d * right[i + 3, k]
                )
    for i in range(even, rows):
        for j in range(left.shape[1]):
            for k in range(wide):
                out[j, k] += left[i, j] * right[i, k]
    return out


@_compiled
def take_out(basis: FloatArray, columns: FloatArray) -> None:
    """Take from `columns` (n, p) what lies along the orthonormal columns of `basis` (n, q)."""
    share = inner(basis, columns)
    for i in range(columns.shape[0]):
        for j in range(basis.shape[1]):
            for k in range(columns.shape[1]):
                columns[i, k] -= basis[i, j] * share[j, k]


@_compiled
def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal columns (n, q) that span the same as `columns` (n, q); a dependent one becomes zero.

    Gram-Schmidt, every column twice: once leaves what rounding has left of the columns before it.
    """
    found = columns.T.copy()
    for j in range(found.shape[0]):
        size = np.sqrt(np.sum(found[j] * found[j]))
        for _ in range(2):
            for before in range(j):
                share = 0.0
                for i in range(found.shape[1]):
                    share += found[before, i] * found[j, i]
                for i in range(found.shape[1]):
                    found[j, i] -= share * found[before, i]
        left = np.sqrt(np.sum(found[j] * found[j]))
        found[j] *= 1.0 / left if left > 1e-12 * size else 0.0
    return found.T.copy()
