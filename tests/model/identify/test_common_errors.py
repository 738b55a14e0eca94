"""Errors that points share: how far visits to one speed differ, and waves over the output."""

from __future__ import annotations

import numpy as np
import pytest

from model.identify.common_errors import means_by, spread_beyond, whitening_of

SPEEDS, VISITS = 15, 3
LEVEL = np.repeat(np.arange(float(SPEEDS)), VISITS)


def places(seed: int) -> np.ndarray:
    at = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(LEVEL))
    return np.column_stack([f(k * at) for k in (1, 2) for f in (np.cos, np.sin)])


def test_the_scatter_of_visits_is_found_and_a_curve_that_misses_is_none() -> None:
    found = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        missed = 0.1 * np.sin(LEVEL)
        relative = missed + 0.004 * random.standard_normal(len(LEVEL))
        nothing = np.empty((len(LEVEL), 0))
        error = np.full(len(LEVEL), 1e-3)
        found.append(spread_beyond(means_by(LEVEL), relative, error, nothing, nothing)[0])
    assert np.mean(found) == pytest.approx(np.sqrt(0.004**2 - 0.001**2), rel=0.15)


def test_waves_over_the_output_are_told_from_scatter() -> None:
    sizes, false = [], 0
    for seed in range(20):
        random, waves = np.random.default_rng(100 + seed), places(seed)
        noise = 0.001 * random.standard_normal(len(LEVEL))
        error = np.full(len(LEVEL), 3e-4)
        nothing = np.empty((len(LEVEL), 0))
        amplitude = 0.01 * random.standard_normal(waves.shape[1])
        free = means_by(LEVEL)
        sizes.append(spread_beyond(free, noise + waves @ amplitude, error, nothing, waves)[1])
        false += spread_beyond(free, noise, error, nothing, waves)[1] > 0.0
    assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(0.01, rel=0.3)
    assert false <= 3


def test_whitening_is_the_inverse_of_the_covariance() -> None:
    random = np.random.default_rng(3)
    error, common = random.uniform(0.5, 2.0, 8), random.standard_normal((8, 2))
    whitening = whitening_of(error, common)
    covariance = np.diag(error**2) + common @ common.T
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(8), atol=1e-12)
