"""The curve of an encoder's certificate: what it takes off, how well, and which points are no curve."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from model.angle_certificate import CERTIFIED_ORDERS, AngleCertificate
from model.errors import ParameterError
from model.units import ARCSEC, DEGREE, REVOLUTION

U = 0.4 * ARCSEC


def curve(angle: np.ndarray) -> np.ndarray:
    """4 arcsec once, 1 twice and 0.5 eight times per revolution."""
    return ARCSEC * (
        4.0 * np.cos(angle - 0.7) + np.sin(2.0 * angle) + 0.5 * np.cos(8.0 * angle - 2.0)
    )


def certificate(points: int = 36, noise: np.ndarray | float = 0.0) -> AngleCertificate:
    angle = np.arange(points) * (REVOLUTION / points)
    return AngleCertificate(
        angles=tuple(angle.tolist()),
        errors=tuple((curve(angle) + noise).tolist()),
        expanded_uncertainties=(U,) * points,
        coverage_factor=2.0,
    )


@pytest.mark.parametrize("points", [18, 36, 200])
def test_the_curve_comes_back_between_its_points_and_is_nothing_at_the_mark(points: int) -> None:
    angle = np.linspace(-9.0, 9.0, 501)
    expected = curve(angle) - curve(np.zeros(1))
    np.testing.assert_allclose(certificate(points).error_at(angle), expected, atol=1e-6 * ARCSEC)


def test_points_that_are_not_even_and_close_the_circle_tell_the_same() -> None:
    even = np.arange(37) * (10.0 * DEGREE)
    angle = np.sort(np.append(even, 33.0 * DEGREE))
    made = AngleCertificate(
        angles=tuple(angle.tolist()),
        errors=tuple(curve(angle).tolist()),
        expanded_uncertainties=(U,) * len(angle),
    )
    np.testing.assert_allclose(made.waves, certificate().waves, atol=1e-9 * ARCSEC)


def test_a_point_that_is_known_badly_counts_little() -> None:
    good = certificate()
    errors, uncertainties = list(good.errors), list(good.expanded_uncertainties)
    errors[5] += 20.0 * ARCSEC
    uncertainties[5] = 100.0 * ARCSEC
    made = dataclasses.replace(
        good, errors=tuple(errors), expanded_uncertainties=tuple(uncertainties)
    )
    np.testing.assert_allclose(made.waves, good.waves, atol=1e-3 * ARCSEC)


def test_its_uncertainty_is_that_of_its_points() -> None:
    assert certificate().standard_uncertainty == pytest.approx(U / 2.0)
    with_three = dataclasses.replace(certificate(), coverage_factor=3.0)
    assert with_three.standard_uncertainty == pytest.approx(U / 3.0)


def test_points_beside_the_series_make_it_larger_by_so_much() -> None:
    """An order 12 that the series has not is left in every angle that is corrected."""
    angle = np.arange(36) * (10.0 * DEGREE)
    finer = certificate(noise=3.0 * ARCSEC * np.cos(12.0 * angle))
    beside = float(np.std(3.0 * ARCSEC * np.cos(12.0 * angle)))
    assert finer.standard_uncertainty == pytest.approx(beside, rel=1e-6)


def test_its_half_width_holds_the_curve_and_its_uncertainty() -> None:
    errors = certificate().errors
    assert certificate().half_width == pytest.approx(0.5 * (max(errors) - min(errors)) + U)
    assert len(CERTIFIED_ORDERS) == 8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coverage_factor": 0.5}, "coverage_factor: is no coverage factor.*0.5"),
        ({"coverage_factor": math.nan}, "coverage_factor"),
        ({"errors": certificate().errors[:-1]}, "unequal length; value 36, 35, 36"),
        ({"angles": (*certificate().angles[:-1], 7.0)}, "point 36.*outside one revolution.*401"),
        ({"angles": (-0.1, *certificate().angles[1:])}, "point 1 of.*-5.7"),
        ({"errors": (0.1, *certificate().errors[1:])}, "point 1 of.*too large.*unit"),
        ({"errors": (math.nan, *certificate().errors[1:])}, "point 1 of.*nan"),
        ({"expanded_uncertainties": (0.0,) * 36}, "point 1 of.*not positive"),
        (
            {
                "angles": (
                    certificate().angles[1],
                    certificate().angles[0],
                    *certificate().angles[2:],
                )
            },
            "point 2 of.*0 deg after 10 deg",
        ),
    ],
)
def test_what_is_no_certificate_is_refused_by_place_and_value(
    change: dict[str, object], words: str
) -> None:
    with pytest.raises(ParameterError, match=words):
        dataclasses.replace(certificate(), **change)  # type: ignore[arg-type]


def test_points_too_far_apart_are_refused_where_the_gap_is() -> None:
    whole = certificate()
    keep = [k for k in range(36) if not 9 < k < 13]
    with pytest.raises(ParameterError, match=r"after point 10 .*40 deg, allowed 21\.18 deg"):
        AngleCertificate(
            angles=tuple(whole.angles[k] for k in keep),
            errors=tuple(whole.errors[k] for k in keep),
            expanded_uncertainties=(U,) * len(keep),
        )
    with pytest.raises(ParameterError, match="has no points"):
        AngleCertificate(angles=(), errors=(), expanded_uncertainties=())
