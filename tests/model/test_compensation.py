"""A correction sends the input to where the output is at its nominal angle, and its file says the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model.compensation import CompensationTable, Correction, DirectionTable, Proof, table_of_set
from model.compensation_file import compensation_from, compensation_text
from model.errors import ModelError
from model.gear_file import shipped_gear
from model.units import ARCSEC, REVOLUTION, RPM

WAY = DirectionTable(
    labels=("1/N", "2", "2+1/N", "4"),
    cosine=(2.0 * ARCSEC, 12.0 * ARCSEC, -1.0 * ARCSEC, 0.0),
    sine=(0.5 * ARCSEC, -9.0 * ARCSEC, 0.3 * ARCSEC, 4.0 * ARCSEC),
    covariance=((1e-14, 2e-15, 3e-14),) * 4,
    encoder=(1.6 * ARCSEC, 0.0, 0.0, 0.0),
    freedom=31.0,
    rest=0.2 * ARCSEC,
)
TABLE = CompensationTable(
    gear="G-1",
    part="CSF-25-120-2UH",
    mounting="circular-spline-fixed",
    ratio=120.0,
    sense=-1,
    bench="7",
    origin="simulated",
    encoder="ROD-1",
    learnt="",
    index_gap=0.41,
    speed=(30.0 * RPM, 60.0 * RPM),
    temperature=24.5,
    runs=("a.h5 123", "b.h5 456"),
    forward=WAY,
    reverse=replace(WAY, cosine=tuple(1.1 * a for a in WAY.cosine)),
)
PROOF = Proof(
    run="c.h5 789",
    verdict="PASS",
    speed=60.0 * RPM,
    ratio=1.02,
    low=0.9,
    high=1.2,
    removed=0.86,
    helps_up_to=480.0 * RPM,
    harms_from=None,
)


@pytest.fixture
def correction() -> Correction:
    return TABLE.of(1.0)


def test_an_input_along_it_has_its_output_at_the_nominal_angle(correction: Correction) -> None:
    phi = correction.turn(5000)
    theta = correction.corrected(phi)
    # (15): the output is at theta/N + ke(theta).
    off = theta / 120.0 + correction.error(theta) - phi / 120.0
    assert np.abs(off).max() < 1e-4 * ARCSEC
    # Without the second order (ke at phi, not at theta) a fiftieth of it would be left.
    first = phi - 120.0 * correction.error(phi)
    assert np.abs(first / 120.0 + correction.error(first) - phi / 120.0).max() > 0.2 * ARCSEC
    assert np.abs(correction.nominal(theta) - phi).max() < 1e-8


def test_its_peaks_are_those_of_its_slopes(correction: Correction) -> None:
    phi = correction.turn(200_000)
    added = correction.added(phi)
    steepest, sharpest = correction.steepness
    assert steepest == pytest.approx(np.abs(np.gradient(added, phi)).max(), rel=0.01)
    bent = np.gradient(np.gradient(added, phi), phi)
    assert sharpest == pytest.approx(np.abs(bent).max(), rel=0.02)
    assert correction.largest == pytest.approx(np.abs(added).max(), rel=0.01)


def test_each_direction_has_its_own() -> None:
    ahead, back = TABLE.of(5.0), TABLE.of(-5.0)
    assert ahead.waves[1].real == pytest.approx(12.0 * ARCSEC)
    assert back.waves[1].real == pytest.approx(1.1 * 12.0 * ARCSEC)


def test_a_class_is_a_bound_and_a_certificate_an_uncertainty() -> None:
    """Shares of a class of 6 arcsec over eight orders: the r.m.s. of a curve that reaches it is 6 over its crest."""
    share = 6.0 * ARCSEC / np.sqrt(3.0 * 8.0)
    labels = tuple(f"{k}/N" for k in range(1, 9))
    rows = (0.0,) * 8
    way = replace(
        WAY,
        labels=labels,
        cosine=rows,
        sine=rows,
        covariance=((0.0, 0.0, 0.0),) * 8,
        encoder=(float(share),) * 8,
    )
    classed = replace(TABLE, forward=way, reverse=way)
    assert classed.encoder_rms == pytest.approx(6.0 / 2.5 * ARCSEC)
    certified = replace(classed, learnt="a certificate")
    assert certified.encoder_rms == pytest.approx(6.0 / np.sqrt(3.0) * ARCSEC)


def test_one_that_would_turn_the_input_back_is_refused() -> None:
    degrees = replace(WAY, cosine=tuple(3600.0 * a for a in WAY.cosine))
    with pytest.raises(ModelError, match="more than a table may"):
        Correction.of(degrees, 120.0)


def test_the_series_of_a_set_is_a_table_of_both_directions() -> None:
    gear = shipped_gear()
    table = table_of_set(gear, "circular-spline-fixed")
    phi = np.linspace(0.0, REVOLUTION, 50)
    expected = sum(
        h.cosine * np.cos(h.order * phi) + h.sine * np.sin(h.order * phi)
        for h in gear.kinematic_error
    )
    for way in (1.0, -1.0):
        assert np.allclose(table.of(way).error(phi), expected, atol=1e-12)
    assert table.index_gap is None


@pytest.mark.parametrize("proof", [None, PROOF], ids=["not proved", "proved"])
def test_a_file_says_the_same(proof: Proof | None) -> None:
    table = replace(TABLE, proof=proof)
    again = compensation_from(compensation_text(table))
    assert compensation_text(again) == compensation_text(table)
    assert np.allclose(again.forward.cosine, WAY.cosine, rtol=1e-11)
    assert np.allclose(again.reverse.covariance, WAY.covariance, rtol=1e-11)
    assert again.index_gap == TABLE.index_gap
    assert again.runs == TABLE.runs
    assert (again.proof is None) == (proof is None)
    if again.proof is not None and proof is not None:
        assert again.proof.helps_up_to == pytest.approx(proof.helps_up_to)
        assert (again.proof.run, again.proof.verdict) == (proof.run, proof.verdict)
        assert again.proof.harms_from is None


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("ratio = 120.0", 'ratio = "120"', "ratio"),
        ("ratio = 120.0", "ratio = 120.0\nfast = 1.0", "fast"),
        ("sense = -1", "sense = 0", "sense"),
        ("[forward]", "[ahead]", "ahead"),
        ('labels = ["1/N", "2"', 'labels = ["2", "2"', "twice"),
        ("degrees_of_freedom = 31.0", "degrees_of_freedom = inf", "degrees_of_freedom"),
        ("cosine_arcsec = [2.0, ", "cosine_arcsec = [", "cosine_arcsec"),
        ('bench = "7"\n', "", "bench"),
        ("harmonic-rig-compensation-1", "harmonic-rig-compensation-9", "format"),
        ('gear = "G-1"', "gear = [", "TOML"),
    ],
)
def test_what_is_none_is_refused_by_name(old: str, new: str, names: str) -> None:
    text = compensation_text(TABLE)
    assert old in text
    with pytest.raises(ModelError, match=names):
        compensation_from(text.replace(old, new, 1), "t.toml")
