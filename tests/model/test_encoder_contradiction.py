"""Mountings that contradict each other are named, and those that do not are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model.identify.encoder_contradiction import CHANCE, contradiction
from model.identify.encoder_curve import Mounted
from model.units import ARCSEC, DEGREE

ORDERS = np.arange(1, 9)
GEARS = np.array([1.3, 0.8, 0.4, 0.3, 0.02, 0.02, 0.02, 0.02]) * ARCSEC
ENCODER = np.array([3.0, 1.0, 0.6, 0.5, 0.4, 0.3, 0.3, 0.2]) * ARCSEC


def drawn(random: np.random.Generator, sizes: np.ndarray) -> np.ndarray:
    return sizes * (random.standard_normal(8) + 1j * random.standard_normal(8)) / np.sqrt(2.0)


def mountings(seed: int, count: int = 8) -> list[Mounted]:
    random = np.random.default_rng(seed)
    encoder = drawn(random, ENCODER)
    return [
        Mounted(
            gear=f"G-{n}",
            angle=n * 360.0 / count * DEGREE,
            waves=encoder + drawn(random, GEARS) * np.exp(1j * ORDERS * n * 360.0 / count * DEGREE),
        )
        for n in range(count)
    ]


def changed(some: list[Mounted], first: int, last: int, seed: int) -> list[Mounted]:
    other = drawn(np.random.default_rng(seed), ENCODER)
    return [
        replace(one, waves=one.waves + other) if first <= n < last else one
        for n, one in enumerate(some)
    ]


@pytest.mark.parametrize("place", [2, 4, 6])
def test_another_encoder_is_told_with_the_mounting_from_which_on(place: int) -> None:
    found = contradiction(changed(mountings(3), place, 8, 77))
    assert found is not None
    assert (found.what, found.place) == ("exchanged", place)
    assert found.chance < CHANCE


def test_one_mounting_beside_all_others_is_told() -> None:
    found = contradiction(changed(mountings(4), 5, 6, 78))
    assert found is not None
    assert (found.what, found.place) == ("beside", 5)


def test_an_order_that_some_runs_do_not_show_says_nothing() -> None:
    some = mountings(6)
    hidden = [
        replace(
            one,
            waves=np.where(ORDERS == 5, 0.06 * ARCSEC if n == 7 else 0.0, one.waves),
            unseen=tuple((0.07 * ARCSEC if n < 7 and k == 5 else 0.0) for k in ORDERS),
        )
        for n, one in enumerate(some)
    ]
    assert contradiction(hidden) is None


def test_sound_mountings_and_too_few_of_them_say_nothing() -> None:
    assert [contradiction(mountings(seed)) for seed in range(40)] == [None] * 40
    few = changed(mountings(3, 5), 2, 5, 77)
    assert contradiction(few[:4]) is None
    twice = [*mountings(3), mountings(3)[0]]
    assert contradiction(twice) is None
