"""An encoder that stands beside one that turns is broken; two that stand are a shaft that sticks."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.evidence.continuity import _angle

RATIO = 0.01
"""Counts of the other encoder per count of this one."""


def turned(stuck: int) -> np.ndarray:
    """Counts (n,) of a shaft that sticks for so many rows and then turns by 20 counts a row; 1000 counts a radian."""
    return np.concatenate([np.zeros(stuck), np.cumsum(np.full(1000, 20.0))])


@pytest.mark.parametrize("stuck", [30, 200])
def test_a_shaft_that_sticks_is_no_broken_encoder(stuck: int) -> None:
    counts = turned(stuck)
    travel, apart = counts[-1] / 1000.0, np.ones(len(counts) - 1, dtype=np.int64)
    excess, _ = _angle(counts, apart, travel, np.floor(RATIO * counts))
    assert excess < 1.0
    turning = np.floor(RATIO * 20.0 * np.arange(len(counts)))
    for beside in (turning, None):
        excess, what = _angle(counts, apart, travel, beside)
        assert excess > 1.0
        assert what == f"stands still for {stuck} rows"


def test_an_output_encoder_that_stands_is_found_beside_an_input_that_turns() -> None:
    counts = turned(0)
    frozen = np.concatenate(
        [np.floor(RATIO * counts[:300]), np.full(200, 59.0), np.floor(RATIO * counts[500:])]
    )
    excess, what = _angle(frozen, np.ones(999, dtype=np.int64), 20.0, counts)
    assert excess > 1.0
    assert "stands still for 20" in what


@pytest.mark.parametrize(("standing", "is_too_long"), [(13, False), (14, True)])
def test_an_angle_may_stand_for_a_tenth_of_a_radian_and_five_counts(
    standing: int, is_too_long: bool
) -> None:
    """At 20 counts a row and 2350 a radian that is the way of twelve rows, and the first of equal ones has moved."""
    steps = np.full(400, 20.0)
    steps[200 : 200 + standing - 1] = 0.0
    stored = np.concatenate([[0.0], np.cumsum(steps)])
    stored *= 20.0 * 400 / stored[-1]
    apart = np.ones(400, dtype=np.int64)
    excess, _ = _angle(stored, apart, 20.0 * 400 / 2350.0, None)
    assert (excess > 1.0) is is_too_long
