"""Both directions together, and figure 16: in phase or not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.angle_regression import standard_basis
from model.identify.directions import combine, phase_relation
from model.identify.encoders import Encoders
from model.units import ARCMIN, ARCSEC, DEGREE
from tests.model.identify.rigs import RATIO, TRUTH, fit_both_ways, fit_over_angle, slow_run


def pair(wind_up: float = 0.0):
    runs = [slow_run(11 + int(direction), direction=direction) for direction in (1.0, -1.0)]
    return fit_both_ways(runs, wind_up=wind_up), runs


def torque_fits(runs, phase: float, amplitude: float, noise: float, conservative: float = 0.002):
    found = []
    for run, direction in zip(runs, (1.0, -1.0), strict=True):
        random = np.random.default_rng(5)
        friction = 0.06 + amplitude * np.cos(2.0 * run.input_angle - phase)
        torque = direction * friction + conservative * np.sin(2.0 * run.input_angle)
        torque = torque + noise * random.standard_normal(len(torque))
        found.append(fit_over_angle(run.input_angle, torque, standard_basis(RATIO)))
    return found


def test_the_mean_is_the_error_and_the_difference_the_wind_up() -> None:
    (ahead, back), _ = pair(wind_up=4.0 * ARCSEC)
    both = combine(ahead, back)
    for order, (a, b) in TRUTH.items():
        index = both.orders.index(min(both.orders, key=lambda v: abs(v - order)))
        assert both.cosine[index] == pytest.approx(a * ARCMIN, abs=0.1 * ARCSEC)
        assert both.sine[index] == pytest.approx(b * ARCMIN, abs=0.1 * ARCSEC)
    assert both.metrics["agreement"] < 0.3 * ARCSEC
    assert both.estimates["lost_motion"].value == pytest.approx(-8.0 * ARCSEC, abs=1.0 * ARCSEC)


def test_what_the_encoders_add_is_not_lessened_by_the_mean_of_both_directions() -> None:
    encoders = Encoders(ARCSEC, ARCSEC, output_accuracy=2.0 * ARCSEC, input_accuracy=20.0 * ARCSEC)
    runs = [slow_run(11 + int(direction), direction=direction) for direction in (1.0, -1.0)]
    both = combine(*fit_both_ways(runs, encoders=encoders))
    systematic = {
        name: [line.standard_uncertainty for line in e.budget if line.kind == "B"]
        for name, e in both.estimates.items()
    }
    # A class of +-2 arcsec: an eccentric scale may have all of it once per turn, 0 to 2 arcsec at any phase. Of the
    # motor's a rectangle of that half width has the variance of three orders in equal shares.
    of_output, of_motor = 2.0 * ARCSEC / math.sqrt(6.0), 20.0 * ARCSEC / RATIO / math.sqrt(9.0)
    assert systematic["amplitude_1/N"] == [pytest.approx(of_output)]
    # All orders at once have no more than the whole curve.
    assert encoders.waves(RATIO)[1.0 / RATIO] == pytest.approx(2.0 * ARCSEC / math.sqrt(24.0))
    assert systematic["amplitude_2"] == systematic["amplitude_4"] == [pytest.approx(of_motor)]
    turned = of_motor / both.estimates["amplitude_2"].value
    assert systematic["phase_2"] == [pytest.approx(turned)]
    assert systematic["amplitude_2-1/N"] == systematic["phase_2-1/N"] == []
    assert both.estimates["amplitude_2-1/N"].standard_uncertainty > 0.0
    # An order that the encoders alone may make is not said to be the gear's.
    loud = replace(encoders, output_accuracy=400.0 * ARCSEC)
    both = combine(*fit_both_ways(runs, encoders=loud))
    assert (
        both.estimates["amplitude_1/N"].identifiable
        == both.estimates["phase_1/N"].identifiable
        == "weakly"
    )
    assert both.estimates["amplitude_2-1/N"].identifiable == "yes"


def test_two_fits_of_one_direction_are_refused() -> None:
    (ahead, _), _ = pair()
    with pytest.raises(IdentificationError, match="same direction"):
        combine(ahead, ahead)


ERROR_PHASE = float(np.arctan2(TRUTH[2.0][1], TRUTH[2.0][0]))


@pytest.mark.parametrize(
    ("shift", "amplitude", "noise", "verdict"),
    [
        (0.0, 0.008, 0.003, "in phase"),
        (90.0, 0.001, 0.003, "not in phase"),
        (-120.0, 0.008, 0.003, "not in phase"),
        (30.0, 0.0002, 0.03, "cannot tell"),
    ],
)
def test_figure_16(shift: float, amplitude: float, noise: float, verdict: str) -> None:
    (ahead, back), runs = pair()
    forward, reverse = torque_fits(runs, ERROR_PHASE + shift * DEGREE, amplitude, noise)
    found = phase_relation(combine(ahead, back), forward, reverse)
    assert found.verdict == verdict
    estimate = found.estimates["phase_difference"]
    if verdict != "cannot tell":
        assert abs(estimate.value - shift * DEGREE) < 0.15
        assert found.estimates["conservative_amplitude"].value == pytest.approx(0.002, abs=3e-4)
        assert found.estimates["friction_amplitude"].value == pytest.approx(amplitude, rel=0.1)
    assert np.ptp(found.friction_torque) > 0.0
