"""Linear least squares with errors that respect autocorrelation: the common ground of every linear fit here.

Parameters of y = X b + r come from a column-scaled QR-equivalent (SVD) solution; their covariance
is a sandwich (X'X)^-1 S (X'X)^-1, where S sums the scores x_t r_t either over contiguous blocks
(clusters) or with Bartlett weights over lags (Newey and West 1987, lag by Andrews 1991). Intervals
use Student's t with the degrees of freedom that remain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import quotient
from model.errors import IdentificationError
from model.identify.checks import Array

CONDITION_LIMIT = 1e10
"""Above this condition number of the column-scaled design the data cannot separate the parameters."""


def student_quantile(freedom: float, level: float = 0.95) -> float:
    """The two-sided quantile of Student's t for `freedom` degrees of freedom (at least one)."""
    return float(scipy.special.stdtrit(max(float(freedom), 1.0), 0.5 + 0.5 * level))


@dataclass(frozen=True, kw_only=True)
class LinearFit:
    """Solution of a linear least-squares problem.

    values, standard_error: (p,); covariance (p, p); residual (n,); condition of X with unit
    columns, condition_raw of X as given; freedom of the variance; relative_error |r|/|y|.
    """

    values: Array
    covariance: Array
    residual: Array
    condition: float
    condition_raw: float
    freedom: float
    relative_error: float

    @property
    def standard_error(self) -> Array:
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def interval(self, index: int) -> tuple[float, float]:
        """The 95 % interval of parameter `index`."""
        half = student_quantile(self.freedom) * float(self.standard_error[index])
        return float(self.values[index]) - half, float(self.values[index]) + half


def inverse_of(matrix: Array) -> Array:
    """Raises NumPy's `LinAlgError` for a matrix that has none."""
    return np.asarray(np.linalg.inv(matrix), dtype=float)


def solution_of(matrix: Array, right: Array) -> Array:
    """Of matrix x = right."""
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


def closest(design: Array, observed: Array) -> Array:
    """The values (p,) of least squares alone, without their errors."""
    return np.asarray(np.linalg.lstsq(design, observed, rcond=None)[0], dtype=float)


def _persistence(residual: Array) -> float:
    """Of an AR(1) fit to a residual, from its integral correlation length in samples (1 + rho)/(1 - rho)."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power <= 0.0 or len(centred) < 3:
        return 0.0
    rho = min(max(float(centred[1:] @ centred[:-1]) / power, 0.0), 0.9999)
    length = (1.0 + rho) / (1.0 - rho)
    return (length - 1.0) / (length + 1.0)


def bartlett_sum(scores: Array, rho: float) -> tuple[Array, float]:
    """S (p, p) of scores (n, p) by Bartlett weights over lags, and how many independent ones they are worth.

    The lag is Andrews' automatic one of an AR(1) approximation with this persistence.
    """
    n = len(scores)
    alpha = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    lag = int(min(math.ceil(1.1447 * (alpha * n) ** (1.0 / 3.0)), n // 5))
    total = scores.T @ scores
    for k in range(1, lag + 1):
        cross = scores[k:].T @ scores[:-k]
        total = total + (1.0 - k / (lag + 1.0)) * (cross + cross.T)
    return total, n / (1.0 + 2.0 * lag / 3.0)


def _block_scores(design: Array, residual: Array, starts: Array) -> tuple[Array, float]:
    """S by contiguous blocks that begin at `starts`."""
    sums = np.add.reduceat(design * residual[:, None], starts.astype(np.intp), axis=0)
    return sums.T @ sums * len(sums) / max(len(sums) - 1, 1), float(len(sums) - 1)


def solve(
    design: Array, observed: Array, *, block_starts: Array | None = None, where: str = "design"
) -> LinearFit:
    """Least squares of `observed` (n,) on `design` (n, p), covariance by lags or by the given blocks.

    Raises `IdentificationError` when there are too few samples, a value is not finite, or a column is empty or a
    combination of others.
    """
    n, p = design.shape
    if n <= p + 1:
        raise IdentificationError(
            "too few samples for this fit", where=where, value=n, limit=f"> {p + 1}"
        )
    scale = np.linalg.norm(design, axis=0)
    if not (np.isfinite(scale).all() and np.isfinite(observed).all()):
        unusable = [f"column {k}" for k in np.flatnonzero(~np.isfinite(scale))]
        raise IdentificationError(
            "holds a value that is not a number, or is infinite",
            where=where,
            value=", ".join(unusable) or "what is observed",
            remedy="Leave those rows out before the fit.",
        )
    if not np.all(scale > 0.0):
        column = int(np.argmin(scale))
        raise IdentificationError(
            "has a regressor that is zero throughout", where=where, value=f"column {column}"
        )
    left, singular, right = np.linalg.svd(design / scale, full_matrices=False)
    condition = float(singular[0] / max(singular[-1], np.finfo(float).tiny))
    if condition > CONDITION_LIMIT:
        raise IdentificationError(
            "the data cannot separate the parameters",
            where=where,
            value=f"condition number {condition:.3g}",
            limit=f"<= {CONDITION_LIMIT:g}",
            remedy="Excite the motion more richly, or ask for fewer parameters.",
        )
    values = (right.T @ ((left.T @ observed) / singular)) / scale
    residual = observed - design @ values
    inverse = (right.T / singular**2) @ right / np.outer(scale, scale)
    if block_starts is None:
        score, effective = bartlett_sum(design * residual[:, None], _persistence(residual))
        effective -= p
    else:
        score, effective = _block_scores(design, residual, block_starts)
    freedom = max(effective, 1.0)
    covariance = inverse @ score @ inverse * (n / (n - p))
    # Those of the columns as they are: the orthonormal factor, the only long one, changes no singular value.
    raw = np.linalg.svd(singular[:, None] * right * scale, compute_uv=False)
    return LinearFit(
        values=values,
        covariance=covariance,
        residual=residual,
        condition=condition,
        condition_raw=float(raw[0] / raw[-1]),
        freedom=freedom,
        relative_error=quotient(float(np.linalg.norm(residual)), float(np.linalg.norm(observed))),
    )
