"""The curve of an encoder's certificate: what the encoder shows too much over one revolution from its index mark.

    e(phi) = shown - true = sum_k (a_k cos k phi + b_k sin k phi),  k = 1 ... 8

phi is counted from the index mark, in the sense in which the encoder counts up. The series is fitted
to the points of the certificate, weighed by their uncertainties. A certificate does not say how the
errors of its points hang together: the eccentricity of a coupling is one wave, reading errors are
many. So any order may carry all of its uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.arrays import FloatArray
from model.errors import ParameterError
from model.units import DEGREE, REVOLUTION

CERTIFIED_ORDERS = (1, 2, 3, 4, 5, 6, 7, 8)
"""Orders of the encoder's own revolution that are taken out by its certificate."""
CREST = 2.5
"""Largest value of a curve of many orders over its r.m.s."""
_LARGEST_GAP = REVOLUTION / (2 * len(CERTIFIED_ORDERS) + 1)
"""rad; points further apart do not tell the highest of these orders."""
LARGEST_ERROR = 1.0 * DEGREE
"""rad; an encoder that is further out has another unit, or another table."""
_COVERAGE_FACTORS = (1.0, 4.0)
_POINTS, COVERAGE_FACTOR = 36, 2.0
"""Points and coverage factor of a curve that is given by its orders."""


@dataclass(frozen=True, kw_only=True)
class AngleCertificate:
    """Points of a certificate, ascending within one revolution [rad]: angle, error (shown - true), and the expanded
    uncertainty of the error. `coverage_factor` is the k of that uncertainty.

    Raises `ParameterError` for points that are no curve over a whole revolution.
    """

    angles: tuple[float, ...]
    errors: tuple[float, ...]
    expanded_uncertainties: tuple[float, ...]
    coverage_factor: float = 2.0

    def __post_init__(self) -> None:
        _check_factor(self.coverage_factor)
        columns = (self.angles, self.errors, self.expanded_uncertainties)
        if len({len(column) for column in columns}) != 1:
            raise ParameterError(
                "the columns of a certificate are of unequal length",
                where="certificate",
                value=", ".join(str(len(column)) for column in columns),
            )
        for number, point in enumerate(zip(*columns, strict=True), start=1):
            _check_point(number, *point)
        _check_round(np.array(self.angles))

    def __repr__(self) -> str:
        return f"AngleCertificate({len(self.angles)} points, {hash(self):x})"

    @cached_property
    def waves(self) -> FloatArray:
        """Cosines and sines of the orders 1 to 8 of the curve [rad], (8, 2)."""
        return self._fit[0][:-1].reshape(-1, 2)

    @cached_property
    def standard_uncertainty(self) -> float:
        """Of the curve at any angle [rad]: the points' own, and by how much more they lie beside the series."""
        stated = float(np.mean(self._uncertainties**2))
        beside = float(np.mean((np.array(self.errors) - self._fit[1]) ** 2))
        return math.sqrt(stated + max(beside - stated, 0.0))

    @property
    def half_width(self) -> float:
        """What the encoder is out by at most where its curve is known and not taken out [rad]."""
        return 0.5 * float(np.ptp(self.errors)) + max(self.expanded_uncertainties)

    def error_at(self, angle: FloatArray) -> FloatArray:
        """What the encoder shows too much at angles from its index mark [rad], less that at the mark itself."""
        total = np.full(np.shape(angle), -float(self.waves[:, 0].sum()))
        for order, (cosine, sine) in zip(CERTIFIED_ORDERS, self.waves, strict=True):
            total += cosine * np.cos(order * angle) + sine * np.sin(order * angle)
        return total

    @property
    def _uncertainties(self) -> FloatArray:
        return np.array(self.expanded_uncertainties) / self.coverage_factor

    @cached_property
    def _fit(self) -> tuple[FloatArray, FloatArray]:
        """Cosines and sines of the orders, then the constant; and the fitted errors at the points."""
        phase = np.outer(np.array(self.angles), np.array(CERTIFIED_ORDERS))
        waves = np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(phase), -1)
        matrix = np.column_stack([waves, np.ones(len(phase))])
        weight = 1.0 / self._uncertainties
        values: FloatArray = np.linalg.lstsq(
            matrix * weight[:, None], np.array(self.errors) * weight, rcond=None
        )[0].astype(np.float64)
        return values, matrix @ values


def _check_factor(factor: float) -> None:
    low, high = _COVERAGE_FACTORS
    if not low <= factor <= high:
        raise ParameterError(
            "is no coverage factor of an expanded uncertainty",
            where="coverage_factor",
            value=factor,
            limit=f"{low:g} to {high:g}",
        )


def _check_point(number: int, angle: float, error: float, uncertainty: float) -> None:
    where = f"point {number} of the certificate"
    if not 0.0 <= angle <= REVOLUTION + 1e-9:
        raise ParameterError(
            "an angle lies outside one revolution",
            where=where,
            value=f"{angle / DEGREE:.6g} deg",
            limit="0 to 360 deg from the index mark",
        )
    if not abs(error) <= LARGEST_ERROR:
        raise ParameterError(
            "an error is too large for an encoder",
            where=where,
            value=f"{error / DEGREE:.6g} deg",
            limit=f"{LARGEST_ERROR / DEGREE:g} deg",
            remedy="Check the unit of the column.",
        )
    if not 0.0 < uncertainty <= LARGEST_ERROR:
        raise ParameterError(
            "an expanded uncertainty is not positive, or too large",
            where=where,
            value=f"{uncertainty / DEGREE:.6g} deg",
            limit=f"above 0, up to {LARGEST_ERROR / DEGREE:g} deg",
        )


def _check_round(angles: FloatArray) -> None:
    """Raise unless the points go round once, in order, close enough for the highest order."""
    if len(angles) == 0:
        raise ParameterError("has no points", where="certificate", value=0)
    gaps = np.diff(np.append(angles, angles[0] + REVOLUTION))
    back = np.flatnonzero(gaps[:-1] <= 0.0)
    if len(back):
        raise ParameterError(
            "the angles do not ascend",
            where=f"point {int(back[0]) + 2} of the certificate",
            value=f"{angles[back[0] + 1] / DEGREE:.6g} deg after {angles[back[0]] / DEGREE:.6g} deg",
        )
    widest = int(np.argmax(gaps))
    if gaps[widest] > _LARGEST_GAP * (1.0 + 1e-9):
        raise ParameterError(
            "the points are too far apart to tell order 8 of the encoder's revolution",
            where=f"after point {widest + 1} of the certificate",
            value=f"{gaps[widest] / DEGREE:.4g} deg",
            limit=f"{_LARGEST_GAP / DEGREE:.4g} deg",
            remedy="Take a certificate with at least 18 points a revolution.",
        )


def curve_of(waves: FloatArray, expanded_uncertainty: float) -> AngleCertificate:
    """The points of orders 1 to 8 given as cosines and sines (8, 2) [rad]."""
    angle = np.arange(_POINTS) * (REVOLUTION / _POINTS)
    phase = np.outer(angle, np.array(CERTIFIED_ORDERS))
    error = np.cos(phase) @ waves[:, 0] + np.sin(phase) @ waves[:, 1]
    return AngleCertificate(
        angles=tuple(angle.tolist()),
        errors=tuple(error.tolist()),
        expanded_uncertainties=(expanded_uncertainty,) * _POINTS,
        coverage_factor=COVERAGE_FACTOR,
    )
