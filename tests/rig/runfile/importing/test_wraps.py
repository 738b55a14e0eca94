"""A wrapped angle is told from everything else that an angle does."""

import numpy as np
import pytest

from rig.runfile.importing.wraps import range_like, wraps

TIME = np.arange(2000) * 0.01


@pytest.mark.parametrize("speed", [0.3, 5.0, -5.0, 90.0])
def test_wraps_are_found_at_any_speed(speed: float) -> None:
    """From two turns in twenty seconds to seven samples a turn."""
    true = speed * TIME
    wrapped = np.asarray((true + np.pi) % (2 * np.pi) - np.pi, dtype=np.float64)
    expected = np.flatnonzero(np.abs(np.diff(wrapped)) > np.pi) + 1
    assert len(expected)
    found = wraps(wrapped, 1.0)
    inner = expected[(expected > 1) & (expected < len(true) - 1)]
    assert found.tolist() == inner.tolist()


def test_what_is_no_wrap() -> None:
    rng = np.random.default_rng(3)
    swing = 2.0 * np.sin(3.0 * TIME)
    dither = rng.integers(0, 2, len(TIME)) * 1.5e-3
    start = np.where(TIME < 10.0, 0.0, 40.0 * (TIME - 10.0))
    spike = 3.0 * TIME
    spike[700] += 30.0
    stop = np.minimum(TIME, 5.0) * 60.0
    for angle in (swing, dither, start, spike, stop, swing + dither, np.zeros(50)):
        assert not len(wraps(angle, 1.0))


def test_the_start_of_a_fast_motion_at_the_end_of_the_rows_is_no_wrap() -> None:
    angle = np.concatenate([np.zeros(500), [3.0, 6.0]])
    assert not len(wraps(angle[:-1], 1.0))
    assert not len(wraps(angle, 1.0))


@pytest.mark.parametrize(
    ("jump", "range_"), [(353.0, 360.0), (6.2, 2 * np.pi), (65000.0, 65536.0), (777.0, 777)]
)
def test_the_range_that_is_proposed(jump: float, range_: float) -> None:
    assert range_like(jump) == pytest.approx(range_)
