"""Kinematic error with the certificate of an encoder: what it takes off, its budget, and when it is refused."""

from __future__ import annotations

import cmath
import dataclasses
import math

import numpy as np
import pytest

from experiments.angle.certified import certified_angle, certified_angles
from experiments.angle.phase_reference import phase_reference
from experiments.contract import Evidence
from experiments.protocols.kinematic_error import analysis as kinematic_error
from experiments.protocols.kinematic_error import declaration as kinematic_error_declaration
from experiments.protocols.kinematic_error import plan as kinematic_error_plan
from experiments.protocols.velocity_steps import declaration as velocity_steps_declaration
from experiments.protocols.velocity_steps import plan as velocity_steps_plan
from experiments.protocols.velocity_steps.data import recorded_steps
from experiments.recording import ArraySource, Recording
from experiments.result import Result
from model.angle_certificate import AngleCertificate
from model.channel import Calibration
from model.gear import Harmonic, HarmonicDrive
from model.kinematic_error import series_value
from model.units import ARCSEC, REVOLUTION
from tests.experiments.conftest import SERIES
from tests.experiments.synthetic import Bench, record

RATIO = 120.0
CLASS = 30.0 * ARCSEC
U = 0.5 * ARCSEC
SEATED = {"output_eccentricity": 0.01, "input_eccentricity": 0.01}
"""A seat that is trued up: the encoder is all that can be mistaken for the gear."""


SHOWN = (
    Harmonic(1.0, 12.0 * ARCSEC * math.cos(1.0), 12.0 * ARCSEC * math.sin(1.0)),
    Harmonic(3.0, 0.0, 6.0 * ARCSEC),
)
"""What the output encoder shows too much over its own angle from its mark."""


def certificate(sense: float = 1.0, turn: float = 0.0) -> AngleCertificate:
    angle = np.arange(36) * (REVOLUTION / 36)
    return AngleCertificate(
        angles=tuple(angle.tolist()),
        errors=tuple((sense * series_value(SHOWN, sense * angle + turn)).tolist()),
        expanded_uncertainties=(U,) * 36,
    )


def arrays_of(run: Recording) -> ArraySource:
    assert isinstance(run.source, ArraySource)
    return run.source


@pytest.fixture(scope="module")
def wrong(bench: Bench, gear: HarmonicDrive) -> Recording:
    """The run as an encoder records it that shows too much; it counts down while the gear turns up."""
    run = record(
        kinematic_error_plan.plan(kinematic_error_declaration.Parameters(speed_rpm=92.7), gear),
        dataclasses.replace(bench, output_shows=SHOWN),
        "kinematic-error",
    )
    channel = dataclasses.replace(
        run.signals["output_angle"], calibration=Calibration(accuracy=CLASS)
    )
    return dataclasses.replace(run, signals={**run.signals, "output_angle": channel})


def with_curve(run: Recording, curve: AngleCertificate) -> Recording:
    signal = run.signals["output_angle"]
    calibration = dataclasses.replace(signal.calibration, curve=curve)
    changed = dataclasses.replace(signal, calibration=calibration)
    return dataclasses.replace(run, signals={**run.signals, "output_angle": changed})


def with_counts(run: Recording, **changes: np.ndarray) -> Recording:
    source = arrays_of(run)
    return dataclasses.replace(
        run, source=dataclasses.replace(source, arrays={**source.arrays, **changes})
    )


def analysed(run: Recording, gear: HarmonicDrive) -> Result:
    return kinematic_error.analyse(run, Evidence(gear, settings=SEATED))


@pytest.fixture(scope="module")
def by_class(wrong: Recording, gear: HarmonicDrive) -> Result:
    return analysed(wrong, gear)


@pytest.fixture(scope="module")
def by_certificate(wrong: Recording, gear: HarmonicDrive) -> Result:
    return analysed(with_curve(wrong, certificate()), gear)


def wave(result: Result, label: str) -> complex:
    """c of a cos + b sin = Re c exp(j x)."""
    amplitude, phase = (result.estimates[f"{part}_{label}"] for part in ("amplitude", "phase"))
    return cmath.rect(amplitude.value, -phase.value)


def true_wave(order: float) -> complex:
    return sum(
        (complex(h.cosine, -h.sine) for h in SERIES if abs(h.order - order) < 1e-9), start=0.0 + 0j
    )


def test_once_per_output_turn_is_the_gears_with_a_certificate_and_not_without(
    by_class: Result, by_certificate: Result
) -> None:
    without, found = (r.estimates["amplitude_1/N"] for r in (by_class, by_certificate))
    assert without.identifiable == "weakly"
    assert found.identifiable == "yes"
    assert found.expanded_uncertainty < 0.1 * without.expanded_uncertainty
    assert abs(wave(by_certificate, "1/N") - true_wave(1.0 / RATIO)) < 0.2 * ARCSEC
    assert abs(wave(by_class, "1/N") - true_wave(1.0 / RATIO)) > 8.0 * ARCSEC
    assert abs(found.value - abs(true_wave(1.0 / RATIO))) <= found.expanded_uncertainty


def test_an_order_that_the_encoder_alone_makes_is_gone(
    by_class: Result, by_certificate: Result
) -> None:
    assert by_class.estimates["amplitude_3/N"].value == pytest.approx(6.0 * ARCSEC, rel=0.05)
    assert by_certificate.estimates["amplitude_3/N"].value < 0.2 * ARCSEC


def test_the_certificate_stands_in_the_budget_in_place_of_the_class(
    by_class: Result, by_certificate: Result
) -> None:
    for label, factor in (("1/N", 1.0), ("2/N", 1.0), ("8/N", 1.0)):
        lines = by_certificate.estimates[f"amplitude_{label}"].budget
        (line,) = [one for one in lines if one.source.startswith("output encoder")]
        assert line.standard_uncertainty == pytest.approx(factor * 0.5 * U)
        assert "certificate" in line.note
        assert not any("class" in one.note for one in lines)
    whole = [
        next(
            one
            for one in r.estimates["transmission_accuracy_forward"].budget
            if one.source == "output encoder, whole curve"
        )
        for r in (by_class, by_certificate)
    ]
    assert whole[0].standard_uncertainty == pytest.approx(CLASS / math.sqrt(3.0))
    assert whole[1].standard_uncertainty == pytest.approx(0.5 * U * math.sqrt(2.0))
    assert by_certificate.options["corrected_by_certificate"] == "output_angle"
    assert "corrected_by_certificate" not in by_class.options


def test_the_transmission_accuracy_is_that_of_the_gear(
    by_class: Result, by_certificate: Result, result_without_encoder: Result
) -> None:
    name = "transmission_accuracy_forward"
    true, seen, corrected = (
        r.estimates[name].value for r in (result_without_encoder, by_class, by_certificate)
    )
    assert abs(seen - true) > 2.0 * ARCSEC
    assert abs(corrected - true) < 0.5 * ARCSEC
    found = by_certificate.estimates[name]
    assert found.expanded_uncertainty < 0.2 * by_class.estimates[name].expanded_uncertainty


@pytest.fixture(scope="module")
def result_without_encoder(kinematic_error_run: Recording, gear: HarmonicDrive) -> Result:
    return analysed(kinematic_error_run, gear)


@pytest.mark.parametrize("curve", [certificate(sense=-1.0), certificate(turn=1.0)])
def test_a_curve_in_the_wrong_sense_or_from_another_zero_corrects_nothing(
    wrong: Recording, gear: HarmonicDrive, curve: AngleCertificate
) -> None:
    """Sense and zero are what the correction stands on: with others the truth is far outside."""
    result = analysed(with_curve(wrong, curve), gear)
    assert abs(wave(result, "1/N") - true_wave(1.0 / RATIO)) > 5.0 * ARCSEC


def test_a_channel_that_is_turned_round_is_corrected_in_its_own_sense(
    wrong: Recording, gear: HarmonicDrive, by_certificate: Result
) -> None:
    """direction = -1 turns the sense on this computer's side: the curve stays that of the counts."""
    run = with_curve(wrong, certificate())
    turned = {
        name: dataclasses.replace(run.signals[name], direction=-1)
        for name in ("output_angle", "output_index")
    }
    metadata = dataclasses.replace(run.metadata, output_sense=-run.metadata.output_sense)
    other = dataclasses.replace(run, signals={**run.signals, **turned}, metadata=metadata)
    result = analysed(other, gear)
    for label in ("1/N", "1", "2"):
        assert abs(wave(result, label) - wave(by_certificate, label)) < 1e-3 * ARCSEC


def refused(run: Recording, gear: HarmonicDrive, by_class: Result) -> str:
    """The warning of a result that is that of the class, number by number."""
    result = analysed(run, gear)
    assert result.estimates == by_class.estimates
    assert "corrected_by_certificate" not in result.options
    (sentence,) = [w for w in result.warnings if "certificate" in w]
    assert sentence.startswith("The certificate of the output encoder is not used: ")
    assert sentence.endswith("Its class stands in the budget.")
    return sentence


def test_without_an_index_mark_nothing_is_corrected_and_the_result_says_so(
    wrong: Recording, gear: HarmonicDrive
) -> None:
    seen = arrays_of(wrong).arrays["index_seen"]
    unseen = with_counts(wrong, index_seen=seen & 1)
    without = analysed(unseen, gear)
    assert "no index mark" in refused(with_curve(unseen, certificate()), gear, without)


def test_marks_that_are_not_whole_revolutions_apart_correct_nothing(
    wrong: Recording, gear: HarmonicDrive, by_class: Result
) -> None:
    """Lost counts: from then on the curve would lie beside the encoder's."""
    index = arrays_of(wrong).arrays["output_index"].copy()
    half = len(index) // 2
    index[half:] += 100
    assert 100 * 360.0 / 72000 > 0.1
    sentence = refused(
        with_curve(with_counts(wrong, output_index=index), certificate()), gear, by_class
    )
    assert "0.5 degrees beside whole revolutions (limit 0.1)" in sentence


def test_a_curve_that_is_not_used_bounds_the_encoder_where_no_class_is_stated(
    wrong: Recording, gear: HarmonicDrive
) -> None:
    unseen = with_counts(wrong, index_seen=arrays_of(wrong).arrays["index_seen"] & 1)
    unclassed = dataclasses.replace(unseen.signals["output_angle"], calibration=Calibration())
    run = dataclasses.replace(unseen, signals={**unseen.signals, "output_angle": unclassed})
    result = analysed(with_curve(run, certificate()), gear)
    (line,) = [
        one
        for one in result.estimates["transmission_accuracy_forward"].budget
        if one.source == "output encoder, whole curve"
    ]
    assert line.standard_uncertainty == pytest.approx(certificate().half_width / math.sqrt(3.0))


def test_the_angle_at_the_mark_stays_as_it_is(wrong: Recording, bench: Bench) -> None:
    """Phases count from the marks: a certificate does not turn them."""
    found, sentence = certified_angle(with_curve(wrong, certificate()), "output_angle")
    assert sentence == ""
    assert found is not None
    own = wrong.signals["output_angle"].scale
    assert math.remainder(found.mark + bench.output_index, REVOLUTION) == pytest.approx(
        0.0, abs=own
    )
    at = np.array([found.mark, found.mark - 3.0 * REVOLUTION])
    np.testing.assert_allclose(found.corrected(at), at, atol=1e-12)


def test_the_motor_encoder_has_a_certificate_of_its_own(
    kinematic_error_run: Recording, gear: HarmonicDrive
) -> None:
    """120 arcsec of the motor encoder are one at the output, at input order 1."""
    channel = kinematic_error_run.signals["input_angle"]
    source = arrays_of(kinematic_error_run)
    counts = source.arrays["input_angle"]
    angle = channel.to_si(counts) - 1.0
    errors = 600.0 * ARCSEC * np.cos(angle)
    wrong = with_counts(
        kinematic_error_run,
        input_angle=counts + np.round(errors / channel.scale).astype(np.int64),
    )
    points = np.arange(36) * (REVOLUTION / 36)
    curve = AngleCertificate(
        angles=tuple(points.tolist()),
        errors=tuple((600.0 * ARCSEC * np.cos(points)).tolist()),
        expanded_uncertainties=(12.0 * ARCSEC,) * 36,
    )
    signal = dataclasses.replace(channel, calibration=Calibration(curve=curve))
    corrected = dataclasses.replace(wrong, signals={**wrong.signals, "input_angle": signal})
    before, after = (analysed(run, gear) for run in (wrong, corrected))
    assert abs(wave(before, "1") - true_wave(1.0)) > 4.5 * ARCSEC
    assert abs(wave(after, "1") - true_wave(1.0)) < 0.3 * ARCSEC
    (line,) = [
        one
        for one in after.estimates["amplitude_1"].budget
        if one.source.startswith("motor encoder")
    ]
    assert line.standard_uncertainty == pytest.approx(6.0 * ARCSEC / RATIO)


def test_steps_are_read_without_what_the_certificate_states(
    bench: Bench, gear: HarmonicDrive
) -> None:
    plan = velocity_steps_declaration.Parameters(speeds_rpm=(1800.0,), repeats=1, duration=0.5)
    there = dataclasses.replace(bench, output_index=0.01)
    clean, shown = (
        record(velocity_steps_plan.plan(plan, gear), one, "velocity-steps")
        for one in (there, dataclasses.replace(there, output_shows=SHOWN))
    )

    def output(run: Recording) -> np.ndarray:
        certified, said = certified_angles(run)
        assert not said
        steps, _, _ = recorded_steps(
            run,
            ratio=RATIO,
            reference=phase_reference(run),
            zero=None,
            source=None,
            resonance=600.0,
            certified=certified,
        )
        return np.concatenate([np.diff(step.data.output_angle) for step in steps])

    count = shown.signals["output_angle"].quantum
    assert count is not None
    found = {
        "class": output(shown) - output(clean),
        "certificate": output(with_curve(shown, certificate())) - output(clean),
    }
    # What the certificate states moves by less than a count from sample to sample, and adds up.
    assert np.abs(np.cumsum(found["certificate"])).max() < 3.0 * count
    assert np.abs(np.cumsum(found["class"])).max() > 5.0 * ARCSEC
