"""The coverage factor of a sum of two errors of which one has most of the variance.

Welch and Satterthwaite's formula takes the sum for Student's t. Where one contribution has nearly all of the
variance the sum has that contribution's shape: U of a rectangular error alone is 0.95 of its half-width,
k = 1.65 and not 1.96. So the distribution of the sum is computed (JCGM 101, 5.2):

    P(|D + R| <= U) = integral over q in (0, 1) of F_D(U - R(q)) - F_D(-U - R(q))

with the distribution function F_D of the large one and the quantiles R(q) of all the others together, in the
middle of equal shares of probability. The large one enters by its distribution function, so that what is left is
smooth, and exact where there is nothing beside it.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.identify.checks import Array
from model.identify.distribution import Distribution

_SHARES = 200
_MIDDLES = (np.arange(_SHARES) + 0.5) / _SHARES
_LEVEL = 0.95


@functools.lru_cache(maxsize=4096)
def dominated_factor(
    distribution: Distribution, freedom: float, share: float, rest_freedom: float
) -> float:
    """k at 95 % of a large error with this share of the combined standard uncertainty beside a rest.

    `freedom`, `rest_freedom`: degrees of freedom of either; the large one's count where its distribution is normal.
    """
    rest = math.sqrt(max(1.0 - share**2, 0.0)) * _quantiles(rest_freedom)

    def within(factor: float) -> float:
        inside = _probability(distribution, freedom, (factor - rest) / share)
        inside -= _probability(distribution, freedom, (-factor - rest) / share)
        return float(inside.mean()) - _LEVEL

    low, high = 0.0, 4.0
    while within(high) < 0.0:
        low, high = high, 2.0 * high
    # Halved and halved again: to import a library's search for roots takes a hundred times longer.
    while high - low > 1e-8:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if within(middle) > 0.0 else (middle, high)
    return high


def _quantiles(freedom: float) -> Array:
    """Quantiles of what stands beside it, in its standard uncertainty: Student's t."""
    if math.isinf(freedom):
        return np.asarray(scipy.special.ndtri(_MIDDLES), dtype=np.float64)
    return np.asarray(scipy.special.stdtrit(freedom, _MIDDLES), dtype=np.float64)


def _probability(distribution: Distribution, freedom: float, value: Array) -> Array:
    """Distribution function of an error of mean zero in its standard uncertainty."""
    if distribution is Distribution.RECTANGULAR:
        return np.clip(0.5 + value / math.sqrt(12.0), 0.0, 1.0)
    if distribution is Distribution.ARCSINE:
        inside = np.clip(value / math.sqrt(2.0), -1.0, 1.0)
        return 0.5 + np.arcsin(inside) / math.pi
    if math.isinf(freedom):
        return np.asarray(scipy.special.ndtr(value), dtype=np.float64)
    return np.asarray(scipy.special.stdtr(freedom, value), dtype=np.float64)
