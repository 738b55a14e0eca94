"""Capability by hand: known values, one side and two, coverage of both intervals, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.fleet.capability import (
    LEAST_GEARS,
    Capability,
    actual_interval,
    capability,
    potential_interval,
)


def found_of(values: np.ndarray, lower: float | None, upper: float | None) -> Capability:
    found = capability(values.tolist(), lower=lower, upper=upper)
    assert isinstance(found, Capability)
    return found


def test_a_lot_by_hand() -> None:
    # Twelve gears of mean 10 and s = 1: 11 s^2 = 11.
    values = np.array([9.0] * 5 + [11.0] * 5 + [10.0 - math.sqrt(0.5), 10.0 + math.sqrt(0.5)])
    both = found_of(values, 7.0, 14.0)
    assert (both.gears, both.mean) == (12, pytest.approx(10.0))
    assert both.standard_deviation == pytest.approx(1.0)
    assert both.potential == pytest.approx(7.0 / 6.0)
    assert both.actual == pytest.approx(1.0)
    one = found_of(values, None, 14.0)
    assert (one.potential, one.potential_interval) == (None, None)
    assert one.actual == pytest.approx(4.0 / 3.0)
    assert found_of(values, 7.0, None).actual == pytest.approx(1.0)
    beyond = found_of(values, None, 9.0)
    assert beyond.actual == pytest.approx(-1.0 / 3.0)


def test_intervals_of_tables() -> None:
    # chi-square of 19 degrees of freedom: 8.907 and 32.852 at 2.5 % and 97.5 %.
    low, high = potential_interval(1.0, 20)
    assert (low, high) == (
        pytest.approx(math.sqrt(8.907 / 19), rel=1e-4),
        pytest.approx(math.sqrt(32.852 / 19), rel=1e-4),
    )
    half = 1.959964 * math.sqrt(1 / 180 + 1.69 / 38)
    assert actual_interval(1.3, 20) == (pytest.approx(1.3 - half), pytest.approx(1.3 + half))


def test_the_intervals_hold_the_truth() -> None:
    rng = np.random.default_rng(20260302)
    held = {"cp": 0, "cpk": 0, "normal": 0}
    lots = 400
    for _ in range(lots):
        found = found_of(rng.normal(0.5, 1.0, 30), -4.0, 4.0)
        assert found.potential_interval is not None
        held["cp"] += found.potential_interval[0] <= 4.0 / 3.0 <= found.potential_interval[1]
        held["cpk"] += found.actual_interval[0] <= 3.5 / 3.0 <= found.actual_interval[1]
        held["normal"] += found.is_normal
    # 95 % of 400 lots within four standard errors of counting.
    assert held["cp"] / lots == pytest.approx(0.95, abs=0.045)
    assert held["cpk"] / lots == pytest.approx(0.95, abs=0.045)
    assert held["normal"] / lots > 0.97


def test_what_is_not_normal_is_called_so() -> None:
    skewed = np.random.default_rng(3).exponential(1.0, 60)
    assert not found_of(skewed, None, 10.0).is_normal


@pytest.mark.parametrize(
    ("values", "limits", "why"),
    [
        ([1.0, 2.0] * 10, {}, "no limit"),
        ([1.0] * (LEAST_GEARS - 1), {"upper": 2.0}, "9 gears judged, 10 are needed"),
        ([1.0], {"upper": 2.0}, "1 gear judged"),
        ([1.5] * 20, {"upper": 2.0}, "same value"),
    ],
)
def test_what_has_no_capability_says_why(
    values: list[float], limits: dict[str, float], why: str
) -> None:
    found = capability(values, **limits)
    assert isinstance(found, str)
    assert why in found
