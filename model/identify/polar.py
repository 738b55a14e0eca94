"""Amplitude and phase of an order: a cos(v theta) + b sin(v theta) = amplitude cos(v theta - phase), with intervals.

The length of a vector that has noise follows Rice's distribution: it is never below zero and is
biased upwards where it is small. The interval of the true amplitude is every one that would have
given the found length with more than 2.5 % on either side; its low end is 0 where noise alone would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy  # pyright: ignore[reportMissingTypeStubs]

from model.arrays import quotient
from model.identify.checks import Array
from model.identify.estimate import NOT_FROM_ZERO, BudgetLine, Estimate
from model.identify.least_squares import student_quantile
from model.unit_text import amount_in_words

_NORMAL_QUANTILE = 1.959963984540054
_ALMOST_NORMAL = 8.0
"""Amplitude in standard uncertainties from which Rice's distribution is a normal one."""
_LEAST_CHANCE = 0.06
"""Square of the length, in variances, below which any smaller amplitude is as likely: the high end falls no further."""
_SIGNIFICANT = 18.42
"""Squared length in variances that noise alone exceeds once in ten thousand orders: a fit has dozens of them."""
RESIDUAL = "residual, spectrum beside the order"
UNKNOWN = math.pi / math.sqrt(3.0)
"""Standard uncertainty of a phase of which nothing is known [rad]."""


def rice_interval(length: float, error: float) -> tuple[float, float]:
    """The 95 % interval of an amplitude whose found length has the standard uncertainty `error` per component."""
    if not error > 0.0:
        return length, length
    if length > _ALMOST_NORMAL * error:
        return length - _NORMAL_QUANTILE * error, length + _NORMAL_QUANTILE * error
    square = (length / error) ** 2
    low = 0.0
    if scipy.special.chndtr(square, 2.0, 0.0) > 0.975:
        low = float(scipy.special.chndtrinc(square, 2.0, 0.975))
    high = float(scipy.special.chndtrinc(max(square, _LEAST_CHANCE), 2.0, 0.025))
    return error * math.sqrt(low), error * math.sqrt(high)


@dataclass(frozen=True, kw_only=True)
class Polar:
    """An order as amplitude and phase with their estimates; `significant`: above what noise explains (99.99 %)."""

    amplitude: Estimate
    phase: Estimate
    significant: bool


def polar(
    label: str,
    vector: Array,
    covariance: Array,
    freedom: float,
    unit: str,
    shared: tuple[tuple[BudgetLine, Array], ...] = (),
) -> Polar:
    """Amplitude and phase of (a, b) with covariance (2, 2) of the data.

    `shared` are errors of type B that belong to the interval all the same, because they come from a
    correction of this vector: the line that names each (its u is filled in) and the change of the
    vector by one standard uncertainty.
    """
    a, b = float(vector[0]), float(vector[1])
    size, phase = math.hypot(a, b), math.atan2(b, a)
    along = np.array([math.cos(phase), math.sin(phase)])
    across = np.array([-along[1], along[0]])
    whole = np.array(covariance)
    for _, change in shared:
        whole = whole + np.outer(change, change)
    low, high, turn = _intervals(size, _error(along, whole), _error(across, whole), freedom)
    significant = _squared_length(a, b, whole) > _SIGNIFICANT
    verdict, of_amplitude, of_phase = "yes", "", ""
    if not significant:
        verdict, of_phase = "weakly", f"of an amplitude {NOT_FROM_ZERO}"
        of_amplitude = f"{NOT_FROM_ZERO}, below {amount_in_words(high, unit, high)}"
    amplitude = Estimate(
        name=f"amplitude_{label}",
        value=size,
        unit=unit,
        low=low,
        high=max(high, size),
        identifiable=verdict,
        note=of_amplitude,
        budget=_budget(along, covariance, freedom, shared),
    )
    return Polar(
        amplitude=amplitude,
        phase=Estimate.about(
            f"phase_{label}",
            phase,
            turn,
            "rad",
            over_amplitude(_budget(across, covariance, freedom, shared), size),
            identifiable=verdict,
            note=of_phase,
        ),
        significant=significant,
    )


def _intervals(
    size: float, radial: float, tangential: float, freedom: float
) -> tuple[float, float, float]:
    """Low and high end of an amplitude and half the width of its phase, by the noise along and across its vector."""
    error, turn = radial, math.pi
    if size <= _ALMOST_NORMAL * radial:
        error = math.sqrt(0.5 * (radial**2 + tangential**2))
    quantile = student_quantile(freedom)
    if size > 0.0:
        turn = min(quantile * tangential / size, math.pi)
    return *rice_interval(size, quantile / _NORMAL_QUANTILE * error), turn


def _squared_length(a: float, b: float, covariance: Array) -> float:
    """The square of a vector's length in its variances (Mahalanobis)."""
    (xx, xy), (_, yy) = covariance.tolist()
    determinant = xx * yy - xy * xy
    length = a * a * yy - 2.0 * a * b * xy + b * b * xx
    return quotient(length, determinant, 0.0)


def _budget(
    direction: Array,
    covariance: Array,
    freedom: float,
    shared: tuple[tuple[BudgetLine, Array], ...],
) -> tuple[BudgetLine, ...]:
    """What the residual and each shared error change of a vector in a direction."""
    return (
        BudgetLine(RESIDUAL, "A", _error(direction, covariance), degrees_of_freedom=freedom),
        *(
            replace(line, standard_uncertainty=abs(float(direction @ change)))
            for line, change in shared
        ),
    )


def over_amplitude(lines: tuple[BudgetLine, ...], amplitude: float) -> tuple[BudgetLine, ...]:
    """Lines across a vector as lines of its phase [rad]; none exceeds that of a phase of which nothing is known."""
    if not amplitude > 0.0:
        return ()
    return tuple(
        replace(line, standard_uncertainty=min(line.standard_uncertainty / amplitude, UNKNOWN))
        for line in lines
    )


def _error(direction: Array, covariance: Array) -> float:
    return math.sqrt(max(float(direction @ covariance @ direction), 0.0))
