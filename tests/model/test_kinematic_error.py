"""Kinematic error: sign, series, basis, goodness of fit, spectrum, eccentric error."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.errors import ModelError
from model.gear import Harmonic
from model.gear_file import shipped_gear
from model.kinematic_error import (
    basis_orders,
    design_matrix,
    equivalent_eccentric_error,
    kinematic_error,
    normalised_mse,
    order_spectrum,
    output_sign,
    peak_to_peak,
    series_slope,
    series_value,
    speed_ripple,
)
from model.units import ARCMIN

GEAR = shipped_gear()


@pytest.mark.parametrize("mounting", ["circular-spline-fixed", "flexspline-fixed"])
@pytest.mark.parametrize("alike", [True, False])
def test_positive_means_that_the_output_leads(mounting: str, alike: bool) -> None:
    total = GEAR.ratio if mounting == "circular-spline-fixed" else GEAR.ratio + 1.0
    lead = 0.5 * ARCMIN
    turned = 3.0 / total + lead
    opposite = mounting == "circular-spline-fixed"
    raw = -turned if opposite == alike else turned
    found = kinematic_error([3.0], [raw], GEAR.ratio, mounting, encoders_alike=alike)  # type: ignore[arg-type]
    assert found[0] == pytest.approx(lead, rel=1e-12)
    assert output_sign(mounting, encoders_alike=alike) * raw > 0.0  # type: ignore[arg-type]


def test_series_slope_is_the_derivative() -> None:
    series = (
        *GEAR.kinematic_error,
        Harmonic(2.0 * (1.0 + 1.0 / 120.0), 1e-5, -2e-5),
        Harmonic(1.0 / 120.0, 3e-5, 1e-5),
    )
    angle, step = np.linspace(-7.0, 300.0, 501), 1e-5
    difference = (series_value(series, angle + step) - series_value(series, angle - step)) / (
        2.0 * step
    )
    assert np.max(np.abs(series_slope(series, angle) - difference)) < 1e-9
    assert series_value(series, angle.reshape(3, 167)).shape == (3, 167)


@settings(max_examples=50)
@given(turns=st.integers(-1000, 1000), angle=st.floats(0.0, 6.3))
def test_whole_orders_are_periodic(turns: int, angle: float) -> None:
    moved = series_value(GEAR.kinematic_error, angle + 2.0 * math.pi * turns)
    assert moved == pytest.approx(float(series_value(GEAR.kinematic_error, angle)), abs=1e-15)


def test_default_error_is_as_large_as_stated() -> None:
    assert peak_to_peak(GEAR.kinematic_error) / ARCMIN == pytest.approx(0.84, abs=5e-3)
    assert speed_ripple(GEAR) == pytest.approx(0.036, abs=5e-4)
    angle = np.linspace(0.0, 2.0 * math.pi, 1_000_001)
    assert peak_to_peak(GEAR.kinematic_error) == pytest.approx(
        np.ptp(series_value(GEAR.kinematic_error, angle)), rel=1e-5
    )


def test_sidebands_need_the_whole_output_revolution() -> None:
    beating = (Harmonic(2.0, 1e-4, 0.0), Harmonic(2.0 + 2.0 / 120.0, 1e-4, 0.0))
    assert peak_to_peak(beating, 120.0) == pytest.approx(4e-4, rel=1e-3)
    assert peak_to_peak(()) == 0.0


def test_one_arcminute_is_sixteen_micrometre_of_wedge() -> None:
    assert equivalent_eccentric_error(GEAR, ARCMIN) == pytest.approx(15.6e-6, abs=0.05e-6)


def test_basis_holds_input_output_and_sideband_orders_once() -> None:
    orders = basis_orders(120.0)
    labels = {order.label: order.order for order in orders}
    assert labels["2"] == 2.0
    assert labels["1/N"] == pytest.approx(1.0 / 120.0)
    assert labels["2+2/N"] == pytest.approx(2.0 * (1.0 + 1.0 / 120.0))
    assert labels["2-1/N"] == pytest.approx(2.0 - 1.0 / 120.0)
    numbers = np.array([order.order for order in orders])
    assert np.all(np.diff(numbers) > 1e-6)
    kinds = {order.label: order.kind for order in orders}
    assert (kinds["1/N"], kinds["2"], kinds["2+2/N"]) == ("output", "input", "wave-sideband")
    with pytest.raises(ModelError, match="ratio"):
        basis_orders(0.0)
    with pytest.raises(ModelError, match="positive"):
        basis_orders(120.0, output_sidebands=[(1, 120)])


def test_least_squares_in_the_basis_recovers_the_series() -> None:
    orders = basis_orders(120.0, range(1, 6))
    angle = np.linspace(0.0, 2.0 * math.pi * 120.0, 60_013)
    truth = (
        series_value([*GEAR.kinematic_error, Harmonic(2.0 + 2.0 / 120.0, 2e-6, 1e-6)], angle)
        + 3e-4
        + 1e-9 * angle
    )
    names = ["a_0", "slope"]
    for order in orders:
        names += [f"a_{order.label}", f"b_{order.label}"]
    matrix = design_matrix(angle, orders)
    assert matrix.shape == (angle.size, len(names))
    found = dict(zip(names, np.linalg.lstsq(matrix, truth, rcond=None)[0], strict=True))
    assert found["a_0"] == pytest.approx(3e-4, rel=1e-9)
    assert found["slope"] == pytest.approx(1e-9, rel=1e-6)
    assert found["a_2"] == pytest.approx(0.30 * ARCMIN, rel=1e-9)
    assert found["b_2+2/N"] == pytest.approx(1e-6, rel=1e-6)
    assert found["a_3"] == pytest.approx(0.0, abs=1e-14)
    assert design_matrix(angle[:5], [2.0], constant=False, trend=False).shape == (5, 2)


def test_mse_is_hundred_for_the_mean_and_nought_for_the_truth() -> None:
    truth = series_value(GEAR.kinematic_error, np.linspace(0.0, 6.0, 999))
    assert normalised_mse(truth, np.full(truth.size, truth.mean())) == pytest.approx(
        100.0, rel=1e-12
    )
    assert normalised_mse(truth, truth) == 0.0
    assert normalised_mse(truth, truth + 0.1 * truth.std()) == pytest.approx(1.0, rel=1e-9)
    for bad in (np.zeros(3), np.array([1.0])):
        with pytest.raises(ModelError, match="MSE"):
            normalised_mse(bad, bad)
    with pytest.raises(ModelError, match="same length"):
        normalised_mse(truth, truth[:-1])


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("samples", [100_003, 3_001])
def test_order_spectrum_finds_amplitude_and_phase(direction: float, samples: int) -> None:
    rng = np.random.default_rng(3)
    angle = direction * (
        0.7 + np.linspace(0.0, 2.0 * math.pi * 10.4, samples) + 1e-4 * rng.standard_normal(samples)
    )
    values = series_value(GEAR.kinematic_error, angle) + 1e-3 + 2e-6 * angle
    spectrum = order_spectrum(angle, values, 16.0)
    assert spectrum.revolutions == 10
    for harmonic in GEAR.kinematic_error:
        place = int(np.argmin(np.abs(spectrum.orders - harmonic.order)))
        assert spectrum.orders[place] == harmonic.order
        assert spectrum.amplitude[place] == pytest.approx(harmonic.amplitude, rel=0.02)
        difference = spectrum.phase[place] - math.atan2(harmonic.sine, harmonic.cosine)
        assert math.remainder(difference, 2.0 * math.pi) == pytest.approx(0.0, abs=0.02)
    quiet = spectrum.amplitude[(np.abs(spectrum.orders - 7.0) < 0.5)]
    assert quiet.max() < 0.02 * GEAR.kinematic_error[1].amplitude


def test_order_spectrum_refuses_what_it_cannot_do() -> None:
    angle = np.linspace(0.0, 6.0, 100)
    with pytest.raises(ModelError, match="whole revolution"):
        order_spectrum(angle, angle)
    with pytest.raises(ModelError, match="not finite"):
        order_spectrum(2.0 * angle, np.full(100, math.nan))
    with pytest.raises(ModelError, match="every value"):
        order_spectrum(angle, angle[:50])


@pytest.mark.parametrize("ratio", [80.0, 120.0, 100.5, math.pi * 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_peak_to_peak_of_any_orders_is_that_of_the_curve(seed: int, ratio: float) -> None:
    random = np.random.default_rng(seed)
    orders = [1.0, 2.0, 3.0, 4.0, 2.0 - 1.0 / ratio, 2.0 + 2.0 / ratio, 1.0 / ratio, 5.0 / ratio]
    series = [Harmonic(order, *random.normal(0.0, 0.1 * ARCMIN, 2)) for order in orders]
    angle = np.linspace(0.0, 2.0 * math.pi * ratio, 1_000_003)
    curve = series_value(series, angle)
    expected = float(curve.max() - curve.min())
    assert peak_to_peak(series, ratio, 120) == pytest.approx(expected, rel=2e-4)
