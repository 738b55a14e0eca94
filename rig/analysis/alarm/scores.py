"""Standard normal scores of a series of runs: each run against what the runs before it let expect.

    w_i = (x_i - z_i b_(i-1)) / sqrt(1 + z_i (Z'Z)^-1 z_i) ,   s_i^2 = sum of w_j^2 over j < i / nu_i
    t_i = w_i / s_i ,   u_i = Phi^-1(F_nu(t_i))

with b_(i-1) the least-squares coefficients of the runs before, z_i the regressors of run i (one, warmth, bench,
mounting, lubricant) and nu_i how many residuals came before. Of a gear that does not change, with normal scatter that
is independent from run to run, the u_i are independent standard normal numbers from the first one on: nobody has to
know its level, its scatter or its temperature coefficient before. Sources: Brown, Durbin, Evans, J. R. Statist. Soc.
B 37 (1975) 149, recursive residuals; Hawkins, The Statistician 36 (1987) 423, self-starting CUSUM; Quesenberry,
J. Qual. Technol. 23 (1991) 213.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr

Array = NDArray[np.float64]

_NEW_DIRECTION = 1e-6
"""Share of a run's regressors that no run before had, from which on nothing is expected of it."""
_RANK = 1e-10
_FARTHEST = 1e-15
"""Probability beyond which a score is no farther out: 8 standard deviations."""


@dataclass(frozen=True)
class Scores:
    """Of many series at once, each an array (series, runs): NaN where the runs before tell nothing yet.

    `normal` the scores u, `expected` what the runs before let expect, in the unit of the values.
    """

    normal: Array
    expected: Array


def scores_of(values: Array, regressors: Array) -> Scores:
    """Scores of series (series, runs) with regressors (series, runs, columns), of about unit size.

    A run whose regressors no run before had (the first on another bench) has no score; it begins the new level.
    """
    series, runs = values.shape
    columns = regressors.shape[2]
    normal, expected = np.full((series, runs), np.nan), np.full((series, runs), np.nan)
    normal_matrix, right = np.zeros((series, columns, columns)), np.zeros((series, columns))
    squares, freedom = np.zeros(series), np.zeros(series)
    for run in range(runs):
        z, x = regressors[:, run], values[:, run]
        inverse = np.linalg.pinv(normal_matrix, rcond=_RANK, hermitian=True)
        known = np.einsum("sij,sj->si", inverse, np.einsum("sij,sj->si", normal_matrix, z))
        size = np.linalg.norm(z, axis=1)
        is_known = np.linalg.norm(z - known, axis=1) <= _NEW_DIRECTION * size
        guess = np.einsum("si,sij,sj->s", z, inverse, right)
        leverage = np.einsum("si,sij,sj->s", z, inverse, z)
        residual = (x - guess) / np.sqrt(1.0 + leverage)
        can_tell = is_known & (freedom >= 1.0) & (squares > 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = residual / np.sqrt(squares / freedom)
            below = stdtr(np.maximum(freedom, 1.0), ratio)
        score = ndtri(np.clip(below, _FARTHEST, 1.0 - _FARTHEST))
        normal[:, run] = np.where(can_tell, score, np.nan)
        expected[:, run] = np.where(is_known, guess, np.nan)
        squares += np.where(is_known, residual**2, 0.0)
        freedom += is_known
        normal_matrix += z[:, :, None] * z[:, None, :]
        right += z * x[:, None]
    return Scores(normal, expected)
