"""The kinematic error is recovered from counted angles, streamed or not, with honest intervals."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.errors import IdentificationError
from model.gear import Harmonic
from model.identify.angle_fit import solve_angle
from model.identify.angle_regression import AngleRegression, Basis
from model.identify.encoders import Encoders
from model.identify.kinematic_error import KinematicErrorAccumulator, score_kinematic_error
from model.kinematic_error import design_matrix, peak_to_peak
from model.units import ARCMIN, ARCSEC, REVOLUTION
from tests.model.identify.rigs import (
    INPUT_QUANTUM,
    OUTPUT_QUANTUM,
    RATIO,
    TRUTH,
    error_curve,
    fit_kinematic_error,
    slow_run,
)

ENCODERS = Encoders(
    OUTPUT_QUANTUM, INPUT_QUANTUM, output_accuracy=1.0 * ARCSEC, input_accuracy=20.0 * ARCSEC
)


@pytest.fixture(scope="module")
def forward():
    run = slow_run(1)
    return fit_kinematic_error(run.input_angle, run.output_angle, RATIO, encoders=ENCODERS)


def test_orders_are_recovered_within_a_tenth_of_an_arcsecond(forward) -> None:
    for order, (a, b) in TRUTH.items():
        found = forward.order(order)
        assert found.significant
        assert found.cosine.value == pytest.approx(a * ARCMIN, abs=0.1 * ARCSEC)
        assert found.sine.value == pytest.approx(b * ARCMIN, abs=0.1 * ARCSEC)


def test_transmission_accuracy_is_the_peak_to_peak_over_one_output_revolution(forward) -> None:
    series = [Harmonic(order, a * ARCMIN, b * ARCMIN) for order, (a, b) in TRUTH.items()]
    accuracy = forward.estimates["transmission_accuracy"]
    assert accuracy.value == pytest.approx(
        peak_to_peak(series, RATIO, points=720), abs=0.3 * ARCSEC
    )
    assert accuracy.identifiable == "yes"
    assert {line.kind for line in accuracy.budget} == {"A", "B"}
    assert forward.metrics["raw_peak_to_peak"] > accuracy.value + 0.5 * OUTPUT_QUANTUM


def test_a_stated_order_limits_the_transmission_accuracy() -> None:
    run = slow_run(1)
    low = fit_kinematic_error(run.input_angle, run.output_angle, RATIO, accuracy_order=1.0)
    series = [
        Harmonic(order, a * ARCMIN, b * ARCMIN) for order, (a, b) in TRUTH.items() if order <= 1.0
    ]
    assert low.estimates["transmission_accuracy"].value == pytest.approx(
        peak_to_peak(series, RATIO, points=720), abs=0.3 * ARCSEC
    )


def test_mse_is_small_on_the_averaged_curve_and_not_on_raw_samples(forward) -> None:
    assert forward.metrics["mse_curve"] < 0.05
    raw_variance = np.var(
        error_curve(np.linspace(0.0, RATIO * REVOLUTION, 200_000, endpoint=False))
    )
    expected = 100.0 * OUTPUT_QUANTUM**2 / 12.0 / (raw_variance + OUTPUT_QUANTUM**2 / 12.0)
    assert forward.metrics["mse_raw"] == pytest.approx(expected, rel=0.1)


def test_a_fit_predicts_a_run_that_it_has_not_seen(forward) -> None:
    run = slow_run(2, direction=-1.0)
    other = fit_kinematic_error(run.input_angle, run.output_angle, RATIO, encoders=ENCODERS)
    assert score_kinematic_error(forward, other).mse < 0.05


def test_nothing_is_to_complain_about_in_a_clean_run(forward) -> None:
    assert forward.warnings == ()
    assert forward.slips == ()
    slope = forward.estimates["slope"]
    assert abs(slope.value) < 3.0 * (slope.high - slope.low)
    assert forward.estimates["ratio"].value == pytest.approx(RATIO, abs=1e-4)


def test_the_edge_triggered_fit_agrees(forward) -> None:
    run = slow_run(1)
    edge = fit_kinematic_error(
        run.input_angle, run.output_angle, RATIO, encoders=ENCODERS, edge_triggered=True
    )
    for order in TRUTH:
        assert edge.order(order).cosine.value == pytest.approx(
            forward.order(order).cosine.value, abs=0.15 * ARCSEC
        )


@settings(max_examples=6)
@given(cuts=st.lists(st.integers(0, 40_000), max_size=12), edge=st.booleans())
def test_the_cutting_into_blocks_changes_nothing(cuts: list[int], edge: bool) -> None:
    run = slow_run(3, revolutions=40.0)
    results = []
    for places in ([], sorted(cuts)):
        accumulator = KinematicErrorAccumulator(RATIO, edge_triggered=edge)
        for part in np.split(np.arange(len(run.time)), places):
            accumulator.add(run.input_angle[part], run.output_angle[part])
        results.append(accumulator.fit().regression.values)
    np.testing.assert_allclose(results[1], results[0], rtol=0, atol=1e-13)


@settings(max_examples=10)
@given(
    seed=st.integers(0, 10_000),
    direction=st.sampled_from([1.0, -1.0]),
    per_turn=st.floats(400.0, 5000.0),
)
def test_streaming_equals_ordinary_least_squares(
    seed: int, direction: float, per_turn: float
) -> None:
    """Summing cells loses a little contrast; regressors are means to fourth order about the centroid."""
    random = np.random.default_rng(seed)
    basis = Basis(RATIO, (1.0, 2.0, 3.0, 2.0 + 2.0 / RATIO, 1.0 / RATIO, 2.37))
    angle = direction * np.sort(random.uniform(0.0, 130.0 * REVOLUTION, int(130 * per_turn / 40)))
    truth = random.standard_normal(basis.parameters)
    value = design_matrix(angle, basis.orders) @ np.concatenate(
        [truth[:1], truth[1:2] / (REVOLUTION * RATIO), truth[2:]]
    )
    regression = AngleRegression(basis.ratio)
    regression.add(angle, value)
    fit, _ = solve_angle(regression.cells(), basis)
    expected = truth.copy()
    expected[0] += truth[1] * angle[0] / (REVOLUTION * RATIO)
    np.testing.assert_allclose(fit.values, expected, atol=1e-8)


def test_intervals_cover_the_truth() -> None:
    inside = []
    for seed in range(16):
        run = slow_run(seed, direction=(-1.0) ** seed, noise=2.0 * ARCSEC)
        fit = fit_kinematic_error(run.input_angle, run.output_angle, RATIO)
        for order, (a, b) in TRUTH.items():
            found = fit.order(order)
            inside += [
                found.cosine.low <= a * ARCMIN <= found.cosine.high,
                found.sine.low <= b * ARCMIN <= found.sine.high,
            ]
    assert 0.90 <= np.mean(inside) <= 0.99


def test_memory_does_not_grow_with_the_recording() -> None:
    peaks = []
    for revolutions in (800, 3200):
        regression = AngleRegression(RATIO)
        regression.add(np.linspace(0.0, 10.0, 100), np.zeros(100))
        tracemalloc.start()
        for turn in range(2, revolutions, 20):
            angle = np.linspace(turn * REVOLUTION, (turn + 20) * REVOLUTION, 1000)
            regression.add(angle, np.cos(2.0 * angle))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert regression.cells().revolutions > revolutions - 3
    assert peaks[1] < 1.05 * peaks[0] + 1e4


def test_output_revolutions_laid_on_each_other_lose_nothing() -> None:
    basis = Basis(1.0, (1.0, 2.0))
    regression = AngleRegression(1.0)
    angle = np.linspace(0.0, 3000.0 * REVOLUTION, 300_000)
    value = 0.5 + np.cos(angle) + 0.2 * np.sin(2.0 * angle) + 1e-3 * angle / REVOLUTION
    regression.add(angle, value)
    cells = regression.cells()
    assert cells.samples == cells.count.sum() == len(angle)
    assert cells.rows <= 1024
    assert cells.layers == 4
    fit, _ = solve_angle(cells, basis)
    np.testing.assert_allclose(fit.values, [0.5, 1e-3, 1.0, 0.0, 0.0, 0.2], atol=2e-6)


def test_a_short_run_leaves_out_what_it_cannot_separate() -> None:
    run = slow_run(4, revolutions=20.0)
    fit = fit_kinematic_error(run.input_angle, run.output_angle, RATIO, encoders=ENCODERS)
    assert any("output revolutions" in w for w in fit.warnings)
    assert fit.estimates["transmission_accuracy"].identifiable == "no"
    assert fit.order(1.0 / RATIO).amplitude.identifiable == "no"
    assert fit.order(4.0).amplitude.value == pytest.approx(0.08 * ARCMIN, abs=0.3 * ARCSEC)


def test_sampling_on_the_lattice_of_counts_is_warned_about() -> None:
    run = slow_run(5, speed_rpm=100.0)
    fit = fit_kinematic_error(run.input_angle, run.output_angle, RATIO, encoders=ENCODERS)
    assert any("incommensurate" in w for w in fit.warnings)


def test_phase_and_amplitude_describe_the_same_order(forward) -> None:
    found = forward.order(2.0)
    assert found.amplitude.value * math.cos(found.phase.value) == pytest.approx(found.cosine.value)
    assert found.amplitude.value * math.sin(found.phase.value) == pytest.approx(found.sine.value)


def test_an_order_that_is_not_there_is_not_significant(forward) -> None:
    for order, label in ((5.0, "5"), (7.0, "7")):
        assert not forward.order(order).significant
        assert f"phase_{label}" not in forward.estimates
    assert "amplitude_7" not in forward.estimates
    expected = forward.estimates["amplitude_5"]
    assert expected.identifiable == "weakly"
    assert "not distinguishable from zero, below" in expected.note


@pytest.mark.parametrize(
    ("angle", "output", "what"),
    [
        (np.array([]), np.array([]), "no motion"),
        (np.zeros(5000), np.zeros(5000), "no motion"),
        (np.linspace(0, 3.0, 50), np.linspace(0, 0.03, 50), "less than one input revolution"),
        (np.full(1000, np.nan), np.zeros(1000), "not finite"),
        (np.arange(10.0), np.arange(11.0), "differ in length"),
        (np.linspace(0, 800.0, 20), np.linspace(0, 800.0 / 120, 20), "too few samples per input"),
    ],
)
def test_bad_input_is_refused(angle: np.ndarray, output: np.ndarray, what: str) -> None:
    with pytest.raises(IdentificationError, match=what):
        fit_kinematic_error(angle, output, RATIO)


@pytest.mark.parametrize("orders", [(), (0.0,), (1.0, 1.0), (math.nan,)])
def test_an_impossible_basis_is_refused(orders: tuple[float, ...]) -> None:
    with pytest.raises(IdentificationError, match="orders"):
        Basis(RATIO, orders)
