"""Orders follow the data; spring, delay and rounding on the lattice are in the numbers; amplitudes are Rice's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.gear import Harmonic
from model.gear_file import shipped_gear
from model.identify.angle_fit import solve_angle
from model.identify.angle_regression import AngleRegression, standard_basis
from model.identify.counting import LockedRounding
from model.identify.directions import combine
from model.identify.encoders import Encoders
from model.identify.estimate import BudgetLine
from model.identify.kinematic_error import (
    KinematicErrorAccumulator,
    KinematicErrorFit,
    fit_traverses,
)
from model.identify.polar import polar, rice_interval
from model.identify.torsion import Torsion, UnstatedMode
from model.kinematic_error import lattice_label, order_of_label, peak_to_peak
from model.linear import dynamic_parameters
from model.units import ARCSEC, REVOLUTION, RPM
from tests.model.identify.rigs import INPUT_QUANTUM, OUTPUT_QUANTUM, RATIO, counted

Waves = dict[float, complex]
"""Complex amplitudes a - ib by order [arcsec]."""
ENCODERS = Encoders(OUTPUT_QUANTUM, INPUT_QUANTUM)
SIDEBANDS: Waves = {
    1.0: 4 + 1j,
    2.0: 15 - 6j,
    4.0 - 3.0 / RATIO: 6 - 2j,
    5.0 + 1.0 / RATIO: 7j,
    6.0: 3 - 3j,
    6.0 + 6.0 / RATIO: 5 + 1j,
}


def curve(waves: Waves, angle: np.ndarray) -> np.ndarray:
    """The waves over the angle [rad]."""
    return sum(
        (ARCSEC * np.real(c * np.exp(1j * v * angle)) for v, c in waves.items()),
        start=np.zeros_like(angle),
    )


def traverse(
    waves: Waves,
    *,
    direction: float = 1.0,
    speed_rpm: float = 61.8,
    ripple: Waves | None = None,
    follow: Torsion | None = None,
    delay: float = 0.0,
    seed: int = 1,
) -> KinematicErrorAccumulator:
    """One direction over an output revolution as both encoders count it.

    `ripple` is that of the input, as waves at the output; `follow` the spring that carries the
    output, which is read later by `delay` [s].
    """
    random = np.random.default_rng(seed)
    speed = direction * speed_rpm * RPM
    n = int(121.0 * 60.0 / speed_rpm * 1000.0)
    time = np.arange(n) / 1000.0
    mean = random.uniform(0.0, REVOLUTION) + speed * time
    shaken = curve(ripple or {}, mean)
    angle = mean + RATIO * shaken
    answered: Waves = {}
    for part in (waves, ripple or {}):
        for v, c in part.items():
            stretch = 1.0 if follow is None else complex(follow.response(np.array([v * speed]))[0])
            later = c * (stretch * np.exp(1j * v * speed * delay) - 1.0)
            answered[v] = answered.get(v, 0.0) + later
    output = (angle + speed * delay) / RATIO + curve(waves, angle) + curve(answered, mean) + 0.3
    one = KinematicErrorAccumulator(RATIO, encoders=ENCODERS, beside=1)
    one.add(counted(angle, INPUT_QUANTUM), counted(output, OUTPUT_QUANTUM), time)
    return one


def found(fit: KinematicErrorFit, order: float) -> complex:
    one = fit.order(order)
    return complex(one.cosine.value, -one.sine.value) / ARCSEC


def test_sidebands_of_any_order_are_found_and_fitted() -> None:
    fit = traverse(SIDEBANDS).fit()
    assert set(SIDEBANDS) <= set(fit.basis.orders)
    for order, wave in SIDEBANDS.items():
        assert abs(found(fit, order) - wave) < 0.1
    assert fit.metrics["left_over"] < 0.2 * ARCSEC
    clean = standard_basis(RATIO)
    extra = set(fit.basis.orders) - set(clean.orders) - set(SIDEBANDS)
    assert len(extra) <= 2


def test_a_line_that_the_directions_do_not_share_is_not_the_gears() -> None:
    """Folded rounding stands anywhere, with another phase in each direction; the gear's sideband does not."""
    line, own = 5.0 - 5.0 / RATIO, 4.0 - 3.0 / RATIO
    ahead = traverse(SIDEBANDS | {line: 2.0 + 0j})
    back = traverse(SIDEBANDS | {line: -0.5 + 1.5j}, direction=-1.0, seed=2)
    forward, reverse = fit_traverses([ahead, back])
    both = combine(forward, reverse)
    assert forward.order(line).significant
    assert reverse.order(line).significant
    assert f"amplitude_{lattice_label(line, RATIO)}" not in both.estimates
    assert both.estimates[f"amplitude_{lattice_label(own, RATIO)}"].identifiable == "yes"


def test_what_the_orders_leave_stands_in_u() -> None:
    """A basis that lacks the sidebands leaves nine arcseconds of them."""
    source = traverse(SIDEBANDS)
    bare = KinematicErrorAccumulator(
        RATIO, basis=standard_basis(RATIO), encoders=ENCODERS, beside=1
    )
    bare._regression = source._regression
    bare.samples = source.samples
    fit = bare.fit()
    missing = [c for v, c in SIDEBANDS.items() if v not in fit.basis.orders]
    left = math.sqrt(sum(abs(c) ** 2 for c in missing) / 2.0)
    assert fit.metrics["left_over"] / ARCSEC == pytest.approx(left, rel=0.05)
    truth = source.fit().estimates["transmission_accuracy"].value
    accuracy = fit.estimates["transmission_accuracy"]
    assert abs(accuracy.value - truth) > accuracy.high - accuracy.value
    assert abs(accuracy.value - truth) < 1.5 * accuracy.expanded_uncertainty


def test_an_encoder_with_orders_5_to_8_has_no_slip() -> None:
    """Within +-5 arcsec as a whole; it closes, and the orders are fitted."""
    waves = SIDEBANDS | {k / RATIO: 1.1 * np.exp(1j * k * k) for k in range(1, 9)}
    for seed in range(3):
        fit = traverse(waves, seed=seed).fit()
        assert fit.slips == ()
        assert not [w for w in fit.warnings if "close" in w]
        for k in range(1, 9):
            assert abs(found(fit, k / RATIO) - waves[k / RATIO]) < 0.3


SPRING = Torsion(
    parameters=dynamic_parameters(shipped_gear(), output_inertia=0.5), relative_uncertainty=0.26
)


def test_spring_and_delay_are_taken_out_per_order() -> None:
    """At 95 r/min order 6 has r^2 of 0.04: uncorrected it is 0.2 arcsec too large; ripple is amplified too."""
    ripple: Waves = {1.0: 3 - 2j, 4.0: -2 + 2j}
    sums = [
        traverse(
            SIDEBANDS,
            direction=way,
            speed_rpm=95.0,
            ripple={v: way * c for v, c in ripple.items()},
            follow=SPRING,
            delay=1e-3,
        )
        for way in (1.0, -1.0)
    ]
    raw, mended = (fit_traverses(sums, spring=spring, time=0) for spring in (None, SPRING))
    assert mended[0].delay == pytest.approx(1e-3, abs=1e-4)
    both = combine(*mended)
    for order, wave in SIDEBANDS.items():
        at = both.orders.index(order)
        one = complex(both.cosine[at], -both.sine[at]) / ARCSEC
        assert abs(one - wave) < 0.12, order
        assert abs(found(mended[0], order) - wave) < 0.2, order
    share = (6.0 * mended[0].speed / SPRING.first_mode) ** 2
    size = abs(SIDEBANDS[6.0])
    assert abs(found(raw[0], 6.0)) - size > 0.7 * share * size
    lines = {line.source: line for line in mended[0].order(6.0).amplitude.budget}
    torsion = next(line for source, line in lines.items() if source.startswith("torsional"))
    assert torsion.standard_uncertainty / ARCSEC == pytest.approx(0.26 * share * size, rel=0.2)


def test_orders_too_near_the_mode_are_not_identified() -> None:
    soft = Torsion(
        parameters=dynamic_parameters(shipped_gear(), output_inertia=12.0),
        relative_uncertainty=0.26,
    )
    (fit,) = fit_traverses([traverse(SIDEBANDS, speed_rpm=61.8)], spring=soft, time=0)
    assert fit.order(6.0).amplitude.identifiable == "no"
    assert "mode" in fit.estimates["transmission_accuracy"].note
    assert fit.order(1.0).amplitude.identifiable == "yes"


def test_on_the_lattice_the_intervals_hold_the_orders_all_the_same() -> None:
    """600 samples and 600 counts per input revolution: rounding falls on the orders, and no residual shows it.

    An error of whole orders alone leaves nothing beside them.
    """
    held, widths = [], []
    whole: Waves = {1.0: 4 + 1j, 2.0: 15 - 6j, 4.0: 6 - 2j, 5.0: 7j, 6.0: 3 - 3j}
    for seed in range(6):
        fit = traverse(whole, speed_rpm=100.0, seed=seed).fit()
        for order, wave in whole.items():
            cosine = fit.order(order).cosine
            held.append(cosine.low <= wave.real * ARCSEC <= cosine.high)
            widths.append(cosine.high - cosine.low)
    assert np.mean(held) >= 0.85
    assert np.median(widths) > 0.5 * ARCSEC
    off = traverse(SIDEBANDS, speed_rpm=61.8).fit().order(2.0).cosine
    assert off.high - off.low < 0.2 * ARCSEC


def test_locked_rounding_has_the_power_of_the_saw_tooth() -> None:
    """Summed over all orders and sidebands it is quantum^2/12, whatever spreads it."""
    regression = AngleRegression(RATIO)
    angle = np.linspace(0.0, 121.0 * REVOLUTION, 60_000)
    regression.add(angle, curve(SIDEBANDS, angle))
    fit, _ = solve_angle(regression.cells(), standard_basis(RATIO))
    locked = LockedRounding.of(fit, 600.0, OUTPUT_QUANTUM)
    every = 4  # of the orders over which each harmonic spreads
    lattice = (np.arange(0, 3000, every)[:, None] + np.arange(-59, 60)[None, :] / RATIO).ravel()
    total = every * float(locked.variance(lattice[lattice > 0.0]).sum())
    assert total == pytest.approx(OUTPUT_QUANTUM**2 / 12.0, rel=0.1)
    free = LockedRounding.of(fit, 600.0 * 1.6180339887, OUTPUT_QUANTUM)
    assert free.variance(np.array([2.0]))[0] < 1e-3 * locked.variance(np.array([2.0]))[0]


def test_amplitudes_cover_as_rice_has_it() -> None:
    random = np.random.default_rng(3)
    for truth in (0.0, 0.5, 1.5, 4.0, 30.0):
        lengths = np.abs(truth + random.standard_normal(800) + 1j * random.standard_normal(800))
        inside = [low <= truth <= high for low, high in (rice_interval(r, 1.0) for r in lengths)]
        assert 0.925 <= np.mean(inside) <= 1.0, truth
    assert rice_interval(1.0, 1.0)[0] == 0.0
    below = polar("3", np.array([1.0, 0.0]), np.eye(2), 48.0, "rad").amplitude
    assert below.identifiable == "weakly"
    assert below.note.startswith("not distinguishable from zero, below")


def test_noise_does_not_raise_the_transmission_accuracy() -> None:
    """The peak-to-peak of a fitted curve is biased upwards by its noise; the estimate is not, its interval holds."""
    waves: Waves = {1.0: 4 + 1j, 2.0: 15 - 6j, 2.0 + 1.0 / RATIO: 8j, 4.0: 5 + 0j}
    truth = peak_to_peak(
        [Harmonic(v, c.real * ARCSEC, -c.imag * ARCSEC) for v, c in waves.items()], RATIO, 200
    )
    errors, held, raw = [], [], []
    for seed in range(24):
        random = np.random.default_rng(seed)
        angle = np.linspace(0.0, 120.5 * REVOLUTION, 40_000)
        regression = KinematicErrorAccumulator(RATIO)
        noise = 150.0 * ARCSEC * random.standard_normal(len(angle))
        regression.add(angle, angle / RATIO + curve(waves, angle) + noise)
        fit = regression.fit()
        found_now = fit.estimates["transmission_accuracy"]
        errors.append(found_now.value - truth)
        raw.append(float(np.ptp(fit.output_curve)) - truth)
        held.append(found_now.low <= truth <= found_now.high)
    scatter = np.std(errors) / math.sqrt(len(errors))
    assert np.mean(raw) > 3.0 * scatter
    assert abs(np.mean(errors)) < 0.6 * np.mean(raw)
    assert np.mean(held) >= 0.8


def test_what_a_slow_curve_of_the_encoder_adds_to_a_peak_to_peak_is_taken_off() -> None:
    """Under a fast error it adds its own peak-to-peak at every phase: a bias, unless it is corrected."""
    limit = 5.0 * ARCSEC
    waves: Waves = {1.0: 4 + 1j, 2.0: 15 - 6j, 2.0 + 1.0 / RATIO: 8j, 4.0: 5 + 0j}
    gear = [Harmonic(v, c.real * ARCSEC, -c.imag * ARCSEC) for v, c in waves.items()]
    truth = peak_to_peak(gear, RATIO, 200)
    turn = np.linspace(0.0, 120.5 * REVOLUTION, 20_000)
    errors, seen, expanded = [], [], []
    for seed in range(8):
        random = np.random.default_rng(seed)
        sizes = random.random(8) * np.exp(2j * math.pi * random.random(8))
        alone: Waves = {(k + 1) / RATIO: c for k, c in enumerate(sizes)}
        scale = random.uniform(1.0, 2.0) * limit / np.ptp(curve(alone, turn))
        bench: Waves = {v: scale * c for v, c in alone.items()}
        regression = KinematicErrorAccumulator(RATIO, encoders=Encoders(output_accuracy=limit))
        noise = 5.0 * ARCSEC * random.standard_normal(len(turn))
        regression.add(turn, turn / RATIO + curve(waves | bench, turn) + noise)
        fit = regression.fit()
        accuracy, taken = fit.estimates["transmission_accuracy"], fit.metrics["raised_by_bench"]
        series = [Harmonic(v, c.real * ARCSEC, -c.imag * ARCSEC) for v, c in bench.items()]
        seen.append(peak_to_peak([*gear, *series], RATIO, 200) - truth)
        errors.append(accuracy.value - truth)
        expanded.append(accuracy.expanded_uncertainty)
        # What was taken off the value was taken off its interval.
        assert accuracy.low <= accuracy.value <= accuracy.high
        assert accuracy.low - truth <= seen[-1] - taken <= accuracy.high - truth
        assert "taken off" in accuracy.note
    assert np.mean(seen) > np.mean(expanded) / 2.0
    assert abs(np.mean(errors)) < np.mean(expanded) / 3.0


@pytest.mark.parametrize("order", [1.0, 12.0, 1 / 120, 8 / 120, 2 - 1 / 120, 6 + 6 / 120])
def test_orders_and_their_names(order: float) -> None:
    assert order_of_label(lattice_label(order, RATIO), RATIO) == pytest.approx(order, abs=1e-12)


def test_the_growth_of_the_orders_bounds_a_mode_that_nobody_stated() -> None:
    """At 61.8 and 190.6 r/min; the mode of this spring is at some 40 Hz."""
    sums = [
        traverse(SIDEBANDS, speed_rpm=speed, follow=SPRING, seed=seed)
        for seed, speed in enumerate((61.8, 190.6))
    ]
    line = BudgetLine("not stated", "B", 0.0, assumed="output inertia")
    unstated = UnstatedMode(largest=1.0 / (8.0 * REVOLUTION) ** 2, line=line)
    one, other = fit_traverses(sums, spring=unstated, time=0)
    assert one.torsion.source == other.torsion.source != "not stated"
    assert not one.torsion.assumed
    (alone,) = fit_traverses(sums[:1], spring=unstated, time=0)
    assert alone.torsion.assumed == "output inertia"
