"""Skew between channels: recovered where the data show it, and "no" with a reason where they do not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.identify.skew import RevolutionMeans, encoder_skew, torque_skew

NEEDED = 1e-4


def means(
    speeds: tuple[float, ...],
    skew: float,
    *,
    wind_up: float = 2e-5,
    noise: float = 1e-6,
    length: int = 30,
    seed: int = 3,
) -> RevolutionMeans:
    """Stretches of `length` input revolutions at each output speed [rad/s]: wind-up, skew, orders of the output."""
    rng = np.random.default_rng(seed)
    speed = np.repeat(speeds, length)
    angle = np.cumsum(np.sign(speed)) * 2.0 * math.pi / 120.0
    offset = 0.3 + wind_up * np.sign(speed) + skew * speed
    offset += 3e-5 * np.cos(angle - 0.4) + 1e-5 * np.sin(3.0 * angle)
    offset += rng.normal(0.0, noise, len(speed)) + np.repeat(
        rng.normal(0.0, noise, len(speeds)), length
    )
    return RevolutionMeans(speed, offset, angle, np.repeat(np.arange(len(speeds)), length))


SPEEDS = (0.3, 0.3, 0.8, 0.8, 1.5, 1.5, 2.5, 2.5, -0.3, -0.8, -1.5, -2.5, -0.3, -0.8, -1.5, -2.5)


@pytest.mark.parametrize("skew", [0.0, 12e-6, -80e-6])
def test_the_skew_of_the_encoders_is_recovered_beside_wind_up_and_output_orders(
    skew: float,
) -> None:
    found = encoder_skew(means(SPEEDS, skew), NEEDED)
    assert found.identifiable == "yes"
    assert found.low < skew < found.high
    assert found.high - found.low < 5e-6
    assert found.expanded_uncertainty == pytest.approx(
        found.coverage_factor * found.budget[0].standard_uncertainty
    )
    assert found.expanded_uncertainty == pytest.approx(0.5 * (found.high - found.low))


def test_viscous_wind_up_is_in_the_budget_and_takes_the_verdict_away() -> None:
    found = encoder_skew(means(SPEEDS, 10e-6), NEEDED, viscous_windup=70e-6)
    assert found.identifiable == "weakly"
    assert found.expanded_uncertainty > 1.959 * 70e-6
    assert "viscous" in found.note
    assert encoder_skew(means(SPEEDS, 10e-6), 1e-3, viscous_windup=70e-6).identifiable == "yes"


def test_intervals_cover_the_truth() -> None:
    hits = 0
    for seed in range(100):
        found = encoder_skew(means(SPEEDS, 7e-6, seed=seed), NEEDED)
        hits += found.low <= 7e-6 <= found.high
    assert 88 <= hits <= 100


@pytest.mark.parametrize(
    ("speeds", "why"),
    [
        ((1.0, 1.0, -1.0, -1.0), "one speed only"),
        ((0.5, 1.0, 2.0, 0.7), "one direction only"),
        ((1.0, -2.0), "too few stretches"),
        ((), "0 whole revolutions"),
    ],
)
def test_what_the_data_cannot_say_is_said(speeds: tuple[float, ...], why: str) -> None:
    found = encoder_skew(means(speeds, 1e-5), NEEDED)
    assert found.identifiable == "no"
    assert math.isnan(found.value)
    assert why in found.note


def test_less_than_an_output_revolution_and_too_much_scatter_are_said() -> None:
    found = encoder_skew(means((0.5, -0.5, 1.0, -1.0, 2.0, -2.0), 1e-5, length=10), NEEDED)
    assert found.identifiable != "yes"
    assert "output revolutions" in found.note
    noisy = encoder_skew(means(SPEEDS, 1e-5, noise=1e-3), NEEDED)
    assert noisy.identifiable == "no"
    assert "were needed" in noisy.note


def torques(delay: float, *, noise: float = 1e-3, quantum: float = 6.37e-4, seed: int = 1):
    """A slowly varying torque seen by the drive in counts, and by the port later, with another gain and zero."""
    rng = np.random.default_rng(seed)
    t = np.arange(8000) * 1e-3
    waves = [(0.08, 3.1), (0.03, 11.7), (0.02, 23.9)]
    truth = [
        sum(a * np.sin(2.0 * math.pi * f * (t - lag) + f) for a, f in waves) for lag in (0.0, delay)
    ]
    drive = np.rint(truth[0] / quantum) * quantum
    port = 0.01 + 1.02 * truth[1] + rng.normal(0.0, noise, len(t))
    return drive, port, np.arange(0, 8000, 1000), quantum


@pytest.mark.parametrize("delay", [0.0, 4e-4, -3e-4, 2e-3])
def test_the_delay_of_the_torque_port_is_recovered(delay: float) -> None:
    drive, port, starts, quantum = torques(delay)
    found = torque_skew(drive, port, 1e-3, 1e-3, starts, quantum)
    assert found.identifiable == "yes"
    assert abs(found.value - delay) < found.expanded_uncertainty + 0.02 * abs(delay)
    assert found.expanded_uncertainty < 1.2e-4


def test_a_torque_that_does_not_vary_shows_no_delay() -> None:
    rng = np.random.default_rng(2)
    flat = torque_skew(
        np.full(4000, 0.1), 0.1 + rng.normal(0, 1e-3, 4000), 1e-3, 1e-3, np.arange(0, 4000, 500)
    )
    assert (flat.identifiable, math.isnan(flat.value)) == ("no", True)
    drive, port, starts, quantum = torques(3e-4)
    assert (
        torque_skew(drive, rng.normal(0, 0.1, len(port)), 1e-3, 1e-3, starts, quantum).identifiable
        == "no"
    )
    assert (
        torque_skew(drive[:40], port[:40], 1e-3, 1e-3, np.array([0]), quantum).identifiable == "no"
    )
    assert (
        torque_skew(np.empty(0), np.empty(0), 1e-3, 1e-3, np.empty(0, np.int64)).identifiable
        == "no"
    )
