"""Loops of a spring with friction elements, whose numbers have closed forms: stiffness, loss, lost motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import Recording
from experiments.result import Result
from model.gear_file import shipped_gear
from model.identify.hysteresis import _angle_at
from tests.experiments.test_analyses_without_plan import foreign, stating

STIFFNESS = 20_000.0
ELEMENTS = ((30_000.0, 2.0), (15_000.0, 3.0))
"""Stiffness [N m/rad] and limit [N m] of springs in series with dry friction (Jenkins)."""
SWING = 2e-3
"""Amplitude of the torsion [rad]."""


def loops(number: int = 4, noise: float = 0.02, seed: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Torsion [rad] and torque [N m] of slow swings."""
    phase = np.linspace(0.0, 2.0 * np.pi * (number + 0.3), 1200 * number)
    angle = SWING * np.sin(phase)
    torque = STIFFNESS * angle
    for stiffness, limit in ELEMENTS:
        force = 0.0
        for k, change in enumerate(np.diff(angle, prepend=0.0)):
            force = min(max(force + stiffness * change, -limit), limit)
            torque[k] += force
    return angle, torque + noise * np.random.default_rng(seed).standard_normal(len(angle))


def recorded(angle: np.ndarray, torque: np.ndarray, name: str = "output_torque") -> Recording:
    time = np.arange(len(angle)) * 1e-2
    recording = foreign(time, position=(angle, "rad"), **{name: (torque, "N m")})
    return stating(recording, name, scale_relative_uncertainty=1e-4)


def analysed(recording: Recording, **settings: object) -> Result:
    evidence = Evidence(shipped_gear(), settings=settings)
    return catalogue.load("hysteresis").analyse(recording, evidence)


def test_the_numbers_of_a_loop_are_those_of_its_elements() -> None:
    result = analysed(recorded(*loops()), at_torque=5.0)
    limits = sum(limit for _, limit in ELEMENTS)
    truth = {
        "branch_stiffness": STIFFNESS,
        "secant_stiffness": STIFFNESS + limits / SWING,
        "loss": sum(4.0 * f * (SWING - f / k) for k, f in ELEMENTS),
        "hysteresis_loss": 2.0 * limits / STIFFNESS,
        "lost_motion": 2.0 * 5.0 / STIFFNESS,
    }
    assert result.metrics["loops"] >= 3
    for name, value in truth.items():
        estimate = result.estimates[name]
        assert estimate.value == pytest.approx(value, rel=0.02), name
        assert abs(estimate.value - value) <= 1.5 * estimate.expanded_uncertainty + 0.01 * value, (
            name
        )
        assert estimate.identifiable == "yes"
    assert len(result.tables[0].rows) == result.metrics["loops"]


def test_torsion_is_made_of_both_angles() -> None:
    angle, torque = loops()
    turned = 0.3 * np.sin(np.arange(len(angle)) / 500.0)
    run = foreign(
        np.arange(len(angle)) * 1e-2,
        input_angle=(120.0 * turned, "rad"),
        output_angle=(-(turned + angle), "rad"),
        output_torque=(torque, "N m"),
    )
    with pytest.raises(AnalysisError, match="needs the ratio"):
        analysed(run)
    known = dataclasses.replace(run, metadata=dataclasses.replace(run.metadata, ratio=120.0))
    assert analysed(known).options["angle"] == "torsion"
    assert analysed(known).estimates["branch_stiffness"].value == pytest.approx(STIFFNESS, rel=0.02)


def test_the_torque_of_the_motor_is_none_of_the_output() -> None:
    with pytest.raises(AnalysisError, match="torque at the output"):
        analysed(recorded(*loops(), name="torque"))


def test_half_a_loop_is_no_loop() -> None:
    angle, torque = loops()
    with pytest.raises(AnalysisError, match="makes no whole loop"):
        analysed(recorded(angle[:300], torque[:300] - torque[150]))


def test_one_loop_has_no_uncertainty() -> None:
    angle, torque = loops()
    result = analysed(recorded(angle[300:2000], torque[300:2000]))
    assert result.metrics["loops"] == 1
    assert {e.identifiable for e in result.estimates.values()} == {"no"}


def test_a_wrong_sign_is_said() -> None:
    angle, torque = loops()
    with pytest.raises(AnalysisError, match="wrong sign"):
        analysed(recorded(angle, -torque))


def test_a_torque_beyond_the_loops_is_refused() -> None:
    with pytest.raises(AnalysisError, match="outside the loops"):
        analysed(recorded(*loops()), at_torque=500.0)


def test_a_torque_that_never_moves_is_refused() -> None:
    angle, torque = loops()
    with pytest.raises(AnalysisError, match="does not move"):
        analysed(recorded(angle, np.full(len(torque), 3.0)))


def test_a_lag_that_the_import_states_is_taken_off() -> None:
    """A torque that is late by five rows opens the loops; with the lag stated they are what they are."""
    angle, torque = loops(noise=0.0)
    run = recorded(angle, np.interp(np.arange(len(angle)) - 5.0, np.arange(len(angle)), torque))
    process = {"stated": {"lag_s": {"output_torque": 0.05}}}
    stated = dataclasses.replace(run, metadata=dataclasses.replace(run.metadata, process=process))
    true, late, corrected = (
        analysed(r).estimates["loss"].value for r in (recorded(angle, torque), run, stated)
    )
    assert abs(late / true - 1.0) > 0.1
    assert corrected == pytest.approx(true, rel=1e-3)


def test_six_loops_are_drawn_of_many() -> None:
    result = analysed(recorded(*loops(9)))
    (drawn,) = (plot for plot in result.plots if plot.name == "hysteresis")
    assert result.metrics["loops"] > 6
    assert [one.label for one in drawn.series] == [f"loop {number}" for number in range(1, 7)]


def test_a_branch_with_nothing_near_a_torque_is_read_from_its_nearest_points() -> None:
    torque = np.array([-3.0, -1.5, 1.2, 2.7, 4.0])
    assert _angle_at(2e-3 * torque, torque, 0.0, 1.0) == pytest.approx(0.0, abs=1e-12)
