"""Orders are found where they are and read as large as they are, whatever the speed, the motion and the sampling."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.orders import samples as samples_module
from model.identify.orders.fit import OrdersFit, fit_samples
from model.identify.orders.near_two import near_two
from model.identify.orders.samples import OrderSamples, Piece
from model.identify.orders.search import Search
from model.identify.orders.turning import DeadZone, runs_of
from model.units import REVOLUTION
from tests.model.identify.orders.sources import in_memory

DATA = Path(
    os.environ.get("HARMONIC_RIG_DATA", Path(__file__).resolve().parents[5] / "shared" / "data")
)


def constant_speed(rate: float, turns: float, seconds: float = 60.0) -> np.ndarray:
    """Angle [rad] sampled at `rate` [Hz] at `turns` revolutions per second."""
    return REVOLUTION * turns * np.arange(0.0, seconds, 1.0 / rate)


def noise(angle: np.ndarray, size: float, seed: int = 1) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(len(angle))


def fitted(
    angle: np.ndarray, value: np.ndarray, highest: float = 64.0, **search: object
) -> OrdersFit:
    zone = DeadZone.of([angle])
    runs = runs_of([zone.ways(angle)], zone.blink)
    source = in_memory([(way, angle[a:b], value[a:b]) for a, b, way in runs])
    return fit_samples(OrderSamples.gathered(source, highest), Search(highest, **search))  # type: ignore[arg-type]


def test_a_trend_without_a_slope_knows_the_slow_orders_better() -> None:
    """A free line beside one turn takes 61 % of a sine; where there is none it must not be looked for."""
    angle = np.linspace(0.0, REVOLUTION, 3000)
    wave = 0.3 * np.sin(angle) + noise(angle, 0.01)
    source = in_memory([(1, angle, wave)])
    fits = [
        fit_samples(OrderSamples.gathered(source, 16.0, has_line=line), Search(16.0))
        for line in (True, False)
    ]
    free, exact = (fit.order(1.0) for fit in fits)
    assert free is not None
    assert exact is not None
    share = exact.mean.covariance[1, 1] / free.mean.covariance[1, 1]
    assert share == pytest.approx(1.0 - 6.0 / np.pi**2, rel=0.15)
    assert all(holds(fit, 1.0, 0.3) for fit in fits)


def holds(fit: OrdersFit, order: float, amplitude: float) -> bool:
    found = fit.order(order)
    assert found is not None, [o.name for o in fit.orders]
    error = float(np.sqrt(found.mean.covariance[0, 0]))
    return abs(found.mean.amplitude - amplitude) < 3.0 * error


@pytest.mark.parametrize("turns", [0.37, 2.11, 6.68, 9.9])
def test_an_order_inside_the_band_is_unbiased_at_any_constant_speed(turns: float) -> None:
    """Order 4 of 64 mN m at 120 Hz and 6.68 rev/s once read 15 % low: lost onto a grid of angle."""
    angle = constant_speed(120.0, turns)
    fit = fitted(angle, 0.1 + 0.064 * np.cos(4.0 * angle - 0.3) + noise(angle, 0.005))
    assert [order.name for order in fit.orders] == ["4"]
    assert holds(fit, 4.0, 0.064)
    assert fit.orders[0].mean.phase == pytest.approx(0.3, abs=0.01)


def test_samples_that_are_averaged_read_the_same() -> None:
    """A thousand samples to a period of the highest order are averaged, and the averaging is undone."""
    angle = constant_speed(20_000.0, 0.5, seconds=6.0)
    waves = 0.3 * np.cos(8.0 * angle) + 0.2 * np.sin(5.0 * angle)
    fit = fitted(angle, waves + noise(angle, 0.1), highest=8.0)
    assert sum(len(piece.angle) for piece in fit.samples.held) < 0.05 * len(angle)
    assert fit.orders[0].mean.amplitude == pytest.approx(0.3, rel=5e-3)
    assert holds(fit, 5.0, 0.2)
    clean = fitted(angle, waves, highest=8.0)
    assert clean.orders[0].mean.amplitude == pytest.approx(0.3, rel=2e-5)


def test_one_turn_and_its_trend_are_told_apart() -> None:
    """A straight line taken out first once left 102 of 300 at order 1."""
    angle = np.linspace(0.0, REVOLUTION, 3000)
    fit = fitted(angle, 0.3 * np.cos(angle) + 0.1 * np.cos(4.0 * angle) + noise(angle, 0.01))
    assert [order.name for order in fit.orders] == ["1", "4"]
    assert holds(fit, 1.0, 0.3)
    assert holds(fit, 4.0, 0.1)


def test_an_order_between_the_lines_is_refined_and_one_of_the_lattice_is_named() -> None:
    angle = constant_speed(400.0, 3.3, seconds=50.0)
    value = 0.02 * np.cos(2.4137 * angle) + 0.01 * np.cos(2.0 * (1.0 + 1.0 / 120.0) * angle)
    fit = fitted(angle, value + noise(angle, 0.01), ratio=120.0)
    free, mesh = fit.orders
    assert free.order == pytest.approx(2.4137, abs=4.0 * free.line.uncertainty)
    assert 0.0 < free.line.uncertainty < 1e-4
    assert mesh.order == pytest.approx(2.0 + 2.0 / 120.0, abs=1e-12)
    assert mesh.line.uncertainty == 0.0
    assert free.mean.amplitude == pytest.approx(0.02, rel=0.03)


def test_directions_that_differ_are_kept_apart_with_their_mean() -> None:
    there = np.linspace(0.0, 20.0 * REVOLUTION, 20_000)
    angle = np.concatenate([there, there[::-1]])
    way = np.repeat([1.0, -1.0], len(there))
    value = way * 0.05 + 0.03 * np.cos(2.0 * angle) + way * 0.02 * np.cos(2.0 * angle)
    fit = fitted(angle, value + 0.01 * np.cos(6.0 * angle) + noise(angle, 0.01))
    two, six = fit.order(2.0), fit.order(6.0)
    assert two is not None
    assert six is not None
    assert two.differ
    assert two.waves[1].amplitude == pytest.approx(0.05, abs=1e-3)
    assert two.waves[-1].amplitude == pytest.approx(0.01, abs=1e-3)
    assert two.mean.amplitude == pytest.approx(0.03, abs=1e-3)
    assert not six.differ
    assert fit.constants[1][0] - fit.constants[-1][0] == pytest.approx(0.1, abs=2e-3)


def test_a_high_order_is_told_from_its_image_when_the_speed_changed() -> None:
    time = np.arange(0.0, 60.0, 0.01)
    for drift, expected in ((1e-3, 16.0), (0.0, 2.018)):
        angle = REVOLUTION * 5.55 * (time + 0.5 * drift * time**2 / 60.0)
        fit = fitted(angle, 0.05 * np.cos(16.0 * angle) + noise(angle, 0.005), highest=24.0)
        assert [order.order for order in fit.orders] == [pytest.approx(expected, abs=1e-3)]
        assert fit.samples.window.alias_of(fit.orders[0].order) == (None if drift else 16)


def test_noise_that_is_not_white_widens_the_orders_it_is_near() -> None:
    random = np.random.default_rng(3)
    errors, claimed = [], []
    for _ in range(12):
        angle = np.linspace(0.0, 60.0 * REVOLUTION, 12_000)
        slow = np.convolve(random.standard_normal(len(angle) + 80), np.hanning(80), "valid")
        value = 8.0 * np.cos(2.0 * angle) + slow[: len(angle)]
        found = fitted(angle, value).order(2.0)
        assert found is not None
        errors.append(found.mean.vector[0] - 8.0)
        claimed.append(np.sqrt(found.mean.covariance[0, 0]))
    assert 0.6 < np.std(errors) / np.mean(claimed) < 1.6


def test_an_order_that_changes_from_stretch_to_stretch_is_as_well_known_as_they_agree() -> None:
    random = np.random.default_rng(5)
    time = np.arange(0.0, 400.0, 2e-3)
    angle = 30.0 * np.sin(REVOLUTION * time / 20.0)
    stretch = np.floor((time + 5.0) / 10.0).astype(int)
    size = 8.0 + random.standard_normal(stretch.max() + 1)
    value = size[stretch] * np.cos(2.0 * angle) + noise(angle, 0.05)
    found = fitted(angle, value, 16.0).order(2.0)
    assert found is not None
    wave = found.waves[1]
    assert np.sqrt(wave.covariance[0, 0]) == pytest.approx(1.0 / np.sqrt(20.0), rel=0.5)
    assert wave.freedom < 50.0


def test_noise_alone_has_no_orders() -> None:
    angle = constant_speed(200.0, 1.7)
    found = [fitted(angle, noise(angle, 1.0, seed)).orders for seed in range(12)]
    assert sum(len(orders) for orders in found) <= 1


def test_a_long_recording_is_fitted_whole_from_a_held_middle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What does not fit into memory is read again: orders refined over all of it, amplitudes of all of it."""
    monkeypatch.setattr(samples_module, "HELD", 1 << 14)
    step, pieces = REVOLUTION / 31.7, 24

    def source():
        for k in range(pieces):
            rows = np.arange(k * 8192, (k + 1) * 8192)
            angle = step * rows
            value = 0.05 * np.cos(4.0 * angle) + 0.03 * np.cos(2.71828 * angle)
            yield Piece.of(0, 1, angle, value + noise(angle, 0.05, k))

    fit = fit_samples(OrderSamples.gathered(source, 14.0), Search(14.0))
    assert not fit.samples.is_whole
    assert fit.samples.held_samples < 0.2 * fit.samples.samples == 0.2 * pieces * 8192
    assert holds(fit, 4.0, 0.05)
    (free,) = [order for order in fit.orders if order.order != 4.0]
    assert free.order == pytest.approx(2.71828, abs=2e-6)
    assert free.mean.amplitude == pytest.approx(0.03, abs=4.0 * 1.6e-4)


def near_two_of(value: np.ndarray, angle: np.ndarray, **known: float) -> str | None:
    fit = fitted(angle, value + noise(angle, 0.002))
    return near_two(fit, known.get("ratio", 120.0), known.get("measured", float("nan")))


def test_a_line_near_two_names_three_explanations_until_one_is_ruled_out() -> None:
    angle = constant_speed(500.0, 2.3)
    mesh = 0.05 * np.cos(2.0 * (1.0 + 1.0 / 120.0) * angle)
    words = near_two_of(mesh, angle)
    assert words is not None
    assert "2.01667" in words
    assert "the mesh" in words
    assert "121 for 120" in words
    assert "alias of a whole order (ruled out" in words
    with_four = near_two_of(mesh + 0.03 * np.cos(4.0 * angle), angle)
    assert with_four is not None
    assert "line at 4" in with_four
    two_angles = near_two_of(mesh, angle, measured=120.0)
    assert two_angles is not None
    assert "both angles" in two_angles
    assert near_two_of(mesh + 0.02 * np.cos(2.0 * angle), angle) is None
    elsewhere = near_two_of(0.05 * np.cos(1.68 * angle), angle)
    assert elsewhere is not None
    assert "stands elsewhere" in elsewhere


@pytest.mark.parametrize(("true", "said"), [(100.0, 101.0), (120.0, 121.0)])
def test_a_tooth_too_many_lays_the_mesh_on_two_and_is_named_by_the_larger_line(
    true: float, said: float
) -> None:
    """The angle was made of the joint's by a ratio that is one tooth too large."""
    angle = np.linspace(0.0, 2.0 * np.pi * 600.0, 60_000)
    wheel = angle * true / said
    mesh = 0.006 * np.cos(2.0 * (1.0 + 1.0 / true) * wheel)
    whole = 0.05 * np.cos(2.0 * wheel) + mesh
    words = near_two_of(whole + 0.01 * np.cos(wheel), angle, ratio=said)
    assert words is not None
    assert "is larger than that at 2" in words
    assert f"({true:.5g} for {said:g}" in words
    right = 0.006 * np.cos(2.0 * angle) + 0.05 * np.cos(2.0 * (1.0 - 1.0 / said) * angle)
    assert near_two_of(right, angle, ratio=said) is None
    assert near_two_of(right + 0.01 * np.cos(4.0 * angle), angle, ratio=said) is None


def test_an_image_near_two_is_one_of_the_three() -> None:
    angle = constant_speed(100.0, 5.55)
    words = near_two_of(0.05 * np.cos(16.0 * angle), angle)
    assert words is not None
    assert "an alias of order 16" in words


def test_an_angle_that_stands_still_is_refused() -> None:
    with pytest.raises(IdentificationError, match="does not move"):
        DeadZone.of([noise(np.zeros(500), 1e-3)])


def test_reversals_and_pauses_cut_the_way_and_jitter_does_not() -> None:
    up = np.linspace(0.0, 7.0, 3000)
    angle = np.concatenate([up, np.full(500, 7.0), up[::-1]])
    angle = angle + noise(angle, 1e-3)
    zone = DeadZone.of([angle])
    runs = runs_of([zone.ways(angle)], zone.blink)
    assert [way for _, _, way in runs] == [1, -1]
    assert abs(runs[0][1] - 3000) < 40
    assert abs(runs[1][0] - 3500) < 40


@pytest.mark.skipif(not (DATA / "tiago_arm").is_dir(), reason="the arm's recording is not here")
def test_the_ripple_of_a_robots_harmonic_drives() -> None:
    """Joints behind 100:1: orders 200 and 400 of joint 3, 200 of joint 2, nothing in joint 1 (its README)."""
    folder = DATA / "tiago_arm"
    columns = {"delimiter": ",", "skip_header": 1}
    position = np.genfromtxt(folder / "tiago_position.csv", **columns)
    effort = np.genfromtxt(folder / "tiago_effort.csv", **columns)
    found = {j: fitted(position[:, j], effort[:, j], highest=500.0) for j in (1, 2, 3)}
    assert found[1].orders == ()
    assert [o.order for o in found[2].orders if o.order > 50.0] == [pytest.approx(200.0, abs=3.0)]
    three = sorted(o.order for o in found[3].orders if o.order > 50.0)
    assert three == [pytest.approx(200.0, abs=2.0), pytest.approx(400.0, abs=2.0)]


def test_gathering_says_what_the_sampling_is() -> None:
    angle = constant_speed(100.0, 5.55)
    samples = OrderSamples.gathered(in_memory([(1, angle, angle * 0.0)]), 8.0)
    assert samples.window.per_revolution == pytest.approx(18.018, abs=0.01)
    assert samples.window.correlation(2.0, 16.0) < 0.2
    assert samples.window.correlation(2.018018, 16.0) > 0.99
