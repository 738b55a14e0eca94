"""Variable projection finds the Stribeck curve, its intervals cover, and the genetic search agrees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.errors import IdentificationError
from model.identify.stribeck import (
    fit_stribeck,
    fit_stribeck_genetic,
    profile_intervals,
    stribeck_curve,
    stribeck_jacobian,
)
from model.units import RPM

TRUTH = np.array([100.0, 160.0, 10.0, 1.0, 0.3])


def measured(seed: int, truth: np.ndarray = TRUTH, *, noise: float = 0.01, slowest: float = 1.0):
    random = np.random.default_rng(seed)
    speed = np.concatenate([np.geomspace(slowest, 3000.0, 30)] * 2) * RPM
    force = stribeck_curve(speed, truth)
    error = noise * force
    return speed, force + error * random.standard_normal(len(speed)), error


@settings(max_examples=40)
@given(
    coulomb=st.floats(20.0, 150.0),
    rise=st.floats(1.1, 2.0),
    velocity=st.floats(2.0, 30.0),
    shape=st.floats(0.6, 2.0),
    viscous=st.floats(0.01, 1.0),
)
def test_exact_data_give_the_exact_parameters(
    coulomb: float, rise: float, velocity: float, shape: float, viscous: float
) -> None:
    truth = np.array([coulomb, coulomb * rise, velocity, shape, viscous])
    speed, _force, error = measured(0, truth, noise=1e-3)
    fit = fit_stribeck(speed, stribeck_curve(speed, truth), error)
    np.testing.assert_allclose(fit.fitted, stribeck_curve(speed, truth), rtol=2e-5)
    np.testing.assert_allclose(fit.values, truth, rtol=0.02)


def test_the_jacobian_is_the_derivative_of_the_curve() -> None:
    speed = np.geomspace(0.1, 300.0, 20)
    for k in range(5):
        up, down = TRUTH.copy(), TRUTH.copy()
        up[k] *= 1 + 1e-6
        down[k] *= 1 - 1e-6
        slope = (stribeck_curve(speed, up) - stribeck_curve(speed, down)) / (2e-6 * TRUTH[k])
        np.testing.assert_allclose(
            stribeck_jacobian(speed, TRUTH)[:, k], slope, rtol=1e-5, atol=1e-8
        )


def test_profile_intervals_cover_and_are_not_wide() -> None:
    speed, _, error = measured(0)
    weighted = stribeck_jacobian(speed, TRUTH) / error[:, None]
    bound = np.sqrt(np.diag(np.linalg.inv(weighted.T @ weighted)))
    inside, widths = [], []
    for seed in range(200):
        data = measured(seed)
        intervals = profile_intervals(fit_stribeck(*data), *data)
        inside.append((intervals[:, 0] <= TRUTH) & (intervals[:, 1] >= TRUTH))
        widths.append(intervals[:, 1] - intervals[:, 0])
    assert 0.92 <= np.mean(inside) <= 0.98
    assert np.all(np.mean(widths, axis=0) < 1.2 * 2.0 * 1.96 * bound)


def test_the_genetic_search_reaches_the_same_minimum() -> None:
    data = measured(7)
    fit, search = fit_stribeck(*data), fit_stribeck_genetic(*data, seed=3)
    assert search.chi_square >= fit.chi_square * (1 - 1e-9)
    assert search.chi_square == pytest.approx(fit.chi_square, rel=1e-3)
    np.testing.assert_allclose(search.values, fit.values, rtol=0.02)
    assert search.evaluations > 1000


def test_fast_data_leave_the_stribeck_part_open() -> None:
    data = measured(1, slowest=60.0)
    intervals = profile_intervals(fit_stribeck(*data), *data)
    slow = measured(1)
    pinned = profile_intervals(fit_stribeck(*slow), *slow)
    width = np.where(
        np.isfinite(intervals[:, 1] - intervals[:, 0]), intervals[:, 1] - intervals[:, 0], np.inf
    )
    assert np.all(width[1:4] > 4.0 * (pinned[1:4, 1] - pinned[1:4, 0]))


def test_a_friction_that_falls_with_speed_stops_at_its_bound() -> None:
    speed, _, error = measured(2, noise=1e-3)
    force = stribeck_curve(speed, [100.0, 160.0, 10.0, 1.0, -0.05])
    fit = fit_stribeck(speed, force, error)
    assert "viscous" in fit.at_bound
    assert fit.values[4] == 0.0
    assert fit.values[1] >= fit.values[0]
    # Zero is the least that friction can be: the interval ends there, it is not left open.
    low, high = profile_intervals(fit, speed, force, error)[4]
    assert low == 0.0
    assert 0.0 < high < 0.1


def test_bad_points_are_refused() -> None:
    speed, force, error = measured(0)
    with pytest.raises(IdentificationError, match="zero"):
        fit_stribeck(np.where(np.arange(60) == 3, 0.0, speed), force, error)
    with pytest.raises(IdentificationError, match="standard_error"):
        fit_stribeck(speed, force, 0.0 * error)
    with pytest.raises(IdentificationError, match="different speeds"):
        fit_stribeck(np.repeat([1.0, 2.0, 3.0], 10), np.ones(30), np.ones(30))
    with pytest.raises(IdentificationError, match="finite"):
        fit_stribeck(speed, np.where(np.arange(60) == 3, np.nan, force), error)
