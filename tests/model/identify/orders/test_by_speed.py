"""An order whose amplitude changes with the speed is found as that, and one that does not is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from model.identify.orders.by_speed import (
    ChangingOrder,
    Moved,
    changing_orders,
    speed_range,
    speed_trend,
)


def swung(
    seed: int = 4,
    *,
    swing: float = 0.4,
    growth: float = 1.0,
    noise: float = 0.02,
    rows: int = 40_000,
) -> Moved:
    """Orders 1 and 2 over an angle whose speed swings about 60 rad/s; that of 2 grows with the speed."""
    random = np.random.default_rng(seed)
    time = np.arange(rows) * 1e-3
    share = swing * np.sin(2.0 * np.pi * time / 9.0)
    speed = 60.0 * (1.0 + share)
    angle = np.cumsum(speed) * 1e-3
    value = 0.4 + 0.1 * share + 0.2 * (1.0 + growth * share) * np.cos(2.0 * angle - 0.3)
    value += 0.03 * np.cos(angle) + noise * random.standard_normal(rows)
    return Moved(angle, value, speed)


def changing(one: Moved, orders: tuple[float, ...] = (2.0, 1.0)) -> tuple[ChangingOrder, ...]:
    return changing_orders(lambda: [one], orders)


@pytest.mark.parametrize("growth", [1.0, -0.8])
def test_the_amplitude_at_every_speed_is_recovered(growth: float) -> None:
    (found,) = changing(swung(growth=growth))
    assert found.order == 2.0
    speeds = np.linspace(found.slow, found.fast, 9)
    truth = 0.2 * (1.0 + growth * (speeds / 60.0 - 1.0))
    np.testing.assert_allclose(found.amplitude(speeds), truth, atol=2e-3)


def test_what_lies_beyond_the_middle_speed_is_taken_off() -> None:
    one = swung(noise=0.0)
    (found,) = changing(one)
    left = one.value - found.beyond(one.angle, one.speed)
    middle = 0.2 * (found.middle / 60.0)
    constant = 0.4 + 0.1 * (one.speed / 60.0 - 1.0) + 0.03 * np.cos(one.angle)
    inside = (one.speed > found.slow) & (one.speed < found.fast)
    rest = left - constant - middle * np.cos(2.0 * one.angle - 0.3)
    # Beyond the range the speed counts as its end, which a twentieth of the samples at each end feel.
    assert np.abs(rest[inside]).max() < 1e-3


def test_an_amplitude_that_stays_is_left_alone() -> None:
    """On forty recordings nothing is found where nothing changes."""
    assert [changing(swung(seed, growth=0.0, noise=0.1, rows=8000)) for seed in range(40)] == [
        ()
    ] * 40


def test_a_small_change_stays_in_one_amplitude() -> None:
    assert changing(swung(growth=0.2)) == ()


def test_a_steady_speed_tells_nothing() -> None:
    assert speed_range([swung(swing=0.05)]) is None
    assert changing(swung(swing=0.05)) == ()
    assert changing(swung(), ()) == ()


def test_a_sidelobe_is_not_looked_at_beside_its_line() -> None:
    (found,) = changing(swung(), (2.0, 2.0116, 1.9884, 1.0))
    assert found.order == 2.0


def test_jumps_of_an_angle_make_no_change() -> None:
    """A few samples whose speed is a hundred times the others pull no parabola."""
    one = swung(growth=0.0)
    speed = one.speed.copy()
    speed[::977] *= 100.0
    assert changing(Moved(one.angle, one.value, speed)) == ()
    (found,) = changing(Moved(one.angle, swung().value, speed))
    assert found.amplitude(np.array([60.0])) == pytest.approx(0.2, abs=3e-3)


def test_a_short_recording_tells_no_change() -> None:
    one = swung()
    few = [
        Moved(one.angle[k : k + 60], one.value[k : k + 60], one.speed[k : k + 60])
        for k in (0, 3000)
    ]
    assert changing_orders(lambda: few, (2.0, 1.0)) == ()


def test_the_trend_over_the_speed_is_told_where_it_predicts() -> None:
    one = swung(noise=0.0, growth=0.0)
    trend = speed_trend(lambda: [one])
    assert trend is not None
    speeds = np.linspace(trend.slow, trend.fast, 9)
    middle = trend.middle / 60.0
    np.testing.assert_allclose(trend.value(speeds), 0.1 * (speeds / 60.0 - middle), atol=2e-3)
    assert speed_trend(lambda: [swung(swing=0.05)]) is None


def wandering(seed: int) -> Moved:
    """Order 2 whose size and phase wander with time while the speed swings once or less."""
    random = np.random.default_rng(seed)
    time = np.arange(12_000) * 1e-3
    swing = 2.0 * np.pi * time / random.uniform(8.0, 30.0) + random.uniform(0.0, 6.0)
    speed = 60.0 * (1.0 + 0.4 * np.sin(swing))
    angle = np.cumsum(speed) * 1e-3
    places = np.linspace(0.0, len(time), 7)
    rows = np.arange(len(time))
    size = np.interp(rows, places, 0.2 + 0.15 * random.standard_normal(7))
    phase = np.interp(rows, places, np.cumsum(0.8 * random.standard_normal(7)))
    noise = 0.02 * random.standard_normal(len(time))
    return Moved(angle, 0.4 + size * np.cos(2.0 * angle + phase) + noise, speed)


def test_what_wanders_with_time_is_hardly_taken_for_a_change_with_speed() -> None:
    """Every part of the way must be predicted by the others: neighbours alone would let four of five through."""
    assert sum(changing(wandering(seed), (2.0,)) != () for seed in range(40)) <= 6
