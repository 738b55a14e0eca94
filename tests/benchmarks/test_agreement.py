"""E_n of two results: what both share does not count."""

from __future__ import annotations

import numpy as np
import pytest

from model.identify.estimate import BudgetLine, Cause, Estimate
from tests.benchmarks.agreement_study import agreement, normalised_error


def estimate(value: float, scatter: float, shared: float) -> Estimate:
    lines = (
        BudgetLine("scatter between revolutions and points", "A", scatter),
        BudgetLine("torque scale", "B", shared, cause=Cause.TORQUE_SCALE),
        BudgetLine("output bearing", "B", shared),
    )
    return Estimate(
        name="coulomb",
        value=value,
        unit="N",
        low=value - 2.0 * scatter,
        high=value + 2.0 * scatter,
        budget=lines,
    )


def test_an_error_that_both_share_does_not_make_them_agree() -> None:
    a, b = estimate(70.0, 0.5, 10.0), estimate(73.0, 0.5, 10.0)
    assert normalised_error(a, b) == pytest.approx(-3.0 / (1.96 * 0.5 * np.sqrt(2.0)), rel=1e-3)


def test_honest_results_agree_in_about_95_of_100_pairs() -> None:
    random = np.random.default_rng(5)
    shared = 10.0 * random.standard_normal(400)
    values = shared + 70.0 + 0.5 * random.standard_normal((2, 400))
    pairs = [(estimate(a, 0.5, 10.0), estimate(b, 0.5, 10.0)) for a, b in values.T]
    count, share = agreement(pairs)["coulomb"]
    assert count == 400
    assert 0.92 <= share <= 0.98
