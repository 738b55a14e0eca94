"""What sampling lets be said of an order: too high, one of a pair, or told apart."""

from __future__ import annotations

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.evidence.orders import sampled
from experiments.recording import Recording
from experiments.result import Result
from model.gear_file import shipped_gear
from model.identify.estimate import Estimate
from model.identify.orders.aliases import SamplingSums, SamplingWindow
from model.units import REVOLUTION
from tests.experiments.test_analyses_without_plan import foreign, stating

RATE, TURNS = 100.0, 5.55
"""Hz and revolutions per second: 18.018 samples per revolution, so that order 16 looks like order 2.018."""


def ripple(order: float, size: float, drift: float = 0.0, turns: float = TURNS) -> Recording:
    """A minute of torque with one order and noise, the speed drifting by a share."""
    time = np.arange(0.0, 60.0, 1.0 / RATE)
    angle = REVOLUTION * turns * (time + 0.5 * drift * time**2 / time[-1])
    noise = 0.005 * np.random.default_rng(1).standard_normal(len(time))
    torque = 0.1 + size * np.cos(order * angle) + noise
    recording = foreign(time, input_angle=(angle, "rad"), torque=(torque, "N m"))
    return stating(recording, "torque", scale_relative_uncertainty=0.01)


def analysed(kind: str, recording: Recording, **settings: object) -> Result:
    evidence = Evidence(
        shipped_gear(), settings={"channel": "torque", "highest_order": 24, **settings}
    )
    return catalogue.load(kind).analyse(recording, evidence)


def called(result: Result, word: str) -> list[float]:
    """The orders whose amplitudes are called so."""
    return [
        round(float(name.removeprefix("amplitude_")), 2)
        for name, estimate in result.estimates.items()
        if name.startswith("amplitude_") and estimate.identifiable == word
    ]


@pytest.mark.parametrize("drift", [0.0, 1e-4])
def test_an_image_of_a_high_order_is_given_with_what_it_may_be(drift: float) -> None:
    result = analysed("order-spectrum", ripple(16.0, 0.05, drift))
    assert called(result, "yes") == []
    strongest = next(iter(result.estimates.values()))
    assert "or its alias 16" in strongest.note


def test_a_speed_that_changed_by_a_thousandth_tells_the_order_from_its_image() -> None:
    result = analysed("order-spectrum", ripple(16.0, 0.05, 1e-3))
    assert list(result.estimates) == ["amplitude_16"]
    assert result.estimates["amplitude_16"].value == pytest.approx(0.05, rel=0.02)
    assert called(result, "yes") == []
    assert "above 0.4 of the 18 samples" in result.estimates["amplitude_16"].note


@pytest.mark.parametrize("kind", ["order-spectrum", "revolution"])
@pytest.mark.parametrize("drift", [0.0, 1e-3])
def test_a_low_order_that_no_other_one_can_be_stays(kind: str, drift: float) -> None:
    assert called(analysed(kind, ripple(2.0, 0.05, drift)), "yes") == [2.0]


def test_nothing_above_four_tenths_of_the_samples_is_identified() -> None:
    result = analysed("revolution", ripple(9.0, 0.05))
    assert called(result, "no") == [9.0]
    assert "above 0.4 of the 18 samples" in result.estimates["amplitude_9"].note


@pytest.mark.parametrize(("drift", "word"), [(0.0, "weakly"), (2e-2, "yes")])
def test_an_order_that_is_not_whole_is_one_only_where_the_speed_changed(
    drift: float, word: str
) -> None:
    """Of 12.7 as of 5.318 the samples of a steady speed show a line at 5.318."""
    low, high = (
        analysed("order-spectrum", ripple(v, 0.05, drift), highest_order=8) for v in (5.318, 12.7)
    )
    assert called(low, word) == [5.32]
    assert called(high, "yes") == []


def test_whole_samples_per_revolution_leave_a_pair() -> None:
    """At 20 samples per revolution orders 2 and 18 are one and the same."""
    result = analysed("order-spectrum", ripple(2.0, 0.05, turns=5.0), highest_order=8)
    assert 2.0 not in called(result, "yes")
    assert "order 2, or its alias 18" in result.estimates["amplitude_2"].note


def test_noise_alone_has_no_orders() -> None:
    for kind in ("order-spectrum", "revolution"):
        assert called(analysed(kind, ripple(2.0, 0.0)), "yes") == []


def test_an_order_needs_one_whole_turn_of_its_own() -> None:
    angle = SamplingWindow(REVOLUTION * np.linspace(0.0, 1.0, 500), np.ones(500), 500.0)
    one = Estimate(name="amplitude", value=1.0, unit="N m", low=0.9, high=1.1)
    assert sampled(one, 1.0, angle).identifiable == "yes"
    quarter = sampled(one, 0.25, angle, ratio=4.0)
    assert quarter.identifiable == "no"
    assert "0.25 of one turn of its own was recorded" in quarter.note


def test_an_order_of_an_angle_that_nobody_knows_is_left_as_it_is() -> None:
    one = Estimate(name="amplitude", value=1.0, unit="N m", low=0.9, high=1.1)
    assert sampled(one, 0.25, SamplingSums().window(), ratio=4.0) == one
