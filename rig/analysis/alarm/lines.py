"""Least squares of a series of runs whose neighbours are alike: coefficients with the covariance that belongs to them.

    b = (M'M)^-1 M' x ,   cov b = s^2 (M'M)^-1 M' R M (M'M)^-1 ,   R_ij = r^|i-j|
    s^2 = e'e / tr(P R) ,   nu = tr(P R)^2 / tr(P R P R) ,   P = I - M (M'M)^-1 M'

With r = 0 these are the usual ones; with the correlation r of neighbouring runs that thresholds assume, an interval is
as wide as days that are alike make it. nu by Satterthwaite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """Coefficients, covariance, degrees of freedom (0 where no residual is left), and the scatter of one run."""

    coefficients: Array
    covariance: Array
    freedom: float
    scatter: float

    @property
    def quantile(self) -> float:
        """Two-sided 95 % of Student's t."""
        return float(stdtrit(self.freedom, 0.975))


def line(values: Array, matrix: Array, correlation: float) -> Line:
    """Fit the columns of a matrix (runs, columns) to values of neighbouring runs of this correlation."""
    runs, columns = matrix.shape
    inverse = np.linalg.pinv(matrix.T @ matrix)
    coefficients = inverse @ matrix.T @ values
    residual = values - matrix @ coefficients
    places = np.arange(runs)
    alike = correlation ** np.abs(places[:, None] - places[None, :])
    left = (np.eye(runs) - matrix @ inverse @ matrix.T) @ alike
    trace = float(np.trace(left))
    if runs - int(np.linalg.matrix_rank(matrix)) < 1:
        return Line(coefficients, np.full((columns, columns), np.inf), 0.0, np.inf)
    square = float(residual @ residual) / trace
    covariance = square * inverse @ matrix.T @ alike @ matrix @ inverse
    return Line(coefficients, covariance, trace**2 / float(np.trace(left @ left)), square**0.5)
