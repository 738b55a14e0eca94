"""Slipped counts, wrong ratios and lost counts are found and named; a clean run is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from model.errors import IdentificationError
from model.identify.counting import lattice_aliases, ratio_from_slope
from model.identify.encoders import Encoders
from model.units import ARCSEC, REVOLUTION
from tests.model.identify.rigs import (
    INPUT_QUANTUM,
    OUTPUT_QUANTUM,
    RATIO,
    fit_kinematic_error,
    slow_run,
)

ENCODERS = Encoders(OUTPUT_QUANTUM, INPUT_QUANTUM)


@pytest.mark.parametrize("counts", [1, -1, 3])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_slipped_output_count_is_found_counted_and_taken_out(
    counts: int, direction: float
) -> None:
    run = slow_run(1, direction=direction)
    clean = fit_kinematic_error(run.input_angle, run.output_angle, RATIO, encoders=ENCODERS)
    output = run.output_angle.copy()
    at = 40_000
    output[at:] += counts * OUTPUT_QUANTUM
    fit = fit_kinematic_error(run.input_angle, output, RATIO, encoders=ENCODERS)
    assert len(fit.slips) == 1
    assert fit.slips[0].output_counts == pytest.approx(counts, abs=0.1)
    assert fit.slips[0].angle_low <= run.input_angle[at] <= fit.slips[0].angle_high
    assert any("slipped" in w for w in fit.warnings)
    accuracy = fit.estimates["transmission_accuracy"].value
    assert accuracy == pytest.approx(
        clean.estimates["transmission_accuracy"].value, abs=0.3 * ARCSEC
    )


def test_two_slips_are_told_apart() -> None:
    run = slow_run(2)
    output = run.output_angle.copy()
    output[30_000:] += OUTPUT_QUANTUM
    output[90_000:] -= 2 * OUTPUT_QUANTUM
    fit = fit_kinematic_error(run.input_angle, output, RATIO, encoders=ENCODERS)
    assert [round(s.output_counts) for s in fit.slips] == [1, -2]


def test_slipped_input_counts_are_named_as_such() -> None:
    run = slow_run(3)
    angle = run.input_angle.copy()
    angle[60_000:] += 5 * INPUT_QUANTUM
    (slip,) = fit_kinematic_error(angle, run.output_angle, RATIO, encoders=ENCODERS).slips
    assert slip.input_counts == pytest.approx(5.0, abs=0.5)


@pytest.mark.parametrize(
    ("stated", "sign", "remedy"),
    [
        (121.0, 1.0, "nearest whole ratio is 120"),
        (120.0, -1.0, "sign"),
        (60.0, 1.0, "lines and multiplication"),
        (120.05, 1.0, "120"),
    ],
)
def test_a_wrong_ratio_is_refused_with_the_ratio_that_the_encoders_show(
    stated: float, sign: float, remedy: str
) -> None:
    run = slow_run(4)
    with pytest.raises(IdentificationError, match=remedy):
        fit_kinematic_error(run.input_angle, sign * run.output_angle, stated, encoders=ENCODERS)


def test_counts_that_are_lost_all_the_time_show_as_a_slope() -> None:
    run = slow_run(5)
    lost = np.floor((run.input_angle - run.input_angle[0]) / (10.0 * REVOLUTION)) * INPUT_QUANTUM
    fit = fit_kinematic_error(run.input_angle - lost, run.output_angle, RATIO, encoders=ENCODERS)
    assert any("does not close" in w for w in fit.warnings)
    assert fit.estimates["transmission_accuracy"].identifiable == "no"


def test_a_slow_drift_is_not_a_slip() -> None:
    run = slow_run(6)
    drift = 6.0 * ARCSEC * (1.0 - np.exp(-run.time / 40.0))
    assert (
        fit_kinematic_error(
            run.input_angle, run.output_angle + drift, RATIO, encoders=ENCODERS
        ).slips
        == ()
    )


def test_aliases_of_the_lattice() -> None:
    at_60_rpm = lattice_aliases(1000.0, 600.0, OUTPUT_QUANTUM, 12.0)
    assert at_60_rpm[0].harmonic == 5
    assert at_60_rpm[0].order == pytest.approx(0.0)
    assert at_60_rpm[0].amplitude == pytest.approx(OUTPUT_QUANTUM / (5 * np.pi))
    golden = lattice_aliases(600.0 * 1.6180339887, 600.0, OUTPUT_QUANTUM, 12.0)
    assert not golden or golden[0].harmonic > 12


def test_ratio_from_slope_inverts_its_definition() -> None:
    assert ratio_from_slope(120.0, 1.0 / 121.0 - 1.0 / 120.0) == pytest.approx(121.0)
