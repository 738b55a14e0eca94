"""Recordings that others made and published figures of: those of this folder, and the rest where they are beside it."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

from experiments.contract import Evidence
from experiments.recording import Recording
from experiments.recordings.motion import analysis as motion
from experiments.result import Result
from model.gear import HarmonicDrive
from model.identify.hysteresis import fit_hysteresis
from tests.experiments.recordings.test_friction_curve import fitted, table
from tests.experiments.test_analyses_without_plan import foreign

HERE = Path(__file__).parents[2] / "data"
DATA = Path(os.environ.get("HARMONIC_RIG_DATA", Path(__file__).parents[4] / "shared" / "data"))
needs_data = pytest.mark.skipif(
    not (DATA / "staubli_tx40").is_dir(), reason="the recordings are not there"
)
WITHIN = 0.08
"""Of the published viscous and Coulomb friction of the Staubli."""


def columns(path: Path) -> np.ndarray:
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array(rows, dtype=np.float64).T


def analysed(recording: Recording, gear: HarmonicDrive, **settings: object) -> Result:
    return motion.analyse(recording, Evidence(gear, settings=dict(settings)))


def values(result: Result, *names: str) -> list[float]:
    return [result.estimates[name].value for name in names]


def pairs(recording: np.ndarray) -> Recording:
    """Speed and coefficient of friction, the force over a constant normal force of 100 N."""
    _, speed, normal, force = recording
    return table(speed, force / normal)


def test_a_joint_of_the_staubli(gear: HarmonicDrive) -> None:
    angle, torque = columns(HERE / "staubli_tx40" / "joint_1.csv")
    time = 1e-3 * np.arange(len(angle))
    run = foreign(time, position=(angle / 32.0, "rad"), torque=(32.0 * torque, "N m"))
    result = analysed(run, gear)
    assert values(result, "viscous", "coulomb") == pytest.approx([8.0278, 7.2318], rel=WITHIN)
    assert {result.estimates[n].identifiable for n in ("inertia", "viscous", "coulomb")} == {"yes"}


def test_a_joint_that_stands_half_of_the_time(gear: HarmonicDrive) -> None:
    """0.07 A would say that the standstill was taken for friction."""
    time, position, current = columns(HERE / "tiago_arm" / "arm_1.csv")
    result = analysed(foreign(time, position=(position, "rad"), current=(current, "A")), gear)
    assert values(result, "coulomb")[0] == pytest.approx(0.144, abs=0.008)
    assert values(result, "viscous")[0] == pytest.approx(2.2, abs=0.06)
    assert result.estimates["coulomb"].unit == "A"


def test_pairs_with_presliding_do_not_collapse() -> None:
    """All rows: least squares of a Stribeck curve over them has a Coulomb friction of -92.6 N."""
    result = fitted(pairs(columns(HERE / "stribeck_pairs" / "test_data_1.csv")))
    assert result.options["law"]["both"] == "stribeck"
    assert 0.140794 < values(result, "coulomb")[0] < 0.154256
    found = values(result, "coulomb", "static", "stribeck_velocity")
    assert found == pytest.approx([0.15, 0.25, 0.25], rel=0.08)
    assert 0.1 < result.metrics["least_speed"] < 0.3
    assert result.metrics["points"] > 300.0


@needs_data
def test_the_speed_of_a_robot_is_late(gear: HarmonicDrive) -> None:
    time, position = columns(DATA / "tiago_arm" / "tiago_position.csv")[:2]
    speed = columns(DATA / "tiago_arm" / "tiago_velocity.csv")[1]
    current = columns(DATA / "tiago_arm" / "tiago_effort.csv")[1]
    channels = {"position": (position, "rad"), "speed": (speed, "rad/s"), "current": (current, "A")}
    result = analysed(foreign(time, **channels), gear)
    assert values(result, "speed_lag")[0] == pytest.approx(0.14, abs=0.01)
    assert values(result, "coulomb")[0] == pytest.approx(0.144, abs=0.008)


@needs_data
def test_a_pendulum_that_swings_out(gear: HarmonicDrive) -> None:
    """Free of torque it brakes by its own friction; the load's known weight (0.49 kg at 0.1 m) is the effort."""
    content = json.loads((DATA / "servo_pendulum" / "2026-01-15_10h29m21.json").read_text())
    rows = [entry for entry in content["entries"] if 2.02 <= entry["timestamp"] <= 4.4]
    time, angle = (np.array([row[name] for row in rows]) for name in ("timestamp", "position"))
    weight = -0.4807 * np.sin(angle)
    run = foreign(time, position=(angle, "rad"), torque=(weight, "N m"))
    by_itself = analysed(run, gear).estimates["inertia"]
    assert abs(by_itself.value - 0.00695) < by_itself.expanded_uncertainty
    # The weight is made of the same noisy angle: a cut-off nearer to the swing (1.3 Hz) keeps that noise out.
    result = analysed(run, gear, cutoff_hz=20.0)
    viscous, coulomb = values(result, "viscous", "coulomb")
    assert coulomb + 2.0 * viscous == pytest.approx(0.0250, rel=0.15)
    assert values(result, "inertia")[0] == pytest.approx(0.00695, rel=0.1)


@needs_data
def test_a_tribometer_with_pauses(gear: HarmonicDrive) -> None:
    """Its force builds up over most of its way: loops carry figures, a law of friction over speed does not."""
    time, _, position, friction = np.loadtxt(
        DATA / "tribometer" / "test_data_2.txt", skiprows=1, unpack=True
    )
    cycles = (time >= 20.0) & (time < 132.0)
    time, way, force = time[cycles], 1e-3 * position[cycles], -1e-6 * friction[cycles]
    loops = fit_hysteresis(way, force).estimates["loss"]
    assert loops.value == pytest.approx(516.1e-6, abs=8.4e-6)
    result = analysed(foreign(time, position=(way, "m"), force=(force, "N")), gear)
    assert result.metrics["standstill_share"] == pytest.approx(0.48, abs=0.03)
    assert {e.identifiable for e in result.estimates.values()} == {"no"}


@needs_data
def test_a_tribometer_where_it_slides() -> None:
    """A coefficient of 0.4643 ± 0.0034 forward and 0.4642 ± 0.0032 back at a normal force of 5 N."""
    time, normal, position, friction = np.loadtxt(
        DATA / "tribometer" / "test_data_2.txt", skiprows=1, unpack=True
    )
    way = position - position[0]
    speed = 1e-3 * np.gradient(position, time)
    forward = (speed > 20e-6) & (way > 0.17) & (way < 0.225)
    back = (speed < -20e-6) & (way > 0.025) & (way < 0.08)
    slides = (time >= 20.0) & (time < 132.0) & (forward | back)
    points = table(speed[slides], -friction[slides] / normal[slides])
    result = fitted(points, law="coulomb")
    assert values(result, "coulomb")[0] == pytest.approx(0.4643, abs=0.0034)
    assert abs(values(result, "offset")[0]) < 0.0034
