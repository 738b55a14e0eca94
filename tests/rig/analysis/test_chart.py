"""Control limits and the rules of the chart, against hand-worked numbers and against an unchanged
gear many times over.
"""

from __future__ import annotations

import numpy as np
import pytest

from rig.analysis.passport.chart import (
    BASELINE_RUNS,
    RULES,
    control_limits,
    false_alarm_share,
    signals_of,
)
from rig.analysis.passport.content import ControlLimits

LEVEL = (10.0, 12.0, 11.0, 9.0, 10.0, 12.0, 10.0, 11.0, 9.0, 10.0)
"""Moving ranges 2, 1, 2, 1, 2, 2, 1, 2, 1: their mean is 14/9."""


def limits(values: tuple[float, ...] = LEVEL) -> ControlLimits:
    found = control_limits(values, [f"r{k}" for k in range(len(values))])
    assert found is not None
    return found


def unit() -> ControlLimits:
    """Limits at -3 and 3, sigma 1, moving range up to 3.69."""
    return ControlLimits(
        centre=0.0,
        sigma=1.0,
        lower=-3.0,
        upper=3.0,
        moving_range=1.128,
        moving_range_upper=3.686,
        runs=(),
        false_alarms=0.03,
    )


def test_limits_by_hand() -> None:
    found = limits((*LEVEL, 50.0))
    assert found.moving_range == pytest.approx(14.0 / 9.0)
    assert found.centre == pytest.approx(10.4)
    assert found.sigma == pytest.approx(14.0 / 9.0 / 1.128)
    # 2.66 and 3.267 are the factors that tables of control charts give.
    assert found.upper - found.centre == pytest.approx(2.66 * 14.0 / 9.0, rel=1e-3)
    assert found.centre - found.lower == pytest.approx(2.66 * 14.0 / 9.0, rel=1e-3)
    assert found.moving_range_upper == pytest.approx(3.267 * 14.0 / 9.0)
    assert found.runs == tuple(f"r{k}" for k in range(10))


@pytest.mark.parametrize("values", [LEVEL[:9], (), (1.0,) * 12, (*LEVEL[:9], float("nan"))])
def test_no_limits_from_too_few_runs_or_from_runs_that_do_not_scatter(
    values: tuple[float, ...],
) -> None:
    assert control_limits(values, [""] * len(values)) is None


@pytest.mark.parametrize(
    ("values", "rules"),
    [
        ((0.0, 3.1), {1: ("1",)}),
        ((0.0, -2.9, 0.0), {}),
        ((0.5, -3.1), {1: ("1",)}),
        ((2.1, 0.0, 2.1), {2: ("2",)}),
        ((2.1, 0.0, 0.0, 2.1), {}),
        ((2.1, -0.1, -2.1), {}),
        ((1.1, 1.2, 0.9, 1.1, 1.5), {4: ("3",)}),
        ((1.1, 1.2, 1.4, 1.1, 0.5), {3: ("3",)}),
        ((-0.1,) * 8, {7: ("4",)}),
        ((0.1,) * 7, {}),
        ((-1.8, 2.0), {1: ("MR",)}),
        ((-1.0, 3.2), {1: ("1", "MR")}),
    ],
)
def test_every_rule_speaks_at_the_run_that_completes_it(
    values: tuple[float, ...], rules: dict[int, tuple[str, ...]]
) -> None:
    found = signals_of(values, unit())
    assert {k: told for k, told in enumerate(found) if told} == rules
    assert all(rule in RULES for told in found for rule in told)


def test_rules_see_both_sides_alike_and_care_for_no_unit() -> None:
    values = np.random.default_rng(1).normal(size=3000) * 1.4
    found = signals_of(values.tolist(), unit())
    assert {rule for told in found for rule in told} == set(RULES)
    assert signals_of((-values).tolist(), unit()) == found
    scaled = ControlLimits(
        centre=5.0,
        sigma=1e-3,
        lower=4.997,
        upper=5.003,
        moving_range=1.128e-3,
        moving_range_upper=3.686e-3,
        runs=(),
        false_alarms=0.03,
    )
    assert signals_of((5.0 + 1e-3 * values).tolist(), scaled) == found


@pytest.mark.parametrize("baseline", [6, BASELINE_RUNS, 25])
def test_the_share_of_false_alarms_is_what_an_unchanged_gear_shows(baseline: int) -> None:
    generator = np.random.default_rng(20)
    draws = 40_000
    first = generator.normal(size=(draws, baseline))
    sigma = np.abs(np.diff(first, axis=1)).mean(axis=1) / 1.128
    later = generator.normal(size=(draws, 1))[:, 0]
    share = float((np.abs(later - first.mean(axis=1)) > 3.0 * sigma).mean())
    assert false_alarm_share(baseline) == pytest.approx(share, rel=0.15)


def test_with_ever_more_runs_three_sigma_are_three_sigma() -> None:
    assert false_alarm_share(100_000) == pytest.approx(0.0027, rel=0.01)
