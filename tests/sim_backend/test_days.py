"""Days that resemble each other: each is drawn by the same law, neighbours as alike as is said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sim_backend.days import Days
from sim_backend.drawing import draw
from sim_backend.imperfections import Imperfections
from sim_backend.population import drawn
from sim_backend.streams import stream
from sim_backend.world import World
from tests.sim_backend.rigs import GEAR, MOTOR

RATIO = GEAR.ratio


def rooms(correlation: float | None, benches: int, days: int) -> np.ndarray:
    """Temperature of the room (benches, days)."""
    return np.array(
        [
            [
                Days(World(gear_seed=1, bench_seed=b, day=d, day_correlation=correlation)).within(
                    "ambient", -1.0, 1.0
                )
                for d in range(1, days + 1)
            ]
            for b in range(benches)
        ]
    )


def test_days_are_as_alike_as_is_said_and_of_the_same_law() -> None:
    seen = rooms(0.4, 150, 6)
    # Ranks of a bivariate normal: (6/pi) asin(r/2).
    expected = 6.0 / np.pi * np.arcsin(0.2)
    alike = np.corrcoef(seen[:, :-1].ravel(), seen[:, 1:].ravel())[0, 1]
    assert alike == pytest.approx(expected, abs=0.1)
    two_apart = np.corrcoef(seen[:, :-2].ravel(), seen[:, 2:].ravel())[0, 1]
    assert two_apart == pytest.approx(0.16, abs=0.12)
    share = np.sort(seen[:, -1]) / 2.0 + 0.5
    assert np.max(np.abs(share - (np.arange(150) + 0.5) / 150)) < 1.6 / np.sqrt(150)


def test_without_a_correlation_and_on_the_first_day_nothing_is_remembered() -> None:
    assert np.array_equal(rooms(None, 3, 4), rooms(0.0, 3, 4))
    world = World(gear_seed=1, bench_seed=2, day=3)
    own = stream(world.seed_of_day(3), "ambient").uniform(-1.0, 1.0)
    assert Days(world).within("ambient", -1.0, 1.0) == own
    first = rooms(0.4, 3, 2)
    assert np.array_equal(first[:, 0], rooms(0.0, 3, 1)[:, 0])
    assert not np.array_equal(first[:, 1], rooms(0.0, 3, 2)[:, 1])


def test_a_day_is_the_same_however_far_one_looks_back() -> None:
    """After a year the beginning is forgotten: the day is found without drawing all of them."""
    world = World(gear_seed=1, bench_seed=2, day=400, day_correlation=0.3)
    r, z = 0.3, None
    for day in range(1, 401):
        own = float(stream(world.seed_of_day(day), "x").standard_normal())
        z = own if z is None else r * z + np.sqrt(1.0 - r * r) * own
    found = Days(world).normal("x", lambda random: float(random.standard_normal()))
    assert found == pytest.approx(z, abs=1e-8)


def test_a_wide_bench_has_a_correlation_of_its_own_and_the_truth_says_it() -> None:
    drawn_by = [
        Days(World(gear_seed=1, bench_seed=b, population="wide")).correlation for b in range(300)
    ]
    assert 0.0 <= min(drawn_by) < 0.01
    assert 0.39 < max(drawn_by) <= 0.4
    one = World(gear_seed=1, bench_seed=7, population="wide", day=2)
    on = Imperfections(sizes=drawn(GEAR, MOTOR, one).sizes)
    assert draw(on, RATIO, one).day_correlation == drawn_by[7]
    said = dataclasses.replace(one, day_correlation=0.0)
    assert Days(said).correlation == 0.0
    offsets = [
        draw(Imperfections(sizes=drawn(GEAR, MOTOR, w).sizes), RATIO, w).torque_port.offset
        for w in (one, said)
    ]
    assert offsets[0] != offsets[1]
