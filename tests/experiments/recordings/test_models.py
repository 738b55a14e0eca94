"""Ladders of recordings of any origin: what moved them is what predicts another run best."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.ladder import Ladder, Sample
from experiments.recordings import motion_models, order_models
from model.gear import HarmonicDrive
from tests.experiments.recordings.test_motion import moved
from tests.experiments.test_analyses_without_plan import foreign

SEEDS = 9731, 9732, 9733


def left(ladder: Ladder, samples: list[Sample]) -> dict[str, float]:
    """Root mean square of what every rung leaves of the last sample, fitted to the others."""
    *train, judged = samples
    return {
        rung.name: float(np.sqrt(np.mean(ladder.left(rung, rung.fit(train), judged) ** 2)))
        for rung in ladder.rungs_for(samples)
    }


def motions(gear: HarmonicDrive, **what: float) -> list[Sample]:
    made = (moved(seed, rate=200.0, seconds=20.0, noise=0.0, **what) for seed in SEEDS)
    return [motion_models.sample(one.recording(), Evidence(gear)) for one in made]


@pytest.mark.parametrize(
    ("what", "best", "richer"),
    [
        ({}, "and inertia", "load of orders 1 to 3"),
        ({"gravity": 1.0}, "gravity", "load of orders 1 to 3"),
        ({"dip": 1.0}, "Stribeck", "load of orders 1 to 3"),
    ],
)
def test_the_rung_that_is_the_truth_predicts_another_motion(
    what: dict[str, float], best: str, richer: str, gear: HarmonicDrive
) -> None:
    found = left(motion_models.LADDER, motions(gear, **what))
    names = list(found)
    assert found[best] < 0.8 * min(found[name] for name in names[: names.index(best)])
    assert found[richer] > 0.9 * found[best], "numbers that mean nothing predict nothing"


def test_a_linear_axis_has_no_load_over_its_angle(gear: HarmonicDrive) -> None:
    one = moved(SEEDS[0], rate=200.0, seconds=20.0, noise=0.0)
    axis = foreign(one.time, position=(one.position, "m"), force=(one.torque, "N"))
    sample = motion_models.sample(axis, Evidence(gear))
    names = [rung.name for rung in motion_models.LADDER.rungs_for([sample])]
    assert sample.unit == "N"
    assert names[-1] == "Stribeck"


def turned(seed: int, **waves: float) -> Any:
    """Ten revolutions there and back of an absolute angle, and a torque with waves of these orders."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 2e-3)
    way = np.where(time < 10.0, time, 20.0 - time) * 2.0 * np.pi + random.uniform(0.0, 1.0)
    torque = 0.3 * np.sign(10.0 - time) + 0.01 * random.standard_normal(len(time))
    for order, amplitude in waves.items():
        torque = torque + amplitude * np.cos(float(order.strip("n").replace("_", ".")) * way + 0.4)
    return foreign(time, input_angle=(way, "rad"), torque=(torque, "N m"))


def test_orders_that_are_found_predict_another_run(gear: HarmonicDrive) -> None:
    evidence = Evidence(gear, settings={"highest_order": 20})
    waves = {"n3": 0.05, "n7_5": 0.04}
    samples = [order_models.sample(turned(seed, **waves), evidence) for seed in SEEDS]
    found = left(order_models.LADDER, samples)
    assert found["orders that were found"] == min(found.values())
    assert found["orders that were found"] < 0.3 * found["no order (null)"]
    assert found["orders 1 to 4"] == pytest.approx(0.04 / np.sqrt(2.0), rel=0.1)
    rung = next(r for r in order_models.LADDER.rungs if r.name == "orders that were found")
    assert rung.numbers(rung.fit(samples)) == 4
