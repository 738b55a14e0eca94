"""U = k u: Welch and Satterthwaite, Student's t."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.identify.estimate import (
    NORMAL_COVERAGE_FACTOR,
    BudgetLine,
    Distribution,
    Estimate,
    coverage_factor,
    effective_degrees_of_freedom,
)


def line(u: float, freedom: float = math.inf) -> BudgetLine:
    kind = "A" if freedom < math.inf else "B"
    return BudgetLine("x", kind, u, degrees_of_freedom=freedom)


def estimate(*lines: BudgetLine) -> Estimate:
    return Estimate(name="x", value=1.0, unit="1", low=0.9, high=1.1, budget=lines)


@pytest.mark.parametrize(
    ("freedom", "k"), [(1, 12.706), (5, 2.571), (10, 2.228), (50, 2.009), (math.inf, 1.960)]
)
def test_k_is_the_quantile_of_students_t(freedom: float, k: float) -> None:
    """The table G.2 of the GUM, 95 %."""
    assert coverage_factor(freedom) == pytest.approx(k, abs=6e-4)
    assert estimate(line(0.1, freedom)).expanded_uncertainty == pytest.approx(0.1 * k, abs=6e-5)


def test_degrees_of_freedom_combine_by_welch_and_satterthwaite() -> None:
    lines = (line(3.0, 4.0), line(4.0, 9.0), line(5.0))
    freedom = 50.0**2 / (81.0 / 4.0 + 256.0 / 9.0)
    assert effective_degrees_of_freedom(lines) == pytest.approx(freedom)
    made = estimate(*lines)
    assert made.degrees_of_freedom == pytest.approx(freedom)
    assert made.expanded_uncertainty == pytest.approx(
        coverage_factor(freedom) * math.sqrt(50.0), rel=1e-12
    )
    assert effective_degrees_of_freedom((line(1.0), line(2.0))) == math.inf


@pytest.mark.parametrize("u", [math.inf, 0.1])
def test_a_line_without_a_degree_of_freedom_leaves_no_interval(u: float) -> None:
    """As many points as coefficients: their scatter is not known at all, however well the rest is."""
    made = estimate(line(u, 0.0), line(0.2, 9.0))
    assert made.degrees_of_freedom == 0.0
    assert made.expanded_uncertainty == math.inf
    assert effective_degrees_of_freedom((line(0.0, 0.0), line(1.0, 7.0))) == pytest.approx(7.0)
    assert effective_degrees_of_freedom((line(math.inf, 1.0), line(0.2))) == 1.0


def test_json_has_k_and_degrees_of_freedom_and_no_infinity() -> None:
    answer = estimate(line(3.0, 4.0), line(5.0)).as_json()
    assert answer["degrees_of_freedom"] == pytest.approx(34.0**2 / (81.0 / 4.0))
    assert answer["coverage_factor"] == pytest.approx(2.002, abs=1e-3)
    assert [b["degrees_of_freedom"] for b in answer["budget"]] == [4.0, None]  # type: ignore[attr-defined]
    assert estimate(line(5.0)).as_json()["degrees_of_freedom"] is None


def test_without_a_budget_u_is_the_half_width_of_the_interval() -> None:
    made = estimate()
    assert made.expanded_uncertainty == pytest.approx(0.1)
    assert made.standard_uncertainty == pytest.approx(0.1 / NORMAL_COVERAGE_FACTOR)


def test_a_line_that_could_not_be_computed_leaves_no_uncertainty() -> None:
    assert math.isnan(estimate(line(math.nan, 5.0)).expanded_uncertainty)
    assert math.isnan(estimate(line(1.0, 5.0), line(math.nan)).expanded_uncertainty)


@pytest.mark.parametrize(
    ("distribution", "k"),
    [
        (Distribution.RECTANGULAR, 0.95 * math.sqrt(3.0)),
        (Distribution.ARCSINE, math.sqrt(2.0) * math.sin(0.475 * math.pi)),
        (Distribution.NORMAL, NORMAL_COVERAGE_FACTOR),
    ],
)
def test_a_line_alone_has_the_k_of_its_own_distribution(
    distribution: Distribution, k: float
) -> None:
    alone = BudgetLine("x", "B", 0.1, distribution=distribution)
    assert estimate(alone).coverage_factor == pytest.approx(k, abs=2e-5)


@pytest.mark.parametrize("distribution", list(Distribution))
@pytest.mark.parametrize("rest_freedom", [math.inf, 6.0])
def test_k_of_a_dominant_line_is_that_of_drawn_sums(
    distribution: Distribution, rest_freedom: float
) -> None:
    """95 of 100 drawn sums of both errors lie within k u (JCGM 101)."""
    random = np.random.default_rng(1)
    draws = 400_000
    own = {
        Distribution.NORMAL: lambda: random.standard_t(4.0, draws),
        Distribution.RECTANGULAR: lambda: math.sqrt(3.0) * random.uniform(-1.0, 1.0, draws),
        Distribution.ARCSINE: lambda: math.sqrt(2.0) * np.sin(random.uniform(0.0, 7e3, draws)),
    }[distribution]()
    beside = (
        random.standard_normal(draws)
        if math.isinf(rest_freedom)
        else random.standard_t(rest_freedom, draws)
    )
    freedom = 4.0 if distribution is Distribution.NORMAL else math.inf
    large = BudgetLine("x", "B", 0.9, degrees_of_freedom=freedom, distribution=distribution)
    made = estimate(large, line(math.sqrt(1.0 - 0.81), rest_freedom))
    held = np.abs(0.9 * own + math.sqrt(1.0 - 0.81) * beside) <= made.expanded_uncertainty
    assert float(held.mean()) == pytest.approx(0.95, abs=2e-3)


def test_the_shape_counts_only_where_one_line_has_most_of_u() -> None:
    halves = [BudgetLine("x", "B", 0.1, distribution=Distribution.RECTANGULAR) for _ in range(2)]
    assert estimate(*halves).coverage_factor == NORMAL_COVERAGE_FACTOR
