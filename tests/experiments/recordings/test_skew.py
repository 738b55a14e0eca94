"""The delay between two channels is found apart from hysteresis; where it cannot be, the analysis says so."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from experiments import catalogue
from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.recording import Recording
from experiments.result import Result
from model.gear_file import shipped_gear
from tests.experiments.test_analyses_without_plan import foreign

RATIO, DELAY, HYSTERESIS = 120.0, 2e-3, 1e-4
PERIOD = 1e-3


def swings(*speeds: float, seconds: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and speed [rad/s] of holds at these speeds, ramps of 0.1 s between them."""
    hold, ramp = int(seconds / PERIOD), int(0.1 / PERIOD)
    parts = [np.full(hold, speeds[0])]
    for last, now in itertools.pairwise(speeds):
        parts += [np.linspace(last, now, ramp), np.full(hold, now)]
    speed = np.concatenate(parts)
    return np.arange(len(speed)) * PERIOD, speed


def encoders(*speeds: float, delay: float = DELAY, sense: float = 1.0) -> Recording:
    """Input and output angle, the output later by the delay and behind by the hysteresis."""
    time, speed = swings(*speeds)
    random = np.random.default_rng(5)
    angle = np.cumsum(speed) * PERIOD
    later = np.interp(time - delay, time, angle)
    output = later / RATIO - HYSTERESIS * np.sign(speed) + 2e-6 * random.standard_normal(len(time))
    run = foreign(time, input_angle=(angle, "rad"), output_angle=(sense * output, "rad"))
    metadata = dataclasses.replace(run.metadata, output_sense=int(sense), ratio=RATIO)
    return dataclasses.replace(run, metadata=metadata)


def analysed(recording: Recording, **settings: object) -> Result:
    return catalogue.load("skew").analyse(recording, Evidence(shipped_gear(), settings=settings))


BOTH = {"first": "input_angle", "second": "output_angle"}


@pytest.mark.parametrize("delay", [DELAY, 0.0, -DELAY])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_delay_and_hysteresis_of_two_encoders(delay: float, sense: float) -> None:
    result = analysed(encoders(50.0, -50.0, 200.0, -200.0, delay=delay, sense=sense), **BOTH)
    skew, hysteresis = result.estimates["skew"], result.estimates["hysteresis"]
    assert abs(skew.value - delay) <= skew.expanded_uncertainty
    assert skew.expanded_uncertainty < 2e-4
    assert abs(hysteresis.value) == pytest.approx(HYSTERESIS, rel=0.05)
    assert result.estimates["gain"].value == pytest.approx(1.0 / RATIO, rel=1e-5)
    assert skew.identifiable == ("yes" if delay else "weakly")
    assert any("viscous wind-up" in warning for warning in result.warnings)


def test_one_speed_is_refused_with_the_sum() -> None:
    with pytest.raises(AnalysisError, match="one speed only") as caught:
        analysed(encoders(100.0, -100.0), **BOTH)
    # Delay times the output's speed, and the hysteresis.
    shown = DELAY * 100.0 / RATIO + HYSTERESIS
    assert f"their sum is {-shown:.2g}"[:18] in str(caught.value)


def test_a_measured_speed_behind_the_derivative_of_the_angle() -> None:
    """As of a robot whose drive filters its speed: 0.19 s, with pauses."""
    time = np.arange(0.0, 30.0, 0.01)
    speed = np.where(np.sin(0.9 * time) > -0.2, np.sin(2.0 * time) * np.sin(0.7 * time), 0.0)
    angle = np.cumsum(speed) * 0.01
    late = 0.99 * np.interp(time - 0.19, time, speed)
    random = np.random.default_rng(6)
    run = foreign(
        time,
        position=(angle + 1e-5 * random.standard_normal(len(time)), "rad"),
        speed=(late + 2e-3 * random.standard_normal(len(time)), "rad/s"),
    )
    result = analysed(run, first="position", second="speed")
    assert result.estimates["skew"].value == pytest.approx(0.19, abs=0.006)
    assert result.estimates["gain"].value == pytest.approx(0.99, abs=0.01)
    assert "hysteresis" not in result.estimates


def test_a_torque_behind_the_acceleration_with_friction_between() -> None:
    time = np.arange(0.0, 20.0, 1e-3)
    angle = 3.0 * np.sin(2.0 * time) + 0.3 * np.sin(9.0 * time + 1.0)
    speed = 6.0 * np.cos(2.0 * time) + 2.7 * np.cos(9.0 * time + 1.0)
    acceleration = -12.0 * np.sin(2.0 * time) - 24.3 * np.sin(9.0 * time + 1.0)
    late = np.interp(time - 4e-3, time, acceleration)
    noise = 0.02 * np.random.default_rng(7).standard_normal(len(time))
    torque = 0.05 * late + 0.02 * speed + 0.2 * np.sign(speed) + noise
    run = foreign(time, position=(angle, "rad"), torque=(torque, "N m"))
    result = analysed(run, first="position", second="torque")
    skew = result.estimates["skew"]
    assert abs(skew.value - 4e-3) <= max(skew.expanded_uncertainty, 4e-4)
    assert result.estimates["gain"].value == pytest.approx(0.05, rel=0.03)


def test_channels_that_have_nothing_to_do_with_each_other_are_refused() -> None:
    run = encoders(50.0, -200.0, 200.0)
    noise = np.random.default_rng(8).standard_normal(run.rows)
    stranger = foreign(
        np.arange(run.rows) * PERIOD, speed=(noise, "rad/s"), output_speed=(noise[::-1], "rad/s")
    )
    with pytest.raises(AnalysisError, match="do not follow each other"):
        analysed(stranger, first="speed", second="output_speed")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"first": "input_angle"}, "between two channels"),
        ({"first": "input_angle", "second": "input_angle"}, "between two channels"),
        ({"first": "input_angle", "second": "torque"}, "does not have"),
        ({"first": "input_angle", "second": "output_angle", "way": 1}, "no such setting"),
    ],
)
def test_what_makes_no_pair_is_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(AnalysisError, match=words):
        analysed(encoders(50.0, -200.0), **settings)


def test_a_nominal_time_tells_no_delay() -> None:
    run = encoders(50.0, -200.0)
    nominal = dataclasses.replace(run.metadata, time_base="nominal")
    with pytest.raises(AnalysisError, match="true time"):
        analysed(dataclasses.replace(run, metadata=nominal), **BOTH)
    assert math.isfinite(analysed(run, **BOTH).estimates["skew"].value)


@pytest.mark.parametrize(("stated", "is_said"), [(DELAY, False), (0.0, True)])
def test_a_stated_lag_is_held_against_the_delay(stated: float, is_said: bool) -> None:
    run = encoders(50.0, -50.0, 200.0, -200.0)
    process = {"stated": {"lag_s": {"output_angle": stated}}}
    run = dataclasses.replace(run, metadata=dataclasses.replace(run.metadata, process=process))
    result = analysed(run, **BOTH)
    assert result.options["stated_s"] == stated
    assert any("The import states" in warning for warning in result.warnings) is is_said
