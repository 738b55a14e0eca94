"""Plots as data: what each direction of turning shows."""

from __future__ import annotations

import numpy as np

from experiments.result import both_ways


def test_each_direction_shows_its_own_points_in_its_own_colour() -> None:
    direction, x = np.array([1.0, -1.0, 1.0]), np.array([10.0, 20.0, 30.0])
    y = np.array([1.0, 2.0, 3.0])
    forward, reverse = both_ways(direction, x, y, low=y - 0.5, high=y + 0.25)
    assert (forward.label, forward.group, reverse.label, reverse.group) == (
        "forward",
        0,
        "reverse",
        1,
    )
    assert forward.x.tolist() == [10.0, 30.0]
    assert forward.y.tolist() == [1.0, 3.0]
    assert reverse.x.tolist() == [20.0]
    assert reverse.y.tolist() == [2.0]
    assert forward.low is not None
    assert forward.low.tolist() == [0.5, 2.5]
    assert reverse.high is not None
    assert reverse.high.tolist() == [2.25]


def test_a_direction_without_points_shows_nothing_and_keeps_the_colours() -> None:
    (reverse,) = both_ways(np.array([-1.0]), np.array([5.0]), np.array([0.1]))
    assert (reverse.label, reverse.group, reverse.low, reverse.high) == ("reverse", 1, None, None)
